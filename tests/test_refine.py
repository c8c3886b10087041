"""Laws of refinement: costs of states, simulations side by side, and motions that are performed."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.dynamics.physics_scene import compiled
from hoi_retarget.dynamics.physics_settings import Refinement
from hoi_retarget.errors import ArgumentError
from hoi_retarget.simulation.control import (
    KNOT,
    TrackingProblem,
    changes_at,
    feedback_gains,
    rollout_gains,
    simulated_costs,
)
from hoi_retarget.simulation.refine import ControlledRollout, jerk, refine, smooth
from hoi_retarget.simulation.rollout import (
    MAX_OBJECT_COST,
    TICK,
    TrackingCost,
    deviations,
    drive_targets,
    object_errors,
    track,
)
from plain_motions import standing_qpos
from test_rollout import G1, staged

FEW = Refinement(horizon=0.4, samples=8, most_samples=16, iterations=1, attempts=1)


@cache
def standing_course():
    """A robot that stands still for a second, with a hand on a box."""
    qpos = standing_qpos(G1, 31)
    touching = np.tile([True, False], (len(qpos), 1))
    points = np.where(touching[..., None], np.full(3, 0.1), np.nan)
    _, scene, reference = staged(
        qpos, contact_flags=touching, contact_object=np.where(touching, 0, -1), contact_points=points
    )
    simulated = compiled(scene)
    gains = feedback_gains(scene, simulated, reference, objects=False)
    return TrackingProblem(
        scene, simulated, reference, drive_targets(scene, reference), gains, TrackingCost(scene, reference)
    )


@pytest.fixture
def problem():
    return standing_course()


def states(problem, tick, move, count=1):
    """The reference's state at a tick, moved along 2 nv numbers, some times over."""
    qpos, nv = problem.reference.qpos[tick].copy(), problem.simulated.nv
    mujoco.mj_integratePos(problem.simulated, qpos, np.array(move[:nv]), 1.0)
    return np.tile(qpos, (count, 1)), np.tile(problem.reference.qvel[tick] + move[nv:], (count, 1))


@settings(deadline=None, max_examples=30)
@given(index=st.integers(0, 2 * (6 + G1.n + 6) - 1), size=st.floats(0.01, 0.3), sign=st.sampled_from([-1, 1]))
def test_cost_is_zero_on_the_reference_and_nowhere_else(index, size, sign):
    problem = standing_course()
    move = np.zeros(2 * problem.simulated.nv)
    assert problem.cost(7, *states(problem, 7, move)) == pytest.approx(0.0, abs=1e-18)
    move[index] = sign * size
    no_cost = index in range(2 * problem.simulated.nv - 3, 2 * problem.simulated.nv)  # How fast objects turn.
    found, twice = (problem.cost(7, *states(problem, 7, share * move))[0] for share in (1.0, 2.0))
    assert (found == pytest.approx(0.0, abs=1e-18)) if no_cost else twice > found > 0.0


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_cost_does_not_depend_on_where_the_world_is_or_on_other_states(seed):
    problem = standing_course()
    random = np.random.default_rng(seed)
    moves = 0.1 * random.standard_normal((3, 2 * problem.simulated.nv))
    alone = [problem.cost(3, *states(problem, 3, move)) for move in moves]
    qpos, qvel = (np.concatenate(parts) for parts in zip(*(states(problem, 3, move) for move in moves), strict=True))
    np.testing.assert_allclose(problem.cost(3, qpos, qvel), np.concatenate(alone), rtol=1e-9)
    offset = np.zeros(len(qpos[0]))
    offset[[0, 1, 7 + G1.n, 8 + G1.n]] = [3.0, -2.0, 3.0, -2.0]
    moved = replace(problem.reference, qpos=problem.reference.qpos + offset)
    np.testing.assert_allclose(
        TrackingCost(problem.scene, moved)(3, qpos + offset, qvel), np.concatenate(alone), rtol=1e-6
    )


def test_an_object_that_is_lost_costs_more_the_further_it_is_off_and_never_more_than_the_limit(problem):
    far = np.zeros((4, 2 * problem.simulated.nv))
    far[:, 6 + G1.n] = [0.1, 0.3, 1.0, 100.0]
    found = [problem.cost(7, *states(problem, 7, move))[0] for move in far]
    assert found == sorted(found) and 0.9 * MAX_OBJECT_COST < found[-1] < MAX_OBJECT_COST


def test_cost_of_numbers_that_are_not_finite_is_infinite(problem):
    qpos, qvel = states(problem, 0, np.zeros(2 * problem.simulated.nv), count=3)
    qpos[0, 9], qvel[1, 2] = np.nan, np.inf
    assert np.isinf(problem.cost(0, qpos, qvel)).tolist() == [True, True, False]


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), size=st.floats(0.0, 2.0))
def test_deviations_are_mujocos(seed, size):
    problem = standing_course()
    move = size * np.random.default_rng(seed).uniform(-1.0, 1.0, 2 * problem.simulated.nv)
    qpos, qvel = states(problem, 4, move)
    expected = np.empty(problem.simulated.nv)
    mujoco.mj_differentiatePos(problem.simulated, expected, 1.0, problem.reference.qpos[4], qpos[0])
    found = deviations(problem.reference, G1.n, 4, qpos, qvel)[0]
    np.testing.assert_allclose(found, [*expected, *move[problem.simulated.nv :]], atol=1e-9)


def test_changes_go_from_knot_to_knot_without_a_kink():
    knots = np.random.default_rng(2).standard_normal((3, 4, 2))
    path = np.stack([changes_at(knots, tick) for tick in range(3 * KNOT + 1)], axis=1)
    np.testing.assert_array_equal(path[:, ::KNOT], knots)
    low, high = np.minimum(knots[:, :-1], knots[:, 1:]), np.maximum(knots[:, :-1], knots[:, 1:])
    between = path[:, :-1].reshape(3, 3, KNOT, 2)
    assert (between >= low[:, :, None] - 1e-12).all() and (between <= high[:, :, None] + 1e-12).all()
    turns, steps = np.abs(np.diff(path, 2, axis=1)), np.abs(np.diff(knots, axis=1)).max()
    assert turns.max() < 0.7 * steps / KNOT  # Straight lines turn by up to twice the step over its ticks.


def test_simulations_side_by_side_do_what_one_alone_does(problem):
    """The cost that was promised is that of the motion that is then performed, tick by tick."""
    simulated, nv = problem.simulated, problem.simulated.nv
    data = mujoco.MjData(simulated)
    data.qpos[:], data.qvel[:] = problem.reference.qpos[0], problem.reference.qvel[0]
    knots = np.random.default_rng(1).normal(0.0, 0.02, (4, 4, G1.n + 6))
    promised = simulated_costs(problem, data, 0, knots, 25)
    costs = []
    for tick in range(25):
        changes = changes_at(knots[2:3], tick)
        data.ctrl[:] = problem.targets_at(tick, data.qpos[None], data.qvel[None], changes)[0]
        mujoco.mj_step(simulated, data, problem.steps)
        costs.append(problem.cost(tick + 1, data.qpos[None], data.qvel[None])[0])
    assert promised[2] == pytest.approx((np.sum(costs[4::5]) + costs[-1]) / 6.0, rel=1e-3)
    assert len(set(promised.tolist())) == 4 and len(data.qvel) == nv


def test_simulations_that_mujoco_cannot_continue_cost_infinitely_much(problem, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data = mujoco.MjData(problem.simulated)
    data.qpos[:], data.qvel[10] = problem.reference.qpos[0], 1e12
    costs = simulated_costs(problem, data, 0, np.zeros((2, 2, G1.n + 6)), 5)
    assert np.isinf(costs).all() and not list(tmp_path.iterdir())


def test_without_noise_refinement_is_tracking_with_feedback(problem):
    refined = refine(problem.scene, problem.reference, replace(FEW, noise=0.0))
    plain = track(problem.simulated, problem.reference, problem.targets, problem.gains)
    np.testing.assert_allclose(refined.rollout.qpos, plain.qpos, atol=1e-12)
    np.testing.assert_allclose(refined.rollout.targets[:-1], plain.targets[:-1], atol=1e-12)
    assert refined.rollout.fell_after is plain.fell_after is None


@cache
def gliding():
    """A robot that glides away, on feet that stand."""
    qpos = standing_qpos(G1, 46)
    qpos[:, 0] += np.linspace(0.0, 1.0, len(qpos)) ** 2 * 5.0
    _, scene, reference = staged(qpos)
    return scene, reference


@pytest.mark.slow
def test_the_same_seed_has_the_same_bytes_and_another_seed_others():
    told = []
    one, two = (refine(*gliding(), FEW, seed=3, on_progress=told.append) for _ in range(2))
    other = refine(*gliding(), FEW, seed=4)
    for name in ("qpos", "qvel", "targets"):
        assert getattr(one.rollout, name).tobytes() == getattr(two.rollout, name).tobytes()
    assert one.gains.tobytes() == two.gains.tobytes() and one.steps == two.steps
    assert one.rollout.qpos.tobytes() != other.rollout.qpos.tobytes()
    assert told[: len(told) // 2] == told[len(told) // 2 :]


def test_performed_targets_give_the_performed_motion_again():
    scene, reference = gliding()
    refined = refine(scene, reference, FEW, seed=5)
    again = track(compiled(scene), reference, refined.rollout.targets)
    assert again.qpos.tobytes() == refined.rollout.qpos.tobytes()


def test_a_smoother_motion_is_simulated_too_and_keeps_objects_where_they_were(problem):
    rough = refine(problem.scene, problem.reference, replace(FEW, noise=0.0))
    shaken = rough.rollout.targets + 0.02 * np.random.default_rng(0).standard_normal(rough.rollout.targets.shape)
    rollout = track(problem.simulated, problem.reference, shaken, problem.gains)
    assert rollout.fell_after is None
    gains = rollout_gains(problem.scene, rollout)
    motion = ControlledRollout(rollout, gains)
    found = smooth(problem.scene, problem.simulated, problem.reference, motion).rollout
    assert jerk(problem.scene, found) < 0.8 * jerk(problem.scene, rollout)
    before, after = (object_errors(item, problem.reference, G1.n).mean() for item in (rollout, found))
    assert after <= 1.05 * before + 0.002
    again = track(problem.simulated, problem.reference, found.targets)
    assert again.qpos.tobytes() == found.qpos.tobytes() and found.fell_after is None


@pytest.mark.parametrize("end", ["begins", "ends"])
def test_a_motion_off_balance_is_performed_with_a_lead_and_goes_on_from_it(end):
    qpos = standing_qpos(G1, 31)
    way = np.linspace(1.0, 0.0, 31) if end == "begins" else np.linspace(0.0, 1.0, 31)
    qpos[:, 0] += 0.13 * way**3 * (-1.0 if end == "begins" else 1.0)
    _, scene, reference = staged(qpos)
    refined = refine(scene, reference, replace(FEW, noise=0.0))
    rollout, simulated = refined.rollout, compiled(scene)
    lead = refined.lead_in if end == "begins" else refined.lead_out
    assert lead is not None and (refined.lead_in is None) != (refined.lead_out is None)
    assert rollout.fell_after is None and len(rollout.qpos) == len(reference.qpos) == len(refined.gains)
    meeting = lead.rollout.qpos[-1] if end == "begins" else lead.rollout.qpos[0]
    assert meeting.tobytes() == rollout.qpos[0 if end == "begins" else -1].tobytes()
    path = replace(reference, qpos=rollout.qpos, qvel=rollout.qvel)
    assert track(simulated, path, rollout.targets).qpos.tobytes() == rollout.qpos.tobytes()


def test_a_motion_that_nothing_holds_up_is_kept_to_the_fall_after_every_attempt():
    scene, reference = gliding()
    told = []
    refined = refine(scene, reference, FEW, on_progress=told.append)
    rollout = refined.rollout
    assert rollout.fell_after is not None and rollout.fell_after < reference.seconds
    assert len(rollout.qpos) == len(rollout.targets) == len(refined.gains) == round(rollout.fell_after / TICK)
    assert np.isfinite(rollout.qpos).all() and {item.samples for item in told} == {8, 16}


def test_an_object_that_is_lost_whatever_comes_ends_the_motion_after_every_attempt():
    qpos = standing_qpos(G1, 46)
    place = np.tile([0.0, 2.0, 0.2], (46, 1, 1))
    place[:, 0, 0] += np.linspace(0.0, 1.0, 46)  # A box that nobody moves.
    labels = np.tile([True, False], (46, 1))
    labelled = {"contact_flags": labels, "contact_object": np.where(labels, 0, -1)}
    labelled["contact_points"] = np.where(labels[..., None], np.zeros(3), np.nan)
    _, scene, reference = staged(qpos, object_pos=place, **labelled)
    told = []
    refined = refine(scene, reference, FEW, on_progress=told.append)
    rollout, ticks = refined.rollout, len(reference.qpos)
    off = object_errors(rollout, reference, G1.n)[:, 0]
    assert rollout.fell_after is None and len(rollout.qpos) == len(refined.gains) < ticks
    assert off[:-1].sum() > 0.1 * ticks >= off[: -KNOT - 1].sum()
    assert {item.samples for item in told} == {8, 16} and refined.lead_out is None


def test_a_hand_that_will_touch_soon_is_at_its_place_already(problem):
    touched = problem.reference.touched.copy()
    touched[:30] = -1
    soon, never = (
        TrackingCost(problem.scene, replace(problem.reference, touched=item))
        for item in (touched, np.full_like(touched, -1))
    )
    move = np.zeros(2 * problem.simulated.nv)
    move[0] = 0.05
    assert soon(4, *states(problem, 4, move)) == never(4, *states(problem, 4, move))
    for tick in (5, 29, 30):
        assert soon(tick, *states(problem, tick, move))[0] > 1.2 * never(tick, *states(problem, tick, move))[0]


@pytest.mark.parametrize(
    "values",
    [
        {"horizon": 0.1},
        {"noise": -1.0},
        {"iterations": 0},
        {"attempts": 0},
        {"samples": 4},
        {"samples": 500},
        {"noise": float("nan")},
    ],
)
def test_settings_out_of_range_are_refused(values):
    with pytest.raises(ArgumentError, match=next(iter(values))):
        Refinement(**values)
