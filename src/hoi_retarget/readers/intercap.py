"""Reads InterCap's results: `<subject>/<object>/Seg_<n>/res.pkl`, one person and one object from six cameras.

A pickle holds a dictionary of the whole recording, or a list with a dictionary for each frame: a person as gendered
SMPL-X, ten betas, hands as twelve principal components from the model's mean hand (YinghaoHuang91/InterCap
prox_second/cfg_files/SMPLifyD.yaml), and the object's rotation vectors and positions, `ob_pose` and `ob_trans`. The
makers' scripts move the mesh as it is in its file (prox_second/prox/fitting.py), and save the moved one of every frame
in `Mesh`: what is there in the first frame, moved back, is the shape. Folders tell subject and object. 30 frames a
second.

Everything is in the frame of the first camera, metres, y down, tilted by nine degrees. The makers' scripts hold bodies
and objects above a floor that they give as a point and a normal, and feet on it (the same file): that floor becomes
z = 0 where the feet are indeed on it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError, GeometryError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.body_parameters import BodyParameters
from hoi_retarget.readers.fields import Fields
from hoi_retarget.readers.object_files import first_mesh
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks
from hoi_retarget.readers.worlds import TURN, Turn, World

FORMAT = "intercap"
LICENCE = "InterCap's licence: non-commercial scientific research only"
FPS = 30.0
UP = "-y"
_NAMES = ["suitcase", "skateboard", "soccerball", "umbrella", "racket", "toolbox", "chair", "bottle", "cup", "stool"]
OBJECTS: Mapping[str, str] = {f"{number:02d}": name for number, name in enumerate(_NAMES, start=1)}
"""Object's folder -> its name."""
MALE = ("01", "02", "04", "05", "10")
SUBJECTS = tuple(f"{number:02d}" for number in range(1, 11))
FLOOR_POINT = (-0.07362306, 1.06334016, 2.88126607)  # A point of the floor in the first camera's frame [m]...
FLOOR_NORMAL = (0.02645398, -0.98627183, -0.16299712)  # ...and the direction upward there.
MIN_FOOT_HEIGHT, MAX_FOOT_HEIGHT = -0.1, 0.25
"""[m]; the lower foot's joints are between these heights above the floor..."""
MIN_SHARE_ON_FLOOR = 0.8  # ...in this part of the frames of a recording that has the makers' floor.
MAX_MISFIT = 0.02  # [m]; between the mesh of `--objects` and the one beside the recording.

_WIDTHS = {
    "global_orient": 3,
    "body_pose": 63,
    "transl": 3,
    "betas": 10,
    "left_hand_pose": 12,
    "right_hand_pose": 12,
    "ob_pose": 3,
    "ob_trans": 3,
}
"""Numbers a frame of everything that is used."""
_KEYS = ("body_pose", "global_orient", "ob_pose", "ob_trans")
_MESHES, _FIRST_MESH = "Mesh", "00000_second_obj.ply"
_FEET = [JOINT_INDEX[f"{side}_{joint}"] for side in ("left", "right") for joint in ("ankle", "foot")]


@dataclass(frozen=True)
class _Place:
    """Subject, object and segment of a recording, from the names of its folders."""

    subject: str
    object: str
    segment: str

    @property
    def gender(self) -> str:
        return "male" if self.subject in MALE else "female"

    @property
    def name(self) -> str:
        return OBJECTS[self.object]


def holds(file: SourceFile) -> bool:
    """Return whether a pickle is a dictionary, or a list of some, with a body's pose and an object's."""
    value = file.pickle
    first = value[0] if isinstance(value, list) and value else value
    return isinstance(first, Mapping) and all(name in first for name in _KEYS)


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a file."""
    place = _place(file)
    fields = _fields(file)
    frames = len(fields.array("global_orient", ("T", 3), "the pelvis's rotation"))

    def read_tracks() -> Tracks:
        betas = fields.array("betas", ("T", 10), "the body's shape")
        if len(betas) != 1:
            betas = fields.array("betas", (frames, 10), "the body's shape")
        body = BodyParameters.of_fields(fields, frames, hand=12, gender=place.gender, betas=betas, flat_hands=False)
        quats = se3.exp(fields.array("ob_pose", (frames, 3), "the object's rotation vectors"))
        positions = fields.array("ob_trans", (frames, 3), "the object's position")
        saved = _saved_geometry(file, place, positions[0], quats[0])
        track = ObjectTrack(place.name, positions, quats, _geometry(file, place, options, saved))
        return Tracks(people=(body,), objects=(track,))

    return SourceRecording(
        name=f"{place.subject}_{place.object}_{place.segment}",
        description="InterCap recording of one person and one object",
        frames=frames,
        fps=FPS,
        skeleton=f"SMPL-X {place.gender}, {_WIDTHS['betas']} betas",
        up_axis="-y of the first camera, tilted as its makers' scripts have it",
        objects=(place.name,),
        licence=LICENCE,
        up=_world,
        read_tracks=read_tracks,
    )


def _place(file: SourceFile) -> _Place:
    steps = file.path.resolve().parts[-4:-1]
    place = _Place(*steps) if len(steps) == 3 else None
    if place is None or place.subject not in SUBJECTS or place.object not in OBJECTS:
        raise ClipError(
            f"{file.name}: the folders that it is in do not tell whose recording of which object it is. Expected "
            "<subject>/<object>/Seg_<n>/res.pkl with subjects and objects 01 to 10, as InterCap has them."
        )
    return place


def _fields(file: SourceFile) -> Fields:
    """Return everything that is used as rows for frames."""
    value = file.pickle
    if isinstance(value, Mapping):
        rows = {name: _rows(file.path, name, value[name], width) for name, width in _WIDTHS.items() if name in value}
    else:
        rows = {name: _rows_of_frames(file.path, name, value, width) for name, width in _WIDTHS.items()}
    return Fields(file.path, rows)


def _rows_of_frames(path: Path, name: str, frames: Sequence[Any], width: int) -> Float[np.ndarray, "T n"]:
    rows = []
    for number, frame in enumerate(frames):
        known = isinstance(frame, Mapping) and name in frame
        row = _rows(path, f"frame {number}'s {name}", frame[name], width) if known else ()
        if len(row) != 1:
            raise ClipError(f"{path}: frame {number} has not one {name}, but {len(row)}. Download the recording again.")
        rows.append(row[0])
    return np.array(rows)


def _rows(path: Path, name: str, value: Any, width: int) -> Float[np.ndarray, "T n"]:
    """Return a value as a row for each frame: of one frame, with frames first, or all in one row; raises `ClipError`.

    One row is how the makers' script saves the body's pose.
    """
    try:
        numbers = np.asarray(value)
    except ValueError:  # Lists of several lengths.
        numbers = np.zeros(0, dtype=object)
    frames = numbers.size / width
    in_order = numbers.shape[:1] in ((1,), (frames,)) or frames == 1
    if numbers.dtype.kind not in "fiu" or not in_order or not frames or frames % 1:
        raise ClipError(
            f"{path}: {name} has shape {numbers.shape} of {numbers.dtype}, expected {width} numbers for each frame. "
            "Download the recording again."
        )
    return numbers.reshape(-1, width).astype(float)


def _saved_geometry(
    file: SourceFile, place: _Place, position: Float[np.ndarray, "3"], quat: Float[np.ndarray, "4"]
) -> ObjectGeometry | None:
    """Return the shape from the mesh that is saved as it lies in the first frame; None where there is none."""
    path = file.beside(_MESHES, _FIRST_MESH)
    if not path.is_file():
        return None
    lying = first_mesh(place.name, [path], centred=False)
    return replace(lying, points=se3.rotate_inverse(quat, lying.points - position))


def _geometry(file: SourceFile, place: _Place, options: ReadOptions, saved: ObjectGeometry | None) -> ObjectGeometry:
    if options.objects is None:
        if saved is None:
            raise GeometryError(
                f"{file.name}: the object's mesh is not beside it, looked for {_MESHES}/{_FIRST_MESH}. Add that folder "
                f"of the recording, or pass --objects DIR with {place.object}.obj in it."
            )
        return saved
    candidates = [options.objects / f"{place.object}{suffix}" for suffix in (".obj", ".ply")]
    given = first_mesh(place.name, candidates, centred=False)
    if saved is not None:
        ends = [np.stack([item.points.min(axis=0), item.points.max(axis=0)]) for item in (given, saved)]
        misfit = float(np.abs(ends[0] - ends[1]).max())
        if misfit > MAX_MISFIT:
            raise GeometryError(
                f"--objects {options.objects}: the mesh of {place.name!r} is up to {misfit:.3f} m off the one in "
                f"{_MESHES}/{_FIRST_MESH} beside {file.name}: it was moved or scaled. Leave the option out, or give "
                "the makers' mesh."
            )
    return given


def _world(person: Person) -> World:
    """Return the world with the data set's floor, where feet are on it; otherwise with y down."""
    up, point = (se3.rotate(TURN[UP], np.array(place)) for place in (FLOOR_NORMAL, FLOOR_POINT))
    tilt = se3.shortest_rotation(up, np.array([0.0, 0.0, 1.0]))
    height = float(se3.rotate(tilt, point)[2])
    feet = se3.rotate(tilt, se3.rotate(TURN[UP], person.joint_positions[:, _FEET]))[..., 2].min(axis=1) - height
    on_floor = float(((feet >= MIN_FOOT_HEIGHT) & (feet <= MAX_FOOT_HEIGHT)).mean())
    if on_floor < MIN_SHARE_ON_FLOOR:
        note = (
            f"The feet are on the makers' floor in {on_floor:.0%} of the frames only (median {np.median(feet):.2f} m "
            "above it): y is down as in the first camera, whose tilt is not known here, so the floor may slope."
        )
        return replace(World.of_axis(UP), note=note)
    degrees = float(np.rad2deg(np.arccos(up[2])))
    note = (
        f"The world is levelled by the floor of the makers' scripts, {degrees:.1f} deg off the first camera's y axis; "
        f"the feet are on it in {on_floor:.0%} of the frames."
    )
    return World(UP, (Turn(TURN[UP]), Turn(tilt, floor=height)), note)


READER = Reader(FORMAT, record, holds=holds)
