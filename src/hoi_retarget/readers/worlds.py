"""Worlds of sources, their turn to z up, and the check that a person of a person's size stands along z."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import ClipError
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectTrack

_HALF = float(np.sqrt(0.5))
TURN: Mapping[str, np.ndarray] = {
    "z": np.array([1.0, 0.0, 0.0, 0.0]),
    "y": np.array([_HALF, _HALF, 0.0, 0.0]),
    "-y": np.array([_HALF, -_HALF, 0.0, 0.0]),
}
"""The source's up axis -> rotation, wxyz, that makes it z: (x, y, z) becomes (x, -z, y) for y, (x, z, -y) for -y."""


@dataclass(frozen=True, eq=False)
class Turn:
    """A rotation of everything, and the height of the floor after it, which becomes 0."""

    quat: Float[np.ndarray, "4"]  # wxyz
    floor: float = 0.0  # [m]

    def of(
        self, positions: Float[np.ndarray, "... 3"], quats: Float[np.ndarray, "... 4"]
    ) -> tuple[Float[np.ndarray, "... 3"], Float[np.ndarray, "... 4"]]:
        """Return positions [m] and rotations, wxyz, after it."""
        return se3.rotate(self.quat, positions) - [0.0, 0.0, self.floor], se3.quat_multiply(self.quat, quats)


@dataclass(frozen=True, eq=False)
class World:
    """A source's world: its up axis, and the turns that make it one with z up."""

    up: str  # The axis that becomes z, for errors.
    turns: tuple[Turn, ...]  # One after the other.
    note: str = ""  # A note of it.

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


MIN_HEIGHT, MAX_HEIGHT = 0.5, 3.0  # [m]; people whose skeleton is smaller or larger are given in another unit.
FLOOR_RANGE = (-0.05, 0.3)  # [m]; heights of the lowest joint of a person on the floor, be it lying.
MIN_SHARE_ON_FLOOR = 0.8  # Of the frames in which a person who does not stand upright is on the floor.


def check_upright(path: Path, person: Person, up_axis: str, *, may_lie: bool = False) -> None:
    """Raise `ClipError` unless a person has a person's size and is upright in most frames.

    `path`: the recording, for errors; `person`: in a world with z up; `up_axis`: the recording's own axis that became
    z, for errors; `may_lie`: whether the person may as well be on a floor near 0.
    """
    if not MIN_HEIGHT <= person.height <= MAX_HEIGHT:
        raise ClipError(
            f"{path}: person {person.name!r} would be {person.height:.4g} m tall: the recording is in another unit "
            "than metres, or its body is of another model. Check the betas and the model."
        )
    axis = standing_axis(person.joint_positions)
    if axis != "z" and not (may_lie and share_on_floor(person) >= MIN_SHARE_ON_FLOOR):
        raise ClipError(
            f"{path}: person {person.name!r} stands along {axis}, turned to z up from {up_axis} up as the format has "
            "it: this copy has another axis up. Turn it as its makers give it."
        )


def share_on_floor(person: Person) -> float:
    """Return the share of the frames in which the lowest joint is as near to z = 0 as that of a person on the floor."""
    lowest = person.joint_positions[..., 2].min(axis=1)
    return float(np.mean((lowest >= FLOOR_RANGE[0]) & (lowest <= FLOOR_RANGE[1])))


def standing_axis(positions: Float[np.ndarray, "T 52 3"]) -> str:
    """Return the axis along which it is farthest from feet to head in most frames, `-z` for upside down."""
    feet = [JOINT_INDEX[f"{side}_ankle"] for side in ("left", "right")]
    upward = positions[:, JOINT_INDEX["head"]] - positions[:, feet].mean(axis=1)
    shares = np.bincount(np.abs(upward).argmax(axis=1), minlength=3) / len(upward)
    axis = int(shares.argmax())
    if shares[axis] <= 0.5:
        return "z"
    return f"{'-' if np.median(upward[:, axis]) < 0 else ''}{'xyz'[axis]}"
