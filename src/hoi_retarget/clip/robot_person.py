"""A robot as a person: its sites are the person's joints, and its skin is the person's.

The table of inverse kinematics tells which joint of a person steers which site of the robot, by which rotation; read
the other way round it gives the person's joints. The hand's middle is the palm's site. Joints that no site stands for
lie between others. Fingers are straight and go with the wrist, also those of hands whose fingers move.
"""

from functools import lru_cache

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float, Int

from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, LEFT_FINGERS, PARENT, RIGHT_FINGERS, add_straight_fingers
from hoi_retarget.human.skinned_mesh import SkinnedMesh
from hoi_retarget.numerics import se3
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.skin import LinkSkin, skin_of
from hoi_retarget.robots.spec import SIDES, SOLE_CORNERS

_SPINE = {"spine1": 0.2, "spine2": 0.4, "spine3": 0.55}
"""Of the way from the pelvis to the neck; no site stands for these joints."""
_COLLAR = 0.3  # Of the way from the neck to the shoulder.


def person_of(kinematics: Kinematics) -> Person:
    """Return the person that a robot stands for, with the robot's skin and stature.

    Retargeted to the same robot at its own size, the person's joints are at the robot's sites. Raises `RobotError`
    where the robot's skin cannot be read.
    """
    model = kinematics.model
    positions, quats = _joints(kinematics)
    home = model.forward(model.home_qpos[None])
    soles = [home.site_position(f"{side}_sole_{corner}")[0, 2] for side in SIDES for corner in SOLE_CORNERS]
    return Person(
        model.spec.name,
        positions,
        quats,
        fingers_recorded=False,
        shape=_skin(model),
        stature=model.spec.stature,
        toe_height=float(home.site_position("left_toe")[0, 2] - min(soles)),
    )


def joint_quats(kinematics: Kinematics) -> Float[np.ndarray, "T 52 4"]:
    """Return the joints' rotations of a person with limbs turned as the robot's, wxyz."""
    followed = {
        row.human_joint: se3.quat_multiply(
            se3.matrix_to_quat(kinematics.site_rotation(row.site)), se3.quat_conjugate(np.array(row.rotation_offset))
        )
        for row in kinematics.model.spec.ik
    }
    quats = np.empty((len(kinematics.qpos), len(JOINTS), 4))
    for joint, index in JOINT_INDEX.items():
        # The pelvis comes first and is in every table; joints that are not go with their parents, the trunk as one.
        known = "spine3" if joint in {"spine1", "spine2"} else joint
        quats[:, index] = followed[known] if known in followed else quats[:, JOINT_INDEX[str(PARENT[joint])]]
    return quats


def _joints(kinematics: Kinematics) -> tuple[Float[np.ndarray, "T 52 3"], Float[np.ndarray, "T 52 4"]]:
    """Return positions [m] and rotations, wxyz, of the person's joints."""
    rows = {row.human_joint: row for row in kinematics.model.spec.ik}
    place = {joint: kinematics.site_position(row.site) for joint, row in rows.items()}
    root = place["pelvis"]
    place = {joint: root + (at - root) / rows[joint].scale for joint, at in place.items()}
    place["neck"] = 0.5 * (place["left_shoulder"] + place["right_shoulder"])
    place["head"] = kinematics.site_position("head")
    place |= {joint: root + share * (place["neck"] - root) for joint, share in _SPINE.items()}
    for side in SIDES:
        place[f"{side}_ankle"] = kinematics.site_position(f"{side}_foot")
        place[f"{side}_collar"] = place["neck"] + _COLLAR * (place[f"{side}_shoulder"] - place["neck"])
    positions, quats = np.zeros((len(root), len(JOINTS), 3)), joint_quats(kinematics)
    for joint, at in place.items():
        positions[:, JOINT_INDEX[joint]] = at
    for side in SIDES:  # A robot's foot has no toes that bend.
        quats[:, JOINT_INDEX[f"{side}_ankle"]] = quats[:, JOINT_INDEX[f"{side}_foot"]]
    add_straight_fingers(positions[:, None], quats[:, None])
    for side, fingers in zip(SIDES, (LEFT_FINGERS, RIGHT_FINGERS), strict=True):
        wrist, middle = place[f"{side}_wrist"], JOINT_INDEX[f"{side}_middle3"]
        indices = [JOINT_INDEX[finger] for finger in fingers]
        # A hand's contact point is half-way to the end of the middle finger.
        away = 2.0 * kinematics.site_position(f"{side}_palm") - wrist - positions[:, middle]
        reach = np.linalg.norm(positions[:, indices] - wrist[:, None], axis=2)
        share = reach / np.linalg.norm(positions[:, middle] - wrist, axis=1)[:, None]
        positions[:, indices] += share[:, :, None] * away[:, None]
    return positions, quats


@lru_cache(maxsize=4)
def _skin(model: RobotModel) -> SkinnedMesh:
    """Return the hulls of the robot's links in its home pose, each bound to the joint of the last site before it."""
    home = model.forward(model.home_qpos[None])
    positions, quats = _joints(home)
    vertices, faces, owners = [], [], []
    for skin in skin_of(model).links:
        faces.append(_hull(skin.points) + sum(map(len, vertices)))
        vertices.append(home.point(skin.frame)[:, 0] + skin.points @ home.orientation(skin.frame)[:, :, 0].T)
        owners.append(np.full(len(skin.points), _joint_before(model, skin)))
    weights = np.eye(len(JOINTS))[np.concatenate(owners)]
    return SkinnedMesh(np.concatenate(vertices), np.concatenate(faces), weights, positions[0], quats[0])


def _hull(points: Float[np.ndarray, "P 3"]) -> Int[np.ndarray, "F 3"]:
    """Return the triangles of the hull of points, corners counter-clockwise seen from outside; none of a flat part."""
    try:
        hull = scipy.spatial.ConvexHull(points)
    except scipy.spatial.QhullError:
        return np.zeros((0, 3), dtype=int)
    first, second, third = points[hull.simplices.T]
    inward = np.sum(np.cross(second - first, third - first) * hull.equations[:, :3], axis=1) < 0.0
    return np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)


def _joint_before(model: RobotModel, skin: LinkSkin) -> int:
    nodes = {row.human_joint: model.sites.frames[row.site].node for row in model.spec.ik}
    before = {joint: node for joint, node in nodes.items() if model.supports[node, skin.frame.node]}
    return JOINT_INDEX[max(before, key=lambda joint: before[joint]) if before else "pelvis"]
