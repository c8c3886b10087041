"""Looks at a robot-motion file from its numbers alone: what it is, and what contradicts what it claims."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.check.bodies import FoundBodies, read_bodies
from hoi_retarget.motion.check.change import changed
from hoi_retarget.motion.check.continuity import check_continuity
from hoi_retarget.motion.check.finding import Finding, contradictions, noted, with_causes
from hoi_retarget.motion.check.ground import check_floor, check_ranges
from hoi_retarget.motion.check.interpretation import Interpretation
from hoi_retarget.motion.check.layout import NO_ROTATION, UNIT_TOLERANCE, Layout, lay_out, off_unit
from hoi_retarget.motion.check.object_bodies import objects_among_bodies
from hoi_retarget.motion.check.objects import ObjectPath, check_object
from hoi_retarget.motion.check.search import Poses, find_reading, read_open, undecided
from hoi_retarget.motion.check.surroundings import Surroundings
from hoi_retarget.motion.check.velocities import check_velocities
from hoi_retarget.motion.formats import Bodies, MotionFile
from hoi_retarget.robots.model import RobotModel

_ASSUMED_FPS = 30.0  # Where nothing tells: only to compare speeds with one another.


@dataclass(frozen=True, eq=False)
class CheckedMotion:
    """A motion file as its numbers were found to be, and everything that was found."""

    path: str
    robot: str
    format: str
    frames: int
    stated_fps: float | None
    implied_fps: float | None
    """From the velocities; None where none are stored."""
    quat_order: Literal["wxyz", "xyzw"]
    """Of the file's quaternions as claimed; by the numbers where the format leaves it open."""
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


def check(file: MotionFile, model: RobotModel) -> CheckedMotion:
    """Return what a file is and what contradicts what it claims."""
    findings: list[Finding] = []
    layout = noted(lay_out(file, model), findings)
    columns = layout.columns or (-1,) * model.n
    claim = Interpretation(columns, (1.0,) * model.n, quat_order=file.convention.quat_order or "xyzw")
    found: FoundBodies | None = None
    if file.bodies is not None:
        found = noted(read_bodies(file, file.bodies, model, layout, claim), findings)
    pos, quat = (found.pos, found.quat) if found is not None else _root(file, layout)
    fps = file.fps or file.convention.usual_fps or _ASSUMED_FPS
    reading, qpos = found.reading if found is not None else claim, None
    if layout.columns is not None and pos is not None and quat is not None:
        poses = Poses(model, pos, quat, layout.joint_pos, fps)
        if found is None:
            claim = reading = noted(read_open(poses, reading, file.convention), findings)
        standing = noted(find_reading(poses, reading, known=found is not None), findings)
        if standing is not None:
            reading = standing
            findings += undecided(poses, reading) if found is None else ()
            qpos = reading.qpos(pos, quat, layout.joint_pos)
    implied = noted(check_velocities(file, reading, _moving(file, layout, found)), findings)
    objects: tuple[ObjectPath, ...] = ()
    if qpos is not None:
        around = Surroundings(model, qpos, reading, file.convention, implied or fps)
        of_objects: list[Finding] = []
        stored = replace(claim.of_poses, y_up=reading.y_up)
        items = [(item, stored) for item in file.objects]
        items = items or [(item, reading.of_poses) for item in objects_among_bodies(file, found)]
        paths = [noted(check_object(item, read_as, around), of_objects) for item, read_as in items]
        objects = tuple(path for path in paths if path is not None)
        findings += [*check_floor(around, objects), *check_ranges(around), *check_continuity(around), *of_objects]
    return CheckedMotion(
        path=file.path,
        robot=model.spec.name,
        format=file.format if found is None else found.format,
        frames=file.frames,
        stated_fps=file.fps,
        implied_fps=implied,
        quat_order=claim.quat_order,
        findings=with_causes(findings),
        qpos=qpos,
        objects=objects,
        missing_joints=tuple(name for name, column in zip(model.joint_names, columns, strict=True) if column < 0),
    )


def mended(file: MotionFile, checked: CheckedMotion) -> MotionFile:
    """Return a file with the advice followed that contradictions have for programs.

    What follows from another finding, or has no such advice, stays as it is: check the file again.
    """
    file = replace(file, convention=replace(file.convention, quat_order=checked.quat_order))
    causes = (item for item in checked.contradictions if not item.follows)
    return changed(file, (change for item in causes for change in item.mend))


def _root(file: MotionFile, layout: Layout) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return the root's pose where bodies do not tell: its own columns, or the first body."""
    if layout.pos is not None or file.bodies is None:
        return layout.pos, layout.quat
    if off_unit(file.bodies.quat[:, 0]) > NO_ROTATION:
        return None, None
    return file.bodies.pos[:, 0], file.bodies.quat[:, 0]


def _moving(file: MotionFile, layout: Layout, found: FoundBodies | None) -> list[tuple[str, Bodies]]:
    """Return the bodies, the root and the objects with stored velocities, by name."""
    moving = []
    if found is not None and file.bodies is not None:
        moving.append(("bodies", file.bodies.only(list(found.there.places.values()))))
    if file.root_vel is not None and layout.pos is not None and layout.quat is not None:
        pos, quat = (found.pos, found.quat) if found is not None else (layout.pos, layout.quat)
        velocity = file.root_vel[:, None]
        moving.append(("the root", Bodies(pos[:, None], quat[:, None], velocity[..., :3], velocity[..., 3:])))
    for item in file.objects:
        pos, quat = file.convention.split(item.pose[:, None])
        if off_unit(quat) < UNIT_TOLERANCE and (item.lin_vel is not None or item.ang_vel is not None):
            lin, ang = (None if values is None else values[:, None] for values in (item.lin_vel, item.ang_vel))
            moving.append((item.name, Bodies(pos, quat, lin, ang)))
    return moving
