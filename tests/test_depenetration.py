"""Ways out of an object: on the human's side, as long as they must be, and rows against finite differences."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from hoi_retarget.human.skeleton import LIMBS
from hoi_retarget.numerics import se3
from hoi_retarget.objects.distance_field import field_of, surface_samples
from hoi_retarget.objects.mesh import Surface
from hoi_retarget.objects.surface_samples import SurfaceSamples
from hoi_retarget.retargeting.surfaces.depenetration import escape_paths, limb_of_link, paths_within
from hoi_retarget.retargeting.surfaces.skin_points import MovingObject
from hoi_retarget.robots.skin import Skin, skin_of
from test_surfaces import along, weighted
from trajectories import MODELS

FRAMES, FPS = 40, 30.0
LINK = "left_elbow_link"
FOREARM = LIMBS.index(("left_elbow", "left_wrist"))


@pytest.fixture(params=list(MODELS))
def model(request):
    return MODELS[request.param]


def standing(model):
    return model.forward(np.repeat(model.home_qpos[None], FRAMES, axis=0))


def bar_through_the_forearm(kinematics, away: float = 0.0) -> MovingObject:
    """Return an upright bar that goes through the left forearm, which moves a little, or passes it at a distance."""
    skin = skin_of(kinematics.model).by_link[LINK]
    mesh = trimesh.creation.box((0.02, 0.02, 0.6))
    surface = Surface(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    centre = kinematics.point(skin.frame.of(skin.centre, np.eye(3))) + np.array([[0.0], [away], [0.0]])
    centre[1] += 0.004 * np.sin(np.arange(FRAMES))
    rotation = np.repeat(se3.quat_to_matrix(np.array([1.0, 0.0, 0.0, 0.0]))[:, :, None], FRAMES, axis=2)
    return MovingObject("bar", field_of(surface), SurfaceSamples(surface_samples(surface, 0.005)), centre, rotation)


def human_beside(side: float) -> np.ndarray:
    """Return the limbs of a human whose forearm passes the bar 6 cm to its left (+1) or right (-1)."""
    limbs = np.zeros((FRAMES, 1, len(LIMBS), 2, 3))
    limbs[:, 0, FOREARM] = [[0.0, 0.06 * side, 0.0], [0.3, 0.06 * side, 0.0]]
    return limbs


def forearm(model) -> Skin:
    return Skin((skin_of(model).by_link[LINK],))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_link_goes_out_on_the_humans_side_and_as_far_as_it_must(model, side):
    kinematics = standing(model)
    bar = bar_through_the_forearm(kinematics)
    (way,) = escape_paths((bar,), human_beside(side), forearm(model), {}, kinematics, (), 1.0, FPS)
    np.testing.assert_array_equal(way.frames, np.arange(FRAMES))
    assert (side * way.outward[1, 0] > 0.9).all()
    (rows,) = way.rows(kinematics)
    assert (rows.residual < -0.01).all()
    skin = way.skin
    for frame in range(0, FRAMES, 5):
        samples = bar.samples.points + bar.position[:, frame]
        origin = kinematics.point(skin.frame)[:, frame]
        begin = origin + kinematics.orientation(skin.frame)[:, :, frame] @ way.points[:, 0, frame]
        step = way.goals[0, frame] - way.outward[:, 0, frame] @ begin
        moved = origin + step * way.outward[:, 0, frame]
        seen = (samples - moved) @ kinematics.orientation(skin.frame)[:, :, frame]
        assert skin.solid.distances(seen).min() > -2.5e-3
        assert step < 0.12


def test_a_link_that_touches_leaves_before_and_after_alone(model):
    kinematics, touching = standing(model), np.zeros(FRAMES, dtype=bool)
    touching[15:25] = True
    bar = bar_through_the_forearm(kinematics)
    ways = escape_paths((bar,), human_beside(1.0), forearm(model), {LINK: touching}, kinematics, (), 1.0, FPS)
    frames = np.concatenate([way.frames for way in ways])
    weights = np.concatenate([way.weights for way in ways])
    assert not touching[frames].any()
    np.testing.assert_array_equal(weights[(frames < 10) | (frames >= 30)], 1.0)
    before = frames < 15
    assert (np.diff(weights[before]) <= 0.0).all() and weights[before][-1] < 0.7, "it gives way to the contact"
    always = {LINK: np.ones(FRAMES, dtype=bool)}
    assert not escape_paths((bar,), human_beside(1.0), forearm(model), always, kinematics, (), 1.0, FPS)


def test_what_was_chosen_before_is_kept(model):
    kinematics = standing(model)
    bar, skin = bar_through_the_forearm(kinematics), forearm(model)
    (left,) = escape_paths((bar,), human_beside(1.0), skin, {}, kinematics, (), 1.0, FPS)
    (again,) = escape_paths((bar,), human_beside(-1.0), skin, {}, kinematics, (left,), 1.0, FPS)
    np.testing.assert_allclose(again.sides, left.sides, atol=2e-2)


def test_rows_agree_with_finite_differences(model):
    rng, kinematics = np.random.default_rng(0), standing(model)
    (way,) = escape_paths(
        (bar_through_the_forearm(kinematics),), human_beside(1.0), forearm(model), {}, kinematics, (), 3.0, FPS
    )
    direction, step = rng.normal(size=(FRAMES, model.nv)), 1e-6
    ahead, behind = (
        weighted(way.rows(model.forward(model.integrate(kinematics.qpos, sign * step * direction)))) for sign in (1, -1)
    )
    numeric = (ahead - behind) / (2 * step)
    assert np.abs(numeric).max() > 0.1
    np.testing.assert_allclose(along(way.rows(kinematics), kinematics, direction), numeric, atol=1e-5)


def test_windows_of_a_way_are_its_frames(model):
    kinematics = standing(model)
    ways = escape_paths(
        (bar_through_the_forearm(kinematics),), human_beside(1.0), forearm(model), {}, kinematics, (), 1.0, FPS
    )
    (whole,) = ways[0].rows(kinematics)
    halves = []
    for first, stop in ((0, 15), (15, FRAMES)):
        (part,) = paths_within(ways, first, stop)
        halves.append(part.rows(model.forward(kinematics.qpos[first:stop]))[0].residual)
    np.testing.assert_allclose(np.concatenate(halves, axis=1), whole.residual, atol=1e-12)
    assert not paths_within(ways, FRAMES, FRAMES + 5)


def test_a_clip_of_one_frame_has_its_way(model):
    kinematics = standing(model)
    bar = bar_through_the_forearm(kinematics)
    one = replace(bar, position=bar.position[:, :1], rotation=bar.rotation[:, :, :1])
    (way,) = escape_paths(
        (one,), human_beside(1.0)[:1], forearm(model), {}, model.forward(kinematics.qpos[:1]), (), 1.0, FPS
    )
    assert way.frames.tolist() == [0]
    assert way.outward[1, 0, 0] > 0.9


def test_links_that_are_not_deep_have_none(model):
    kinematics = standing(model)
    bar = bar_through_the_forearm(kinematics, away=0.5)
    assert not escape_paths((bar,), human_beside(1.0), forearm(model), {}, kinematics, (), 1.0, FPS)


def test_links_stand_for_the_limbs_that_they_are(model):
    of_link = limb_of_link(model)
    for side in ("left", "right"):
        assert LIMBS[of_link[f"{side}_elbow_link"]] == (f"{side}_elbow", f"{side}_wrist")
        assert LIMBS[of_link[f"{side}_knee_link"]] == (f"{side}_knee", f"{side}_ankle")
        assert LIMBS[of_link[f"{side}_shoulder_yaw_link"]] == (f"{side}_shoulder", f"{side}_elbow")
        assert LIMBS[of_link[f"{side}_hip_yaw_link"]] == (f"{side}_hip", f"{side}_knee")
    assert LIMBS[of_link["torso_link"]] == ("pelvis", "neck")
