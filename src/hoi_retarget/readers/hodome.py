"""Reads NeuralDome's HODome: one person and one object, a pair of `.npz` files for each sequence.

`smplx/<sequence>.npz` holds parameters of neutral SMPL-X for the frames of `frame_ids`, ten betas in each row, hands as
rotation vectors from the flat hand. `object/<sequence>.npz` holds the object's rotation matrices, which turn columns,
and positions, one for each frame from 0 on: a frame's id is its row there. Both are in one world whose y axis is the
floor's normal; 60 frames a second. The sequence's last word names the object; its mesh, less the mean of its vertices,
is `scaned_object/<object>/<object>_face1000.obj` (Juzezhang/NeuralDome_Toolbox README.md,
scripts/hodome_visualize_pyrender.py, scripts/utils/pose_source.py, scripts/process_all_ground.py).

The toolbox writes positions with one axis more, (T, 1, 3), and the rate beside them; both are taken. Not read are the
older files, a JSON for each frame with transposed rotations, `smplh`, which its makers advise against, and `mhr`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from hoi_retarget.clip.clip import MINIMUM_FRAMES, Clip, Source
from hoi_retarget.errors import ClipError, GeometryError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.person import Person
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.body_parameters import BodyParameters
from hoi_retarget.readers.companions import folder_above, folder_of_tree
from hoi_retarget.readers.fields import Fields
from hoi_retarget.readers.npz_fields import npz_values
from hoi_retarget.readers.reader import Outline, Reader, ReadOptions
from hoi_retarget.readers.rigid import quats_of
from hoi_retarget.readers.triangles import first_mesh
from hoi_retarget.readers.upright import check_upright
from hoi_retarget.readers.varying_shape import person_of_rows
from hoi_retarget.readers.worlds import turned_object, turned_person

FORMAT = "hodome"
LICENCE = "NeuralDome HODome: non-commercial; LICENSE.md beside the data tells the terms"
FPS = 60.0
UP = "y"

_IDS, _RATE = "frame_ids", "mocap_frame_rate"
_KEYS = {_IDS, "betas", "global_orient", "body_pose", "transl", "left_hand_pose", "right_hand_pose"}
_POSES, _MESHES = "object", "scaned_object"
_ROWS: Mapping[str, tuple[int, int]] = MappingProxyType(
    {"body_pose": (21, 3), "left_hand_pose": (15, 3), "right_hand_pose": (15, 3), "object_T": (1, 3)}
)
"""Arrays whose numbers of one frame may be in rows."""
_BETAS = 10
_ROTATION = "the object's rotation"
_RATE_NOTE = "60 frames a second, as the data set has it; this file does not state it."


def holds(file: SourceFile) -> bool:
    """Return whether an `.npz` file has the arrays of HODome's people."""
    return file.array_names >= _KEYS


def read_file(file: SourceFile, options: ReadOptions) -> Clip:
    """Return the clip whose person is in a file.

    Raises:
        ReadError: the object's file is missing, or one is damaged.
        ClipError: arrays are missing or disagree, or frames are missing in between.
        GeometryError: the object's mesh cannot be had.
        BodyModelError: the body model cannot be had.
    """
    pair = _Pair.of(file)
    name = options.object_name or _named_object(file)
    track = _track(pair, name, _geometry(file, options, name))
    person, shape_notes = _person(pair, options.body_models)
    person = turned_person(person, UP)
    check_upright(file.path, person, UP)
    told = "was asked for" if options.object_name else "the name of the sequence says"
    return Clip(
        name=file.path.stem,
        fps=pair.fps,
        people=(person,),
        objects=(turned_object(track, UP),),
        contacts=(),
        source=Source(
            str(file.name),
            file.sha256,
            FORMAT,
            LICENCE,
            (f"The object is {name}, as {told}.", *pair.notes, *shape_notes),
        ),
        first_source_frame=pair.human_rows.start,
    )


def outline(file: SourceFile) -> Outline:
    """Return what a pair of files holds; raises `ReadError` or `ClipError`."""
    pair = _Pair.of(file)
    return Outline(
        description="HODome sequence of one person and one object",
        frames=len(pair.frames),
        fps=pair.fps,
        fps_stated=_RATE in pair.object,
        skeleton=f"SMPL-X neutral, {_BETAS} betas",
        up_axis=f"{UP}, as the format has it",
        people=1,
        objects=(_named_object(file),),
        contacts="none stored",
        licence=LICENCE,
        notes=pair.notes,
    )


def _named_object(file: SourceFile) -> str:
    """Return the last word of the sequence's name."""
    return file.path.stem.rpartition("_")[2]


# Files


@dataclass(frozen=True, eq=False)
class _Pair:
    """A person's file and an object's, and the frames that both have."""

    human: Fields
    object: Fields
    human_frames: range
    """Ids of the frames that the file has."""
    object_frames: range
    frames: range
    """Those that both have."""

    @classmethod
    def of(cls, file: SourceFile) -> "_Pair":
        """Read both files of a sequence; raises `ReadError` or `ClipError`."""
        human, human_ids = _fields(file, file.path)
        stored, object_ids = _fields(file, _object_file(file))
        rotations = len(stored.array("object_R", ("T", 3, 3), _ROTATION))
        human_frames = _frames(human, human_ids)
        object_frames = range(rotations) if object_ids is None else _frames(stored, object_ids)
        common = range(max(human_frames.start, object_frames.start), min(human_frames.stop, object_frames.stop))
        if len(common) < MINIMUM_FRAMES:
            raise ClipError(
                f"{file.name}: person and object have {len(common)} frames in common, at least {MINIMUM_FRAMES} are "
                f"needed: the person's are {_span(human_frames)}, the object's {_span(object_frames)}. Download both "
                "files again."
            )
        return cls(human, stored, human_frames, object_frames, common)

    @property
    def human_rows(self) -> slice:
        """Where the common frames are in the person's file."""
        return _rows(self.frames, self.human_frames)

    @property
    def object_rows(self) -> slice:
        """Where they are in the object's file."""
        return _rows(self.frames, self.object_frames)

    @property
    def fps(self) -> float:
        """Frames a second; raises `ClipError` where what the file states is no number."""
        return float(self.object.array(_RATE, (), "the rate")) if _RATE in self.object else FPS

    @property
    def notes(self) -> tuple[str, ...]:
        """What was decided about rate and frames."""
        rate = () if _RATE in self.object else (_RATE_NOTE,)
        missing = len(self.human_frames) - len(self.frames)
        left_out = f"{missing} frame(s) at the ends are left out, for which the object has no pose."
        return (*rate, left_out) if missing else rate


def _object_file(file: SourceFile) -> Path:
    folder = folder_above(file.path, _POSES)
    name = f"{file.path.stem}.npz"
    if folder is None:
        raise ReadError(
            f"{file.name}: the object's poses are missing: there is no folder {_POSES} beside the one that the file is "
            f"in. Download {_POSES}/{name} of the data set."
        )
    return folder / name


def _fields(file: SourceFile, path: Path) -> tuple[Fields, Any]:
    """Return what a file holds, and its frames' ids as they are; raises `ReadError`."""
    values = npz_values(file, path)
    for name, rows in _ROWS.items():
        array = values.get(name)
        if isinstance(array, np.ndarray) and array.shape[1:] == rows:
            values[name] = array.reshape(len(array), rows[0] * rows[1])
    return Fields(path, values), values.get(_IDS)


def _frames(fields: Fields, ids: Any) -> range:
    """Return the frames of these ids; raises `ClipError` unless one is after the other."""
    if not isinstance(ids, np.ndarray) or ids.dtype.kind not in "iu" or ids.ndim != 1:
        raise ClipError(f"{fields.path}: {_IDS} is no row of whole numbers. Download the recording again.")
    numbers = ids.astype(np.int64)
    jumps = np.flatnonzero(np.diff(numbers) != 1)
    if len(jumps):
        before, after = numbers[jumps[0]], numbers[jumps[0] + 1]
        raise ClipError(
            f"{fields.path}: {_IDS} goes from {before} to {after}, expected one frame after the other: without those "
            "between, the motion would be too fast there. Cut the recording at that frame."
        )
    first = int(numbers[0]) if len(numbers) else 0
    return range(first, first + len(numbers))


def _rows(frames: range, of: range) -> slice:
    return slice(frames.start - of.start, frames.stop - of.start)


def _span(frames: range) -> str:
    return f"{frames.start} to {frames.stop - 1}" if frames else "none"


# Person and object


def _person(pair: _Pair, body_models: Path | None) -> tuple[Person, tuple[str, ...]]:
    fields, rows, frames = pair.human, pair.human_rows, len(pair.human_frames)
    betas = fields.array("betas", (frames, _BETAS), "the body's shape")[rows]
    root = fields.array("global_orient", (frames, 3), "the pelvis's rotation")
    body = fields.array("body_pose", (frames, 63), "the body's pose")
    parameters = BodyParameters(
        family="smplx",
        gender="neutral",
        betas=betas[0],
        translation=fields.array("transl", (frames, 3), "the body's position")[rows],
        body=np.concatenate([root, body], axis=1)[rows],
        left_hand=fields.array("left_hand_pose", (frames, 45), "the left hand's pose")[rows],
        right_hand=fields.array("right_hand_pose", (frames, 45), "the right hand's pose")[rows],
        flat_hands=True,
    )
    return person_of_rows(fields.path, "person", parameters, betas, body_models)


def _track(pair: _Pair, name: str, geometry: ObjectGeometry) -> ObjectTrack:
    fields, rows, frames = pair.object, pair.object_rows, len(pair.object_frames)
    rotations = fields.array("object_R", (frames, 3, 3), _ROTATION)[rows]
    positions = fields.array("object_T", (frames, 3), "the object's position")[rows]
    return ObjectTrack(name, positions, quats_of(fields.path, "object_R", rotations), geometry)


def _geometry(file: SourceFile, options: ReadOptions, name: str) -> ObjectGeometry:
    folder = options.objects or folder_of_tree(file.path, _MESHES, beside="smplx")
    # The full scan has another mean of its vertices.
    try:
        return first_mesh(name, [folder / name / f"{name}_face1000.obj"], centred=True)
    except GeometryError as error:
        if options.object_name is not None:
            raise
        raise GeometryError(f"{error} Where the sequence's last word is not the object, pass --object NAME.") from error


READER = Reader(
    format=FORMAT,
    suffixes=(".npz",),
    floor_at_zero=False,
    holds=holds,
    read=read_file,
    outline=outline,
)
