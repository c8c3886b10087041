"""What the package needs to know of a robot beside its MJCF: one frozen value per robot.

Every MJCF carries sites named by their role, the same names on every robot (`SITES`): the links
that inverse kinematics steers, the palms and feet that touch, the head, and the sole corners.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

SIDES = ("left", "right")
SOLE_CORNERS = ("heel_inner", "heel_outer", "toe_inner", "toe_outer")
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


@dataclass(frozen=True)
class IkRow:
    """One row of the IK table: a site of the robot follows a joint of the human.

    The residuals are multiplied by the weights before they are squared.
    """

    site: str
    human_joint: str
    position_weight: float
    """[1/m]"""
    rotation_weight: float
    """[1/rad]"""
    rotation_offset: tuple[float, float, float, float]
    """Human joint to robot site, wxyz, multiplied on the right."""
    scale: float = 1.0
    """Of the joint's place about the pelvis, on top of the root scale."""


@dataclass(frozen=True)
class SitePose:
    """A site that an MJCF lacks: its constant place on a body."""

    body: str
    position: tuple[float, float, float]
    """In the body's frame [m]."""
    quat: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    """wxyz"""


@dataclass(frozen=True)
class Capsule:
    """All places within a radius of a segment that is fixed to a body: a coarse shape of one link."""

    body: str
    start: tuple[float, float, float]
    """Ends of the segment in the body's frame [m]."""
    end: tuple[float, float, float]
    radius: float
    """[m]"""


@dataclass(frozen=True)
class Motor:
    """Published facts on one joint's drive, which no MJCF of the maker holds."""

    armature: float
    """Inertia of the rotors as the joint feels it [kg m^2]."""
    torque: float | None = None
    """What it can give [N m], where that is not the MJCF's."""


@dataclass(frozen=True)
class HeldJoint:
    """A joint of the maker's that the MJCF has not: a finger's, or one that is coupled to another."""

    joint: str
    other: str
    """The joint that it follows; empty where it is held at `offset`."""
    ratio: float
    offset: float
    """[rad], of a slide [m]; its value is `offset + ratio * other`."""


@dataclass(frozen=True)
class RobotSpec:
    """One robot: a module of data beside its MJCF, or one that the user added."""

    name: str
    """As given on the command line and stored in results."""
    title: str
    mjcf: Path
    provenance: str
    """Whose description the numbers of the MJCF were taken from, and under which licence."""
    stature: float
    """Human height times root scale [m]: a human of this height is retargeted without scaling."""
    object_size: Literal["root", "captured"]
    """What `--object-scale auto` means: objects shrink with the root scale, or keep their size."""
    speed_limits: Mapping[str, float]
    """Joint speed limits [rad/s], one for every hinge."""
    home: Mapping[str, float]
    """Joint angles [rad] of a relaxed standing pose; joints not named are at zero."""
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
    """Which site touches for which human part."""
    base: Literal["legs", "stays", "follows"] = "legs"
    """What carries the trunk: legs, or a base that stands where the hands' work is, or goes where the person goes."""
    palm_weight: float = 1.0
    """Share of the cost table's `hand_orientation`: less where the arms cannot turn the palms freely."""
    contact_weight: float = 1.0
    """Factor of the cost table's `object_contact` with `--contact landmark`: more where a part of a person's pose is
    out of reach, whose terms pull at the contacts for good."""
    dropped_rotations: tuple[str, ...] = ()
    """Sites whose rotations are not followed, because the joints before them cannot turn them freely."""
    sites: Mapping[str, SitePose] = field(default_factory=dict)
    """Sites that the MJCF lacks, by role."""
    meshes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Body name to the vendor's mesh file names, for pictures where a user has those files."""
    capsules: tuple[Capsule, ...] = ()
    """Coarse shapes of the links, for the weight `capsule_clearance`."""
    motors: Mapping[str, Motor] = field(default_factory=dict)
    """Drives by joint, where they are published; `physics/actuators.py` estimates others."""
    skin: Path | None = None
    """File of the links' skins, made from the vendor's meshes; without one, the colliding geometries are the skin."""

    held: tuple[HeldJoint, ...] = ()
    """Joints of the maker's that are not moved; exports give them back."""
    joint_order: tuple[str, ...] = ()
    """All of the maker's joints in its order, held ones included; empty where none is held."""
    description_file: str = ""
    """Name of the maker's file that the robot was made from; empty for the robots of this package."""
    description_sha256: str = ""
    """Digest of that file."""

    @property
    def ik_rows(self) -> tuple[IkRow, ...]:
        """The IK table without the rotations that are dropped."""
        return tuple(
            replace(row, rotation_weight=0.0) if row.site in self.dropped_rotations else row for row in self.ik
        )
