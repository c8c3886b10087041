"""Links that must not meet: which they are, that crossed ones come apart, and that nothing else is touched."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.trajopt.link_pairs import near_pairs
from hoi_retarget.retargeting.trajopt.problem import Problem, cost
from hoi_retarget.retargeting.trajopt.solvers.solver import BandedInteriorPoint
from hoi_retarget.retargeting.trajopt.terms.differences import Differences
from hoi_retarget.retargeting.trajopt.terms.posture import Posture
from hoi_retarget.retargeting.trajopt.terms.self_clearance import SelfClearance, self_clearance_terms, self_depth
from hoi_retarget.retargeting.trajopt.terms.site_pose import SitePosition
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.skin import separable_pairs, skin_of
from trajectories import MODELS, random_qpos

G1 = MODELS["unitree_g1"]
FRAMES = 5


def depth(kinematics: Kinematics, link: str, other: str) -> float:
    """How deep any point of a link's whole skin is in another's solid in any frame [m]."""
    skins = skin_of(kinematics.model).by_link
    here, there = skins[link], skins[other]
    places = np.einsum("ijt,kj->tki", kinematics.orientation(here.frame), here.points)
    places += kinematics.point(here.frame).T[:, None] - kinematics.point(there.frame).T[:, None]
    seen = np.einsum("jit,tkj->tki", kinematics.orientation(there.frame), places)
    return float(-there.solid.distances(seen.reshape(-1, 3)).min())


def posed(model: RobotModel, **angles: float) -> np.ndarray:
    """A standing robot with some joints at other angles [rad], in all frames."""
    qpos = model.home_qpos.copy()
    for name, angle in angles.items():
        qpos[7 + model.joint_names.index(f"{name}_joint")] = angle
    return np.tile(qpos, (FRAMES, 1))


CROSSED = posed(G1, left_shoulder_roll=0.0, left_shoulder_pitch=0.0, left_elbow=1.3)
"""The left hand is in the left hip."""


def term_at(qpos: np.ndarray, weight: float = 5e3) -> tuple[SelfClearance, ...]:
    return tuple(self_clearance_terms(Weights(self_clearance=weight), G1.forward(qpos)))


def test_depth_of_links_in_each_other_is_that_of_their_skins():
    found, crossed = self_depth(G1.forward(CROSSED)), G1.forward(CROSSED)
    pairs = ((one, other) for both in separable_pairs(G1, G1.body_names) for one, other in (both, both[::-1]))
    deepest = max(depth(crossed, *pair) for pair in pairs if all(link in skin_of(G1).by_link for link in pair))
    assert deepest > 0.01
    assert found == pytest.approx(deepest, abs=2e-3)
    assert self_depth(G1.forward(posed(G1))) <= 0.0


# Which links


@pytest.mark.parametrize("name", MODELS)
def test_pairs_are_symmetric_to_left_and_right(name):
    model = MODELS[name]
    pairs = {frozenset(pair) for pair in separable_pairs(model, model.body_names)}

    def mirrored(link: str) -> str:
        return link.replace("left", "#").replace("right", "left").replace("#", "right")

    assert pairs == {frozenset(map(mirrored, pair)) for pair in pairs}


def test_pairs_meet_by_arms_or_legs_and_not_at_joints():
    pairs = {frozenset(pair) for pair in separable_pairs(G1, G1.body_names)}
    for first, second in (
        ("left_wrist_yaw_link", "left_hip_yaw_link"),
        ("left_wrist_yaw_link", "right_wrist_yaw_link"),
        ("left_wrist_yaw_link", "torso_link"),
        ("left_wrist_yaw_link", "left_shoulder_yaw_link"),
        ("left_ankle_roll_link", "right_knee_link"),
        ("torso_link", "left_knee_link"),
    ):
        assert frozenset((first, second)) in pairs
    for first, second in (
        ("torso_link", "pelvis"),
        ("torso_link", "left_shoulder_roll_link"),
        ("left_wrist_yaw_link", "left_elbow_link"),
        ("left_knee_link", "left_ankle_roll_link"),
        ("left_hip_pitch_link", "right_hip_pitch_link"),
    ):
        assert frozenset((first, second)) not in pairs


# The cost


def test_a_robot_that_stands_costs_nothing():
    assert all(cost(rows) == 0 for term in term_at(posed(G1)) for rows in term.rows(G1.forward(posed(G1))))


def test_no_weight_is_no_term():
    assert term_at(CROSSED, weight=0.0) == ()


def test_links_far_apart_are_no_term():
    assert term_at(posed(G1, left_shoulder_roll=1.4, right_shoulder_roll=-1.4)) == ()


def test_the_cost_is_that_of_all_points_one_by_one():
    """The coarse points leave out none that costs anything."""
    rng = np.random.default_rng(0)
    qpos = random_qpos(G1, 20, rng, wander=0.3)
    kinematics = G1.forward(qpos)
    margin, found, expected = 0.01, 0.0, 0.0
    every, skins = np.arange(len(qpos)), skin_of(G1).by_link
    for first, second in separable_pairs(G1, tuple(skins)):
        for pair in near_pairs(skins[first], skins[second], kinematics, kinematics):
            if pair is None:
                continue
            met = replace(pair, frames=every).meeting(kinematics, kinematics, margin)
            found += 0.0 if met is None else float((met.depths**2).sum())
            places = np.einsum("ijt,kj->tki", kinematics.orientation(pair.link), pair.skin.points)
            places += kinematics.point(pair.link).T[:, None] - kinematics.point(pair.other).T[:, None]
            seen = np.einsum("jit,tkj->tki", kinematics.orientation(pair.other), places)
            depths = margin - pair.solid.distances(seen.reshape(-1, 3))
            expected += float((np.clip(depths, 0.0, pair.deepest) ** 2).sum())
    assert found == pytest.approx(expected)
    assert expected > 0


@pytest.mark.parametrize("seed", range(3))
def test_pairs_that_meet_are_found(seed):
    """Whatever is inside another at a random trajectory has rows."""
    kinematics = G1.forward(random_qpos(G1, 10, np.random.default_rng(seed), wander=0.3))
    (term,) = self_clearance_terms(Weights(), kinematics)
    frames = {(pair.link.node, pair.other.node): set(pair.frames) for pair in term.pairs}
    skins = skin_of(G1).by_link
    for first, second in separable_pairs(G1, tuple(skins)):
        for link, other in ((first, second), (second, first)):
            if depth(kinematics, link, other) > 1e-3:
                assert frames.get((skins[link].frame.node, skins[other].frame.node)), (link, other)


def test_crossed_links_come_apart():
    assert depth(G1.forward(CROSSED), "left_wrist_yaw_link", "left_hip_roll_link") > 0.02
    home = np.repeat(CROSSED[0, 7:, None], FRAMES, axis=1)
    terms = (
        Posture("posture", home, 1.0),
        Differences("jerk", 3, 1e-3),
        SitePosition("base", "pelvis", G1.forward(CROSSED).point("pelvis"), 100.0),
        *term_at(CROSSED),
    )
    solution = BandedInteriorPoint(max_iterations=30).solve(Problem(G1, terms, 30.0), CROSSED)
    kinematics = G1.forward(solution.qpos)
    for first, second in combinations(skin_of(G1).by_link, 2):
        if (first, second) in separable_pairs(G1, (first, second)):
            assert depth(kinematics, first, second) < 2e-3
            assert depth(kinematics, second, first) < 2e-3
    # The other arm was in nobody's way.
    right = [7 + k for k, name in enumerate(G1.joint_names) if name.startswith("right_")]
    np.testing.assert_allclose(solution.qpos[:, right], CROSSED[:, right], atol=0.02)
