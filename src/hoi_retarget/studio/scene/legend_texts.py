"""Texts of curves, layers and figures: their meanings and good values, in a sentence or two each."""

from collections.abc import Callable, Mapping

import numpy as np

from hoi_retarget.evaluation import Figure
from hoi_retarget.evaluation.thresholds import LANDMARK_FIGURES, SURFACE_FIGURES, THRESHOLDS, Reason

Badness = Callable[[np.ndarray], np.ndarray]  # Makes of a curve's values numbers that are the larger the worse.


CURVES: Mapping[str, tuple[str, Badness]] = {
    "surface gap": (
        "How far the skin of a hand or foot that is to touch is off the object's surface; negative inside it. "
        "Good: within 2 mm of zero.",
        np.abs,
    ),
    "hand slip": (
        "How fast a hand moves over the object it touches, and the person's own; bold where that holds still. "
        "Good: a mean below 40 mm/s in the bold stretches.",
        np.positive,
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
    "trunk": (
        "The angle between the chests of robot and person, and how much more or less the robot leans sideways. "
        "Good: a mean of up to 20 degrees; a lean of up to 10.",
        np.positive,
    ),
    "jerk": (
        "Change of acceleration, the mean over all links and the largest. Good: a mean below 80; higher is a jolt.",
        np.positive,
    ),
    "joint margin": (
        "Way left to the nearest end of a joint's range. Zero is at the stop, which is allowed; negative is beyond it.",
        np.negative,
    ),
    "speed margin": ("Speed left to the limit of the fastest joint. Negative is faster than it can.", np.negative),
    "missing wrench": (
        "Force and moment that nothing present can give, over the weight of robot or object. Good: below 15 % for the "
        "robot, 50 % for an object.",
        np.positive,
    ),
    "grip margin": (
        "Acceleration in the worst direction with which hands can still move an object, beside that of the person's "
        "hands. Good: above 0.2 g; zero cannot hold it.",
        np.negative,
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

_LIMITS = {threshold.name: threshold for threshold in THRESHOLDS}


def legend_of_figure(figure: Figure) -> str:
    """Return a figure's meaning, with its good values where it has a threshold."""
    meaning, threshold = figure.meaning, _LIMITS.get(figure.name)
    if threshold is None:
        return f"{meaning}."
    side = "up to" if figure.better == "lower" else "from"
    good = f"{meaning}. Good: {side} {figure.scale * threshold.warn:g} {figure.unit}".rstrip()
    unfit = "" if threshold.fail is None else f", unfit beyond {figure.scale * threshold.fail:g}"
    targets = {LANDMARK_FIGURES: "human's points", SURFACE_FIGURES: "surfaces"}
    only = [f" (where contacts ask for {what})" for names, what in targets.items() if figure.name in names]
    return f"{good}{unfit}{''.join(only)}."


def in_words(reason: Reason) -> str:
    """Return the reason of a verdict as a sentence: the figure's meaning, its value, and the good ones."""
    figure = reason.threshold.column
    side = "up to" if figure.better == "lower" else "from"
    good = f"good {side} {figure.scale * reason.threshold.warn:g}"
    return f"{figure.meaning}: {figure.text(reason.value)} {figure.unit}; {good}."


def badness(group: str, values: np.ndarray) -> np.ndarray:
    """Return numbers that are the larger the worse the values of a group of curves are."""
    return CURVES[group][1](values) if group in CURVES else np.abs(values)


def worst_frame(group: str, values: np.ndarray, counted: np.ndarray | None) -> int | None:
    """Return a curve's worst frame among the counted ones; None where it has no numbers."""
    there = np.isfinite(values) if counted is None else np.isfinite(values) & counted
    return int(np.where(there, badness(group, values), -np.inf).argmax()) if there.any() else None
