"""Findings about a file's velocities: of joints, root, bodies and objects."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.check.body_poses import BodyReading
from hoi_retarget.motion.check.finding import Finding
from hoi_retarget.motion.check.interpretation import Interpretation
from hoi_retarget.motion.check.rates import (
    CORRELATED,
    UNLIKE,
    ImpliedRate,
    check_angular,
    check_linear,
    check_rate,
    differences,
    implied_rate,
    turns,
)
from hoi_retarget.motion.formats import MotionFile


@dataclass(frozen=True, eq=False)
class Moving:
    """Poses with stored velocities, all in the z-up world and metres."""

    name: str
    pos: Float[np.ndarray, "T B 3"]
    quat: Float[np.ndarray, "T B 4"]
    lin_vel: Float[np.ndarray, "T B 3"] | None
    ang_vel: Float[np.ndarray, "T B 3"] | None


def check_velocities(
    file: MotionFile, reading: Interpretation, moving: Sequence[Moving]
) -> tuple[float | None, list[Finding]]:
    """Return the rate that velocities imply, None without any, and what contradicts."""
    joint_rate, rates = _joint_rate(file, reading), []
    if joint_rate is not None and joint_rate.correlation > UNLIKE:
        rates.append(joint_rate)
    steps = {item.name: (differences(item.pos), turns(item.quat)) for item in moving}
    for item in moving:
        change, _ = steps[item.name]
        rate = None if item.lin_vel is None else implied_rate(f"linear velocities of {item.name}", change, item.lin_vel)
        if rate is not None and rate.correlation > CORRELATED:
            rates.append(rate)
    implied, findings = check_rate(file.fps, file.convention.usual_fps, rates)
    if joint_rate is not None and joint_rate.correlation < UNLIKE:
        claim, says = "in the order of the angles", f"correlation with their differences {joint_rate.correlation:.2f}"
        advice = "Compute them anew from the joint angles."
        findings.append(Finding("contradiction", "joint velocities", claim, says, advice, "velocities"))
    fps = implied or file.fps or file.convention.usual_fps
    if fps is None:
        return implied, findings
    for item in moving:
        change, turn = steps[item.name]
        middle = item.quat[1:-1]
        if item.ang_vel is not None:
            subject = f"angular velocities of {item.name}"
            findings += check_angular(subject, fps * turn, middle, item.ang_vel[1:-1])
        if item.lin_vel is not None:
            subject = f"linear velocities of {item.name}"
            findings += check_linear(subject, fps * change, fps * turn, middle, item.lin_vel[1:-1])
    return implied, findings


def _joint_rate(file: MotionFile, reading: Interpretation) -> ImpliedRate | None:
    if file.joint_vel is None:
        return None
    change = differences(reading.angles(file.joint_pos))
    return implied_rate("joint velocities", change, reading.angles(file.joint_vel))


def moving_bodies(file: MotionFile, reading: Interpretation, there: BodyReading) -> Moving | None:
    """Return the robot's bodies with their velocities, the root's first."""
    if file.bodies is None:
        return None
    columns = list(there.places.values())
    bodies = file.bodies
    return Moving(
        "bodies",
        reading.position(bodies.pos[:, columns]),
        reading.rotation(bodies.quat[:, columns]),
        None if bodies.lin_vel is None else reading.position(bodies.lin_vel[:, columns]),
        None if bodies.ang_vel is None else reading.vector(bodies.ang_vel[:, columns]),
    )


def moving_point(
    name: str,
    pos: Float[np.ndarray, "T 3"],
    quat: Float[np.ndarray, "T 4"],
    lin_vel: Float[np.ndarray, "T 3"] | None,
    ang_vel: Float[np.ndarray, "T 3"] | None,
) -> Moving:
    """Return one body, with its velocities where they are stored."""
    velocities = (None if values is None else values[:, None] for values in (lin_vel, ang_vel))
    return Moving(name, pos[:, None], quat[:, None], *velocities)
