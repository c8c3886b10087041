"""Feet that stand still: one place on the floor for each stance run of a foot, its sole flat on it.

The ball of a person's foot stays within a centimetre of one place while it stands. The ankle above it does not, and a
robot that follows the ankle slides. So each run of stance frames gets the median place of its ball and the median
heading, and the sole is laid flat there. Clear motions of a run remain: a heel that rises turns the foot about the
front edge of its sole, toes that rise about the rear edge, a foot that pivots turns about its ball, and one that is
dragged over the floor is dragged.
"""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.numerics.filters import fade, frames_in
from hoi_retarget.retargeting.foot_planting import RAMP_SECONDS, Foot, steady_stance

# Motion up to the first number is taken out; from the second one on it is followed whole. In 249 runs of 33 clips the
# ball strays by 7 mm in the middle and by 32 at most. Heels rise by 16 degrees at the end of one run in four: a robot
# that does the same slides and shakes more than one whose soles stay flat.
DRAG = 0.05, 0.10  # [m]: largest distance of the ball from its median place
PIVOT = np.radians(15.0), np.radians(30.0)  # Largest angle from the median heading.
TILT = np.radians(25.0), np.radians(40.0)  # Pitch of each frame.
FADE_SECONDS = 0.2  # A foot is held and let go over this time within its stance.


def anchor(
    foot: Foot,
    positions: Float[np.ndarray, "T 3"],
    quats: Float[np.ndarray, "T 4"],
    stands: Bool[np.ndarray, "T"],
    fps: float,
) -> tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 4"]]:
    """Return the contact site's positions [m] and rotations of a planted foot with one place for each stance run.

    What that changes fades out before and after a run, over as long as a foot is planted.
    """
    rotations = se3.quat_to_matrix(quats)
    heading = np.unwrap(np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0]))
    pitch = np.arcsin(np.clip(-rotations[:, 2, 0], -1.0, 1.0))
    free = np.column_stack([positions[:, :2], heading, pitch])
    balls = positions[:, :2] + (rotations @ foot.toe)[:, :2]
    change, pieces = np.zeros_like(free), runs(steady_stance(stands, fps))
    for first, stop in pieces:
        run = slice(first, stop)
        change[run] = _anchored(foot, balls[run], heading[run], pitch[run]) - free[run]
    change = _carried_on(change, free, pieces, frames_in(RAMP_SECONDS, fps))
    turned = se3.quat_multiply(se3.quat_multiply(_about(2, change[:, 2]), quats), _about(1, change[:, 3]))
    # The lowest corner keeps its height.
    height = positions[:, 2] + foot.lowest(rotations) - foot.lowest(se3.quat_to_matrix(turned))
    return np.column_stack([positions[:, :2] + change[:, :2], height]), turned


def anchor_weights(stands: Bool[np.ndarray, "T"], fps: float) -> Float[np.ndarray, "T"]:
    """Return how much a foot is to keep its place: 1 in stance runs, less towards their first and last frame.

    At full weight to the end a foot would stop and start with a jerk.
    """
    steady = steady_stance(stands, fps)
    return 1.0 - fade(~steady, frames_in(FADE_SECONDS, fps))


def _anchored(
    foot: Foot, balls: Float[np.ndarray, "F 2"], heading: Float[np.ndarray, "F"], pitch: Float[np.ndarray, "F"]
) -> Float[np.ndarray, "F 4"]:
    """Return x, y [m], heading and pitch of one run's contact site."""
    ahead = np.median(heading)
    # Medians along the foot and across it: a turned clip has turned places.
    axes = np.array([[np.cos(ahead), -np.sin(ahead)], [np.sin(ahead), np.cos(ahead)]])
    place = axes @ np.median(balls @ axes, axis=0)
    away, turn = balls - place, heading - ahead
    ball = place + _share(np.linalg.norm(away, axis=1).max(), DRAG) * away
    heading = ahead + _share(np.abs(turn).max(), PIVOT) * turn
    pitch = _share(np.abs(pitch), TILT) * pitch
    # The foot turns about the edge of its sole that stays on the floor.
    edge = np.where(pitch > 0, foot.corners[:, 0].max(), foot.corners[:, 0].min())
    forwards = edge * (1.0 - np.cos(pitch)) - foot.corners[:, 2].min() * np.sin(pitch) - foot.toe[0]
    along = np.column_stack([np.cos(heading), np.sin(heading)])
    across = np.column_stack([-np.sin(heading), np.cos(heading)])
    return np.column_stack([ball + forwards[:, None] * along - foot.toe[1] * across, heading, pitch])


def _share(value: Any, limits: tuple[float, float]) -> Any:
    """Return 0 up to the first limit, 1 from the second one on, and a smooth step between them."""
    share = np.clip((value - limits[0]) / (limits[1] - limits[0]), 0.0, 1.0)
    return share**2 * (3.0 - 2.0 * share)


def _carried_on(
    change: Float[np.ndarray, "T 4"],
    free: Float[np.ndarray, "T 4"],
    pieces: tuple[tuple[int, int], ...],
    ramp: int,
) -> Float[np.ndarray, "T 4"]:
    """Return a change that is given inside of runs, faded out around each: the foot departs and arrives at rest."""
    carried, frames = change.copy(), len(change)
    bounds = [0, *(edge for piece in pieces for edge in piece), frames]
    speed = np.gradient(free, axis=0)
    # Gaps before, between and after the runs.
    for before, after in zip(bounds[::2], bounds[1::2], strict=True):
        reach = min(ramp, after - before) + 1
        since = np.arange(1, after - before + 1)
        if before > 0:
            carried[before:after] += _quintic(since, reach, change[before - 1], -speed[before - 1])
        if after < frames:
            carried[before:after] += _quintic(since[::-1], reach, change[after], speed[after])
    return carried


def _quintic(
    frames: Int[np.ndarray, "G"], reach: int, value: Float[np.ndarray, "4"], slope: Float[np.ndarray, "4"]
) -> Float[np.ndarray, "G 4"]:
    """Return the polynomial from a value and a slope to zero, as smooth at its ends as a fifth degree can be."""
    s = np.minimum(frames / reach, 1.0)[:, None]
    return (1 - s) ** 3 * ((1.0 + 3.0 * s + 6.0 * s**2) * value + s * (1.0 + 3.0 * s) * reach * slope)


def _about(axis: int, angle: Float[np.ndarray, "T"]) -> Float[np.ndarray, "T 4"]:
    return se3.exp(angle[:, None] * np.eye(3)[axis])
