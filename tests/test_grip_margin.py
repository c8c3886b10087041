"""Grips: linear programs against SciPy's, closed forms of margins, force closure, and what must not matter to them."""

import numpy as np
import pytest
import scipy
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from hoi_retarget.dynamics.grip_margin import (
    DIRECTIONS,
    LARGEST_MARGIN,
    LARGEST_PRESS,
    NOWHERE,
    closure,
    grip_margin,
    least_costs,
)
from hoi_retarget.dynamics.inverse_dynamics import GRAVITY
from hoi_retarget.dynamics.object_support import friction_edges, object_load
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry

CORNERS = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.15, 0.15) for z in (-0.1, 0.1)])
FRAMES = np.array([10])


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), size=st.sampled_from([1.0, 30.0, 500.0]))
def test_costs_are_least(seed, size):
    rng = np.random.default_rng(seed)
    matrices = rng.normal(size=(4, 5, 20))
    some = rng.uniform(size=(4, 20)) * (rng.uniform(size=(4, 20)) < 0.4)
    targets = size * np.einsum("bmn,bn->bm", matrices, some)
    costs = rng.uniform(0.1, 1.0, size=20)
    found = least_costs(costs, matrices, targets)
    assert found.min() >= 0.0
    np.testing.assert_allclose(np.einsum("bmn,bn->bm", matrices, found), targets, atol=1e-5 * size)
    best = [scipy.optimize.linprog(costs, A_eq=a, b_eq=b).fun for a, b in zip(matrices, targets, strict=True)]
    np.testing.assert_allclose(found @ costs, best, atol=1e-4 * size)


def load(mass: float, height: float = 1.0, turn=(1.0, 0.0, 0.0, 0.0)):
    path = np.tile([0.3, -0.2, height], (20, 1)), np.tile(turn, (20, 1))
    return object_load("box", ObjectGeometry(CORNERS), 1.0, path, 30.0, Physics(object_mass=mass))


def palm(centre, outward, turn=(1.0, 0.0, 0.0, 0.0), height=1.0):
    """A square patch of a palm on the box, in the world."""
    aside = np.eye(3)[[axis for axis in range(3) if not outward[axis]]]
    corners = np.array([a * aside[0] + b * aside[1] for a in (-0.04, 0.04) for b in (-0.04, 0.04)])
    rotation = se3.quat_to_matrix(np.array(turn))
    points = (np.array(centre) + corners) @ rotation.T + [0.3, -0.2, height]
    return points, np.tile(-rotation @ outward, (4, 1))


def sides(**options):
    return [
        [palm((0.0, 0.15, 0.0), (0.0, 1.0, 0.0), **options)],
        [palm((0.0, -0.15, 0.0), (0.0, -1.0, 0.0), **options)],
    ]


def test_two_palms_at_the_sides_of_a_box_bear_what_friction_allows():
    # With both palms' presses at their limit, less what the disturbance takes along the normals, friction is largest;
    # the pyramids' edges are along the box.
    mass, friction = 4.0, 0.8
    found = grip_margin(load(mass), FRAMES, sides(), friction)[0]
    x, y, z = np.abs(mass * GRAVITY * (found * DIRECTIONS + [0.0, 0.0, 1.0])).T
    lacking = x + z - friction * (2.0 * LARGEST_PRESS - y)
    assert lacking.max() == pytest.approx(0.0, abs=0.1)


def test_what_weighs_hardly_anything_is_held_as_firmly_as_is_counted():
    assert grip_margin(load(0.01), FRAMES, sides(), 0.8)[0] == pytest.approx(LARGEST_MARGIN, abs=1e-2)


@settings(max_examples=20, phases=[Phase.generate], deadline=None)
@given(mass=st.floats(0.5, 8.0), friction=st.floats(0.2, 1.2))
def test_heavier_or_smoother_objects_are_held_less_firmly_and_mirrored_ones_alike(mass, friction):
    found = grip_margin(load(mass), FRAMES, sides(), friction)[0]
    assert 0.0 <= found <= LARGEST_MARGIN + 1e-3
    assert grip_margin(load(1.3 * mass), FRAMES, sides(), friction)[0] <= found + 1e-3
    assert grip_margin(load(mass), FRAMES, sides(), 0.8 * friction)[0] <= found + 1e-3
    mirrored = [
        [(points * [1.0, -1.0, 1.0] - [0.0, 0.4, 0.0], inward * [1.0, -1.0, 1.0]) for points, inward in hand]
        for hand in sides()
    ]
    assert grip_margin(load(mass), FRAMES, mirrored, friction)[0] == pytest.approx(found, abs=2e-3)


def test_one_palm_below_carries_nothing_sideways_and_nothing_holds_nothing():
    below = [[palm((0.0, 0.0, -0.1), (0.0, 0.0, -1.0))]]
    assert 0.0 < grip_margin(load(1.0), FRAMES, below, 0.8)[0] < 0.5
    beside = [[palm((0.0, 0.15, 0.0), (0.0, 1.0, 0.0))]]
    assert grip_margin(load(1.0), FRAMES, beside, 0.8)[0] == 0.0
    assert grip_margin(load(1.0), FRAMES, [[NOWHERE], [NOWHERE]], 0.8)[0] == 0.0


def test_the_floor_helps():
    beside = [[palm((0.0, 0.15, 0.0), (0.0, 1.0, 0.0), height=0.1)]]
    assert grip_margin(load(1.0, height=0.1), FRAMES, beside, 0.8)[0] > 0.05


@settings(max_examples=20, phases=[Phase.generate], deadline=None)
@given(friction=st.floats(0.2, 1.2), turn=st.floats(-3.0, 3.0))
def test_force_closure_is_the_least_wrench_of_unit_forces_whatever_the_weight_and_the_turn(friction, turn):
    own = load(1.0)
    found = closure(own, FRAMES, sides(), friction)[0]
    assert found > 0.0
    assert closure(own, FRAMES, sides(), 0.5 * friction)[0] < found
    assert closure(load(30.0), FRAMES, sides(), friction)[0] == pytest.approx(found)
    quat = (np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2))
    assert closure(load(1.0, turn=quat), FRAMES, sides(turn=quat), friction)[0] == pytest.approx(
        found, rel=0.3
    )  # Pyramids.
    # What the forces can do along a direction is the most that one edge of their cones does.
    edges, centre = [], own.required.centre[10]
    for ((points, inward),) in sides():
        cone = friction_edges(inward, friction)
        arms = np.repeat((points - centre)[:, None], 4, axis=1)
        edges.append(np.concatenate([cone, np.cross(arms, cone) / own.length], axis=2).reshape(-1, 6))
    ways = np.random.default_rng(0).normal(size=(2000, 6))

    def most(way):
        return (np.concatenate(edges) @ way).max() / np.linalg.norm(way)

    near = sorted(ways, key=most)[:20]
    least = min(scipy.optimize.minimize(most, way, method="Powell").fun for way in near)
    assert found - 1e-6 <= least < found + 0.02


def test_hands_on_one_side_close_nothing():
    beside = [[palm((0.0, 0.15, 0.0), (0.0, 1.0, 0.0))]]
    assert closure(load(1.0), FRAMES, beside, 0.8)[0] == 0.0
    assert closure(load(1.0), FRAMES, [[NOWHERE], [NOWHERE]], 0.8)[0] == 0.0
    assert closure(load(1.0), FRAMES, sides(), 0.0)[0] == 0.0


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), size=st.sampled_from([1e-5, 1e-3, 0.03]), hands=st.integers(1, 2))
def test_closure_is_found_of_any_points(seed, size, hands):
    rng = np.random.default_rng(seed)
    touching = []
    for _ in range(hands):
        points = rng.normal(size=3) * 0.1 + size * rng.normal(size=(rng.integers(1, 7), 3)) + [0.3, -0.2, 1.0]
        inward = rng.normal(size=3) + rng.choice([0.0, 1e-6, 0.3]) * rng.normal(size=(len(points), 3))
        touching.append([(points, inward / np.linalg.norm(inward, axis=1, keepdims=True))])
    found = closure(load(1.0), FRAMES, touching, float(rng.uniform(0.0, 1.2)))[0]
    assert found == 0.0 or 1e-6 < found < 2.0
