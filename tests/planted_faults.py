"""Faults that people's files have, planted into the arrays of any motion file."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hoi_retarget.motion.formats import Bodies, MotionFile
from hoi_retarget.motion.links import breadth_first
from hoi_retarget.numerics import se3
from hoi_retarget.robots.model import RobotModel

Poses = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Fault:
    """A fault: how it is planted, and how a finding names it."""

    plant: Callable[[MotionFile, RobotModel], MotionFile | None]
    """Returns None for a file that cannot have it."""
    subjects: tuple[str, ...]
    words: str = ""
    hidden: tuple[str, ...] = ()
    """Words of an `unknown` finding that is as good an answer: the motion does not tell."""


def with_root(file: MotionFile, make: Poses) -> MotionFile | None:
    if file.root is None:
        return None
    return replace(file, root=_joined(file, *make(*file.convention.split(file.root))))


def with_bodies(file: MotionFile, make: Poses, columns: list[int] | None = None) -> MotionFile | None:
    if file.bodies is None:
        return None
    chosen = slice(None) if columns is None else columns
    pos, quat = file.bodies.pos.copy(), file.bodies.quat.copy()
    pos[:, chosen], quat[:, chosen] = make(pos[:, chosen], quat[:, chosen])
    return replace(file, bodies=replace(file.bodies, pos=pos, quat=quat))


def with_object(file: MotionFile, make: Poses) -> MotionFile | None:
    if file.objects:
        pose = _joined(file, *make(*file.convention.split(file.objects[0].pose)))
        return replace(file, objects=(replace(file.objects[0], pose=pose), *file.objects[1:]))
    if file.body_names is None or file.body_names[-1].endswith(("_link", "_hand")):
        return None
    return with_bodies(file, make, [len(file.body_names) - 1])


def _joined(file: MotionFile, pos: np.ndarray, quat: np.ndarray) -> np.ndarray:
    return np.concatenate([quat, pos] if file.convention.root_order == "quat_pos" else [pos, quat], axis=-1)


def in_other_order(file: MotionFile) -> Poses:
    """Return poses with their quaternions in the order that the format does not have."""
    swap = se3.quat_to_xyzw if file.convention.quat_order == "wxyz" else se3.quat_from_xyzw
    return lambda pos, quat: (pos, swap(quat))


def with_joints(file: MotionFile, make: Callable[[np.ndarray], np.ndarray]) -> MotionFile:
    return replace(
        file, joint_pos=make(file.joint_pos), joint_vel=None if file.joint_vel is None else make(file.joint_vel)
    )


def names(file: MotionFile, model: RobotModel) -> tuple[str, ...] | None:
    """Return the names of a file's columns, None where it does not have all joints."""
    if file.joint_names is not None:
        return file.joint_names
    if file.joint_pos.shape[1] != model.n:
        return None
    if file.convention.order == "breadth_first":
        return tuple(model.joint_names[joint] for joint in breadth_first(model)[1])
    return model.joint_names


def exchanged(*parts: str) -> Callable[[MotionFile, RobotModel], MotionFile | None]:
    def plant(file: MotionFile, model: RobotModel) -> MotionFile | None:
        columns = names(file, model)
        if columns is None:
            return None
        other = {"left": "right", "right": "left"}
        place = [
            columns.index("_".join([other.get(name.split("_")[0], name.split("_")[0]), *name.split("_")[1:]]))
            if any(part in name for part in parts)
            else index
            for index, name in enumerate(columns)
        ]
        return with_joints(file, lambda table: table[:, place])

    return plant


def isaac_order(file: MotionFile, model: RobotModel) -> MotionFile | None:
    if file.joint_pos.shape[1] != model.n or file.convention.order is None:
        return None
    return with_joints(file, lambda table: table[:, breadth_first(model)[1]])


def shuffled(file: MotionFile, model: RobotModel) -> MotionFile:
    order = np.random.default_rng(3).permutation(file.joint_pos.shape[1])
    return with_joints(file, lambda table: table[:, order])


def offset(part: str) -> Callable[[MotionFile, RobotModel], MotionFile | None]:
    def plant(file: MotionFile, model: RobotModel) -> MotionFile | None:
        columns = names(file, model)
        if columns is None or file.bodies is None:  # Nothing else tells where a joint's angle is zero.
            return None
        moved = 0.6 * np.array([part in name for name in columns])
        return replace(file, joint_pos=file.joint_pos + moved)

    return plant


def in_centimetres(file: MotionFile, model: RobotModel) -> MotionFile | None:
    file = with_root(file, lambda pos, quat: (100 * pos, quat)) or file
    if file.root_vel is not None:
        file = replace(file, root_vel=file.root_vel * [100, 100, 100, 1, 1, 1])
    if file.bodies is None:
        return file
    lin_vel = None if file.bodies.lin_vel is None else 100 * file.bodies.lin_vel
    return replace(file, bodies=replace(file.bodies, pos=100 * file.bodies.pos, lin_vel=lin_vel))


def _everywhere(file: MotionFile, make: Poses, turn: Callable[[np.ndarray], np.ndarray]) -> MotionFile:
    file = with_root(file, make) or file
    if file.root_vel is not None:
        file = replace(file, root_vel=np.concatenate([turn(file.root_vel[:, :3]), turn(file.root_vel[:, 3:])], axis=1))
    if file.bodies is not None:
        velocities = (None if vel is None else turn(vel) for vel in (file.bodies.lin_vel, file.bodies.ang_vel))
        file = replace(file, bodies=Bodies(*make(file.bodies.pos, file.bodies.quat), *velocities))
    return replace(
        file,
        objects=tuple(
            replace(
                item,
                pose=_joined(file, *make(*file.convention.split(item.pose))),
                lin_vel=None if item.lin_vel is None else turn(item.lin_vel),
                ang_vel=None if item.ang_vel is None else turn(item.ang_vel),
            )
            for item in file.objects
        ),
    )


def y_up(file: MotionFile, model: RobotModel) -> MotionFile:
    turn = se3.exp(np.array([-0.5 * np.pi, 0.0, 0.0]))

    def make(pos: np.ndarray, quat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if file.convention.quat_order == "wxyz":
            return se3.rotate(turn, pos), se3.quat_multiply(turn, quat)
        return se3.rotate(turn, pos), se3.quat_to_xyzw(se3.quat_multiply(turn, se3.quat_from_xyzw(quat)))

    return _everywhere(file, make, lambda vector: se3.rotate(turn, vector))


def lifted(height: Callable[[int], np.ndarray | float]) -> Callable[[MotionFile, RobotModel], MotionFile]:
    """Return the fault of a world that is higher by so many metres, of the number of frames."""

    def plant(file: MotionFile, model: RobotModel) -> MotionFile:
        up = np.broadcast_to(height(file.frames), file.frames)[:, None] * [0.0, 0.0, 1.0]
        return _everywhere(
            file, lambda pos, quat: (pos + (up if pos.ndim == 2 else up[:, None]), quat), lambda vector: vector
        )

    return plant


def in_one_frame(frames: int) -> np.ndarray:
    return np.arange(frames) == frames // 2


def knee_off(file: MotionFile, model: RobotModel) -> MotionFile | None:
    columns = names(file, model)
    if columns is None:
        return None
    moved = in_one_frame(file.frames)[:, None] * (np.array(columns) == "left_knee_joint")
    return replace(file, joint_pos=file.joint_pos + 0.3 * moved)


def object_off(file: MotionFile, model: RobotModel) -> MotionFile | None:
    def make(pos: np.ndarray, quat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return pos + 0.1 * in_one_frame(len(pos)).reshape(-1, *(1,) * (pos.ndim - 1)), quat

    return with_object(file, make)


def elsewhere_flagged(file: MotionFile, model: RobotModel) -> MotionFile | None:
    return file.contacts and replace(file, contacts=replace(file.contacts, flags=~file.contacts.flags))


def doubled(file: MotionFile, model: RobotModel) -> MotionFile:
    kept = np.arange(file.frames) // 2 * 2
    return replace(
        file,
        joint_pos=file.joint_pos[kept],
        root=None if file.root is None else file.root[kept],
        bodies=None
        if file.bodies is None
        else replace(file.bodies, pos=file.bodies.pos[kept], quat=file.bodies.quat[kept]),
        objects=tuple(replace(item, pose=item.pose[kept]) for item in file.objects),
    )


def at_another_rate(file: MotionFile, model: RobotModel) -> MotionFile | None:
    if file.joint_vel is None or file.fps is None:
        return None
    return replace(file, fps=0.6 * file.fps)


LEGS, ARMS = ("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist")
FAULTS = {
    "root quaternions": Fault(lambda file, _: with_root(file, in_other_order(file)), ("quaternion order",)),
    "bodies' quaternions": Fault(lambda file, _: with_bodies(file, in_other_order(file)), ("quaternion order",)),
    "object quaternions": Fault(
        lambda file, _: with_object(file, in_other_order(file)), ("object",), "quaternions", ("cannot be told",)
    ),
    "Isaac's order": Fault(isaac_order, ("joint order", "joint and body order"), "order"),
    "shuffled": Fault(shuffled, ("joint order",), "order"),
    "legs exchanged": Fault(exchanged(*LEGS), ("left and right", "joint order"), "", ("legs exchanged",)),
    "arms exchanged": Fault(exchanged(*ARMS), ("left and right", "joint order"), "", ("arms exchanged",)),
    "sides exchanged": Fault(exchanged(*LEGS, *ARMS), ("left and right", "joint order"), "", ("exchanged",)),
    "degrees": Fault(lambda file, _: with_joints(file, np.degrees), ("angle unit",), "degrees"),
    "knees measured from elsewhere": Fault(offset("knee"), ("joint zero",)),
    "raised": Fault(lifted(lambda frames: 0.4), ("floor",)),
    "raised by 5 cm": Fault(lifted(lambda frames: 0.05), ("floor",), "", ("whose shapes are not in the file",)),
    "sunk by 5 cm": Fault(lifted(lambda frames: -0.05), ("floor",)),
    "drifting floor": Fault(lifted(lambda frames: np.linspace(-0.03, 0.07, frames)), ("floor",), "over the clip"),
    "robot off for a frame": Fault(lifted(lambda frames: 0.1 * in_one_frame(frames)), ("jump",), "1 frame"),
    "knee off for a frame": Fault(knee_off, ("jump",), "left_knee_joint"),
    "object off for a frame": Fault(object_off, ("jump",), "1 frame"),
    "contacts flagged elsewhere": Fault(elsewhere_flagged, ("contacts",), "an object moving near a palm"),
    "y up": Fault(y_up, ("up axis",)),
    "centimetres": Fault(in_centimetres, ("length unit",)),
    "doubled frames": Fault(doubled, ("repeated frames",)),
    "another rate": Fault(at_another_rate, ("rate",), "imply"),
}
