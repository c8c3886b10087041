"""Verdicts: figures against thresholds, in one table, with a reason for every number.

A verdict has two lights, one of the motion and one of its physics, each as bad as its worst figure. A missing figure is
named as not judged, never taken to be good. A fatal figure makes the motion no result.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import groupby
from pathlib import Path
from typing import Any

from hoi_retarget.clip.clip import Severity
from hoi_retarget.evaluation import COLUMNS, FIGURES, SOUNDNESS, Figure, Score, soundness
from hoi_retarget.evaluation.physics_figures import PERFORMED
from hoi_retarget.motion.motion import Motion, Stage, check_robot
from hoi_retarget.motion.motion_report import Event, Status
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import RobotModel


class Level(IntEnum):
    """From fit for use to unfit; the larger the worse."""

    PASS = 0  # No figure is beyond a threshold.
    WARN = 1  # Look at it before using it.
    FAIL = 2  # Do not train on it.

    def __str__(self) -> str:
        return self.name.lower()


@dataclass(frozen=True)
class Threshold:
    """Where one figure stops being good."""

    name: str  # Name of the figure.
    warn: float  # The last value that passes, in the unit of the figure's name.
    fail: float | None  # The last value that only warns; None where the figure alone never fails a motion.
    why: str  # Where the numbers come from.

    @property
    def light(self) -> str:
        """The light that it belongs to: `physics` or `motion`."""
        return "physics" if self.name in PHYSICS_FIGURES else "motion"

    @property
    def fatal(self) -> bool:
        """Whether a motion beyond `fail` is no result."""
        return self.name in FATAL_FIGURES

    @property
    def column(self) -> Figure:
        """The figure: title, unit and the better direction."""
        return _FIGURES[self.name]

    def level(self, value: float) -> Level:
        """Return the level of a value; NaN fails."""
        if math.isnan(value) or (self.fail is not None and self._beyond(value, self.fail)):
            return Level.FAIL
        return Level.WARN if self._beyond(value, self.warn) else Level.PASS

    def limit(self, level: Level) -> float:
        """Return the threshold that a value of this level is beyond, in the unit of the figure's name."""
        return self.fail if level is Level.FAIL and self.fail is not None else self.warn

    def _beyond(self, value: float, limit: float) -> bool:
        return value > limit if self.column.better == "lower" else value < limit


REPORTED = (
    Figure("unreached_share", "unreached contact", "%", "Share of the contact frames in which a link is out of reach"),
    Figure("thin_air_share", "contact in thin air", "%", "Share of the contact frames with an edited point in the air"),
    Figure("orientation_flip_s", "orientation flip", "s", "Time in which a link is turned from the human's", digits=2),
    Figure("recording_warnings", "warnings of the recording", "", "Number of warnings of the recording", digits=0),
    Figure("recording_errors", "errors of the recording", "", "Number of errors of the recording", digits=0),
    Figure("trunk_turn_s", "trunk turned over", "s", "Time in which the trunk is over 60 degrees off", digits=2),
    Figure("unsolved_share", "unsolved frames", "%", "Share of frames in windows that did not converge", digits=0),
)
"""Figures that follow from a result's report."""
_FIGURES = {column.name: column for column in (*COLUMNS, *SOUNDNESS, *REPORTED)}

THRESHOLDS: tuple[Threshold, ...] = (
    Threshold("contact_gap_m", 0.005, 0.010, "5 mm: mean of the paper's results; users accept 10 mm"),
    Threshold("contact_gap_p95_m", 0.020, 0.050, "beyond 2 cm a contact counts as not reached"),
    Threshold("contact_gap_max_m", 0.050, 0.100, "half of a palm's width, then all of it"),
    Threshold("touch_share", 0.75, 0.25, "a hand that misses more than approach and release is off too long"),
    Threshold("palm_touch_share", 0.02, None, "fingertips or edges of hands alone"),
    Threshold("finger_touch_share", 0.75, 0.25, "as of hands"),
    Threshold("touch_gap_p95_m", 0.010, 0.050, "a hand 1 cm off the surface holds nothing"),
    Threshold("touch_place_m", 0.100, 0.200, "one palm's width from the person's place on the object, then two"),
    Threshold("hand_slip_mps", 0.040, 0.100, "people in real clips: 35 mm/s at most; at 10 cm/s nothing is held"),
    Threshold("recorded_place_m", 0.100, None, "as for the touch place; whoever edits may mean it"),
    Threshold("thin_air_share", 0.0, 0.001, "nothing can be touched where nothing is"),
    Threshold("unreached_share", 0.02, 0.10, "share of contact frames; 2 % is 0.1 s late in a contact of 5 s"),
    Threshold(
        "relative_hand_rotation_deg", 45.0, 90.0, "landmarks: 6 at most; holds, in which people turn: 44 at most"
    ),
    Threshold("trunk_deviation_deg", 20.0, 40.0, "a robot at 45 stands beside a person who is bent double"),
    Threshold("trunk_deviation_p95_deg", 40.0, 70.0, "not followed for a moment, then for good"),
    Threshold("trunk_lean_p95_deg", 15.0, 30.0, "a shoulder hangs, then the robot seems to fall sideways"),
    Threshold("rest_gap_p95_m", 0.005, 0.050, "a cushion, then a robot that squats before its chair"),
    Threshold("penetration_max_m", 0.010, 0.030, "users accept 1 cm; a simulator pushes deeper contacts apart"),
    Threshold("penetration_p95_m", 0.005, 0.020, "5 mm is within a soft skin; palms centred on the surface sink 23 mm"),
    Threshold("self_penetration_max_m", 0.010, 0.030, "as for objects; at 3 cm a hand is inside the thigh"),
    Threshold("robot_penetration_max_m", 0.010, 0.030, "as for one robot; irrelevant if each robot is trained alone"),
    Threshold("object_below_floor_m", 0.005, 0.020, "as for the soles"),
    Threshold("object_float_m", 0.010, 0.050, "a simulator drops the object; at 5 cm the floor is wrong"),
    Threshold("support_height_error_m", 0.005, 0.020, "as for soles: a cup in its table, or over it"),
    Threshold("floor_penetration_max_m", 0.005, 0.020, "users accept 5 mm; at 2 cm a simulator lifts the robot"),
    Threshold("link_below_floor_m", 0.005, 0.020, "as for the soles"),
    Threshold("stance_float_m", 0.010, 0.030, "users accept 1 cm; a robot that starts 3 cm up falls"),
    Threshold("stance_slide_mps", 0.10, 0.20, "good motions: up to 9 cm/s at the ankles; twice that is skating"),
    Threshold("sole_tilt_deg", 3.0, 10.0, "users accept 3; at 10 the edge of a foot is 3 cm up"),
    Threshold("body_jerk_mps3", 80.0, 200.0, "real clips: 43 at most; simulated: 55 to 91; worst method: 194 (paper)"),
    Threshold("body_jerk_max_mps3", 1000.0, 3000.0, "real clips: 650 at most; unsmoothed IK: 1000; a flip: 4400"),
    Threshold("joint_range_margin_rad", -0.001, -0.035, "rounding in text files; two degrees beyond the stop"),
    Threshold("joint_speed_margin_radps", -0.01, -5.0, "beyond the motor's limit; by 5 rad/s, the joint has flipped"),
    Threshold("coupling_error_rad", 0.02, 0.05, "a joint that another one drives cannot move alone; play, springs"),
    Threshold("missing_wrench_p95_share", 0.15, None, "of body weight; 15 % is standing while leaning 9 degrees"),
    Threshold("object_missing_wrench_p95_share", 0.50, None, "of the object's weight; grips that need fingers: 100 %"),
    Threshold("torque_p95_share", 1.5, None, "of the limit; a slight excess is a slight lag; half of real clips: none"),
    Threshold("one_hand_unheld_s", 0.5, None, "one rigid palm carries more than it can hold; inertia bridges a moment"),
    Threshold("grip_margin_g", 0.2, None, "people: 0.4 on average; with less, two free hands lose 24 of 25 objects"),
    Threshold("orientation_flip_s", 0.0, 0.2, "a link against the person's; for a moment, a wrist near its stop"),
    Threshold("trunk_turn_s", 0.0, 0.0, "beyond 60 degrees against the person's; usable motions stay within 44"),
    Threshold("recording_warnings", 0.0, 5.0, "grasps that slip, feet off the floor, objects that move untouched"),
    Threshold("recording_errors", 0.0, 0.0, "feet 1 m off the floor, hands 0.5 m off objects, another unit or origin"),
    Threshold("base_turn_max_radps", 15.0, 25.0, "a spin kick has 15; a base that flips between frames, 90 or more"),
    Threshold("base_speed_max_mps", 5.0, 10.0, "5 is a fast runner; beyond 10 the base jumps"),
    Threshold("base_height_max_share", 1.3, 2.0, "of standing height; 130 % is a high jump, 200 % a wrong unit"),
    Threshold("base_height_min_share", 0.15, 0.05, "of standing height; 15 % is sitting on the floor, 5 % in it"),
    Threshold("frozen_share", 0.02, 0.50, "repeated frames; 50 % is a wrong frame rate or a still"),
    Threshold("unsolved_share", 0.0, 0.5, "frames in windows that did not converge; beyond half it is no solution"),
)
"""Every figure that is judged, in the order of importance in which reasons are given."""


LANDMARK_FIGURES = ("contact_gap_m", "contact_gap_p95_m", "contact_gap_max_m")
SURFACE_FIGURES = ("touch_share", "palm_touch_share", "touch_gap_p95_m", "touch_place_m", "recorded_place_m")
"""A motion is judged by its kind of contact targets: palms at the human's landmarks, or surfaces that touch."""
PHYSICS_FIGURES = (
    "missing_wrench_p95_share",
    "object_missing_wrench_p95_share",
    "torque_p95_share",
    "one_hand_unheld_s",
    "grip_margin_g",
)
"""Figures of the light of physics: forces that a motion would need. All others are those of the motion."""
FATAL_FIGURES = (
    *("orientation_flip_s", "trunk_turn_s", "recording_errors"),
    *("base_speed_max_mps", "base_height_max_share", "unsolved_share"),
)
"""Figures that make a motion no result where they fail.

It is no solution, turned over, elsewhere as a whole, or of a person who is far from the floor or the objects.

All are known of every motion, whichever figures were asked for.
"""


@dataclass(frozen=True)
class Reason:
    """One figure that is not good."""

    level: Level
    threshold: Threshold
    value: float

    @property
    def fatal(self) -> bool:
        """Whether it makes the motion no result."""
        nothing = math.isnan(self.value) and self.threshold.light == "motion"
        return nothing or (self.level is Level.FAIL and self.threshold.fatal)

    @property
    def kind(self) -> str:
        """One of `fatal`, `fail` and `warn`."""
        return "fatal" if self.fatal else str(self.level)

    def __str__(self) -> str:
        column = self.threshold.column
        if math.isnan(self.value):
            return f"{column.title} is no number"
        value, limit = (column.scale * number for number in (self.value, self.threshold.limit(self.level)))
        side = "above" if column.better == "lower" else "below"
        # As many digits as tell the two apart.
        texts = (f"{float(f'{value:.{digits}g}'):.10g}" for digits in (3, 5, 8))
        shown = next((text for text in texts if float(text) != limit), repr(float(value)))
        return f"{f'{column.title} {shown} {column.unit}'.rstrip()}, {side} {limit:.8g}"


def by_kind(reasons: Sequence[Reason]) -> str:
    """Return ordered reasons in a line, such as `fail: touch 11 %, below 25; warn: contact slip 31 cm/s, above 20`."""
    groups = groupby(reasons, lambda reason: reason.kind)
    return "; ".join(f"{kind}: {'; '.join(map(str, members))}" for kind, members in groups)


@dataclass(frozen=True)
class Light:
    """One light of a verdict."""

    level: Level | None  # None where no figure of it could be judged.
    reasons: tuple[Reason, ...] = ()  # Its figures that are not good: fatal ones first, then failures, then warnings.

    def __str__(self) -> str:
        return "not judged" if self.level is None else str(self.level)

    def as_json(self) -> dict[str, Any]:
        """Return plain JSON values: `level`, null where nothing was judged, and `reasons` with `kind` and `text`."""
        reasons = [{"kind": reason.kind, "text": str(reason)} for reason in self.reasons]
        return {"level": None if self.level is None else str(self.level), "reasons": reasons}


@dataclass(frozen=True)
class Verdict:
    """The two lights of a motion; its level is that of the first, as forces are what tracking has yet to find."""

    motion: Light  # By all figures but those of forces; a warning where none could be judged.
    physics: Light = Light(None)  # By `PHYSICS_FIGURES`.
    not_judged: tuple[str, ...] = ()  # Names of the figures that could not be judged, because they are not there.

    @property
    def level(self) -> Level:
        """The level of the motion's light."""
        return Level.WARN if self.motion.level is None else self.motion.level

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """The reasons of both lights, in the order of each."""
        return _ordered((*self.motion.reasons, *self.physics.reasons))

    @property
    def fatal(self) -> tuple[Reason, ...]:
        """The reasons for which the motion is no result; its file is then `NAME.npz.failed`."""
        return tuple(reason for reason in self.reasons if reason.fatal)

    def __str__(self) -> str:
        return f"motion {self.motion}, physics {self.physics}"

    def as_json(self) -> dict[str, Any]:
        """Return plain JSON values: `level`, `reasons` as sentences, both lights, and `not_judged`."""
        return {
            "level": str(self.level),
            "reasons": [str(reason) for reason in self.reasons],
            "motion": self.motion.as_json(),
            "physics": self.physics.as_json(),
            "not_judged": list(self.not_judged),
        }


def verdict_of(motion: Motion, model: RobotModel | None = None) -> Verdict:
    """Return the verdict on a result, by its report and its own numbers; the robot is by default that of its name."""
    return verdict_of_figures(judged_figures(motion, model))


def verdict_of_figures(figures: Mapping[str, float | None]) -> Verdict:
    """Return the verdict on figures by name, in stored units; None or absent means not judged.

    Without any figure of the motion to judge, its light is a warning.
    """
    missing = tuple(threshold.name for threshold in THRESHOLDS if figures.get(threshold.name) is None)
    motion = _light("motion", figures)
    return Verdict(Light(Level.WARN) if motion.level is None else motion, _light("physics", figures), missing)


def _light(name: str, figures: Mapping[str, float | None]) -> Light:
    judged = [(item, figures.get(item.name)) for item in THRESHOLDS if item.light == name]
    found = [Reason(item.level(value), item, value) for item, value in judged if value is not None]
    reasons = _ordered(reason for reason in found if reason.level is not Level.PASS)
    return Light(max((reason.level for reason in found), default=None), reasons)


def _ordered(reasons: Iterable[Reason]) -> tuple[Reason, ...]:
    return tuple(sorted(reasons, key=lambda reason: (not reason.fatal, -reason.level)))


_EXPLAINED_BY = {
    "unsolved_share": "not_converged",
    "trunk_turn_s": "trunk_turn",
    "orientation_flip_s": "orientation_flip",
}
"""Fatal figure -> the code of the warnings that explain it."""


def fatal_fault(motion: Motion) -> str:
    """Return why a motion is no result, in a sentence with the frames concerned; empty where it is one."""
    fatal = verdict_of(motion).fatal
    if not fatal:
        return ""
    code = _EXPLAINED_BY.get(fatal[0].threshold.name)
    if fatal[0].threshold.name == "recording_errors":
        told = [item for item in motion.report.source.warnings if item.severity is Severity.ERROR]
    else:
        told = [item for item in motion.warnings if item.code == code]
    explained = next((f" ({str(item).removesuffix('.')})" for item in told), "")
    return f"{'; '.join(map(str, fatal))}{explained}."


def judged_figures(motion: Motion, model: RobotModel | None = None) -> dict[str, float | None]:
    """Return the figures of a result's report and verdict, by names that end in their units; None where absent."""
    model = model or load_robot(motion.robot)
    check_robot(motion, model)
    return {
        **{threshold.name: None for threshold in THRESHOLDS},
        **motion.report.figures,
        **dict.fromkeys(_not_judged(motion)),
        **soundness(motion.qpos, motion.fps, model.forward(motion.qpos), motion.stance_flags, model.home_qpos[2]),
        **_reported(motion),
    }


def level_of(motion: Motion, name: str) -> Level | None:
    """Return the level of a figure of a result's report; None where it is not judged, or is not there."""
    value = motion.report.figures.get(name)
    threshold = next((item for item in THRESHOLDS if item.name == name), None)
    if threshold is None or value is None or name in _not_judged(motion):
        return None
    return threshold.level(value)


def _not_judged(motion: Motion) -> tuple[str, ...]:
    return LANDMARK_FIGURES if motion.report.touches_with_surfaces else SURFACE_FIGURES


def _reported(motion: Motion) -> dict[str, float | None]:
    """Return the values of `REPORTED` by name."""
    report, contacts, solves = motion.report, int(motion.contact_flags.sum()), motion.stages
    unreached, flips, in_air = report.unreached_contacts, report.orientation_flips, report.thin_air_contacts
    found = report.source.warnings
    errors = sum(warning.severity is Severity.ERROR for warning in found)
    return {
        "unreached_share": _frames(unreached) / contacts if contacts and unreached is not None else None,
        "thin_air_share": _frames(in_air) / contacts if contacts and in_air is not None else None,
        "orientation_flip_s": _frames(flips) / motion.fps if flips is not None else None,
        "trunk_turn_s": _frames(report.trunk_turns) / motion.fps if flips is not None or report.trunk_turns else None,
        "recording_warnings": float(len(found)) if report.clip else None,
        "recording_errors": float(errors) if report.clip else None,
        "unsolved_share": max(map(_unsolved_share, solves)) if solves[-1].windows else None,
    }


def _unsolved_share(stage: Stage) -> float:
    unsolved = sum(window.frames for window in stage.windows if window.status is not Status.SOLVED)
    return min(1.0, unsolved / len(stage.qpos))


def _frames(events: Sequence[Event]) -> float:
    return float(sum(event.frames for event in events))


def known_figures(motion: Motion, path: Path) -> Score:
    """Return the figures that a motion's report holds, be it none."""
    report = motion.report
    figures = {figure.name: report.figures.get(figure.name) for figure in FIGURES}
    figures |= {figure.name: value for figure in PERFORMED if (value := report.figures.get(figure.name)) is not None}
    return Score(
        path.stem.removesuffix(".npz"),  # Of one that was set aside.
        figures,
        motion.frames,
        sum(report.cpu_seconds.values()) if report.cpu_seconds else None,
        file=str(path),
        robot=motion.robot,
        root_scale=report.root_scale,
        object_scale=tuple(motion.object_scale.tolist()),
        object_surfaces=tuple(report.object_surfaces.get(name, "") for name in motion.object_names),
        verdict=None if report.is_foreign else verdict_of(motion),
        at_landmarks=not report.touches_with_surfaces,
    )
