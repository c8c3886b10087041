"""Pins: where a part of a person is to be in one frame, put there by hand."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import PARTS

PELVIS = "pelvis"
PINNED_PARTS: tuple[str, ...] = (*PARTS, PELVIS)

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class PosePin:
    """A part of a person in one frame."""

    person: int
    part: str
    frame: int
    position: Vector
    """In the world of the recording, at captured size [m]."""
    turn: Vector | None = None
    """Rotation vector in the world's axes, on top of the recorded part's rotation [degrees]; None leaves it free."""

    @property
    def key(self) -> tuple[int, int, int]:
        """The order of pins: by person, part and time."""
        return self.person, PINNED_PARTS.index(self.part), self.frame


def pinned_path(person: Person, part: str) -> Float[np.ndarray, "T 3"]:
    """Return where a part that can be pinned is [m]."""
    return person.position(part) if part == PELVIS else person.part_position(part)
