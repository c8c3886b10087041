"""What curves, layers and figures mean, and which values are good, in a sentence or two each."""

from collections.abc import Callable, Mapping

import numpy as np

from hoi_retarget.evaluation import Figure
from hoi_retarget.evaluation.thresholds import LANDMARK_FIGURES, SURFACE_FIGURES, THRESHOLDS, Reason

Badness = Callable[[np.ndarray], np.ndarray]
"""Makes of a curve's values numbers that are the larger the worse."""


def _negated(values: np.ndarray) -> np.ndarray:
    return -values


CURVES: Mapping[str, tuple[str, Badness]] = {
    "surface gap": (
        "How far the skin of a hand or foot that is to touch is off the object's surface; negative inside it. "
        "Good: within 2 mm of zero.",
        np.abs,
    ),
    "inside object": (
        "How deep the robot's deepest point is inside an object. Good: 5 mm at most, 10 for a moment.",
        np.positive,
    ),
    "contact gap": (
        "How far a palm's middle is from the point where the human's was on the object, as the paper measures. Palms "
        "that touch with their skin stay a few centimetres off it.",
        np.positive,
    ),
    "sole height": (
        "Height of each foot's lowest sole corner over the floor; bold where the foot is to stand. "
        "Good: within 5 mm of zero in the bold stretches.",
        np.abs,
    ),
    "slide": ("How fast a standing foot moves over the floor. Good: below 10 cm/s.", np.positive),
    "jerk": (
        "Change of acceleration, the mean over all links and the largest. Good: a mean below 80; higher is a jolt.",
        np.positive,
    ),
    "joint margin": (
        "Way left to the nearest end of a joint's range. Zero is at the stop, which is allowed; negative is beyond it.",
        _negated,
    ),
    "speed margin": ("Speed left to the limit of the fastest joint. Negative is faster than it can.", _negated),
    "missing wrench": (
        "Force and moment that nothing present can give, over the weight of robot or object. Good: below 15 % for the "
        "robot, 50 % for an object.",
        np.positive,
    ),
    "torque": ("Torque of the joint that needs most of its limit. Good: below 100 %, up to 150 in short.", np.positive),
}
"""Each group of curves: its meaning, and which values are worse."""

BARS: Mapping[str, str] = {
    "contact": "When this part is to touch an object.",
    "stance": "When this foot is to stand.",
    "warning": "What is not right, and when. Point at a mark to read it.",
    "error": "What is not right, and when. Point at a mark to read it.",
}

LAYERS: Mapping[str, str] = {
    "robot": "The robot, as the result moves it.",
    "inverse kinematics": "The robot as it was before the trajectory was optimized: what the last stage changed.",
    "trajectory": "The robot as the optimized trajectory has it, before later stages.",
    "reference": "What a robot that performed this in simulation was to follow.",
    "before": "The robot as its motion was before the edits since the last saved ones.",
    "object": "The robot's objects, in the size in which it handles them.",
    "contacts": "A patch where the hand is to touch, a dot at the palm and a line between them: green up to 1 cm, "
    "red from 5 cm on; of surfaces that touch, how far the skin is off or in.",
    "inside something": "Dots where the robot is inside an object, itself or the floor: yellow from 2 mm, red from 15.",
    "stance": "Plates under feet that are to stand.",
    "forces": "Forces of contacts in the simulation: an arrow of 20 cm is 100 N.",
    "human": "The recorded person.",
    "human's object": "The objects as they were recorded.",
    "human's contacts": "Where the person touches the objects.",
}

_FIGURES: Mapping[str, str] = {
    "contact_gap_m": "Mean distance of palms from the points where the human's were on the object",
    "contact_gap_p95_m": "The same distance, exceeded in 5 % of the frames",
    "contact_gap_max_m": "The same distance at its largest",
    "contact_slip_mps": "Mean speed of touching palms over the object; recorded hands slide and roll too",
    "touch_share": "Share of the frames in which a hand that is to touch is within 2 mm of the surface",
    "touch_gap_p95_m": "Distance of such a hand's skin from the surface, exceeded in 5 % of the frames",
    "touch_place_m": "How far from the human's place on the surface it touches",
    "foot_touch_share": "Share of the frames in which a foot that is to touch an object does",
    "foot_touch_gap_p95_m": "Distance of such a foot from the surface, exceeded in 5 % of the frames",
    "penetration_mean_m": "Mean depth of the deepest point of the robot in objects, while it touches",
    "penetration_p95_m": "That depth, exceeded in 5 % of all frames",
    "penetration_max_m": "That depth at its largest",
    "self_penetration_max_m": "How deep one part of the robot gets into another",
    "robot_penetration_max_m": "How deep one robot gets into another",
    "link_below_floor_m": "How deep any part gets below the floor",
    "body_pose_deviation_deg": "Mean angle between the bones of robot and human; proportions alone make some",
    "link_velocity_direction_deg": "Mean angle between the velocities of hands, feet, head and pelvis of the two",
    "relative_hand_rotation_deg": "How differently a touching hand turns on the object",
    "body_jerk_mps3": "Mean change of acceleration over all links",
    "body_jerk_max_mps3": "The largest change of acceleration of any link",
    "stance_slide_mps": "Mean speed of standing feet over the floor",
    "stance_sole_height_abs_m": "Mean distance of standing soles from the floor",
    "stance_float_m": "Mean height of standing soles over the floor",
    "floor_penetration_max_m": "How deep a sole gets below the floor",
    "object_below_floor_m": "How deep an object gets below the floor",
    "object_float_m": "Mean height of resting objects over the floor",
    "object_path_error_m": "How far the object's path is from the recorded one; it shrinks with the person by design",
    "joint_range_margin_rad": "Way left to the nearest end of any joint's range; negative is beyond it",
    "joint_speed_margin_radps": "Speed left to the limit of the fastest joint; negative is beyond it",
    "missing_wrench_p95_share": "Force and moment that the robot needs and nothing gives, over its weight",
    "object_missing_wrench_p95_share": "The same of objects, over their weight",
    "torque_p95_share": "Torque of the joint that needs most, over its limit",
    "torque_over_limit_share": "Share of frames that no torques within the limits can do",
    "one_hand_unheld_s": "Time in which one hand alone holds what it cannot",
    "reference_object_m": "Mean distance of the object from where it was to be, when performed",
    "reference_object_max_m": "The same at its largest",
    "reference_object_deg": "Mean angle of the object off its reference, when performed",
    "reference_root_m": "Mean distance of the robot's root from its reference, when performed",
    "reference_root_deg": "Mean angle of the root off its reference, when performed",
    "reference_joint_rad": "Mean angle of joints off their reference, when performed",
    "stood_s": "Time until the simulated robot fell, or the end",
    "compute_s": "CPU time that it took",
}
_LIMITS = {threshold.name: threshold for threshold in THRESHOLDS}


def meaning_of_figure(figure: Figure) -> str:
    """Return what a figure says, and which values are good where it has a threshold."""
    meaning, threshold = _FIGURES.get(figure.name, figure.title), _LIMITS.get(figure.name)
    if threshold is None:
        return f"{meaning}."
    side = "up to" if figure.better == "lower" else "from"
    good = f"{meaning}. Good: {side} {figure.scale * threshold.warn:g} {figure.unit}".rstrip()
    unfit = "" if threshold.fail is None else f", unfit beyond {figure.scale * threshold.fail:g}"
    asked = {LANDMARK_FIGURES: "human's points", SURFACE_FIGURES: "surfaces"}
    only = [f" (where contacts ask for {what})" for names, what in asked.items() if figure.name in names]
    return f"{good}{unfit}{''.join(only)}."


def in_words(reason: Reason) -> str:
    """Return why a motion is no better as a sentence: what is measured, its value, and which are good."""
    figure = reason.threshold.column
    side = "up to" if figure.better == "lower" else "from"
    good = f"good {side} {figure.scale * reason.threshold.warn:g}"
    return f"{_FIGURES.get(figure.name, figure.title)}: {figure.text(reason.value)} {figure.unit}; {good}."


def badness(group: str, values: np.ndarray) -> np.ndarray:
    """Return numbers that are the larger the worse the values of a group of curves are."""
    return CURVES[group][1](values) if group in CURVES else np.abs(values)


def worst_frame(group: str, values: np.ndarray, counted: np.ndarray | None) -> int | None:
    """Return the frame in which a curve is at its worst, among those that count; None where it has no numbers."""
    there = np.isfinite(values) if counted is None else np.isfinite(values) & counted
    return int(np.where(there, badness(group, values), -np.inf).argmax()) if there.any() else None
