"""Findings about a file's velocities: of joints, root, bodies and objects."""

from collections.abc import Sequence

from hoi_retarget.motion.check.change import Change
from hoi_retarget.motion.check.finding import Check, Finding
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
from hoi_retarget.motion.formats import Bodies, MotionFile


def check_velocities(
    file: MotionFile, reading: Interpretation, stored: Sequence[tuple[str, Bodies]]
) -> Check[float | None]:
    """Return the rate that velocities imply, None without any.

    Args:
        file: What was read.
        reading: How its numbers are to be read.
        stored: Poses and velocities as in the file, by name.
    """
    moving = [(name, _in_world(bodies, reading)) for name, bodies in stored]
    joint_rate = _joint_rate(file, reading)
    rates = [joint_rate] if joint_rate is not None and joint_rate.correlation > UNLIKE else []
    for name, item in moving:
        if item.lin_vel is not None:
            rate = implied_rate(f"linear velocities of {name}", differences(item.pos), item.lin_vel)
            rates += [rate] if rate is not None and rate.correlation > CORRELATED else []
    implied = yield from check_rate(file.fps, file.convention.usual_fps, rates)
    if joint_rate is not None and joint_rate.correlation < UNLIKE:
        claim, says = "in the order of the angles", f"correlation with their differences {joint_rate.correlation:.2f}"
        advice = "Compute them anew from the joint angles."
        mend = (Change("compute joint velocities"),)
        yield Finding("contradiction", "joint velocities", claim, says, advice, "velocities", mend)
    fps = implied or file.fps or file.convention.usual_fps
    if fps is None:
        return implied
    for name, item in moving:
        turn, middle = fps * turns(item.quat), item.quat[1:-1]
        if item.ang_vel is not None:
            yield check_angular(f"angular velocities of {name}", turn, middle, item.ang_vel[1:-1])
        if item.lin_vel is not None:
            subject = f"linear velocities of {name}"
            yield check_linear(subject, fps * differences(item.pos), turn, middle, item.lin_vel[1:-1])
    return implied


def _joint_rate(file: MotionFile, reading: Interpretation) -> ImpliedRate | None:
    if file.joint_vel is None:
        return None
    change = differences(reading.angles(file.joint_pos))
    return implied_rate("joint velocities", change, reading.angles(file.joint_vel))


def _in_world(bodies: Bodies, reading: Interpretation) -> Bodies:
    """Return bodies in the z-up world and metres."""
    return Bodies(
        reading.position(bodies.pos),
        reading.rotation(bodies.quat),
        None if bodies.lin_vel is None else reading.position(bodies.lin_vel),
        None if bodies.ang_vel is None else reading.vector(bodies.ang_vel),
    )
