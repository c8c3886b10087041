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

from hoi_retarget.clip.clip import MINIMUM_FRAMES, Clip, Source
from hoi_retarget.errors import ClipError, GeometryError, ReadError
from hoi_retarget.files.joblib_file import read_joblib, starts_with
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human import fingers, kinematics, rest_pose
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINTS
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.body_parameters import BodyParameters, person_of
from hoi_retarget.readers.companions import folder_of_tree, refuse_object_name
from hoi_retarget.readers.fields import Fields
from hoi_retarget.readers.reader import Outline, Reader, ReadOptions
from hoi_retarget.readers.rigid import quats_of
from hoi_retarget.readers.triangles import first_mesh
from hoi_retarget.readers.upright import check_upright

FORMAT = "omomo"
LICENCE = "MIT, as others state it; the makers' repository has no licence"
FPS = 30.0
UP = "z"
TWO_PARTS = ("mop", "vacuum")
LARGEST_CHANGE = 1e-3
"""Of an object's size within a clip, as a share of it."""
LARGEST_GAP = 0.05
"""[m]; between the clip's own joints and those of a body model: farther is another body."""
NOTED_GAP = 0.01
"""[m]; from there on it is said."""

_NAMES = (b"seq_name", b"rest_offsets", b"trans2joint")
_START = 1 << 24
"""Bytes of a file within which its first clip ends, and all names have occurred."""
_PLAIN = re.compile(r"[A-Za-z0-9-]+(_[A-Za-z0-9-]+)+")
_SCANS = "captured_objects"
_BODY = len(kinematics.BODY_PARENTS)
_RATE_NOTE = "30 frames a second, as others than the makers state it; the file does not."
_HANDS_NOTE = "Hands are not recorded; the model's are flat."


@dataclass(frozen=True, eq=False)
class _Recordings:
    """What a file holds, its arrays left in it."""

    sha256: str
    clips: Mapping[str, Mapping[str, Any]]


def holds(file: SourceFile) -> bool:
    """Return whether a file starts with a clip of OMOMO's."""
    return starts_with(file.path, _NAMES, _START)


def clips_in(file: SourceFile) -> tuple[str, ...]:
    """Return the names of all clips in a file; raises `ReadError`."""
    return tuple(_recordings(file).clips)


def read_file(file: SourceFile, options: ReadOptions) -> Clip:
    """Return the clip that is selected; a body model is used where it is given.

    Raises:
        ReadError: the file is damaged, or holds something else.
        ClipError: arrays are missing, disagree, or contradict each other.
        GeometryError: the object's scan cannot be had.
        ArgumentError: an object's name is given.
    """
    name, fields = _selected(file)
    thing = name.split("_")[1]
    refuse_object_name(file, options, thing)
    frames = len(_translation(fields))
    if frames < MINIMUM_FRAMES:
        raise ClipError(f"{file.name}: {frames} frame(s); at least {MINIMUM_FRAMES} are needed. Choose another clip.")
    person, person_notes = _person(fields, frames, options.body_models)
    check_upright(file.path, person, UP)
    tracks, object_notes = _objects(file, options, fields, thing, frames)
    return Clip(
        name=name,
        fps=FPS,
        people=(person,),
        objects=tracks,
        contacts=(),
        source=Source(
            str(file.name),
            _recordings(file).sha256,
            FORMAT,
            LICENCE,
            notes=(_RATE_NOTE, *person_notes, *object_notes),
        ),
    )


def outline(file: SourceFile) -> Outline:
    """Return what the selected clip holds; raises `ReadError` or `ClipError`."""
    name, fields = _selected(file)
    thing = name.split("_")[1]
    return Outline(
        description="OMOMO clip of one person and one object",
        frames=len(_translation(fields)),
        fps=FPS,
        fps_stated=False,
        skeleton=f"SMPL-X {fields.text('gender', 'the body model')}, 16 betas, joints at rest stored",
        up_axis="z, as the format has it",
        people=1,
        objects=(thing, f"{thing}_bottom") if thing in TWO_PARTS else (thing,),
        contacts="none stored",
        licence=LICENCE,
    )


# Clips


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


def _selected(file: SourceFile) -> tuple[str, Fields]:
    clips = _recordings(file).clips
    name = next(iter(clips)) if file.selection is None and len(clips) == 1 else file.selection
    if name is None or name not in clips:
        raise ReadError(
            f"{file.name}: it does not say which of its {len(clips)} clips. Choose one: {file.path}#{next(iter(clips))}"
        )
    return name, Fields(file.path, clips[name], within=f"{name}/")


# The person


def _translation(fields: Fields) -> Float[np.ndarray, "T 3"]:
    return fields.array("trans", ("T", 3), "the body's position")


def _person(fields: Fields, frames: int, body_models: Path | None) -> tuple[Person, tuple[str, ...]]:
    root = fields.array("root_orient", (frames, 3), "the pelvis's rotation")
    body = fields.array("pose_body", (frames, 3 * (_BODY - 1)), "the body's pose")
    pose = np.concatenate([root, body], axis=1)
    own = _own_person(fields, pose.reshape(frames, _BODY, 3))
    if body_models is None:
        return own, (fingers.NOTE,)
    hands = np.zeros((frames, 45))
    parameters = BodyParameters(
        family="smplx",
        gender=fields.text("gender", "the body model"),
        betas=fields.array("betas", (1, 16), "the body's shape")[0],
        translation=_translation(fields),
        body=pose,
        left_hand=hands,
        right_hand=hands,
        flat_hands=True,
    )
    person = person_of(fields.path, own.name, parameters, body_models)
    return person, (_HANDS_NOTE, *_gap_notes(fields.path, own, person))


def _own_person(fields: Fields, pose: Float[np.ndarray, "T 22 3"]) -> Person:
    bones = fields.array("rest_offsets", (_BODY + 2, 3), "joints in their parents' frames at rest")[:_BODY]
    pelvis = _translation(fields) - fields.array("trans2joint", (3,), "minus the pelvis at rest")
    quats, positions = np.empty((len(pose), len(JOINTS), 4)), np.empty((len(pose), len(JOINTS), 3))
    quats[:, :_BODY] = kinematics.world_quats(pose, kinematics.BODY_PARENTS)
    positions[:, :_BODY] = kinematics.world_positions(pelvis, bones, quats[:, :_BODY], kinematics.BODY_PARENTS)
    if rest_pose.agreement(positions, quats) < rest_pose.LEAST_AGREEMENT:
        raise ClipError(
            f"{fields.path}: rest_offsets has knees or elbows elsewhere than below or beside their parents, where "
            "SMPL-X's T-pose has them. Download it again."
        )
    fingers.add_straight_fingers(positions[:, None], quats[:, None])
    return Person("person", positions, quats, fingers_recorded=False)


def _gap_notes(path: Path, own: Person, modelled: Person) -> tuple[str, ...]:
    gaps = np.linalg.norm(own.joint_positions - modelled.joint_positions, axis=-1)[:, :_BODY].mean(axis=0)
    joint, gap = JOINTS[int(gaps.argmax())], float(gaps.max())
    if gap > LARGEST_GAP:
        raise ClipError(
            f"{path}: the body model puts {joint} {gap:.3g} m from where the clip's own skeleton has it, expected at "
            f"most {LARGEST_GAP:g} m. Is this the SMPL-X model of that gender? Without a model the skeleton is used."
        )
    return (f"The body model puts {joint} {gap:.3f} m from where the clip's own skeleton has it.",) * (gap > NOTED_GAP)


# The object


def _objects(
    file: SourceFile, options: ReadOptions, fields: Fields, thing: str, frames: int
) -> tuple[tuple[ObjectTrack, ...], tuple[str, ...]]:
    if thing not in TWO_PARTS:
        track, notes = _object(file, options, fields, frames, thing, "", "")
        return (track,), notes
    top, top_notes = _object(file, options, fields, frames, thing, "", "_top")
    bottom, bottom_notes = _object(file, options, fields, frames, thing, "_bottom", "_bottom")
    return (top, bottom), (*top_notes, *bottom_notes)


def _object(  # noqa: PLR0913, PLR0917 - what is the same for both parts, and what is not
    file: SourceFile, options: ReadOptions, fields: Fields, frames: int, thing: str, key: str, scan: str
) -> tuple[ObjectTrack, tuple[str, ...]]:
    name = f"{thing}{key}"
    rotations = fields.array(f"obj{key}_rot", (frames, 3, 3), "the object's rotation")
    positions = fields.array(f"obj{key}_trans", (frames, 3, 1), "the object's position")[..., 0]
    sizes = fields.array(f"obj{key}_scale", (frames,), "the object's size")
    size, change = float(sizes.mean()), float(np.ptp(sizes))
    if sizes.min() <= 0 or change > LARGEST_CHANGE * size:
        raise ClipError(
            f"{file.name}: the size of {name} goes from {sizes.min():.4g} to {sizes.max():.4g} times its scan's; a "
            f"rigid body keeps it, up to {LARGEST_CHANGE:g} of it. Choose another clip."
        )
    notes = (f"The size of {name} varies by {change / size:.1e} of it; the mean is taken.",) if change > 0 else ()
    geometry = _geometry(file, options, thing, scan, size)
    quats = quats_of(file.path, f"the rotation of {name}", rotations)
    return ObjectTrack(name, positions, quats, geometry), notes


def _geometry(file: SourceFile, options: ReadOptions, thing: str, scan: str, size: float) -> ObjectGeometry:
    folder = options.objects or folder_of_tree(file.path, _SCANS)
    path = folder / f"{thing}_cleaned_simplified{scan}.obj"
    centred = folder / thing / f"{thing}.obj"
    if centred.is_file() and not path.is_file():
        raise GeometryError(
            f"object {thing!r}: poses are those of the scan, {path.name}, and {centred} may be InterMimic's mesh, "
            f"which is moved to its middle and scaled. Pass --objects DIR with OMOMO's {_SCANS}."
        )
    return first_mesh(f"{thing}{scan}", [path], centred=False, scale=size)


READER = Reader(
    format=FORMAT,
    suffixes=(".p",),
    floor_at_zero=False,
    holds=holds,
    read=read_file,
    clips_in=clips_in,
    outline=outline,
)
