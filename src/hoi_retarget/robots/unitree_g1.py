"""Unitree G1 with 29 joints, and with Dex3 hands 43: the specifications beside their `.xml`."""

from dataclasses import replace
from pathlib import Path

from hoi_retarget.robots.spec import SIDES, Motor, RobotSpec, ik_table
from hoi_retarget.robots.unitree import joint_values, limb_meshes, mirrored

_LEG_SPEEDS = {"hip_pitch": 32.0, "hip_roll": 20.0, "hip_yaw": 32.0, "knee": 20.0}
_LEG_SPEEDS |= {"ankle_pitch": 30.0, "ankle_roll": 30.0}
_WAIST_SPEEDS = {"waist_yaw": 32.0, "waist_roll": 30.0, "waist_pitch": 30.0}
_ARM_SPEEDS = {"shoulder_pitch": 37.0, "shoulder_roll": 37.0, "shoulder_yaw": 37.0, "elbow": 37.0}
_ARM_SPEEDS |= {"wrist_roll": 37.0, "wrist_pitch": 22.0, "wrist_yaw": 22.0}

# Rotor inertias by kind of motor: published by BeyondMimic (Liao et al., 2025), and used by mjlab. Two motors of 25 N m
# turn each ankle, and two the waist, in parallel. The manufacturer's URDF says 35 N m there and its MJCF of the same
# revision 50, which is the torque of two motors and that of mjlab.
_5020, _7520_14, _7520_22, _4010 = Motor(0.003609725), Motor(0.01017752), Motor(0.025101925), Motor(0.00425)
_PAIR = Motor(2 * _5020.armature, 50.0)
_LEG_MOTORS = {"hip_pitch": _7520_14, "hip_roll": _7520_22, "hip_yaw": _7520_14, "knee": _7520_22}
_LEG_MOTORS |= {"ankle_pitch": _PAIR, "ankle_roll": _PAIR}
_WAIST_MOTORS = {"waist_yaw": _7520_14, "waist_roll": _PAIR, "waist_pitch": _PAIR}
_ARM_MOTORS = {"shoulder_pitch": _5020, "shoulder_roll": _5020, "shoulder_yaw": _5020, "elbow": _5020}
_ARM_MOTORS |= {"wrist_roll": _5020, "wrist_pitch": _4010, "wrist_yaw": _4010}

# The frame of the hip roll link is tilted by -10.02 degrees about y in the zero pose. The offset asks
# for -15.75 degrees: a straight human leg is followed with 5.7 degrees of hip flexion, which keeps the
# knee off its stretched position.
_HIP = (0.42678, -0.56379, -0.56379, -0.42678)

SPEC = RobotSpec(
    name="unitree_g1",
    title="Unitree G1, 29 joints",
    mjcf=Path(__file__).with_name("unitree_g1.xml"),
    skin=Path(__file__).with_name("unitree_g1_skin.npz"),
    provenance=(
        "Joint frames, axes, ranges, masses and inertias: g1_29dof_rev_1_0.xml; speed limits and efforts: "
        "g1_29dof_rev_1_0.urdf; both of unitreerobotics/unitree_ros, BSD-3-Clause. "
        "Palm frames, root scale and IK offsets: public retargeting tables for the G1. "
        "Geometry: primitives of this project."
    ),
    stature=1.4525,  # root scale 0.83 for a human of 1.75 m
    object_size="root",
    speed_limits=joint_values({**_LEG_SPEEDS, **_ARM_SPEEDS}, _WAIST_SPEEDS),
    motors=joint_values({**_LEG_MOTORS, **_ARM_MOTORS}, _WAIST_MOTORS),
    home={
        **joint_values(
            {"hip_pitch": -0.15, "knee": 0.3, "ankle_pitch": -0.15, "shoulder_pitch": 0.15, "elbow": 1.1}, {}
        ),
        **mirrored({"shoulder_roll": 0.2}),
    },
    ik=ik_table(_HIP),
    meshes={
        "pelvis": ("pelvis.STL", "pelvis_contour_link.STL"),
        "waist_yaw_link": ("waist_yaw_link_rev_1_0.STL",),
        "waist_roll_link": ("waist_roll_link_rev_1_0.STL",),
        "torso_link": ("torso_link_rev_1_0.STL", "logo_link.STL", "head_link.STL"),
        **limb_meshes(".STL", "rubber_hand"),
    },
)

_FINGER_SPEEDS = {f"hand_{joint}": 12.0 for joint in ("thumb_1", "thumb_2", "middle_0", "middle_1")}
_FINGER_SPEEDS |= {"hand_thumb_0": 3.14, "hand_index_0": 12.0, "hand_index_1": 12.0}
_FINGER_LINKS = [f"{side}_{joint}_link" for side in SIDES for joint in _FINGER_SPEEDS]
# The gains of the maker's teleoperation (xr_teleoperate); rotor inertias are estimated as of other motors of the G1.
_FINGER_MOTORS = {joint: Motor(3.5e-4 if "thumb_0" in joint else 2e-4, gains=(1.5, 0.2)) for joint in _FINGER_SPEEDS}
# Nearly straight: a joint at the end of its range could not give way.
_OPEN = {"hand_thumb_2": 0.1, **{f"hand_{finger}_{joint}": -0.1 for finger in ("middle", "index") for joint in (0, 1)}}

DEX3 = replace(
    SPEC,
    name="unitree_g1_dex3",
    title="Unitree G1 with Dex3 hands, 43 joints",
    mjcf=Path(__file__).with_name("unitree_g1_dex3.xml"),
    skin=Path(__file__).with_name("unitree_g1_dex3_skin.npz"),
    provenance=(
        "Hands: g1_29dof_with_hand_rev_1_0.xml and .urdf of unitreerobotics/unitree_ros, BSD-3-Clause; their palms and "
        f"pads, and which person's finger each follows, are this project's. The rest: {SPEC.provenance}"
    ),
    speed_limits={**SPEC.speed_limits, **joint_values(_FINGER_SPEEDS, {})},
    motors={**SPEC.motors, **joint_values(_FINGER_MOTORS, {})},
    home={**SPEC.home, **mirrored({"shoulder_roll": 0.35, **_OPEN})},  # Thumbs are off the hips.
    fingers={f"{side}_{finger}": f"{side}_{finger}" for side in SIDES for finger in ("thumb", "index", "ring")},
    meshes={
        **SPEC.meshes,
        **limb_meshes(".STL", "hand_palm_link"),
        **{link: (f"{link}.STL",) for link in _FINGER_LINKS},
    },
)
