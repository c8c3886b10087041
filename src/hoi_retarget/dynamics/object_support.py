"""Whether hands at given places can move an object as it moves, with the floor's help; no robot is needed.

What slides over the floor is braked: friction there acts against the motion, and pushes nothing.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Bool, Float

from hoi_retarget.dynamics.inverse_dynamics import GRAVITY, RequiredWrench, movement_of, required_object_wrench
from hoi_retarget.dynamics.object_bodies import object_body
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.robots.skin import extreme_points

SLIDING_MPS = 0.04  # A point that moves faster over the floor slides [m/s].
FLOOR_HEIGHT, LOWEST_RANGE = 0.015, 0.005
"""A point is on the floor up to this height, and so far above the lowest one [m]."""
FLOOR_POINTS, PYRAMID_EDGES = 6, 4
_FRAMES_AT_ONCE = 500
EFFORT = 1e-3  # Of forces of the object's weight, against that of a missing weight.


@dataclass(frozen=True, eq=False)
class ObjectLoad:
    """The wrench that an object needs over T frames, and the floor that may help."""

    required: RequiredWrench
    length: float  # From its centre of mass to its furthest point [m].
    floor_points: Float[np.ndarray, "T K 3"]  # [m]
    floor_edges: Float[np.ndarray, "T K 4 3"]
    """Edges of the floor's friction pyramids, with a normal part of one; of points that slide all are the same."""
    on_floor: Bool[np.ndarray, "T K"]

    def hand_forces(
        self, frame: int, points: Float[np.ndarray, "P 3"], inward: Float[np.ndarray, "P 3"], friction: float
    ) -> tuple[float, Float[np.ndarray, "P 3"]]:
        """Return the share of the object's weight that hands and floor cannot give, and the forces of the hands [N].

        `points`: of the hands on the surface, in the world [m]; `inward`: directions into the object there.
        """
        on_floor, weight = self.on_floor[frame], self.required.mass * GRAVITY
        hands = friction_edges(inward, friction).reshape(-1, 3)
        forces = np.concatenate([hands, self.floor_edges[frame, on_floor].reshape(-1, 3)])
        places = np.repeat(np.concatenate([points, self.floor_points[frame, on_floor]]), PYRAMID_EDGES, axis=0)
        unit = np.repeat([1.0, 1.0 / self.length], 3)
        effects = np.concatenate([forces, np.cross(places - self.required.centre[frame], forces)], axis=1) * unit
        needed = self.required.wrench[frame] / weight * unit
        rows = np.concatenate([effects.T, EFFORT * np.eye(len(effects))])
        norms = np.zeros(0)
        if len(effects):
            norms, _ = scipy.optimize.nnls(rows, np.concatenate([needed, np.zeros(len(effects))]))
        given = (weight * norms[: len(hands), None] * hands).reshape(-1, PYRAMID_EDGES, 3).sum(axis=1)
        return float(np.linalg.norm(needed - effects.T @ norms)), given


def object_load(  # noqa: PLR0913, PLR0917  # the parts of a load
    name: str,
    geometry: ObjectGeometry,
    scale: float,
    path: tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 4"]],
    fps: float,
    physics: Physics,
) -> ObjectLoad:
    """Return the load of one object.

    Args: `name`: its name, which tells its density; `geometry`: its shape at captured size; `scale`: its size over
    captured size; `path`: its positions [m] and rotations (wxyz); `fps`: frames a second; `physics`: masses and
    frictions.
    """
    body = object_body(name, geometry, scale, physics)
    movement = movement_of(np.concatenate(path, axis=1), fps, physics.smoothing)
    corners = scale * extreme_points(geometry.points)
    length = float(np.linalg.norm(corners - body.centre, axis=1).max())
    rotations = se3.quat_to_matrix(movement.qpos[:, 3:7])
    blocks = np.split(rotations[:, 2], range(_FRAMES_AT_ONCE, len(rotations), _FRAMES_AT_ONCE))
    lowest = np.concatenate([np.argsort(up @ corners.T, axis=1, kind="stable")[:, :FLOOR_POINTS] for up in blocks])
    own = movement.qpos[:, 2, None] + np.einsum("tj,tkj->tk", rotations[:, 2], corners[lowest])
    on_floor = own < np.minimum(FLOOR_HEIGHT, own[:, :1] + LOWEST_RANGE)
    arms = np.einsum("tij,tkj->tki", rotations, corners[lowest])
    turning = se3.rotate(movement.qpos[:, 3:7], movement.qvel[:, 3:6])
    velocity = movement.qvel[:, None, :3] + np.cross(turning[:, None], arms)
    upward = np.broadcast_to([0.0, 0.0, 1.0], arms.shape)
    edges = friction_edges(upward, physics.object_friction)
    braking = braking_directions(velocity)
    braked = upward + physics.object_friction * braking
    edges = np.where(np.any(braking, axis=-1)[..., None, None], braked[:, :, None], edges)
    required = required_object_wrench(body, movement)
    return ObjectLoad(required, length, movement.qpos[:, None, :3] + arms, edges, on_floor)


def braking_directions(velocity: Float[np.ndarray, "*many 3"]) -> Float[np.ndarray, "*many 3"]:
    """Return the directions of friction on the floor for velocities of points [m/s]; zero where they do not slide."""
    speed = np.linalg.norm(velocity[..., :2], axis=-1, keepdims=True)
    against = -velocity * [1.0, 1.0, 0.0] / np.maximum(speed, 1e-9)
    return np.where(speed > SLIDING_MPS, against, 0.0)


def friction_edges(
    normals: Float[np.ndarray, "*many 3"], friction: float | Float[np.ndarray, "*same 1 1"]
) -> Float[np.ndarray, "*many 4 3"]:
    """Return the edges of friction pyramids around unit normals: forces with a normal part of one."""
    aside = np.where(np.abs(normals[..., :1]) < 0.8, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    first = np.cross(normals, aside)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    second = np.cross(normals, first)
    return normals[..., None, :] + friction * np.stack([first, -first, second, -second], axis=-2)
