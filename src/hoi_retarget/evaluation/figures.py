"""All figures of one robot on one clip, in the order of tables; a new figure is a file and a line here."""

from collections.abc import Mapping

from hoi_retarget.clip.clip import Clip
from hoi_retarget.dynamics.physics_settings import FigureSet
from hoi_retarget.evaluation import contact_figures, hand_slip, motion_figures, penetration, physics_figures
from hoi_retarget.evaluation.comparison import Comparison, Figure
from hoi_retarget.evaluation.physics_figures import performed_figures
from hoi_retarget.motion.motion import Motion, check_robot
from hoi_retarget.robots.model import RobotModel

FIGURES: tuple[Figure, ...] = (
    contact_figures.contact_gap_m,
    contact_figures.contact_gap_p95_m,
    contact_figures.contact_gap_max_m,
    hand_slip.hand_slip_mps,
    hand_slip.person_slip_mps,
    hand_slip.hand_slip_fast_share,
    hand_slip.hand_wander_excess_m,
    hand_slip.person_wander_m,
    contact_figures.touch_share,
    contact_figures.palm_touch_share,
    contact_figures.fingertip_touch_share,
    contact_figures.touch_gap_p95_m,
    contact_figures.touch_place_m,
    contact_figures.finger_touch_share,
    contact_figures.finger_place_m,
    contact_figures.finger_depth_max_m,
    contact_figures.recorded_place_m,
    contact_figures.foot_touch_share,
    contact_figures.foot_touch_gap_p95_m,
    contact_figures.rest_share,
    contact_figures.rest_gap_p95_m,
    penetration.penetration_mean_m,
    penetration.penetration_p95_m,
    penetration.penetration_max_m,
    penetration.self_penetration_max_m,
    penetration.robot_penetration_max_m,
    penetration.link_below_floor_m,
    motion_figures.trunk_deviation_deg,
    motion_figures.trunk_deviation_p95_deg,
    motion_figures.trunk_deviation_max_deg,
    motion_figures.trunk_lean_p95_deg,
    motion_figures.body_pose_deviation_deg,
    motion_figures.link_velocity_direction_deg,
    contact_figures.relative_hand_rotation_deg,
    motion_figures.body_jerk_mps3,
    motion_figures.body_jerk_max_mps3,
    motion_figures.stance_slide_mps,
    motion_figures.stance_sole_height_abs_m,
    motion_figures.stance_float_m,
    motion_figures.floor_penetration_max_m,
    motion_figures.object_below_floor_m,
    motion_figures.object_float_m,
    motion_figures.support_height_error_m,
    motion_figures.object_path_error_m,
    motion_figures.joint_range_margin_rad,
    motion_figures.joint_speed_margin_radps,
    motion_figures.coupling_error_rad,
    *physics_figures.FEASIBILITY,
    *physics_figures.GRIP,
)


def evaluate(
    motion: Motion, clip: Clip, model: RobotModel, *, person: int = 0, figures: FigureSet = "all"
) -> Mapping[str, float | None]:
    """Return the figures of a motion against the clip it was made from, by names that end in their units.

    Args: `motion`: the robot's motion; its frames are exactly the clip's; `clip`: the human side; `model`: the robot of
    the motion; `person`: index of the person that the robot follows; `figures`: which figures are computed. Raises
    `ClipError`: the motion does not cover the clip's frames, rate and objects; `RobotError`: the motion's joints are
    not the model's; `ArgumentError`: there is no such person.
    """
    check_robot(motion, model)
    return figures_of(Comparison(motion, clip, person, model.forward(motion.qpos)), figures)


def figures_of(view: Comparison, chosen: FigureSet = "all") -> Mapping[str, float | None]:
    """Return the figures of a comparison by names that end in their units, those of simulated motions too."""
    if chosen == "none":
        return {}
    measured = {
        figure.name: figure.measure(view)
        for figure in FIGURES
        if figure.measure is not None and (chosen == "all" or not figure.slow)
    }
    return measured | performed_figures(view.motion)
