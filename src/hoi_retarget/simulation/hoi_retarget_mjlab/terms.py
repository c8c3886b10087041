"""Observations, rewards and terminations of objects and contacts; E environments, O objects, C links."""

from typing import Any, cast

import torch
from mjlab.utils.lab_api.math import quat_apply_inverse, quat_error_magnitude

from .command import ObjectMotionCommand, turned_between

FORCE_UNIT = 100.0  # Forces are observed in units of this [N].


def _command(env: Any) -> ObjectMotionCommand:
    return cast(ObjectMotionCommand, env.command_manager.get_term("motion"))


def _seen(command: ObjectMotionCommand, vectors: torch.Tensor) -> torch.Tensor:
    """Return vectors (E, N, 3) in the axes of the robot's torso, flat."""
    turn = command.robot_anchor_quat_w[:, None].expand(-1, vectors.shape[1], -1)
    return quat_apply_inverse(turn, vectors).flatten(1)


def _poses_seen(command: ObjectMotionCommand, pos: torch.Tensor, quat: torch.Tensor) -> torch.Tensor:
    turn = command.robot_anchor_quat_w[:, None].expand_as(quat)
    places = _seen(command, pos - command.robot_anchor_pos_w[:, None])
    return torch.cat([places, turned_between(turn, quat).flatten(1)], dim=1)


# Observations


def object_pose(env: Any) -> torch.Tensor:
    """Return objects' poses as the torso sees them, (E, 9 O)."""
    command = _command(env)
    return _poses_seen(command, command.simulated_object_pos_w, command.simulated_object_quat_w)


def object_target(env: Any) -> torch.Tensor:
    """Return the reference's poses of objects as the torso sees them, (E, 9 O)."""
    command = _command(env)
    return _poses_seen(command, command.object_pos_w, command.object_quat_w)


def object_velocity(env: Any) -> torch.Tensor:
    """Return objects' velocities in the torso's axes, linear and angular, (E, 6 O)."""
    command = _command(env)
    return torch.cat([_seen(command, command.of_objects(name)) for name in ("lin_vel", "ang_vel")], dim=1)


def contact_labels(env: Any) -> torch.Tensor:
    """Return which link should touch which object now, (E, C O)."""
    return _command(env).labels.flatten(1).float()


def contact_offsets(env: Any) -> torch.Tensor:
    """Return the ways from links that should touch to their places on the objects, else zeros, (E, 3 C)."""
    command = _command(env)
    ways = command.link_targets_w - command.link_points_w
    return _seen(command, ways * command.labels.any(dim=2)[..., None])


def contact_forces(env: Any) -> torch.Tensor:
    """Return how hard links touch objects, (E, C O)."""
    return _command(env).touching("force").flatten(1) / FORCE_UNIT


# Rewards


def object_position(env: Any, std: float) -> torch.Tensor:
    """Return 1 where objects are at their places."""
    command = _command(env)
    away = (command.object_pos_w - command.simulated_object_pos_w).square().sum(dim=-1)
    return torch.exp(-away.mean(dim=1) / std**2)


def object_orientation(env: Any, std: float) -> torch.Tensor:
    """Return 1 where objects are turned as they should be."""
    command = _command(env)
    turned = quat_error_magnitude(command.object_quat_w, command.simulated_object_quat_w).square()
    return torch.exp(-turned.mean(dim=1) / std**2)


def contact_place(env: Any, std: float) -> torch.Tensor:
    """Return 1 where all links that should touch are at their places on the objects, or none should."""
    command = _command(env)
    away = (command.link_targets_w - command.link_points_w).square().sum(dim=-1)
    return _mean_over(torch.exp(-away / std**2), command.labels.any(dim=2))


def contact_made(env: Any) -> torch.Tensor:
    """Return the share of contacts that should be and are; 1 where none should be."""
    command = _command(env)
    wanted = command.labels.flatten(1)
    return _mean_over((command.touching().flatten(1) > 0).float(), wanted)


def contact_unwanted(env: Any) -> torch.Tensor:
    """Return the number of links that touch objects that they should not touch."""
    command = _command(env)
    return ((command.touching() > 0) & ~command.labels).flatten(1).sum(dim=1).float()


def _mean_over(values: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    count = wanted.sum(dim=1)
    mean = (values * wanted).sum(dim=1) / count.clamp(min=1)
    return torch.where(count > 0, mean, torch.ones_like(mean))


# Terminations


def object_away(env: Any, threshold: float) -> torch.Tensor:
    """Return whether an object is farther than the threshold from its place [m]."""
    command = _command(env)
    away = torch.linalg.norm(command.object_pos_w - command.simulated_object_pos_w, dim=-1)
    return (away > threshold).any(dim=1)


def object_turned(env: Any, threshold: float) -> torch.Tensor:
    """Return whether an object is turned by more than the threshold from the reference [rad]."""
    command = _command(env)
    turned = quat_error_magnitude(command.object_quat_w, command.simulated_object_quat_w)
    return (turned > threshold).any(dim=1)
