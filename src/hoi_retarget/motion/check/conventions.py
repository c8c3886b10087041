"""Orders in which programs write a robot's joints and bodies, and left and right among them."""

import numpy as np
from jaxtyping import Int

from hoi_retarget.robots.model import RobotModel

_OTHER = {"left": "right", "right": "left"}


def breadth_first_joints(model: RobotModel) -> Int[np.ndarray, "n"]:
    """Return the joints in Isaac Lab's order: by depth in the tree, each depth in the MJCF's order."""
    return np.concatenate(model.levels)


def breadth_first_bodies(model: RobotModel) -> Int[np.ndarray, "B"]:
    """Return the bodies in Isaac Lab's order, the root first."""
    depth = np.zeros(model.n + 1, dtype=int)
    for level, hinges in enumerate(model.levels, 1):
        depth[hinges + 1] = level
    return np.argsort(depth[model.bodies.nodes], kind="stable")


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
