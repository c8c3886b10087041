"""Left and right among a robot's joints and bodies."""

import numpy as np
from jaxtyping import Int

_OTHER = {"left": "right", "right": "left"}


def mirrored(names: tuple[str, ...], parts: tuple[str, ...] = ("",)) -> Int[np.ndarray, "n"]:
    """Return where each name's counterpart on the other side is; only names that contain one of `parts` change."""
    index = {name: place for place, name in enumerate(names)}
    places = []
    for name in names:
        side, _, rest = name.partition("_")
        other = f"{_OTHER.get(side, side)}_{rest}"
        places.append(index[other] if other in index and any(part in name for part in parts) else index[name])
    return np.array(places)


def is_sideways(joint: str) -> bool:
    """Return whether a mirrored motion turns a joint the other way round: roll and yaw, not pitch, knee and elbow."""
    return "roll" in joint or "yaw" in joint


LEGS = ("hip", "knee", "ankle")
ARMS = ("shoulder", "elbow", "wrist")
