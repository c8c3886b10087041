"""The outer skin of a link's triangles and the solid that it encloses, internals left out.

A manufacturer's mesh of a link holds motors, ribs and screws, is often not closed and seldom wound alike. So a small
ball distinguishes inside and outside: it can fill the outside, coming in from far away, and touch the skin. Hollows
that it cannot enter belong to the solid, and so do those that other links plug.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Bool, Float, Int

from hoi_retarget.kernels.shape import DistanceGrid
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.spec import SIDES

_NEIGHBOURS = 10  # Nearest balls to a point, with the best one among them.
_TOUCH = 5e-4  # A ball touches points within this distance [m]: centres of balls are nodes of a grid.
_HULL = 1e-3  # By which the skin may bulge out between its points [m].
_MAX_SLOPE, _MAX_KEPT = 1.2, 1.5
"""Steps of a grid: between values next to each other; from the skin to values of the balls that are kept."""
_COARSER = 3  # Steps of a grid at which is found where it is near to triangles.
_NEAR = 3.0  # Steps of a grid from a surface within which distances from it are computed one by one.
_SOLID_SPACING = 0.4
"""Distance of points on triangles by which a solid is found, as a share of that of the skin's points."""
_BLOCK = 200_000  # Points asked for at once, which bounds memory.


@dataclass(frozen=True)
class SkinResolution:
    """Resolution of one link's skin, all in [m]."""

    nodes: float  # Distance of the balls' centres.
    ball: float  # Radius of the ball: hollows less than twice as wide count as solid.
    spacing: float  # No place on the skin is further than this from a point.
    grid: float  # Step of the solid's distance grid.


HAND = SkinResolution(nodes=0.001, ball=0.00125, spacing=0.0035, grid=0.0025)  # 5 mm apart on a square lattice
_FOOT = SkinResolution(nodes=0.002, ball=0.003, spacing=0.0055, grid=0.005)  # 8 mm apart
_LINK = SkinResolution(nodes=0.002, ball=0.003, spacing=0.0085, grid=0.006)  # 12 mm apart


def resolution_of(model: RobotModel, link: str) -> SkinResolution:
    """Return the resolution of a link's skin: finest for hands and forearms, which touch, then feet."""
    node = model.body_frames.frames[link].node
    elbows = [model.sites.frames[f"{side}_elbow"].node for side in SIDES]
    if any(model.supports[elbow, node] for elbow in elbows):
        return HAND
    return _FOOT if link in {model.body_of(f"{side}_foot") for side in SIDES} else _LINK


@dataclass(frozen=True, eq=False)
class OuterSkin:
    """Points on a link's outer skin and its solid, in the frame of the triangles."""

    points: Float[np.ndarray, "P 3"]  # In farthest-point order: the first n are a coarser skin [m].
    normals: Float[np.ndarray, "P 3"]  # Outward, of unit length.
    solid: DistanceGrid


@dataclass(frozen=True, eq=False)
class Outside:
    """Balls next to the skin that can come in from far away."""

    centres: Float[np.ndarray, "N 3"]  # [m]
    radii: Float[np.ndarray, "N"]  # Of the largest balls there that touch nothing [m].

    def free(self, points: Float[np.ndarray, "K 3"]) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K 3"]]:
        """Return the depths of points in the balls [m], negative in none, and the centre of the best ball."""
        ways, indices = scipy.spatial.KDTree(self.centres).query(points, k=min(_NEIGHBOURS, len(self.centres)))
        nearest = np.asarray(indices)
        depths = self.radii[nearest] - ways
        best = depths.argmax(axis=1)
        rows = np.arange(len(points))
        return depths[rows, best], self.centres[nearest[rows, best]]


def outer_skin(
    vertices: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    resolution: SkinResolution,
    outside: Outside | None = None,
    *,
    seed: int = 0,
) -> OuterSkin:
    """Return the outer skin of triangles, which need not be closed, manifold or wound alike.

    Args: `vertices`: [m]; `faces`: triangles; `resolution`: the resolution; `outside`: the outside, where it is known
    from more than these triangles; `seed`: of the places that are tried on the triangles.
    """
    outside = outside or outside_of(vertices, faces, resolution)
    candidates, normals, centre = _touched(vertices, faces, outside, 0.2 * resolution.spacing, seed)
    inward = np.einsum("ki,ki->k", centre - candidates, normals) < 0.0
    normals = np.where(inward[:, None], -normals, normals)
    chosen = farthest_points(candidates, resolution.spacing)
    solid = _solid(vertices, faces, outside, candidates, resolution)
    return OuterSkin(candidates[chosen], normals[chosen], solid)


def outer_solid(vertices: np.ndarray, faces: np.ndarray, resolution: SkinResolution) -> DistanceGrid:
    """Return the solid that the outer skin of triangles encloses, without points on the skin."""
    outside = outside_of(vertices, faces, resolution)
    candidates, _, _ = _touched(vertices, faces, outside, _SOLID_SPACING * resolution.spacing, 0)
    return _solid(vertices, faces, outside, candidates, resolution)


def _touched(
    vertices: np.ndarray, faces: np.ndarray, outside: Outside, spacing: float, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points of triangles that balls from outside touch [m], the triangles' normals, and the balls' centres."""
    points, normals = _samples(vertices, faces, spacing, seed)
    depth, centre = outside.free(points)
    touched = depth > -_TOUCH
    return points[touched], normals[touched], centre[touched]


def farthest_points(points: Float[np.ndarray, "K 3"], spacing: float) -> Int[np.ndarray, "P"]:
    """Return indices of points, each the farthest from those before, until all are within `spacing` [m] of one."""
    left = points.astype(np.float32)
    chosen = [int(((left - left.mean(axis=0)) ** 2).sum(axis=1).argmax())]
    nearest = np.full(len(left), np.inf, dtype=np.float32)
    while True:
        away = left - left[chosen[-1]]
        np.minimum(nearest, np.einsum("ki,ki->k", away, away), out=nearest)
        farthest = int(nearest.argmax())
        if nearest[farthest] <= spacing**2:
            return np.array(chosen)
        chosen.append(farthest)


def outside_of(vertices: np.ndarray, faces: np.ndarray, resolution: SkinResolution) -> Outside:
    """Return the outside of triangles alone."""
    origin, shape = grid_around(vertices, resolution.nodes, resolution.ball + 4 * resolution.nodes)
    nodes = grid_nodes(origin, resolution.nodes, shape)
    room = _near_distances(nodes, shape, vertices, faces, resolution.ball + 2.0 * resolution.nodes)
    reached = reached_from_afar((room > resolution.ball).reshape(shape)).reshape(-1)
    layer = reached & (room <= resolution.ball + 2.0 * resolution.nodes)
    return Outside(nodes[layer], room[layer])


def _near_distances(
    nodes: np.ndarray, shape: tuple[int, int, int], vertices: np.ndarray, faces: np.ndarray, most: float
) -> Float[np.ndarray, "N"]:
    """Return the distances of a grid's nodes from the nearest triangle [m], infinite where they are above `most`."""
    places = np.stack(np.meshgrid(*(np.arange(0, count, _COARSER) for count in shape), indexing="ij"), axis=-1)
    rows = np.ravel_multi_index(tuple(np.moveaxis(places, -1, 0)), shape)
    coarse = mesh_distances(nodes[rows.ravel()], vertices, faces).reshape(rows.shape)
    step = float(np.linalg.norm(nodes[1] - nodes[0]))
    nearest = [(np.arange(count) + _COARSER // 2) // _COARSER for count in shape]
    # The last nodes may have no coarse one on their other side.
    padded = np.pad(coarse, [(0, own[-1] + 1 - size) for own, size in zip(nearest, coarse.shape, strict=True)])
    near = (padded[np.ix_(*nearest)] <= most + np.sqrt(3.0) * (_COARSER // 2) * step).ravel()
    distances = np.full(len(nodes), np.inf)
    distances[near] = mesh_distances(nodes[near], vertices, faces)
    return distances


def reached_from_afar(fits: Bool[np.ndarray, "X Y Z"]) -> Bool[np.ndarray, "X Y Z"]:
    """Return where a ball can come to from the first node, by nodes where it fits."""
    parts = np.zeros(fits.shape, dtype=np.int32)
    scipy.ndimage.label(fits, output=parts)
    return parts == parts[0, 0, 0]


def _solid(
    vertices: np.ndarray, faces: np.ndarray, outside: Outside, skin: np.ndarray, resolution: SkinResolution
) -> DistanceGrid:
    origin, shape = grid_around(vertices, resolution.grid, 2 * resolution.grid)
    ways = _ways(skin, origin, resolution.grid, shape)
    near = ways <= _NEAR * resolution.grid
    nodes, to_skin = grid_nodes(origin, resolution.grid, shape)[near.ravel()], ways[near]
    to_mesh = mesh_distances(nodes, vertices, faces)
    free, _ = outside.free(nodes)
    # Balls are next to the skin: from farther outside they are nearer than it, from inside farther.
    beyond = (scipy.spatial.KDTree(outside.centres).query(nodes)[0] < to_skin) & (to_skin > outside.radii.min())
    # Balls alone say a little less than the way to the skin, but more than that to the rim of a plugged hollow.
    by_skin = np.abs(to_mesh - free) < 2.0 * _TOUCH
    values = np.where(free > 0.0, np.where(by_skin, to_mesh, free), np.maximum(free, -to_skin))
    values = np.where(beyond, np.maximum(free, to_skin), values)
    return ended_solid(DistanceGrid(origin, resolution.grid, _spread(values, near, resolution.grid)), skin)


def _ways(points: np.ndarray, origin: np.ndarray, step: float, shape: tuple[int, ...]) -> Float[np.ndarray, "X Y Z"]:
    """Return the distances of a grid's nodes from points on it [m]: exact near to them, else by the nodes that are."""
    near = np.zeros(shape, dtype=bool)
    near[tuple(np.clip(np.rint((points - origin) / step).astype(int), 0, np.array(shape) - 1).T)] = True
    near = scipy.ndimage.distance_transform_edt(~near) <= _NEAR + 1.0
    nodes = origin + step * np.argwhere(near)
    return _spread(scipy.spatial.KDTree(points).query(nodes)[0], near, step)


def _spread(values: np.ndarray, near: Bool[np.ndarray, "X Y Z"], step: float) -> Float[np.ndarray, "X Y Z"]:
    """Return signed distances [m] of all nodes, from the distances of nodes near to a surface."""
    whole = np.zeros(near.shape)
    whole[near] = values
    gaps, places = scipy.ndimage.distance_transform_edt(~near, return_indices=True)
    nearest = whole[tuple(places)]
    return np.where(nearest < 0.0, nearest - step * gaps, nearest + step * gaps)


def ended_solid(solid: DistanceGrid, skin: Float[np.ndarray, "P 3"]) -> DistanceGrid:
    """Return a solid that ends at the hull of its skin, with the distances from where inside and outside meet.

    Hollows that other links plug have no skin at the plug, and balls tell nothing of places behind it.
    """
    shape, step = solid.values.shape, solid.step
    nodes = grid_nodes(solid.origin, step, shape)
    values, inside = solid.values.copy(), solid.values < 0.0
    values[inside] = np.maximum(values[inside], _beyond_hull(nodes[inside.ravel()], skin, step))
    meet = []
    places = nodes.reshape(*shape, 3)
    for axis in range(3):
        (first, second), (start, end) = (
            (np.moveaxis(array, axis, 0)[:-1], np.moveaxis(array, axis, 0)[1:]) for array in (values, places)
        )
        change = (first < 0.0) != (second < 0.0)
        here, there = np.abs(first[change]), np.abs(second[change])
        # Two values that do not fit together tell no place between them.
        fit = here + there < _MAX_SLOPE * step
        share = np.where(fit, here / np.maximum(here + there, 1e-9), 0.5)[:, None]
        meet.append((1.0 - share) * start[change] + share * end[change])
    away = _ways(np.concatenate([*meet, skin]), solid.origin, step, shape)
    size = np.where(away < _MAX_KEPT * step, np.minimum(np.abs(values), away), away)
    return DistanceGrid(solid.origin, step, np.where(values < 0.0, -size, size).astype(np.float32))


def _beyond_hull(nodes: np.ndarray, skin: np.ndarray, step: float) -> Float[np.ndarray, "N"]:
    """Return the distances of nodes beyond the hull of a skin, or a little less [m]; negative inside."""
    try:
        planes = np.unique(scipy.spatial.ConvexHull(skin).equations.round(6), axis=0)
    except scipy.spatial.QhullError:  # A few points, or flat ones: all of a link that shows between others.
        return scipy.spatial.KDTree(skin).query(nodes)[0] - step
    beyond = np.full(len(nodes), -np.inf)
    for *normal, offset in planes:
        np.maximum(beyond, nodes @ np.array(normal) + offset, out=beyond)
    return beyond - _HULL


def mesh_distances(
    points: Float[np.ndarray, "K 3"], vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]
) -> Float[np.ndarray, "K"]:
    """Return the distances of points from the nearest triangle [m]."""
    import igl  # noqa: PLC0415  # takes a fifth of a second, and only robots without skin data need it

    tree = igl.AABB()
    tree.init(vertices, faces)
    blocks = [points[first : first + _BLOCK] for first in range(0, len(points), _BLOCK)]
    return np.sqrt(np.concatenate([tree.squared_distance(vertices, faces, block)[0] for block in blocks]))


def _samples(vertices: np.ndarray, faces: np.ndarray, spacing: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points about `spacing` [m] apart on triangles, corners among them, and the triangles' normals."""
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(across, axis=1)
    real = areas > 1e-12
    corners, across, areas = corners[real], across[real], areas[real]
    random = np.random.default_rng(seed)
    count = int(2.0 * areas.sum() / spacing**2) + 1
    owner = np.searchsorted(np.cumsum(areas), areas.sum() * (np.arange(count) + random.random(count)) / count)
    owner = np.minimum(owner, len(areas) - 1)
    a, b = np.sqrt(random.random((count, 1))), random.random((count, 1))
    inner = np.concatenate([1.0 - a, a * (1.0 - b), a * b], axis=1)
    points = np.einsum("kc,kci->ki", inner, corners[owner])
    thirds = corners.mean(axis=1, keepdims=True)
    points = np.concatenate([points, (0.99 * corners + 0.01 * thirds).reshape(-1, 3)])
    owner = np.concatenate([owner, np.repeat(np.arange(len(areas)), 3)])
    _, first = np.unique(np.floor(points / (0.5 * spacing)).astype(np.int64), axis=0, return_index=True)
    points, owner = points[first], owner[first]
    return points, across[owner] / (2.0 * areas[owner, None])


def grid_around(vertices: np.ndarray, step: float, margin: float) -> tuple[np.ndarray, tuple[int, int, int]]:
    """Return the first node of a grid around points [m], and its numbers of nodes along the axes."""
    low, high = vertices.min(axis=0) - margin, vertices.max(axis=0) + margin
    x, y, z = np.ceil((high - low) / step).astype(int) + 1
    return low, (int(x), int(y), int(z))


def grid_nodes(origin: np.ndarray, step: float, shape: tuple[int, int, int]) -> np.ndarray:
    """Return all nodes of a grid [m], in the order of its values."""
    return origin + step * np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3)
