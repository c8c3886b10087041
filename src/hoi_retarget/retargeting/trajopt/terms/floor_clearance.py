"""Sole corners, and every link's skin, above the floor; the paper has no such terms, and its soles sink by up to 2 cm.

Of links: knees of a robot that kneels, its seat, its hands, and all of its soles.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.problem import FrameRows
from hoi_retarget.robots.frames import Frame
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import LinkSkin, skin_of
from hoi_retarget.robots.spec import SIDES, SOLE_CORNERS

# Links that the reference keeps higher are left out [m]; contacts draw hands and feet further.
NEAR, NEAR_TOUCHING = 0.05, 0.2
# Points of a link: the lowest one as it is, and as it would be if it were tilted in six directions [rad]. Of a flat
# sole's points, which are all as low, a trace of tilt decides, so that a clip that is turned has the same ones.
TILTS = np.array([1e-3, *[0.2] * 6])[:, None]
TURNS = np.radians([0.0, 30.0, 90.0, 150.0, 210.0, 270.0, 330.0])[:, None]


@dataclass(frozen=True, eq=False)
class FloorClearance:
    """`min(0, z - margin)^2` [m^2] of some sites of one link; quadratic once below, nothing above."""

    name: str
    sites: tuple[str, ...]
    margin: float  # [m]
    weight: float

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return one row per site, all written for the twist of the first."""
        first = kinematics.frame(self.sites[0])
        points = np.stack([kinematics.point(site) for site in self.sites])
        depth = points[:, 2] - self.margin
        below = depth < 0.0
        lever = points - points[0]
        # z of a point moves with v_z + (omega x lever)_z.
        by_linear = np.zeros((len(self.sites), 3, depth.shape[1]))
        by_linear[:, 2] = below
        by_angular = np.zeros_like(by_linear)
        by_angular[:, 0] = below * lever[:, 1]
        by_angular[:, 1] = below * -lever[:, 0]
        return (FrameRows(first, np.where(below, depth, 0.0), by_linear, by_angular, self.weight),)


def floor_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[FloorClearance]:
    """Yield the sole corners of each foot above the floor."""
    for side in SIDES:
        corners = tuple(f"{side}_sole_{corner}" for corner in SOLE_CORNERS)
        yield FloorClearance(f"{side}_floor", corners, 0.0, weights.floor_clearance)


@dataclass(frozen=True, eq=False)
class LinkFloor:
    """`min(0, z)^2` [m^2] of a few points of one link in some frames."""

    name: str
    frame: Frame
    points: Float[np.ndarray, "3 K F"]  # In the link's frame [m].
    frames: Int[np.ndarray, "F"]
    weight: float

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return one row a point, in the frames in which any is below."""
        turn = kinematics.orientation(self.frame)
        height = np.einsum("jf,jkf->kf", turn[2][:, self.frames], self.points)
        height += kinematics.point(self.frame)[2, self.frames]
        sunk = np.flatnonzero(height.min(axis=0, initial=0.0) < 0.0)
        if not sunk.size:
            return ()
        height, frames = height[:, sunk], self.frames[sunk]
        lever = np.einsum("ijf,jkf->kif", turn[:2][:, :, frames], self.points[:, :, sunk])
        below = height < 0.0
        zero, one = np.zeros_like(height), below.astype(float)
        # z of a point moves with v_z + (omega x lever)_z.
        by_linear = np.stack([zero, zero, one], axis=1)
        by_angular = np.stack([below * lever[:, 1], below * -lever[:, 0], zero], axis=1)
        return (FrameRows(self.frame, below * height, by_linear, by_angular, self.weight, frames),)


def link_floor_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[LinkFloor]:
    """Yield the links that come near the floor in the reference, in surface contact."""
    if targets.contact != "surface":
        return
    touching = {reference.model.body_of(site) for site in targets.contact_links}
    for skin in skin_of(reference.model).links:
        near = NEAR_TOUCHING if skin.link in touching else NEAR
        points, frames = _lowest(skin, reference, near)
        if frames.size:
            yield LinkFloor(f"{skin.link}_floor", skin.frame, points, frames, weights.link_floor)


def _lowest(
    skin: LinkSkin, reference: Kinematics, near: float
) -> tuple[Float[np.ndarray, "3 K F"], Int[np.ndarray, "F"]]:
    """Return a link's lowest points, as it is and if it were tilted a little, in the frames in which it is near."""
    corners = skin.extreme_points
    frames = np.flatnonzero(reference.point(skin.middle)[2] - skin.radius < near)
    ahead = reference.node_rotation[:2, 0, 0, frames]
    upwards = np.einsum("kjf,jif->kfi", _directions(ahead), reference.orientation(skin.frame)[:, :, frames])
    heights = upwards @ corners.T
    close = heights[0].min(axis=1) + reference.point(skin.frame)[2, frames] < near
    return corners[heights[:, close].argmin(axis=2)].transpose(2, 0, 1), frames[close]


def _directions(ahead: Float[np.ndarray, "2 F"]) -> Float[np.ndarray, "K 3 F"]:
    """Return upward directions that are tilted towards all sides of where the robot faces."""
    turns = np.arctan2(ahead[1], ahead[0]) + TURNS
    return np.stack([TILTS * np.cos(turns), TILTS * np.sin(turns), np.ones_like(turns)], axis=1)
