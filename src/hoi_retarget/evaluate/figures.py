"""All figures of one robot on one clip; `docs/metrics.md` gives every formula."""

from dataclasses import dataclass

from hoi_retarget.clip.clip import Clip
from hoi_retarget.evaluate import contact, ground, limits, movement, pose
from hoi_retarget.evaluate.view import Comparison, check_joints
from hoi_retarget.motion.motion import Motion
from hoi_retarget.robots.model import Kinematics, RobotModel


@dataclass(frozen=True)
class Figures:
    """One number per figure; None where it is undefined, such as the contact gap of a clip without contact."""

    contact_gap_m: float | None
    """Mean distance on the object between the robot's palm and the human's contact point [m]."""
    contact_gap_p95_m: float | None
    """95th percentile of that distance [m]."""
    contact_gap_max_m: float | None
    """Largest such distance [m]."""
    contact_slip_mps: float | None
    """Mean speed of the robot's palms on what they touch [m/s]."""
    body_pose_deviation_deg: float | None
    """Mean angle between 16 bone directions, in the pelvis' and the trunk's frame [deg]."""
    link_velocity_direction_deg: float | None
    """Mean angle between link velocities relative to the object [deg]."""
    relative_hand_rotation_deg: float | None
    """Mean angle between the changes of hand rotation on the object since the segment's first frame [deg]."""
    body_jerk_mps3: float | None
    """Mean third difference of the positions of all links with mass [m/s^3]."""
    body_jerk_max_mps3: float | None
    """Largest such third difference [m/s^3]."""
    stance_slide_mps: float | None
    """Mean horizontal ankle speed in stance [m/s]."""
    stance_sole_height_abs_m: float | None
    """Mean distance of the lowest sole corner from the floor in stance [m]."""
    stance_float_m: float | None
    """The same, counting only what is above the floor [m]."""
    floor_penetration_max_m: float | None
    """Depth of the deepest sole corner below the floor [m], at least 0."""
    object_below_floor_m: float | None
    """Depth of the deepest object point below the floor [m], at least 0."""
    object_path_error_m: float | None
    """Mean distance of object translations, each relative to its own first frame [m]."""
    joint_range_margin_rad: float | None
    """Smallest distance of a joint to the end of its range [rad]; negative is a violation."""
    joint_speed_margin_radps: float | None
    """Smallest distance of a joint's speed to its limit [rad/s]; negative is a violation."""


def evaluate(motion: Motion, clip: Clip, model: RobotModel, *, person: int = 0) -> Figures:
    """Return the figures of a motion against the clip it was made from.

    Args:
        motion: The robot's motion; its frames are exactly the clip's.
        clip: The human side.
        model: The robot of the motion (`robots.model.RobotModel`).
        person: Index of the person that the robot follows.

    Raises:
        ClipError: The motion does not cover the clip's frames, rate and objects.
        RobotError: The motion's joints are not the model's.
        ArgumentError: There is no such person.
    """
    check_joints(motion, model)
    return evaluate_kinematics(motion, clip, model, model.forward(motion.qpos), person=person)


def evaluate_kinematics(
    motion: Motion, clip: Clip, model: RobotModel, kinematics: Kinematics, *, person: int = 0
) -> Figures:
    """Do the same as `evaluate` where `kinematics`, the model's `forward(motion.qpos)`, is at hand."""
    check_joints(motion, model)
    view = Comparison(motion, clip, person, kinematics)
    gap, gap_p95, gap_max = contact.gap_summary(contact.contact_gaps(view))
    jerk, jerk_max = movement.jerk_summary(movement.body_jerks(kinematics, clip.fps)[view.first :])
    heights = ground.sole_heights(kinematics)[view.first :]
    return Figures(
        contact_gap_m=gap,
        contact_gap_p95_m=gap_p95,
        contact_gap_max_m=gap_max,
        contact_slip_mps=contact.contact_slip_mps(view),
        body_pose_deviation_deg=pose.body_pose_deviation_deg(view),
        link_velocity_direction_deg=movement.link_velocity_direction_deg(view),
        relative_hand_rotation_deg=contact.relative_hand_rotation_deg(view),
        body_jerk_mps3=jerk,
        body_jerk_max_mps3=jerk_max,
        stance_slide_mps=ground.stance_slide_mps(view),
        stance_sole_height_abs_m=ground.stance_sole_height_abs_m(view, heights),
        stance_float_m=ground.stance_float_m(view, heights),
        floor_penetration_max_m=ground.floor_penetration_max_m(heights),
        object_below_floor_m=ground.object_below_floor_m(view),
        object_path_error_m=movement.object_path_error_m(view),
        joint_range_margin_rad=limits.joint_range_margin_rad(motion, model),
        joint_speed_margin_radps=limits.joint_speed_margin_radps(motion, model),
    )
