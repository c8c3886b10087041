"""Motion figures: feet and objects on the floor, joint limits, likeness of links' and objects' motion, and smoothness.

Joint limits are judged in every frame, the first one too: a limit is a promise, not a comparison.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.floor import rests_on_floor
from hoi_retarget.clip.supports import supports
from hoi_retarget.evaluation import comparison
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.spec import SIDES

_MIN_SPEED_MPS = 0.02  # Below this speed [m/s] a direction means nothing (paper's table of metrics).
# Robot site and human joint; the palms are added from `HAND_SITES`.
_LINKS = (("left_foot", "left_ankle"), ("right_foot", "right_ankle"), ("head", "head"), ("pelvis", "pelvis"))
# Turns a human joint's axes (x left, y up, z ahead) into a robot link's (x ahead, y left, z up), on the right.
HUMAN_TO_ROBOT_AXES = se3.quat_to_matrix(np.array([0.5, -0.5, -0.5, -0.5]))
_TRUNK_ENDS = (("torso", "spine3"), ("pelvis", "pelvis"))
_PALM = "palm"  # Stands for the contact point of a hand, which is no joint.
# Chains of robot site and human joint, `{side}` being left and right. Bones are seen in the frame of the first pair.
_LEG = (
    ("pelvis", "pelvis"),
    ("{side}_hip", "{side}_hip"),
    ("{side}_knee", "{side}_knee"),
    ("{side}_foot", "{side}_ankle"),
    ("{side}_toe", "{side}_foot"),
)
_ARM = (
    ("torso", "spine3"),
    ("{side}_shoulder", "{side}_shoulder"),
    ("{side}_elbow", "{side}_elbow"),
    ("{side}_wrist", "{side}_wrist"),
    ("{side}_palm", _PALM),
)
_Chain = tuple[tuple[str, str], ...]


@comparison.figure("foot slide", "cm/s", needs_floor=True)
def stance_slide_mps(view: comparison.Comparison) -> float | None:
    """Mean speed of standing feet over the floor [m/s]."""
    speeds = foot_speeds(view.kinematics, view.clip.fps)[view.first :]
    return comparison.mean_or_none(speeds[view.stance[1:] & view.stance[:-1]])


@comparison.figure("sole height", "mm", needs_floor=True)
def stance_sole_height_abs_m(view: comparison.Comparison) -> float | None:
    """Mean distance of standing soles from the floor [m]."""
    return comparison.mean_or_none(np.abs(view.cached(_counted_heights)[view.stance]))


@comparison.figure("foot float", "mm", needs_floor=True)
def stance_float_m(view: comparison.Comparison) -> float | None:
    """Mean height of standing soles over the floor [m]."""
    return comparison.mean_or_none(np.maximum(view.cached(_counted_heights)[view.stance], 0.0))


@comparison.figure("floor penetration", "mm", needs_floor=True)
def floor_penetration_max_m(view: comparison.Comparison) -> float | None:
    """Depth of the deepest sole corner below the floor [m]."""
    return deepest(view.cached(_counted_heights))


@comparison.figure("object below floor", "mm", needs_floor=True)
def object_below_floor_m(view: comparison.Comparison) -> float | None:
    """Depth of the deepest object point below the floor [m]."""
    if view.object_count == 0:
        return None
    return max(0.0, -float(view.cached(_object_heights).min()))


@comparison.figure("object float", "mm", needs_floor=True)
def object_float_m(view: comparison.Comparison) -> float | None:
    """Mean height of resting objects over the floor [m]."""
    rests = rests_on_floor(view.clip)[:, view.first :]
    if not rests.any():
        return None
    heights = np.maximum(view.cached(_object_heights), 0.0)
    return max(float(own[resting].mean()) for own, resting in zip(heights, rests, strict=True) if resting.any())


@comparison.figure("object on object", "mm")
def support_height_error_m(view: comparison.Comparison) -> float | None:
    """Largest change of an object's height over the one that carries it [m]."""
    carriers = supports(view.clip.objects, view.clip.fps).carriers[view.first :]
    frames, riders = np.nonzero(carriers >= 0)
    if not len(frames):
        return None
    heights = [
        np.stack([pose.positions[:, 2] for pose in poses], axis=1) for poses in (view.robot_objects, view.human_objects)
    ]
    robot, human = (side[frames, riders] - side[frames, carriers[frames, riders]] for side in heights)
    return float(np.abs(robot - view.motion.object_scale[riders] * human).max())


@comparison.figure("range margin", "rad", digits=3, better="higher")
def joint_range_margin_rad(view: comparison.Comparison) -> float | None:
    """Way left to the nearest end of any joint's range; negative is beyond it [rad]."""
    return comparison.finite_min_or_none(joint_range_margins(view.motion, view.kinematics.model))


@comparison.figure("speed margin", "rad/s", digits=2, better="higher")
def joint_speed_margin_radps(view: comparison.Comparison) -> float | None:
    """Speed left to the limit of the fastest joint; negative is beyond it [rad/s]."""
    return comparison.finite_min_or_none(joint_speed_margins(view.motion, view.kinematics.model))


@comparison.figure("coupling", "rad", digits=3)
def coupling_error_rad(view: comparison.Comparison) -> float | None:
    """Largest way of a joint from where its mechanism takes it: along with another joint, or nowhere [rad]."""
    model = view.kinematics.model
    angles = dict(zip(model.joint_names, view.motion.qpos[:, 7:].T, strict=True))
    errors = [
        angles[one.joint] - (one.offset + one.ratio * angles[one.other] if one.other else angles[one.joint][0])
        for one in model.spec.couplings
    ]
    return float(np.abs(errors).max()) if errors else None


@comparison.figure("pose", "deg")
def body_pose_deviation_deg(view: comparison.Comparison) -> float | None:
    """Mean angle between the bones of robot and human; proportions alone make some [deg].

    Over the 8 of the arms alone where a base carries the robot.
    """
    chains = (_LEG, _ARM) if view.kinematics.model.spec.base == "legs" else (_ARM,)
    angles = [comparison.direction_angles_deg(_robot_bones(view, chain), _human_bones(view, chain)) for chain in chains]
    return comparison.mean_or_none(np.stack(angles))


@comparison.figure("trunk", "deg")
def trunk_deviation_deg(view: comparison.Comparison) -> float | None:
    """Mean angle between the chests of robot and human, in the world [deg].

    None where a base carries the robot, whose trunk cannot follow.
    """
    return comparison.mean_or_none(view.cached(trunk_deviations)[0])


@comparison.figure("trunk p95", "deg")
def trunk_deviation_p95_deg(view: comparison.Comparison) -> float | None:
    """The angle between the chests that 95 % of the frames stay below [deg]."""
    return comparison.percentile_or_none(view.cached(trunk_deviations)[0])


@comparison.figure("trunk max", "deg")
def trunk_deviation_max_deg(view: comparison.Comparison) -> float | None:
    """The largest angle between the chests [deg]."""
    return comparison.max_or_none(view.cached(trunk_deviations)[0])


@comparison.figure("lean p95", "deg", needs_floor=True)
def trunk_lean_p95_deg(view: comparison.Comparison) -> float | None:
    """Difference of sideways lean, of chest or hips, that 95 % of the frames stay below [deg]."""
    return comparison.percentile_or_none(view.cached(trunk_deviations)[1])


@comparison.figure("velocity direction", "deg")
def link_velocity_direction_deg(view: comparison.Comparison) -> float | None:
    """Mean angle between the velocities of hands, feet, head and pelvis of the two [deg].

    Over palms, ankles, head and pelvis, wherever both sides exceed 2 cm/s. With several objects, relative to
    the one that the person touches longest; without objects, in the world.
    """
    robot_points = [view.robot_point(site) for site in comparison.HAND_SITES.values()]
    robot_points += [view.robot_point(site) for site, _ in _LINKS]
    human_points = [view.human_part_point(part) for part in comparison.HAND_SITES]
    human_points += [view.human_point(joint) for _, joint in _LINKS]
    robot = _velocities(np.stack(robot_points, axis=1), view.robot_objects, view)
    human = _velocities(np.stack(human_points, axis=1), view.human_objects, view)
    moving = (comparison.norms(robot) > _MIN_SPEED_MPS) & (comparison.norms(human) > _MIN_SPEED_MPS)
    return comparison.mean_or_none(comparison.direction_angles_deg(robot[moving], human[moving]))


@comparison.figure("jerk", "m/s^3")
def body_jerk_mps3(view: comparison.Comparison) -> float | None:
    """Mean change of acceleration over all links [m/s^3]."""
    return comparison.mean_or_none(view.cached(_counted_jerks))


@comparison.figure("jerk max", "m/s^3", digits=0)
def body_jerk_max_mps3(view: comparison.Comparison) -> float | None:
    """The largest change of acceleration of any link [m/s^3]."""
    return comparison.max_or_none(view.cached(_counted_jerks))


@comparison.figure("object path", "cm")
def object_path_error_m(view: comparison.Comparison) -> float | None:
    """Mean distance of the object's path from the recorded one; it shrinks with the person by design [m]."""
    distances = [
        comparison.norms((robot.positions - robot.positions[:1]) - (human.positions - human.positions[:1]))
        for robot, human in zip(view.robot_objects, view.human_objects, strict=True)
    ]
    return comparison.mean_or_none(np.array(distances))


def trunk_deviations(view: comparison.Comparison) -> Float[np.ndarray, "2 F"]:
    """Return the angle between the robot's torso and the human's chest, and how much their leans differ [deg].

    Chest and hips lean by the angle of their axis to the left over the horizontal; the larger difference counts. No
    frames where a base carries the robot.
    """
    if view.kinematics.model.spec.base != "legs":
        return np.zeros((2, 0))
    pairs = [
        (view.robot_rotation(site), view.human_rotation(joint) @ HUMAN_TO_ROBOT_AXES) for site, joint in _TRUNK_ENDS
    ]
    leans = np.arcsin(np.clip([[side[:, 2, 1] for side in pair] for pair in pairs], -1.0, 1.0))
    return np.degrees([se3.matrix_angle_between(*pairs[0]), np.abs(leans[:, 0] - leans[:, 1]).max(axis=0)])


def foot_speeds(kinematics: Kinematics, fps: float) -> Float[np.ndarray, "steps 2"]:
    """Return the horizontal speed of each ankle [m/s] from each frame to the next."""
    ankles = np.stack([kinematics.site_position(f"{side}_foot")[:, :2] for side in SIDES], axis=1)
    return comparison.norms(np.diff(ankles, axis=0)) * fps


def sole_heights(kinematics: Kinematics) -> Float[np.ndarray, "T 2"]:
    """Return the height of the lowest sole corner of each foot above the floor [m]."""
    return kinematics.soles()[..., 2].min(axis=2)


def deepest(heights: Float[np.ndarray, "F 2"]) -> float | None:
    """Return the depth [m] of the deepest sole corner; zero if none is below the floor."""
    return float(np.maximum(-heights, 0.0).max()) if heights.size else None


def joint_range_margins(motion: Motion, model: RobotModel) -> Float[np.ndarray, "T n"]:
    """Return the distance [rad] of every joint to the nearer end of its range, in every frame."""
    angles = motion.qpos[:, 7:]
    return np.minimum(angles - model.lower, model.upper - angles)


def joint_speed_margins(motion: Motion, model: RobotModel) -> Float[np.ndarray, "steps n"]:
    """Return the limit minus speed [rad/s] of every joint, from each frame to the next."""
    return model.speed_limits - np.abs(np.diff(motion.qpos[:, 7:], axis=0)) * motion.fps


def body_jerks(kinematics: Kinematics, fps: float) -> Float[np.ndarray, "J B"]:
    """Return the magnitude of the third difference of all links with mass [m/s^3], from every frame over four."""
    positions = kinematics.body_positions
    # Written out: three passes of `numpy.diff` cost twice as much.
    third = positions[3:] - positions[:-3] - 3.0 * (positions[2:-1] - positions[1:-2])
    return comparison.norms(third) * fps**3


def _counted_heights(view: comparison.Comparison) -> Float[np.ndarray, "F 2"]:
    return sole_heights(view.kinematics)[view.first :]


def _object_heights(view: comparison.Comparison) -> Float[np.ndarray, "O F"]:
    """Return the height of each object's lowest point above the floor [m]."""
    return np.array(
        [
            pose.positions[:, 2] + scale * track.geometry.lowest_along(pose.rotations[:, 2])
            for track, pose, scale in zip(view.clip.objects, view.robot_objects, view.motion.object_scale, strict=True)
        ]
    )


def _velocities(
    points: Float[np.ndarray, "F K 3"], objects: Sequence[comparison.RigidPoses], view: comparison.Comparison
) -> Float[np.ndarray, "F-1 K 3"]:
    """Return `R_o^T (v - v_o)` [m/s], or `v`, backward differences, with the rotation of the later frame."""
    if view.main_object is None:
        return np.diff(points, axis=0) * view.clip.fps
    pose = objects[view.main_object]
    # (v - v_o) is the difference of (p - p_o): the object's rotation is not differentiated.
    relative = np.diff(points - pose.positions[:, None], axis=0) * view.clip.fps
    return comparison.RigidPoses(pose.positions[1:], pose.rotations[1:]).vectors_inside(relative)


def _counted_jerks(view: comparison.Comparison) -> Float[np.ndarray, "J B"]:
    return body_jerks(view.kinematics, view.clip.fps)[view.first :]


def _robot_bones(view: comparison.Comparison, chain: _Chain) -> Float[np.ndarray, "F 8 3"]:
    points = [[view.robot_point(name.format(side=side)) for name, _ in chain] for side in SIDES]
    return _bones_inside(view.robot_rotation(chain[0][0]), points)


def _human_bones(view: comparison.Comparison, chain: _Chain) -> Float[np.ndarray, "F 8 3"]:
    points = [
        [
            view.human_part_point(f"{side}_hand") if name == _PALM else view.human_point(name.format(side=side))
            for _, name in chain
        ]
        for side in SIDES
    ]
    return _bones_inside(view.human_rotation(chain[0][1]) @ HUMAN_TO_ROBOT_AXES, points)


def _bones_inside(
    frame: Float[np.ndarray, "F 3 3"], points: list[list[Float[np.ndarray, "F 3"]]]
) -> Float[np.ndarray, "F 8 3"]:
    """Return the bones of two chains of five points each, along the axes of `frame` [m]."""
    bones = np.diff(np.array(points), axis=1)
    return bones.reshape(8, -1, 3).transpose(1, 0, 2) @ frame
