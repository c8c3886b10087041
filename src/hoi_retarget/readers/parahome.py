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
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.clip.clip import MINIMUM_FRAMES, Clip, Source
from hoi_retarget.errors import BodyModelError, ClipError, GeometryError, ReadError
from hoi_retarget.files.source_file import FOLDER, SourceFile
from hoi_retarget.files.torch_file import parse_tensors
from hoi_retarget.human import kinematics, rest_pose
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.body_parameters import BodyParameters, person_of
from hoi_retarget.readers.companions import folder_above, folder_of_tree, json_values, refuse_object_name
from hoi_retarget.readers.fields import Fields
from hoi_retarget.readers.object_files import load_mesh
from hoi_retarget.readers.reader import Outline, Reader, ReadOptions
from hoi_retarget.readers.rigid import poses_of
from hoi_retarget.readers.upright import check_upright

FORMAT = "parahome"
LICENCE = "CC BY-NC-SA 4.0, academic use"
FPS = 30.0
UP = "z"
LARGEST_GAP = 0.10
"""[m]; median distance between joints of the makers' fit and of their skeleton: farther, frames or people differ."""
LARGEST_WANDERING = 0.02
"""[m]; root mean square of a joint's way from its place in its parent's frame."""

_POSES = "object_transformations.pkl"
_JOINTS = "joint_positions.pkl"
_ANNOTATIONS = ("text_annotation.json", "text_annotations.json")
_INTERVAL = re.compile(r"\s*(\d{1,9})\s+(\d{1,9})\s*")
_MOST_FRAMES = 1 << 30
_BODY, _HAND = 23, 25

_PLACES: Mapping[str, tuple[int, int]] = {
    "pelvis": (1, 0),
    "spine1": (2, 2),
    "spine2": (3, 3),
    "spine3": (4, 4),
    "neck": (5, 5),
    "head": (6, 6),
    "right_collar": (7, 7),
    "right_shoulder": (8, 8),
    "right_elbow": (9, 9),
    "right_wrist": (10, 10),
    "left_collar": (11, 11),
    "left_shoulder": (12, 12),
    "left_elbow": (13, 13),
    "left_wrist": (14, 14),
    "right_hip": (15, 15),
    "right_knee": (16, 16),
    "right_ankle": (17, 17),
    "right_foot": (18, 18),
    "left_hip": (19, 19),
    "left_knee": (20, 20),
    "left_ankle": (21, 21),
    "left_foot": (22, 22),
}
"""Joint of `skeleton.JOINTS` -> ParaHome's joint where it is, and the one whose rotation it has."""
_PARENTS = (-1, 0, 1, 2, 3, 4, 5, 4, 7, 8, 9, 4, 11, 12, 13, 0, 15, 16, 17, 0, 19, 20, 21)
"""Of ParaHome's body."""
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
_STRAIGHT, _ROUGHLY = 0.95, 0.75
"""Cosines within which the T-pose lies along axes: hips from side to side, the spine's lowest bone upwards."""
_SMALLEST_PALM = 1e-3
"""[m]; no palm is that short or narrow."""
_STILL_METRES, _STILL_RADIANS = 2e-3, 0.01
_RATE_NOTE = "30 frames a second, as others than the makers state it; the files do not."
_SKELETON_NOTE = (
    "The person is ParaHome's own skeleton: the pelvis at the lowest joint of the spine, hands and fingers turned as "
    "the palm lies."
)


@dataclass(frozen=True)
class _Interval:
    """Frames of a folder's recording, the last one not included, and what is done in them."""

    first: int
    stop: int
    text: str

    @property
    def name(self) -> str:
        return f"{self.first}-{self.stop}"


@dataclass(frozen=True, eq=False)
class _Track:
    """In which frames a part is there, and where."""

    frames: Int[np.ndarray, "N"]
    poses: Float[np.ndarray, "N 4 4"]


def holds(file: SourceFile) -> bool:
    """Return whether a folder has the files of one of ParaHome's recordings."""
    return file.beside(_POSES).is_file() and file.beside(_JOINTS).is_file()


def clips_in(file: SourceFile) -> tuple[str, ...]:
    """Return the annotated intervals, such as `215-360`, in their order; raises `ReadError`."""
    return tuple(_intervals(file))


def read_file(file: SourceFile, options: ReadOptions) -> Clip:
    """Return the interval that is selected; the makers' fit is used where body models are given.

    Raises:
        ReadError: files are missing or damaged.
        ClipError: arrays are missing, disagree, or contradict each other.
        GeometryError: a part's mesh cannot be had.
        BodyModelError: the own skeleton's rotations do not fit its joints, so that a body model is needed.
        ArgumentError: an object's name is given.
    """
    interval = _selected(file)
    refuse_object_name(file, options, "its parts")
    tracks, object_notes = _objects(file, options, interval)
    joints = _array(file, _JOINTS, ("T", _BODY + 2 * _HAND, 3), "the joints")
    if interval.stop > len(joints):
        raise ClipError(
            f"{file.name}: the interval {interval.name} ends after the {len(joints)} frames of {_JOINTS}. Choose "
            "another interval, or download the recording again."
        )
    if options.body_models is None:
        person, person_notes = _own_person(file, joints, interval), (_SKELETON_NOTE,)
    else:
        person, person_notes = _fitted_person(file, joints, interval, options.body_models), ()
    check_upright(file.path, person, UP)
    return Clip(
        name=f"{file.path.resolve().name}_{interval.name}",
        fps=FPS,
        people=(person,),
        objects=tracks,
        contacts=(),
        source=Source(
            str(file.name),
            file.sha256,
            FORMAT,
            LICENCE,
            notes=(f"Described as {interval.text[:200]!r}.", _RATE_NOTE, *person_notes, *object_notes),
        ),
        first_source_frame=interval.first,
    )


def outline(file: SourceFile) -> Outline:
    """Return what the selected interval holds, without joints and poses; raises `ReadError` or `ClipError`."""
    interval = _selected(file)
    return Outline(
        description=f"ParaHome recording of one person in a room: {interval.text[:200]}",
        frames=interval.stop - interval.first,
        fps=FPS,
        fps_stated=False,
        skeleton="73 joints of ParaHome's own skeleton; SMPL-X with 20 betas beside it",
        up_axis="z, as the format has it",
        people=1,
        objects=_scene(file),
        contacts="none stored",
        licence=LICENCE,
    )


# Files


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


def _selected(file: SourceFile) -> _Interval:
    intervals = _intervals(file)
    name = next(iter(intervals)) if file.selection is None and len(intervals) == 1 else file.selection
    if name is None or name not in intervals:
        raise ReadError(
            f"{file.name}: it does not say which of its {len(intervals)} intervals. Choose one: "
            f"{file.path}#{next(iter(intervals))}"
        )
    interval = intervals[name]
    if interval.stop - interval.first < MINIMUM_FRAMES:
        raise ClipError(f"{file.name}: the interval has fewer than {MINIMUM_FRAMES} frames. Choose another one.")
    return interval


def _scene(file: SourceFile) -> tuple[str, ...]:
    path = file.beside("object_in_scene.json")
    if not path.is_file():
        return ()
    return tuple(name for name, is_there in json_values(file, path).items() if is_there)


def _array(file: SourceFile, name: str, shape: tuple[int | str, ...], meaning: str) -> np.ndarray:
    path = file.beside(name)
    return Fields(path, {name: parse_tensors(file.read(path), path)}).array(name, shape, meaning)


# Objects


def _objects(
    file: SourceFile, options: ReadOptions, interval: _Interval
) -> tuple[tuple[ObjectTrack, ...], tuple[str, ...]]:
    path = file.beside(_POSES)
    made, absent = [], []
    for name, track in _tracks(file.read(path), path).items():
        within = (track.frames >= interval.first) & (track.frames < interval.stop)
        count = int(within.sum())
        if count == interval.stop - interval.first:
            poses = Fields(path, {name: track.poses[within]}).array(name, (count, 4, 4), "the part's pose")
            made.append(ObjectTrack(name, *poses_of(path, name, poses), _geometry(file, options, name)))
        elif count:
            absent.append(f"{name} ({count} frames)")
    if not made:
        raise ClipError(f"{path}: no part of an object is there in all frames of {interval.name}. Choose another one.")
    still = [track.name for track in made if _is_still(track)]
    notes: tuple[str, ...] = ()
    if still:
        notes += (f"Parts that do not move: {', '.join(still)}.",)
    if absent:
        notes += (f"Left out, as they are there in some of the frames only: {', '.join(absent)}.",)
    return tuple(made), notes


@lru_cache(maxsize=2)
def _tracks(content: bytes, path: Path) -> Mapping[str, _Track]:
    """Return the tracks of all parts over a whole recording, by name; raises `ReadError`."""
    frames = parse_tensors(content, path)
    found: dict[str, tuple[list[int], list[np.ndarray]]] = {}
    for frame, parts in frames.items() if isinstance(frames, dict) else ():
        if type(frame) is not int or not 0 <= frame < _MOST_FRAMES or not isinstance(parts, dict):
            raise ReadError(f"{path}: frame {frame!a} is not a number with a dictionary of parts. Download it again.")
        for name, pose in parts.items():
            if not isinstance(name, str) or not _is_pose(pose):
                raise ReadError(f"{path}: frame {frame}: {name!a} is no part with a matrix (4, 4). Download it again.")
            numbers, poses = found.setdefault(name, ([], []))
            numbers.append(frame)
            poses.append(pose)
    if not found:
        raise ReadError(f"{path}: there are no poses of objects in it. Download it again.")
    return {name: _in_order(np.array(numbers), np.array(poses)) for name, (numbers, poses) in sorted(found.items())}


def _is_pose(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.shape == (4, 4) and value.dtype.kind in "fiu"


def _in_order(frames: Int[np.ndarray, "N"], poses: np.ndarray) -> _Track:
    order = np.argsort(frames)
    return _Track(frames[order], poses[order])


def _is_still(track: ObjectTrack) -> bool:
    moves = np.ptp(track.positions, axis=0).max() > _STILL_METRES
    return not moves and float(se3.angle_between(track.quats, track.quats[0]).max()) <= _STILL_RADIANS


def _geometry(file: SourceFile, options: ReadOptions, name: str) -> ObjectGeometry:
    thing, _, part = name.rpartition("_")
    file.beside(thing, part)  # Plain names, or an error.
    folder = options.objects or folder_of_tree(file.path, "scan", beside="seq")
    path = folder / thing / "simplified" / f"{part}.obj"
    if not path.is_file():
        raise GeometryError(
            f"object {name!r}: there is no mesh {path}. Pass --objects DIR with ParaHome's scans, "
            f"{thing}/simplified/{part}.obj."
        )
    return load_mesh(path)


# The person


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
    shape, pose = _table(file, folder / "smplx_params.pkl"), _table(file, folder / "smplx_pose.pkl")
    frames = slice(interval.first, interval.stop)
    body = pose.array("body_pose", (len(joints), 63), "the body's pose")[frames]
    hands = pose.array("hand_pose", (len(joints), 90), "the hands' pose, left and right")[frames]
    root = pose.array("global_orient", (len(joints), 3), "the pelvis's rotation")[frames]
    parameters = BodyParameters(
        family="smplx",
        gender=shape.text("gender", "the body model"),
        betas=shape.array("beta", (1, 20), "the body's shape")[0],
        translation=pose.array("transl", (len(joints), 3), "the body's position")[frames],
        body=np.concatenate([root, body], axis=1),
        left_hand=hands[:, :45],
        right_hand=hands[:, 45:],
        flat_hands=True,
    )
    person = person_of(pose.path, "person", parameters, body_models)
    compared = [f"{side}_{joint}" for side in ("left", "right") for joint in _COMPARED]
    fitted = person.joint_positions[:, [JOINT_INDEX[joint] for joint in compared]]
    own = joints[frames][:, [_PLACES[joint][0] for joint in compared]]
    gap = float(np.median(np.linalg.norm(fitted - own, axis=2)))
    if gap > LARGEST_GAP:
        raise ClipError(
            f"{pose.path}: arms and legs of the fit are mostly {gap:.3g} m from those of {_JOINTS}, expected at most "
            f"{LARGEST_GAP:g} m: frames or people differ. Use the model of that gender, or leave --body-models away."
        )
    return person


def _table(file: SourceFile, path: Path) -> Fields:
    """Return a dictionary of arrays as fields: numbers of one frame, whether by joint or not, in one row."""
    values = parse_tensors(file.read(path), path)
    if not isinstance(values, dict):
        raise ReadError(f"{path}: it holds {type(values).__name__}, expected a dictionary. Download it again.")
    return Fields(path, {name: _in_rows(value) for name, value in values.items()})


def _in_rows(value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        return value
    if value.ndim == 3 and value.shape[2] == 3:
        return value.reshape(len(value), 3 * value.shape[1])
    return value[None] if value.ndim == 1 else value


def _own_person(file: SourceFile, joints: Float[np.ndarray, "T 73 3"], interval: _Interval) -> Person:
    """Return the person that ParaHome's own skeleton is."""
    frames = slice(interval.first, interval.stop)
    rotations = _array(file, "body_joint_orientations.pkl", (len(joints), _BODY, 6), "rows of rotations")[frames]
    transforms = _array(file, "body_global_transform.pkl", (len(joints), 4, 4), "the body's frame")[frames]
    joints = joints[frames]
    _, frame = poses_of(file.path, "body_global_transform.pkl", transforms)
    own = se3.quat_multiply(frame[:, None], _quats_of_rows(file.path, rotations))
    bones = kinematics.bones_in_parents(joints[:, :_BODY], own, _PARENTS)
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
    if rest_pose.agreement(positions, quats) < rest_pose.LEAST_AGREEMENT:
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
    wandering = np.sqrt(np.mean(kinematics.wandering(bones) ** 2, axis=0))
    if wandering.max() > LARGEST_WANDERING:
        raise _unfit(
            path,
            f"turned by its rotations, its bones do not keep their place: joint {int(wandering.argmax())} wanders by "
            f"{wandering.max():.3g} m",
        )


def _t_pose_axes(path: Path, bones: Float[np.ndarray, "23 3"]) -> Float[np.ndarray, "4"]:
    """Return the rotation from the T-pose of `skeleton` to that of the file, wxyz."""
    left_hip, right_hip, spine = _PLACES["left_hip"][0], _PLACES["right_hip"][0], 1
    left = _nearest_axis(bones[left_hip] - bones[right_hip], _STRAIGHT)
    up = _nearest_axis(bones[spine], _ROUGHLY)
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
    """Return how the palm lies, wxyz: in the T-pose fingers are along x and the index in front of the pinky."""
    along = sign * (hand[:, _FINGERS["middle"][0]] - hand[:, 0])
    upward = np.cross(hand[:, _FINGERS["index"][0]] - hand[:, _FINGERS["pinky"][0]], along)
    length, area = (np.linalg.norm(sides, axis=1, keepdims=True) for sides in (along, upward))
    if length.min() < _SMALLEST_PALM or area.min() < _SMALLEST_PALM**2:
        raise ClipError(f"{path}: {_JOINTS} has a palm without length or breadth. Download it again.")
    x, y = along / length, upward / area
    return se3.matrix_to_quat(np.stack([x, y, np.cross(x, y)], axis=-1))


READER = Reader(
    format=FORMAT,
    suffixes=(FOLDER,),
    parts=(_POSES, _JOINTS),
    floor_at_zero=False,
    holds=holds,
    read=read_file,
    clips_in=clips_in,
    outline=outline,
)
