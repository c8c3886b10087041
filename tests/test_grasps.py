"""Fingers that close from a hold: they stop where they touch, nothing goes inside, and hands are open in between."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh

from finger_robot import FINGERS, finger_robot
from hoi_retarget.clip.edits import ContactEdits, Delete, apply
from hoi_retarget.dynamics.free_hands import Touch
from hoi_retarget.objects.distance_field import field_of, surface_samples
from hoi_retarget.objects.mesh import Surface
from hoi_retarget.objects.surface_samples import SurfaceSamples
from hoi_retarget.readers.builtin_clips import builtin_clip
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.holds import grasps
from hoi_retarget.retargeting.holds.episodes import Episode
from hoi_retarget.retargeting.holds.grasps import STEPS, TOUCHING, closed_shares, closing_fingers, with_grasps
from hoi_retarget.retargeting.holds.hand_shape import HandPoses
from hoi_retarget.retargeting.holds.hold import Hold, PersonHold
from hoi_retarget.retargeting.local_resolve import resolve_locally
from hoi_retarget.retargeting.solve import solve
from hoi_retarget.retargeting.surfaces.skin_points import MovingObject
from hoi_retarget.retargeting.targets import make_targets
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.spec import SIDES

FIRST, STOP = 100, 160


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return finger_robot(tmp_path_factory.mktemp("fingers"))


@cache
def targets():
    """Of the built-in clip, by a robot without fingers: none has a contact."""
    return make_targets(builtin_clip("carry_box"), load_robot("unitree_g1"), Config().scaling)


def pole(centre, radius: float) -> MovingObject:
    """Return a pole across the fingers, at a place of the palm's frame."""
    mesh = trimesh.creation.cylinder(radius=radius, height=0.16, sections=16)
    surface, frames = Surface(np.asarray(mesh.vertices) + centre, np.asarray(mesh.faces)), targets().frames
    samples = SurfaceSamples(surface_samples(surface, 0.005))
    still = np.tile(np.eye(3)[:, :, None], frames)
    return MovingObject("pole", field_of(surface), samples, np.zeros((3, frames)), still)


def held(palm: str) -> Hold:
    """Return a hold whose object has its frame in the palm's."""
    episode = Episode(targets().contact_links.index(palm), 0, FIRST, STOP)
    person = PersonHold(episode, HandPoses(np.zeros((1, 3)), np.eye(3)[None]), False)
    touch = Touch(np.zeros(3), np.eye(3), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(3))
    return Hold(person, touch, np.array([FIRST]), np.zeros(1), 0.0, 0.0, 0, 1)


def distances(model, palm, finger, angles, moving_object) -> list[float]:
    """Return the least signed distance of each link of a finger from an object in the palm's frame [m]."""
    qpos = model.home_qpos[None].copy()
    qpos[:, 7 + finger.columns] = angles
    kinematics, found = model.forward(qpos), []
    turn, place = kinematics.site_rotation(palm)[0], kinematics.site_position(palm)[0]
    for link in finger.links:
        points = link.points @ kinematics.orientation(link.frame)[:, :, 0].T + kinematics.point(link.frame)[:, 0]
        found.append(float(moving_object.field.distances((points - place) @ turn).min()))
    return found


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(("along", "off", "radius"), [(0.085, 0.04, 0.015), (0.1, 0.035, 0.01), (0.07, 0.05, 0.02)])
def test_fingers_close_until_they_touch_and_never_go_inside(model, side, along, off, radius):
    palm, inward = f"{side}_palm", -1.0 if side == "left" else 1.0
    moving_object = pole(np.array([along, off * inward, 0.0]), radius)
    fingers = closing_fingers(model, palm)
    assert len(fingers) == len(FINGERS)
    touching = 0
    for finger in fingers:
        shares = closed_shares(model, palm, finger, held(palm), moving_object)
        assert (shares >= 0.0).all() and (shares <= 1.0).all()
        found = distances(model, palm, finger, finger.angles(shares[None])[0], moving_object)
        opened = min(distances(model, palm, finger, finger.opened, moving_object))
        # No deeper than a fingertip moves in a step; a thumb that lies in the pole from the start goes no deeper.
        step = np.abs(finger.travel).max() / STEPS * 0.13
        assert min(found) > min(opened, TOUCHING - step) - 1e-3
        if shares.any():
            assert min(found) < TOUCHING + step + 1e-3
            touching += 1
    assert touching >= 2, "the two fingers beside the thumb"


def test_hands_are_open_but_in_their_holds_and_fingers_that_meet_nothing_stay(model, monkeypatch):
    qpos = np.tile(model.home_qpos, (targets().frames, 1))
    near, far = pole(np.array([0.085, -0.04, 0.0]), 0.015), pole(np.array([0.6, 0.0, 0.0]), 0.015)
    person = replace(builtin_clip("carry_box").people[0], fingers_recorded=False)

    def grasped(moving_object, holds):
        monkeypatch.setattr(grasps, "moving_objects", lambda *_: (moving_object,))
        return with_grasps(model, targets(), person, holds, qpos)

    assert np.array_equal(grasped(far, [held("left_palm")]), qpos)
    closed = grasped(near, [held("left_palm")])
    moved = np.abs(closed - qpos).max(axis=1)
    assert (
        (moved[FIRST + 10 : STOP - 10] > 0.2).all() and not moved[: FIRST - 10].any() and not moved[STOP + 10 :].any()
    )
    others = [name for name in model.joint_names if not name.startswith("left_") or name.split("_")[1] not in FINGERS]
    columns = [7 + model.joint_names.index(name) for name in others]
    assert np.array_equal(closed[:, columns], qpos[:, columns]), "only this hand's fingers"
    assert (closed[:, 7:] >= model.lower - 1e-9).all() and (closed[:, 7:] <= model.upper + 1e-9).all()
    steady = closed[FIRST + 12 : STOP - 12]
    assert np.ptp(steady, axis=0).max() < 1e-9, "a hold is one grasp"
    twice = grasped(near, [held("left_palm")] * 2)[FIRST + 12 : STOP - 12]
    assert twice == pytest.approx(steady), "holds at once are no more than one"


@pytest.mark.slow
def test_an_edited_contact_takes_its_grasp_along(model):
    clip = builtin_clip("carry_box")
    clip = replace(clip, people=(replace(clip.people[0], fingers_recorded=False),))
    before = solve(clip, model, Config())
    fingers = [7 + index for index, name in enumerate(model.joint_names) if name.split("_")[1] in FINGERS]
    left = [column for column in fingers if model.joint_names[column - 7].startswith("left")]
    middle = slice(110, 200)  # Of the contact: beside it, free fingers give way.
    bent = np.abs(before.motion.qpos[middle, left] - model.home_qpos[left]).max()
    edits = ContactEdits.of(clip).adding(Delete("left_hand", 150))
    after = resolve_locally(before, apply(clip, edits), Config())
    assert bent > 0.2 and np.abs(after.motion.qpos[middle, left] - model.home_qpos[left]).max() < 0.1 * bent
