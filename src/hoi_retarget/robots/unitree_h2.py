"""Unitree H2 with 31 joints: the specification beside `unitree_h2.xml`."""

from pathlib import Path

from hoi_retarget.robots.spec import TRUNK, RobotSpec, ik_table
from hoi_retarget.robots.unitree import joint_values, limb_meshes, mirrored

_LEG_SPEEDS = {"hip_pitch": 20.0, "hip_roll": 20.0, "hip_yaw": 20.0, "knee": 20.0}
_LEG_SPEEDS |= {"ankle_roll": 100.7, "ankle_pitch": 28.61}
_TRUNK_SPEEDS = {"waist_yaw": 28.375, "waist_roll": 28.375, "waist_pitch": 28.375, "head_pitch": 10.0, "head_yaw": 10.0}
_ARM_SPEEDS = {"shoulder_pitch": 21.9, "shoulder_roll": 18.7, "shoulder_yaw": 18.7, "elbow": 18.7}
_ARM_SPEEDS |= {"wrist_roll": 18.7, "wrist_pitch": 37.7, "wrist_yaw": 37.7}

# In the zero pose of the H2 all links are aligned with the pelvis: legs straight and vertical (hip to knee
# within 0.5 degrees, knee to ankle within 2.1), upper arms hanging along -z, forearms pointing ahead
# along +x. So one offset serves trunk and legs.

SPEC = RobotSpec(
    name="unitree_h2",
    title="Unitree H2, 31 joints",
    mjcf=Path(__file__).with_name("unitree_h2.xml"),
    skin=Path(__file__).with_name("unitree_h2_skin.npz"),
    provenance=(
        "Joint frames, axes, ranges, speed limits, efforts, masses and inertias: H2.urdf of "
        "unitreerobotics/unitree_ros, BSD-3-Clause. Palm frames and toe frames: public retargeting "
        "tables for the H2. IK offsets and geometry (primitives): this project."
    ),
    stature=1.8,  # root scale 1.084 for a human of 1.66 m; with more its legs are stretched, and knees undecided
    posture_weight=2.0,  # its leaning hip axes leave more undecided than the G1's
    object_size="captured",
    speed_limits=joint_values({**_LEG_SPEEDS, **_ARM_SPEEDS}, _TRUNK_SPEEDS),
    # The hip pitch axes lean by 30 degrees: roll and yaw take out what pitch alone would turn the feet by.
    home={
        **joint_values(
            {"hip_pitch": -0.17277605, "knee": 0.3, "ankle_pitch": -0.15, "shoulder_pitch": 0.15, "elbow": 1.1}, {}
        ),
        **mirrored({"hip_roll": -0.006471, "hip_yaw": -0.08606526, "shoulder_roll": 0.15}),
    },
    ik=ik_table(TRUNK),
    meshes={
        "pelvis": ("pelvis.stl",),
        **{f"{link}_link": (f"{link}_link.stl",) for link in ("waist_yaw", "waist_roll", "head_pitch", "head_yaw")},
        "torso_link": ("torso_link.stl",),
        **limb_meshes(".stl", "hand_link"),
    },
)
