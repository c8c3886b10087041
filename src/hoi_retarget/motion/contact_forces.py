"""Forces of contacts along a motion, as they were simulated."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import ClipError
from hoi_retarget.numerics.arrays import check_shape, frozen


@dataclass(frozen=True, eq=False)
class ContactForces:
    """Sums of contact forces on F bodies over T frames, in the world.

    Those are the robot's links, with all that they touch, and objects, with the floor alone. Raises `ClipError` when
    shapes disagree, or a number is not finite.
    """

    bodies: tuple[str, ...]
    forces: Float[np.ndarray, "T F 3"]
    """[N]; zero where nothing is touched."""
    points: Float[np.ndarray, "T F 3"]
    """Where they act [m]: the mean of the contacts' places, weighted by force."""

    def __post_init__(self) -> None:
        for name in ("forces", "points"):
            values = frozen(getattr(self, name))
            object.__setattr__(self, name, values)
            check_shape("motion", f"contact {name}", values, (len(self.forces), len(self.bodies), 3))
            if not np.isfinite(values).all():
                raise ClipError(f"motion: contact {name} hold numbers that are not finite.")
