"""Laws of verdicts: thresholds are inclusive, worse figures never help, and nothing unmeasured is taken as good."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.cli import main
from hoi_retarget.clip.augment import mirrored
from hoi_retarget.clip.clip import QualityWarning, Severity
from hoi_retarget.errors import ArgumentError
from hoi_retarget.evaluation import FIGURES, SOUNDNESS, soundness
from hoi_retarget.evaluation.thresholds import (
    FATAL_FIGURES,
    LANDMARK_FIGURES,
    PHYSICS_FIGURES,
    REPORTED,
    THRESHOLDS,
    Level,
    Threshold,
    Verdict,
    by_kind,
    judged_figures,
    verdict_of,
    verdict_of_figures,
)
from hoi_retarget.motion.motion import Stage
from hoi_retarget.motion.motion_report import Event, Report, Status
from hoi_retarget.numerics import se3
from hoi_retarget.readers.own_layout import write as write_clip
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from synthetic import make
from test_curves import G1, carried
from trajectories import MODELS, random_qpos

NAMES = [threshold.name for threshold in THRESHOLDS]
GOOD = {threshold.name: threshold.warn for threshold in THRESHOLDS}
numbers = st.floats(-1e4, 1e4, allow_nan=False)
some_figures = st.dictionaries(st.sampled_from(NAMES), numbers, min_size=1)


def worse_than(threshold: Threshold, value: float) -> float:
    return float(np.nextafter(value, math.inf if threshold.column.better == "lower" else -math.inf))


def by_name(threshold: Threshold) -> str:
    return threshold.name


@pytest.mark.parametrize("threshold", THRESHOLDS, ids=by_name)
def test_a_figure_at_its_threshold_passes_and_one_just_beyond_does_not(threshold):
    assert threshold.level(threshold.warn) is Level.PASS
    never_warns = threshold.fail == threshold.warn
    assert threshold.level(worse_than(threshold, threshold.warn)) is (Level.FAIL if never_warns else Level.WARN)
    if never_warns:
        return
    if threshold.fail is not None:
        assert threshold.level(threshold.fail) is Level.WARN
        assert threshold.level(worse_than(threshold, threshold.fail)) is Level.FAIL


def test_figures_at_their_thresholds_pass_without_a_reason():
    verdict = verdict_of_figures(GOOD)
    assert verdict.level is Level.PASS
    assert verdict.reasons == () == verdict.not_judged


@given(some_figures, st.sampled_from(THRESHOLDS), st.floats(0.0, 1e3))
def test_a_worse_figure_never_gives_a_better_verdict(figures, threshold, step):
    before = figures.setdefault(threshold.name, 0.0)
    worse = before + step if threshold.column.better == "lower" else before - step
    assert verdict_of_figures({**figures, threshold.name: worse}).level >= verdict_of_figures(figures).level


@given(some_figures)
def test_each_light_is_as_bad_as_its_worst_figure_and_that_of_the_motion_decides(figures):
    verdict = verdict_of_figures(figures)
    for name, light in {"motion": verdict.motion, "physics": verdict.physics}.items():
        own = [item for item in THRESHOLDS if item.light == name and item.name in figures]
        levels = [item.level(figures[item.name]) for item in own]
        assert light.level is max(levels, default=Level.WARN if name == "motion" else None)
        assert len(light.reasons) == sum(level is not Level.PASS for level in levels)
        assert {reason.threshold.light for reason in light.reasons} <= {name}
    assert verdict.level is verdict.motion.level
    assert sorted(map(str, verdict.reasons)) == sorted(map(str, verdict.motion.reasons + verdict.physics.reasons))


@given(st.dictionaries(st.sampled_from(NAMES), numbers | st.just(math.nan), min_size=1))
def test_reasons_are_in_order_fatal_ones_first_and_only_failures_are_fatal(figures):
    verdict = verdict_of_figures(figures)
    kinds = ["fatal", "fail", "warn"]
    for reasons in (verdict.reasons, verdict.motion.reasons, verdict.physics.reasons):
        assert reasons == tuple(sorted(reasons, key=lambda reason: kinds.index(reason.kind)))
        assert [reason for reason in reasons if reason.fatal and reason.level is not Level.FAIL] == []
    assert verdict.fatal == tuple(reason for reason in verdict.reasons if reason.kind == "fatal")
    assert verdict.level is Level.FAIL or not verdict.fatal


def test_every_threshold_belongs_to_one_light_and_fatal_figures_can_fail_it():
    lights = {name: [item.name for item in THRESHOLDS if item.light == name] for name in ("motion", "physics")}
    assert sorted(lights["motion"] + lights["physics"]) == sorted(NAMES)
    assert set(lights["physics"]) == set(PHYSICS_FIGURES), "no other figure is there"
    fatal = {item.name for item in THRESHOLDS if item.fatal and item.fail is not None and item.light == "motion"}
    assert fatal == set(FATAL_FIGURES)


def test_reasons_in_a_line_say_their_level_once():
    figures = {"touch_share": 0.4, "penetration_p95_m": 0.021, "unsolved_share": 1.0, "touch_place_m": 0.3}
    assert by_kind(verdict_of_figures(figures).reasons) == (
        "fatal: unsolved frames 100 %, above 50; fail: touch place 300 mm, above 200; penetration p95 21 mm, above 20; "
        "warn: touch 40 %, below 75"
    )


@given(some_figures)
def test_figures_that_are_not_there_are_named(figures):
    absent = [name for name in NAMES if name not in figures]
    assert list(verdict_of_figures(figures).not_judged) == absent
    assert list(verdict_of_figures({**dict.fromkeys(absent), **figures}).not_judged) == absent


def test_nothing_judged_is_not_good():
    assert verdict_of_figures({}).level is Level.WARN
    assert verdict_of_figures({"unheard_of": 1.0}).level is Level.WARN


@pytest.mark.parametrize("threshold", THRESHOLDS, ids=by_name)
def test_what_is_no_number_fails_its_light_and_is_fatal_for_the_motion(threshold):
    verdict = verdict_of_figures({threshold.name: math.nan})
    assert (verdict.motion if threshold.light == "motion" else verdict.physics).level is Level.FAIL
    assert bool(verdict.fatal) == (threshold.light == "motion")


def test_thresholds_are_in_order_and_each_says_why():
    assert len(set(NAMES)) == len(NAMES)
    for threshold in THRESHOLDS:
        assert threshold.why
        if threshold.fail is not None:
            worse = threshold.fail - threshold.warn
            assert worse >= 0 if threshold.column.better == "lower" else worse < 0


def test_the_documentation_has_the_same_thresholds():
    path = Path(__file__).parents[1] / "docs" / "verdicts.md"
    documented = [line for line in path.read_text().splitlines() if line.startswith("| `") and line.count("|") == 4]
    assert documented[-len(THRESHOLDS) :] == [_documented(threshold) for threshold in THRESHOLDS]


def _documented(threshold: Threshold) -> str:
    column, side = threshold.column, "" if threshold.column.better == "lower" else "below "
    limits = (threshold.warn, threshold.fail)
    warn, fail = ("-" if limit is None else f"{column.scale * limit:g}" for limit in limits)
    fail = f"**{fail}**" if threshold.fatal else fail
    return f"| `{threshold.name}` | {side}{warn} / {fail} {column.unit}".rstrip() + f" | {threshold.why} |"


def test_json_tells_level_reasons_and_what_was_not_judged():
    told = json.loads(json.dumps(verdict_of_figures({"contact_gap_m": 0.0114, "stance_slide_mps": 0.12}).as_json()))
    assert told["level"] == "fail"
    assert told["reasons"] == ["contact gap 11.4 mm, above 10", "foot slide 12 cm/s, above 10"]
    assert "body_jerk_mps3" in told["not_judged"]
    assert told["motion"]["reasons"][0] == {"kind": "fail", "text": "contact gap 11.4 mm, above 10"}
    assert told["physics"] == {"level": None, "reasons": []}, "nobody looked at forces"
    (share,) = verdict_of_figures({"unreached_share": 0.054}).reasons
    assert str(share) == "unreached contact 5.4 %, above 2"


# Verdicts on results.

UNREACHED = Event("unreached_contact", 60, 64, 0.04, subject="left_palm", object="box", mean=0.03)
FLIP = Event("orientation_flip", 60, 64, 120.0, subject="left_wrist")


def told(**report) -> dict[str, float | None]:
    return judged_figures(replace(carried(), report=replace(carried().report, **report)), G1)


@pytest.mark.slow
@pytest.mark.parametrize("clip", [make("push_table"), mirrored(make("push_table"))], ids=["as made", "mirrored"])
def test_a_good_result_passes_and_only_what_was_not_asked_for_is_not_judged(clip):
    motion = retarget(clip, G1, Config())
    verdict = verdict_of(motion)
    assert verdict.level is Level.PASS
    # Surfaces were asked for: the gap of landmarks is none of its faults. Nothing was edited, nobody sits, there is one
    # robot without fingers and couplings, and one object, which nothing carries.
    alone = ("robot_penetration_max_m", "support_height_error_m", "coupling_error_rad")
    assert verdict.not_judged == (*LANDMARK_FIGURES, "finger_touch_share", "recorded_place_m", "rest_gap_p95_m", *alone)
    assert verdict == verdict_of(motion, G1)


def test_what_sinks_in_fails():
    figures = dict(carried().report.figures)
    assert figures["penetration_max_m"] is not None
    sunk = verdict_of(
        replace(carried(), report=replace(carried().report, figures={**figures, "penetration_max_m": 0.031}))
    )
    assert sunk.level is Level.FAIL and str(sunk.reasons[0]) == "penetration max 31 mm, above 30"


def test_errors_of_a_recording_fail_and_its_warnings_do_not():
    def with_warning(severity: Severity) -> Verdict:
        source = replace(carried().report.source, warnings=(QualityWarning("grasp", severity, "Far."),))
        return verdict_of(carried().with_report(source=source), G1)

    assert with_warning(Severity.WARNING).level is Level.WARN
    assert [str(item) for item in with_warning(Severity.ERROR).fatal] == ["errors of the recording 1, above 0"]


@pytest.mark.parametrize(("up", "fault"), [(0.0, ""), (0.2, ""), (2.0, "Parts that are said")])
def test_motion_of_a_person_far_over_the_floor_is_no_result(up, fault, tmp_path, capsys):
    clip = make("carry_box")
    person = replace(clip.people[0], joint_positions=clip.people[0].joint_positions + np.array([0.0, 0.0, up]))
    write_clip(replace(clip, people=(person,)), tmp_path / "clip.npz")
    command = ["run", str(tmp_path / "clip.npz"), "--contact", "landmark", "--figures", "none"]
    assert main([*command, "--out", str(tmp_path / "out")]) == bool(fault)
    assert (tmp_path / "out" / ("clip.npz.failed" if fault else "clip.npz")).exists()
    assert not fault or f", above 0 ({fault}" in " ".join(capsys.readouterr().err.split())


def test_what_a_report_complains_of_is_counted():
    contacts = carried().contact_flags.sum()
    assert told(unreached_contacts=(UNREACHED, UNREACHED))["unreached_share"] == pytest.approx(10 / contacts)
    assert told(orientation_flips=(FLIP,))["orientation_flip_s"] == pytest.approx(5 / carried().fps)
    assert told(trunk_turns=(replace(FLIP, kind="trunk_turn"),))["trunk_turn_s"] == pytest.approx(5 / carried().fps)
    last = carried().stages[-1]
    half = replace(last.windows[0], stop=carried().frames // 2, status=Status.STALLED)
    stalled = replace(carried(), stages=(*carried().stages[:-1], replace(last, windows=(half,))))
    assert judged_figures(stalled, G1)["unsolved_share"] == pytest.approx(0.5, abs=0.01)


def test_a_clip_without_contacts_has_no_share_of_them():
    motion = carried()
    nothing = replace(motion, contact_flags=np.zeros_like(motion.contact_flags))
    assert judged_figures(nothing, G1)["unreached_share"] is None


def test_what_a_report_does_not_tell_is_not_judged():
    motion = replace(carried(), report=Report(), stages=(Stage("motion", carried().qpos),))
    figures = judged_figures(motion, G1)
    for name in ("contact_gap_m", "unreached_share", "orientation_flip_s", "unsolved_share", "recording_warnings"):
        assert figures.get(name) is None
    assert figures["sole_tilt_deg"] is not None


def test_a_motion_of_a_robot_that_is_not_known_is_not_judged():
    with pytest.raises(ArgumentError, match="no robot 'unheard_of'"):
        judged_figures(replace(carried(), robot="unheard_of"))


def test_every_judged_figure_is_one_that_somebody_computes():
    assert set(NAMES) <= {figure.name for figure in (*FIGURES, *SOUNDNESS, *REPORTED)}


# What a motion says of itself.


def sound(qpos: np.ndarray, model=G1, stance: bool = True) -> dict[str, float | None]:
    flags = np.full((len(qpos), 2), stance)
    return soundness(qpos, 30.0, model.forward(qpos), flags, float(model.home_qpos[2]))


@pytest.mark.parametrize("robot", MODELS)
@settings(max_examples=10, deadline=None)
@given(tilt=st.floats(0.0, 179.0), towards=st.floats(0.0, 6.28), yaw=st.floats(-3.1, 3.1))
def test_a_standing_robot_that_is_tilted_has_tilted_soles(robot, tilt, towards, yaw):
    model = MODELS[robot]
    qpos = np.repeat(model.home_qpos[None], 3, axis=0)
    flat = sound(qpos, model)["sole_tilt_deg"]
    assert flat is not None and flat < 1.0
    axis = np.array([np.cos(towards), np.sin(towards), 0.0])
    turn = se3.quat_multiply(se3.exp(np.radians(tilt) * axis), se3.exp(np.array([0.0, 0.0, yaw])))
    qpos[:, 3:7] = se3.quat_multiply(turn, qpos[:, 3:7])
    assert sound(qpos, model)["sole_tilt_deg"] == pytest.approx(tilt, abs=flat + 1e-6)


def test_without_stance_soles_have_no_tilt():
    assert sound(np.repeat(G1.home_qpos[None], 3, axis=0), stance=False)["sole_tilt_deg"] is None


@settings(max_examples=20, deadline=None)
@given(repeats=st.integers(1, 5), frames=st.integers(2, 20), seed=st.integers(0, 99))
def test_frames_that_are_repeated_are_frozen(repeats, frames, seed):
    moving = random_qpos(G1, frames, np.random.default_rng(seed))
    assert sound(moving)["frozen_share"] == 0.0
    share = sound(np.repeat(moving, repeats, axis=0))["frozen_share"]
    assert share == pytest.approx(frames * (repeats - 1) / (frames * repeats - 1))


def test_a_base_that_jumps_or_flips_is_fast():
    qpos = np.repeat(G1.home_qpos[None], 4, axis=0)
    assert (sound(qpos)["base_speed_max_mps"], sound(qpos)["base_turn_max_radps"]) == (0.0, 0.0)
    qpos[2:, 0] += 0.5
    qpos[3, 3:7] = se3.quat_multiply(se3.exp(np.array([0.0, 0.0, np.pi])), qpos[3, 3:7])
    assert sound(qpos)["base_speed_max_mps"] == pytest.approx(15.0)
    assert sound(qpos)["base_turn_max_radps"] == pytest.approx(30.0 * np.pi)


def test_a_base_is_measured_by_where_it_stands():
    qpos = np.repeat(G1.home_qpos[None], 3, axis=0)
    qpos[:, 2] *= (0.5, 1.0, 2.0)
    assert (sound(qpos)["base_height_min_share"], sound(qpos)["base_height_max_share"]) == (0.5, 2.0)


def test_of_a_single_frame_nothing_that_moves_is_judged():
    figures = sound(G1.home_qpos[None])
    assert (figures["frozen_share"], figures["base_speed_max_mps"], figures["base_turn_max_radps"]) == (
        None,
        None,
        None,
    )
