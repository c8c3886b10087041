"""Whether a person is of a person's size and stands along z, with the head up."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import ClipError
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX

SHORTEST, TALLEST = 0.5, 3.0
"""[m]; people whose skeleton is smaller or larger are given in another unit."""
FLOOR_RANGE = (-0.05, 0.3)
"""[m]; heights of the lowest joint of a person on the floor, be it lying."""
LEAST_ON_FLOOR = 0.8
"""Of the frames in which a person who does not stand upright is on the floor."""


def check_upright(path: Path, person: Person, up_axis: str, *, may_lie: bool = False) -> None:
    """Raise `ClipError` unless a person has a person's size and is upright in most frames.

    Args:
        path: the recording, for errors.
        person: in a world with z up.
        up_axis: the recording's own axis that became z, for errors.
        may_lie: whether the person may as well be on a floor near 0.
    """
    if not SHORTEST <= person.height <= TALLEST:
        raise ClipError(
            f"{path}: person {person.name!r} would be {person.height:.4g} m tall: the recording is in another unit "
            "than metres, or its body is of another model. Check the betas and the model."
        )
    axis = standing_axis(person.joint_positions)
    if axis != "z" and not (may_lie and share_on_floor(person) >= LEAST_ON_FLOOR):
        raise ClipError(
            f"{path}: person {person.name!r} stands along {axis}, turned to z up from {up_axis} up as the format has "
            "it: this copy has another axis up. Turn it as its makers give it."
        )


def share_on_floor(person: Person) -> float:
    """Return the part of the frames in which the lowest joint is as near to z = 0 as that of a person on the floor."""
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
