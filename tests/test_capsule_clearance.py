"""Capsules against a sampled surface: known depths at a box, no rows where nothing is near, the robots' capsules."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import KDTree

from hoi_retarget.errors import ArgumentError
from hoi_retarget.motion.motion_report import Status
from hoi_retarget.objects.distance_field import surface_samples
from hoi_retarget.objects.mesh import Surface
from hoi_retarget.retargeting.config import Config, Scaling, Weights
from hoi_retarget.retargeting.solve import solve
from hoi_retarget.retargeting.targets import make_targets
from hoi_retarget.retargeting.trajopt.problem import cost
from hoi_retarget.retargeting.trajopt.terms.capsule_clearance import CapsuleClearance, capsule_terms
from hoi_retarget.retargeting.trajopt.trajectory_terms import trajectory_terms
from hoi_retarget.robots.spec import LinkCapsule
from hoi_retarget.synthetic import make
from hoi_retarget.synthetic.object_shapes import Block, Shape
from trajectories import MODELS, random_qpos

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


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS.keys())
class TestCapsulesOfRobots:
    def test_there_are_as_many_as_in_the_paper_on_bodies_that_exist(self, model):
        assert len(model.spec.capsules) == 17
        assert {capsule.body for capsule in model.spec.capsules} <= set(model.body_frames.names)

    def test_left_and_right_are_mirrored(self, model):
        upright = np.concatenate([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], np.zeros(model.n)])
        kinematics = model.forward(upright[None])
        ends = {}
        for capsule in model.spec.capsules:
            body = model.body_frames.frames[capsule.body]
            places = [kinematics.point(body.of(np.array(end), np.eye(3)))[:, 0] for end in (capsule.start, capsule.end)]
            ends[capsule.body] = np.stack(places)
        for body, places in ends.items():
            if body.startswith("left_"):
                mirrored = ends[body.replace("left_", "right_")] * [1.0, -1.0, 1.0]
                np.testing.assert_allclose(places, mirrored, atol=2e-3, err_msg=body)

    def test_their_middles_lie_in_their_links(self, model):
        geometries = model.geometries
        for capsule in model.spec.capsules:
            body = model.body_frames.frames[capsule.body]
            middle = body.of(0.5 * (np.array(capsule.start) + capsule.end), np.eye(3)).position
            shapes = [
                (geometries.types[geom], geometries.sizes[geom], geometries.frames[geom])
                for geom, carrier in enumerate(geometries.bodies)
                if carrier == capsule.body
            ]
            assert any(
                holds(kind, size, frame.rotation.T @ (middle - frame.position)) for kind, size, frame in shapes
            ), capsule.body


def holds(kind: str, size: np.ndarray, point: np.ndarray) -> bool:
    """Return whether a point [m] lies in a primitive."""
    if kind == "capsule":
        return bool(np.linalg.norm(point - [0.0, 0.0, np.clip(point[2], -size[1], size[1])]) < size[0])
    if kind == "ellipsoid":
        return bool(np.sum((point / size) ** 2) < 1.0)
    if kind == "cylinder":
        return bool(np.hypot(*point[:2]) < size[0] and abs(point[2]) < size[1])
    return bool((np.abs(point) < size).all())


def test_nothing_is_computed_at_weight_zero():
    targets = make_targets(make("carry_box"), G1, Scaling()).window(0, 5)
    reference = G1.forward(random_qpos(G1, 5, np.random.default_rng(0)))
    assert not [term for term in trajectory_terms(Weights(), targets, reference) if "capsule" in term.name]
    on = trajectory_terms(Weights(capsule_clearance=1.0), targets, reference)
    assert [term.name for term in on if "capsule" in term.name] == ["capsule_clearance_0"]


def test_a_robot_without_capsules_is_named():
    targets = make_targets(make("carry_box"), G1, Scaling()).window(0, 5)
    bare = replace(G1, spec=replace(G1.spec, capsules=()))
    reference = bare.forward(random_qpos(G1, 5, np.random.default_rng(0)))
    with pytest.raises(ArgumentError, match="unitree_g1 has no capsules"):
        list(capsule_terms(Weights(capsule_clearance=1.0), targets, reference))


@pytest.mark.slow
def test_the_weight_moves_the_robot_out_of_the_object():
    clip = make("carry_box")
    sunk = {}
    for weight in (0.0, 300.0):
        config = Config(weights=Weights(capsule_clearance=weight), contact="landmark")
        solution = solve(clip, G1, config)
        motion, targets = solution.motion, solution.targets
        kinematics = G1.forward(motion.qpos)
        (term,) = capsule_terms(Weights(capsule_clearance=1.0), targets, kinematics)
        sunk[weight] = sum(cost(rows) for rows in term.rows(kinematics))
        assert all(window.status is Status.SOLVED for window in motion.stages[-1].windows)
    assert sunk[300.0] < 0.5 * sunk[0.0]
