"""Inverse dynamics with contacts: the least forces at soles, hands and objects that a motion needs, frame by frame.

In every frame, forces in friction pyramids at the points in contact are chosen by non-negative least squares such that

1. robot and touched objects move as they do: the wrench that is missing is least, relative to their weights;
2. no torque is over its limit, unless the limbs' own weight and motion need it;
3. among such forces, joint torques relative to their limits, and forces, are least.

A force at a hand acts on the robot, and its opposite on the object. Nothing is simulated: what is missing is what no
controller could supply.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.dynamics.actuators import actuators_of
from hoi_retarget.dynamics.contact_points import ContactPoint, contact_points
from hoi_retarget.dynamics.inverse_dynamics import (
    GRAVITY,
    Movement,
    RequiredRobotWrench,
    RequiredWrench,
    movement_of,
    required_object_wrench,
    required_robot_wrench,
)
from hoi_retarget.dynamics.object_bodies import ObjectBody, object_body
from hoi_retarget.dynamics.object_support import PYRAMID_EDGES, friction_edges
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.kernels.library import at, function, real
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.robots.model import Kinematics, RobotModel

_LEAST_FORCES = function("least_forces", "pppppiiiip", allocates=True)
_BLOCK_FRAMES = 200  # Frames at once: 40 MB.


@dataclass(frozen=True, eq=False)
class Forces:
    """Forces that a motion needs over T frames; K contact points, O objects, n joints."""

    points: tuple[ContactPoint, ...]
    on_robot: Float[np.ndarray, "T K 3"]
    """Force at each point [N], in the world: on the robot, or on the object where the robot has no part in it."""
    missing: Float[np.ndarray, "T 6"]
    """Force [N] and torque about the centre of mass [N m] that the robot lacks, in the world."""
    missing_at_objects: Float[np.ndarray, "T O 6"]
    """The same of objects; NaN where they are not judged: the robot does not touch them, or somebody else does, too."""
    torques: Float[np.ndarray, "T n"]  # Of the joints, with these forces [N m].
    unlimited_torques: Float[np.ndarray, "T n"]  # Torques of the joints if they had no limits [N m].
    limits: Float[np.ndarray, "n"]  # [N m]
    mass: float  # Of the robot [kg].
    height: float  # Of the standing robot's centre of mass [m].
    bodies: tuple[ObjectBody, ...]
    lengths: Float[np.ndarray, "O"]  # Distance from each object's centre of mass to its furthest point [m].

    @property
    def missing_share(self) -> Float[np.ndarray, "T"]:
        """Ratio of the robot's missing wrench to its weight, about the lean of its centre of mass in radians."""
        return _share(self.missing, self.mass, self.height)

    @property
    def missing_share_at_objects(self) -> Float[np.ndarray, "T O"]:
        """Ratio of each object's missing wrench to its weight; NaN where it is not judged."""
        shares = [
            _share(self.missing_at_objects[:, index], body.mass, length)
            for index, (body, length) in enumerate(zip(self.bodies, self.lengths.tolist(), strict=True))
        ]
        return np.stack(shares, axis=1) if shares else np.zeros((len(self.missing), 0))

    @property
    def torque_shares(self) -> Float[np.ndarray, "T n"]:
        """Joint torques over their limits, as shares without unit, computed without the limits."""
        return np.abs(self.unlimited_torques) / self.limits


def forces_of(
    motion: Motion,
    model: RobotModel,
    geometries: Sequence[ObjectGeometry],
    physics: Physics = Physics(),
    *,
    held_by_others: Bool[np.ndarray, "T O"] | None = None,
) -> Forces:
    """Return the forces that a motion needs.

    Args: `motion`: the motion; `model`: its robot; `geometries`: shapes of its objects, in their order; `physics`:
    masses and frictions; `held_by_others`: where somebody else touches an object, too; nobody does by default. Raises
    `RobotError`: a base carries the robot, or a joint's torque has no limit; `GeometryError`: an object's mesh cannot
    be read.
    """
    actuators = actuators_of(model)
    movement = movement_of(motion.qpos, motion.fps, physics.smoothing)
    poses = np.concatenate([motion.object_pos, motion.object_quat], axis=2)
    paths = [movement_of(pose, motion.fps, physics.smoothing) for pose in np.moveaxis(poses, 1, 0)]
    bodies = tuple(
        object_body(name, geometry, scale, physics)
        for name, geometry, scale in zip(motion.object_names, geometries, motion.object_scale.tolist(), strict=True)
    )
    kinematics = model.forward(movement.qpos)
    points = contact_points(_smoothed(motion, movement, paths), kinematics, geometries)
    judged = _labelled(motion)
    if held_by_others is not None:
        judged = judged & ~held_by_others
    robot = required_robot_wrench(model, movement)
    objects = [required_object_wrench(body, path) for body, path in zip(bodies, paths, strict=True)]
    lengths = [
        float(np.linalg.norm(scale * geometry.points - body.centre, axis=1).max())
        for body, geometry, scale in zip(bodies, geometries, motion.object_scale.tolist(), strict=True)
    ]
    problem = _Problem(robot, tuple(objects), judged, actuators.torque, points, np.array(lengths), physics)
    found = [
        problem.solve(_Levers.of(points, kinematics, slice(first, first + _BLOCK_FRAMES)))
        for first in range(0, motion.frames, _BLOCK_FRAMES)
    ]
    return Forces(
        points,
        *(frozen(np.concatenate(parts)) for parts in zip(*found, strict=True)),
        limits=actuators.torque,
        mass=robot.mass,
        height=robot.height,
        bodies=bodies,
        lengths=frozen(lengths),
    )


def _smoothed(motion: Motion, movement: Movement, paths: Sequence[Movement]) -> Motion:
    if not paths:
        return motion.with_qpos(movement.qpos)
    poses = np.stack([path.qpos for path in paths], axis=1)
    return replace(motion.with_qpos(movement.qpos), object_pos=poses[:, :, :3], object_quat=poses[:, :, 3:])


def _labelled(motion: Motion) -> Bool[np.ndarray, "T O"]:
    labelled = [motion.labelled(index).any(axis=1) for index in range(len(motion.object_names))]
    return np.stack(labelled, axis=1) if labelled else np.zeros((motion.frames, 0), dtype=bool)


@dataclass(frozen=True, eq=False)
class _Levers:
    """Effects of forces at the K points in F frames."""

    frames: slice
    position: Float[np.ndarray, "F K 3"]
    normal: Float[np.ndarray, "F K 3"]
    active: Bool[np.ndarray, "F K"]
    jacobian: Float[np.ndarray, "F K 3 n"]  # Of the robot's links by the joints; zero where a point is on none.

    @classmethod
    def of(cls, points: Sequence[ContactPoint], kinematics: Kinematics, frames: slice) -> "_Levers":
        """Return the levers in some frames."""
        n, links = kinematics.model.n, dict.fromkeys(point.link for point in points if point.link is not None)
        there = kinematics.window(frames)
        jacobians = {link: there.jacobian(link)[:, :, 6:] for link in links}
        origins = {link: there.point(link).T for link in links}
        count = len(there.qpos)
        jacobian = np.zeros((count, len(points), 3, n))
        for number, point in enumerate(points):
            if point.link is not None:
                lever = point.position[frames] - origins[point.link]
                linear, angular = jacobians[point.link][:, :3], jacobians[point.link][:, 3:]
                jacobian[:, number] = linear - se3.skew(lever) @ angular
        empty = np.zeros((count, 0, 3))
        return cls(
            frames,
            np.stack([point.position[frames] for point in points], axis=1) if points else empty,
            np.stack([point.normal[frames] for point in points], axis=1) if points else empty,
            np.stack([point.active[frames] for point in points], axis=1) if points else empty[:, :, 0] > 0,
            jacobian,
        )


@dataclass(frozen=True, eq=False)
class _Problem:
    """Least forces of a whole motion, of which some frames are solved at a time."""

    robot: RequiredRobotWrench
    objects: tuple[RequiredWrench, ...]
    judged: Bool[np.ndarray, "T O"]
    limits: Float[np.ndarray, "n"]
    points: tuple[ContactPoint, ...]
    lengths: Float[np.ndarray, "O"]
    physics: Physics

    def solve(self, levers: _Levers) -> tuple[np.ndarray, ...]:
        """Return forces, missing wrenches of the robot and of the objects, and both torques, of some frames."""
        frames, free_torques = levers.frames, self.robot.torques[levers.frames]
        limited, unlimited = self._forces(levers)
        found = limited[:, :, None]
        missing = self.robot.wrench[frames] - self._on_robot(found, levers).sum(axis=(1, 2))
        lacking = np.full((len(found), len(self.objects), 6), np.nan)
        for index, required in enumerate(self.objects):
            given = self._on_object(found, levers, index).sum(axis=(1, 2))
            lacking[:, index] = np.where(self.judged[frames, index, None], required.wrench[frames] - given, np.nan)
        torques = [free_torques - np.einsum("fkin,fki->fn", levers.jacobian, forces) for forces in (limited, unlimited)]
        return limited, missing, lacking, *torques

    def _forces(self, levers: _Levers) -> tuple[Float[np.ndarray, "F K 3"], Float[np.ndarray, "F K 3"]]:
        """Return the least forces [N], and those without limits of torques."""
        edges = self._edges(levers)
        bodies: list[tuple[RequiredWrench, float]] = [(self.robot, self.robot.height)]
        bodies += list(zip(self.objects, self.lengths.tolist(), strict=True))
        wrenches = [self._on_robot(edges, levers)]
        wrenches += [self._on_object(edges, levers, index) for index in range(len(self.objects))]
        given = [_scaled(wrench, body.mass, length) for wrench, (body, length) in zip(wrenches, bodies, strict=True)]
        required = [_scaled(body.wrench[levers.frames], body.mass, length) for body, length in bodies]
        effort = np.einsum("fkin,fkei->fken", levers.jacobian, edges) / self.limits
        counted = np.insert(self.judged[levers.frames], 0, values=True, axis=1).repeat(6, axis=1)
        frames, weight = len(edges), self.robot.mass * GRAVITY
        effects = weight * np.concatenate(given, axis=-1).reshape(frames, -1, counted.shape[1]) * counted[:, None]
        norms = least_forces(
            effects,
            np.where(counted, np.concatenate(required, axis=-1), 0.0),
            weight * effort.reshape(frames, effects.shape[1], len(self.limits)),
            self.robot.torques[levers.frames] / self.limits,
            levers.active.repeat(PYRAMID_EDGES, axis=1),
        )
        limited, unlimited = np.einsum("sfke,fkei->sfki", weight * norms.reshape(2, *edges.shape[:3]), edges)
        return limited, unlimited

    def _edges(self, levers: _Levers) -> Float[np.ndarray, "F K 4 3"]:
        """Return the edges of friction pyramids: forces of which the normal part is one; alike where a point slides."""
        friction = np.array([_friction(point, self.physics) for point in self.points])[:, None, None]
        edges = friction_edges(levers.normal, friction)
        for number, point in enumerate(self.points):
            if point.braking is not None:
                braking = point.braking[levers.frames]
                braked = levers.normal[:, number] + friction[number, 0] * braking
                edges[:, number] = np.where(np.any(braking, axis=1)[:, None, None], braked[:, None], edges[:, number])
        return edges

    def _on_robot(self, forces: Float[np.ndarray, "F K E 3"], levers: _Levers) -> Float[np.ndarray, "F K E 6"]:
        """Return the wrenches of forces on the robot."""
        return _wrenches(forces, levers, self.robot, [float(point.link is not None) for point in self.points])

    def _on_object(
        self, forces: Float[np.ndarray, "F K E 3"], levers: _Levers, index: int
    ) -> Float[np.ndarray, "F K E 6"]:
        """Return the wrenches of forces on an object: of those on the robot, the opposite ones."""
        signs = [0.0 if point.object != index else 1.0 if point.link is None else -1.0 for point in self.points]
        return _wrenches(forces, levers, self.objects[index], signs)


def _wrenches(
    forces: Float[np.ndarray, "F K E 3"], levers: _Levers, required: RequiredWrench, signs: Sequence[float]
) -> Float[np.ndarray, "F K E 6"]:
    """Return forces at the points times signs, with their torques about a body's centre of mass."""
    signed = np.array(signs).reshape(-1, 1, 1) * forces
    arm = levers.position - required.centre[levers.frames, None]
    return np.concatenate([signed, np.cross(arm[:, :, None], signed)], axis=-1)


def _friction(point: ContactPoint, physics: Physics) -> float:
    if point.link is None:
        return physics.object_friction
    return physics.floor_friction if point.on_floor else physics.hand_friction


def _scaled(wrench: Float[np.ndarray, "*any 6"], mass: float, length: float) -> Float[np.ndarray, "*any 6"]:
    """Return wrenches over a body's weight, and over its weight times a length."""
    return wrench / (mass * GRAVITY * np.array([1.0, 1.0, 1.0, length, length, length]))


def _share(wrench: Float[np.ndarray, "T 6"], mass: float, length: float) -> Float[np.ndarray, "T"]:
    return np.linalg.norm(_scaled(wrench, mass, length), axis=1)


def least_forces(
    effects: Float[np.ndarray, "F N H"],
    targets: Float[np.ndarray, "F H"],
    efforts: Float[np.ndarray, "F N n"],
    free_torques: Float[np.ndarray, "F n"],
    active: Bool[np.ndarray, "F N"],
) -> Float[np.ndarray, "2 F N"]:
    """Return norms of forces, none negative, with limits on torques and without, in units of the robot's weight.

    They come nearest to the targets, with torques between -1 and 1 where that is possible; of all such forces they are
    those of least effort: a torque at its limit counts a thousandth of a missing weight, a force of the robot's weight
    a tenth of that.

    Args: `effects`: of a unit of each of N forces on the bodies; `targets`: required wrenches of the bodies; `efforts`:
    what a unit of each force takes from the torques, relative to their limits; `free_torques`: torques without forces,
    relative to their limits; `active`: which forces there are.
    """
    parts = [real(part) for part in (effects, targets, efforts, free_torques)]
    there = np.ascontiguousarray(active, dtype=np.int8)
    found = np.empty((2, *there.shape))
    _LEAST_FORCES(*map(at, (*parts, there)), *effects.shape, parts[2].shape[2], at(found))
    return found
