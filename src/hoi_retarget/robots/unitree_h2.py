"""Unitree H2 with 31 joints: what the package needs to know beside `unitree_h2.xml`."""

from pathlib import Path

from hoi_retarget.robots.spec import SIDES, IkRow, RobotSpec

_LEG_SPEEDS = {
    "hip_pitch": 20.0,
    "hip_roll": 20.0,
    "hip_yaw": 20.0,
    "knee": 20.0,
    "ankle_roll": 100.7,
    "ankle_pitch": 28.61,
}
_TRUNK_SPEEDS = {
    "waist_yaw": 28.375,
    "waist_roll": 28.375,
    "waist_pitch": 28.375,
    "head_pitch": 10.0,
    "head_yaw": 10.0,
}
_ARM_SPEEDS = {
    "shoulder_pitch": 21.9,
    "shoulder_roll": 18.7,
    "shoulder_yaw": 18.7,
    "elbow": 18.7,
    "wrist_roll": 18.7,
    "wrist_pitch": 37.7,
    "wrist_yaw": 37.7,
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
# left, z up while the robot stands. In the zero pose of the H2 all the links below are aligned with
# the pelvis: legs straight and vertical (hip to knee within 0.5 degrees, knee to ankle within 2.1),
# upper arms hanging along -z, forearms pointing ahead along +x. So one offset serves trunk and legs,
# and those of the arms bring in that the human's arms are spread in the T-pose.
_TRUNK = (0.5, -0.5, -0.5, -0.5)
_LEFT_UPPER_ARM = (0.70711, 0.0, -0.70711, 0.0)
_RIGHT_UPPER_ARM = (0.0, 0.70711, 0.0, 0.70711)
_LEFT_FOREARM = (1.0, 0.0, 0.0, 0.0)
_RIGHT_FOREARM = (0.0, 0.0, 0.0, -1.0)

SPEC = RobotSpec(
    name="unitree_h2",
    title="Unitree H2, 31 joints",
    mjcf=Path(__file__).with_name("unitree_h2.xml"),
    provenance=(
        "Joint frames, axes, ranges, speed limits, efforts, masses and inertias: H2.urdf of "
        "unitreerobotics/unitree_ros, BSD-3-Clause. Palm frames and toe frames: public retargeting "
        "tables for the H2. IK offsets and geometry (primitives): this project."
    ),
    stature=1.8,  # root scale 1.084 for a human of 1.66 m; with more its legs are stretched, and knees undecided
    posture_weight=2.0,  # its leaning hip axes leave more undecided than the G1's
    object_size="captured",
    speed_limits={
        **{f"{side}_{joint}_joint": speed for side in SIDES for joint, speed in _LEG_SPEEDS.items()},
        **{f"{joint}_joint": speed for joint, speed in _TRUNK_SPEEDS.items()},
        **{f"{side}_{joint}_joint": speed for side in SIDES for joint, speed in _ARM_SPEEDS.items()},
    },
    # The hip pitch axes lean by 30 degrees: roll and yaw take out what pitch alone would turn the feet by.
    home={
        **{f"{side}_hip_pitch_joint": -0.17277605 for side in SIDES},
        "left_hip_roll_joint": -0.006471,
        "right_hip_roll_joint": 0.006471,
        "left_hip_yaw_joint": -0.08606526,
        "right_hip_yaw_joint": 0.08606526,
        **{f"{side}_knee_joint": 0.3 for side in SIDES},
        **{f"{side}_ankle_pitch_joint": -0.15 for side in SIDES},
        **{f"{side}_shoulder_pitch_joint": 0.15 for side in SIDES},
        "left_shoulder_roll_joint": 0.15,
        "right_shoulder_roll_joint": -0.15,
        **{f"{side}_elbow_joint": 1.1 for side in SIDES},
    },
    ik=(
        IkRow("pelvis", "pelvis", 100.0, 5.0, _TRUNK),
        IkRow("torso", "spine3", 0.0, 10.0, _TRUNK),
        *(IkRow(f"{side}_hip", f"{side}_hip", 10.0, 5.0, _TRUNK) for side in SIDES),
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
        "pelvis": ("pelvis.stl",),
        **{f"{link}_link": (f"{link}_link.stl",) for link in ("waist_yaw", "waist_roll", "head_pitch", "head_yaw")},
        "torso_link": ("torso_link.stl",),
        **{f"{side}_{link}_link": (f"{side}_{link}_link.stl",) for side in SIDES for link in _MESH_PER_LINK},
        **{f"{side}_wrist_yaw_link": (f"{side}_wrist_yaw_link.stl", f"{side}_hand_link.stl") for side in SIDES},
    },
)
