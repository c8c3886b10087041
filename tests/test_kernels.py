"""Kernels in C give what the same in numpy gives."""

import sys

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.kernels.library import COMPILED
from hoi_retarget.numerics import se3
from hoi_retarget.objects.distance_field import field_of, surface_samples
from hoi_retarget.objects.mesh import Surface
from hoi_retarget.objects.surface_samples import SolidPoses, SurfaceSamples
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.solve import solve
from hoi_retarget.retargeting.surfaces.skin_points import LinkAtObject, MovingObject, hinge_rows, near_skin
from hoi_retarget.retargeting.surfaces.skin_terms import object_outside_link, skin_contact
from hoi_retarget.retargeting.trajopt.link_pairs import near_pairs
from hoi_retarget.retargeting.trajopt.normal import assemble
from hoi_retarget.retargeting.trajopt.problem import Problem
from hoi_retarget.robots.skin import skin_of
from short_clips import taken
from synthetic import make
from trajectories import MODELS, all_terms, random_qpos

G1 = MODELS["unitree_g1"]
HAND = skin_of(G1).by_link["left_wrist_yaw_link"]
SETTINGS = settings(max_examples=8, deadline=None, derandomize=True, database=None)
seeds = st.integers(0, 10_000)


def in_numpy(function):
    """Return what a function gives without the compiled library."""
    modules = [module for name, module in sys.modules.items() if name.startswith("hoi_retarget.")]
    with pytest.MonkeyPatch.context() as patch:
        for module in modules:
            if hasattr(module, "COMPILED"):
                patch.setattr(module, "COMPILED", False)
        return function()


def assert_same(function, tolerance=1e-12) -> None:
    """Check that a function gives the same arrays with the library and without it."""
    compiled, plain = function(), in_numpy(function)
    assert len(compiled) == len(plain) > 0
    for one, other in zip(compiled, plain, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=tolerance * max(1.0, float(np.abs(other).max(initial=0))))


def rod() -> Surface:
    mesh = trimesh.creation.cylinder(0.015, 0.6, sections=12)
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.faces))


SURFACE = rod()
FIELD = field_of(SURFACE)
SAMPLES = SurfaceSamples(surface_samples(SURFACE, 0.005))


def poses(rng: np.random.Generator, count: int = 30) -> SolidPoses:
    """Return poses of a hand about a rod: in it, beside it, and far from it."""
    turns = se3.quat_to_matrix(se3.exp(rng.normal(size=(count, 3))))
    places = np.array([0.08, 0.08, 0.3]) * rng.normal(size=(count, 3))
    return SolidPoses(HAND.solid, turns, places - turns @ HAND.centre, HAND.centre, HAND.radius)


def test_this_installation_has_the_library():
    """Without it all laws below would hold of numpy alone."""
    assert COMPILED, "install again: pip install -e ."


@given(seeds)
@SETTINGS
def test_distances_from_solids_and_surfaces(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.4, 0.4, (500, 3))  # Beyond the samples, too.
    for shape in (HAND.solid, FIELD):
        for own in (points, points.T.copy().T, points[::3]):
            assert_same(lambda shape=shape, own=own: (shape.distances(own), *shape.distances_and_slopes(own)))


def test_a_place_that_is_no_number_has_no_distance():
    points = np.array([[0.0, np.nan, 0.0], [np.inf, 0.0, 0.0]])
    for shape in (HAND.solid, FIELD):
        nowhere, far = shape.distances(points)
        assert np.isnan(nowhere) and not np.isfinite(far)


@given(seeds)
@SETTINGS
def test_samples_near_a_solid_and_in_it(seed):
    rng = np.random.default_rng(seed)
    placed, pivots, sides = poses(rng), rng.normal(size=(30, 3)), rng.normal(size=(30, 3))
    sides /= np.linalg.norm(sides, axis=1, keepdims=True)
    assert_same(lambda: SAMPLES.nearest(placed, 0.012, 14, 0.008))
    assert_same(lambda: SAMPLES.inside(placed, pivots))
    assert_same(lambda: SAMPLES.ways_out(placed, sides, 0.12, 0.004))
    least, plain = SAMPLES.least_distances(placed), in_numpy(lambda: SAMPLES.least_distances(placed))
    np.testing.assert_allclose(least, plain, atol=1e-12)
    assert (least < 0).any() and np.isinf(least).any()


@pytest.mark.parametrize("count", [0, 1])
def test_a_surface_of_few_samples(count):
    placed, few = poses(np.random.default_rng(1), 5), SurfaceSamples(np.zeros((count, 3)))
    chosen, number = few.nearest(placed, 0.5, 3, 0.01)
    assert chosen.shape == (5, 3) and number.max() <= count


def beside(rng: np.random.Generator, frames: int = 12) -> LinkAtObject:
    """Return a hand that moves over a rod that moves."""
    kinematics = G1.forward(random_qpos(G1, frames, rng, wander=0.01))
    rotation = se3.quat_to_matrix(se3.exp(rng.normal(size=3) + 0.02 * rng.normal(size=(frames, 3))))
    place = kinematics.point(HAND.middle) + 0.03 * rng.normal(size=(3, 1))
    thing = MovingObject("rod", FIELD, SAMPLES, place, np.ascontiguousarray(rotation.transpose(1, 2, 0)))
    return LinkAtObject(HAND, thing, kinematics)


def parts(rows) -> list[np.ndarray]:
    return [array for part in rows for array in (part.residual, part.by_linear, part.by_angular)]


@given(seeds)
@SETTINGS
def test_rows_of_a_hand_at_an_object(seed):
    rng = np.random.default_rng(seed)
    link = beside(rng)
    there = G1.forward(G1.integrate(link.start.qpos, 2e-3 * rng.normal(size=(12, G1.nv))))

    def rows():
        near = near_skin(link, 24, 0.008)
        touch = skin_contact("hand", link, near, 2e4, np.ones(12))
        inside = object_outside_link("rod", link, near, 2e4, 14, 0.008)
        given = [near.chosen, near.nearest, near.least]
        return given + parts([*touch.rows(there), *(inside.rows(there) if inside else ())])

    assert_same(rows)


@given(seeds)
@SETTINGS
def test_hinges_with_margins_of_their_own(seed):
    rng = np.random.default_rng(seed)
    levers, normals, frames = rng.normal(size=(3, 5, 7)), rng.normal(size=(3, 5, 7)), np.arange(7)
    distances, margins = 0.05 * rng.normal(size=(5, 7)), np.where(rng.random((5, 7)) < 0.5, 0.0, -np.inf)
    for margin in (0.002, margins):
        assert_same(
            lambda margin=margin: parts([hinge_rows(HAND.frame, levers, distances, normals, margin, 1.0, frames)])
        )


@pytest.mark.parametrize("name", list(MODELS))
def test_links_in_links(name):
    model, skins = MODELS[name], skin_of(MODELS[name]).by_link
    qpos = np.repeat(model.home_qpos[None], 20, axis=0)
    joints = [model.joint_names.index(f"left_{joint}_joint") for joint in ("shoulder_roll", "elbow")]
    qpos[:, 7 + joints[0]] = np.linspace(model.upper[joints[0]], model.lower[joints[0]], 20)
    kinematics = model.forward(qpos)
    first, second = skins["left_elbow_link"], skins["torso_link"]

    def met():
        pairs = [pair for pair in near_pairs(first, second, kinematics, kinematics) if pair is not None]
        meetings = [pair.meeting(kinematics, kinematics, 0.002) for pair in pairs]
        return [
            array for found in meetings if found for array in (found.frames, found.depths, found.inwards, found.levers)
        ]

    assert_same(met)


@pytest.mark.parametrize("name", list(MODELS))
def test_poses_of_links_and_normal_equations(name):
    model, rng = MODELS[name], np.random.default_rng(3)
    qpos = random_qpos(model, 8, rng)
    assert_same(lambda: (model.forward(qpos).node_position, model.forward(qpos).node_rotation))
    kinematics = model.forward(qpos)
    problem = Problem(model, tuple(all_terms(model, 8, rng)), 30.0)
    rows = [part for some in problem.linearize(kinematics).values() for part in some]
    assert_same(lambda: (assemble(kinematics, rows).band, assemble(kinematics, rows).gradient))


def test_a_solve_needs_no_library():
    clip = taken(make("carry_box"), np.arange(40, 60))
    compiled = solve(clip, G1, Config()).motion.qpos
    plain = in_numpy(lambda: solve(clip, G1, Config()).motion.qpos)
    np.testing.assert_allclose(compiled, plain, atol=1e-6)
