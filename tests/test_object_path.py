"""Paths that give way: only where arms miss holds, by little, smoothly, towards the hands, and never on the floor."""

from dataclasses import replace

import numpy as np
import pytest

from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.holds.held_targets import with_holds
from hoi_retarget.retargeting.holds.object_path import LARGEST_SHIFT, LARGEST_TURN, shift_between
from hoi_retarget.retargeting.ik import solve_ik
from hoi_retarget.retargeting.solve import solve
from hoi_retarget.retargeting.targets import make_targets
from hoi_retarget.robots.skin import extreme_points
from synthetic import make
from trajectories import MODELS

MODEL = MODELS["unitree_g1"]


@pytest.fixture(scope="module")
def lifted():
    """A clip, IK, and targets whose box is lifted beyond the arms' reach where it is carried."""
    clip = make("carry_box")
    targets = make_targets(clip, MODEL, Config().scaling, contact="surface", person=0)
    ik_qpos, _ = solve_ik(MODEL, targets, Config().ik, Config().horizon)
    height = targets.object_pos[:, 0, 2]
    share = np.clip((height - height[0]) / 0.3, 0.0, 1.0)[:, None, None]
    high = replace(targets, object_pos=frozen(targets.object_pos + share * [0.0, 0.0, 0.6]))
    return high, ik_qpos


def heights(targets):
    corners = targets.object_scale[0] * extreme_points(targets.object_geometry[0].points)
    rotations = se3.quat_to_matrix(targets.object_quat[:, 0])
    return (np.einsum("tij,kj->tki", rotations, corners) + targets.object_pos[:, 0, None])[:, :, 2].min(axis=1)


@pytest.mark.slow
def test_a_box_out_of_reach_gives_way_a_little_smoothly_and_not_on_the_floor(lifted):
    targets, ik_qpos = lifted
    found, _ = with_holds(targets, MODEL, ik_qpos, Config().physics, gives_way=True)
    moves = (found.object_pos - targets.object_pos)[:, 0]
    turns = se3.angle_between(found.object_quat[:, 0], targets.object_quat[:, 0])
    assert 0.02 < np.linalg.norm(moves, axis=1).max() <= LARGEST_SHIFT + 1e-9
    assert turns.max() <= LARGEST_TURN + 1e-9
    middle = int(np.linalg.norm(moves, axis=1).argmax())
    assert moves[middle, 2] < 0.0  # Down, to the arms.
    before, after = heights(targets), heights(found)
    low = before < 0.02
    np.testing.assert_allclose(moves[low], 0.0, atol=2e-3)
    assert (after > np.minimum(before, 0.002) - 1e-6).all()
    assert np.abs(np.diff(moves, 2, axis=0)).max() * targets.fps**2 < 4.0  # [m/s^2]
    shift = shift_between(targets, found)
    assert shift is not None and shift.first_frame <= middle <= shift.last_frame
    assert shift.moved_m == pytest.approx(np.linalg.norm(moves, axis=1).max())


def test_without_it_a_path_stays_and_what_arms_reach_moves_nothing(lifted):
    targets, ik_qpos = lifted
    found, _ = with_holds(targets, MODEL, ik_qpos, Config().physics)
    assert found.object_pos is targets.object_pos and found.object_quat is targets.object_quat
    assert shift_between(targets, found) is None


@pytest.mark.slow
def test_the_option_fixes_the_path_and_within_reach_it_changes_nothing():
    clip = make("carry_box", seconds=3.0)
    free, fixed = (solve(clip, MODEL, Config(object_path=kind)) for kind in ("free", "fixed"))
    assert free.motion.report.object_shift is None
    np.testing.assert_array_equal(free.motion.qpos, fixed.motion.qpos)
