"""Reads CORE4D's recordings of two people and one object: a folder for each.

`person1_poses.npz` and `person2_poses.npz` hold a dictionary each, pickled into `arr_0`: parameters of neutral SMPL-X,
ten betas, hands as twelve principal components from the flat hand, and the joints and vertices that come out of them.
`smooth_objposes.npy` holds the object's poses as matrices, `object_metadata.json` its name; its mesh is
`object_models/<category>/<name>_m.obj`, the category being the name without its three digits. y is up, in metres, 15
frames a second, which the makers' paper says and not the files (leolyliu/CORE4D-Instructions docs/file_definitions.md,
benchmarks/data_processing/utils/VTS_object.py).

Joints need no body model here: they are stored, in SMPL-X's order, and the pose gives the body's rotations. With a
model people come from it, and must be where the stored joints are.

The second version has other files for people, `person_1/result.npz`, and no objects; the synthetic part's files are
nowhere described. Both are refused.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError, ReadError
from hoi_retarget.files import npz
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human import skeleton
from hoi_retarget.human.body_model import JOINT_COUNT
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINTS
from hoi_retarget.numerics.arrays import describe_frames
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.body_parameters import BodyParameters, constant_betas, person_of
from hoi_retarget.readers.fields import Fields, check_frames, folder_of_tree, json_values, npz_fields
from hoi_retarget.readers.object_files import first_mesh, poses_of
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks

FORMAT = "core4d"
LICENCE = "CC BY 4.0, as the data set's README says"
FPS = 15.0
PEOPLE = ("person1", "person2")
MAX_GAP = 0.01  # [m]; between joints that the file stores and where its own parameters put them.

_PARAMETERS = "arr_0"
_POSES = "smooth_objposes.npy"
_METADATA = "object_metadata.json"
_MESHES = "object_models"
_STORED_JOINTS = 127  # SMPL-X's 55 joints, then points of the face, the feet and the fingertips.
_SKELETON_JOINTS = [*range(22), *range(25, JOINT_COUNT["smplx"])]
"""Which of them are those of `skeleton.JOINTS`: all but jaw and eyes."""
_DIGITS = 3
_NEW_PEOPLE = ("person_1", "result.npz")
_SYNTHETIC = ("human_poses.npy", "object_poses.npy", "object_mesh.obj")
_RATE_NOTE = "15 frames a second, as the makers' paper and scripts have it; the files do not state it."
_FINGER_NOTE = (
    "Finger joints are where the file has them, turned as the wrist: their own rotations are components that only the "
    "body model can expand."
)


def holds(file: SourceFile) -> bool:
    """Return whether a folder has the files of one of CORE4D's recordings, of any version."""
    names = ((f"{PEOPLE[0]}_poses.npz",), _NEW_PEOPLE)
    return any(file.beside(*name).is_file() for name in names) or _is_synthetic(file)


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a folder; body models are used where they are given."""
    _check_version(file)
    name, poses = _object_name(file), _object_poses(file)

    def read_tracks() -> Tracks:
        positions, quats = poses_of(file.beside(_POSES), "the object's pose", poses)
        return Tracks(
            people=tuple(_person(file, person, len(poses), options.body_models) for person in PEOPLE),
            objects=(ObjectTrack(name, positions, quats, _geometry(file, options, name)),),
            notes=() if options.body_models else (_FINGER_NOTE,),
        )

    return SourceRecording(
        name="_".join(file.path.resolve().parts[-2:]),
        description="CORE4D recording of two people and one object",
        frames=len(poses),
        fps=FPS,
        skeleton="SMPL-X neutral, 10 betas, joints stored",
        people=len(PEOPLE),
        objects=(name,),
        licence=LICENCE,
        notes=(_RATE_NOTE,),
        up="y",
        read_tracks=read_tracks,
    )


def _is_synthetic(file: SourceFile) -> bool:
    return all(file.beside(name).is_file() for name in _SYNTHETIC)


def _check_version(file: SourceFile) -> None:
    if _is_synthetic(file):
        raise ReadError(
            f"{file.name}: this is of CORE4D's synthetic part, whose {_SYNTHETIC[0]} its makers do not describe. Only "
            f"recordings with {PEOPLE[0]}_poses.npz are read."
        )
    if not file.beside(f"{PEOPLE[0]}_poses.npz").is_file():
        raise ReadError(
            f"{file.name}: this is a recording of CORE4D's second version, {'/'.join(_NEW_PEOPLE)}, which has people "
            f"without objects. Name the folder of the first version, with {PEOPLE[0]}_poses.npz and {_POSES}."
        )


def _object_name(file: SourceFile) -> str:
    """Return the object's name in small letters, which is its mesh's; raises `ReadError` or `ClipError`."""
    path = file.beside(_METADATA)
    name = Fields(path, json_values(file, path)).text("obj_name", "the object's name").lower()
    category = name[:-_DIGITS]
    if not category or not name[-_DIGITS:].isdecimal():
        raise ClipError(
            f"{path}: obj_name is {name[:80]!a}, expected a category and three digits, such as 'box021'. "
            "Download it again."
        )
    file.beside(category, name)  # A plain name, or an error.
    return name


def _object_poses(file: SourceFile) -> Float[np.ndarray, "T 4 4"]:
    path = file.beside(_POSES)
    try:
        poses = npz.array(_POSES, file.read(path), "f")
    except ValueError as error:
        raise ReadError(f"{path}: cannot be read: {error}. Download it again.") from error
    return Fields(path, {_POSES: poses}).array(_POSES, ("T", 4, 4), "the object's poses")


def _geometry(file: SourceFile, options: ReadOptions, name: str) -> ObjectGeometry:
    folder = options.objects or folder_of_tree(file.path, _MESHES, beside="human_object_motions")
    places = (folder / name[:-_DIGITS], folder)
    return first_mesh(name, [place / f"{name}_m.obj" for place in places], centred=False)


def _person(file: SourceFile, name: str, frames: int, body_models: Path | None) -> Person:
    # One after the other: the vertices beside the joints are a hundred times as large as all the rest.
    fields = npz_fields(file, file.beside(f"{name}_poses.npz")).table(_PARAMETERS, "the person's parameters")
    stored = fields.array("joints", ("T", _STORED_JOINTS, 3), "the joints")[:, _SKELETON_JOINTS]
    check_frames(file.path, {_POSES: frames, name: len(stored)})
    root = fields.array("global_orient", (frames, 3), "the pelvis's rotation")
    body = fields.array("body_pose", (frames, 21, 3), "the body's pose")
    pose = np.concatenate([root[:, None], body], axis=1)
    if body_models is None:
        return _person_of_joints(fields.path, name, stored, pose)
    parameters = BodyParameters.of_fields(
        fields,
        frames,
        hand=12,
        gender="neutral",
        betas=constant_betas(fields.path, fields.array("betas", (frames, 10), "the body's shape")),
        flat_hands=True,
    )
    person = person_of(fields.path, name, parameters, body_models)
    _check_gap(fields.path, np.linalg.norm(person.joint_positions - stored, axis=-1), "the body model puts")
    return person


def _person_of_joints(
    path: Path, name: str, positions: Float[np.ndarray, "T 52 3"], pose: Float[np.ndarray, "T 22 3"]
) -> Person:
    body = skeleton.world_quats(pose, skeleton.BODY_PARENTS)
    count = body.shape[1]
    bones = skeleton.bones_in_parents(positions[:, :count], body, skeleton.BODY_PARENTS)
    _check_gap(path, skeleton.bone_deviations(bones), "rigid bones turned by its pose have")
    wrists = [body[:, JOINTS.index(f"{side}_wrist"), None] for side in ("left", "right")]
    hands = [np.broadcast_to(wrist, (len(body), 15, 4)) for wrist in wrists]
    return Person(name, positions, np.concatenate([body, *hands], axis=1))


def _check_gap(path: Path, gaps: Float[np.ndarray, "T J"], elsewhere: str) -> None:
    bad = gaps > MAX_GAP
    if bad.any():
        joint = JOINTS[int(gaps.max(axis=0).argmax())]
        raise ClipError(
            f"{path}: stored joints are up to {gaps.max():.3g} m from where {elsewhere} them, most at {joint}, in "
            f"{describe_frames(np.flatnonzero(bad.any(axis=1)))}; at most {MAX_GAP:g} m was expected. Use the "
            "neutral SMPL-X model, or download the recording again."
        )


READER = Reader(FORMAT, record, holds=holds)
