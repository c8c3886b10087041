"""The IK table of robots whose sites have the axes that docs/robots.md names: how their limbs follow a human's."""

from hoi_retarget.robots.spec import SIDES, IkRow

Quat = tuple[float, float, float, float]

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
