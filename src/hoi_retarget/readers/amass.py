"""Reads AMASS, and recordings in its layout: `<name>.npz`, one person without objects.

Two releases exist. SMPL-H: `poses` has 156 numbers a frame, pelvis, body, left and right hand, the rate is called
`mocap_framerate`. SMPL-X, in files `*_stageii.npz`: `poses` has 165, with jaw and eyes between body and hands, the same
stands in `root_orient`, `pose_body` and `pose_hand`, the rate is called `mocap_frame_rate`, and `surface_model_type`
names the model. Converters to that layout, such as those beside GMR, leave `poses` or the hands out. SMPL has 72
numbers; its body is taken as SMPL-H's, and its hands, joints without fingers, are left out.

Rotations are rotation vectors, hands are counted from flat ones, betas are of one body. z is up, in metres. The floor
is near 0, not exactly, and some subsets have people on stairs and boxes that are not in the files.

Cites: nghorbani/amass `README.md` and notebooks; human_body_prior `body_model.py` (no mean hand); GMR
`scripts/smplx_to_robot.py`.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.body_model import Family
from hoi_retarget.readers.body_parameters import FLAT_HANDS, TITLES, BodyParameters
from hoi_retarget.readers.fields import Fields, npz_fields
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks

FORMAT = "amass"
LICENCE = "AMASS: non-commercial scientific research; and the terms of the subset"
RATES = ("mocap_framerate", "mocap_frame_rate")
FAMILY_OF_WIDTH: Mapping[int, Family] = {72: "smplh", 156: "smplh", 165: "smplx"}
"""Numbers of `poses` in a frame -> family of their model."""

_BODY, _HANDS = 66, 90
_PARTS = ("root_orient", "pose_body")
_SMPL_WIDTH = 72
_SMPL_NOTE = "The poses are SMPL's, with 24 joints; its body is taken as that of SMPL-H."
_NO_MODEL_NOTE = "The file does not name its body model; root_orient and pose_body are taken as those of SMPL-X."


def holds(file: SourceFile) -> bool:
    """Return whether an `.npz` file has the arrays of one of AMASS's people."""
    names = file.array_names
    posed = "poses" in names or names.issuperset(_PARTS)
    return posed and names.issuperset(("trans", "betas")) and not names.isdisjoint(RATES)


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a file."""
    fields = npz_fields(file, file.path)
    frames = len(fields.array("trans", ("T", 3), "the body's position"))
    rate = next(name for name in RATES if name in fields)
    gender = fields.text("gender", "the body's gender").lower()
    family, notes = _family(fields, frames)
    betas = fields.array("betas", ("b",), "the body's shape")
    hands = _hands(fields, frames)

    def read_tracks() -> Tracks:
        pose = np.concatenate([_body(fields, frames), np.zeros((frames, _HANDS)) if hands is None else hands], axis=1)
        translation = fields.array("trans", (frames, 3), "the body's position")
        person = BodyParameters.of_rows(
            pose, family=family, gender=gender, betas=betas, translation=translation, flat_hands=True
        )
        return Tracks(people=(person,), objects=())

    return SourceRecording(
        name=file.path.stem,
        description="recording of one person in AMASS's layout",
        frames=frames,
        fps=float(fields.array(rate, (), "frames a second")),
        fps_stated=True,
        skeleton=f"{TITLES[family]} {gender}, {len(betas)} betas",
        objects=(),
        contacts="none, as there are no objects",
        licence=LICENCE,
        notes=(*notes, *(() if hands is not None else (FLAT_HANDS,))),
        up="z",
        read_tracks=read_tracks,
        may_lie=True,
    )


def _family(fields: Fields, frames: int) -> tuple[Family, tuple[str, ...]]:
    """Return the family of the pose's body model, and notes of it; raises `ClipError`."""
    if "surface_model_type" in fields:
        stated = fields.text("surface_model_type", "the body model")
        # Another release of the same model, such as smplx_locked_head, has the same joints.
        family: Family | None = next((known for known in TITLES if stated.lower().startswith(known)), None)
        if family is None:
            raise ClipError(
                f"{fields.path}: surface_model_type is {stated[:40]!a}, expected {' or '.join(TITLES)} and the "
                "like. Download the recording for one of these models."
            )
        return family, (f"The body model is {stated}, as the file says.",)
    if "poses" not in fields:
        return "smplx", (_NO_MODEL_NOTE,)
    width = fields.array("poses", (frames, "D"), "the body's pose").shape[1]
    if width not in FAMILY_OF_WIDTH:
        known = ", ".join(f"{count} for {TITLES[family]}" for count, family in FAMILY_OF_WIDTH.items())
        raise ClipError(
            f"{fields.path}: poses has {width} numbers a frame; expected {known}. Download the recording for one of "
            "these models, or convert from what it was made of."
        )
    return FAMILY_OF_WIDTH[width], (_SMPL_NOTE,) if width == _SMPL_WIDTH else ()


def _body(fields: Fields, frames: int) -> Float[np.ndarray, "T 66"]:
    if all(name in fields for name in _PARTS):
        root = fields.rows("root_orient", frames, 3, "the pelvis's rotation")
        return np.concatenate([root, fields.rows("pose_body", frames, _BODY - 3, "the body's pose")], axis=1)
    return fields.array("poses", (frames, "D"), "the body's pose")[:, :_BODY]


def _hands(fields: Fields, frames: int) -> Float[np.ndarray, "T 90"] | None:
    """Return the pose of both hands; None where the file has none."""
    if "pose_hand" in fields:
        return fields.rows("pose_hand", frames, _HANDS, "the pose of both hands")
    pose = fields.array("poses", (frames, "D"), "the body's pose") if "poses" in fields else np.zeros((0, _SMPL_WIDTH))
    return None if pose.shape[1] == _SMPL_WIDTH else pose[:, -_HANDS:]


READER = Reader(FORMAT, record, holds=holds)
