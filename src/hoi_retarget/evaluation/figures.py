"""All figures of one robot on one clip, in the order of tables; a new figure is a file and a line here."""

from collections.abc import Mapping

from hoi_retarget.clip.clip import Clip
from hoi_retarget.evaluation import contact, feasibility, ground, limits, movement, penetration, pose, touch
from hoi_retarget.evaluation.figure import Figure
from hoi_retarget.evaluation.performed import performed_figures
from hoi_retarget.evaluation.view import Comparison
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.of_robot import check_robot
from hoi_retarget.robots.model import Kinematics, RobotModel

FIGURES: tuple[Figure, ...] = (
    contact.CONTACT_GAP,
    contact.CONTACT_GAP_P95,
    contact.CONTACT_GAP_MAX,
    contact.CONTACT_SLIP,
    touch.TOUCH_SHARE,
    touch.TOUCH_GAP_P95,
    touch.TOUCH_PLACE,
    touch.FOOT_TOUCH_SHARE,
    touch.FOOT_TOUCH_GAP_P95,
    penetration.PENETRATION_MEAN,
    penetration.PENETRATION_P95,
    penetration.PENETRATION_MAX,
    penetration.SELF_PENETRATION_MAX,
    penetration.ROBOT_PENETRATION_MAX,
    penetration.LINK_BELOW_FLOOR,
    pose.BODY_POSE_DEVIATION,
    movement.LINK_VELOCITY_DIRECTION,
    contact.RELATIVE_HAND_ROTATION,
    movement.BODY_JERK,
    movement.BODY_JERK_MAX,
    ground.STANCE_SLIDE,
    ground.STANCE_SOLE_HEIGHT_ABS,
    ground.STANCE_FLOAT,
    ground.FLOOR_PENETRATION_MAX,
    ground.OBJECT_BELOW_FLOOR,
    ground.OBJECT_FLOAT,
    movement.OBJECT_PATH_ERROR,
    limits.JOINT_RANGE_MARGIN,
    limits.JOINT_SPEED_MARGIN,
    *feasibility.FEASIBILITY,
)


def evaluate(motion: Motion, clip: Clip, model: RobotModel, *, person: int = 0) -> Mapping[str, float | None]:
    """Return the figures of a motion against the clip it was made from, by name.

    Args:
        motion: The robot's motion; its frames are exactly the clip's.
        clip: The human side.
        model: The robot of the motion.
        person: Index of the person that the robot follows.

    Raises:
        ClipError: The motion does not cover the clip's frames, rate and objects.
        RobotError: The motion's joints are not the model's.
        ArgumentError: There is no such person.
    """
    check_robot(motion, model)
    return evaluate_kinematics(motion, clip, model.forward(motion.qpos), person=person)


def evaluate_kinematics(
    motion: Motion, clip: Clip, kinematics: Kinematics, *, person: int = 0
) -> Mapping[str, float | None]:
    """Do the same as `evaluate` where `kinematics`, the model's `forward(motion.qpos)`, is at hand."""
    check_robot(motion, kinematics.model)
    return figures_of(Comparison(motion, clip, person, kinematics))


def figures_of(view: Comparison) -> Mapping[str, float | None]:
    """Return the figures of a comparison, by name, with those that only a performed motion has."""
    measured = {figure.name: figure.measure(view) for figure in FIGURES if figure.measure is not None}
    return measured | performed_figures(view.motion)
