"""Laws of leads: they begin balanced at rest, end in the first frame with its velocity, and keep feet in place."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.dynamics.inverse_dynamics import mass_centres, mass_jacobian
from hoi_retarget.dynamics.physics_scene import SOLES
from hoi_retarget.simulation.balance_transition import LENGTH, capture_margin, lead_in, with_lead_in_and_out
from hoi_retarget.simulation.rollout import TICK
from plain_motions import standing_qpos
from test_rollout import G1, staged


@cache
def standing():
    return staged(standing_qpos(G1, 12))


def stepping(raised, side, ahead):
    """A state on one foot, or on two, that moves ahead."""
    _, scene, reference = standing()
    qpos, qvel = reference.qpos[0].copy(), np.zeros_like(reference.qvel[0])
    qvel[0] = ahead
    for name, angle in (("hip_pitch", -raised), ("knee", 2.0 * raised), ("ankle_pitch", -raised)):
        qpos[7 + G1.joint_names.index(f"{side}_{name}_joint")] += angle
    return scene, qpos, qvel


@settings(deadline=None, max_examples=12)
@given(raised=st.floats(0.15, 0.6), side=st.sampled_from(["left", "right"]), ahead=st.floats(-0.6, 0.6))
def test_a_lead_begins_balanced_at_rest_and_ends_in_the_state_that_it_leads_to(raised, side, ahead):
    scene, qpos, qvel = stepping(raised, side, ahead)
    lead, n = lead_in(scene, qpos, qvel), G1.n
    assert len(lead.qpos) == len(lead.qvel) == len(lead.torques) == LENGTH
    assert not lead.qvel[0].any() and capture_margin(scene, lead.qpos[0], lead.qvel[0]) > 0.02
    # The tick after the last is the state: a step along its velocity leads there.
    there = G1.integrate(lead.qpos[-1:, : 7 + n], TICK * 0.5 * (lead.qvel[-1:, : 6 + n] + qvel[None, : 6 + n]))[0]
    np.testing.assert_allclose(there[:3], qpos[:3], atol=5e-3)
    np.testing.assert_allclose(there[7:], qpos[7 : 7 + n], atol=0.03)
    np.testing.assert_array_equal(lead.qpos[:, 7 + n :], np.tile(qpos[7 + n :], (LENGTH, 1)))
    assert (lead.qpos[:, 7 : 7 + n] >= G1.lower).all() and (lead.qpos[:, 7 : 7 + n] <= G1.upper).all()


@settings(deadline=None, max_examples=8)
@given(raised=st.floats(0.15, 0.6), ahead=st.floats(-0.6, 0.6))
def test_in_a_lead_no_foot_is_under_the_floor_and_the_standing_one_stays(raised, ahead):
    scene, qpos, qvel = stepping(raised, "left", ahead)
    qvel[0] = 0.0
    qvel[6:] = ahead * 0.1
    path = G1.forward(lead_in(scene, qpos, qvel).qpos[:, : 7 + G1.n])
    assert min(path.site_position(name)[:, 2].min() for name in SOLES) > -0.004
    held = path.site_position("right_foot")
    assert np.abs(held - held[-1]).max() < 0.02


def test_only_motions_that_begin_or_end_off_balance_have_leads():
    _, scene, reference = standing()
    still, *ticks = with_lead_in_and_out(scene, reference)
    assert ticks == [0, 0] and still is reference
    qpos = standing_qpos(G1, 60)
    qpos[:, 0] += np.maximum(0.0, np.linspace(-1.0, 1.0, 60)) ** 2  # It glides away at the end.
    _, scene, reference = staged(qpos)
    found, *ticks = with_lead_in_and_out(scene, reference)
    assert ticks == [0, LENGTH]
    assert found.qpos[: len(reference.qpos)].tobytes() == reference.qpos.tobytes()
    assert not found.qvel[-1].any() and (found.touched[-LENGTH:] == -1).all()
    np.testing.assert_array_equal(found.touched[:-LENGTH], reference.touched)
    turned = replace(reference, qpos=reference.qpos[::-1].copy(), qvel=-reference.qvel[::-1])
    backwards, *ticks = with_lead_in_and_out(scene, turned)
    assert ticks == [LENGTH, 0]
    np.testing.assert_allclose(backwards.qpos[:LENGTH], found.qpos[: -LENGTH - 1 : -1], atol=1e-9)


def test_where_a_hand_is_at_an_object_no_lead_is_added():
    qpos = standing_qpos(G1, 30)
    qpos[:, 0] += np.linspace(0.0, 1.0, 30) ** 2
    touching = np.tile([True, False], (30, 1))
    points = np.where(touching[..., None], np.full(3, 0.1), np.nan)
    _, scene, reference = staged(
        qpos, contact_flags=touching, contact_object=np.where(touching, 0, -1), contact_points=points
    )
    assert with_lead_in_and_out(scene, reference) == (reference, 0, 0)


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_mass_centres_jacobian_is_its_derivative(seed):
    random = np.random.default_rng(seed)
    qpos = G1.integrate(standing_qpos(G1, 3), 0.3 * random.standard_normal((3, G1.nv)))
    step = random.standard_normal((3, G1.nv))
    after, before = (mass_centres(G1.forward(G1.integrate(qpos, size * step))) for size in (1e-5, -1e-5))
    found = np.einsum("tij,tj->ti", mass_jacobian(G1.forward(qpos)), step)
    np.testing.assert_allclose(found, (after - before) / 2e-5, atol=1e-6)


@pytest.mark.parametrize("height", [0.0, 0.05])
def test_a_capture_point_is_within_soles_on_the_floor_alone(height):
    _, scene, reference = standing()
    qpos = reference.qpos[0].copy()
    qpos[2] += height
    margin = capture_margin(scene, qpos, np.zeros_like(reference.qvel[0]))
    assert margin > 0.02 if height == 0.0 else margin == -np.inf
