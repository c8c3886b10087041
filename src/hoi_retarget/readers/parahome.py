"""Reads ParaHome's own release: a folder `data/seq/s10`, of which each annotated interval of frames is a clip.

`text_annotations.json`, in the release without the plural's s, has intervals such as `215 360` and what is done in
them. `object_transformations.pkl` has a matrix for each part of each object that is there in a frame; the mesh of
`kettle_base` is `data/scan/kettle/simplified/base.obj`, not centred. `joint_positions.pkl` has 73 joints of the world:
23 of the body and 25 of each hand. z is up, in metres. The makers state no rate; others take 30 frames a second
(snuvclab/ParaHome README.md, visualize/render.py, visualize/utils.py).

With a body model the person is the makers' fit, `data/smplx_seq/s10`: SMPL-X, twenty betas, hands as rotation vectors
from the flat hand (wzyabcas/InterAct process/process_parahome.py). It must be where the 73 joints are.

Without one, the person is these joints. `body_joint_orientations.pkl` has the two first rows of each joint's rotation
in the body's frame, `body_global_transform.pkl` that frame in the world; bones turned by them must keep their length
and place. Which axes the skeleton's T-pose lies along is measured: left is from hip to hip, up from hips to spine.
The skeleton's root is midway between the hips, where SMPL-X's pelvis is not; the lowest joint of the spine, which is
rigid with it, stands for the pelvis. Hands are turned as the palm lies.

Objects' matrices are thousands of small arrays, interpreted once for all clips of a folder.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import BodyModelError, ClipError, GeometryError, ReadError
from hoi_retarget.files.array_pickle import parse_pickle
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human import skeleton, t_pose
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS
from hoi_retarget.numerics import se3
from hoi_retarget.objects.object_joint import fitted_joint, world_of
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.body_parameters import BodyParameters, person_of
from hoi_retarget.readers.fields import Fields, chosen_clip, folder_above, folder_of_tree, json_values
from hoi_retarget.readers.object_files import load_mesh, poses_of
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks

FORMAT = "parahome"
LICENCE = "CC BY-NC-SA 4.0, academic use"
FPS = 30.0
MAX_GAP = 0.10
"""[m]; median distance between joints of the makers' fit and of their skeleton: farther, frames or people differ."""
MAX_WANDERING = 0.02  # [m]; root mean square of a joint's way from its place in its parent's frame.

_POSES = "object_transformations.pkl"
_JOINTS = "joint_positions.pkl"
_ANNOTATIONS = ("text_annotation.json", "text_annotations.json")
_INTERVAL = re.compile(r"\s*(\d{1,9})\s+(\d{1,9})\s*")
_BODY, _HAND = 23, 25

_ARM, _LEG = ("collar", "shoulder", "elbow", "wrist"), ("hip", "knee", "ankle", "foot")
_ORDER = (
    *("pelvis", "spine1", "spine2", "spine3", "neck", "head"),
    *(f"{side}_{joint}" for joints in (_ARM, _LEG) for side in ("right", "left") for joint in joints),
)
_PLACES: Mapping[str, tuple[int, int]] = {
    joint: (index, index) for index, joint in enumerate(_ORDER, start=1) if joint != "pelvis"
} | {"pelvis": (1, 0)}
"""Joint of `skeleton.JOINTS` -> ParaHome's joint where it is, and the one whose rotation it has."""
_PARENTS = (-1, 0, 1, 2, 3, 4, 5, 4, 7, 8, 9, 4, 11, 12, 13, 0, 15, 16, 17, 0, 19, 20, 21)  # Of ParaHome's body.
_FINGERS: Mapping[str, tuple[int, int, int]] = {
    "thumb": (1, 22, 23),
    "index": (18, 19, 20),
    "middle": (14, 15, 16),
    "ring": (10, 11, 12),
    "pinky": (6, 7, 8),
}
"""Joints of a hand's 25, from the palm outwards."""
_HANDS: Mapping[str, tuple[int, float]] = {"left": (_BODY, 1.0), "right": (_BODY + _HAND, -1.0)}
"""Where a hand's 25 joints begin, and its fingers' direction along x in the T-pose."""
_COMPARED = ("elbow", "wrist", "knee", "ankle")
_MIN_HIP_COSINE, _MIN_SPINE_COSINE = 0.95, 0.75
"""Cosines within which the T-pose lies along axes: hips from side to side, the spine's lowest bone upwards."""
_MIN_PALM_SIZE = 1e-3  # [m]; no palm is that short or narrow.
_MAX_STILL_METRES, _MAX_STILL_RADIANS = 2e-3, 0.01
_RATE_NOTE = "30 frames a second, as others than the makers state it; the files do not."
_SKELETON_NOTE = (
    "The person is ParaHome's own skeleton: the pelvis at the lowest joint of the spine, hands and fingers turned as "
    "the palm lies."
)


@dataclass(frozen=True)
class _Interval:
    """Frames of a folder's recording, the last one not included, and a text of the action in them."""

    first: int
    stop: int
    text: str

    @property
    def name(self) -> str:
        return f"{self.first}-{self.stop}"

    @property
    def rows(self) -> slice:
        return slice(self.first, self.stop)


def holds(file: SourceFile) -> bool:
    """Return whether a folder has the files of one of ParaHome's recordings."""
    return file.beside(_POSES).is_file() and file.beside(_JOINTS).is_file()


def clips_in(file: SourceFile) -> tuple[str, ...]:
    """Return the annotated intervals, such as `215-360`, in their order; raises `ReadError`."""
    return tuple(_intervals(file))


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the selected interval; the data set's own fit is used where body models are given."""
    intervals = _intervals(file)
    interval = intervals[chosen_clip(file, intervals, "intervals")]

    def read_tracks() -> Tracks:
        tracks, notes = _objects(file, options, interval)
        joints = _array(file, _JOINTS, ("T", _BODY + 2 * _HAND, 3), "the joints")
        if interval.stop > len(joints):
            raise ClipError(
                f"{file.name}: the interval {interval.name} ends after the {len(joints)} frames of {_JOINTS}. Choose "
                "another interval, or download the recording again."
            )
        if options.body_models is not None:
            person = _fitted_person(file, joints, interval, options.body_models)
        else:
            person, notes = _own_person(file, joints, interval), (_SKELETON_NOTE, *notes)
        return Tracks(people=(person,), objects=tracks, notes=notes)

    return SourceRecording(
        name=f"{file.path.resolve().name}_{interval.name}",
        description=f"ParaHome recording of one person in a room: {interval.text[:200]}",
        frames=interval.stop - interval.first,
        fps=FPS,
        skeleton="73 joints of ParaHome's own skeleton; SMPL-X with 20 betas beside it",
        objects=_scene(file),
        licence=LICENCE,
        notes=(f"Described as {interval.text[:200]!r}.", _RATE_NOTE),
        up="z",
        read_tracks=read_tracks,
        first_frame=interval.first,
    )


def _intervals(file: SourceFile) -> dict[str, _Interval]:
    path = next((file.beside(name) for name in _ANNOTATIONS if file.beside(name).is_file()), None)
    if path is None:
        raise ReadError(f"{file.name}: there is no {_ANNOTATIONS[0]}, which tells its clips. Download it again.")
    found = []
    for key, text in json_values(file, path).items():
        match = _INTERVAL.fullmatch(key)
        if match is None or int(match[1]) >= int(match[2]) or not isinstance(text, str):
            raise ReadError(
                f"{path}: {key[:40]!a}: {ascii(text)[:40]} is no interval of frames with a text, expected such as "
                "'215 360': 'Move cup'. Download it again."
            )
        found.append(_Interval(int(match[1]), int(match[2]), text))
    if not found:
        raise ReadError(f"{path}: there are no intervals in it. Download it again.")
    return {interval.name: interval for interval in sorted(found, key=lambda it: (it.first, it.stop))}


def _scene(file: SourceFile) -> tuple[str, ...]:
    path = file.beside("object_in_scene.json")
    if not path.is_file():
        return ()
    # No clip depends on it: read by itself, it does not count into the recording's digest.
    return tuple(name for name, is_there in json_values(SourceFile(path), path).items() if is_there)


def _array(file: SourceFile, name: str, shape: tuple[int | str, ...], meaning: str) -> np.ndarray:
    path = file.beside(name)
    return Fields(path, {name: parse_pickle(file.read(path), path)}).array(name, shape, meaning)


def _objects(
    file: SourceFile, options: ReadOptions, interval: _Interval
) -> tuple[tuple[ObjectTrack, ...], tuple[str, ...]]:
    path, frames = file.beside(_POSES), range(interval.first, interval.stop)
    made, absent = [], []
    for name, known in _poses(file.read(path), path).items():
        poses = [known[frame] for frame in frames if frame in known]
        if len(poses) == len(frames):
            matrices = Fields(path, {name: poses}).array(name, ("T", 4, 4), "the part's pose")
            made.append(ObjectTrack(name, *poses_of(path, name, matrices), _geometry(file, options, name)))
        elif poses:
            absent.append(f"{name} ({len(poses)} frames)")
    if not made:
        raise ClipError(f"{path}: no part of an object is there in all frames of {interval.name}. Choose another one.")
    still = [track.name for track in made if _is_still(track)]
    sentences = {"Parts that do not move": still, "Left out, as they are there in some of the frames only": absent}
    return with_fitted_joints(made), tuple(f"{what}: {', '.join(names)}." for what, names in sentences.items() if names)


def with_fitted_joints(tracks: Sequence[ObjectTrack]) -> tuple[ObjectTrack, ...]:
    """Return objects in which `kettle_part1` hangs on `kettle_base` by a joint that fits; parts at rest may be free."""
    bases = {track.name.removesuffix("_base"): track for track in tracks if track.name.endswith("_base")}
    found = []
    for track in tracks:
        whole, _, part = track.name.rpartition("_")
        base = bases.get(whole) if part != "base" else None
        joint = None if base is None else fitted_joint(base, track)
        if base is not None and joint and joint.kind == "fixed" and fitted_joint(world_of(base), base, "fixed"):
            joint = None
        found.append(replace(track, joint=joint))
    return tuple(found)


@lru_cache(maxsize=2)
def _poses(content: bytes, path: Path) -> Mapping[str, Mapping[int, np.ndarray]]:
    """Return the poses of all parts over a whole recording, by name and frame; raises `ReadError`."""
    frames = parse_pickle(content, path)
    found: dict[str, dict[int, np.ndarray]] = {}
    for frame, parts in frames.items() if isinstance(frames, dict) else ():
        if type(frame) is not int or not isinstance(parts, dict):
            raise ReadError(f"{path}: frame {frame!a} is not a number with a dictionary of parts. Download it again.")
        for name, pose in parts.items():
            sound = isinstance(pose, np.ndarray) and pose.shape == (4, 4) and pose.dtype.kind in "fiu"
            if not isinstance(name, str) or not sound:
                raise ReadError(f"{path}: frame {frame}: {name!a} is no part with a matrix (4, 4). Download it again.")
            found.setdefault(name, {})[frame] = pose
    if not found:
        raise ReadError(f"{path}: there are no poses of objects in it. Download it again.")
    return dict(sorted(found.items()))


def _is_still(track: ObjectTrack) -> bool:
    moves = np.ptp(track.positions, axis=0).max() > _MAX_STILL_METRES
    return not moves and float(se3.angle_between(track.quats, track.quats[0]).max()) <= _MAX_STILL_RADIANS


def _geometry(file: SourceFile, options: ReadOptions, name: str) -> ObjectGeometry:
    whole, _, part = name.rpartition("_")
    file.beside(whole, part)  # Plain names, or an error.
    folder = options.objects or folder_of_tree(file.path, "scan", beside="seq")
    path = folder / whole / "simplified" / f"{part}.obj"
    if not path.is_file():
        raise GeometryError(
            f"object {name!r}: there is no mesh {path}. Pass --objects DIR with ParaHome's scans, "
            f"{whole}/simplified/{part}.obj."
        )
    return load_mesh(path)


def _fitted_person(
    file: SourceFile, joints: Float[np.ndarray, "T 73 3"], interval: _Interval, body_models: Path
) -> Person:
    """Return the person of the makers' fit of SMPL-X."""
    name = file.path.resolve().name
    folder = folder_above(file.path, "smplx_seq", name)
    if folder is None:
        raise ReadError(
            f"{file.name}: there is no folder smplx_seq/{name} beside seq, with the makers' fit of SMPL-X. Download "
            "it, or leave --body-models away to read ParaHome's own skeleton."
        )
    shape, fit = _table(file, folder / "smplx_params.pkl"), _table(file, folder / "smplx_pose.pkl")
    parts = {
        "global_orient": (3, "the pelvis's rotation"),
        "body_pose": (63, "the body's pose"),
        "hand_pose": (90, "the hands' pose, left and right"),
    }
    pose = np.concatenate([fit.rows(name, len(joints), *meaning) for name, meaning in parts.items()], axis=1)
    parameters = BodyParameters.of_rows(
        pose,
        family="smplx",
        gender=shape.text("gender", "the body model"),
        betas=shape.array("beta", (1, 20), "the body's shape")[0],
        translation=fit.rows("transl", len(joints), 3, "the body's position"),
        flat_hands=True,
    )
    person = person_of(fit.path, "person", parameters.at(interval.rows), body_models)
    compared = [f"{side}_{joint}" for side in ("left", "right") for joint in _COMPARED]
    fitted = person.joint_positions[:, [JOINT_INDEX[joint] for joint in compared]]
    own = joints[interval.rows][:, [_PLACES[joint][0] for joint in compared]]
    gap = float(np.median(np.linalg.norm(fitted - own, axis=2)))
    if gap > MAX_GAP:
        raise ClipError(
            f"{fit.path}: arms and legs of the fit are mostly {gap:.3g} m from those of {_JOINTS}, expected at most "
            f"{MAX_GAP:g} m: frames or people differ. Use the model of that gender, or leave --body-models away."
        )
    return person


def _table(file: SourceFile, path: Path) -> Fields:
    """Return a dictionary of arrays as fields: numbers without a frame as those of one frame."""
    values = parse_pickle(file.read(path), path)
    if not isinstance(values, dict):
        raise ReadError(f"{path}: it holds {type(values).__name__}, expected a dictionary. Download it again.")
    return Fields(
        path,
        {
            name: value[None] if isinstance(value, np.ndarray) and value.ndim == 1 else value
            for name, value in values.items()
        },
    )


def _own_person(file: SourceFile, joints: Float[np.ndarray, "T 73 3"], interval: _Interval) -> Person:
    """Return the person that ParaHome's own skeleton is."""
    rotations = _array(file, "body_joint_orientations.pkl", (len(joints), _BODY, 6), "rows of rotations")
    transforms = _array(file, "body_global_transform.pkl", (len(joints), 4, 4), "the body's frame")
    rotations, transforms, joints = (array[interval.rows] for array in (rotations, transforms, joints))
    _, frame = poses_of(file.path, "body_global_transform.pkl", transforms)
    own = se3.quat_multiply(frame[:, None], _quats_of_rows(file.path, rotations))
    bones = skeleton.bones_in_parents(joints[:, :_BODY], own, _PARENTS)
    _check_rigid(file.path, bones)
    turned = se3.quat_multiply(own, _t_pose_axes(file.path, bones.mean(axis=0)))
    positions, quats = np.empty((len(joints), len(JOINTS), 3)), np.empty((len(joints), len(JOINTS), 4))
    for joint, (place, rotation) in _PLACES.items():
        positions[:, JOINT_INDEX[joint]] = joints[:, place]
        quats[:, JOINT_INDEX[joint]] = turned[:, rotation]
    for side, (first, sign) in _HANDS.items():
        hand = joints[:, first : first + _HAND]
        palm = _palm_quats(file.path, hand, sign)
        quats[:, JOINT_INDEX[f"{side}_wrist"]] = palm
        for finger, places in _FINGERS.items():
            for bone, place in enumerate(places, start=1):
                positions[:, JOINT_INDEX[f"{side}_{finger}{bone}"]] = hand[:, place]
                quats[:, JOINT_INDEX[f"{side}_{finger}{bone}"]] = palm
    if t_pose.agreement(positions, quats) < t_pose.MIN_T_POSE_AGREEMENT:
        raise _unfit(file.path, "knees or elbows are elsewhere than below or beside their parents in its T-pose")
    return Person("person", positions, quats)


def _unfit(path: Path, why: str) -> BodyModelError:
    return BodyModelError(
        f"{path}: ParaHome's own skeleton cannot be used: {why}. Pass --body-models DIR with SMPL-X: the makers' fit, "
        "in smplx_seq, is read then."
    )


def _quats_of_rows(path: Path, rows: Float[np.ndarray, "T J 6"]) -> Float[np.ndarray, "T J 4"]:
    """Return rotations from the two first rows of their matrices, the second made perpendicular to the first."""
    first, second = rows[..., :3], rows[..., 3:]
    if (np.linalg.norm(np.cross(first, second), axis=-1) < 1e-6).any():
        raise ClipError(f"{path}: body_joint_orientations.pkl has rows that are zero or parallel. Download it again.")
    first = first / np.linalg.norm(first, axis=-1, keepdims=True)
    second = second - np.sum(first * second, axis=-1, keepdims=True) * first
    second = second / np.linalg.norm(second, axis=-1, keepdims=True)
    return se3.matrix_to_quat(np.stack([first, second, np.cross(first, second)], axis=-2))


def _check_rigid(path: Path, bones: Float[np.ndarray, "T 23 3"]) -> None:
    wandering = np.sqrt(np.mean(skeleton.bone_deviations(bones) ** 2, axis=0))
    if wandering.max() > MAX_WANDERING:
        raise _unfit(
            path,
            f"turned by its rotations, its bones do not keep their place: joint {int(wandering.argmax())} wanders by "
            f"{wandering.max():.3g} m",
        )


def _t_pose_axes(path: Path, bones: Float[np.ndarray, "23 3"]) -> Float[np.ndarray, "4"]:
    """Return the rotation from the T-pose of `skeleton` to that of the file, wxyz."""
    left_hip, right_hip, spine = _PLACES["left_hip"][0], _PLACES["right_hip"][0], 1
    left = _nearest_axis(bones[left_hip] - bones[right_hip], _MIN_HIP_COSINE)
    up = _nearest_axis(bones[spine], _MIN_SPINE_COSINE)
    if left is None or up is None or abs(left @ up) > 0.5:
        raise _unfit(path, "its T-pose does not lie along axes")
    axes = np.stack([left, up, np.cross(left, up)], axis=1)
    return se3.matrix_to_quat(axes)


def _nearest_axis(direction: Float[np.ndarray, "3"], least: float) -> Float[np.ndarray, "3"] | None:
    cosines = direction / max(float(np.linalg.norm(direction)), 1e-9)
    axis = np.zeros(3)
    largest = int(np.abs(cosines).argmax())
    axis[largest] = np.sign(cosines[largest])
    return axis if abs(cosines[largest]) >= least else None


def _palm_quats(path: Path, hand: Float[np.ndarray, "T 25 3"], sign: float) -> Float[np.ndarray, "T 4"]:
    """Return the palm's rotation, wxyz: in the T-pose fingers are along x and the index in front of the pinky."""
    along = sign * (hand[:, _FINGERS["middle"][0]] - hand[:, 0])
    upward = np.cross(hand[:, _FINGERS["index"][0]] - hand[:, _FINGERS["pinky"][0]], along)
    length, area = (np.linalg.norm(sides, axis=1, keepdims=True) for sides in (along, upward))
    if length.min() < _MIN_PALM_SIZE or area.min() < _MIN_PALM_SIZE**2:
        raise ClipError(f"{path}: {_JOINTS} has a palm without length or breadth. Download it again.")
    x, y = along / length, upward / area
    return se3.matrix_to_quat(np.stack([x, y, np.cross(x, y)], axis=-1))


READER = Reader(FORMAT, record, holds=holds, parts=(_POSES, _JOINTS), clips_in=clips_in)
