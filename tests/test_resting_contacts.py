"""Parts that rest: who sits is labelled, and the robot sits on the seat; who stands or carries is not."""

from dataclasses import replace

import numpy as np
import pytest

import hoi_retarget as hr
from hoi_retarget.clip.clip import ContactTrack
from hoi_retarget.clip.infer_contacts import with_contacts
from hoi_retarget.dynamics.feasibility import forces_on_clip
from hoi_retarget.human.skeleton import BODY_PARTS
from hoi_retarget.retargeting.local_resolve import resolve_locally
from hoi_retarget.retargeting.solve import solve
from hoi_retarget.retargeting.targets import make_targets
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.skin import skins_from
from hoi_retarget.robots.spec import BODY_SITES
from seated import SEATED, sits_down
from synthetic import SCENES, make

CLIP = sits_down()


def resting(clip):
    return {track.part: track for track in with_contacts(clip).contacts if track.part in BODY_PARTS}


def moved(clip, paths):
    return replace(clip, objects=(replace(clip.objects[0], positions=clip.objects[0].positions + paths),))


# Labels


@pytest.mark.parametrize("fps", [30.0, 60.0])
def test_somebody_who_sits_down_rests_from_then_on(fps):
    found = resting(sits_down(fps=fps))
    assert set(found) == {"pelvis", "left_thigh", "right_thigh"}
    for track in found.values():
        ((first, stop),) = track.segments
        assert stop == len(track.active)
        assert SEATED - 0.35 < first / fps < SEATED + 0.05


def test_contact_points_are_the_parts_own():
    track = resting(CLIP)["pelvis"]
    wanted = CLIP.objects[0].to_object(CLIP.people[0].position("pelvis"))
    np.testing.assert_allclose(track.contact_points[track.active], wanted[track.active])


def test_somebody_who_squats_over_a_seat_does_not_rest():
    assert resting(sits_down(gap=0.05)) == {}


def test_what_moves_or_is_over_the_part_or_beside_it_bears_nothing():
    swaying = 0.3 * np.sin(np.arange(CLIP.frames) / 3.0)[:, None] * np.array([0.0, 1.0, 0.0])
    assert resting(moved(CLIP, swaying)) == {}
    pelvis = CLIP.people[0].position("pelvis")[-1]
    for place in ([0.0, 0.0, 0.32], [-0.31, 0.0, 0.0], [0.0, 0.36, 0.0]):
        found = resting(moved(CLIP, pelvis + place - CLIP.objects[0].positions[0]))
        assert not {"pelvis", "left_thigh", "right_thigh"} & set(found)


@pytest.mark.parametrize("scene", SCENES)
def test_nobody_who_walks_and_carries_rests(scene):
    assert resting(replace(make(scene), contacts=())) == {}


def test_recorded_contacts_stay_and_the_seat_comes_beside_them():
    hand = ContactTrack(0, 0, "left_hand", np.arange(CLIP.frames) > 90, np.zeros((CLIP.frames, 3)))
    clip = with_contacts(replace(CLIP, contacts=(hand,)))
    assert clip.contacts[0] is hand
    assert {track.part for track in clip.contacts[1:]} == set(resting(CLIP))
    assert any("sits on stool" in note for note in clip.source.notes)


# The robot


@pytest.mark.parametrize("name", ["unitree_g1", "unitree_h2"])
def test_parts_are_other_links_each(name):
    model = load_robot(name)
    links = [skin.link for site in BODY_SITES.values() for skin in skins_from(model, site)]
    assert len(set(links)) == len(links)
    assert all(skins_from(model, site) for site in BODY_SITES.values())
    assert {skin.link for skin in skins_from(model, "pelvis")} >= {"pelvis", "left_hip_roll_link"}


@pytest.mark.parametrize("contact", ["surface", "landmark"])
def test_without_such_labels_there_are_hands_and_feet_alone(contact):
    model = load_robot("unitree_g1")
    assert len(make_targets(make("carry_box"), model, hr.Config().scaling, contact=contact).contact_links) == 4
    seated = make_targets(with_contacts(CLIP), model, hr.Config().scaling, contact=contact)
    assert seated.contact_links[4:] == (("pelvis", "left_hip", "right_hip") if contact == "surface" else ())


def test_landmarks_of_somebody_who_sits_are_those_of_hands_and_feet():
    model, config = load_robot("unitree_g1"), hr.Config(contact="landmark")
    motion, bare = hr.retarget(with_contacts(CLIP), model, config), solve(CLIP, model, config).motion
    np.testing.assert_array_equal(motion.qpos, bare.qpos)
    assert motion.report.unreached_contacts == ()
    assert motion.report.figures["rest_share"] == 0.0


@pytest.mark.parametrize("name", ["unitree_g1", pytest.param("unitree_h2", marks=pytest.mark.slow)])
def test_the_robot_sits_on_the_seat_which_bears_it(name):
    clip, model = with_contacts(CLIP), load_robot(name)
    motion = hr.retarget(clip, model, hr.Config())
    figures = motion.report.figures
    assert figures["rest_share"] > 0.95
    assert figures["rest_gap_p95_m"] < 0.005
    assert figures["penetration_max_m"] < 0.005
    assert figures["torque_p95_share"] < 1.5
    assert motion.report.unreached_contacts == ()
    forces = forces_on_clip(motion, clip, model)
    on_seat = sum(
        forces.on_robot[-1, index, 2] for index, point in enumerate(forces.points) if point.link and point.object == 0
    )
    assert on_seat > 0.3 * 9.81 * forces.mass


@pytest.mark.slow
def test_an_added_seat_is_the_same_as_a_recorded_one():
    model, config = load_robot("unitree_g1"), hr.Config()
    clip = with_contacts(CLIP)
    bare = replace(clip, contacts=tuple(track for track in clip.contacts if track.part not in BODY_PARTS))
    before = solve(bare, model, config)
    again = resolve_locally(before, clip, config)
    assert again.motion.contact_links == again.targets.contact_links
    np.testing.assert_array_equal(again.motion.qpos, solve(clip, model, config).motion.qpos)
