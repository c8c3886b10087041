"""Findings about velocities of joints, root, bodies and objects: the rate that they imply, and their frame."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.check.finding import Change, Check, FormatFinding, contradiction
from hoi_retarget.motion.check.interpretation import Interpretation
from hoi_retarget.motion.formats import Bodies, MotionFile
from hoi_retarget.motion.formats.motion_file import arrays_of
from hoi_retarget.numerics import se3

_RATE_TOLERANCE = 0.05
_MIN_RATE_CORRELATION, _MIN_CORRELATION = 0.99, 0.6
"""Of velocities with the poses, to imply a rate; lower ones contradict the poses."""
_WRONG, _EXPLAINED, _PART = 0.6, 0.25, 0.5
"""Errors as parts of the speed: stored velocities are wrong above, right below; an explanation takes half away."""
_MIN_SPEED = 0.02  # [rad/s or m/s]
_MAX_LEVER_M = 0.4  # Of a centre of mass from its body's origin.


@dataclass(frozen=True)
class ImpliedRate:
    """The frames a second at which differences of poses become the stored velocities."""

    of: str
    fps: float
    correlation: float


def differences(values: Float[np.ndarray, "T *k"]) -> Float[np.ndarray, "steps *k"]:
    """Return the change per frame, in the values' unit, in the middle frames, from the two neighbours."""
    return 0.5 * (values[2:] - values[:-2])


def turns(quat: Float[np.ndarray, "T *k 4"]) -> Float[np.ndarray, "steps *k 3"]:
    """Return the world rotation vector per frame [rad] in the middle frames."""
    return 0.5 * se3.log(se3.quat_multiply(quat[2:], se3.quat_conjugate(quat[:-2])))


def implied_rate(of: str, change: np.ndarray, stored: np.ndarray) -> ImpliedRate | None:
    """Return the rate that stored velocities imply, None where nothing moves."""
    velocity = stored[1:-1]
    size = float(np.sum(change * change)), float(np.sum(velocity * velocity))
    if min(size) < 1e-12 * change.size:
        return None
    product = float(np.sum(change * velocity))
    correlation = product / float(np.sqrt(size[0] * size[1]))
    return ImpliedRate(of, product / size[0], correlation)


def _check_rate(stated: float | None, usual: float | None, implied: Iterable[ImpliedRate]) -> Check[float | None]:
    """Return the rate [Hz] that the numbers imply, None where they do not."""
    found = list(implied)
    claim = f"{stated:g} frames/s" if stated else f"no rate (usual: {usual:g})" if usual else "no rate"
    if not found:
        numbers = "no velocities that follow the poses are stored"
        yield FormatFinding("unknown", "rate", claim, f"{numbers}: cannot be told")
        return None
    rates = [rate.fps for rate in found]
    numbers = "; ".join(f"{rate.of} imply {rate.fps:.4g} (correlation {rate.correlation:.3f})" for rate in found)
    middle = float(np.median(rates))
    if max(rates) > (1 + 2 * _RATE_TOLERANCE) * min(rates):
        advice = "Compute all velocities from the poses, at the file's rate."
        fix = (Change("compute velocities"), Change("compute joint velocities"))
        yield contradiction("rate", claim, f"the velocities differ: {numbers}", advice, fix=fix, spoils="velocities")
        return None
    if stated is None or abs(middle / stated - 1) <= _RATE_TOLERANCE:
        yield FormatFinding("ok", "rate", claim, numbers)
        return middle
    advice = f"Either the rate is {middle:.3g}, or the velocities were computed for another one: write both anew."
    yield contradiction(
        "rate", claim, numbers, advice, fix=(Change("set rate", "", (round(middle, 2),)),), spoils="rate"
    )
    return middle


def _check_angular(of: str, turn: np.ndarray, quat: np.ndarray, stored: np.ndarray) -> FormatFinding:
    """Compare stored angular velocities with the turns of the poses, both (steps, bodies, 3) in rad/s.

    The first body is the root; `quat` are the rotations in the middle of each step.
    """
    base, speed = _size(turn - stored), _size(turn)
    claim = "world axes"
    if speed < _MIN_SPEED and _size(stored) < _MIN_SPEED:
        return FormatFinding("unknown", of, claim, f"nothing turns (median {speed:.2g} rad/s): cannot be told")
    numbers = f"error {base:.2f} rad/s of {speed:.2f}"
    readings = {
        "in the body's own axes": se3.rotate_inverse(quat, turn),
        "rotated once too often into the world": se3.rotate(quat, turn),
        "negated": -turn,
    }
    errors = {way: _size(value - stored) for way, value in readings.items()}
    root = {way: _size((value - stored)[:, :1]) for way, value in readings.items()}
    if base < _WRONG * speed:
        way = min(errors, key=errors.__getitem__)
        if errors[way] < _PART * base and errors[way] < _EXPLAINED * speed:
            return _wrong(of, claim, f"{way}: {errors[way]:.2f} rad/s, as claimed {numbers}")
        if errors["in the body's own axes"] < base + 0.1 * speed:
            numbers += "; as near in the body's own axes, so that the frame cannot be told"
            return FormatFinding("unknown", of, claim, numbers)
        return FormatFinding("ok", of, claim, f"{numbers}; {errors[way]:.2f} if {way}")
    times = float(np.sum(turn[:, :1] * stored[:, :1]) / max(float(np.sum(turn[:, :1] ** 2)), 1e-12))
    root[f"{times:.3g} times as fast as its poses"] = _size((times * turn - stored)[:, :1])
    for found, whose in ((errors, ""), (root, "of the root ")):
        way = min(found, key=found.__getitem__)
        limit = speed if not whose else _size(turn[:, :1])
        if found[way] < _EXPLAINED * limit:
            tail = ", and the others follow from it" if whose else ""
            return _wrong(of, claim, f"{whose}{way}{tail}: {found[way]:.2g} rad/s left; as claimed {numbers}")
    return _wrong(of, claim, numbers)


def _check_linear(of: str, change: np.ndarray, turn: np.ndarray, quat: np.ndarray, stored: np.ndarray) -> FormatFinding:
    """Compare stored linear velocities with the change of the poses, both in m/s; those of centres of mass are right.

    `turn` are the poses' angular velocities [rad/s], `quat` the rotations in the middle of each step.
    """
    speed = _size(change)
    if speed < _MIN_SPEED and _size(stored) < _MIN_SPEED:
        return FormatFinding("unknown", of, "world axes", f"nothing moves (median {speed:.2g} m/s): cannot be told")
    at_origin = _size(change - stored)
    at_centre = _size(_at_centre(change, turn, quat, stored) - stored)
    base = min(at_origin, at_centre)
    numbers = f"error {base:.2f} m/s of {speed:.2f}"
    readings = {
        "in the body's own axes": se3.rotate_inverse(quat, change),
        "in the root's axes": se3.rotate_inverse(quat[:, :1], change),
        "negated": -change,
    }
    errors = {way: _size(value - stored) for way, value in readings.items()}
    way = min(errors, key=errors.__getitem__)
    if errors[way] < _PART * base and errors[way] < _WRONG * speed:
        return _wrong(of, "world axes", f"{way}: {errors[way]:.2f} m/s, as claimed {numbers}")
    if base > _WRONG * speed:
        return _wrong(of, "world axes", numbers)
    if at_centre < _PART * at_origin and at_origin > 0.05 * speed:
        beside = "those of points beside the bodies' origins, such as centres of mass"
        numbers = f"{beside}: {numbers}, {at_origin:.2f} at origins"
        advice = "Fine where centres of mass are meant."
        return FormatFinding("note", of, "velocities of the bodies' origins", numbers, advice)
    return FormatFinding("ok", of, "world axes", f"{numbers}; {errors[way]:.2f} if {way}")


def _wrong(of: str, claim: str, numbers: str) -> FormatFinding:
    advice, fix = "Compute them anew from the poses, in world axes.", (Change("compute velocities"),)
    return contradiction(of, claim, numbers, advice, fix=fix, spoils="velocities")


def _size(vectors: np.ndarray) -> float:
    """Return the median length over frames, averaged over bodies."""
    return float(np.median(np.linalg.norm(vectors, axis=-1), axis=0).mean())


def _at_centre(change: np.ndarray, turn: np.ndarray, quat: np.ndarray, stored: np.ndarray) -> np.ndarray:
    """Return the velocities of points fixed to the bodies that fit the stored ones best."""
    found = change.copy()
    for body in range(change.shape[1]):
        rotation = se3.quat_to_matrix(quat[:, body])
        # omega x (R r) is linear in r.
        lever = se3.skew(turn[:, body]) @ rotation
        offset, *_ = np.linalg.lstsq(lever.reshape(-1, 3), (stored[:, body] - change[:, body]).reshape(-1), rcond=1e-6)
        if np.linalg.norm(offset) < _MAX_LEVER_M:
            found[:, body] += lever @ offset
    return found


def check_velocities(
    file: MotionFile, reading: Interpretation, stored: Sequence[tuple[str, Bodies]]
) -> Check[float | None]:
    """Return the rate [Hz] that velocities imply, None without any; poses and velocities are as stored, by name."""
    moving = [(name, _in_world(bodies, reading)) for name, bodies in stored]
    joint_rate = None
    if file.joint_vel is not None:
        angles, stored_rates = (reading.angles(columns) for columns in (file.joint_pos, file.joint_vel))
        joint_rate = implied_rate("joint velocities", differences(angles), stored_rates)
    rates = [joint_rate] if joint_rate is not None and joint_rate.correlation > _MIN_CORRELATION else []
    for name, item in moving:
        if item.lin_vel is not None:
            rate = implied_rate(f"linear velocities of {name}", differences(item.pos), item.lin_vel)
            rates += [rate] if rate is not None and rate.correlation > _MIN_RATE_CORRELATION else []
    implied = yield from _check_rate(file.fps, file.convention.usual_fps, rates)
    if joint_rate is not None and joint_rate.correlation < _MIN_CORRELATION:
        numbers = f"correlation with their differences {joint_rate.correlation:.2f}"
        advice, fix = "Compute them anew from the joint angles.", (Change("compute joint velocities"),)
        claim = "in the order of the angles"
        yield contradiction("joint velocities", claim, numbers, advice, fix=fix, spoils="velocities")
    fps = implied or file.fps or file.convention.usual_fps
    if fps is None:
        return implied
    for name, item in moving:
        turn, middle = fps * turns(item.quat), item.quat[1:-1]
        if item.ang_vel is not None:
            yield _check_angular(f"angular velocities of {name}", turn, middle, item.ang_vel[1:-1])
        if item.lin_vel is not None:
            subject = f"linear velocities of {name}"
            yield _check_linear(subject, fps * differences(item.pos), turn, middle, item.lin_vel[1:-1])
    return implied


def _in_world(bodies: Bodies, reading: Interpretation) -> Bodies:
    """Return bodies in the z-up world and metres."""
    read = {"quat": reading.rotation, "ang_vel": reading.vector}
    return Bodies(**{name: read.get(name, reading.position)(array) for name, array in arrays_of(bodies).items()})
