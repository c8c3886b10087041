"""The checks of a robot-motion file in their order, and its motion in this package's conventions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import ClipError
from hoi_retarget.human.skeleton import HANDS
from hoi_retarget.motion.check import object_checks
from hoi_retarget.motion.check.body_checks import FoundBodies, read_bodies
from hoi_retarget.motion.check.continuity import check_continuity
from hoi_retarget.motion.check.finding import FormatFinding, changed, collected, with_causes
from hoi_retarget.motion.check.interpretation import Interpretation
from hoi_retarget.motion.check.layout import NO_ROTATION, UNIT_TOLERANCE, Layout, lay_out, off_unit
from hoi_retarget.motion.check.plausibility import check_floor, check_ranges
from hoi_retarget.motion.check.rates import check_velocities
from hoi_retarget.motion.check.search import CandidatePoses, find_reading, read_open, undecided
from hoi_retarget.motion.formats import Bodies, MotionFile
from hoi_retarget.robots.model import RobotModel

_ASSUMED_FPS = 30.0  # Where nothing tells: only to compare speeds with one another.


@dataclass(frozen=True, eq=False)
class CheckedMotion:
    """A motion file as its numbers were found to be, in the robot's joint order, with all findings."""

    path: str
    robot: str
    format: str
    frames: int
    stated_fps: float | None
    usual_fps: float | None  # Of the format's files that state none [1/s].
    implied_fps: float | None  # From the velocities; None where none are stored.
    quat_order: Literal["wxyz", "xyzw"]
    """Of the file's quaternions as claimed; by the numbers where the format leaves it open."""
    findings: tuple[FormatFinding, ...]
    readable_qpos: Float[np.ndarray, "T nq"] | None  # As `qpos`; None where the numbers leave the poses open.
    objects: tuple[object_checks.ObjectPath, ...]
    missing_joints: tuple[str, ...]  # Joints of the robot that the file does not have; zero in `qpos`.

    @property
    def contradictions(self) -> tuple[FormatFinding, ...]:
        """All contradictions of the claim."""
        return tuple(finding for finding in self.findings if finding.level == "contradiction")

    @property
    def causes(self) -> tuple[FormatFinding, ...]:
        """The contradictions of the claim without their consequences."""
        return tuple(finding for finding in self.contradictions if not finding.follows)

    @property
    def fps(self) -> float:
        """Frames a second [Hz], as stated or as usual in the format; raises `ClipError` where there is neither."""
        rate = self.stated_fps or self.usual_fps
        if rate is None:
            raise ClipError(f"{self.path}: it states no rate, and its format has no usual one. Give the rate.")
        return rate

    @property
    def fps_assumed(self) -> bool:
        """Whether the rate is the format's usual one, because the file states none."""
        return self.stated_fps is None

    @property
    def qpos(self) -> Float[np.ndarray, "T nq"]:
        """Root position [m], root rotation wxyz, joints [rad]; raises `ClipError` where the poses are open."""
        if self.readable_qpos is None:
            raise _contradicted(self, self.contradictions)
        return self.readable_qpos


def check(file: MotionFile, model: RobotModel) -> CheckedMotion:
    """Return a file's motion as its numbers are, and all contradictions of its claims."""
    findings: list[FormatFinding] = []
    layout = collected(lay_out(file, model), findings)
    columns = layout.columns or (-1,) * model.n
    claim = Interpretation(columns, (1.0,) * model.n, quat_order=file.convention.quat_order or "xyzw")
    found: FoundBodies | None = None
    if file.bodies is not None:
        found = collected(read_bodies(file, file.bodies, model, layout, claim), findings)
    pos, quat = (found.pos, found.quat) if found is not None else _root(file, layout)
    fps = file.fps or file.convention.usual_fps or _ASSUMED_FPS
    reading, qpos = found.reading if found is not None else claim, None
    if layout.columns is not None and pos is not None and quat is not None:
        poses = CandidatePoses(model, pos, quat, layout.joint_pos, fps)
        if found is None:
            claim = reading = collected(read_open(poses, reading, file.convention), findings)
        standing = collected(find_reading(poses, reading, known=found is not None), findings)
        if standing is not None:
            reading = standing
            findings += undecided(poses, reading) if found is None else ()
            qpos = reading.qpos(pos, quat, layout.joint_pos)
    implied = collected(check_velocities(file, reading, _moving(file, layout, found)), findings)
    objects: tuple[object_checks.ObjectPath, ...] = ()
    if qpos is not None:
        context = object_checks.CheckContext(model, qpos, reading, file.convention, implied or fps, _hands_touch(file))
        of_objects: list[FormatFinding] = []
        stored = replace(claim.of_poses, y_up=reading.y_up)
        items = [(item, stored) for item in file.objects]
        items = items or [(item, reading.of_poses) for item in object_checks.objects_among_bodies(file, found)]
        paths = [collected(object_checks.check_object(item, read_as, context), of_objects) for item, read_as in items]
        objects = tuple(path for path in paths if path is not None)
        findings += [*check_floor(context, objects), *check_ranges(context)]
        findings += [*check_continuity(context, objects, _body_paths(file, layout, found)), *of_objects]
        findings += [
            *object_checks.check_contacts(file, objects, context),
            *object_checks.check_loose_links(file, found, objects),
        ]
    return CheckedMotion(
        path=file.path,
        robot=model.spec.name,
        format=file.format if found is None else found.format,
        frames=file.frames,
        stated_fps=file.fps,
        usual_fps=file.convention.usual_fps,
        implied_fps=implied,
        quat_order=claim.quat_order,
        findings=with_causes(findings),
        readable_qpos=qpos,
        objects=objects,
        missing_joints=tuple(name for name, column in zip(model.joint_names, columns, strict=True) if column < 0),
    )


def as_qpos(file: MotionFile, model: RobotModel, *, fps: float | None = None) -> CheckedMotion:
    """Return a file's motion; raises `ClipError` where its numbers contradict its poses, objects or rate.

    Wrong velocities do not matter. `fps` is the rate where the file states none [1/s], by default its format's usual.
    """
    checked = check(replace(file, fps=file.fps or fps), model)
    spoilt = [item for item in checked.contradictions if item.spoils in ("poses", "rate", "objects")]
    if spoilt or checked.readable_qpos is None:
        raise _contradicted(checked, spoilt or checked.contradictions)
    return checked


def repair(file: MotionFile, checked: CheckedMotion) -> MotionFile:
    """Return a file repaired by the fixes of its contradictions.

    Consequences of others, and contradictions without a fix, stay as they are: check the file again.
    """
    file = replace(file, convention=replace(file.convention, quat_order=checked.quat_order))
    return changed(file, (change for item in checked.causes for change in item.fix))


def _root(file: MotionFile, layout: Layout) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return the root's pose without a reading of bodies: its own columns, or the first body."""
    if layout.pos is not None or file.bodies is None:
        return layout.pos, layout.quat
    if off_unit(file.bodies.quat[:, 0]) > NO_ROTATION:
        return None, None
    return file.bodies.pos[:, 0], file.bodies.quat[:, 0]


def _body_paths(file: MotionFile, layout: Layout, found: FoundBodies | None) -> dict[str, Float[np.ndarray, "T 3"]]:
    """Return the positions of all bodies by name [m], of links and others, and the root's beside them."""
    if found is None or file.bodies is None:
        return {}
    paths = file.bodies.pos if layout.pos is None else np.concatenate([file.bodies.pos, layout.pos[:, None]], axis=1)
    names = (*(file.body_names or (f"body {index}" for index in range(file.bodies.pos.shape[1]))), "the root's columns")
    return dict(zip(names, np.moveaxis(found.reading.position(paths), 1, 0), strict=False))


def _hands_touch(file: MotionFile) -> bool:
    flags = file.contacts
    hands = [index for index, name in enumerate(flags.names if flags else ()) if name in HANDS]
    return flags is None or not hands or bool(flags.flags[:, hands].any())


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
        body = item.as_body(file.convention)
        if off_unit(body.quat) < UNIT_TOLERANCE and (body.lin_vel is not None or body.ang_vel is not None):
            moving.append((item.name, body))
    return moving


def _contradicted(checked: CheckedMotion, spoilt: Sequence[FormatFinding]) -> ClipError:
    first = f"{spoilt[0].subject}: {spoilt[0].numbers}" if spoilt else "its poses cannot be read"
    more = f" (and {len(spoilt) - 1} more)" if len(spoilt) > 1 else ""
    return ClipError(
        f"{checked.path}: the numbers contradict what the file claims: {first}{more}. "
        f"See: hoi-retarget check-motion {checked.path} --robot {checked.robot}."
    )
