"""Laws of verdicts: thresholds are inclusive, worse figures never help, and nothing unmeasured is taken as good."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hoi_retarget.verdict import THRESHOLDS, Level, Threshold, verdict_of_figures

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
    assert threshold.level(worse_than(threshold, threshold.warn)) is Level.WARN
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
def test_a_verdict_is_as_bad_as_its_worst_figure(figures):
    alone = [verdict_of_figures({name: value}).level for name, value in figures.items()]
    verdict = verdict_of_figures(figures)
    assert verdict.level is max(alone)
    assert len(verdict.reasons) == sum(level is not Level.PASS for level in alone)
    assert [reason.level for reason in verdict.reasons] == sorted((r.level for r in verdict.reasons), reverse=True)


@given(some_figures)
def test_figures_that_are_not_there_are_named(figures):
    absent = [name for name in NAMES if name not in figures]
    assert list(verdict_of_figures(figures).not_judged) == absent
    assert list(verdict_of_figures({**dict.fromkeys(absent), **figures}).not_judged) == absent


def test_nothing_judged_is_not_good():
    assert verdict_of_figures({}).level is Level.WARN
    assert verdict_of_figures({"unheard_of": 1.0}).level is Level.WARN


@pytest.mark.parametrize("threshold", THRESHOLDS, ids=by_name)
def test_what_is_no_number_fails(threshold):
    assert verdict_of_figures({threshold.name: math.nan}).level is Level.FAIL


def test_thresholds_are_in_order_and_each_says_why():
    assert len(set(NAMES)) == len(NAMES)
    for threshold in THRESHOLDS:
        assert threshold.why
        if threshold.fail is not None:
            assert (threshold.fail > threshold.warn) == (threshold.column.better == "lower")


def test_json_tells_level_reasons_and_what_was_not_judged():
    told = json.loads(json.dumps(verdict_of_figures({"contact_gap_m": 0.0114, "stance_slide_mps": 0.12}).as_json()))
    assert told["level"] == "fail"
    assert told["reasons"] == ["contact gap 11.4 mm, above 10", "foot slide 12 cm/s, above 10"]
    assert "body_jerk_mps3" in told["not_judged"]
