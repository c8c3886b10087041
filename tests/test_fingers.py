"""Laws of fingers: robots' are found by geometry, bend as the person's do, and touch where the person's do."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from finger_robot import FINGERS, finger_robot
from hoi_retarget.cli import main
from hoi_retarget.clip.clip import ContactTrack
from hoi_retarget.clip.edits import Add, ContactEdits, Delete, Fix, FixAll, Move, Retime, Snap, apply, save, segments_of
from hoi_retarget.clip.label_contacts import (
    CAPSULE_FINGERS,
    LABELLED,
    ON_SURFACE,
    finger_contacts,
    of_part,
    with_finger_contacts,
)
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.evaluation import evaluate
from hoi_retarget.human.skeleton import FINGER_PARTS
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.readers.builtin_clips import builtin_clip
from hoi_retarget.readers.open import open_clip
from hoi_retarget.readers.own_layout import write as write_clip
from hoi_retarget.retargeting.config import Config, Weights
from hoi_retarget.retargeting.fingers import _bent, _straight_reach, with_fingers
from hoi_retarget.retargeting.retarget import judge
from hoi_retarget.retargeting.solve import solve
from hoi_retarget.retargeting.surfaces.contact_targets import resting_palms
from hoi_retarget.retargeting.surfaces.skin_points import moving_objects
from hoi_retarget.retargeting.targets import finger_touch, make_targets
from hoi_retarget.retargeting.trajopt.terms.posture import coupling_terms
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.adding.build import build_robot
from hoi_retarget.robots.adding.description import read_description
from hoi_retarget.robots.adding.findings import Hints, UnsuitableRobotError
from hoi_retarget.robots.model import load_model
from hoi_retarget.robots.spec import SIDES, HeldJoint
from hoi_retarget.studio.editor.edit_session import EditSession, solved
from synthetic.mug import raise_mug

SHARED = Path(__file__).resolve().parents[1].parent / "shared" / "data"
SITES = [f"{side}_{finger}" for side in SIDES for finger in FINGERS]


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return finger_robot(tmp_path_factory.mktemp("fingers"))


@cache
def clip():
    return builtin_clip("carry_box")


@cache
def targets():
    return make_targets(clip(), load_robot("unitree_g1"), Config().scaling)


def test_fingers_are_found_in_a_file_with_their_pads_on_the_side_that_closes(model, tmp_path):
    built = build_robot(model.spec.mjcf, "found", Hints(fingers=True))
    assert sorted(built.spec.fingers) == sorted(SITES) and not built.spec.held
    told = [finding for finding in built.findings if finding.hint == "fingers = false"]
    assert [finding.subject for finding in told] == [site.replace("_", " ") for site in SITES]
    (tmp_path / "robot.xml").write_text(built.mjcf)
    found = load_model(replace(built.spec, mjcf=tmp_path / "robot.xml"))
    for site in SITES:
        assert found.body_of(site) == model.body_of(site)
        placed = found.sites.frames[site].position - model.sites.frames[site].position
        assert np.linalg.norm(placed) < 0.006


def test_fingers_are_held_unless_they_are_asked_for(model):
    built = build_robot(model.spec.mjcf, "held", Hints())
    assert not built.spec.fingers and len(built.spec.held) == 14


def test_a_hand_with_one_finger_is_refused(model):
    keep = [name for name in model.joint_names if "thumb" in name]
    locked = tuple(name for name in model.joint_names if ("index" in name or "ring" in name) and name not in keep)
    with pytest.raises(UnsuitableRobotError, match="1 fingers"):
        build_robot(model.spec.mjcf, "one", Hints(fingers=True, lock=locked))


@settings(deadline=None, max_examples=10)
@given(seed=st.integers(0, 1000), side=st.sampled_from(SIDES))
def test_pads_that_the_hand_can_reach_are_reached_within_ranges(model, seed, side):
    random = np.random.default_rng(seed)
    sites = [site for site in SITES if site.startswith(side)]
    columns = [7 + model.joint_names.index(name) for name in model.joint_names if name.split("_")[1] in FINGERS]
    columns = [column for column in columns if model.joint_names[column - 7].startswith(side)]
    qpos = np.tile(model.home_qpos, (4, 1))
    bent = qpos.copy()
    bent[:, columns] = random.uniform(0.1, 1.2, len(columns))  # Steady: smoothing changes nothing.
    kinematics = model.forward(bent)
    place, turn = kinematics.site_position(f"{side}_palm"), kinematics.site_rotation(f"{side}_palm")
    goals = {site: np.einsum("tji,tj->ti", turn, kinematics.site_position(site) - place) for site in sites}
    found = _bent(model, f"{side}_palm", goals, qpos, 30.0)
    after = model.forward(found)
    for site in sites:
        assert np.linalg.norm(after.site_position(site) - kinematics.site_position(site), axis=1).max() < 1e-3
    assert (found[:, 7:] >= model.lower - 1e-9).all() and (found[:, 7:] <= model.upper + 1e-9).all()
    others = np.setdiff1d(np.arange(qpos.shape[1]), columns)
    assert np.array_equal(found[:, others], qpos[:, others])


COUPLED = HeldJoint("left_index_1_joint", "left_index_0_joint", 0.8, 0.05)


@pytest.fixture(scope="module")
def coupled(model):
    return replace(model, spec=replace(model.spec, couplings=(COUPLED,)))


def test_joints_that_follow_others_are_found_as_such_and_follow(coupled, tmp_path):
    text = coupled.spec.mjcf.read_text()
    equality = f'<joint joint1="{COUPLED.joint}" joint2="{COUPLED.other}" polycoef="0.05 0.8 0 0 0"/>'
    (tmp_path / "coupled.xml").write_text(text.replace("</mujoco>", f"<equality>{equality}</equality></mujoco>"))
    built = build_robot(tmp_path / "coupled.xml", "coupled", Hints(fingers=True))
    assert built.spec.couplings == (COUPLED,) and not built.spec.held
    assert not [finding for finding in built.findings if finding.subject == "coupled joints"]
    goals = {"left_index": np.tile([0.08, -0.03, 0.02], (5, 1))}
    bent = _bent(coupled, "left_palm", goals, np.tile(coupled.home_qpos, (5, 1)), 30.0)
    joint, other = (bent[:, 7 + coupled.joint_names.index(name)] for name in (COUPLED.joint, COUPLED.other))
    assert np.abs(other).max() > 0.1 and joint == pytest.approx(0.8 * other + 0.05, abs=1e-12)


def test_fingers_whose_file_states_no_effort_for_any_are_driven(model, monkeypatch):
    fingers = tuple(name for name in model.joint_names if name not in load_robot("unitree_g1").joint_names)
    found = read_description(model.spec.mjcf)
    for passive, loose in (
        (fingers, ()),
        (fingers[:3], fingers[:3]),
        ((*fingers, "waist_yaw_joint"), ("waist_yaw_joint",)),
    ):
        description = replace(found, passive=passive)
        monkeypatch.setattr("hoi_retarget.robots.adding.build.read_description", lambda *_, it=description, **__: it)
        built = build_robot(model.spec.mjcf, "found", Hints(fingers=True))
        assert sorted(one.joint for one in built.spec.couplings) == sorted(loose)


def test_a_robot_has_a_term_for_each_joint_that_follows_another(coupled):
    still = coupled.forward(np.tile(coupled.home_qpos, (3, 1)))
    (term,) = coupling_terms(Weights(), targets(), still)
    assert [coupled.joint_names[place] for place in (term.joint, term.other)] == [COUPLED.joint, COUPLED.other]
    (rows,) = term.rows(still)
    assert rows.residual == pytest.approx(np.full((1, 3), -0.05))


def test_robots_without_fingers_and_people_without_recorded_ones_change_nothing(model):
    g1, person = load_robot("unitree_g1"), clip().people[0]
    qpos = np.tile(g1.home_qpos, (clip().frames, 1))
    assert with_fingers(g1, targets(), person, qpos) is qpos
    made_up = replace(person, fingers_recorded=False)
    assert with_fingers(model, targets(), made_up, qpos) is qpos
    assert finger_contacts(replace(clip(), people=(made_up,)), 0) == ()


def test_fingers_touch_where_they_are_near_and_the_hand_touches():
    tracks = finger_contacts(clip(), 0)
    assert [track.part for track in tracks] == list(FINGER_PARTS)
    surface = surface_of(clip().objects[0].geometry)
    for track in tracks:
        (hand,) = [one for one in clip().contacts if one.part == f"{track.part.split('_')[0]}_hand"]
        distances, _ = of_part(clip().people[0], track.part, clip().objects)[0]
        assert track.active.any() and not (track.active & ~hand.active).any()
        assert np.median(distances[track.active]) < CAPSULE_FINGERS.release
        assert not (hand.active & (distances < CAPSULE_FINGERS.touch) & ~track.active)[10:-10].any()
        assert surface.distances(track.contact_points[track.active]).max() < 1e-6


def test_recorded_contacts_of_fingers_are_taken_as_they_are_and_written(tmp_path, model):
    points = np.tile(clip().objects[0].geometry.points[0], (clip().frames, 1))
    own = ContactTrack(0, 0, "left_thumb", np.arange(clip().frames) < 50, points)
    recorded = replace(clip(), contacts=(*clip().contacts, own))
    assert finger_contacts(recorded, 0) == (own,)
    found = make_targets(recorded, model, Config().scaling)
    assert found.contact_flags[:, found.contact_links.index("left_thumb")].sum() == 50
    write_clip(recorded, tmp_path / "clip.npz")
    again = open_clip(tmp_path / "clip.npz")
    (track,) = [track for track in again.contacts if track.part == "left_thumb"]
    assert np.array_equal(track.active, own.active)


def test_points_of_labelled_fingers_off_the_surface_become_its_nearest():
    surface, person = surface_of(clip().objects[0].geometry), clip().people[0]
    hand = next(one for one in clip().contacts if one.part == "left_hand")
    joint = clip().objects[0].to_object(person.part_position("left_index"))
    labelled = ContactTrack(0, 0, "left_index", hand.active, joint)
    assert surface.distances(joint[hand.active]).max() > ON_SURFACE
    (found,) = finger_contacts(replace(clip(), contacts=(*clip().contacts, labelled)), 0)
    gaps, nearest = of_part(person, "left_index", clip().objects)[0]
    assert np.array_equal(found.active, labelled.active & (gaps < LABELLED)) and found.active.any()
    assert surface.distances(found.contact_points[found.active]).max() < 1e-6
    np.testing.assert_array_equal(found.contact_points[found.active], nearest[found.active])


def test_a_hand_that_is_moved_takes_its_fingers_along_its_object():
    surface = surface_of(clip().objects[0].geometry)
    whole = with_finger_contacts(clip(), 0)
    for one, again in zip(whole.contacts, with_finger_contacts(whole, 0).contacts, strict=True):
        assert one.part == again.part and np.array_equal(one.active, again.active)
        np.testing.assert_array_equal(one.contact_points, again.contact_points)
    offset = np.array([0.02, 0.0, 0.03])
    hand = next(item for item in segments_of(clip()) if item.part == "left_hand")
    edits = ContactEdits.of(clip()).adding(Move("left_hand", hand.start, tuple(offset.tolist())))
    before, after = (finger_contacts(whole, 0), with_finger_contacts(apply(clip(), edits), 0).contacts)
    for track in before:
        pieces = [item for item in after if item.part == track.part]
        (found,) = [item.contact_points for item in pieces]
        inside = track.active & (np.arange(clip().frames) >= hand.start) & (np.arange(clip().frames) < hand.stop)
        moved = track.contact_points + (offset if track.part.startswith("left") else 0.0)
        np.testing.assert_allclose(found[inside], surface.closest_points(moved[inside]), atol=1e-9)


def test_a_finger_found_by_geometry_is_edited_as_one_that_is_labelled():
    whole = with_finger_contacts(clip(), 0)
    thumb = next(item for item in segments_of(whole) if item.part == "left_thumb")
    edits = ContactEdits.of(clip()).adding(Move("left_thumb", thumb.start, (0.0, 0.0, 0.02)))
    edited = with_finger_contacts(apply(clip(), edits), 0)
    surface = surface_of(clip().objects[0].geometry)
    for item, other in zip(segments_of(whole), segments_of(edited), strict=True):
        assert (item.part, item.start, item.stop) == (other.part, other.start, other.stop)
        wanted = item.points
        if item.part == "left_thumb" and item.start == thumb.start:
            wanted = surface.closest_points(wanted + np.array([0.0, 0.0, 0.02]))
            assert np.abs(wanted - item.points).max() > 0.01
        np.testing.assert_allclose(other.points, wanted, atol=1e-9)


def seen(*edits, of=None):
    """Return the contacts of fingers by part and first frame, as the robot gets them after edits."""
    of = of or clip()
    made = ContactEdits.of(of)
    for edit in edits:
        made = made.adding(edit)
    tracks = with_finger_contacts(apply(of, made), 0).contacts
    return {
        (track.part, int(np.flatnonzero(track.active)[0])): track
        for track in tracks
        if track.part in FINGER_PARTS and track.active.any()
    }


def test_edited_fingers_are_where_their_edits_put_them_whatever_their_hand_does():
    surface, place = surface_of(clip().objects[0].geometry), (0.05, 0.2022, 0.05)
    away = Move("left_hand", 90, (0.03, 0.0, 0.0))
    fixed = seen(away, Fix("left_thumb", 90, place))["left_thumb", 87]
    wanted = np.tile(surface.closest_points(np.array([place])), (137, 1))
    np.testing.assert_allclose(fixed.contact_points[87:224], wanted, atol=1e-9)
    added = seen(away, Delete("left_thumb", 90), Add("left_thumb", 100, 120, place))["left_thumb", 100]
    np.testing.assert_allclose(added.contact_points[100:120], wanted[:20], atol=1e-9)
    # Hands and fingers that slide, labelled: with one point each they stay there.
    frames = np.arange(clip().frames)
    slid = np.column_stack([0.0004 * (frames - 87), 0.0 * frames, 0.0 * frames])
    contacts = [
        replace(track, contact_points=track.contact_points + slid) for track in with_finger_contacts(clip(), 0).contacts
    ]
    for track in seen(FixAll(), of=replace(clip(), contacts=tuple(contacts))).values():
        assert np.ptp(track.contact_points[track.active], axis=0).max() < 1e-9


def test_fingers_end_with_their_hand_and_deleted_ones_stay_away():
    nothing = Move("right_thumb", 90, (0.0, 0.0, 0.0))
    for edits in ((Delete("left_hand", 90),), (Retime("left_hand", 90, 87, 117),), (Retime("left_hand", 90, 87, 244),)):
        alone, other = seen(*edits), seen(*edits, nothing)
        assert alone.keys() == other.keys()
        for key, track in alone.items():
            assert np.array_equal(track.active, other[key].active)
            np.testing.assert_allclose(track.contact_points, other[key].contact_points, atol=1e-9)
    assert {part for part, _ in seen(Delete("left_hand", 90))} == {part for part in FINGER_PARTS if part[0] == "r"}
    assert seen(*(Delete(part, 90) for part in FINGER_PARTS)) == {}


def test_fingers_go_along_the_surface_alone():
    before = seen()
    for key, track in seen(Snap("left_hand", 90)).items():
        np.testing.assert_allclose(track.contact_points, before[key].contact_points, atol=1e-9)
    thumb = seen(Move("left_hand", 90, (0.03, 0.0, 0.0)), Retime("left_hand", 90, 87, 244))["left_thumb", 87]
    moved = (thumb.contact_points - before["left_thumb", 87].contact_points)[87:224]
    np.testing.assert_allclose(moved, np.tile([0.03, 0.0, 0.0], (137, 1)), atol=1e-9)


def test_edits_of_fingers_that_do_not_move_are_told(tmp_path, capsys):
    save(ContactEdits.of(clip()).adding(Move("left_thumb", 90, (0.0, 0.0, 0.02))), tmp_path / "a.toml")
    words = ["--edits", str(tmp_path / "a.toml"), "--contact", "landmark", "--figures", "none", "--out", str(tmp_path)]
    assert main(["run", "builtin:carry_box", *words]) == 0
    assert "edits of fingers change nothing" in capsys.readouterr().err


@pytest.mark.parametrize("part", ["left_hand", "left_thumb"])
def test_an_edited_contact_moves_the_finger_at_once(model, part):
    config = Config()
    start = solved(clip(), model, config, ContactEdits.of(clip()))
    assert {item.part for item in start.segments} >= {"left_hand", "left_thumb", "right_ring"}
    frame = next(item for item in start.segments if item.part == part).start + 5
    after = EditSession(clip(), model, config, start).preview(Move(part, frame, (0.0, 0.0, 0.03)), quickly=False)
    places = []
    for state in (start, after):
        (motion,) = state.motions
        pad = model.forward(motion.qpos).site_position("left_thumb")
        places.append(se3.rotate_inverse(motion.object_quat[:, 0], pad - motion.object_pos[:, 0])[frame + 15])
    moved = (places[1] - places[0])[2] / start.motions[0].object_scale[0]
    assert 0.015 < moved < 0.045


def test_labels_of_fingers_far_from_their_object_are_late():
    away = replace(clip().objects[0], positions=clip().objects[0].positions + np.array([30.0, 0.0, 0.0]))
    points = away.to_object(clip().people[0].part_position("left_index"))
    labelled = ContactTrack(0, 0, "left_index", np.arange(clip().frames) < 50, points)
    (found,) = finger_contacts(replace(clip(), objects=(away,), contacts=(labelled,)), 0)
    assert not found.active.any()


def test_fingers_lead_a_hand_in_whole_runs_of_its_contact(model):
    found = make_targets(clip(), model, Config().scaling)
    column = found.contact_links.index("left_palm")
    flags = found.contact_flags.copy()
    flags[:, column] = (np.arange(found.frames) % 100) < 60
    flags[:, found.contact_links.index("left_index")] = False
    thumb = found.contact_links.index("left_thumb")
    flags[:, [found.contact_links.index(f"left_{finger}") for finger in FINGERS]] = False
    flags[130, thumb] = True
    led = finger_touch(replace(found, contact_flags=flags), column)
    assert np.array_equal(np.flatnonzero(led), np.arange(100, 160))


@pytest.mark.parametrize("moved", [(0.0, 0.0, 0.0), (0.02, -0.01, 0.005)])
def test_a_palm_that_fingers_lead_rests_where_it_is_in_the_middle_of_a_contact(model, moved):
    """However far that is from the person's place; a few frames elsewhere change nothing, nor do other palms."""
    found = make_targets(clip(), model, Config().scaling)
    column = found.contact_links.index("left_palm")
    objects = moving_objects(found)
    kinematics = model.forward(np.repeat(model.home_qpos[None], found.frames, axis=0))
    frames = np.flatnonzero(finger_touch(found, column))
    place = objects[0].inside(kinematics.site_position("left_palm").T[:, None], np.arange(found.frames))[:, 0].T
    points = found.carried_contact_points.copy()
    points[:, column] = place - np.array(moved)
    points[frames[:10], column] += 0.3
    led = replace(found, carried_contact_points=points)
    after = resting_palms(led, objects, kinematics)
    np.testing.assert_allclose(after.carried_contact_points[frames[10:], column], place[frames[10:]], atol=1e-9)
    assert (after.contact_weights[frames, column] > led.contact_weights[frames, column]).all()
    others = np.setdiff1d(np.arange(found.frames), frames)
    np.testing.assert_array_equal(after.contact_weights[others], led.contact_weights[others])
    fingers = [link for link, site in enumerate(found.contact_links) if not site.endswith("palm")]
    np.testing.assert_array_equal(after.carried_contact_points[:, fingers], points[:, fingers])


def from_frame(person, first):
    return replace(person, joint_positions=person.joint_positions[first:], joint_quats=person.joint_quats[first:])


@pytest.mark.parametrize("side", SIDES)
def test_a_straight_reach_is_that_of_the_bones_however_fingers_bend(side):
    person = clip().people[0]
    reaches = {_straight_reach(from_frame(person, first), f"{side}_index", f"{side}_wrist") for first in (0, 50, 120)}
    assert max(reaches) - min(reaches) < 1e-6 and 0.14 < min(reaches) < 0.22


DEX3 = SHARED / "robots/unitree_g1_hands/g1_29dof_with_hand_rev_1_0.urdf"
GRAB = SHARED / "foreign/grab"


@pytest.mark.slow
@pytest.mark.skipif(not DEX3.exists(), reason="the shared data is not beside the project")
def test_a_robot_with_the_makers_fingers_holds_an_apple_where_the_person_does(tmp_path):
    built = build_robot(DEX3, "dex3", Hints(fingers=True))
    assert [finger.rsplit("_", 1)[1] for finger in built.spec.fingers] == ["thumb", "index", "ring"] * 2
    mjcf = tmp_path / "robot.xml"
    mjcf.write_text(built.mjcf)
    robot = load_model(replace(built.spec, mjcf=mjcf))
    recorded = open_clip(GRAB / "s1_apple,table_10_334.pt", ReadOptions(objects=GRAB / "objects"))
    solution = solve(recorded, robot, Config())
    figures = evaluate(solution.motion, recorded, robot)
    assert figures["finger_touch_share"] > 0.95 and figures["finger_depth_max_m"] < 0.004
    assert figures["joint_range_margin_rad"] >= 0.0 and figures["joint_speed_margin_radps"] >= 0.0
    unreached = judge(solution).report.unreached_contacts
    assert {event.subject for event in unreached} <= {"right_palm"}  # Its label lasts longer than its fingers touch.
    # By wrenches: apples weigh little, and a program that is not solved says that they are not held at all.
    assert figures["grip_margin_g"] > 1.0 and figures["closure_share"] > 0.9


@pytest.mark.slow
def test_a_mug_is_grasped_with_the_persons_fingers():
    recorded, robot = raise_mug(), load_robot("unitree_g1_dex3")
    figures = evaluate(solve(recorded, robot, Config()).motion, recorded, robot)
    assert figures["finger_touch_share"] > 0.95 and figures["finger_depth_max_m"] < 0.004
    assert figures["person_closure_share"] == 1.0 and figures["closure_share"] > 0.25
