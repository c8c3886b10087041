"""Whatever a page shows says what it means, and jumps lead to what is worst."""

import numpy as np
import pytest

from hoi_retarget.evaluation import COLUMNS
from hoi_retarget.evaluation.thresholds import THRESHOLDS
from hoi_retarget.studio.scene.curves import FORCE_GROUPS, SLIP_GROUP, TRUNK_GROUP, bar_rows, curves_of
from hoi_retarget.studio.scene.legend_texts import BARS, CURVES, LAYERS, legend_of_figure, worst_frame
from hoi_retarget.studio.scene.scene import FORCES, REFERENCE, SceneItem
from hoi_retarget.studio.scene.subplots import make_subplots
from synthetic import make
from test_curves import G1, carried


def test_every_figure_curve_and_layer_has_a_meaning() -> None:
    motion, clip = carried(), make("carry_box")
    for figure in COLUMNS:
        assert legend_of_figure(figure).rstrip(".") != figure.title, figure.name
    groups = {curve.group for curve in curves_of(motion, G1, tuple(track.geometry for track in clip.objects))}
    assert groups | {TRUNK_GROUP, SLIP_GROUP, *FORCE_GROUPS} == set(CURVES)
    subplots = make_subplots([SceneItem("G1", motion, G1, clip)])
    layers = {layer.name for subject in subplots.subjects for layer in subject.layers}
    assert {*layers, REFERENCE, FORCES} <= set(LAYERS)
    assert {bar.kind for row in bar_rows([("G1", motion)]) for bar in row.bars} <= set(BARS)


@pytest.mark.parametrize("threshold", THRESHOLDS, ids=lambda threshold: threshold.name)
def test_the_meaning_of_a_judged_figure_says_what_is_good(threshold) -> None:
    text = legend_of_figure(threshold.column)
    assert f"{threshold.column.scale * threshold.warn:g}" in text and "Good: " in text


def test_the_worst_frame_is_the_largest_deviation_or_the_least_margin_among_those_that_count() -> None:
    values = np.array([1.0, np.nan, -3.0, 2.0])
    assert worst_frame("surface gap", values, None) == 2
    assert worst_frame("jerk", values, None) == 3
    assert worst_frame("joint margin", values, None) == 2
    assert worst_frame("sole height", values, np.array([True, True, False, True])) == 3
    assert worst_frame("jerk", np.full(3, np.nan), None) is None


def test_bars_are_where_things_are_and_rows_of_two_results_are_there_once() -> None:
    motion = carried()
    rows = {row.name: row.bars for row in bar_rows([("one", motion), ("two", motion)])}
    assert set(rows) == {"left hand", "right hand", "left stance", "right stance"}
    (bar,) = rows["left hand"]
    touching = np.flatnonzero(motion.contact_flags[:, motion.contact_links.index("left_palm")]) / motion.fps
    assert (bar.start, bar.stop) == (touching[0], touching[-1])
