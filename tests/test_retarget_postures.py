"""People who sit, kneel and lie: the robot's trunk follows theirs, whichever way they face."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.human.person import stance
from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.config import Scaling
from hoi_retarget.retargeting.ik import MIN_LIFT_M, raised_above_floor
from hoi_retarget.retargeting.orientation_flips import MAX_TRUNK_TURN_DEG, trunk_errors_deg, trunk_turns
from hoi_retarget.retargeting.retarget import judge
from hoi_retarget.retargeting.solve import solve
from hoi_retarget.retargeting.targets import make_targets
from hoi_retarget.robots.skin import link_heights, skin_of
from posed_people import POSTURES, posed
from trajectories import MODELS

LYING_FEET = ("legs stretched", "kneeling", "on the back", "on the front", "on the side")


@pytest.mark.slow
@pytest.mark.parametrize("robot", list(MODELS))
@pytest.mark.parametrize("posture", list(POSTURES))
def test_the_trunk_follows_in_every_posture(posture, robot):
    clip, model = posed(posture, heading=0.7), MODELS[robot]
    solution = solve(clip, model)
    motion, targets = judge(solution), solution.targets
    assert motion.converged
    assert trunk_errors_deg(model.forward(motion.qpos), targets).max() < 20.0
    assert motion.report.trunk_turns == ()
    assert motion.report.figures["link_below_floor_m"] < 0.01


@pytest.mark.parametrize("robot", list(MODELS))
def test_a_reference_in_the_floor_is_lifted_and_no_other(robot):
    model = MODELS[robot]
    targets = make_targets(posed("standing"), model, Scaling())
    standing = np.tile(model.home_qpos, (targets.frames, 1))
    assert raised_above_floor(model, targets, standing) is standing
    sunk = standing.copy()
    sunk[31:34, 2] -= 0.3
    above = raised_above_floor(model, targets, sunk)
    np.testing.assert_array_equal(np.delete(above, 2, axis=1), np.delete(sunk, 2, axis=1))
    ends = {model.site_bodies[model.sites.index[site]] for site in targets.contact_links}
    inner = [skin.link not in ends for skin in skin_of(model).links]
    assert link_heights(model.forward(above))[inner].min() > -MIN_LIFT_M - 1e-9
    lift = above[:, 2] - sunk[:, 2]
    assert lift.min() >= 0.0 and lift[:5].max() == 0.0 and np.abs(np.diff(lift)).max() < 0.2 * lift.max()


@given(st.sampled_from(list(POSTURES)), st.floats(-np.pi, np.pi))
@settings(max_examples=20, deadline=None)
def test_only_feet_with_the_sole_underneath_stand(posture, heading):
    flags = stance(posed(posture, heading=heading).people[0], 30.0)
    assert flags.any() == (posture not in LYING_FEET)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_trunk_turned_over_is_an_error_with_its_frames(axis):
    """A robot that follows the person, turned about its own base in some frames."""
    model, clip = MODELS["unitree_g1"], posed("standing")
    qpos = np.tile(model.home_qpos, (clip.frames, 1))
    targets = make_targets(clip, model, Scaling())
    before = trunk_errors_deg(model.forward(qpos), targets)
    heading = se3.exp(np.array([0.0, 0.0, np.pi / 2]))  # The posed person looks along -y.
    qpos[:, 3:7] = se3.quat_multiply(se3.quat_conjugate(heading), qpos[:, 3:7])
    assert before.max() > MAX_TRUNK_TURN_DEG and trunk_turns(model.forward(qpos), targets) == ()
    vector = np.zeros(3)
    vector[axis] = np.radians(80.0)
    qpos[10:15, 3:7] = se3.quat_multiply(qpos[10:15, 3:7], se3.exp(vector))
    (found,) = trunk_turns(model.forward(qpos), targets)
    assert (found.first_frame, found.last_frame) == (10, 14)
    assert found.value == pytest.approx(80.0, abs=10.0)
