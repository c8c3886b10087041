"""The robot's feet: planted on the floor in stance by its own soles, at one place for each stance run.

The human's toe joint rides 2 to 7 cm over the floor, depending on subject and capture. Each foot's
resting height is taken from its own stance frames; a standing foot is laid flat, set down so that
its lowest sole corner touches the floor. Transitions are blended over a few
frames, so that nothing depends on frames further away than that.

The ball of a person's foot stays within a centimetre of one place while it stands. The ankle above it does not, and a
robot that follows the ankle slides. So each run of stance frames gets the median place of its ball and the median
heading, and the sole is laid flat there. Clear motions of a run remain: a heel that rises turns the foot about the
front edge of its sole, toes that rise about the rear edge, a foot that pivots turns about its ball, and one that is
dragged over the floor is dragged.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.numerics.filters import closed_and_opened, seconds_to_frames, smooth, smooth_quats, smoothstep_around
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.spec import SOLE_CORNERS

RAMP_SECONDS = 0.4  # A foot is planted and released over this time.
SHORTEST_STANCE_SECONDS = 0.1  # Shorter ones, and shorter gaps, are flicker of the labels.
LARGEST_TILT = np.radians(15.0)  # More is not a habit of the skeleton.
FLAT_BELOW, TILTED_ABOVE = np.radians(2.0), np.radians(6.0)  # Pitch of a standing foot.


@dataclass(frozen=True, eq=False)
class Foot:
    """One foot of a robot: places in the frame of its contact site."""

    toe: Float[np.ndarray, "3"]  # The site that inverse kinematics steers [m].
    corners: Float[np.ndarray, "4 3"]  # Sole corners [m].

    @classmethod
    def of(cls, model: RobotModel, side: str) -> "Foot":
        """Return a robot's left or right foot."""
        standing = model.forward(model.home_qpos[None])
        origin, rotation = standing.site_position(f"{side}_foot")[0], standing.site_rotation(f"{side}_foot")[0]

        def place(site: str) -> np.ndarray:
            return rotation.T @ (standing.site_position(site)[0] - origin)

        return cls(place(f"{side}_toe"), np.stack([place(f"{side}_sole_{corner}") for corner in SOLE_CORNERS]))

    @property
    def toe_height(self) -> float:
        """Height of the toe site when the sole is flat on the floor [m]."""
        return float(self.toe[2] - self.corners[:, 2].min())

    def lowest(self, rotations: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T"]:
        """Return how high the lowest sole corner is over the contact site [m]; negative."""
        return np.min(rotations[:, 2] @ self.corners.T, axis=1)


def resting_height(toe_heights: Float[np.ndarray, "T"], stands: Bool[np.ndarray, "T"]) -> float:
    """Return at which height a toe joint stands [m]; its lowest where it never does."""
    return float(np.median(toe_heights[stands]) if stands.any() else toe_heights.min())


def resting_tilt(quats: Float[np.ndarray, "T 4"], stands: Bool[np.ndarray, "T"]) -> Float[np.ndarray, "4"]:
    """Return the constant rotation, in the foot's frame, by which a foot usually stands tilted.

    Multiplied on the right it levels the foot. What the skeleton calls level differs by a few
    degrees from subject to subject.
    """
    if not stands.any():
        return se3.IDENTITY_QUAT
    up_in_foot = se3.quat_to_matrix(quats[stands])[:, 2]
    x, y, _ = np.median(up_in_foot, axis=0)
    tilt = np.clip([np.arcsin(np.clip(y, -1, 1)), -np.arcsin(np.clip(x, -1, 1)), 0.0], -LARGEST_TILT, LARGEST_TILT)
    return se3.exp(-tilt)


def steady_stance(stands: Bool[np.ndarray, "T"], fps: float) -> Bool[np.ndarray, "T"]:
    """Return stance flags without flicker."""
    shortest = seconds_to_frames(SHORTEST_STANCE_SECONDS, fps)
    return closed_and_opened(stands, gap=shortest - 1, shortest=shortest)


def plant(
    foot: Foot,
    toes: Float[np.ndarray, "T 3"],
    quats: Float[np.ndarray, "T 4"],
    stands: Bool[np.ndarray, "T"],
    fps: float,
) -> tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 4"]]:
    """Return the contact site's position and rotation for a wanted toe path and foot rotation."""
    standing = smoothstep_around(steady_stance(stands, fps), seconds_to_frames(RAMP_SECONDS, fps))
    toes, quats = smooth(toes, fps), smooth_quats(quats, fps)
    quats = se3.slerp(quats, _level(quats), standing)
    positions = toes - se3.rotate(quats, foot.toe)
    lowest = foot.lowest(se3.quat_to_matrix(quats))
    # On the floor in stance, never under it.
    free = np.maximum(positions[:, 2], -lowest)
    positions[:, 2] = free + standing * (-lowest - free)
    return positions, quats


def _level(quats: Float[np.ndarray, "T 4"]) -> Float[np.ndarray, "T 4"]:
    """Return the rotations without roll, and without pitch as long as that is small."""
    forward = se3.quat_to_matrix(quats)[:, :, 0]
    yaw = np.arctan2(forward[:, 1], forward[:, 0])
    pitch = np.arcsin(np.clip(-forward[:, 2], -1.0, 1.0))
    share = np.clip((np.abs(pitch) - FLAT_BELOW) / (TILTED_ABOVE - FLAT_BELOW), 0.0, 1.0)
    kept = pitch * share**2 * (3.0 - 2.0 * share)
    zero = np.zeros_like(yaw)
    turn = se3.exp(np.stack([zero, zero, yaw], axis=1))
    return se3.quat_multiply(turn, se3.exp(np.stack([zero, kept, zero], axis=1)))


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
    change = _carried_on(change, free, pieces, seconds_to_frames(RAMP_SECONDS, fps))
    turned = se3.quat_multiply(se3.quat_multiply(_about(2, change[:, 2]), quats), _about(1, change[:, 3]))
    # The lowest corner keeps its height.
    height = positions[:, 2] + foot.lowest(rotations) - foot.lowest(se3.quat_to_matrix(turned))
    return np.column_stack([positions[:, :2] + change[:, :2], height]), turned


def anchor_weights(stands: Bool[np.ndarray, "T"], fps: float) -> Float[np.ndarray, "T"]:
    """Return the weight of a foot's place, as a share: 1 in stance runs, less towards their first and last frame.

    At full weight to the end a foot would stop and start with a jerk.
    """
    steady = steady_stance(stands, fps)
    return 1.0 - smoothstep_around(~steady, seconds_to_frames(FADE_SECONDS, fps))


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
    change: Float[np.ndarray, "T 4"], free: Float[np.ndarray, "T 4"], pieces: tuple[tuple[int, int], ...], ramp: int
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
