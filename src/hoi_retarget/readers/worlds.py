"""Turns what sources record into a world with z up."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

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


def turned_person(person: Person, up: str) -> Person:
    """Return a person in a world with z up, from one where `up` is."""
    turn = TURN[up]
    return replace(
        person,
        joint_positions=se3.rotate(turn, person.joint_positions),
        joint_quats=se3.quat_multiply(turn, person.joint_quats),
    )


def turned_object(track: ObjectTrack, up: str) -> ObjectTrack:
    """Return an object in a world with z up, from one where `up` is."""
    turn = TURN[up]
    return replace(track, positions=se3.rotate(turn, track.positions), quats=se3.quat_multiply(turn, track.quats))
