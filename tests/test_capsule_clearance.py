"""Capsules against a sampled surface: known depths at a box, no rows where nothing is near, the robots' capsules."""

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import KDTree

from hoi_retarget.motion.motion_report import Status
from hoi_retarget.objects.distance_field import surface_samples
from hoi_retarget.objects.mesh import Surface
from hoi_retarget.retargeting.config import Config, Weights
from hoi_retarget.retargeting.solve import solve
from hoi_retarget.retargeting.trajopt import trajectory_terms
from hoi_retarget.retargeting.trajopt.problem import cost
from synthetic import make
from synthetic.object_shapes import Block, Shape
from trajectories import MODELS

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from capsule_clearance import CAPSULES, CapsuleClearance, LinkCapsule, counted  # beside the package

G1 = MODELS["unitree_g1"]
HALF = 0.15  # [m] of the box's height
BOX = Surface(*Shape("box", (0.6, 0.4, 2 * HALF), (Block((-0.3, -0.2, 0.0), (0.3, 0.2, 2 * HALF)),)).mesh)
RADIUS = 0.05
UNTURNED = np.eye(3)
ALONG_X = LinkCapsule("pelvis", (-0.1, 0.0, 0.0), (0.1, 0.0, 0.0), RADIUS)


def term_of(samples, *, frames=1, turn=UNTURNED) -> CapsuleClearance:
    turns = np.repeat(turn[:, :, None], frames, axis=2)
    return CapsuleClearance("clearance", (ALONG_X,), KDTree(samples), np.zeros((3, frames)), turns, 1.0)


def standing(*places) -> np.ndarray:
    """Return trajectories of an upright robot with its pelvis at some places."""
    qpos = np.tile(G1.home_qpos, (len(places), 1))
    qpos[:, :3], qpos[:, 3:7] = places, (1.0, 0.0, 0.0, 0.0)
    return qpos


def residuals_of(term, qpos) -> np.ndarray:
    parts = term.rows(G1.forward(qpos))
    return np.concatenate([part.residual.ravel() for part in parts]) if parts else np.zeros(0)


@given(x=st.floats(-0.3, 0.3), side=st.floats(-0.049, 0.049), height=st.floats(0.001, 0.06), turned=st.booleans())
def test_one_sample_is_as_deep_as_its_distance_from_the_segment_says(x, side, height, turned):
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) if turned else UNTURNED
    sample = np.array([[x, side, -height]])
    beyond = max(0.0, abs(x) - 0.1)
    squared = beyond**2 + side**2 + height**2
    found = residuals_of(term_of(sample @ turn, turn=turn), standing((0.0, 0.0, 0.0)))
    if squared < RADIUS**2:
        np.testing.assert_allclose(found, (RADIUS**2 - squared) / (2 * RADIUS), atol=1e-12)
    else:
        assert found.size == 0


@pytest.mark.parametrize("depth", [0.0001, 0.002, 0.01, 0.02])
def test_a_capsule_in_the_top_of_a_box_is_as_deep_as_it_lies(depth):
    """The residual is the depth but for `depth / (2 radius)` of it; between samples it is less, by their distance."""
    spacing = 0.004
    term = term_of(surface_samples(BOX, spacing))
    deepest = residuals_of(term, standing((0.02, 0.01, HALF + RADIUS - depth))).max(initial=0.0)
    exact = depth - depth**2 / (2 * RADIUS)
    assert exact - spacing**2 / (2 * RADIUS) <= deepest <= exact + 1e-12


@given(x=st.floats(-1.0, 1.0), y=st.floats(-1.0, 1.0), gap=st.floats(1e-6, 2.0))
def test_a_capsule_off_the_box_has_no_rows(x, y, gap):
    term = term_of(surface_samples(BOX, 0.02))
    assert term.rows(G1.forward(standing((x, y, HALF + RADIUS + gap)))) == ()


def test_rows_belong_to_the_frames_that_touch():
    term = term_of(surface_samples(BOX, 0.02), frames=4)
    above, within = (0.0, 0.0, 1.0), (0.0, 0.0, HALF + 0.03)
    (rows,) = term.rows(G1.forward(standing(above, within, above, within)))
    assert rows.frames is not None
    np.testing.assert_array_equal(rows.frames, [1, 3])
    np.testing.assert_array_equal(rows.residual[:, 0], rows.residual[:, 1])


def test_a_sample_on_the_segment_costs_half_the_radius_and_pushes_nowhere():
    (rows,) = term_of(np.zeros((1, 3))).rows(G1.forward(standing((0.0, 0.0, 0.0))))
    assert rows.residual == pytest.approx(RADIUS / 2)
    assert rows.by_linear is not None and not rows.by_linear.any()


@given(spacing=st.floats(0.02, 0.2), scale=st.sampled_from([0.25, 0.5, 2.0, 4.0]))
def test_samples_lie_on_the_surface_one_for_every_square(spacing, scale):
    samples = surface_samples(BOX, spacing)
    area = 2 * (0.6 * 0.4 + 0.6 * 0.3 + 0.4 * 0.3)
    assert len(samples) == max(1, round(area / spacing**2))
    assert BOX.distances(samples).max() < 1e-9
    larger = Surface(scale * BOX.vertices, BOX.faces)
    np.testing.assert_allclose(surface_samples(larger, scale * spacing), scale * samples, atol=1e-9)


def test_samples_leave_no_part_of_the_surface_out():
    spacing = 0.02
    everywhere = surface_samples(BOX, 0.003)
    gaps = KDTree(surface_samples(BOX, spacing)).query(everywhere)[0]
    assert gaps.max() < 1.7 * spacing
    assert np.mean(gaps) < 0.6 * spacing


@pytest.mark.parametrize("model", [MODELS[name] for name in CAPSULES], ids=[*CAPSULES])
def test_there_are_as_many_capsules_as_in_the_paper_on_bodies_that_exist(model):
    capsules = CAPSULES[model.spec.name]
    assert len(capsules) == 17 and {capsule.body for capsule in capsules} <= set(model.body_frames.names)


def test_rows_follow_finite_differences():
    term = term_of(surface_samples(BOX, 0.05))
    qpos, step = standing((0.02, 0.01, HALF + 0.03)), 1e-6
    (rows,) = term.rows(G1.forward(qpos))
    for axis in range(3):
        moved = [residuals_of(term, qpos + sign * step * np.eye(qpos.shape[1])[axis]) for sign in (-1.0, 1.0)]
        np.testing.assert_allclose(rows.by_linear[:, axis, 0], (moved[1] - moved[0]) / (2 * step), atol=1e-6)


@pytest.mark.slow
def test_the_weight_moves_the_robot_out_of_the_object():
    clip, sunk = make("carry_box"), {}
    for weight in (0.0, 300.0):
        with counted(weight):
            solution = solve(clip, G1, Config(contact="landmark"))
        kinematics = G1.forward(solution.motion.qpos)
        with counted(1.0):
            every = trajectory_terms.trajectory_terms(Weights(), solution.targets, kinematics)
        (term,) = [term for term in every if term.name == "capsule_clearance_0"]
        sunk[weight] = sum(cost(rows) for rows in term.rows(kinematics))
        assert all(window.status is Status.SOLVED for window in solution.motion.stages[-1].windows)
    assert sunk[300.0] < 0.5 * sunk[0.0]
    assert not [term for term in trajectory_terms.COSTS if term.__module__ == "capsule_clearance"]
