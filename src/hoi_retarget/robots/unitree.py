"""Facts that the Unitree robots share: the names of their links."""

from collections.abc import Mapping
from typing import TypeVar

from hoi_retarget.robots.spec import SIDES

Value = TypeVar("Value")
LIMB_MESHES = (
    *("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll"),
    *("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch"),
)
"""Links of a limb with the manufacturer's mesh file of the same name."""
_SIGNS = (("left", 1.0), ("right", -1.0))


def joint_values(limbs: Mapping[str, Value], trunk: Mapping[str, Value]) -> dict[str, Value]:
    """Return values by joint, from those of a limb's joints, alike on both sides, and those of the trunk's."""
    return {
        **{f"{side}_{joint}_joint": value for side in SIDES for joint, value in limbs.items()},
        **{f"{joint}_joint": value for joint, value in trunk.items()},
    }


def mirrored(values: Mapping[str, float]) -> dict[str, float]:
    """Return values by joint, in their unit, from those of the left joints, which have the other sign on the right."""
    return {f"{side}_{joint}_joint": sign * value for joint, value in values.items() for side, sign in _SIGNS}


def limb_meshes(suffix: str, hand: str) -> dict[str, tuple[str, ...]]:
    """Return the manufacturer's mesh files of the limbs by body, with the hand's."""
    files = {f"{side}_{link}_link": (f"{side}_{link}_link{suffix}",) for side in SIDES for link in LIMB_MESHES}
    hands = {f"{side}_wrist_yaw_link": (f"{side}_wrist_yaw_link{suffix}", f"{side}_{hand}{suffix}") for side in SIDES}
    return {**files, **hands}
