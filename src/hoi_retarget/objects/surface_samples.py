"""Samples of an object's surface, and those of them that are near a solid, or in it.

Rods and edges pass between the points of a skin. Their own points are seen from the solid of the link.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float, Int

from hoi_retarget.kernels.point_cells import Placed, PointCells
from hoi_retarget.kernels.shape import OVERRATED, DistanceGrid


@dataclass(frozen=True, eq=False)
class SolidPoses:
    """One solid in N poses in the frame of a surface, and a ball around it."""

    solid: DistanceGrid
    rotations: Float[np.ndarray, "N 3 3"]
    origins: Float[np.ndarray, "N 3"]  # [m]
    middle: Float[np.ndarray, "3"]  # Of the ball, in the solid's frame [m].
    radius: float  # [m]

    @cached_property
    def centres(self) -> Float[np.ndarray, "N 3"]:
        """The middles in the frame of the surface [m]."""
        return self.rotations @ self.middle + self.origins


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """Points all over a surface, in its frame."""

    points: Float[np.ndarray, "K 3"]  # [m]

    @cached_property
    def tree(self) -> "scipy.spatial.KDTree":
        """The points, to be searched."""
        return scipy.spatial.KDTree(self.points)

    @cached_property
    def _cells(self) -> PointCells:
        return PointCells.of(self.points)

    def nearest(
        self, poses: SolidPoses, near: float, count: int, apart: float
    ) -> tuple[Int[np.ndarray, "N K"], Int[np.ndarray, "N"]]:
        """Return the samples nearest to a solid in each pose, and their number.

        There are `count` at most, none further than `near` [m], and any two are `apart` or more [m].
        """
        return self._cells.nearest(_placed(poses), near, count, apart)

    def least_distances(self, poses: SolidPoses) -> Float[np.ndarray, "N"]:
        """Return the least of the distances of samples in the ball from the solid [m]; infinite without any."""
        return self._cells.deepest(_placed(poses))

    def inside(
        self, poses: SolidPoses, pivots: Float[np.ndarray, "N 3"]
    ) -> tuple[Float[np.ndarray, "N 6 6"], Float[np.ndarray, "N 6"]]:
        """Return `J^T J` and `J^T d` of distances of samples in the solid by its shift and turn about pivots [m]."""
        return self._cells.inside(_placed(poses), pivots)

    def ways_out(
        self, poses: SolidPoses, directions: Float[np.ndarray, "N 3"], most: float, least_step: float
    ) -> tuple[Float[np.ndarray, "N"], Float[np.ndarray, "N 3"]]:
        """Return the ways of the solid along directions until no sample is in it [m], and its nearest sample before.

        No way is longer than `most` [m]; the steps of the search are `least_step` or more [m].
        """
        wider = replace(poses, radius=poses.radius + most)
        return self._cells.ways_out(_placed(wider), poses.middle, directions, (most, least_step, OVERRATED))

    def around(self, poses: SolidPoses, pose: int) -> tuple[Float[np.ndarray, "K 3"], Float[np.ndarray, "K 3"]]:
        """Return the samples in the ball of one pose, in the frame of the surface and in the solid's [m]."""
        found = self.points[self.tree.query_ball_point(poses.centres[pose], poses.radius)]
        return found, (found - poses.origins[pose]) @ poses.rotations[pose]


def _placed(poses: SolidPoses) -> Placed:
    return Placed(poses.solid.compiled, poses.rotations, poses.origins, poses.centres, poses.radius)
