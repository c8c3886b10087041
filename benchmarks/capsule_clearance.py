"""Capsules around the robot's links outside an object's sampled surface: the collision cost of the paper's Appendix B.

No solve of the package has it: surfaces in contact do better. `counted` puts it into the table of costs.


The paper says that 17 capsules are held against a sampled surface; the form of the cost is ours. Samples make no
solid: a capsule that is inside an object, further than its radius from the surface, costs nothing.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy
from jaxtyping import Float, Int

from hoi_retarget.numerics import se3
from hoi_retarget.objects.distance_field import surface_samples
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt import trajectory_terms
from hoi_retarget.retargeting.trajopt.problem import FrameRows
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.spec import SIDES

SPACING = 0.02  # [m] of the samples: one on every 4 cm^2, so that the cost is that of an area.


@dataclass(frozen=True)
class LinkCapsule:
    """All places within a radius of a segment that is fixed to a body: a coarse shape of one link."""

    body: str
    start: tuple[float, float, float]
    """Ends of the segment in the body's frame [m]."""
    end: tuple[float, float, float]
    radius: float
    """[m]"""


def mirrored_capsules(left: Iterable[LinkCapsule]) -> tuple[LinkCapsule, ...]:
    """Return the capsules of the left and the right limbs; the frames of their bodies are mirrored at y = 0."""
    return tuple(
        replace(
            capsule,
            body=capsule.body.replace("left_", f"{side}_"),
            start=(capsule.start[0], sign * capsule.start[1], capsule.start[2]),
            end=(capsule.end[0], sign * capsule.end[1], capsule.end[2]),
        )
        for side, sign in zip(SIDES, (1.0, -1.0), strict=True)
        for capsule in left
    )


CAPSULES = {
    # Least squares of the distance to the surface of each link's primitives.
    "unitree_g1": (
        LinkCapsule("pelvis", (0.0, 0.0, -0.088), (0.001, 0.0, -0.062), 0.072),
        LinkCapsule("torso_link", (0.008, 0.0, 0.086), (0.008, 0.0, 0.233), 0.094),
        LinkCapsule("torso_link", (0.006, 0.0, 0.333), (0.005, 0.0, 0.428), 0.061),  # neck and head
        *mirrored_capsules(
            (
                LinkCapsule("left_hip_roll_link", (0.052, 0.0, -0.011), (0.029, -0.001, -0.099), 0.049),
                LinkCapsule("left_hip_yaw_link", (0.008, 0.002, -0.027), (-0.070, -0.008, -0.185), 0.048),
                LinkCapsule("left_knee_link", (0.012, 0.010, -0.004), (0.010, -0.005, -0.267), 0.041),
                LinkCapsule("left_ankle_roll_link", (-0.036, 0.0, -0.011), (0.108, 0.0, -0.018), 0.028),
                LinkCapsule("left_shoulder_yaw_link", (-0.003, 0.0, 0.007), (0.012, -0.007, -0.084), 0.037),
                LinkCapsule("left_elbow_link", (0.009, 0.022, -0.003), (0.080, -0.001, -0.012), 0.031),
                LinkCapsule(
                    "left_wrist_yaw_link", (0.014, 0.005, 0.001), (0.145, -0.013, 0.007), 0.030
                ),  # with the hand
            )
        ),
    ),
    "unitree_h2": (
        LinkCapsule("pelvis", (-0.001, 0.014, -0.009), (-0.001, -0.014, -0.009), 0.090),
        LinkCapsule("torso_link", (0.001, 0.0, 0.086), (0.0, 0.0, 0.341), 0.105),
        LinkCapsule("head_yaw_link", (0.034, 0.0, -0.014), (0.005, 0.0, 0.051), 0.066),
        *mirrored_capsules(
            (
                LinkCapsule("left_hip_roll_link", (-0.036, -0.004, -0.023), (-0.033, -0.009, -0.043), 0.065),
                LinkCapsule("left_hip_yaw_link", (-0.001, 0.0, -0.027), (0.006, -0.001, -0.281), 0.061),
                LinkCapsule("left_knee_link", (0.011, -0.021, 0.007), (0.011, -0.025, -0.463), 0.040),
                LinkCapsule("left_ankle_pitch_link", (-0.047, 0.037, -0.024), (0.120, 0.038, -0.034), 0.030),
                LinkCapsule("left_shoulder_yaw_link", (-0.003, -0.002, -0.019), (0.012, 0.024, -0.124), 0.036),
                LinkCapsule("left_elbow_link", (-0.005, -0.028, 0.0), (0.109, -0.021, -0.015), 0.039),
                LinkCapsule(
                    "left_wrist_yaw_link", (0.007, 0.005, -0.003), (0.169, -0.025, 0.015), 0.036
                ),  # with the hand
            )
        ),
    ),
}


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


@contextmanager
def counted(weight: float) -> Iterator[None]:
    """Have the cost in every trajectory with a weight; at 0 nothing is computed."""

    def terms(_weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[CapsuleClearance]:
        for index, (geometry, scale) in enumerate(zip(targets.object_geometry, targets.object_scale, strict=True)):
            yield CapsuleClearance(
                f"capsule_clearance_{index}",
                CAPSULES[reference.model.spec.name],
                _samples_of(geometry, float(scale)),
                targets.object_pos[:, index].T,
                se3.quat_to_matrix(targets.object_quat[:, index]).transpose(1, 2, 0),
                weight,
            )

    costs = trajectory_terms.COSTS
    trajectory_terms.COSTS = (*costs, terms) if weight else costs
    try:
        yield
    finally:
        trajectory_terms.COSTS = costs
