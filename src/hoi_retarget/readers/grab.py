"""Reads GRAB's recordings: `grab/<subject>/<name>.npz`, a person who handles an object from a table.

Arrays of the file hold dictionaries, pickled; they are read without executing anything. The person is SMPL-X with the
subject's own body as the template, `tools/subject_meshes/<gender>/<subject>.ply`, and no betas; hands are 24 principal
components from the model's mean hand. z is up, in metres; the file states its 120 frames a second.

Objects' rotations are the wrong way round: the makers' object model multiplies rows of vertices by the matrix of the
rotation vector (otaheri/GRAB tools/objectmodel.py, issue 23), so that it turns by the inverse. So does the table's.
Meshes are as they lie in `tools/object_meshes/contact_meshes`.

For every frame and every vertex of the object the file says which part of the body touches it, 0 for none, else one
more than the index of SMPL-X's joint there (`contact_ids` in tools/utils.py). Contact with the table is not labelled.
"""

from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any, get_args

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.body_model import Gender
from hoi_retarget.human.skeleton import ALL_PARTS, FINGER_PARTS, HANDS, JOINTS, PARTS
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.body_parameters import BodyParameters
from hoi_retarget.readers.fields import Fields, folder_of_tree, npz_fields
from hoi_retarget.readers.object_files import first_mesh
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks

FORMAT = "grab"
LICENCE = "GRAB's licence: non-commercial scientific research only"
TABLE = "table"
LABELLED_JOINTS = (*JOINTS[:22], "jaw", "left_eye", "right_eye", *JOINTS[22:])
"""SMPL-X's joints: the k-th, counted from 1, is what label k says."""

_KEYS = ("body", "object", "sbj_id", "obj_name", "n_comps")
_TOOLS, _SUBJECTS, _MESHES = "tools", "subject_meshes", ("object_meshes", "contact_meshes")
_ROWS = 1024  # Frames whose labels are looked at at once.
_TABLE_NOTE = "Contact is labelled for the object only, not for the table."


def holds(file: SourceFile) -> bool:
    """Return whether an `.npz` file has the arrays of one of GRAB's recordings."""
    return all(name in file.array_names for name in _KEYS)


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a file."""
    fields = npz_fields(file, file.path)
    name = fields.text("obj_name", "the object's name")
    file.beside(name)  # A plain name, or an error.
    gender = fields.text("gender", "the subject's gender")
    pose = fields.table("body", "the person").table("params", "the person's pose")
    frames = len(pose.array("transl", ("T", 3), "the body's position"))

    def read_tracks() -> Tracks:
        body = _body(file, fields, pose, frames, gender)
        item = _track(file, fields.table("object", "the object"), name, frames, options)
        table = _track(file, fields.table(TABLE, "the table"), TABLE, frames, options)
        touching = _touching(file.path, fields.get("contact"), frames)
        return Tracks(
            people=(body,),
            objects=(item, table),
            touching={(0, part): active for part, active in _active(touching).items()},
            notes=_other_touches(touching, name),
        )

    return SourceRecording(
        name=f"{file.path.resolve().parent.name}_{file.path.stem}",
        description="GRAB recording of one person, one object and a table",
        frames=frames,
        fps=float(fields.array("framerate", (), "frames a second")),
        fps_stated=True,
        skeleton=f"SMPL-X {gender}, with the body of subject {fields.text('sbj_id', 'the subject')}",
        objects=(name, TABLE),
        contacts="labels of the object's vertices",
        licence=LICENCE,
        notes=(_TABLE_NOTE,),
        up="z",
        read_tracks=read_tracks,
    )


def _body(file: SourceFile, fields: Fields, pose: Fields, frames: int, gender: str) -> BodyParameters:
    named = fields.table("body", "the person").text("vtemp", "the subject's own body")
    return BodyParameters.of_fields(
        pose,
        frames,
        hand=int(fields.array("n_comps", (), "components of a hand")),
        gender=gender,
        betas=np.zeros(0),
        flat_hands=False,
        template=_template(file, named, gender),
    )


def _template(file: SourceFile, named: str, gender: str) -> Float[np.ndarray, "V 3"]:
    """Return the vertices of the subject's own body [m]; raises `ReadError`, `ClipError` or `GeometryError`."""
    if gender not in get_args(Gender):
        raise ClipError(f"{file.name}: gender is {gender[:40]!a}, expected {' or '.join(get_args(Gender))}.")
    plain = file.beside(PurePosixPath(named).name).name  # A plain name, or an error.
    folder = folder_of_tree(file.path, _TOOLS, _SUBJECTS, beside="grab")
    candidates = (folder / gender / plain, folder / plain)
    for path in candidates:
        if path.is_file():
            file.read(path)  # The person depends on it: it counts into the digest.
            return first_mesh("the subject's body", [path], centred=False).points
    raise ReadError(
        f"{file.name}: the subject's own body is missing, looked for {candidates[0]}. Unpack GRAB's {_TOOLS} "
        "beside its folder grab."
    )


def _track(file: SourceFile, fields: Fields, name: str, frames: int, options: ReadOptions) -> ObjectTrack:
    pose = fields.table("params", "the pose")
    turns = se3.exp(pose.array("global_orient", (frames, 3), "rotation vectors"))
    positions = pose.array("transl", (frames, 3), "positions")
    mesh = fields.text("table_mesh" if name == TABLE else "object_mesh", "the mesh's file")
    return ObjectTrack(name, positions, se3.quat_conjugate(turns), _geometry(file, name, mesh, options.objects))


def _geometry(file: SourceFile, name: str, named: str, objects: Path | None) -> ObjectGeometry:
    plain = file.beside(PurePosixPath(named).name).name  # A plain name, or an error.
    if objects is not None:
        folders = [objects, objects / _MESHES[-1]]
    else:
        tools = folder_of_tree(file.path, _TOOLS, _MESHES[0], beside="grab")
        folders = [tools / _MESHES[1], tools]
    return first_mesh(name, [folder / plain for folder in folders], centred=False)


def _touching(path: Path, contact: Any, frames: int) -> Bool[np.ndarray, "T 56"]:
    """Return which labels any vertex of the object has in each frame; raises `ClipError`."""
    labels = contact.get("object") if isinstance(contact, Mapping) else None
    if not isinstance(labels, np.ndarray) or labels.dtype.kind not in "iu" or labels.ndim != 2 or not labels.size:
        raise ClipError(
            f"{path}: contact/object, which part touches each vertex, is no table of whole numbers with a row for each "
            "frame. Download the recording again."
        )
    if len(labels) != frames:
        raise ClipError(f"{path}: contact/object has {len(labels)} frames, the recording {frames}. Download it again.")
    if labels.min() < 0 or labels.max() > len(LABELLED_JOINTS):
        raise ClipError(
            f"{path}: contact/object has labels from {labels.min()} to {labels.max()}, expected 0 to "
            f"{len(LABELLED_JOINTS)}. Download the recording again."
        )
    touching = np.zeros((frames, len(LABELLED_JOINTS) + 1), dtype=bool)
    for first in range(0, frames, _ROWS):
        rows = labels[first : first + _ROWS]
        which, where = np.nonzero(rows)
        touching[first + which, rows[which, where]] = True
    return touching


def _active(touching: Bool[np.ndarray, "T 56"]) -> dict[str, Bool[np.ndarray, "T"]]:
    """Return the frames in which each part touches, and each finger that ever does."""
    found = {part: np.any(touching[:, _labels_of(part)], axis=1) for part in (*PARTS, *FINGER_PARTS)}
    return {part: active for part, active in found.items() if part in PARTS or active.any()}


def _labels_of(part: str) -> list[int]:
    """Return the labels that mean a part: those of its joints, and for a hand that of the wrist, which is the palm."""
    joints = ALL_PARTS[part].label_joints + ((PARTS[part].rotation_joint,) if part in HANDS else ())
    return [LABELLED_JOINTS.index(joint) + 1 for joint in joints]


def _other_touches(touching: Bool[np.ndarray, "T 56"], name: str) -> tuple[str, ...]:
    used = {label for part in PARTS for label in _labels_of(part)}
    others = [LABELLED_JOINTS[label - 1] for label in np.flatnonzero(touching.any(axis=0)) if label not in used]
    return (f"{name} is also touched by {', '.join(others)}, which no part of the robot follows.",) if others else ()


READER = Reader(FORMAT, record, holds=holds)
