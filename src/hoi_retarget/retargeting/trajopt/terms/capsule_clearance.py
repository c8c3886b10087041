"""Capsules around the robot's links outside an object's sampled surface: the collision cost of the paper's Appendix B.

The paper says that 17 capsules are held against a sampled surface; the form of the cost is ours. Samples make no
solid: a capsule that is inside an object, further than its radius from the surface, costs nothing.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float, Int

from hoi_retarget.errors import ArgumentError
from hoi_retarget.numerics import se3
from hoi_retarget.objects.distance_field import surface_samples
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.problem import FrameRows
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.spec import LinkCapsule

SPACING = 0.02  # [m] of the samples: one on every 4 cm^2, so that the cost is that of an area.


@dataclass(frozen=True, eq=False)
class CapsuleClearance:
    """`max(0, (radius^2 - distance^2) / (2 radius))^2` [m^2] of every capsule's segment and sample.

    Near the capsule's surface this is the squared depth. Unlike that, it is smooth on the segment, where the shortest
    way out changes sides: solves take fewer iterations.
    """

    name: str
    capsules: tuple[LinkCapsule, ...]
    samples: "scipy.spatial.KDTree"
    """Of the object's surface, in the object's frame [m]."""
    object_position: Float[np.ndarray, "3 T"]
    object_rotation: Float[np.ndarray, "3 3 T"]
    weight: float

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return the rows of every capsule that has a sample inside, in any frame: as many as the most in one frame."""
        found = (self._rows_of(capsule, kinematics) for capsule in self.capsules)
        return tuple(rows for rows in found if rows is not None)

    def _rows_of(self, capsule: LinkCapsule, kinematics: Kinematics) -> FrameRows | None:
        start, end = np.array(capsule.start), np.array(capsule.end)
        middle = kinematics.model.body_frames.frames[capsule.body].of(0.5 * (start + end), np.eye(3))
        half = np.einsum("ijt,j->it", kinematics.orientation(middle), 0.5 * (end - start))
        centres, halves = (
            np.einsum("jit,jt->ti", self.object_rotation, vector)
            for vector in (kinematics.point(middle) - self.object_position, half)
        )
        times, levers, ways = _pairs_within(self.samples, centres, halves, capsule.radius)
        if not times.size:
            return None
        frames, first, column = np.unique(times, return_index=True, return_inverse=True)
        row = np.arange(len(times)) - first[column]
        residual = np.zeros((row.max() + 1, len(frames)))
        by_linear, by_angular = (np.zeros((len(residual), 3, len(frames))) for _ in range(2))
        turns = self.object_rotation[:, :, times]
        residual[row, column] = 0.5 * (capsule.radius - np.einsum("pi,pi->p", ways, ways) / capsule.radius)
        by_linear[row, :, column] = -np.einsum("ijp,pj->pi", turns, ways) / capsule.radius
        by_angular[row, :, column] = -np.einsum("ijp,pj->pi", turns, np.cross(levers, ways)) / capsule.radius
        return FrameRows(middle, residual, by_linear, by_angular, self.weight, frames)


def _pairs_within(
    samples: "scipy.spatial.KDTree", centres: Float[np.ndarray, "T 3"], halves: Float[np.ndarray, "T 3"], radius: float
) -> tuple[Int[np.ndarray, "P"], Float[np.ndarray, "P 3"], Float[np.ndarray, "P 3"]]:
    """Return, for every sample in the capsule, by frames: the frame, and two vectors [m].

    They lead from the segment's middle to its point nearest to the sample, and from the sample to that point.
    """
    reach = radius + float(np.linalg.norm(halves, axis=1).max(initial=0.0))
    beyond = np.maximum(samples.mins - centres, centres - samples.maxes)
    near = np.flatnonzero((beyond < reach).all(axis=1))
    found = samples.query_ball_point(centres[near], reach)
    frames = np.repeat(near, [len(each) for each in found])
    chosen = np.concatenate([np.zeros(0, dtype=int), *(np.array(each, dtype=int) for each in found)])
    offsets, axes = samples.data[chosen] - centres[frames], halves[frames]
    along = np.einsum("pi,pi->p", offsets, axes) / np.maximum(np.einsum("pi,pi->p", axes, axes), 1e-12)
    levers = along.clip(-1.0, 1.0)[:, None] * axes
    ways = levers - offsets
    inside = np.einsum("pi,pi->p", ways, ways) < radius**2
    return frames[inside], levers[inside], ways[inside]


@lru_cache(maxsize=32)
def _samples_of(geometry: ObjectGeometry, scale: float) -> "scipy.spatial.KDTree":
    return scipy.spatial.KDTree(scale * surface_samples(surface_of(geometry), SPACING / scale))


def capsule_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[CapsuleClearance]:
    """Yield the robot's capsules outside every object, where their weight asks for it.

    Raises:
        ArgumentError: The robot's specification has no capsules.
        GeometryError: An object's mesh cannot be read.
    """
    if weights.capsule_clearance == 0:
        return
    spec = reference.model.spec
    if not spec.capsules:
        raise ArgumentError(
            f"weight capsule_clearance is {weights.capsule_clearance}, but {spec.name} has no capsules; "
            "give its specification some, or leave the weight at 0."
        )
    for index, (geometry, scale) in enumerate(zip(targets.object_geometry, targets.object_scale, strict=True)):
        yield CapsuleClearance(
            f"capsule_clearance_{index}",
            spec.capsules,
            _samples_of(geometry, float(scale)),
            targets.object_pos[:, index].T,
            se3.quat_to_matrix(targets.object_quat[:, index]).transpose(1, 2, 0),
            weights.capsule_clearance,
        )
