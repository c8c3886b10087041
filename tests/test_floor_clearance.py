"""All of a robot stays above the floor: links that a reference sinks come out, and those that are far cost nothing."""

from dataclasses import replace

import numpy as np
import pytest

from hoi_retarget import Config
from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.config import Scaling, Weights
from hoi_retarget.retargeting.solve import solve_trajectory
from hoi_retarget.retargeting.targets import make_targets
from hoi_retarget.retargeting.trajopt.terms.floor_clearance import _directions, link_floor_terms
from hoi_retarget.robots.skin import skin_of
from hoi_retarget.robots.spec import SIDES
from synthetic import make
from trajectories import MODELS

CLIP = make("carry_box", seconds=2.0)


@pytest.fixture(params=list(MODELS))
def model(request):
    return MODELS[request.param]


def depths(kinematics) -> np.ndarray:
    """Return the depth of a robot's deepest skin point under the floor in every frame [m]."""
    heights = [
        kinematics.point(skin.frame)[2] + (skin.points @ kinematics.orientation(skin.frame)[2]).min(axis=0)
        for skin in skin_of(kinematics.model).links
    ]
    return -np.min(heights, axis=0)


def terms(model, qpos, contact="surface"):
    targets = make_targets(CLIP, model, Scaling(), contact=contact).window(0, len(qpos))
    return tuple(link_floor_terms(Weights(), targets, model.forward(qpos)))


def lying(model, height: float, frames: int = 12) -> np.ndarray:
    """Return a robot that turns a little about its own length while it lies on its back."""
    turn = np.linspace(0.0, 0.05, frames)[:, None] * np.array([0.0, 0.0, 1.0])
    qpos = np.tile(model.home_qpos, (frames, 1))
    qpos[:, :3] = 0.0, 0.0, height
    qpos[:, 3:7] = se3.quat_multiply(se3.exp(np.array([0.0, -np.pi / 2, 0.0])), se3.exp(turn))
    return qpos


def test_the_cost_is_that_of_the_deepest_points(model):
    kinematics = model.forward(lying(model, 0.05))
    rows = [part for term in terms(model, kinematics.qpos) for part in term.rows(kinematics)]
    np.testing.assert_allclose(-min(part.residual.min() for part in rows), depths(kinematics).max(), atol=1e-3)


def test_links_that_are_far_cost_nothing_and_landmark_contact_has_no_such_term(model):
    qpos = lying(model, 0.1)
    assert len(terms(model, qpos)) > 5
    assert terms(model, qpos + 5.0 * np.eye(len(qpos[0]))[2]) == ()
    assert terms(model, qpos, "landmark") == ()


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
def test_points_are_the_lowest_when_a_link_tilts_evenly_to_six_sides(yaw):
    directions = _directions(np.array([[np.cos(yaw)], [np.sin(yaw)]]))[:, :, 0]
    (trace, *tilted), ahead = directions, np.array([np.cos(yaw), np.sin(yaw)])
    np.testing.assert_allclose(trace, [*1e-3 * ahead, 1.0])
    np.testing.assert_allclose(np.mean(tilted, axis=0), [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(np.diff(tilted, axis=0), axis=1), 0.2)
    np.testing.assert_allclose(tilted[0][:2] @ ahead, 0.2 * np.cos(np.radians(30.0)))


def test_a_robot_that_lies_in_the_floor_comes_out_of_it_and_stays_as_it_is_otherwise(model):
    qpos = lying(model, 0.02)
    reference = model.forward(qpos)
    feet = np.stack([reference.site_position(f"{side}_foot") for side in SIDES], axis=1)
    targets = make_targets(replace(CLIP, objects=(), contacts=()), model, Scaling()).window(0, len(qpos))
    none = np.zeros((len(qpos), 2))
    alone = replace(targets, foot_positions=feet, stance_flags=none.astype(bool), anchor_weights=none)
    found, _ = solve_trajectory(model, alone, qpos, Config())
    assert depths(reference).min() > 0.05
    assert depths(model.forward(found)).max() < 0.005
    assert np.abs(found[:, 7:] - qpos[:, 7:]).mean() < 0.1
    np.testing.assert_allclose(found[:, :2], qpos[:, :2], atol=0.05)
