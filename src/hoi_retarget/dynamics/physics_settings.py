"""Settings of physics and refinement. Nothing heavy is imported here, as the command line's help needs it."""

from dataclasses import dataclass
from math import isfinite
from typing import Literal

from hoi_retarget.errors import ArgumentError

FigureSet = Literal["all", "fast", "none"]
"""Figures that are computed; `fast` leaves out those that may take as long as the solve."""


@dataclass(frozen=True)
class Physics:
    """Physical facts that no recording tells."""

    object_mass: float | Literal["auto"] = "auto"
    """Mass of each object as the robot handles it [kg]; auto is from its size and its name."""
    hand_friction: float = 0.8
    """Coefficient of friction between the robot and objects: rubber on cardboard or plastic."""
    floor_friction: float = 0.8
    """Coefficient of friction between the floor and the robot's soles."""
    object_friction: float = 0.4
    """Coefficient of friction between objects and their support: cardboard, plastic or wood."""
    smoothing: float = 0.3
    """Time over which a motion's velocities and accelerations are taken [s]."""
    timestep: float = 0.01
    """Of the simulation [s]."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not isinstance(value, str) and not (isfinite(value) and value > 0):
                raise ArgumentError(f"physics: {name.replace('_', '-')} is {value}; it must be a positive number.")


@dataclass(frozen=True)
class Refinement:
    """The effort of a refinement."""

    horizon: float = 1.0
    """How far ahead plans look [s]."""
    iterations: int = 3
    """Rounds of samples of each plan."""
    samples: int = 128
    """In each round."""
    most_samples: int = 256
    """In each round where the robot is about to fall, or an object to be lost."""
    attempts: int = 2
    """Most tries, each with other random numbers, until nothing falls and objects are held strictly."""
    noise: float = 1.0
    """Of the samples; 1 is 0.1 rad at the arms' joints, 0.04 at others but fingers, 3 cm of the base."""

    def __post_init__(self) -> None:
        if not (isfinite(self.horizon) and 0.2 <= self.horizon <= 10.0):
            raise ArgumentError(f"refinement: horizon is {self.horizon}; it must be 0.2 to 10 seconds.")
        if not (isfinite(self.noise) and self.noise >= 0.0):
            raise ArgumentError(f"refinement: noise is {self.noise}; it must be a number that is not negative.")
        for name in ("iterations", "attempts"):
            if getattr(self, name) < 1:
                raise ArgumentError(f"refinement: {name} is {getattr(self, name)}; it must be 1 or more.")
        if not 8 <= self.samples <= self.most_samples:
            raise ArgumentError(
                f"refinement: samples is {self.samples} and most-samples {self.most_samples}; samples must be 8 or "
                "more, and no more than most-samples."
            )
