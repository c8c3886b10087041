"""Legs of a description: knees, ankles, and the planes and corners of the soles."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError

from hoi_retarget.robots.adding.findings import UnsuitableRobotError
from hoi_retarget.robots.adding.forward_axis import TrunkAxes
from hoi_retarget.robots.adding.kinematic_chains import BendJoint, KinematicChain, Limbs, find_bend_joint, joint_centre
from hoi_retarget.robots.adding.zero_pose import ZeroPose

_LAYER = 0.012  # Points within this height of the lowest one belong to the sole [m].
_FLAT = 0.45  # A foot whose lowest points span this share of its length stands flat in the zero pose.
_MIN_DOWNWARDS, _SAME_FACE = 0.6, np.cos(np.radians(6.0))
_LEVEL_FACE = np.cos(np.radians(4.0))
_TILTED_FACE_WEIGHT = 0.35
_NOT_TILTED = np.cos(np.radians(3.0))
_CORNER_INSET = 0.04  # Corners lie inside the sole's outline by this share of its length and width.
_MIN_LENGTH = 0.05  # [m]
_MIN_SOLE_SHARE, _MIN_LENGTH_BY_LEG = 0.3, 0.15
"""Of a foot's outline, and of the leg's length: manufacturers' soles have 0.5 to 1, and 0.25 to 0.56."""


@dataclass(frozen=True, eq=False)
class Sole:
    """One foot, in the axes of the zero pose: ahead, left, up, about the ankle."""

    rotation: Float[np.ndarray, "3 3"]  # Of the sole: x to the toes, z up.
    heel: float  # Ends of the sole from the ankle along its x axis [m].
    toe: float
    right: float
    left: float  # Along its y axis [m].
    bottom: float  # Along its z axis, negative [m].
    tilt_deg: float  # Of the sole against the ground in the zero pose.
    measured: bool  # Whether there is geometry; otherwise its size follows from the leg's length.
    exists: bool = True
    """Whether a foot's lowest points are a face under most of it, as they are under no gripper and no peg."""

    def corner(self, name: str, side: str) -> Float[np.ndarray, "3"]:
        """Return the place of `heel_inner`, ..., `toe_outer` of a left or right foot [m]."""
        along, across = name.split("_")
        length, width = self.toe - self.heel, self.left - self.right
        x = self.heel + _CORNER_INSET * length if along == "heel" else self.toe - _CORNER_INSET * length
        leftwards = (side == "left") == (across == "outer")
        y = self.left - _CORNER_INSET * width if leftwards else self.right + _CORNER_INSET * width
        return self.rotation @ np.array([x, y, self.bottom])

    @property
    def ball(self) -> Float[np.ndarray, "3"]:
        """The place between the toes' joints and the sole [m]."""
        length = self.toe - self.heel
        place = [self.heel + 0.89 * length, 0.5 * (self.left + self.right), self.bottom + 0.08 * length]
        return self.rotation @ np.array(place)


def find_sole(
    points: Float[np.ndarray, "_ 3"], shank: Float[np.ndarray, "3"], lateral: Float[np.ndarray, "3"], leg: float
) -> Sole:
    """Return the sole of a foot.

    `points`: on the foot's surface, from the ankle, in axes ahead, left, up [m]; `shank`: from the knee to the ankle,
    of unit length; `lateral`: the knee's axis, to the left; `leg`: length of thigh and shank [m].
    """
    if len(points) < 4 or np.ptp(points[:, 0]) < _MIN_LENGTH:
        length = 0.3 * leg
        rotation, half = _frame(np.array([0.0, 0.0, 1.0]), lateral), 0.2 * length
        return Sole(rotation, -0.25 * length, 0.75 * length, -half, half, -0.1 * leg, 0.0, measured=False)
    normal = _normal(points, shank)
    tilt = float(np.degrees(np.arccos(np.clip(normal[2], -1.0, 1.0))))
    if normal[2] > _NOT_TILTED:
        normal = np.array([0.0, 0.0, 1.0])
    rotation = _frame(normal, lateral)
    local = points @ rotation
    bottom = float(local[:, 2].min())
    low = local[local[:, 2] < bottom + _LAYER]
    (heel, right), (toe, left) = low[:, :2].min(axis=0).tolist(), low[:, :2].max(axis=0).tolist()
    exists = _area(low[:, :2]) > _MIN_SOLE_SHARE * _area(local[:, :2]) and toe - heel > _MIN_LENGTH_BY_LEG * leg
    return Sole(rotation, heel, toe, right, left, bottom, tilt, measured=True, exists=exists)


def _area(points: np.ndarray) -> float:
    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return 0.0


def _frame(normal: np.ndarray, lateral: np.ndarray) -> np.ndarray:
    left = lateral - normal * (normal @ lateral)
    left /= np.linalg.norm(left)
    return np.stack([np.cross(left, normal), left, normal], axis=1)


def _normal(points: np.ndarray, shank: np.ndarray) -> np.ndarray:
    """Return the upward normal of the sole: the vertical one, or that of the largest face that looks down the shank."""
    low = points[points[:, 2] < points[:, 2].min() + _LAYER]
    if np.ptp(low[:, 0]) > _FLAT * np.ptp(points[:, 0]):
        return np.array([0.0, 0.0, 1.0])
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return np.array([0.0, 0.0, 1.0])
    normals, corners = hull.equations[:, :3], points[hull.simplices]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    best, chosen = 0.0, np.array([0.0, 0.0, -1.0])
    for index in np.argsort(-areas)[:60]:
        if normals[index] @ shank < _MIN_DOWNWARDS:
            continue
        same = normals @ normals[index] > _SAME_FACE
        area = areas[same].sum() * (1.0 if normals[index, 2] < -_LEVEL_FACE else _TILTED_FACE_WEIGHT)
        if area > best:
            best, chosen = area, (normals[same] * areas[same, None]).sum(axis=0)
    return -chosen / np.linalg.norm(chosen)


@dataclass(frozen=True, eq=False)
class Leg:
    """One leg in the zero pose."""

    chain: KinematicChain
    knee: BendJoint
    ankle: Float[np.ndarray, "3"]  # In world axes [m].
    sole: Sole

    @property
    def length(self) -> float:
        """Height of the hip when the leg is straight [m]."""
        thigh, shank = self.knee.top - self.knee.middle, self.knee.middle - self.ankle
        return float(np.linalg.norm(thigh) + np.linalg.norm(shank)) - self.sole.bottom


def find_knees(pose: ZeroPose, limbs: Limbs, named: tuple[str, str]) -> tuple[BendJoint, BendJoint]:
    """Return the knees in the order of the legs; `named` are their joints, where the user states them, or empty."""
    first, second = (
        find_bend_joint(pose, chain.hinges, pose.anchors[chain.hinges[-1]] - 0.02 * limbs.up, "knee", name)
        for chain, name in zip(limbs.legs, named, strict=True)
    )
    return first, second


def find_ankle(pose: ZeroPose, chain: KinematicChain, knee: BendJoint) -> Float[np.ndarray, "3"]:
    """Return the centre of the joints after the knee [m]; of a single one, the point of its axis abreast of the knee.

    Raises `UnsuitableRobotError` without a joint after the knee.
    """
    after = list(chain.hinges[knee.place + 1 :])
    if not after:
        raise UnsuitableRobotError(f"no ankle: no joint follows the knee {pose.name(knee.joint)!r}.")
    if len(after) > 1:
        return joint_centre(pose, after)
    axis, anchor = pose.axes[after[0]], pose.anchors[after[0]]
    return anchor + axis * (axis @ (knee.middle - anchor))


def find_leg(pose: ZeroPose, trunk: TrunkAxes, chain: KinematicChain, knee: BendJoint) -> Leg:
    """Return a leg with its ankle and its sole.

    Raises `UnsuitableRobotError` where no joint follows the knee.

    `pose`: the zero pose; `trunk`: the trunk's axes; `chain`: the leg; `knee`: its knee.
    """
    axes, ankle = trunk.axes, find_ankle(pose, chain, knee)
    points = (pose.points(*chain.tip, meshes_only=True) - ankle) @ axes
    shank = (ankle - knee.middle) @ axes
    length = float(np.linalg.norm(knee.top - knee.middle) + np.linalg.norm(shank))
    sole = find_sole(points, shank / np.linalg.norm(shank), leftwards(pose, trunk, knee.joint) @ axes, length)
    return Leg(chain, knee, ankle, sole)


def leftwards(pose: ZeroPose, trunk: TrunkAxes, joint: int) -> Float[np.ndarray, "3"]:
    """Return the axis of a joint, in the direction that points to the left, of unit length."""
    axis = pose.axes[joint]
    return axis if axis @ trunk.axes[:, 1] > 0 else -axis
