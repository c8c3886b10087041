"""Findings about a motion file, and the changes to its arrays that they advise."""

from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, TypeVar

import numpy as np

from hoi_retarget.motion.formats import Bodies, MotionFile, ObjectPoses
from hoi_retarget.motion.formats.motion_file import arrays_of
from hoi_retarget.numerics import se3

Values = tuple[int | float, ...]
ROOT, JOINTS, BODIES = "root", "joints", "bodies"


@dataclass(frozen=True)
class Change:
    """One change to a file's arrays."""

    kind: str  # A key of `_CHANGES`.
    of: str = ""  # `root`, `bodies`, `joints`, or an object's name; empty for all.
    values: Values = ()
    """By kind: places of components, columns, bodies, frames; factors; angles [rad]; a vector [m]; a rotation wxyz."""


Level = Literal["ok", "note", "unknown", "contradiction"]
Spoils = Literal["poses", "rate", "velocities", "objects", "nothing"]


@dataclass(frozen=True)
class FormatFinding:
    """The outcome of one check."""

    level: Level  # Whether the numbers agree with the claim, deserve a remark, leave it open, or contradict it.
    subject: str  # Such as 'quaternion order'.
    claim: str  # Of the file, or the demand of its format.
    numbers: str  # The finding, with figures of the alternatives.
    advice: str = ""  # A sentence; empty where nothing is to be done.
    spoils: Spoils = "nothing"  # The part of the file that is unusable as it is.
    fix: tuple[Change, ...] = ()
    """The advice for programs (`repair`); empty where other numbers or a decision is needed."""
    follows: str = ""  # Subject of the finding that this one follows from; empty for one of its own.

    def __str__(self) -> str:
        return f"{self.subject}: {self.numbers}"


contradiction = partial(FormatFinding, "contradiction", spoils="poses")
"""Makes the finding that contradicts a claim, of the fields behind `level`."""
T = TypeVar("T")
Check = Generator[FormatFinding, None, T]  # Yields findings, and returns a value for the next checks.


def collected(check: Check[T], findings: list[FormatFinding]) -> T:
    """Run a check, append its findings to a list, and return its value."""
    while True:
        try:
            findings.append(next(check))
        except StopIteration as end:
            return end.value


_CAUSES = (("linear velocities of ", "angular velocities of "), ("jump", "repeated frames"), ("joint speed", "jump"))
"""Beginnings of subjects: the first follows from the second where the rest is the same and both contradict a claim.

Velocities of links are made of the root's turning, a movement goes on far off after a stop, and a jump is fast.
"""


def with_causes(findings: Iterable[FormatFinding]) -> tuple[FormatFinding, ...]:
    """Return the findings, consequences of others with their causes."""
    found = tuple(findings)
    wrong = {finding.subject for finding in found if finding.level == "contradiction"}

    def cause(finding: FormatFinding) -> str:
        possible = (
            cause + finding.subject.removeprefix(effect)
            for effect, cause in _CAUSES
            if finding.subject.startswith(effect)
        )
        return next((subject for subject in possible if subject in wrong), "")

    return tuple(
        replace(item, follows=cause(item)) if item.level in {"contradiction", "note"} else item for item in found
    )


def changed(file: MotionFile, changes: Iterable[Change]) -> MotionFile:
    """Return a file with changes made to its arrays, one after the other."""
    for change in changes:
        file = _CHANGES[change.kind](file, change)
    return file


# Poses: of the root, of bodies and of objects, each as bodies in the file's own order of components.


def _all_with_poses(file: MotionFile) -> tuple[str, ...]:
    return (
        *([ROOT] if file.root is not None else []),
        *([BODIES] if file.bodies is not None else []),
        *(item.name for item in file.objects),
    )


def _poses(file: MotionFile, name: str) -> Bodies:
    item = next((item for item in file.objects if item.name == name), None)
    if item is None and name == ROOT and file.root is not None:
        velocities = () if file.root_vel is None else (file.root_vel[:, :3], file.root_vel[:, 3:])
        item = ObjectPoses(ROOT, file.root, *velocities)
    if item is not None:
        return item.as_body(file.convention)
    assert file.bodies is not None
    return file.bodies.only(_body_columns(file, name))


def _with_poses(file: MotionFile, name: str, poses: Bodies) -> MotionFile:
    pair = (poses.quat, poses.pos) if file.convention.root_order == "quat_pos" else (poses.pos, poses.quat)
    lin, ang = poses.lin_vel, poses.ang_vel
    if any(item.name == name for item in file.objects):
        velocities = (None if values is None else values[:, 0] for values in (lin, ang))
        made = ObjectPoses(name, np.concatenate(pair, axis=-1)[:, 0], *velocities)
        return replace(file, objects=tuple(made if item.name == name else item for item in file.objects))
    if name == ROOT and file.root is not None:
        velocity = file.root_vel if lin is None or ang is None else np.concatenate([lin, ang], axis=-1)[:, 0]
        return replace(file, root=np.concatenate(pair, axis=-1)[:, 0], root_vel=velocity)
    assert file.bodies is not None
    arrays = {field: np.array(array) for field, array in arrays_of(file.bodies).items()}
    columns = _body_columns(file, name)
    for field, array in arrays.items():
        array[:, columns] = getattr(poses, field)
    return replace(file, bodies=Bodies(**arrays))


def _body_columns(file: MotionFile, name: str) -> list[int]:
    """Return all bodies, the first one for a root without columns of its own, or the one of an object."""
    assert file.bodies is not None
    if name == BODIES:
        return list(range(file.bodies.pos.shape[1]))
    return [0 if name == ROOT or file.body_names is None else file.body_names.index(name)]


def _of_poses(make: Callable[[MotionFile, Bodies, Any], Bodies]) -> Callable[[MotionFile, Change], MotionFile]:
    """Return the change of the poses of one owner, or of all, by the change's values."""

    def with_changed_poses(file: MotionFile, change: Change) -> MotionFile:
        for name in (change.of,) if change.of else _all_with_poses(file):
            file = _with_poses(file, name, make(file, _poses(file, name), change.values))
        return file

    return with_changed_poses


def _of_quats(make: Callable[[np.ndarray, Any], np.ndarray]) -> Callable[[MotionFile, Change], MotionFile]:
    return _of_poses(lambda file, poses, values: replace(poses, quat=make(poses.quat, values)))


def _inverted(file: MotionFile, poses: Bodies, values: Values) -> Bodies:
    inverse = se3.quat_conjugate(_wxyz(file, poses.quat))
    return Bodies(-se3.rotate(inverse, poses.pos), _stored(file, inverse))


def _exchanged(file: MotionFile, poses: Bodies, values: Values) -> Bodies:
    """Return positions and rotations of those columns in which the format has the others."""
    flat = np.concatenate([poses.pos, poses.quat], axis=-1)
    if file.convention.root_order == "quat_pos":  # Columns are stored as (quat, pos): these are not.
        flat = np.concatenate([poses.quat, poses.pos], axis=-1)
        return replace(poses, pos=flat[..., :3], quat=flat[..., 3:])
    return replace(poses, pos=flat[..., 4:], quat=flat[..., :4])


def _scaled(file: MotionFile, poses: Bodies, values: Values) -> Bodies:
    arrays = {name: array * values[0] for name, array in arrays_of(poses).items() if name in {"pos", "lin_vel"}}
    return replace(poses, **arrays)


def _turned(file: MotionFile, poses: Bodies, values: Values) -> Bodies:
    turn = np.array(values)
    vectors = {name: se3.rotate(turn, array) for name, array in arrays_of(poses).items() if name != "quat"}
    return replace(poses, quat=_stored(file, se3.quat_multiply(turn, _wxyz(file, poses.quat))), **vectors)


def _with_velocities(file: MotionFile, poses: Bodies, values: Values) -> Bodies:
    """Return poses with the velocities of their paths, where the file stores any; of the file's rate."""
    fps = _rate(file)
    quat = _wxyz(file, poses.quat)
    before, after = np.concatenate([quat[:1], quat[:-1]]), np.concatenate([quat[1:], quat[-1:]])
    turn = se3.log(se3.quat_multiply(after, se3.quat_conjugate(before)))
    turn[1:-1] *= 0.5
    lin_vel = None if poses.lin_vel is None else fps * np.gradient(poses.pos, axis=0)
    return replace(poses, lin_vel=lin_vel, ang_vel=None if poses.ang_vel is None else fps * turn)


def _wxyz(file: MotionFile, quat: np.ndarray) -> np.ndarray:
    return quat if file.convention.quat_order == "wxyz" else se3.quat_from_xyzw(quat)


def _stored(file: MotionFile, quat: np.ndarray) -> np.ndarray:
    return quat if file.convention.quat_order == "wxyz" else se3.quat_to_xyzw(quat)


def _of_columns(make: Callable[[np.ndarray, Values], np.ndarray]) -> Callable[[MotionFile, Change], MotionFile]:
    """Return the change of the columns of joint angles and of their velocities, by the change's values."""

    def with_changed_columns(file: MotionFile, change: Change) -> MotionFile:
        joint_vel = None if file.joint_vel is None else make(file.joint_vel, change.values)
        return replace(file, joint_pos=make(file.joint_pos, change.values), joint_vel=joint_vel)

    return with_changed_columns


def _without_first_columns(file: MotionFile, change: Change) -> MotionFile:
    assert file.root is not None
    table = np.concatenate([file.root, file.joint_pos], axis=1)[:, int(change.values[0]) :]
    return replace(file, root=table[:, :7], joint_pos=table[:, 7:])


def _interpolated(file: MotionFile, change: Change) -> MotionFile:
    """Put poses and angles between their neighbours in some frames."""
    gone = np.zeros(file.frames, dtype=bool)
    gone[_whole(change.values)] = True
    there = np.flatnonzero(~gone)
    after = np.minimum(np.searchsorted(there, np.arange(file.frames)), len(there) - 1)
    before, after = there[np.maximum(after - 1, 0)], there[after]
    before = np.where(gone, before, np.arange(file.frames))
    fraction = np.where(gone, (np.arange(file.frames) - before) / np.maximum(after - before, 1), 0.0)

    def between(values: np.ndarray) -> np.ndarray:
        part = fraction.reshape(-1, *(1,) * (values.ndim - 1))
        return np.where(part > 0, (1 - part) * values[before] + part * values[after], values)

    for name in _all_with_poses(file):
        poses = _poses(file, name)
        quat = _wxyz(file, poses.quat)
        turned = se3.slerp(quat[before], quat[after], np.broadcast_to(fraction[:, None], quat.shape[:2]))
        quat = np.where(gone[:, None, None], turned, quat)
        poses = replace(poses, pos=between(poses.pos), quat=_stored(file, quat))
        file = _with_poses(file, name, poses)
    return replace(file, joint_pos=between(file.joint_pos))


def _with_frames(file: MotionFile, change: Change) -> MotionFile:
    first, stop = _whole(change.values)

    def part(owner: Any) -> Any:
        return replace(owner, **{name: array[first:stop] for name, array in arrays_of(owner).items()})

    return replace(
        part(replace(file, bodies=None, objects=(), contacts=None)),
        bodies=None if file.bodies is None else part(file.bodies),
        objects=tuple(part(item) for item in file.objects),
        contacts=None if file.contacts is None else part(file.contacts),
    )


_CHANGES: Mapping[str, Callable[[MotionFile, Change], MotionFile]] = {
    "take quaternion components": _of_quats(lambda quat, values: quat[..., _whole(values)]),
    "multiply quaternion components": _of_quats(lambda quat, values: quat * values),
    "normalize quaternions": _of_quats(lambda quat, values: se3.quat_normalize(quat)),
    "invert poses": _of_poses(_inverted),
    "exchange position and rotation": _of_poses(_exchanged),
    "multiply positions": _of_poses(_scaled),
    "move": _of_poses(lambda file, poses, values: replace(poses, pos=poses.pos + values)),
    "lower evenly": _of_poses(
        lambda file, poses, values: replace(poses, pos=poses.pos - np.linspace(*_rises(values), file.frames)[:, None])
    ),
    "turn": _of_poses(_turned),
    "compute velocities": _of_poses(_with_velocities),
    "take columns": _of_columns(lambda table, values: table[:, _whole(values)]),
    "multiply columns": _of_columns(lambda table, values: table * values),
    # Another zero of an angle leaves its velocity.
    "add to columns": lambda file, change: replace(file, joint_pos=file.joint_pos + change.values),
    "drop first columns": _without_first_columns,
    "take bodies": lambda file, change: replace(file, bodies=file.bodies and file.bodies.only(_whole(change.values))),
    "set rate": lambda file, change: replace(file, fps=change.values[0]),
    "interpolate frames": _interpolated,
    "keep frames": _with_frames,
    "compute joint velocities": lambda file, change: replace(
        file, joint_vel=_rate(file) * np.gradient(file.joint_pos, axis=0)
    ),
}


def _rises(values: Values) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and the last frame's vector from its height [m]."""
    first, last = (np.array([0.0, 0.0, value]) for value in values)
    return first, last


def _rate(file: MotionFile) -> float:
    return file.fps or file.convention.usual_fps or 1.0


def _whole(values: Values) -> list[int]:
    return [int(value) for value in values]
