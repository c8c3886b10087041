"""Settings of physics: what no recording tells. Nothing heavy is imported here, as the command line's help needs it."""

from dataclasses import dataclass
from math import isfinite
from typing import Literal

from hoi_retarget.errors import ArgumentError


@dataclass(frozen=True)
class Physics:
    """What physics needs to know beside the motion."""

    object_mass: float | Literal["auto"] = "auto"
    """Mass of each object as the robot handles it [kg]; auto is from its size and what it is called."""
    hand_friction: float = 0.8
    """Coefficient of friction between the robot and objects: rubber on cardboard or plastic."""
    floor_friction: float = 0.8
    """Coefficient of friction between the floor and whatever stands on it."""
    smoothing: float = 0.3
    """Time over which a motion's velocities and accelerations are taken [s]."""
    timestep: float = 0.01
    """Of the simulation [s]."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not isinstance(value, str) and not (isfinite(value) and value > 0):
                raise ArgumentError(f"physics: {name.replace('_', '-')} is {value}; it must be a positive number.")
