"""Skin of a link outside an object, and on its surface where the link is to touch it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.retargeting.surfaces.link_points import hinge_rows, levers, moments, softened
from hoi_retarget.retargeting.surfaces.moving_object import MovingObject
from hoi_retarget.retargeting.surfaces.near_skin import near_distances, nearest_spread, patches_of
from hoi_retarget.retargeting.trajopt.rows import FrameRows
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import LinkSkin

NEAR = 0.03
"""[m]; skin that is further away is left out."""
MARGIN = 0.0005
"""[m] of clearance: the surface between two skin points."""
TOUCHING = 0.001
"""[m]; nearer skin touches, and is drawn no nearer."""
SHARPNESS = 0.0015
"""[m]; skin that much further away has a share of 1/e in the distance of the whole."""
FURTHEST_PULL = 0.03
"""[m]; beyond, what is drawn to the surface costs in proportion to its distance."""


@dataclass(frozen=True, eq=False)
class SkinContact:
    """Hinge of skin points under the margin, and of their smooth least distance over `TOUCHING` where they touch [m^2].

    The points of each frame are chosen once, nearest ones and spread, so that the cost is smooth.
    """

    name: str
    skin: LinkSkin
    thing: MovingObject
    frames: Int[np.ndarray, "F"]
    points: Float[np.ndarray, "3 K F"]
    """In the link's frame [m]."""
    weights: Float[np.ndarray, "F"]
    """Of the clearance [1/m^2]."""
    touch_weights: Float[np.ndarray, "F"] | None
    """[1/m^2]; None where the link never touches the object."""

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return one row a point for clearance, and one for touch."""
        lever, distances, normals = self._at(kinematics)
        normals = np.einsum("ijf,jkf->ikf", self.thing.rotation[:, :, self.frames], normals)
        clearance = hinge_rows(self.skin.frame, lever, distances, normals, MARGIN, self.weights, self.frames)
        if self.touch_weights is None:
            return (clearance,)
        return clearance, self._touch(lever, distances, normals, self.touch_weights)

    def depths(self, kinematics: Kinematics) -> Float[np.ndarray, "F"]:
        """Return how deep the deepest point is in each frame [m]; negative outside."""
        return -self._at(kinematics)[1].min(axis=0)

    def _at(self, kinematics: Kinematics) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return levers and distances of the points, and normals in the object's frame."""
        lever = levers(kinematics, self.skin.frame, self.points, self.frames)
        points = kinematics.point(self.skin.frame)[:, None, self.frames] + lever
        return lever, *self.thing.distances_and_normals(self.thing.inside(points, self.frames))

    def _touch(self, lever: np.ndarray, distances: np.ndarray, normals: np.ndarray, weights: np.ndarray) -> FrameRows:
        shares = np.exp((distances.min(axis=0) - distances) / SHARPNESS)
        shares /= shares.sum(axis=0)
        distance = (shares * distances).sum(axis=0)
        residual, slope = softened(np.maximum(distance - TOUCHING, 0.0), FURTHEST_PULL)
        # The derivative of the shares counts too: they move towards the points that come nearer.
        shares *= 1.0 - (distances - distance) / SHARPNESS
        along = np.where(residual > 0.0, slope, 0.0) * shares * normals
        by_linear, by_angular = along.sum(axis=1), moments(lever, along).sum(axis=1)
        return FrameRows(self.skin.frame, residual[None], by_linear[None], by_angular[None], weights, self.frames)


def skin_contact(  # noqa: PLR0913, PLR0917 - what a term is made of
    name: str,
    skin: LinkSkin,
    thing: MovingObject,
    start: Kinematics,
    weight: float,
    touch_weights: Float[np.ndarray, "T"] | None,
    count: int,
    apart: float,
) -> SkinContact | None:
    """Return the term with the skin points that are near at a start; None where no skin ever is, nor is to touch.

    Args:
        name: Of the term.
        skin: Of the link.
        thing: The object.
        start: Trajectory that a solve starts from.
        weight: Of the clearance [1/m^2].
        touch_weights: In every frame [1/m^2]; None where the link never touches the object.
        count: Points in each frame.
        apart: Least distance between two of them [m].
    """
    wanted = np.zeros(len(start.qpos), dtype=bool) if touch_weights is None else touch_weights > 0
    frames = np.flatnonzero(wanted | _ball_is_near(skin, thing, start))
    patches = patches_of(skin, apart)
    distances = near_distances(skin, patches, thing, start, frames, NEAR)
    near = wanted[frames] | (distances.min(axis=0, initial=np.inf) < NEAR)
    frames, distances = frames[near], distances[:, near]
    if not frames.size:
        return None
    points = skin.points[nearest_spread(distances, patches, count)].transpose(2, 0, 1)
    touching = None if touch_weights is None else touch_weights[frames]
    return SkinContact(name, skin, thing, frames, points, np.full(len(frames), weight), touching)


def _ball_is_near(skin: LinkSkin, thing: MovingObject, start: Kinematics) -> np.ndarray:
    every = np.arange(len(start.qpos))
    centre = start.point(skin.frame.of(skin.centre, np.eye(3)))[:, None]
    return thing.distances(thing.inside(centre, every))[0] < skin.radius + NEAR
