"""Unitree G1 with Dex3 hands of three fingers, 43 joints: the specification beside `unitree_g1_dex3.xml`."""

from dataclasses import replace
from pathlib import Path

from hoi_retarget.robots import unitree_g1
from hoi_retarget.robots.spec import SIDES, Motor
from hoi_retarget.robots.unitree import joint_values, limb_meshes, mirrored

_FINGER_SPEEDS = {f"hand_{joint}": 12.0 for joint in ("thumb_1", "thumb_2", "middle_0", "middle_1")}
_FINGER_SPEEDS |= {"hand_thumb_0": 3.14, "hand_index_0": 12.0, "hand_index_1": 12.0}
_FINGER_LINKS = [f"{side}_{joint}_link" for side in SIDES for joint in _FINGER_SPEEDS]
# The gains of the maker's teleoperation (xr_teleoperate); rotor inertias are estimated as of other motors of the G1.
_FINGER_MOTORS = {joint: Motor(3.5e-4 if "thumb_0" in joint else 2e-4, gains=(1.5, 0.2)) for joint in _FINGER_SPEEDS}
# Nearly straight: a joint at the end of its range could not give way.
_OPEN = {"hand_thumb_2": 0.1, **{f"hand_{finger}_{joint}": -0.1 for finger in ("middle", "index") for joint in (0, 1)}}

SPEC = replace(
    unitree_g1.SPEC,
    name="unitree_g1_dex3",
    title="Unitree G1 with Dex3 hands, 43 joints",
    mjcf=Path(__file__).with_name("unitree_g1_dex3.xml"),
    skin=Path(__file__).with_name("unitree_g1_dex3_skin.npz"),
    provenance=(
        "Hands: g1_29dof_with_hand_rev_1_0.xml and .urdf of unitreerobotics/unitree_ros, BSD-3-Clause; their palms and "
        f"pads, and which person's finger each follows, are this project's. The rest: {unitree_g1.SPEC.provenance}"
    ),
    speed_limits={**unitree_g1.SPEC.speed_limits, **joint_values(_FINGER_SPEEDS, {})},
    motors={**unitree_g1.SPEC.motors, **joint_values(_FINGER_MOTORS, {})},
    home={**unitree_g1.SPEC.home, **mirrored({"shoulder_roll": 0.35, **_OPEN})},  # Thumbs are off the hips.
    fingers={f"{side}_{finger}": f"{side}_{finger}" for side in SIDES for finger in ("thumb", "index", "ring")},
    meshes={
        **unitree_g1.SPEC.meshes,
        **limb_meshes(".STL", "hand_palm_link"),
        **{link: (f"{link}.STL",) for link in _FINGER_LINKS},
    },
)
