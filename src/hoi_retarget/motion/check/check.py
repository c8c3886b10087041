"""Looks at a robot-motion file from its numbers alone: what it is, and what contradicts what it claims."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.check.bodies import FoundBodies, read_bodies
from hoi_retarget.motion.check.continuity import check_continuity
from hoi_retarget.motion.check.finding import Finding, contradictions
from hoi_retarget.motion.check.ground import check_floor, check_ranges
from hoi_retarget.motion.check.interpretation import Interpretation
from hoi_retarget.motion.check.layout import UNIT_TOLERANCE, Layout, lay_out, off_unit
from hoi_retarget.motion.check.objects import ObjectPath, Surroundings, check_object
from hoi_retarget.motion.check.search import Poses, find_reading, find_up_axis, undecided
from hoi_retarget.motion.check.velocities import Moving, check_velocities, moving_bodies, moving_point
from hoi_retarget.motion.formats import MotionFile, ObjectPoses
from hoi_retarget.robots.model import RobotModel

_ASSUMED_FPS = 30.0  # Where nothing tells: only to compare speeds with one another.


@dataclass(frozen=True, eq=False)
class Verdict:
    """What a file is, and everything that was found."""

    path: str
    robot: str
    format: str
    frames: int
    stated_fps: float | None
    implied_fps: float | None
    """From the velocities; None where none are stored."""
    findings: tuple[Finding, ...]
    qpos: Float[np.ndarray, "T nq"] | None
    """Read as the numbers say: root position [m], wxyz, joints [rad] in the robot's order; None where that is open."""
    objects: tuple[ObjectPath, ...]
    missing_joints: tuple[str, ...]
    """Joints of the robot that the file does not have; zero in `qpos`."""

    @property
    def contradictions(self) -> tuple[Finding, ...]:
        """What contradicts the claim."""
        return contradictions(self.findings)


def check(file: MotionFile, model: RobotModel) -> Verdict:
    """Return what a file is and what contradicts what it claims."""
    layout, findings = lay_out(file, model)
    claim = _claim(file, model, layout)
    found: FoundBodies | None = None
    if file.bodies is not None:
        found, more = read_bodies(file, file.bodies, model, layout, claim)
        findings += more
    pos, quat = (found.pos, found.quat) if found is not None else _root(file, layout)
    fps = file.fps or file.convention.usual_fps or _ASSUMED_FPS
    reading, qpos = found.reading if found is not None else claim, None
    if layout.columns is not None and pos is not None and quat is not None:
        poses = Poses(model, pos, quat, layout.joint_pos, fps)
        reading, more = (find_up_axis if found is not None else find_reading)(poses, reading)
        findings += more
        if found is None and not contradictions(findings):
            findings += undecided(poses, reading)
        qpos = reading.qpos(pos, quat, layout.joint_pos)
    implied, more = check_velocities(file, reading, _moving(file, layout, reading, found))
    findings += more
    paths: list[ObjectPath] = []
    if qpos is not None:
        findings += [*check_floor(model, qpos), *check_ranges(model, qpos)]
        findings += check_continuity(model, qpos, implied or fps)
        quat_first = file.convention.root_order == "quat_pos"
        paths, more = _objects(file, Surroundings(model, qpos, reading, quat_first, implied or fps), found)
        findings += more
    return Verdict(
        path=file.path,
        robot=model.spec.name,
        format=file.format if found is None else found.format,
        frames=file.frames,
        stated_fps=file.fps,
        implied_fps=implied,
        findings=tuple(findings),
        qpos=qpos,
        objects=tuple(paths),
        missing_joints=_missing(model, layout),
    )


def _claim(file: MotionFile, model: RobotModel, layout: Layout) -> Interpretation:
    columns = layout.columns or (-1,) * model.n
    return Interpretation(columns, (1.0,) * model.n, quat_order=file.convention.quat_order)


def _missing(model: RobotModel, layout: Layout) -> tuple[str, ...]:
    columns = layout.columns or (-1,) * model.n
    return tuple(name for name, column in zip(model.joint_names, columns, strict=True) if column < 0)


def _root(file: MotionFile, layout: Layout) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return the root's pose where bodies do not tell: its own columns, or the first body."""
    if layout.pos is not None or file.bodies is None:
        return layout.pos, layout.quat
    if off_unit(file.bodies.quat[:, 0]) > UNIT_TOLERANCE:
        return None, None
    return file.bodies.pos[:, 0], file.bodies.quat[:, 0]


def _moving(file: MotionFile, layout: Layout, reading: Interpretation, found: FoundBodies | None) -> Sequence[Moving]:
    moving = []
    if found is not None:
        bodies = moving_bodies(file, reading, found.there)
        moving += [bodies] if bodies is not None else []
    if file.root_vel is not None and layout.pos is not None and layout.quat is not None:
        pos, quat = (found.pos, found.quat) if found is not None else (layout.pos, layout.quat)
        lin, ang = reading.position(file.root_vel[:, :3]), reading.vector(file.root_vel[:, 3:])
        moving.append(moving_point("the root", reading.position(pos), reading.rotation(quat), lin, ang))
    for item in file.objects:
        quat_first = file.convention.root_order == "quat_pos"
        pos, quat = (item.pose[:, 4:], item.pose[:, :4]) if quat_first else (item.pose[:, :3], item.pose[:, 3:])
        if off_unit(quat) < UNIT_TOLERANCE and (item.lin_vel is not None or item.ang_vel is not None):
            lin = None if item.lin_vel is None else reading.position(item.lin_vel)
            ang = None if item.ang_vel is None else reading.vector(item.ang_vel)
            moving.append(moving_point(item.name, reading.position(pos), reading.rotation(quat), lin, ang))
    return moving


def _objects(
    file: MotionFile, around: Surroundings, found: FoundBodies | None
) -> tuple[list[ObjectPath], list[Finding]]:
    paths, findings = [], []
    for item in file.objects or _other_bodies(file, around.model, found):
        path, more = check_object(item, around)
        findings += more
        paths += [path] if path is not None else []
    return paths, findings


def _other_bodies(file: MotionFile, model: RobotModel, found: FoundBodies | None) -> list[ObjectPoses]:
    """Return the objects among the bodies: those whose names are no robot's link."""
    if file.bodies is None or file.body_names is None or found is None:
        return []
    items = []
    for index, name in enumerate(file.body_names):
        if name not in model.body_names and name != "world" and not name.endswith("_link"):
            pose = np.concatenate([file.bodies.pos[:, index], file.bodies.quat[:, index]], axis=1)
            items.append(ObjectPoses(name, pose))
    return items
