"""Points of an object outside a link's solid: what the link's skin points do not see between them, such as rods."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.retargeting.surfaces.link_points import hinge_rows
from hoi_retarget.retargeting.surfaces.moving_object import MovingObject
from hoi_retarget.retargeting.trajopt.rows import FrameRows
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import LinkSkin

NEAR = 0.012
"""[m]; samples that are further away from a link are left out."""
STRIDE = 3
"""Neighbouring frames that share their samples."""


@dataclass(frozen=True, eq=False)
class ObjectOutsideLink:
    """Hinge of object samples inside a link's solid [m^2]; the samples of each frame are chosen once."""

    name: str
    skin: LinkSkin
    frames: Int[np.ndarray, "F"]
    points: Float[np.ndarray, "3 K F"]
    """World positions of the samples [m]."""
    margins: Float[np.ndarray, "K F"]
    """Distance from the solid that costs nothing [m]; minus infinity for places in the arrays without a sample."""
    weights: Float[np.ndarray, "F"]
    """[1/m^2]"""

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return one row a sample."""
        frame = self.skin.frame
        distances, away = self._at(kinematics)
        lever = self.points - kinematics.point(frame)[:, None, self.frames]
        rows = hinge_rows(frame, lever, distances, away, self.margins, self.weights, self.frames)
        return (rows,) if rows.residual.any() else ()

    def depths(self, kinematics: Kinematics) -> Float[np.ndarray, "F"]:
        """Return how deep the deepest sample is in each frame [m]; negative outside."""
        return -np.where(np.isfinite(self.margins), self._at(kinematics)[0], np.inf).min(axis=0)

    def _at(self, kinematics: Kinematics) -> tuple[Float[np.ndarray, "K F"], Float[np.ndarray, "3 K F"]]:
        """Return the samples' distances from the solid [m], and in which direction it must move for them to grow."""
        frame, shape = self.skin.frame, self.points.shape
        rotation = kinematics.orientation(frame)[:, :, self.frames]
        lever = self.points - kinematics.point(frame)[:, None, self.frames]
        inside = np.einsum("jif,jkf->ikf", rotation, lever)
        distances, normals = self.skin.solid.distances_and_normals(inside.reshape(3, -1).T)
        away = -np.einsum("ijf,jkf->ikf", rotation, normals.T.reshape(shape))
        return distances.reshape(shape[1:]), away


def object_outside_link(  # noqa: PLR0913, PLR0917 - what a term is made of
    name: str,
    skin: LinkSkin,
    thing: MovingObject,
    start: Kinematics,
    weight: float,
    count: int,
    apart: float,
) -> ObjectOutsideLink | None:
    """Return the term with the samples that are near the link at a start; None where none ever is.

    Args:
        name: Of the term.
        skin: Of the link, with its solid.
        thing: The object.
        start: Trajectory that a solve starts from.
        weight: [1/m^2]
        count: Most samples in a frame.
        apart: Least distance between two of them [m].
    """
    every = np.arange(len(start.qpos))
    centres = thing.inside(start.point(skin.frame.of(skin.centre, np.eye(3)))[:, None], every)
    near = np.flatnonzero(np.abs(thing.distances(centres)[0]) < skin.radius + NEAR)
    if not near.size:
        return None
    # One frame in the middle of each group speaks for all of the group.
    middles = near[np.minimum(np.arange(0, len(near), STRIDE) + STRIDE // 2, len(near) - 1)]
    around = thing.samples.query_ball_point(centres[:, 0, middles].T, skin.radius + NEAR)
    chosen = [
        _nearest(samples, skin, thing, start, frame, count, apart)
        for frame, samples in zip(middles.tolist(), around, strict=True)
    ]
    group = np.arange(len(near)) // STRIDE
    kept = np.array([bool(len(samples)) for samples in chosen])[group]
    frames = near[kept]
    if not frames.size:
        return None
    most = max(map(len, chosen))
    index, margins = np.zeros((most, len(chosen)), dtype=int), np.full((most, len(chosen)), -np.inf)
    for column, samples in enumerate(chosen):
        index[: len(samples), column], margins[: len(samples), column] = samples, 0.0
    places = np.moveaxis(thing.samples.data[index[:, group[kept]]], 2, 0)
    world = np.einsum("ijf,jkf->ikf", thing.rotation[:, :, frames], places) + thing.position[:, None, frames]
    return ObjectOutsideLink(name, skin, frames, world, margins[:, group[kept]], np.full(len(frames), weight))


def _nearest(  # noqa: PLR0913, PLR0917 - where samples are chosen
    samples: list[int], skin: LinkSkin, thing: MovingObject, start: Kinematics, frame: int, count: int, apart: float
) -> list[int]:
    """Return the samples nearest to a link's solid in one frame, spread."""
    if not samples:
        return []
    found = np.array(samples)
    places = np.asarray(thing.samples.data)[found]
    world = thing.rotation[:, :, frame] @ places.T + thing.position[:, frame, None]
    rotation = start.orientation(skin.frame)[:, :, frame]
    distances = skin.solid.nearest_distances((rotation.T @ (world - start.point(skin.frame)[:, frame, None])).T)
    order = np.argsort(distances, kind="stable")
    left = order[: np.searchsorted(distances[order], NEAR)]
    chosen: list[int] = []
    while left.size and len(chosen) < count:
        chosen.append(int(found[left[0]]))
        away = places[left] - places[left[0]]
        left = left[np.einsum("ki,ki->k", away, away) >= apart**2]
    return chosen
