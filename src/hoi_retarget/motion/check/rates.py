"""How stored velocities fit the differences of stored poses: the rate that they imply, and their frame."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.check.change import Change
from hoi_retarget.motion.check.finding import Check, Finding
from hoi_retarget.numerics import se3

_RATE_TOLERANCE = 0.05
CORRELATED, UNLIKE = 0.99, 0.6
"""Velocities that follow the poses well enough to tell the rate; that do not follow them at all."""
_WRONG, _EXPLAINED, _PART = 0.6, 0.25, 0.5
"""Errors as parts of the speed: stored velocities are wrong above, right below; an explanation takes half away."""
_STILL = 0.02
"""Speeds below tell nothing [rad/s or m/s]."""
_MAXIMUM_LEVER = 0.4
"""Of a centre of mass from its body's origin [m]."""


@dataclass(frozen=True)
class ImpliedRate:
    """The frames a second at which differences of poses become the stored velocities."""

    of: str
    fps: float
    correlation: float


def differences(values: Float[np.ndarray, "T *k"]) -> Float[np.ndarray, "steps *k"]:
    """Return the change per frame in the middle frames, from the two neighbours."""
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


def check_rate(stated: float | None, usual: float | None, implied: Iterable[ImpliedRate]) -> Check[float | None]:
    """Return the rate that the numbers imply, None where they do not."""
    found = list(implied)
    claim = f"{stated:g} frames/s" if stated else f"no rate (usual: {usual:g})" if usual else "no rate"
    if not found:
        says = "no velocities that follow the poses are stored"
        yield Finding("unknown", "rate", claim, f"{says}: cannot be told")
        return None
    rates = [rate.fps for rate in found]
    says = "; ".join(f"{rate.of} imply {rate.fps:.4g} (correlation {rate.correlation:.3f})" for rate in found)
    middle = float(np.median(rates))
    if max(rates) > (1 + 2 * _RATE_TOLERANCE) * min(rates):
        advice = "Compute all velocities from the poses, at the file's rate."
        mend = (Change("compute velocities"), Change("compute joint velocities"))
        yield Finding("contradiction", "rate", claim, f"the velocities differ: {says}", advice, "velocities", mend)
        return None
    if stated is None or abs(middle / stated - 1) <= _RATE_TOLERANCE:
        yield Finding("ok", "rate", claim, says)
        return middle
    advice = f"Either the rate is {middle:.3g}, or the velocities were computed for another one: write both anew."
    yield Finding("contradiction", "rate", claim, says, advice, "rate", (Change("set rate", "", (round(middle, 2),)),))
    return middle


def check_angular(
    of: str,
    turn: Float[np.ndarray, "steps B 3"],
    quat: Float[np.ndarray, "steps B 4"],
    stored: Float[np.ndarray, "steps B 3"],
) -> Finding:
    """Compare stored angular velocities with the turns of the poses, both in rad/s; the first body is the root."""
    base, speed = _size(turn - stored), _size(turn)
    claim = "world axes"
    if speed < _STILL and _size(stored) < _STILL:
        return Finding("unknown", of, claim, f"nothing turns (median {speed:.2g} rad/s): cannot be told")
    says = f"error {base:.2f} rad/s of {speed:.2f}"
    ways = {
        "in the body's own axes": se3.rotate_inverse(quat, turn),
        "rotated once too often into the world": se3.rotate(quat, turn),
        "negated": -turn,
    }
    errors = {way: _size(value - stored) for way, value in ways.items()}
    root = {way: _size((value - stored)[:, :1]) for way, value in ways.items()}
    if base < _WRONG * speed:
        way = min(errors, key=errors.__getitem__)
        if errors[way] < _PART * base and errors[way] < _EXPLAINED * speed:
            return _wrong(of, claim, f"{way}: {errors[way]:.2f} rad/s, as claimed {says}")
        if errors["in the body's own axes"] < base + 0.1 * speed:
            says += "; as near in the body's own axes, so that the frame cannot be told"
            return Finding("unknown", of, claim, says)
        return Finding("ok", of, claim, f"{says}; {errors[way]:.2f} if {way}")
    times = _times(turn[:, :1], stored[:, :1])
    root[f"{times:.3g} times as fast as its poses"] = _size((times * turn - stored)[:, :1])
    for found, whose in ((errors, ""), (root, "of the root ")):
        way = min(found, key=found.__getitem__)
        limit = speed if not whose else _size(turn[:, :1])
        if found[way] < _EXPLAINED * limit:
            tail = ", and the others follow from it" if whose else ""
            return _wrong(of, claim, f"{whose}{way}{tail}: {found[way]:.2g} rad/s left; as claimed {says}")
    return _wrong(of, claim, says)


def check_linear(
    of: str,
    change: Float[np.ndarray, "steps B 3"],
    turn: Float[np.ndarray, "steps B 3"],
    quat: Float[np.ndarray, "steps B 4"],
    stored: Float[np.ndarray, "steps B 3"],
) -> Finding:
    """Compare stored linear velocities with the paths, in m/s; those of centres of mass count as right."""
    speed = _size(change)
    if speed < _STILL and _size(stored) < _STILL:
        return Finding("unknown", of, "world axes", f"nothing moves (median {speed:.2g} m/s): cannot be told")
    at_origin = _size(change - stored)
    at_centre = _size(_at_centre(change, turn, quat, stored) - stored)
    base = min(at_origin, at_centre)
    says = f"error {base:.2f} m/s of {speed:.2f}"
    ways = {
        "in the body's own axes": se3.rotate_inverse(quat, change),
        "in the root's axes": se3.rotate_inverse(quat[:, :1], change),
        "negated": -change,
    }
    errors = {way: _size(value - stored) for way, value in ways.items()}
    way = min(errors, key=errors.__getitem__)
    if errors[way] < _PART * base and errors[way] < _WRONG * speed:
        return _wrong(of, "world axes", f"{way}: {errors[way]:.2f} m/s, as claimed {says}")
    if base > _WRONG * speed:
        return _wrong(of, "world axes", says)
    if at_centre < _PART * at_origin and at_origin > 0.05 * speed:
        says = (
            f"those of points beside the bodies' origins, such as centres of mass: {says}, {at_origin:.2f} at origins"
        )
        return Finding("note", of, "velocities of the bodies' origins", says, "Fine where centres of mass are meant.")
    return Finding("ok", of, "world axes", f"{says}; {errors[way]:.2f} if {way}")


def _wrong(of: str, claim: str, says: str) -> Finding:
    advice, mend = "Compute them anew from the poses, in world axes.", (Change("compute velocities"),)
    return Finding("contradiction", of, claim, says, advice, "velocities", mend)


def _times(change: np.ndarray, stored: np.ndarray) -> float:
    """Return how many times as fast stored velocities are."""
    return float(np.sum(change * stored) / max(float(np.sum(change * change)), 1e-12))


def _size(vectors: np.ndarray) -> float:
    """Return the median length over frames, averaged over bodies."""
    return float(np.median(np.linalg.norm(vectors, axis=-1), axis=0).mean())


def _at_centre(change: np.ndarray, turn: np.ndarray, quat: np.ndarray, stored: np.ndarray) -> np.ndarray:
    """Return the velocities of those points fixed to the bodies that come nearest to the stored ones."""
    found = change.copy()
    for body in range(change.shape[1]):
        rotation = se3.quat_to_matrix(quat[:, body])
        # omega x (R r) is linear in r.
        lever = se3.skew(turn[:, body]) @ rotation
        offset, *_ = np.linalg.lstsq(lever.reshape(-1, 3), (stored[:, body] - change[:, body]).reshape(-1), rcond=1e-6)
        if np.linalg.norm(offset) < _MAXIMUM_LEVER:
            found[:, body] += lever @ offset
    return found
