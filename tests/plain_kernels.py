"""What kernels in C compute, in numpy, one point at a time or all at once: for comparison."""

from itertools import product

import numpy as np
from scipy.spatial import KDTree

from hoi_retarget.kernels.shape import OVERRATED, DistanceGrid
from hoi_retarget.objects.distance_field import STEPS, DistanceField, starts_of
from hoi_retarget.objects.surface_samples import SolidPoses

CORNERS = np.array(list(product((0, 1), repeat=3)))
LAST_PLACE = 1.0 - 1e-12  # Of the cells' extent: the last place that is in a cell.


def trilinear(corners: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return values and slopes at places in cells; differences of samples are of single precision, as these are."""
    x, y, z = place
    by_z = corners[1::2] - corners[0::2]
    along_z = corners[0::2] + z * by_z
    by_y = along_z[1::2] - along_z[0::2]
    along_y = along_z[0::2] + y * by_y
    by_x = along_y[1] - along_y[0]
    by_z = by_z[0::2] + y * (by_z[1::2] - by_z[0::2])
    slopes = np.stack([by_x, by_y[0] + x * (by_y[1] - by_y[0]), by_z[0] + x * (by_z[1] - by_z[0])])
    return along_y[0] + x * by_x, slopes


def grid_distances(grid: DistanceGrid, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    last = np.array(grid.values.shape)[:, None] - 1
    at = (points.T - grid.origin[:, None]) / grid.step
    inside = np.clip(at, 0.0, last)
    first = np.minimum(inside.astype(int), last - 1)
    corners = grid.values[tuple(first[:, None] + CORNERS.T[:, :, None])]
    beyond = (at - inside) * grid.step
    distances, slopes = trilinear(corners, inside - first)
    away = np.sqrt((beyond**2).sum(axis=0))
    # Beyond the grid, along an axis, only the way to it grows.
    slopes = np.where(beyond != 0.0, 0.0, slopes / grid.step) + beyond / np.maximum(away, 1e-12)
    return distances + away, slopes.T


def field_distances(field: DistanceField, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    cells, starts = field.cells, starts_of(field.cells.levels)
    at = (points.T - cells.origin[:, None]) / cells.edge
    counts = np.array(cells.levels.shape)
    inside = np.clip(at, 0.0, counts[:, None] * LAST_PLACE)
    beyond = (at - inside) * cells.edge
    cell = inside.astype(int)
    index = (cell[0] * counts[1] + cell[1]) * counts[2] + cell[2]
    steps = STEPS[cells.levels.reshape(-1)[index]]
    place, nodes = (inside - cell) * steps, steps + 1
    local = place.astype(int)
    corner = local[:, None] + CORNERS.T[:, :, None]
    corners = cells.samples[starts[index] + (corner[0] * nodes + corner[1]) * nodes + corner[2]]
    distances, slopes = trilinear(corners, place - local)
    slopes *= steps / cells.edge
    # Along an axis in which a point is beyond the cells, the distance within them does not change.
    outside = beyond.any(axis=0)
    longer = np.where(outside, np.sqrt(distances**2 + (beyond**2).sum(axis=0)), distances)
    way = np.where(beyond == 0, distances * slopes, beyond) / np.where(outside, longer, 1.0)
    return longer, np.where(outside, way, slopes).T


def seen(points: np.ndarray, poses: SolidPoses, beyond: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return indices and places in the solid's frame of the points around it, for each pose."""
    around = KDTree(points).query_ball_point(poses.centres, poses.radius + beyond)
    found = [np.array(sorted(index), dtype=int) for index in around]
    every = zip(found, poses.rotations, poses.origins, strict=True)
    return [(index, (points[index] - origin) @ turn) for index, turn, origin in every]


def node_distances(grid: DistanceGrid, points: np.ndarray) -> np.ndarray:
    """Return the distances of the nearest nodes, with the way to the grid."""
    last = np.array(grid.values.shape) - 1
    at = np.clip(np.rint((points - grid.origin) / grid.step), 0, last)
    outside = ((points < grid.origin) | (points > grid.origin + grid.step * last)).any(axis=1)
    ways = np.linalg.norm(points - (grid.origin + grid.step * at), axis=1)
    return grid.values[tuple(at.astype(int).T)] + np.where(outside, ways, 0.0)


def nearest(points: np.ndarray, poses: SolidPoses, near: float, count: int, apart: float) -> list[list[int]]:
    chosen = []
    for index, places in seen(points, poses, near):
        distances = node_distances(poses.solid, places)
        order = np.argsort(distances, kind="stable")
        left, own = index[order[distances[order] < near]], []
        while left.size and len(own) < count:
            own.append(int(left[0]))
            left = left[np.linalg.norm(points[left] - points[left[0]], axis=1) >= apart]
        chosen.append(own)
    return chosen


def least_distances(points: np.ndarray, poses: SolidPoses) -> np.ndarray:
    return np.array([grid_distances(poses.solid, at)[0].min(initial=np.inf) for _, at in seen(points, poses, 0.0)])


def inside(points: np.ndarray, poses: SolidPoses, pivots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    squares, products = np.zeros((len(pivots), 6, 6)), np.zeros((len(pivots), 6))
    for pose, (index, places) in enumerate(seen(points, poses, 0.0)):
        distances, slopes = grid_distances(poses.solid, places)
        deep = distances < 0.0
        away = -slopes[deep] @ poses.rotations[pose].T
        along = np.concatenate([away, np.cross(points[index[deep]] - pivots[pose], away)], axis=1)
        squares[pose], products[pose] = along.T @ along, along.T @ distances[deep]
    return squares, products


def ways_out(points: np.ndarray, poses: SolidPoses, directions: np.ndarray, most: float, step: float) -> np.ndarray:
    ways = np.zeros(len(directions))
    for pose, (_, places) in enumerate(seen(points, poses, most)):
        back, distances = directions[pose] @ poses.rotations[pose], grid_distances(poses.solid, places)[0]
        while ways[pose] < most:
            left = places[distances <= min(OVERRATED * ways[pose], most)]
            depth = -grid_distances(poses.solid, left - ways[pose] * back)[0].min(initial=0.0)
            if depth <= 0.0:
                break
            ways[pose] += max(depth, step)
    return np.minimum(ways, most)


def spread(distances: np.ndarray, points: np.ndarray, count: int, apart: float) -> list[int]:
    """Return the nearest point, then the nearest that is not close to it, and so on, while there are any."""
    chosen, left = [], np.isfinite(distances)
    while left.any() and len(chosen) < count:
        chosen.append(int(np.where(left, distances, np.inf).argmin()))
        left &= np.linalg.norm(points - points[chosen[-1]], axis=1) >= apart
    return chosen
