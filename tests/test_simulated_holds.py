"""Holds chosen by simulation: those that keep an object stay, others give way to some that do."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from hoi_retarget.clip.augment import mirrored
from hoi_retarget.dynamics.free_hands import hand_parts, palm_skin, touch_of
from hoi_retarget.dynamics.object_bodies import CollisionShape
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.errors import GeometryError
from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.holds.hand_settling import depths
from hoi_retarget.retargeting.holds.hand_shape import HandPoses, hand_shape
from hoi_retarget.retargeting.holds.held_targets import with_holds
from hoi_retarget.retargeting.holds.hold_choice import DEEPEST
from hoi_retarget.retargeting.holds.simulated_holds import FARTHEST, simulated_holds
from hoi_retarget.retargeting.ik import solve_ik
from hoi_retarget.retargeting.solve import solve
from hoi_retarget.retargeting.surfaces.skin_points import moving_objects
from hoi_retarget.retargeting.targets import make_targets
from hoi_retarget.robots.skin import skins_from
from hoi_retarget.robots.spec import PALMS
from synthetic import make
from trajectories import MODELS

G1 = MODELS["unitree_g1"]
PHYSICS = Physics(object_mass=1.0)


@cache
def chosen(flipped=False):
    """Return targets, objects, holds and the start of a box that is carried."""
    clip = make("carry_box", seconds=4.0)
    targets = make_targets(mirrored(clip) if flipped else clip, G1, Config().scaling, contact="surface", person=0)
    qpos, _ = solve_ik(G1, targets, Config().ik, Config().horizon)
    _, holds = with_holds(targets, G1, qpos, PHYSICS)
    return targets, moving_objects(targets), holds, G1.forward(qpos)


def off_the_surface(targets, moving_object, holds, by=0.04):
    """Return holds whose hands are beside the object."""
    skins = [palm_skin(G1, targets.contact_links[hold.episode.link]) for hold in holds]
    places = [hold.touch.position + by * hold.touch.outward for hold in holds]
    return tuple(
        replace(hold, touch=touch_of(skin, moving_object.field, place, hold.touch.rotation))
        for hold, skin, place in zip(holds, skins, places, strict=True)
    )


def test_holds_that_keep_the_object_stay():
    targets, objects, holds, start = chosen()
    found = simulated_holds(targets, objects, holds, start, PHYSICS, 0)
    for hold, other in zip(holds, found, strict=True):
        assert other.kept and other.touch is hold.touch


@pytest.mark.parametrize("flipped", [False, True])
def test_holds_that_lose_it_give_way_to_ones_that_keep_it(flipped):
    """The new ones touch, are not inside, and are near the person's."""
    targets, objects, holds, start = chosen(flipped)
    worse = off_the_surface(targets, objects[0], holds)
    found = simulated_holds(targets, objects, worse, start, PHYSICS, 0)
    assert all(hold.kept and hold.touch is not other.touch for hold, other in zip(found, worse, strict=True))
    for hold in found:
        site = targets.contact_links[hold.episode.link]
        pose = HandPoses(hold.touch.position[None], hold.touch.rotation[None])
        assert np.linalg.norm(hold.touch.position - hold.person_position) < FARTHEST
        assert depths(hand_shape(G1, site), objects[0], pose)[0] < DEEPEST
        assert len(touch_of(palm_skin(G1, site), objects[0].field, hold.touch.position, hold.touch.rotation).points)
    again = simulated_holds(targets, objects, worse, start, PHYSICS, 0)
    assert all(
        np.array_equal(one.touch.position, other.touch.position) for one, other in zip(found, again, strict=True)
    )


def test_holds_that_lose_it_stay_where_nothing_is_better():
    targets, objects, holds, start = chosen()
    slippery = replace(PHYSICS, hand_friction=0.01)
    assert not any(hold.kept for hold in simulated_holds(targets, objects, holds, start, slippery, 0))


@pytest.mark.slow
def test_bodies_keep_simulated_holds_and_reports_tell_so():
    solution = solve(make("carry_box", seconds=4.0), G1, Config(holds="simulated", physics=PHYSICS))
    assert solution.motion.report.config["holds"] == "simulated"
    for hold in solution.motion.report.holds:
        assert hold.kept and str(hold).endswith("; two free hands keep the object")
    plain = solve(make("carry_box", seconds=4.0), G1, Config(physics=PHYSICS)).motion.report.holds
    assert all(hold.kept is None and "free hands" not in str(hold) for hold in plain)


def test_an_object_without_convex_parts_is_named(monkeypatch):
    targets, objects, holds, start = chosen()
    hull = CollisionShape("convex hull", parts=(np.eye(3),), fits=False)
    monkeypatch.setattr("hoi_retarget.retargeting.holds.simulated_holds.collision_shape", lambda _: hull)
    monkeypatch.setattr("hoi_retarget.errors.find_spec", lambda name: None)
    with pytest.raises(GeometryError, match=r"box: .*pip install \"coacd"):
        simulated_holds(targets, objects, holds, start, PHYSICS, 0)


def test_objects_that_somebody_else_holds_too_are_not_simulated():
    clip = make("carry_table", seconds=2.0)
    holds = solve(clip, G1, Config(holds="simulated", physics=PHYSICS)).motion.report.holds
    assert holds and all(hold.kept is None for hold in holds)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS.keys())
@pytest.mark.parametrize("palm", PALMS)
def test_convex_parts_of_a_hand_are_its_skin(model, palm):
    points, _ = palm_skin(model, palm)
    parts = hand_parts(model, palm)
    outside = np.min([distances_outside(part, points) for part in parts], axis=0)
    assert outside.max() < 0.002
    home = model.forward(model.home_qpos[None])
    turn, place = home.site_rotation(palm)[0], home.site_position(palm)[0]
    corners = np.concatenate(parts) @ turn.T + place
    off = [
        skin.solid.distances((corners - home.point(skin.frame)[:, 0]) @ home.orientation(skin.frame)[:, :, 0])
        for skin in skins_from(model, palm)
    ]
    assert np.min(off, axis=0).max() < 0.002


def distances_outside(corners, points):
    """Return the distances of points from a convex part's planes, zero within [m]."""
    equations = ConvexHull(corners).equations
    return np.maximum(points @ equations[:, :3].T + equations[:, 3], 0.0).max(axis=1)


def test_skin_touches_where_it_faces_the_surface():
    targets, objects, holds, _ = chosen()
    for hold in holds:
        site, field = targets.contact_links[hold.episode.link], objects[0].field
        touch = touch_of(palm_skin(G1, site), field, hold.touch.position, hold.touch.rotation)
        distances, normals = field.distances_and_normals(touch.points)
        np.testing.assert_allclose(distances, 0.0, atol=5e-4)
        assert (np.einsum("pi,pi->p", normals, touch.inward) < -0.9).all()
        turned = se3.quat_to_matrix(se3.exp(np.array([[0.0, 0.0, np.pi]])))[0]
        away = touch_of(palm_skin(G1, site), field, hold.touch.position + touch.outward, turned @ hold.touch.rotation)
        assert not len(away.points) and not away.outward.any()
