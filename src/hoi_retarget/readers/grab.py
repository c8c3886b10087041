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

from hoi_retarget.clip.clip import MINIMUM_FRAMES, Clip, ContactTrack, Source
from hoi_retarget.errors import ClipError, ReadError
from hoi_retarget.files.npz import object_or_array
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.body_model import Gender
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import HANDS, JOINTS, PARTS
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.body_parameters import BodyParameters, person_of
from hoi_retarget.readers.companions import folder_of_tree, refuse_object_name
from hoi_retarget.readers.fields import Fields
from hoi_retarget.readers.reader import Outline, Reader, ReadOptions
from hoi_retarget.readers.triangles import first_mesh
from hoi_retarget.readers.upright import check_upright

FORMAT = "grab"
LICENCE = "GRAB's licence: non-commercial scientific research only"
UP = "z"
TABLE = "table"
LABELLED_JOINTS = (*JOINTS[:22], "jaw", "left_eye", "right_eye", *JOINTS[22:])
"""SMPL-X's joints: the k-th, counted from 1, is what label k says."""

_TOLD_BY = ("body", "object", "sbj_id", "obj_name", "n_comps")
_TOOLS, _SUBJECTS, _MESHES = "tools", "subject_meshes", ("object_meshes", "contact_meshes")
_ROWS = 1024  # Frames whose labels are looked at at once.
_TABLE_NOTE = "Contact is labelled for the object only, not for the table."


def holds(file: SourceFile) -> bool:
    """Return whether an `.npz` file has the arrays of one of GRAB's recordings."""
    return all(name in file.array_names for name in _TOLD_BY)


def read_file(file: SourceFile, options: ReadOptions) -> Clip:
    """Return the clip in a file.

    Raises:
        ReadError: the file is damaged, or the subject's own body is not in the tree that the file is in.
        ClipError: arrays are missing, unusable or disagree, or nobody stands upright.
        GeometryError: a mesh cannot be had.
        BodyModelError: the body model cannot be had.
        ArgumentError: an object's name is given.
    """
    members = _Members(file)
    fields = Fields(file.path, members)
    name = fields.text("obj_name", "the object's name")
    file.beside(name)  # A plain name, or an error.
    refuse_object_name(file, options, f"{name}, {TABLE}")
    frames, fps = _frames_and_rate(fields)
    person = _person(file, fields, frames, options)
    check_upright(file.path, person, UP)
    item = fields.table("object", "the object")
    tracks = (
        _track(file, item, name, "object_mesh", frames, options),
        _track(file, fields.table(TABLE, "the table"), TABLE, "table_mesh", frames, options),
    )
    touching = _touching(file.path, members.get("contact"), frames)
    return Clip(
        name=f"{file.path.resolve().parent.name}_{file.path.stem}",
        fps=fps,
        people=(person,),
        objects=tracks,
        contacts=_contacts(touching, person, tracks[0]),
        source=Source(str(file.name), file.sha256, FORMAT, LICENCE, (_TABLE_NOTE, *_other_touches(touching, name))),
    )


def outline(file: SourceFile) -> Outline:
    """Return what a file holds, without shapes and body models; raises `ReadError` or `ClipError`."""
    fields = Fields(file.path, _Members(file))
    frames, fps = _frames_and_rate(fields)
    gender = fields.text("gender", "the subject's gender")
    return Outline(
        description="GRAB recording of one person, one object and a table",
        frames=frames,
        fps=fps,
        fps_stated=True,
        skeleton=f"SMPL-X {gender}, with the body of subject {fields.text('sbj_id', 'the subject')}",
        up_axis="z, as the format has it",
        people=1,
        objects=(fields.text("obj_name", "the object's name"), TABLE),
        contacts="labels of the object's vertices",
        licence=LICENCE,
    )


class _Members(Mapping[str, Any]):
    """The arrays of the file, each unpickled when it is asked for: most of the file is of no use here."""

    def __init__(self, file: SourceFile) -> None:
        self._file = file

    def __getitem__(self, name: str) -> Any:
        return object_or_array(self._file.path, name, self._file.members[name])

    def __iter__(self) -> Any:
        return iter(self._file.members)

    def __len__(self) -> int:
        return len(self._file.members)


def _frames_and_rate(fields: Fields) -> tuple[int, float]:
    """Return how many frames there are, and how many a second; raises `ClipError`."""
    positions = fields.table("body", "the person").table("params", "the person's pose")
    frames = len(positions.array("transl", ("T", 3), "the body's position"))
    if frames < MINIMUM_FRAMES:
        raise ClipError(f"{fields.path}: there are {frames} frames; at least {MINIMUM_FRAMES} are needed.")
    return frames, float(fields.array("framerate", (), "frames a second"))


# The person


def _person(file: SourceFile, fields: Fields, frames: int, options: ReadOptions) -> Person:
    body = fields.table("body", "the person")
    values = body.table("params", "the person's pose")
    components = int(fields.array("n_comps", (), "components of a hand"))
    gender = fields.text("gender", "the subject's gender")
    root = values.array("global_orient", (frames, 3), "the pelvis's rotation")
    parameters = BodyParameters(
        family="smplx",
        gender=gender,
        betas=np.zeros(0),
        translation=values.array("transl", (frames, 3), "the body's position"),
        body=np.concatenate([root, values.array("body_pose", (frames, 63), "the body's pose")], axis=1),
        left_hand=values.array("left_hand_pose", (frames, components), "the left hand's components"),
        right_hand=values.array("right_hand_pose", (frames, components), "the right hand's components"),
        flat_hands=False,
        template=_template(file, body.text("vtemp", "the subject's own body"), gender),
    )
    return person_of(file.path, "person", parameters, options.body_models)


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


# Objects


def _track(  # noqa: PLR0913, PLR0917 - the object and the table differ in all of it
    file: SourceFile, fields: Fields, name: str, mesh_key: str, frames: int, options: ReadOptions
) -> ObjectTrack:
    values = fields.table("params", "the pose")
    turns = se3.exp(values.array("global_orient", (frames, 3), "rotation vectors"))
    mesh = fields.text(mesh_key, "the mesh's file")
    return ObjectTrack(
        name,
        values.array("transl", (frames, 3), "positions"),
        se3.quat_conjugate(turns),
        _geometry(file, name, mesh, options.objects),
    )


def _geometry(file: SourceFile, name: str, named: str, objects: Path | None) -> ObjectGeometry:
    plain = file.beside(PurePosixPath(named).name).name  # A plain name, or an error.
    if objects is not None:
        folders = [objects, objects / _MESHES[-1]]
    else:
        tools = folder_of_tree(file.path, _TOOLS, _MESHES[0], beside="grab")
        folders = [tools / _MESHES[1], tools]
    return first_mesh(name, [folder / plain for folder in folders], centred=False)


# Contacts


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


def _labels_of(part: str) -> list[int]:
    """Return the labels that mean a part: those of its joints, and for a hand that of the wrist, which is the palm."""
    joints = PARTS[part].label_joints + ((PARTS[part].rotation_joint,) if part in HANDS else ())
    return [LABELLED_JOINTS.index(joint) + 1 for joint in joints]


def _contacts(touching: Bool[np.ndarray, "T 56"], person: Person, track: ObjectTrack) -> tuple[ContactTrack, ...]:
    return tuple(
        ContactTrack(
            0, 0, part, np.any(touching[:, _labels_of(part)], axis=1), track.to_object(person.part_position(part))
        )
        for part in PARTS
    )


def _other_touches(touching: Bool[np.ndarray, "T 56"], name: str) -> tuple[str, ...]:
    used = {label for part in PARTS for label in _labels_of(part)}
    others = [LABELLED_JOINTS[label - 1] for label in np.flatnonzero(touching.any(axis=0)) if label not in used]
    return (f"{name} is also touched by {', '.join(others)}, which no part of the robot follows.",) if others else ()


READER = Reader(
    format=FORMAT,
    suffixes=(".npz",),
    floor_at_zero=False,
    holds=holds,
    read=read_file,
    outline=outline,
)
