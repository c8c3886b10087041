"""Unitree G1 with 29 joints: what the package needs to know beside `unitree_g1.xml`."""

from pathlib import Path

from hoi_retarget.robots.spec import SIDES, IkRow, RobotSpec

_LEG_SPEEDS = {
    "hip_pitch": 32.0,
    "hip_roll": 20.0,
    "hip_yaw": 32.0,
    "knee": 20.0,
    "ankle_pitch": 30.0,
    "ankle_roll": 30.0,
}
_WAIST_SPEEDS = {"waist_yaw": 32.0, "waist_roll": 30.0, "waist_pitch": 30.0}
_ARM_SPEEDS = {
    "shoulder_pitch": 37.0,
    "shoulder_roll": 37.0,
    "shoulder_yaw": 37.0,
    "elbow": 37.0,
    "wrist_roll": 37.0,
    "wrist_pitch": 22.0,
    "wrist_yaw": 22.0,
}

# Bodies of which the maker's mesh file is called as the body is.
_MESH_PER_LINK = (
    *_LEG_SPEEDS,
    "shoulder_pitch",
    "shoulder_roll",
    "shoulder_yaw",
    "elbow",
    "wrist_roll",
    "wrist_pitch",
)

# A human joint's axes are x to the left, y up, z ahead in the T-pose; a link's are x ahead, y to the
# left, z up while the robot stands. The offsets turn the first into the second; those of the arms
# bring in that the human's arms are spread where the links' frames hang (upper arm, along -z) or
# point ahead (forearm and hand, along +x).
_TRUNK = (0.5, -0.5, -0.5, -0.5)
# The frame of the hip roll link is tilted by -10.02 degrees about y in the zero pose. The offset asks
# for -15.75 degrees: a straight human leg is followed with 5.7 degrees of hip flexion, which keeps the
# knee off its stretched position.
_HIP = (0.42678, -0.56379, -0.56379, -0.42678)
_LEFT_UPPER_ARM = (0.70711, 0.0, -0.70711, 0.0)
_RIGHT_UPPER_ARM = (0.0, 0.70711, 0.0, 0.70711)
_LEFT_FOREARM = (1.0, 0.0, 0.0, 0.0)
_RIGHT_FOREARM = (0.0, 0.0, 0.0, -1.0)

SPEC = RobotSpec(
    name="unitree_g1",
    title="Unitree G1, 29 joints",
    mjcf=Path(__file__).with_name("unitree_g1.xml"),
    provenance=(
        "Joint frames, axes, ranges, masses and inertias: g1_29dof_rev_1_0.xml; speed limits and efforts: "
        "g1_29dof_rev_1_0.urdf; both of unitreerobotics/unitree_ros, BSD-3-Clause. "
        "Palm frames, root scale and IK offsets: public retargeting tables for the G1. "
        "Geometry: primitives of this project."
    ),
    stature=1.4525,  # root scale 0.83 for a human of 1.75 m
    object_size="root",
    speed_limits={
        **{f"{side}_{joint}_joint": speed for side in SIDES for joint, speed in _LEG_SPEEDS.items()},
        **{f"{joint}_joint": speed for joint, speed in _WAIST_SPEEDS.items()},
        **{f"{side}_{joint}_joint": speed for side in SIDES for joint, speed in _ARM_SPEEDS.items()},
    },
    home={
        **{f"{side}_hip_pitch_joint": -0.15 for side in SIDES},
        **{f"{side}_knee_joint": 0.3 for side in SIDES},
        **{f"{side}_ankle_pitch_joint": -0.15 for side in SIDES},
        **{f"{side}_shoulder_pitch_joint": 0.15 for side in SIDES},
        "left_shoulder_roll_joint": 0.2,
        "right_shoulder_roll_joint": -0.2,
        **{f"{side}_elbow_joint": 1.1 for side in SIDES},
    },
    ik=(
        IkRow("pelvis", "pelvis", 100.0, 5.0, _TRUNK),
        IkRow("torso", "spine3", 0.0, 10.0, _TRUNK),
        *(IkRow(f"{side}_hip", f"{side}_hip", 10.0, 5.0, _HIP) for side in SIDES),
        *(IkRow(f"{side}_knee", f"{side}_knee", 10.0, 5.0, _TRUNK) for side in SIDES),
        *(IkRow(f"{side}_toe", f"{side}_foot", 100.0, 50.0, _TRUNK) for side in SIDES),
        IkRow("left_shoulder", "left_shoulder", 20.0, 5.0, _LEFT_UPPER_ARM),
        IkRow("right_shoulder", "right_shoulder", 20.0, 5.0, _RIGHT_UPPER_ARM),
        IkRow("left_elbow", "left_elbow", 25.0, 5.0, _LEFT_FOREARM),
        IkRow("right_elbow", "right_elbow", 25.0, 5.0, _RIGHT_FOREARM),
        IkRow("left_wrist", "left_wrist", 10.0, 5.0, _LEFT_FOREARM),
        IkRow("right_wrist", "right_wrist", 10.0, 5.0, _RIGHT_FOREARM),
    ),
    meshes={
        "pelvis": ("pelvis.STL", "pelvis_contour_link.STL"),
        "waist_yaw_link": ("waist_yaw_link_rev_1_0.STL",),
        "waist_roll_link": ("waist_roll_link_rev_1_0.STL",),
        "torso_link": ("torso_link_rev_1_0.STL", "logo_link.STL", "head_link.STL"),
        **{f"{side}_{link}_link": (f"{side}_{link}_link.STL",) for side in SIDES for link in _MESH_PER_LINK},
        **{f"{side}_wrist_yaw_link": (f"{side}_wrist_yaw_link.STL", f"{side}_rubber_hand.STL") for side in SIDES},
    },
)
