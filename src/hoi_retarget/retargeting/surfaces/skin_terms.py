"""Points of a link outside an object, and points of an object, such as rods, outside a link.

Skin in contact stays on the object's surface. Between its points the skin does not see rods: their own points do.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.kernels import moving_points
from hoi_retarget.retargeting.surfaces import skin_points
from hoi_retarget.retargeting.trajopt.problem import FrameRows
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import LinkSkin

OUTSIDE_RANGE = 0.012  # [m]; samples that are further away from a link are left out.
STRIDE, SHARED_WAY, SPREAD_POINTS = 3, 0.01, 4
"""Most frames that share their samples, the way of the link between them [m], and its points that tell it."""


@dataclass(frozen=True, eq=False)
class ObjectOutsideLink:
    """Hinge of object samples inside a link's solid [m^2]; the samples of each frame are chosen once."""

    name: str
    skin: LinkSkin
    frames: Int[np.ndarray, "F"]
    points: Float[np.ndarray, "3 K F"]  # World positions of the samples [m].
    margins: Float[np.ndarray, "K F"]
    """Distance from the solid that costs nothing [m]; minus infinity for places in the arrays without a sample."""
    weights: Float[np.ndarray, "F"]  # [1/m^2]

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return one row a sample."""
        frame = self.skin.frame
        lever, distances, away = self._at(kinematics)
        rows = skin_points.hinge_rows(frame, lever, distances, away, self.margins, self.weights, self.frames)
        return (rows,) if rows.residual.any() else ()

    def depths(self, kinematics: Kinematics) -> Float[np.ndarray, "F"]:
        """Return the depth of the deepest sample in each frame [m]; negative outside."""
        return -np.where(np.isfinite(self.margins), self._at(kinematics)[1], np.inf).min(axis=0)

    def _at(self, kinematics: Kinematics) -> moving_points.AtPoints:
        """Return the samples' levers and distances from the solid [m], and its ways along which these grow."""
        frame = self.skin.frame
        link = kinematics.orientation(frame), kinematics.point(frame)
        return moving_points.solid_points(self.skin.solid.compiled, link, self.frames, self.points)


def object_outside_link(  # noqa: PLR0913, PLR0917  # the parts of a term
    name: str, link: skin_points.LinkAtObject, near: skin_points.NearSkin, weight: float, count: int, apart: float
) -> ObjectOutsideLink | None:
    """Return the term with the samples that are near the link at a start; None where none ever is.

    Args: `name`: of the term; `link`: the link and the object; `near`: its points at a start; `weight`: [1/m^2];
    `count`: most samples in a frame; `apart`: least distance between two of them [m].
    """
    skin, moving_object = link.skin, link.moving_object
    frames = near.frames[near.least < OUTSIDE_RANGE]
    frames = frames[np.abs(link.around[frames]) < skin.radius + OUTSIDE_RANGE]
    if not frames.size:
        return None
    # One frame in the middle of each group speaks for all of the group.
    group = _groups(link, frames)
    ends = np.searchsorted(group, np.arange(group[-1] + 2))
    middles = frames[(ends[:-1] + ends[1:]) // 2]
    chosen, number = moving_object.samples.nearest(link.poses(middles), OUTSIDE_RANGE, count, apart)
    kept = number[group] > 0
    frames = frames[kept]
    if not frames.size:
        return None
    most = number.max()
    margins = np.where(np.arange(most)[:, None] < number, 0.0, -np.inf)
    places = np.moveaxis(moving_object.samples.points[chosen[group[kept], :most].T], 2, 0)
    world = (
        np.einsum("ijf,jkf->ikf", moving_object.rotation[:, :, frames], places)
        + moving_object.position[:, None, frames]
    )
    return ObjectOutsideLink(name, skin, frames, world, margins[:, group[kept]], np.full(len(frames), weight))


def _groups(link: skin_points.LinkAtObject, frames: Int[np.ndarray, "F"]) -> Int[np.ndarray, "F"]:
    """Return the groups of frames in which a link is at about the same place on the object, numbered from zero."""
    frame, points = link.skin.frame, link.skin.points[:SPREAD_POINTS].T[:, :, None].repeat(len(frames), axis=2)
    world = link.start.point(frame)[:, None, frames] + skin_points.levers(link.start, frame, points, frames)
    places = link.moving_object.inside(world, frames)
    group, first = np.zeros(len(frames), dtype=int), 0
    for index in range(1, len(frames)):
        apart = index - first == STRIDE or np.abs(places[:, :, index] - places[:, :, first]).max() > SHARED_WAY
        first = index if apart else first
        group[index] = group[index - 1] + apart
    return group


MARGIN = 0.0005  # [m] of clearance: the surface between two skin points.
TOUCHING = 0.001  # [m]; nearer skin touches, and is drawn no nearer.
SHARPNESS = 0.0015  # [m]; skin that much further away has a share of 1/e in the distance of the whole.
FURTHEST_PULL = 0.03  # [m]; beyond, what is drawn to the surface costs in proportion to its distance.


@dataclass(frozen=True, eq=False)
class SkinContact:
    """Hinge of skin points under the margin, and of their smooth least distance over `TOUCHING` where they touch [m^2].

    The points of each frame are chosen once, nearest ones and spread, so that the cost is smooth.
    """

    name: str
    skin: LinkSkin
    moving_object: skin_points.MovingObject
    frames: Int[np.ndarray, "F"]
    points: Float[np.ndarray, "3 K F"]  # In the link's frame [m].
    weights: Float[np.ndarray, "F"]  # Of the clearance [1/m^2].
    touch_weights: Float[np.ndarray, "F"] | None  # [1/m^2]; None where the link never touches the object.

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return one row a point for clearance, and one for touch."""
        lever, distances, normals = self._at(kinematics)
        clearance = skin_points.hinge_rows(
            self.skin.frame, lever, distances, normals, MARGIN, self.weights, self.frames
        )
        if self.touch_weights is None:
            return (clearance,)
        return clearance, self._touch(lever, distances, normals, self.touch_weights)

    def depths(self, kinematics: Kinematics) -> Float[np.ndarray, "F"]:
        """Return the depth of the deepest point in each frame [m]; negative outside."""
        return -self._at(kinematics)[1].min(axis=0)

    def _at(self, kinematics: Kinematics) -> moving_points.AtPoints:
        """Return levers and distances of the points [m], and normals in world axes."""
        link = kinematics.orientation(self.skin.frame), kinematics.point(self.skin.frame)
        surface, moving = self.moving_object.field.compiled, self.moving_object
        return moving_points.skin_points(surface, link, (moving.rotation, moving.position), self.frames, self.points)

    def _touch(self, lever: np.ndarray, distances: np.ndarray, normals: np.ndarray, weights: np.ndarray) -> FrameRows:
        shares = np.exp((distances.min(axis=0) - distances) / SHARPNESS)
        shares /= shares.sum(axis=0)
        distance = (shares * distances).sum(axis=0)
        residual, slope = skin_points.softened(np.maximum(distance - TOUCHING, 0.0), FURTHEST_PULL)
        # The derivative of the shares counts too: they move towards the points that come nearer.
        shares *= 1.0 - (distances - distance) / SHARPNESS
        along = np.where(residual > 0.0, slope, 0.0) * shares * normals
        by_linear, by_angular = along.sum(axis=1), skin_points.moments(lever, along).sum(axis=1)
        return FrameRows(self.skin.frame, residual[None], by_linear[None], by_angular[None], weights, self.frames)


def skin_contact(
    name: str,
    link: skin_points.LinkAtObject,
    near: skin_points.NearSkin,
    weight: float,
    touch_weights: Float[np.ndarray, "T"] | None,
) -> SkinContact | None:
    """Return the term with the skin points that are near at a start; None where no skin ever is, nor is to touch.

    Args: `name`: of the term; `link`: the link and the object; `near`: its points at a start; `weight`: of the
    clearance [1/m^2]; `touch_weights`: in every frame [1/m^2]; None where the link never touches the object.
    """
    points, count = link.skin.points, near.chosen.shape[1]
    seen = near.nearest < skin_points.NEAR
    wanted = np.zeros(len(link.around), dtype=bool) if touch_weights is None else touch_weights > 0
    wanted[near.frames[seen]] = True
    frames = np.flatnonzero(wanted)
    if not frames.size:
        return None
    # Where none is near, any that are spread.
    chosen = np.repeat(np.arange(count)[None], len(frames), axis=0)
    chosen[np.searchsorted(frames, near.frames[seen])] = near.chosen[seen]
    touching = None if touch_weights is None else touch_weights[frames]
    placed = np.ascontiguousarray(points[chosen].transpose(2, 1, 0))
    return SkinContact(name, link.skin, link.moving_object, frames, placed, np.full(len(frames), weight), touching)
