"""Curves over time: they are the figures before their means are taken, and their charts show all of them."""

import functools
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.errors import RobotError
from hoi_retarget.evaluation import unreached_contacts
from hoi_retarget.motion.motion import Motion, Stage
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.studio.scene.curves import MAX_POINTS, Curve, all_curves, chart_html, curves_of, named_curves
from synthetic import make
from trajectories import MODELS, random_qpos

G1 = MODELS["unitree_g1"]
LINKS = ("left_palm", "right_palm", "left_foot", "right_foot")


@functools.cache
def carried() -> Motion:
    return retarget(make("carry_box"), G1, Config())


def random_motion(frames: int, seed: int, *, robot: str = "unitree_g1", objects: int = 2) -> Motion:
    """A robot that tumbles about with contacts and stance at random."""
    model, rng = MODELS[robot], np.random.default_rng(seed)
    qpos = random_qpos(model, frames, rng)
    touched = rng.integers(-1, objects, size=(frames, len(LINKS)))
    targets = np.where(touched[:, :, None] >= 0, rng.normal(size=(frames, len(LINKS), 3)), np.nan)
    quats = rng.normal(size=(frames, objects, 4))
    return Motion(
        robot=robot,
        fps=30.0,
        joint_names=model.joint_names,
        stages=(Stage("trajectory", qpos),),
        object_names=tuple(f"object{index}" for index in range(objects)),
        object_pos=rng.normal(size=(frames, objects, 3)),
        object_quat=quats / np.linalg.norm(quats, axis=-1, keepdims=True),
        object_scale=np.ones(objects),
        contact_links=LINKS,
        contact_flags=touched >= 0,
        contact_object=touched,
        contact_points=targets,
        stance_flags=rng.random(size=(frames, 2)) < 0.5,
        first_source_frame=1,
        human_height=1.7,
    )


def group(curves: tuple[Curve, ...], name: str) -> list[Curve]:
    return [curve for curve in curves if curve.group == name]


def pooled(curves: tuple[Curve, ...], name: str, first: int) -> np.ndarray:
    """What a figure counts: from its first counted frame on."""
    parts = []
    for curve in group(curves, name):
        counted = np.ones(len(curve.values), dtype=bool) if curve.counted is None else curve.counted
        values = curve.values[first:][counted[first:]]
        parts.append(values[np.isfinite(values)])
    return np.concatenate(parts)


def test_means_and_extremes_are_the_figures() -> None:
    motion = carried()
    curves, figures = curves_of(motion, G1), motion.report.figures
    first = max(0, 1 - motion.first_source_frame)
    hands = tuple(curve for curve in curves if curve.name.endswith("palm"))
    gaps, heights = pooled(hands, "contact gap", first), pooled(curves, "sole height", first)
    assert gaps.mean() == pytest.approx(1e3 * figures["contact_gap_m"])
    assert np.percentile(gaps, 95) == pytest.approx(1e3 * figures["contact_gap_p95_m"])
    assert gaps.max() == pytest.approx(1e3 * figures["contact_gap_max_m"])
    assert np.abs(heights).mean() == pytest.approx(1e3 * figures["stance_sole_height_abs_m"])
    assert np.maximum(heights, 0).mean() == pytest.approx(1e3 * figures["stance_float_m"])
    everywhere = np.concatenate([curve.values[first:] for curve in group(curves, "sole height")])
    assert max(0.0, -everywhere.min()) == pytest.approx(1e3 * figures["floor_penetration_max_m"])
    # What lies between two frames counts when both do.
    assert pooled(curves, "slide", first + 1).mean() == pytest.approx(1e2 * figures["stance_slide_mps"])
    mean, largest = (curve.values[first + 3 :] for curve in group(curves, "jerk"))
    assert mean.mean() == pytest.approx(figures["body_jerk_mps3"])
    assert largest.max() == pytest.approx(figures["body_jerk_max_mps3"])
    (margin,), (speed,) = group(curves, "joint margin"), group(curves, "speed margin")
    assert np.radians(np.nanmin(margin.values)) == pytest.approx(figures["joint_range_margin_rad"], abs=1e-12)
    assert np.nanmin(speed.values) == pytest.approx(figures["joint_speed_margin_radps"])


def test_curves_of_surfaces_are_the_figures() -> None:
    motion, clip = carried(), make("carry_box")
    curves, figures = curves_of(motion, G1, tuple(track.geometry for track in clip.objects)), motion.report.figures
    first = max(0, 1 - motion.first_source_frame)
    gaps = np.abs(pooled(tuple(curve for curve in curves if curve.name.endswith("hand")), "surface gap", first))
    assert (gaps <= 2.0).mean() == pytest.approx(figures["touch_share"])
    assert np.percentile(gaps, 95) == pytest.approx(1e3 * figures["touch_gap_p95_m"])
    depths = pooled(curves, "inside object", first)
    assert depths.max() == pytest.approx(1e3 * figures["penetration_max_m"]) and depths.max() > 0.0
    assert np.percentile(depths, 95) == pytest.approx(1e3 * figures["penetration_p95_m"])


def test_the_slip_that_counts_is_the_figure() -> None:
    motion, clip = carried(), make("carry_box")
    curves = [curve for curve in all_curves(motion, G1, clip) if curve.group == "hand slip"]
    for ending, name in (("hand", "hand_slip_mps"), ("person", "person_slip_mps")):
        slips = pooled(tuple(curve for curve in curves if curve.name.endswith(ending)), "hand slip", 0)
        assert slips.mean() == pytest.approx(1e3 * motion.report.figures[name]) and len(slips) > 100


@settings(max_examples=20, deadline=None)
@given(frames=st.integers(1, 30), seed=st.integers(0, 99), robot=st.sampled_from(sorted(MODELS)))
def test_a_gap_is_there_when_and_only_when_its_link_touches(frames: int, seed: int, robot: str) -> None:
    motion = random_motion(frames, seed, robot=robot)
    curves = curves_of(motion, MODELS[robot])
    assert all(curve.values.shape == (frames,) and not np.isinf(curve.values).any() for curve in curves)
    gaps = {curve.name: curve.values for curve in group(curves, "contact gap")}
    for column, link in enumerate(LINKS):
        assert (link in gaps) == motion.contact_flags[:, column].any()
        if link in gaps:
            assert (np.isfinite(gaps[link]) == motion.contact_flags[:, column]).all()
    if frames > 1:
        slides = np.column_stack([curve.values for curve in group(curves, "slide")])
        both = motion.stance_flags[1:] & motion.stance_flags[:-1]
        assert np.isnan(slides[0]).all() and (np.isfinite(slides[1:]) == both).all()


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 99))
def test_unreached_contacts_are_read_off_the_gaps(seed: int) -> None:
    motion = random_motion(25, seed, objects=1)
    gaps = {curve.name: curve.values for curve in group(curves_of(motion, G1), "contact gap")}
    for segment in unreached_contacts(motion, G1.forward(motion.qpos)):
        stretch = gaps[segment.subject][segment.first_frame : segment.last_frame + 1]
        assert stretch.mean() == pytest.approx(1e3 * segment.mean)
        assert stretch.max() == pytest.approx(1e3 * segment.value)


def test_another_robot_is_refused() -> None:
    with pytest.raises(RobotError, match="robot it was made for"):
        curves_of(random_motion(5, 0), MODELS["unitree_h2"])


WAVE = re.compile(r'<path d="([^"]+)" stroke="#0072b2" stroke-width="1.4"')
WIDTH, HEIGHT = 20_000, 4000


def wave(values: np.ndarray, *, fps: float = 30.0) -> Curve:
    return Curve("wave", "mm", values, "gap", fps)


def strokes(html: str) -> list[np.ndarray]:
    """Return the points of each stroke of the first curve: horizontal, vertical."""
    found = WAVE.search(html)
    assert found
    return [
        np.array(re.findall(r"-?\d+", stroke.removesuffix("h0")), dtype=int).reshape(-1, 2)
        for stroke in found[1].split("M")[1:]
    ]


@settings(max_examples=30, deadline=None)
@given(frames=st.integers(2, 4000), seed=st.integers(0, 99), holes=st.sampled_from([0.0, 0.02, 0.9]))
def test_a_chart_shows_every_extreme_and_spans_its_frames(frames: int, seed: int, holes: float) -> None:
    rng = np.random.default_rng(seed)
    values = rng.uniform(0.0, 0.5, size=frames)
    values[rng.random(frames) < holes] = np.nan
    peak = int(rng.integers(frames))
    values[[0, -1]] = 0.25
    values[peak] = 1.0
    drawn = strokes(chart_html([("result", (wave(values),))], 30.0))
    points = np.concatenate(drawn)
    assert len(points) <= MAX_POINTS
    # The range is from zero to one: heights are known.
    assert points[:, 1].min() == 0
    assert abs(points[points[:, 1].argmin(), 0] - WIDTH * peak / (frames - 1)) <= 1
    assert points[:, 1].max() == round(HEIGHT * (1 - np.nanmin(values)))
    assert (np.diff(points[:, 0]) >= 0).all() and points[:, 0].max() <= WIDTH
    if frames <= MAX_POINTS:
        assert points[0, 0] == 0 and points[-1, 0] == WIDTH
        assert len(points) == np.isfinite(values).sum()
        assert len(drawn) == np.count_nonzero(np.diff(np.isfinite(values).astype(int), prepend=0) == 1)


def test_results_of_different_rates_share_the_time_axis() -> None:
    slow, fast = wave(np.linspace(0, 1, 31)), wave(np.linspace(0, 1, 121), fps=60.0)
    (half,) = strokes(chart_html([("slow", (slow,)), ("fast", (fast,))], 60.0))
    assert half[-1, 0] == WIDTH // 2, "one second of two"


def test_what_counts_is_drawn_bold() -> None:
    motion = carried()
    html = chart_html([("result", curves_of(motion, G1))], motion.fps)
    assert html.count('stroke-width="2.0"') == 2, "both feet's stance"


def test_a_group_without_numbers_has_no_chart() -> None:
    curves = (wave(np.full(9, np.nan)), replace(wave(np.arange(9.0)), group="jerk"))
    html = chart_html([("result", curves)], 30.0)
    assert html.count('class="chart"') == 1 and "jerk over time" in html


def test_names_are_text() -> None:
    found = set()

    class Tags(HTMLParser):
        def handle_starttag(self, tag, attrs):
            found.add(tag)

    curve = replace(wave(np.arange(9.0)), name="<script>alert(1)</script>", group='"><img src=x>', unit="<b>")
    other = replace(curve, name="&")
    Tags().feed(chart_html([("<script>", (curve, other)), ("<i>", (curve,))], 30.0))
    assert not found & {"script", "img", "b"}


def test_charts_of_five_minutes_stay_small() -> None:
    curves = curves_of(random_motion(10_000, 0), G1)
    assert len(chart_html([("long", curves)], 30.0)) < 250_000


def test_curves_have_names_of_their_own():
    motion, clip = carried(), make("carry_box")
    named, curves = named_curves(motion, clip), all_curves(motion, G1, clip)
    assert len(named) == len(curves)
    for curve, (name, values) in zip(curves, named.items(), strict=True):
        assert name == f"{curve.group}, {curve.name} [{curve.unit}]"
        assert values.shape == (motion.frames,)
    deepest = 1e3 * motion.report.figures["penetration_max_m"]
    assert np.nanmax(named["inside object, deepest [mm]"]) == pytest.approx(deepest)
    assert set(named_curves(motion)) < set(named)
