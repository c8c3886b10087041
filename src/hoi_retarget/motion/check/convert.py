"""A file's motion as this package has motions, for one of our robots."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import ClipError
from hoi_retarget.motion.check.check import CheckedMotion, check
from hoi_retarget.motion.check.finding import Finding, contradictions
from hoi_retarget.motion.check.objects import ObjectPath
from hoi_retarget.motion.formats import MotionFile
from hoi_retarget.robots.model import RobotModel


@dataclass(frozen=True, eq=False)
class ConvertedMotion:
    """One robot's motion, converted; its objects' poses in the same world."""

    fps: float
    qpos: Float[np.ndarray, "T nq"]
    """Root position [m], root rotation wxyz, joints [rad] in the robot's order."""
    objects: tuple[ObjectPath, ...]
    missing_joints: tuple[str, ...]
    """Joints that the file does not have, at zero."""
    fps_assumed: bool
    """Whether the rate is the format's usual one, because the file states none."""
    findings: tuple[Finding, ...] = ()
    """What was looked at to read it."""

    @property
    def contradictions(self) -> tuple[Finding, ...]:
        """What contradicts the file's claims, without what follows from it."""
        return tuple(item for item in contradictions(self.findings) if not item.follows)


def as_qpos(file: MotionFile, model: RobotModel, *, fps: float | None = None) -> ConvertedMotion:
    """Return a file's motion in the robot's joint order, quaternions wxyz.

    Velocities that are wrong do not matter here: none are returned.

    Args:
        file: What was read.
        model: The robot it is of.
        fps: The rate, where the file states none [1/s]; by default its format's usual one.

    Raises:
        ClipError: The numbers contradict what the file claims about poses, objects or the rate.
    """
    checked = check(file, model)
    spoilt = [item for item in checked.contradictions if item.spoils in ("poses", "rate", "objects")]
    if spoilt:
        raise _contradicted(checked, spoilt)
    return _converted(file, checked, fps)


def as_found(file: MotionFile, model: RobotModel) -> ConvertedMotion:
    """Return a file's motion as its numbers say it is, whatever contradicts the file's claims.

    Raises:
        ClipError: The numbers do not tell what the poses are.
    """
    return _converted(file, check(file, model), None)


def _converted(file: MotionFile, checked: CheckedMotion, fps: float | None) -> ConvertedMotion:
    if checked.qpos is None:
        raise _contradicted(checked, checked.contradictions)
    rate = file.fps or fps or file.convention.usual_fps
    if rate is None:
        raise ClipError(f"{file.path}: it states no rate, and its format has no usual one. Give the rate.")
    assumed = file.fps is None and fps is None
    return ConvertedMotion(rate, checked.qpos, checked.objects, checked.missing_joints, assumed, checked.findings)


def _contradicted(checked: CheckedMotion, spoilt: Sequence[Finding]) -> ClipError:
    first = f"{spoilt[0].subject}: {spoilt[0].numbers}" if spoilt else "its poses cannot be read"
    more = f" (and {len(spoilt) - 1} more)" if len(spoilt) > 1 else ""
    return ClipError(
        f"{checked.path}: the numbers contradict what the file claims: {first}{more}. "
        f"See: hoi-retarget check-motion {checked.path} --robot {checked.robot}."
    )
