"""Kernels in C give what the same in numpy gives; rows and poses have laws of their own in the tests of terms."""

import numpy as np
import pytest
import scipy
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

import plain_kernels as plain
from hoi_retarget.dynamics.contact_forces import least_forces
from hoi_retarget.kernels.point_tree import Accuracy, PointTree
from hoi_retarget.numerics import se3
from hoi_retarget.objects.distance_field import field_of, surface_samples
from hoi_retarget.objects.mesh import Surface
from hoi_retarget.objects.surface_samples import SolidPoses, SurfaceSamples
from hoi_retarget.retargeting.surfaces.skin_points import (
    NEAR,
    SPREAD,
    LinkAtObject,
    MovingObject,
    near_skin,
    patches_of,
)
from hoi_retarget.retargeting.trajopt.normal import assemble
from hoi_retarget.retargeting.trajopt.problem import FrameRows
from hoi_retarget.robots.skin import skin_of
from trajectories import MODELS, random_qpos

G1 = MODELS["unitree_g1"]
HAND = skin_of(G1).by_link["left_wrist_yaw_link"]
SETTINGS = settings(max_examples=8, deadline=None, derandomize=True, database=None)
seeds = st.integers(0, 10_000)


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


@given(seeds)
@SETTINGS
def test_distances_from_solids_and_surfaces(seed):
    points = np.random.default_rng(seed).uniform(-0.4, 0.4, (500, 3))  # Beyond the samples, too.
    for shape, reference in ((HAND.solid, plain.grid_distances), (FIELD, plain.field_distances)):
        for own in (points, points.T.copy().T, points[::3]):
            distances, slopes = reference(shape, own)
            np.testing.assert_allclose(shape.distances(own), distances, atol=1e-15)
            found, along = shape.distances_and_slopes(own)
            np.testing.assert_array_equal(found, shape.distances(own))
            np.testing.assert_allclose(along, slopes, atol=1e-12)


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
    chosen, number = SAMPLES.nearest(placed, 0.012, 14, 0.008)
    found = [own[:count].tolist() for own, count in zip(chosen, number, strict=True)]
    assert found == plain.nearest(SAMPLES.points, placed, 0.012, 14, 0.008) and any(found)
    least = SAMPLES.least_distances(placed)
    np.testing.assert_allclose(least, plain.least_distances(SAMPLES.points, placed), atol=1e-12)
    assert (least < 0).any() and np.isinf(least).any()
    for sums, expected in zip(
        SAMPLES.inside(placed, pivots), plain.inside(SAMPLES.points, placed, pivots), strict=True
    ):
        np.testing.assert_allclose(sums, expected, atol=1e-9)
    ways, _ = SAMPLES.ways_out(placed, sides, 0.12, 0.004)
    np.testing.assert_allclose(ways, plain.ways_out(SAMPLES.points, placed, sides, 0.12, 0.004), atol=1e-12)
    assert ways.max() > 0.02


@pytest.mark.parametrize("count", [0, 1])
def test_a_surface_of_few_samples(count):
    placed, few = poses(np.random.default_rng(1), 5), SurfaceSamples(np.zeros((count, 3)))
    chosen, number = few.nearest(placed, 0.5, 3, 0.01)
    assert chosen.shape == (5, 3) and number.max() <= count


@given(seeds)
@SETTINGS
def test_skin_near_an_object(seed):
    rng = np.random.default_rng(seed)
    kinematics = G1.forward(random_qpos(G1, 12, rng, wander=0.01))
    rotation = se3.quat_to_matrix(se3.exp(rng.normal(size=3) + 0.02 * rng.normal(size=(12, 3))))
    place = kinematics.point(HAND.middle) + 0.03 * rng.normal(size=(3, 1))
    thing = MovingObject("rod", FIELD, SAMPLES, place, np.ascontiguousarray(rotation.transpose(1, 2, 0)))
    near = near_skin(LinkAtObject(HAND, thing, kinematics), 24, 0.008)
    world = kinematics.point(HAND.frame) + np.einsum("ijt,kj->kit", kinematics.orientation(HAND.frame), HAND.points)
    distances = thing.distances(thing.inside(world.transpose(1, 0, 2), np.arange(12)))[:, near.frames]
    least = distances.min(axis=0)
    assert (near.least <= least + 1e-12).all()
    np.testing.assert_allclose(near.nearest[least < NEAR], least[least < NEAR], atol=1e-12)
    patches, points = patches_of(HAND), HAND.points
    patch = np.empty(len(points), dtype=int)
    patch[patches.order] = np.repeat(np.arange(len(patches.count)), patches.count)
    counts = []
    for chosen, own in zip(near.chosen.tolist(), distances.T, strict=True):
        rough = own[: len(patches.count)]
        looked_at = rough - patches.radius < min(rough.min() + SPREAD, NEAR)
        expected = plain.spread(np.where(looked_at[patch], own, np.inf), points, 24, 0.008)
        assert chosen[: len(expected)] == expected
        # Then those that were not looked at, in their order, while any is apart from all before.
        for index in range(len(expected), 24):
            away = np.linalg.norm(points[:, None] - points[chosen[:index]], axis=2)
            free = np.flatnonzero(~looked_at[patch] & (away >= 0.008).all(axis=1))
            assert chosen[index] == (free[0] if free.size else chosen[0])
        counts.append(len(expected))
    assert max(counts) > 5


@pytest.mark.parametrize("name", list(MODELS))
def test_normal_equations_are_those_of_the_whole_jacobian(name):
    model, rng, count = MODELS[name], np.random.default_rng(3), 7
    kinematics = model.forward(random_qpos(model, count, rng))
    frames = [model.sites.frames[site] for site in ("left_palm", "right_foot", "head")]
    some = np.array([1, 4, 5])
    rows = [
        FrameRows(frame, rng.normal(size=(2, at)), by(at), by(at), weight, chosen)
        for frame in frames
        for at, weight, chosen in ((count, 3.0, None), (3, rng.uniform(1, 2, 3), some))
        for by in (lambda at: rng.normal(size=(2, 3, at)),)
    ]
    normal = assemble(kinematics, rows)
    square, gradient = np.zeros((count, model.nv, model.nv)), np.zeros((count, model.nv))
    for part in rows:
        at = np.arange(count) if part.frames is None else part.frames
        jacobian = kinematics.jacobian(part.frame)[at]
        by = np.concatenate([part.by_linear, part.by_angular], axis=1)
        along = np.einsum("mit,tiv->tmv", by, jacobian)
        weights = np.broadcast_to(part.weight, at.shape)
        square[at] += np.einsum("t,tmv,tmw->tvw", weights, along, along)
        gradient[at] += np.einsum("t,tmv,mt->tv", weights, along, part.residual)
    np.testing.assert_allclose(normal.gradient, gradient, atol=1e-9)
    lower = np.array([[[square[t, c + k, c] if c + k < model.nv else 0.0 for k in range(model.nv)]
                       for c in range(model.nv)] for t in range(count)])  # fmt: skip
    np.testing.assert_allclose(normal.band[:, :, : model.nv], lower, atol=1e-9)


@given(seeds)
@SETTINGS
def test_a_tree_finds_what_all_points_have(seed):
    rng = np.random.default_rng(seed)
    points = SAMPLES.points[rng.permutation(len(SAMPLES.points))[:3000]]
    placed, limit = poses(rng, 5), rng.uniform(-0.01, 0.2, 5)
    back = placed.rotations.transpose(0, 2, 1)
    origins = -np.einsum("kij,kj->ki", back, placed.origins)
    for shape, scale in ((HAND.solid, 1.0), (FIELD, 0.7)):
        accuracy = Accuracy(0.001, 0.06, 0.25, 0.45, 0.02)
        tree = PointTree.of(points)
        asked = {"limit": limit, "accuracy": accuracy, "scale": scale}
        found = tree.nearest(shape.compiled, back, origins, **asked)
        for place in range(5):
            there = (points @ back[place].T + origins[place])[tree.order]
            lower, upper = accuracy.bounds(scale * shape.distances(there / scale))
            can_be = lower <= min(limit[place], upper.min())
            own = found.place == place
            # Balls may hide some that can be, but none of which all others are sure to be farther.
            assert set(found.point[own]) <= set(np.flatnonzero(can_be)) and own.any() == can_be.any()
            np.testing.assert_allclose(found.upper[own].min(initial=np.inf), np.where(can_be, upper, np.inf).min())
            np.testing.assert_allclose(found.lower[own], lower[found.point[own]], atol=1e-12)


@given(seeds)
@SETTINGS
def test_forces_are_the_least_squares_of_those_that_are_there(seed):
    rng = np.random.default_rng(seed)
    effects, efforts = rng.normal(size=(6, 30, 12)), rng.normal(size=(6, 30, 20))
    effects[:, 20:] = effects[:, :10]  # Some that do the same.
    effects[3:, :, 6:] = 0.0
    targets, free = rng.normal(size=(6, 12)), 0.1 * rng.normal(size=(6, 20))
    targets[3:, 6:] = 0.0
    active = rng.random((6, 30)) < 0.8
    _, found = least_forces(effects, targets, 1e-3 * efforts, free, active)
    assert not found[~active].any() and found.min() == 0.0
    for frame, there in enumerate(active):
        rows = np.concatenate([effects[frame][there].T, 1e-6 * efforts[frame][there].T, 1e-4 * np.eye(there.sum())])
        aims = np.concatenate([targets[frame], 1e-3 * free[frame], np.zeros(there.sum())])
        best = rows @ scipy.optimize.nnls(rows, aims)[0] - aims
        np.testing.assert_allclose(rows @ found[frame][there] - aims, best, atol=1e-5)


@given(seeds)
@SETTINGS
def test_forces_reach_what_can_be_reached_within_limits(seed):
    rng = np.random.default_rng(seed)
    effects, efforts = rng.normal(size=(4, 40, 12)), rng.normal(size=(4, 40, 20))
    forces = np.maximum(rng.normal(size=(4, 40)), 0.0)
    targets = np.einsum("fnh,fn->fh", effects, forces)
    free = np.einsum("fni,fn->fi", efforts, forces) + rng.uniform(-0.9, 0.9, (4, 20))
    limited, unlimited = least_forces(effects, targets, efforts, free, np.ones((4, 40), dtype=bool))
    for found in (limited, unlimited):
        assert found.min() >= 0.0
        np.testing.assert_allclose(np.einsum("fnh,fn->fh", effects, found), targets, atol=1e-8)
    assert np.abs(free - np.einsum("fni,fn->fi", efforts, limited)).max() < 1.0 + 1e-6
