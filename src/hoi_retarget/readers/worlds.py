"""Turns what sources record into a world with z up."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Float

from hoi_retarget.human.person import Person
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectTrack

_HALF = float(np.sqrt(0.5))
TURN: Mapping[str, np.ndarray] = MappingProxyType(
    {
        "z": np.array([1.0, 0.0, 0.0, 0.0]),
        "y": np.array([_HALF, _HALF, 0.0, 0.0]),
        "-y": np.array([_HALF, -_HALF, 0.0, 0.0]),
    }
)
"""The source's up axis -> rotation, wxyz, that makes it z: (x, y, z) becomes (x, -z, y) for y, (x, z, -y) for -y."""


@dataclass(frozen=True, eq=False)
class Turn:
    """A rotation of everything, and the height of the floor after it, which becomes 0."""

    quat: Float[np.ndarray, "4"]
    """wxyz"""
    floor: float = 0.0
    """[m]"""

    def of(
        self, positions: Float[np.ndarray, "... 3"], quats: Float[np.ndarray, "... 4"]
    ) -> tuple[Float[np.ndarray, "... 3"], Float[np.ndarray, "... 4"]]:
        """Return positions [m] and rotations, wxyz, after it."""
        return se3.rotate(self.quat, positions) - [0.0, 0.0, self.floor], se3.quat_multiply(self.quat, quats)


@dataclass(frozen=True, eq=False)
class World:
    """A source's world: which way is up in it, and how it becomes one with z up."""

    up: str
    """The axis that becomes z, for errors."""
    turns: tuple[Turn, ...]
    """One after the other."""
    note: str = ""
    """What was found of it."""

    @classmethod
    def of_axis(cls, up: str) -> "World":
        """Return the world in which one of the axes of `TURN` is up."""
        return cls(up, () if up == "z" else (Turn(TURN[up]),))

    def turned_person(self, person: Person) -> Person:
        """Return a person of this world in one with z up."""
        for turn in self.turns:
            positions, quats = turn.of(person.joint_positions, person.joint_quats)
            person = replace(person, joint_positions=positions, joint_quats=quats)
        return person

    def turned_object(self, track: ObjectTrack) -> ObjectTrack:
        """Return an object of this world in one with z up."""
        for turn in self.turns:
            positions, quats = turn.of(track.positions, track.quats)
            track = replace(track, positions=positions, quats=quats)
        return track
