"""Two robots beside each other: the second gives way to the first, whose motion is known."""

import numpy as np
import pytest

from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.trajopt.problem import Problem, cost
from hoi_retarget.retargeting.trajopt.solvers.solver import BandedInteriorPoint
from hoi_retarget.retargeting.trajopt.terms.differences import Differences
from hoi_retarget.retargeting.trajopt.terms.posture import Posture
from hoi_retarget.retargeting.trajopt.terms.robot_clearance import RobotClearance, robot_clearance_terms
from hoi_retarget.retargeting.trajopt.terms.site_pose import SitePosition
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import skin_of
from trajectories import MODELS

G1, H2 = MODELS["unitree_g1"], MODELS["unitree_h2"]
FRAMES = 2


def standing(model=G1, aside: float = 0.0) -> Kinematics:
    qpos = np.tile(model.home_qpos, (FRAMES, 1))
    qpos[:, 1] += aside
    return model.forward(qpos)


def terms(robot: Kinematics, *others: Kinematics) -> tuple[RobotClearance, ...]:
    return tuple(robot_clearance_terms(Weights(), robot, others))


def depth(here: Kinematics, there: Kinematics) -> float:
    """How deep any skin point of one robot is in any link of the other [m]."""
    deepest = -np.inf
    for link in skin_of(here.model).links:
        centre = here.point(link.frame.of(link.centre, np.eye(3)))
        for other in skin_of(there.model).links:
            away = centre - there.point(other.frame.of(other.centre, np.eye(3)))
            if np.linalg.norm(away, axis=0).min() > link.radius + other.radius:
                continue
            places = np.einsum("ijt,kj->tki", here.orientation(link.frame), link.points)
            places += (here.point(link.frame) - there.point(other.frame)).T[:, None]
            seen = np.einsum("jit,tkj->tki", there.orientation(other.frame), places)
            deepest = max(deepest, float(-other.solid.distances(seen.reshape(-1, 3)).min()))
    return deepest


@pytest.mark.parametrize("other", [G1, H2])
def test_robots_apart_are_no_term(other):
    assert terms(standing(), standing(other, aside=1.2)) == ()


def test_no_weight_is_no_term():
    assert tuple(robot_clearance_terms(Weights(self_clearance=0.0), standing(), [standing(aside=0.3)])) == ()


def test_the_cost_is_the_same_for_both():
    """Points of one in the other cost one what they cost the other."""
    one, other = standing(), standing(aside=0.35)
    costs = [
        sum(cost(rows) for term in terms(*pair) for rows in term.rows(pair[0])) for pair in [(one, other), (other, one)]
    ]
    assert costs[0] == pytest.approx(costs[1])
    assert costs[0] > 0


def test_each_other_robot_has_a_term_of_its_own():
    found = terms(standing(), standing(aside=0.35), standing(aside=3.0), standing(aside=-0.35))
    assert [term.name for term in found] == ["robot_clearance_0", "robot_clearance_2"]


def test_links_that_are_more_than_half_through_leave_on_the_side_on_which_they_came():
    """A robot comes from the side until arms have crossed, and goes again."""
    aside = 0.75 - 0.35 * np.hanning(15)
    qpos = np.tile(G1.home_qpos, (len(aside), 1))
    fixed = G1.forward(qpos)
    qpos[:, 1] += aside
    start = G1.forward(qpos)

    def ways(passing_at: float | None) -> np.ndarray:
        """How the depths of its own points grow as it goes on aside."""
        (term,) = robot_clearance_terms(Weights(), start, [fixed], passing_at=passing_at)
        rows = tuple(term.rows(start))
        return np.concatenate([item.by_linear[:, 1][item.residual > 0] for item in rows])

    assert ways(None).max() > 0.5, "the nearest way out leads further through"
    assert np.mean(ways(30.0) < 0.0) > 0.95


def test_links_that_keep_their_places_leave_each_other_the_nearest_way():
    here, there = standing(), standing(aside=0.35)
    (term,) = robot_clearance_terms(Weights(), here, [there], passing_at=30.0)
    pairs = [(pair, here, there) for pair in term.own] + [(pair, there, here) for pair in term.others]
    for pair, own, other in pairs:
        middle = own.point(pair.link.of(pair.skin.points.mean(axis=0), np.eye(3)))
        turn = other.orientation(pair.other)
        places = np.einsum("jit,jt->ti", turn, middle - other.point(pair.other))
        outwards = np.einsum("ijt,tj->it", turn, pair.solid.distances_and_slopes(places)[1])
        np.testing.assert_allclose(pair.side, outwards / np.linalg.norm(outwards, axis=0), atol=1e-9)
    assert len(pairs) > 2 and np.ptp([pair.side[0, 0] for pair, *_ in pairs]) > 0.1


@pytest.mark.slow
def test_a_robot_gives_way_to_another():
    fixed, start = standing(H2), standing(aside=0.42)
    assert depth(start, fixed) > 0.01
    home = np.repeat(G1.home_qpos[7:, None], FRAMES, axis=1)
    table = (
        Posture("posture", home, 1.0),
        Differences("jerk", 3, 1e-3),
        SitePosition("base", "pelvis", start.point("pelvis"), 1.0),
        SitePosition("foot", "left_foot", start.point("left_foot"), 100.0),
    )
    moved = start
    for _ in range(2):  # Links that were far from each other may be near after the first solve.
        problem = Problem(G1, (*table, *terms(moved, fixed)), 30.0)
        moved = G1.forward(BandedInteriorPoint(max_iterations=30).solve(problem, moved.qpos).qpos)
    assert depth(moved, fixed) < 2e-3
    assert depth(fixed, moved) < 2e-3
