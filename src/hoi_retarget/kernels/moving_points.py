"""Points of links and objects that move: their distances from each other, and hinges between them."""

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.kernels.library import at, function, real, whole
from hoi_retarget.kernels.shape import Shape

_SKIN_POINTS = function("skin_points", "pppppipipippp")
_SOLID_POINTS = function("solid_points", "pppipipippp")
_MEETING = function("meeting", "ppiippdppppipiddpppp", counts=True)
_HINGE = function("hinge", "ppppddiippp")

Moving = tuple[Float[np.ndarray, "3 3 T"], Float[np.ndarray, "3 T"]]  # Rotation and position [m] over T frames.
AtPoints = tuple[Float[np.ndarray, "3 K F"], Float[np.ndarray, "K F"], Float[np.ndarray, "3 K F"]]
"""Levers [m], distances [m], normals in world axes."""


def skin_points(
    surface: Shape,
    link: Moving,
    moving_object: Moving,
    frames: Int[np.ndarray, "F"],
    points: Float[np.ndarray, "3 K F"],
) -> AtPoints:
    """Return levers and distances of points of a link's skin at a moving surface [m], and normals.

    `points` are in the link's frame [m], and `frames` those of their places.
    """
    own, other = [real(part) for part in link], [real(part) for part in moving_object]
    frames, points = whole(frames), real(points)
    _, each, count = points.shape
    levers, distances, normals = np.empty(points.shape), np.empty((each, count)), np.empty(points.shape)
    _SKIN_POINTS(
        surface.address, *map(at, (*own, *other)), own[1].shape[1], at(frames), count, at(points), each,
        at(levers), at(distances), at(normals),
    )  # fmt: skip
    return levers, distances, normals


def solid_points(
    solid: Shape, link: Moving, frames: Int[np.ndarray, "F"], points: Float[np.ndarray, "3 K F"]
) -> AtPoints:
    """Return levers and distances of world points at a link's solid [m], and how these grow as the link moves.

    `frames` are those of the points.
    """
    own, frames, points = [real(part) for part in link], whole(frames), real(points)
    _, each, count = points.shape
    levers, distances, away = np.empty(points.shape), np.empty((each, count)), np.empty(points.shape)
    _SOLID_POINTS(
        solid.address, *map(at, own), own[1].shape[1], at(frames), count, at(points), each,
        at(levers), at(distances), at(away),
    )  # fmt: skip
    return levers, distances, away


def meeting(  # noqa: PLR0913, PLR0917  # two links and what is asked of them
    solid: Shape,
    points: Float[np.ndarray, "K 3"],
    neighbours: tuple[int, Int[np.ndarray, "K"], Float[np.ndarray, "K"], float],
    link: Moving,
    other: Moving,
    frames: Int[np.ndarray, "F"],
    *,
    margin: float,
    overrated: float,
) -> tuple[Int[np.ndarray, "N"], Float[np.ndarray, "N 3"], Float[np.ndarray, "N"], Float[np.ndarray, "N 3"]]:
    """Return the points of a link in another's solid: indices of frames, places, depths [m], slopes of distances.

    Args: `solid`: of the other link; `points`: of the link, in its frame [m]; `neighbours`: number of coarse points;
    for each point the nearest of these and how far that is and is at most [m]; `link`: pose of the link; `other`: pose
    of the other link; `frames`: frames that are looked at; `margin`: distance that counts as inside [m]; `overrated`:
    factor by which the solid may overrate distances.
    """
    coarse, nearest, away, farthest = neighbours
    points, own, others = real(points), [real(part) for part in link], [real(part) for part in other]
    chosen, nearest, away = whole(frames), whole(nearest), real(away)
    most = max(len(points) * len(frames), 1)
    times, places, slopes = np.empty(most, dtype=np.int64), np.empty((most + 1, 3)), np.empty((most + 1, 3))
    depths = np.empty(most + coarse)
    found = _MEETING(
        solid.address, at(points), len(points), coarse, at(nearest), at(away), farthest,
        *map(at, (*own, *others)), own[1].shape[1], at(chosen), len(frames), margin, overrated,
        *map(at, (times, places, depths, slopes)),
    )  # fmt: skip
    return times[:found].copy(), places[:found].copy(), depths[:found].copy(), slopes[:found].copy()


def hinge(
    levers: Float[np.ndarray, "3 K F"],
    distances: Float[np.ndarray, "K F"],
    normals: Float[np.ndarray, "3 K F"],
    margin: float | Float[np.ndarray, "K F"],
    knee: float,
) -> tuple[Float[np.ndarray, "K F"], Float[np.ndarray, "K 3 F"], Float[np.ndarray, "K 3 F"]]:
    """Return residuals of hinges [m], and their derivatives by a link's linear and angular velocity.

    Args: `levers`: from the link's origin to the points [m]; `distances`: of the points [m]; `normals`: in which the
    distances grow; `margin`: distance that costs nothing [m]; `knee`: depth beyond which the cost is linear [m].
    """
    levers, distances, normals = real(levers), real(distances), real(normals)
    each, count = distances.shape
    residual, by_linear, by_angular = np.empty((each, count)), np.empty((each, 3, count)), np.empty((each, 3, count))
    margins = real(margin) if isinstance(margin, np.ndarray) else None
    _HINGE(
        at(levers), at(distances), at(normals), at(margins), 0.0 if margins is not None else margin, knee, each,
        count, at(residual), at(by_linear), at(by_angular),
    )  # fmt: skip
    return residual, by_linear, by_angular
