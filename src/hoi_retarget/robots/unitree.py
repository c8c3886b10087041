"""Facts that the Unitree robots share: the names of their links, and how their limbs follow a human's."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TypeVar

from hoi_retarget.robots.spec import SIDES, Capsule, IkRow

Quat = tuple[float, float, float, float]
Value = TypeVar("Value")

LIMB_MESHES = (
    *("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll"),
    *("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch"),
)
"""Links of a limb of which the vendor's mesh file is called as the link is."""

# A human joint's axes are x to the left, y up, z ahead in the T-pose; a link's are x ahead, y to the
# left, z up while the robot stands. The offsets turn the first into the second; those of the arms
# bring in that the human's arms are spread where the links' frames hang (upper arm, along -z) or
# point ahead (forearm and hand, along +x).
TRUNK: Quat = (0.5, -0.5, -0.5, -0.5)
_LEFT_UPPER_ARM: Quat = (0.70711, 0.0, -0.70711, 0.0)
_RIGHT_UPPER_ARM: Quat = (0.0, 0.70711, 0.0, 0.70711)
_LEFT_FOREARM: Quat = (1.0, 0.0, 0.0, 0.0)
_RIGHT_FOREARM: Quat = (0.0, 0.0, 0.0, -1.0)


def ik_table(hip: Quat) -> tuple[IkRow, ...]:
    """Return the IK table, with the rotation offset of the hips."""
    return (
        IkRow("pelvis", "pelvis", 100.0, 5.0, TRUNK),
        IkRow("torso", "spine3", 0.0, 10.0, TRUNK),
        *(IkRow(f"{side}_hip", f"{side}_hip", 10.0, 5.0, hip) for side in SIDES),
        *(IkRow(f"{side}_knee", f"{side}_knee", 10.0, 5.0, TRUNK) for side in SIDES),
        *(IkRow(f"{side}_toe", f"{side}_foot", 100.0, 50.0, TRUNK) for side in SIDES),
        IkRow("left_shoulder", "left_shoulder", 20.0, 5.0, _LEFT_UPPER_ARM),
        IkRow("right_shoulder", "right_shoulder", 20.0, 5.0, _RIGHT_UPPER_ARM),
        IkRow("left_elbow", "left_elbow", 25.0, 5.0, _LEFT_FOREARM),
        IkRow("right_elbow", "right_elbow", 25.0, 5.0, _RIGHT_FOREARM),
        IkRow("left_wrist", "left_wrist", 10.0, 5.0, _LEFT_FOREARM),
        IkRow("right_wrist", "right_wrist", 10.0, 5.0, _RIGHT_FOREARM),
    )


def joint_values(limbs: Mapping[str, Value], trunk: Mapping[str, Value]) -> dict[str, Value]:
    """Return values by joint, from those of a limb's joints, alike on both sides, and those of the trunk's."""
    return {
        **{f"{side}_{joint}_joint": value for side in SIDES for joint, value in limbs.items()},
        **{f"{joint}_joint": value for joint, value in trunk.items()},
    }


def mirrored(values: Mapping[str, float]) -> dict[str, float]:
    """Return values by joint, from those of the left joints, which have the other sign on the right."""
    return {f"{side}_{joint}_joint": sign * value for joint, value in values.items() for side, sign in _SIGNS}


def limb_meshes(suffix: str, hand: str) -> dict[str, tuple[str, ...]]:
    """Return the vendor's mesh files by body, of the limbs, with the one that hangs from the wrist."""
    files = {f"{side}_{link}_link": (f"{side}_{link}_link{suffix}",) for side in SIDES for link in LIMB_MESHES}
    hands = {f"{side}_wrist_yaw_link": (f"{side}_wrist_yaw_link{suffix}", f"{side}_{hand}{suffix}") for side in SIDES}
    return {**files, **hands}


def mirrored_capsules(left: Iterable[Capsule]) -> tuple[Capsule, ...]:
    """Return the capsules of the left limbs and those of the right ones, whose bodies' frames are mirrored at y = 0."""
    return tuple(
        replace(
            capsule,
            body=capsule.body.replace("left_", f"{side}_"),
            start=(capsule.start[0], sign * capsule.start[1], capsule.start[2]),
            end=(capsule.end[0], sign * capsule.end[1], capsule.end[2]),
        )
        for side, sign in _SIGNS
        for capsule in left
    )


_SIGNS = (("left", 1.0), ("right", -1.0))
