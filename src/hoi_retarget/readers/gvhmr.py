"""Reads GVHMR, people reconstructed from video: `hmr4d_results.pt`, and the same arrays as `.npz`.

The file's dictionary `smpl_params_global` has neutral SMPL-X by its own names, a row for each frame: `global_orient`,
`body_pose` of 21 joints, `transl`, ten `betas`. y is up along gravity, the floor near 0, in metres; videos are brought
to 30 frames a second first. Hands are not estimated. What else is there, such as the camera's view, is of no use here.
An `.npz` has the dictionary, or its arrays themselves.

Cites: zju3dv/GVHMR `tools/demo/demo.py` and `hmr4d/utils/postprocess.py`; GMR `scripts/gvhmr_to_robot.py`.
"""

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.readers.body_parameters import FLAT_HANDS, BodyParameters
from hoi_retarget.readers.fields import Fields, npz_fields
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks

FORMAT = "gvhmr"
LICENCE = "GVHMR's licence: non-commercial; and the terms of the video"
FPS = 30.0
BETAS = 10
RESULTS = "hmr4d_results"  # The name of all its files, without their ending; the folder has the video's name.

_GLOBAL = "smpl_params_global"
_KEYS = frozenset(("global_orient", "body_pose", "transl", "betas"))
_HANDS = frozenset(("left_hand_pose", "right_hand_pose"))
_RATE = "fps"
_RATE_NOTE = f"{FPS:g} frames a second, to which GVHMR brings videos; the file does not state it."
_CONSTANT = 1e-3  # Of betas; below they are those of one body.


def holds(file: SourceFile) -> bool:
    """Return whether a file has the person of a video in the world, or an `.npz` file just the person's arrays."""
    if file.suffix == ".npz":
        names = file.array_names
        return _GLOBAL in names or (names >= _KEYS and names.isdisjoint(_HANDS))
    return isinstance(file.torch, dict) and isinstance(file.torch.get(_GLOBAL), dict)


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a file."""
    whole = npz_fields(file, file.path) if file.suffix == ".npz" else Fields(file.path, file.torch)
    fields = whole.table(_GLOBAL, "the person in the world") if _GLOBAL in whole else whole
    frames = len(fields.array("transl", ("T", 3), "the body's position"))
    stated = _RATE in whole
    betas, shape_notes = _betas(fields, frames)

    def read_tracks() -> Tracks:
        root = fields.rows("global_orient", frames, 3, "the pelvis's rotation")
        body = fields.rows("body_pose", frames, 63, "the body's pose")
        person = BodyParameters.of_rows(
            np.concatenate([root, body, np.zeros((frames, 90))], axis=1),
            family="smplx",
            gender="neutral",
            betas=betas,
            translation=fields.array("transl", (frames, 3), "the body's position"),
            flat_hands=True,
        )
        return Tracks(people=(person,), objects=())

    return SourceRecording(
        name=file.path.resolve().parent.name if file.path.stem == RESULTS else file.path.stem,
        description="reconstruction of one person from video by GVHMR",
        frames=frames,
        fps=float(whole.array(_RATE, (), "frames a second")) if stated else FPS,
        fps_stated=stated,
        skeleton=f"SMPL-X neutral, {BETAS} betas",
        objects=(),
        contacts="none, as there are no objects",
        licence=LICENCE,
        notes=(*(() if stated else (_RATE_NOTE,)), *shape_notes, FLAT_HANDS),
        up="y",
        read_tracks=read_tracks,
        may_lie=True,
    )


def _betas(fields: Fields, frames: int) -> tuple[Float[np.ndarray, "10"], tuple[str, ...]]:
    """Return the body's shape, which is estimated in each frame of the video, and notes of it."""
    stored = fields.get("betas")
    if isinstance(stored, np.ndarray) and stored.ndim == 1:
        return fields.array("betas", (BETAS,), "the body's shape"), ()
    rows = fields.array("betas", (frames, BETAS), "the body's shape")
    change = float(np.ptp(rows, axis=0).max(initial=0.0))
    if change <= _CONSTANT:
        return rows[0], ()
    note = f"The betas change by up to {change:.2g}, as they are estimated in each frame; the body has their mean."
    return rows.mean(axis=0), (note,)


READER = Reader(FORMAT, record, holds=holds)
