"""Reads OMOMO's own release: one file of joblib with all clips, such as `train_diffusion_manip_seq_joints24.p`.

A dictionary from numbers to clips. A clip has a name such as `sub3_largebox_003`, a person as parameters of gendered
SMPL-X with sixteen betas, and an object's rotation, position and size for each frame. z is up, in metres; hands are not
recorded. The pelvis is at `trans` less `trans2joint`, which is minus the pelvis at rest; `rest_offsets` are the places
of 22 joints and two points of the hands in their parents' frames, so that no body model is needed
(lijiaman/omomo_release manip/data/hand_foot_dataset.py). 30 frames a second are stated by others than the makers.

An object is its scan, turned, scaled and moved, not centred: `captured_objects/<object>_cleaned_simplified.obj` in the
folder of the file or above. Mop and vacuum have two parts that move on their own, each with a scan of its own.

The file holds thousands of clips: it is interpreted once in a process, and only a clip's own arrays are then read.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError, GeometryError, ReadError
from hoi_retarget.files.array_pickle import read_joblib, starts_with
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human import skeleton, t_pose
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINTS
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.body_parameters import BodyParameters, person_of
from hoi_retarget.readers.fields import Fields, chosen_clip, folder_of_tree
from hoi_retarget.readers.object_files import first_mesh, quats_of
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks

FORMAT = "omomo"
LICENCE = "MIT, as others state it; the makers' repository has no licence"
FPS = 30.0
TWO_PARTS = ("mop", "vacuum")
MAX_SIZE_CHANGE = 1e-3  # Of an object's size within a clip, as a share of it.
MAX_GAP = 0.05  # [m]; between the clip's own joints and those of a body model: farther is another body.
MIN_NOTED_GAP = 0.01  # [m]; from there on it is said.

_NAMES = (b"seq_name", b"rest_offsets", b"trans2joint")
_START = 1 << 24  # Bytes of a file within which its first clip ends, and all names have occurred.
_PLAIN = re.compile(r"[A-Za-z0-9-]+(_[A-Za-z0-9-]+)+")
_SCANS = "captured_objects"
_BODY = len(skeleton.BODY_PARENTS)
_RATE_NOTE = "30 frames a second, as others than the makers state it; the file does not."
_HANDS_NOTE = "Hands are not recorded; the model's are flat."


@dataclass(frozen=True, eq=False)
class _Recordings:
    """All clips of a file, their arrays left in it."""

    sha256: str
    clips: Mapping[str, Mapping[str, Any]]


def holds(file: SourceFile) -> bool:
    """Return whether a file starts with a clip of OMOMO's."""
    return starts_with(file.path, _NAMES, _START)


def clips_in(file: SourceFile) -> tuple[str, ...]:
    """Return the names of all clips in a file; raises `ReadError`."""
    return tuple(_recordings(file).clips)


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the selected clip; a body model is used where it is given."""
    recordings = _recordings(file)
    name = chosen_clip(file, recordings.clips, "clips")
    fields = Fields(file.path, recordings.clips[name], within=f"{name}/")
    positions = fields.array("trans", ("T", 3), "the body's position")
    object_name = name.split("_")[1]
    # What follows the object's name in that of a part, and what follows it in that of the part's scan.
    parts = {"": "_top", "_bottom": "_bottom"} if object_name in TWO_PARTS else {"": ""}

    def read_tracks() -> Tracks:
        person, notes = _person(fields, positions, options.body_models)
        tracks: tuple[ObjectTrack, ...] = ()
        for part, scan in parts.items():
            size, size_notes = _size(fields, f"{object_name}{part}", f"obj{part}_scale", len(positions))
            geometry = _geometry(file, options, object_name, scan, size)
            tracks += (_track(fields, f"{object_name}{part}", f"obj{part}", len(positions), geometry),)
            notes += size_notes
        return Tracks(people=(person,), objects=tracks, notes=notes)

    return SourceRecording(
        name=name,
        description="OMOMO clip of one person and one object",
        frames=len(positions),
        fps=FPS,
        skeleton=f"SMPL-X {fields.text('gender', 'the body model')}, 16 betas, joints at rest stored",
        objects=tuple(f"{object_name}{part}" for part in parts),
        licence=LICENCE,
        notes=(_RATE_NOTE,),
        up="z",
        read_tracks=read_tracks,
        sha256=recordings.sha256,
    )


def _recordings(file: SourceFile) -> _Recordings:
    try:
        status = file.path.stat()
    except OSError as error:
        raise ReadError(f"{file.path}: cannot be read ({error}). Check the path.") from error
    return _indexed(file.path.resolve(), status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=2)
def _indexed(path: Path, *_changed: int) -> _Recordings:
    values, sha256 = read_joblib(path)
    clips = {}
    for entry in values.values() if isinstance(values, dict) else ():
        name = entry.get("seq_name") if isinstance(entry, dict) else None
        if not isinstance(name, str) or not _PLAIN.fullmatch(name):
            raise ReadError(
                f"{path}: one of its clips is called {ascii(name)[:80]}, expected a name such as sub3_largebox_003. "
                "Download it again."
            )
        if name in clips:
            raise ReadError(f"{path}: two of its clips are called {name}. Download it again.")
        clips[name] = entry
    if not clips:
        raise ReadError(f"{path}: there are no clips in it. Download it again.")
    return _Recordings(sha256, clips)


def _person(
    fields: Fields, positions: Float[np.ndarray, "T 3"], body_models: Path | None
) -> tuple[Person, tuple[str, ...]]:
    frames = len(positions)
    root = fields.array("root_orient", (frames, 3), "the pelvis's rotation")
    body = fields.array("pose_body", (frames, 3 * (_BODY - 1)), "the body's pose")
    pose = np.concatenate([root, body], axis=1)
    own = _own_person(fields, positions, pose.reshape(frames, _BODY, 3))
    if body_models is None:
        return own, (skeleton.STRAIGHT_FINGERS,)
    parameters = BodyParameters.of_rows(
        np.concatenate([pose, np.zeros((frames, 90))], axis=1),
        family="smplx",
        gender=fields.text("gender", "the body model"),
        betas=fields.array("betas", (1, 16), "the body's shape")[0],
        translation=positions,
        flat_hands=True,
    )
    person = person_of(fields.path, own.name, parameters, body_models)
    return person, (_HANDS_NOTE, *_gap_notes(fields.path, own, person))


def _own_person(fields: Fields, positions: Float[np.ndarray, "T 3"], pose: Float[np.ndarray, "T 22 3"]) -> Person:
    bones = fields.array("rest_offsets", (_BODY + 2, 3), "joints in their parents' frames at rest")[:_BODY]
    pelvis = positions - fields.array("trans2joint", (3,), "minus the pelvis at rest")
    quats, places = np.empty((len(pose), len(JOINTS), 4)), np.empty((len(pose), len(JOINTS), 3))
    quats[:, :_BODY] = skeleton.world_quats(pose, skeleton.BODY_PARENTS)
    places[:, :_BODY] = skeleton.world_positions(pelvis, bones, quats[:, :_BODY], skeleton.BODY_PARENTS)
    if t_pose.agreement(places, quats) < t_pose.MIN_T_POSE_AGREEMENT:
        raise ClipError(
            f"{fields.path}: rest_offsets has knees or elbows elsewhere than below or beside their parents, where "
            "SMPL-X's T-pose has them. Download it again."
        )
    skeleton.add_straight_fingers(places[:, None], quats[:, None])
    return Person("person", places, quats, fingers_recorded=False)


def _gap_notes(path: Path, own: Person, modelled: Person) -> tuple[str, ...]:
    gaps = np.linalg.norm(own.joint_positions - modelled.joint_positions, axis=-1)[:, :_BODY].mean(axis=0)
    joint, gap = JOINTS[int(gaps.argmax())], float(gaps.max())
    if gap > MAX_GAP:
        raise ClipError(
            f"{path}: the body model puts {joint} {gap:.3g} m from where the clip's own skeleton has it, expected at "
            f"most {MAX_GAP:g} m. Is this the SMPL-X model of that gender? Without a model the skeleton is used."
        )
    return (f"The body model puts {joint} {gap:.3f} m from where the clip's own skeleton has it.",) * (
        gap > MIN_NOTED_GAP
    )


def _track(fields: Fields, name: str, key: str, frames: int, geometry: ObjectGeometry) -> ObjectTrack:
    rotations = fields.array(f"{key}_rot", (frames, 3, 3), "the object's rotation")
    positions = fields.array(f"{key}_trans", (frames, 3, 1), "the object's position")[..., 0]
    return ObjectTrack(name, positions, quats_of(fields.path, f"the rotation of {name}", rotations), geometry)


def _size(fields: Fields, name: str, key: str, frames: int) -> tuple[float, tuple[str, ...]]:
    """Return the ratio of an object's size to its scan's, and notes of it."""
    sizes = fields.array(key, (frames,), "the object's size")
    size, change = float(sizes.mean()), float(np.ptp(sizes))
    if sizes.min() <= 0 or change > MAX_SIZE_CHANGE * size:
        raise ClipError(
            f"{fields.path}: the size of {name} goes from {sizes.min():.4g} to {sizes.max():.4g} times its scan's; a "
            f"rigid body keeps it, up to {MAX_SIZE_CHANGE:g} of it. Choose another clip."
        )
    return size, (f"The size of {name} varies by {change / size:.1e} of it; the mean is taken.",) * (change > 0)


def _geometry(file: SourceFile, options: ReadOptions, object_name: str, scan: str, size: float) -> ObjectGeometry:
    folder = options.objects or folder_of_tree(file.path, _SCANS)
    path = folder / f"{object_name}_cleaned_simplified{scan}.obj"
    centred = folder / object_name / f"{object_name}.obj"
    if centred.is_file() and not path.is_file():
        raise GeometryError(
            f"object {object_name!r}: poses are those of the scan, {path.name}, and {centred} may be InterMimic's "
            f"mesh, which is moved to its middle and scaled. Pass --objects DIR with OMOMO's {_SCANS}."
        )
    return first_mesh(f"{object_name}{scan}", [path], centred=False, scale=size)


READER = Reader(FORMAT, record, holds=holds, clips_in=clips_in)
