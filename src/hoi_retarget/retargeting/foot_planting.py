"""Where the robot's feet should be: planted on the floor in stance, by the robot's own soles.

The human's toe joint rides 2 to 7 cm over the floor, depending on subject and capture. Each foot's
resting height is taken from its own stance frames; a standing foot is laid flat, set down so that
its lowest sole corner touches the floor. Transitions are blended over a few
frames, so that nothing depends on frames further away than that.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import fade, frames_in, smooth, smooth_quats, steadied
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.spec import SOLE_CORNERS

RAMP_SECONDS = 0.4  # A foot is planted and released over this time.
SHORTEST_STANCE_SECONDS = 0.1  # Shorter ones, and shorter gaps, are flicker of the labels.
LARGEST_TILT = np.radians(15.0)  # More is not a habit of the skeleton.
FLAT_BELOW, TILTED_ABOVE = np.radians(2.0), np.radians(6.0)  # Pitch of a standing foot.


@dataclass(frozen=True, eq=False)
class Foot:
    """One foot of a robot: places in the frame of its contact site."""

    toe: Float[np.ndarray, "3"]
    """The site that inverse kinematics steers [m]."""
    corners: Float[np.ndarray, "4 3"]
    """Sole corners [m]."""

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
    shortest = frames_in(SHORTEST_STANCE_SECONDS, fps)
    return steadied(stands, gap=shortest - 1, shortest=shortest)


def plant(
    foot: Foot,
    toes: Float[np.ndarray, "T 3"],
    quats: Float[np.ndarray, "T 4"],
    stands: Bool[np.ndarray, "T"],
    fps: float,
) -> tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 4"]]:
    """Return the contact site's position and rotation for a wanted toe path and foot rotation."""
    standing = fade(steady_stance(stands, fps), frames_in(RAMP_SECONDS, fps))
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
