"""The specification of a robot beside its MJCF: one frozen value per robot.

Every MJCF carries sites named by their role, the same names on every robot (`SITES`): the links that inverse kinematics
steers, the palms and feet that touch, the head, and the sole corners. The IK table is that of robots with the sites'
axes of docs/robots.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

SIDES = ("left", "right")
PALMS = ("left_palm", "right_palm")
SOLE_CORNERS = ("heel_inner", "heel_outer", "toe_inner", "toe_outer")
FINGER_SITES = tuple(f"{side}_{name}" for side in SIDES for name in ("thumb", "index", "middle", "ring", "pinky"))
"""Of robots whose fingers move, some of these: each on the last link of the finger that follows the human one."""
SITES: tuple[str, ...] = (
    "pelvis",
    "torso",
    "head",
    *(
        f"{side}_{name}"
        for side in SIDES
        for name in ("hip", "knee", "foot", "toe", "shoulder", "elbow", "wrist", "palm")
    ),
    *(f"{side}_sole_{corner}" for side in SIDES for corner in SOLE_CORNERS),
)
BODY_SITES: Mapping[str, str] = {
    "pelvis": "pelvis",
    **{f"{side}_{part}": f"{side}_{site}" for part, site in (("thigh", "hip"), ("forearm", "elbow")) for side in SIDES},
}
"""Site by human part that can rest on an object: pelvis, thighs and forearms of robots on legs."""
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


@dataclass(frozen=True)
class IkRow:
    """One row of the IK table: a site of the robot follows a joint of the human.

    The residuals are multiplied by the weights before they are squared.
    """

    site: str
    human_joint: str
    position_weight: float  # [1/m]
    rotation_weight: float  # [1/rad]
    rotation_offset: tuple[float, float, float, float]  # Human joint to robot site, wxyz, multiplied on the right.
    scale: float = 1.0  # Of the joint's place about the pelvis, on top of the root scale.


@dataclass(frozen=True)
class SitePose:
    """A site that an MJCF lacks: its constant place on a body."""

    body: str
    position: tuple[float, float, float]  # In the body's frame [m].
    quat: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)  # wxyz


@dataclass(frozen=True)
class Motor:
    """Published or stated facts on one joint's drive, beside the manufacturer's MJCF."""

    armature: float  # Inertia of the rotors as the joint feels it [kg m^2].
    torque: float | None = None  # Torque limit [N m], where it is not the MJCF's.
    gains: tuple[float, float] | None = None
    """Stiffness [N m/rad] and damping [N m s/rad], where they do not follow from the inertia."""


@dataclass(frozen=True)
class HeldJoint:
    """A joint of the source file that is missing in the MJCF: a finger's, or one that is coupled to another."""

    joint: str
    other: str  # The joint that it follows; empty where it is held at `offset`.
    ratio: float
    offset: float  # [rad], of a slide [m]; its value is `offset + ratio * other`.


@dataclass(frozen=True)
class RobotSpec:
    """One robot: a module of data beside its MJCF, or one that the user added."""

    name: str  # As given on the command line and stored in results.
    title: str
    mjcf: Path
    provenance: str  # Source and licence of the numbers of the MJCF.
    stature: float  # Human height times root scale [m]: a human of this height is retargeted without scaling.
    object_size: Literal["root", "captured"]
    """Meaning of `--object-scale auto`: objects shrink with the root scale, or keep their size."""
    speed_limits: Mapping[str, float]  # Joint speed limits [rad/s], one for every hinge.
    home: Mapping[str, float]  # Joint angles [rad] of a relaxed standing pose; joints not named are at zero.
    ik: tuple[IkRow, ...]
    posture_weight: float = 0.5
    """IK weight of joint angles near the home pose [1/rad^2]: decides what the sites leave free."""
    part_sites: Mapping[str, str] = field(
        default_factory=lambda: {
            "left_hand": "left_palm",
            "right_hand": "right_palm",
            "left_foot": "left_foot",
            "right_foot": "right_foot",
        }
    )
    """Touching site by human part."""
    fingers: Mapping[str, str] = field(default_factory=dict)
    """Site on the last link of each finger that moves, by the human finger that it follows, such as `left_ring`."""
    base: Literal["legs", "stays", "follows"] = "legs"
    """Carrier of the trunk: legs, or a base that stays at the place of the hands' work, or follows the person."""
    palm_weight: float = 1.0
    """Share of the cost table's `hand_orientation`: less where the arms cannot turn the palms freely."""
    contact_weight: float = 1.0
    """Factor of the cost table's `object_contact` with `--contact landmark`: more where a part of a person's pose is
    out of reach, whose terms pull at the contacts for good."""
    dropped_rotations: tuple[str, ...] = ()
    """Sites whose rotations are not followed, because the joints before them cannot turn them freely."""
    sites: Mapping[str, SitePose] = field(default_factory=dict)  # Sites that the MJCF lacks, by role.
    meshes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Body name to the manufacturer's mesh file names, for pictures where a user has those files."""
    motors: Mapping[str, Motor] = field(default_factory=dict)
    """Drives by joint, where they are published; `dynamics/actuators.py` estimates others."""
    skin: Path | None = None
    """File of the links' skins, made from the manufacturer's meshes; else the colliding geometries are the skin."""
    held: tuple[HeldJoint, ...] = ()  # Joints of the source file that are not moved; exports give them back.
    couplings: tuple[HeldJoint, ...] = ()
    """Joints that move here, and on the robot follow another one, or have no drive of their own."""
    joint_order: tuple[str, ...] = ()
    """All joints of the source file in its order, held ones included; empty where none is held."""
    description_file: str = ""
    """Name of the source file that the robot was made from; empty for the robots of this package."""
    description_sha256: str = ""  # Digest of that file.

    @property
    def contact_sites(self) -> Mapping[str, str]:
        """Sites by human part of all that can touch: hands, feet, fingers, and on legs pelvis, thighs, forearms."""
        return {**self.part_sites, **(BODY_SITES if self.base == "legs" else {}), **self.fingers}

    @property
    def ik_rows(self) -> tuple[IkRow, ...]:
        """The IK table without the rotations that are dropped."""
        return tuple(
            replace(row, rotation_weight=0.0) if row.site in self.dropped_rotations else row for row in self.ik
        )


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
