"""Is a motion fit for use? Figures against thresholds, in one table, with a reason for every number.

A verdict is as bad as the worst figure. A figure that is not there is named as not judged: nothing
is taken to be good because nobody measured it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import IntEnum
from typing import Any

from hoi_retarget.evaluation import COLUMNS, Figure, soundness
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.of_robot import check_robot
from hoi_retarget.motion.report import OrientationFlip, Status, UnreachedContact
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import RobotModel


class Level(IntEnum):
    """From fit for use to unfit; the larger the worse."""

    PASS = 0
    """No figure is beyond a threshold."""
    WARN = 1
    """Look at it before using it."""
    FAIL = 2
    """Do not train on it."""

    def __str__(self) -> str:
        return self.name.lower()


@dataclass(frozen=True)
class Threshold:
    """Where one figure stops being good."""

    column: Figure
    """The figure: name, title, unit and which way is better."""
    warn: float
    """The last value that passes, in the unit of the figure's name."""
    fail: float | None
    """The last value that only warns; None where the figure alone never fails a motion."""
    why: str
    """Where the numbers come from."""

    @property
    def name(self) -> str:
        """Name of the figure."""
        return self.column.name

    def level(self, value: float) -> Level:
        """Return how good a value is; what is no number fails."""
        if math.isnan(value) or (self.fail is not None and self._beyond(value, self.fail)):
            return Level.FAIL
        return Level.WARN if self._beyond(value, self.warn) else Level.PASS

    def limit(self, level: Level) -> float:
        """Return the threshold that a value of this level is beyond."""
        return self.fail if level is Level.FAIL and self.fail is not None else self.warn

    def _beyond(self, value: float, limit: float) -> bool:
        return value > limit if self.column.better == "lower" else value < limit


_KNOWN = {column.name: column for column in COLUMNS}

THRESHOLDS: tuple[Threshold, ...] = (
    Threshold(
        _KNOWN["contact_gap_m"],
        0.005,
        0.010,
        "5 mm is the mean of the paper's own results, 10 mm what users ask for at most",
    ),
    Threshold(_KNOWN["contact_gap_p95_m"], 0.020, 0.050, "beyond 2 cm a contact counts as not reached"),
    Threshold(_KNOWN["contact_gap_max_m"], 0.050, 0.100, "a palm is 10 cm wide: half of it is off, then all of it"),
    Threshold(
        _KNOWN["touch_share"],
        0.75,
        0.25,
        "of labelled frames of hands; each contact comes and goes over a few, in the rest a hand holds nothing",
    ),
    Threshold(_KNOWN["touch_gap_p95_m"], 0.010, 0.050, "1 cm off a surface nothing is held; 5 cm is another place"),
    Threshold(
        _KNOWN["touch_place_m"], 0.100, 0.200, "a palm's width from the human's place; two are another part of it"
    ),
    Threshold(
        _KNOWN["contact_slip_mps"],
        0.20,
        0.50,
        "hands of real clips slide and roll by 16 cm/s at most; 20 is one that trembles on its object by a centimetre",
    ),
    Threshold(
        Figure("unreached_share", "unreached contact", "%", 1e2, 1, "lower"),
        0.02,
        0.10,
        "of all frames of all contacts; 2 % is a hand that arrives a tenth of a second late in a contact of five",
    ),
    Threshold(
        _KNOWN["relative_hand_rotation_deg"],
        10.0,
        30.0,
        "real clips have 6 degrees at most; a method that ignores how hands turn has 38 (paper)",
    ),
    Threshold(
        _KNOWN["penetration_max_m"],
        0.010,
        0.030,
        "1 cm together with the contact gap is what users ask for; a simulator pushes apart what is deeper",
    ),
    Threshold(
        _KNOWN["penetration_p95_m"],
        0.005,
        0.020,
        "5 mm gives way as a skin does; with palms' centres on the surface, hands of real clips sink by 23",
    ),
    Threshold(
        _KNOWN["self_penetration_max_m"],
        0.010,
        0.030,
        "1 cm as for objects; from 3 cm on a hand is all in the thigh",
    ),
    Threshold(
        _KNOWN["robot_penetration_max_m"],
        0.010,
        0.030,
        "as for links of one robot; a robot that is trained alone does not meet the other",
    ),
    Threshold(_KNOWN["object_below_floor_m"], 0.005, 0.020, "as for the soles"),
    Threshold(
        _KNOWN["object_float_m"],
        0.010,
        0.050,
        "1 cm as for the soles: a simulator drops it at once; from 5 cm on the floor is elsewhere",
    ),
    Threshold(
        _KNOWN["floor_penetration_max_m"],
        0.005,
        0.020,
        "5 mm is what users ask for; from 2 cm on a simulator lifts the robot when it starts",
    ),
    Threshold(_KNOWN["link_below_floor_m"], 0.005, 0.020, "as for the soles: a knee in the floor lifts the robot, too"),
    Threshold(
        _KNOWN["stance_float_m"],
        0.010,
        0.030,
        "1 cm is what users ask for; a robot that starts 3 cm up falls before it stands",
    ),
    Threshold(
        _KNOWN["stance_slide_mps"],
        0.10,
        0.20,
        "ankles of good motions move at up to 9 cm/s while toes stand; twice that is skating",
    ),
    Threshold(
        Figure("sole_tilt_deg", "sole tilt", "deg", 1.0, 1, "lower"),
        3.0,
        10.0,
        "3 degrees is what users ask for; at 10 a foot of 20 cm has its edge 3 cm up",
    ),
    Threshold(
        _KNOWN["body_jerk_mps3"],
        80.0,
        200.0,
        "real clips have 43 at most, motions that a simulated robot tracked 55 to 91, the worst method 194 (paper)",
    ),
    Threshold(
        _KNOWN["body_jerk_max_mps3"],
        1000.0,
        3000.0,
        "real clips have 650 at most, inverse kinematics without smoothing about 1000, and 4400 where a wrist flips",
    ),
    Threshold(_KNOWN["joint_range_margin_rad"], -0.001, -0.035, "rounding of text files; two degrees beyond the stop"),
    Threshold(
        _KNOWN["joint_speed_margin_radps"],
        -0.01,
        -5.0,
        "a joint step longer than the motor's limit; 5 rad/s beyond it no motor follows, and a joint has flipped",
    ),
    Threshold(
        _KNOWN["missing_wrench_p95_share"],
        0.15,
        None,
        "of the robot's weight, from nowhere: as if it stood while it leans by 9 degrees; real clips have 28 % at most",
    ),
    Threshold(
        _KNOWN["object_missing_wrench_p95_share"],
        0.50,
        None,
        "of the object's weight: half of it hangs from hands that cannot hold it; grips by fingers have 100 %",
    ),
    Threshold(
        _KNOWN["torque_p95_share"],
        1.5,
        None,
        "of a joint's limit: a little more is given up by a little lag; half of real clips stay below 100 %",
    ),
    Threshold(
        _KNOWN["one_hand_unheld_s"],
        0.5,
        None,
        "time in which one rigid palm alone carries what it cannot; for a moment, inertia does",
    ),
    Threshold(
        Figure("orientation_flip_s", "orientation flip", "s", 1.0, 2, "lower"),
        0.0,
        0.2,
        "time in which a link points away from the human's; for a moment it is a wrist near its stop",
    ),
    Threshold(
        Figure("recording_warnings", "warnings of the recording", "", 1.0, 0, "lower"),
        0.0,
        5.0,
        "what speaks against the recording: grasps that slip, feet off the floor, objects that move untouched",
    ),
    Threshold(
        Figure("base_turn_max_radps", "base turn", "rad/s", 1.0, 1, "lower"),
        15.0,
        25.0,
        "a spin kick has 15; a base that flips between two frames has 90 and more",
    ),
    Threshold(
        Figure("base_speed_max_mps", "base speed", "m/s", 1.0, 1, "lower"),
        5.0,
        10.0,
        "a fast runner; beyond 10 the base jumps",
    ),
    Threshold(
        Figure("base_height_max_share", "base height, highest", "%", 1e2, 0, "lower"),
        1.3,
        2.0,
        "of standing: a high jump, or a floor that is not at zero; twice is a wrong unit or axis",
    ),
    Threshold(
        Figure("base_height_min_share", "base height, lowest", "%", 1e2, 0, "higher"),
        0.15,
        0.05,
        "of standing: sitting on the floor; lower than lying is in the floor",
    ),
    Threshold(
        Figure("frozen_share", "frozen frames", "%", 1e2, 1, "lower"),
        0.02,
        0.50,
        "frames that repeat the one before: recordings drop some; half of them is a wrong frame rate or a still",
    ),
    Threshold(
        Figure("unsolved_share", "unsolved frames", "%", 1e2, 0, "lower"),
        0.0,
        None,
        "frames of windows that did not converge; how good they still are, the other figures say",
    ),
)
"""Every figure that is judged, in the order of importance in which reasons are given."""


LANDMARK_FIGURES = ("contact_gap_m", "contact_gap_p95_m", "contact_gap_max_m")
SURFACE_FIGURES = ("touch_share", "touch_gap_p95_m", "touch_place_m")
"""A motion is judged by what it was asked for: palms at the human's landmarks, or surfaces that touch."""


@dataclass(frozen=True)
class Reason:
    """One figure that is not good."""

    level: Level
    threshold: Threshold
    value: float

    def __str__(self) -> str:
        column = self.threshold.column
        if math.isnan(self.value):
            return f"{column.title} is no number"
        value, limit = (column.scale * number for number in (self.value, self.threshold.limit(self.level)))
        side = "above" if column.better == "lower" else "below"
        # As many digits as tell the two apart.
        texts = (f"{float(f'{value:.{digits}g}'):.10g}" for digits in (3, 5, 8))
        shown = next((text for text in texts if float(text) != limit), repr(float(value)))
        return f"{column.title} {shown} {column.unit}, {side} {limit:.8g}"


@dataclass(frozen=True)
class Verdict:
    """How good a motion is, and why it is no better."""

    level: Level
    reasons: tuple[Reason, ...] = ()
    """The figures that are not good, the worst level first."""
    not_judged: tuple[str, ...] = ()
    """Names of the figures that could not be judged, because they are not there."""

    def as_json(self) -> dict[str, Any]:
        """Return plain JSON values: `level`, `reasons` as sentences, and `not_judged`."""
        return {
            "level": str(self.level),
            "reasons": [str(reason) for reason in self.reasons],
            "not_judged": list(self.not_judged),
        }


def verdict_of(motion: Motion, model: RobotModel | None = None) -> Verdict:
    """Return the verdict on a result, by its report and its own numbers.

    Args:
        motion: The result.
        model: Its robot; by default the one of its name. What needs a robot that is not known is not judged.
    """
    return verdict_of_figures(judged_figures(motion, model))


def verdict_of_figures(figures: Mapping[str, float | None]) -> Verdict:
    """Return the verdict on figures by name, in stored units; None or absent means not judged.

    Without any figure to judge, the verdict is a warning.
    """
    reasons, missing = [], []
    for threshold in THRESHOLDS:
        value = figures.get(threshold.name)
        if value is None:
            missing.append(threshold.name)
        elif (level := threshold.level(value)) is not Level.PASS:
            reasons.append(Reason(level, threshold, value))
    reasons.sort(key=lambda reason: -reason.level)
    nothing = Level.WARN if len(missing) == len(THRESHOLDS) else Level.PASS
    return Verdict(max((reason.level for reason in reasons), default=nothing), tuple(reasons), tuple(missing))


def judged_figures(motion: Motion, model: RobotModel | None = None) -> dict[str, float | None]:
    """Return the figures that a result's report holds, and those that only its verdict needs, by name.

    What the report does not tell is None.
    """
    return {
        **{threshold.name: None for threshold in THRESHOLDS},
        **motion.report.figures,
        **dict.fromkeys(_not_asked_for(motion)),
        **_of_kinematics(motion, model),
        "unreached_share": _unreached_share(motion),
        "orientation_flip_s": _orientation_flip_s(motion),
        "recording_warnings": float(len(motion.report.source.warnings)) if motion.report.clip else None,
        "unsolved_share": _unsolved_share(motion),
    }


def level_of(motion: Motion, name: str) -> Level | None:
    """Return how good a figure of a result's report is; None where it is not judged, or is not there."""
    value = motion.report.figures.get(name)
    threshold = next((item for item in THRESHOLDS if item.name == name), None)
    if threshold is None or value is None or name in _not_asked_for(motion):
        return None
    return threshold.level(value)


def _not_asked_for(motion: Motion) -> tuple[str, ...]:
    return LANDMARK_FIGURES if motion.report.touches_with_surfaces else SURFACE_FIGURES


def _of_kinematics(motion: Motion, model: RobotModel | None) -> dict[str, float | None]:
    model = model or load_robot(motion.robot)
    check_robot(motion, model)
    kinematics, height = model.forward(motion.qpos), float(model.home_qpos[2])
    return asdict(soundness(motion.qpos, motion.fps, kinematics, motion.stance_flags, height))


def _unreached_share(motion: Motion) -> float | None:
    contacts, unreached = int(motion.contact_flags.sum()), motion.report.unreached_contacts
    return _frames(unreached) / contacts if contacts and unreached is not None else None


def _orientation_flip_s(motion: Motion) -> float | None:
    flips = motion.report.orientation_flips
    return _frames(flips) / motion.fps if flips is not None else None


def _unsolved_share(motion: Motion) -> float | None:
    windows = motion.stages[-1].windows
    if not windows:
        return None
    unsolved = sum(window.frames for window in windows if window.status is not Status.SOLVED)
    return min(1.0, unsolved / motion.frames)


def _frames(segments: Sequence[UnreachedContact] | Sequence[OrientationFlip]) -> float:
    """Return how many frames all segments have together."""
    return float(sum(segment.last_frame - segment.first_frame + 1 for segment in segments))
