"""Hands laid onto an object: as much palmar skin as may be on its surface, and nothing inside, both ways.

Gauss-Newton steps of all poses at once. Palmar skin is drawn by a cost that saturates with distance, first from afar
and then from near (Geman and McClure, 1987), so that what cannot touch gives up.
"""

import numpy as np
from jaxtyping import Float

from hoi_retarget.objects.surface_samples import SolidPoses
from hoi_retarget.retargeting.holds.hand_shape import HandPart, HandPoses, HandShape
from hoi_retarget.retargeting.surfaces.skin_points import MovingObject

FAR_REACHES = (0.03, 0.03, 0.015, 0.015, 0.008, 0.008)  # [m]; palmar skin is drawn from so far away, step by step.
NEAR_REACHES = (0.005, 0.005, 0.003, 0.003, 0.002, 0.002, 0.002, 0.002)
"""The same of hands that are about where they touch,"""
PLACED_REACHES = (0.004,) * 3  # and of those that touch already, nearly.
MARGIN = 0.0003  # [m] of clearance.
HARD = 3e6  # Cost of skin inside [1/m^2]; 1 cm2 of skin that touches is worth 1.
SOLID_FROM = 0.005
"""[m]; from this reach on, points of the object in the hand count, too: skin points do not see rods and edges."""
LONGEST_SHIFT, LONGEST_TURN = 0.02, 0.2  # Of one step [m, rad].
TOUCHING_STEPS = 5


def settled(  # noqa: PLR0913, PLR0917  # the parts of a search
    hand: HandShape,
    moving_object: MovingObject,
    start: HandPoses,
    wanted: HandPoses,
    stiffness: Float[np.ndarray, "6 6"],
    reaches: tuple[float, ...],
) -> HandPoses:
    """Return the poses at which hands come to rest.

    Args: `hand`: its shape; `moving_object`: the object; `start`: of each search; `wanted`: poses to stay near: one, or
    as many; `stiffness`: of the pull to these [1/m^2, 1/rad^2], as that of `pull`; `reaches`: of the steps [m].
    """
    poses = start
    for reach in reaches:
        # From afar every second point will do.
        every = 1 if reach <= SOLID_FROM else 2
        palmar, outer = poses.placed(hand.palmar[::every]), poses.placed(hand.outer[::every])
        points = np.concatenate([palmar, outer], axis=1)
        distances, slopes = moving_object.field.distances_and_slopes(points.reshape(-1, 3))
        residuals, slopes = distances.reshape(points.shape[:2]) - MARGIN, slopes.reshape(points.shape)
        draws = (
            1e4
            * every
            * hand.draws[::every]
            * reach**2
            / (reach**2 + np.maximum(residuals[:, : palmar.shape[1]], 0.0) ** 2) ** 2
        )
        weights = np.where(residuals < 0.0, HARD, np.pad(draws, ((0, 0), (0, outer.shape[1]))))
        rows = np.concatenate([slopes, np.cross(points - poses.positions[:, None], slopes)], axis=2)
        weighted = weights[:, :, None] * rows
        matrix = weighted.transpose(0, 2, 1) @ rows + stiffness
        gradient = np.einsum("nki,nk->ni", weighted, residuals) + poses.away_from(wanted) @ stiffness
        if reach <= SOLID_FROM:
            for part in hand.parts:
                squares, products = moving_object.samples.inside(_part_poses(part, poses), poses.positions)
                matrix += HARD * squares
                gradient += HARD * products
        poses = poses.moved(_limited(-np.linalg.solve(matrix, gradient[:, :, None])[:, :, 0]))
    return poses


def pull(spread: tuple[float, float]) -> Float[np.ndarray, "6 6"]:
    """Return the stiffness with which distances [m, rad] cost half as much as 1 cm2 of touch is worth."""
    return np.diag(np.repeat(np.square(spread) ** -1.0, 3))


def _limited(twists: Float[np.ndarray, "N 6"]) -> Float[np.ndarray, "N 6"]:
    sizes = np.linalg.norm(twists.reshape(-1, 2, 3), axis=2)
    shares = np.minimum(1.0, [LONGEST_SHIFT, LONGEST_TURN] / np.maximum(sizes, 1e-12))
    return twists * np.repeat(shares, 3, axis=1)


def touching(hand: HandShape, moving_object: MovingObject, poses: HandPoses) -> HandPoses:
    """Return poses shifted until they just touch: to the nearest surface where off it, the palm's way where inside."""
    every = np.arange(len(poses.positions))
    for _ in range(TOUCHING_STEPS):
        points = np.concatenate([poses.placed(hand.palmar), poses.placed(hand.outer)], axis=1)
        nearest = moving_object.field.distances(points.reshape(-1, 3)).reshape(points.shape[:2]).argmin(axis=1)
        shifts = depths(hand, moving_object, poses)[:, None]
        # Skin in a thin board may be nearer to its far side: the palm is outside.
        from_points = np.where(shifts > 0.0, poses.positions, points[every, nearest])
        _, normals = moving_object.field.distances_and_normals(from_points)
        poses = HandPoses(poses.positions + shifts * normals, poses.rotations)
    return poses


def _part_poses(part: HandPart, poses: HandPoses) -> SolidPoses:
    """Return the poses of a link of the hand on the object."""
    origins = poses.rotations @ part.origin + poses.positions
    return SolidPoses(part.skin.solid, poses.rotations @ part.rotation, origins, part.skin.centre, part.skin.radius)


def skin_depths(hand: HandShape, moving_object: MovingObject, poses: HandPoses) -> Float[np.ndarray, "N"]:
    """Return the depth of hands' coarse skin in the object [m]; negative outside."""
    points = poses.placed(hand.outer)
    return -moving_object.field.distances(points.reshape(-1, 3)).reshape(points.shape[:2]).min(axis=1)


def depths(hand: HandShape, moving_object: MovingObject, poses: HandPoses) -> Float[np.ndarray, "N"]:
    """Return the depth of hands and object in each other [m]; negative where they are apart."""
    deepest = skin_depths(hand, moving_object, poses)
    for part in hand.parts:
        deepest = np.maximum(deepest, -moving_object.samples.least_distances(_part_poses(part, poses)))
    return deepest


def touching_areas(
    hand: HandShape, moving_object: MovingObject, poses: HandPoses, near: float
) -> Float[np.ndarray, "N"]:
    """Return the area of palmar skin within a distance of the surface [m^2]."""
    points = poses.placed(hand.palmar)
    distances = moving_object.field.distances(points.reshape(-1, 3)).reshape(points.shape[:2])
    return (np.abs(distances) <= near) @ hand.areas
