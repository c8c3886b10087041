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

from pathlib import Path

import numpy as np
from jaxtyping import Int

from hoi_retarget.clip.clip import MINIMUM_FRAMES
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError, GeometryError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.body_parameters import BodyParameters
from hoi_retarget.readers.fields import Fields, folder_above, folder_of_tree, npz_fields
from hoi_retarget.readers.object_files import first_mesh, quats_of
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks

FORMAT = "hodome"
LICENCE = "NeuralDome HODome: non-commercial; LICENSE.md beside the data tells the terms"
FPS = 60.0
BETAS = 10

_IDS, _RATE = "frame_ids", "mocap_frame_rate"
_KEYS = {_IDS, "betas", "global_orient", "body_pose", "transl", "left_hand_pose", "right_hand_pose"}
_POSES, _MESHES = "object", "scaned_object"
_ROTATION = "the object's rotation"
_RATE_NOTE = "60 frames a second, as the data set has it; this file does not state it."


def holds(file: SourceFile) -> bool:
    """Return whether an `.npz` file has the arrays of HODome's people."""
    return file.array_names >= _KEYS


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in the files of a person and an object, in the frames that both have."""
    human, object_ = npz_fields(file, file.path), npz_fields(file, _object_file(file))
    human_ids, object_ids = _ids(human), _object_ids(object_)
    ids, human_rows, object_rows = np.intersect1d(human_ids, object_ids, assume_unique=True, return_indices=True)
    if len(ids) < MINIMUM_FRAMES:
        raise ClipError(
            f"{file.name}: person and object have {len(ids)} frames in common, at least {MINIMUM_FRAMES} are needed: "
            f"the person's are {_span(human_ids)}, the object's {_span(object_ids)}. Download both files again."
        )
    name = options.object_name or file.path.stem.rpartition("_")[2]
    notes = (f"The object is {name}, as {'was asked for' if options.object_name else 'the sequence is called'}.",)
    stated = _RATE in object_
    if not stated:
        notes += (_RATE_NOTE,)
    if len(ids) < len(human_ids):
        missing = len(human_ids) - len(ids)
        notes += (f"{missing} frame(s) at the ends are left out, for which the object has no pose.",)

    def read_tracks() -> Tracks:
        betas = human.array("betas", (len(human_ids), BETAS), "the body's shape")
        body = BodyParameters.of_fields(human, len(human_ids), hand=45, gender="neutral", betas=betas, flat_hands=True)
        rotations = object_.array("object_R", (len(object_ids), 3, 3), _ROTATION)[object_rows]
        positions = object_.rows("object_T", len(object_ids), 3, "the object's position")[object_rows]
        quats = quats_of(object_.path, "object_R", rotations)
        track = ObjectTrack(name, positions, quats, _geometry(file, options, name))
        return Tracks(people=(body.at(human_rows),), objects=(track,))

    return SourceRecording(
        name=file.path.stem,
        description="HODome sequence of one person and one object",
        frames=len(ids),
        fps=float(object_.array(_RATE, (), "the rate")) if stated else FPS,
        fps_stated=stated,
        skeleton=f"SMPL-X neutral, {BETAS} betas",
        objects=(name,),
        licence=LICENCE,
        notes=notes,
        up="y",
        read_tracks=read_tracks,
        names_objects=False,
        first_frame=int(human_rows[0]),
    )


def _object_file(file: SourceFile) -> Path:
    folder = folder_above(file.path, _POSES)
    name = f"{file.path.stem}.npz"
    if folder is None:
        raise ReadError(
            f"{file.name}: the object's poses are missing: there is no folder {_POSES} beside the one that the file is "
            f"in. Download {_POSES}/{name} of the data set."
        )
    return folder / name


def _ids(fields: Fields) -> Int[np.ndarray, "T"]:
    """Return the ids of a file's frames; raises `ClipError` unless one is after the other."""
    ids = fields.get(_IDS)
    if not isinstance(ids, np.ndarray) or ids.dtype.kind not in "iu" or ids.ndim != 1:
        raise ClipError(f"{fields.path}: {_IDS} is no row of whole numbers. Download the recording again.")
    ids = ids.astype(np.int64)
    jumps = np.flatnonzero(np.diff(ids) != 1)
    if len(jumps):
        before, after = ids[jumps[0]], ids[jumps[0] + 1]
        raise ClipError(
            f"{fields.path}: {_IDS} goes from {before} to {after}, expected one frame after the other: without those "
            "between, the motion would be too fast there. Cut the recording at that frame."
        )
    return ids


def _object_ids(object_: Fields) -> Int[np.ndarray, "T"]:
    """Return the same of an object's file; frames without ids are counted from 0."""
    rotations = object_.array("object_R", ("T", 3, 3), _ROTATION)
    return np.arange(len(rotations)) if object_.get(_IDS) is None else _ids(object_)


def _span(ids: Int[np.ndarray, "T"]) -> str:
    return f"{ids[0]} to {ids[-1]}" if len(ids) else "none"


def _geometry(file: SourceFile, options: ReadOptions, name: str) -> ObjectGeometry:
    folder = options.objects or folder_of_tree(file.path, _MESHES, beside="smplx")
    # The full scan has another mean of its vertices.
    try:
        return first_mesh(name, [folder / name / f"{name}_face1000.obj"], centred=True)
    except GeometryError as error:
        if options.object_name is not None:
            raise
        raise GeometryError(f"{error} Where the sequence's last word is not the object, pass --object NAME.") from error


READER = Reader(FORMAT, record, holds=holds)
