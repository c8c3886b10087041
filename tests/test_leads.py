"""Leads: the recording stays as it is, feet that stand stay, bones keep their lengths, back is forth reversed."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.clip.augment import mirrored
from hoi_retarget.clip.leads import LARGEST_SPEED, with_leads
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, ClipError
from hoi_retarget.human.person import stance
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, PARENT
from hoi_retarget.numerics import se3
from hoi_retarget.readers.open import open_clip
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.robots import load_robot
from short_clips import cut, taken
from synthetic import make
from synthetic.jointed import open_laptop

PARENTS = [JOINT_INDEX[PARENT[joint]] for joint in JOINTS[1:]]
BOX = make("carry_box")


def lifted_foot(height, yaw=0.3):
    """The first frames of a clip with the left leg raised sideways, turned about the vertical."""
    clip = cut(BOX, 40)
    (person,) = clip.people
    positions, quats = person.joint_positions.copy(), person.joint_quats.copy()
    leg = [JOINT_INDEX[f"left_{name}"] for name in ("knee", "ankle", "foot")]
    hip, hip_joint = positions[:, [JOINT_INDEX["left_hip"]]], JOINT_INDEX["left_hip"]
    raising = se3.exp(np.array([0.0, 0.0, height]) @ se3.quat_to_matrix(quats[0, 0]).T)
    positions[:, leg] = hip + se3.rotate(raising, positions[:, leg] - hip)
    quats[:, [hip_joint, *leg]] = se3.quat_multiply(raising, quats[:, [hip_joint, *leg]])
    turn = se3.exp(np.array([0.0, 0.0, yaw]))
    person = replace(person, joint_positions=se3.rotate(turn, positions), joint_quats=se3.quat_multiply(turn, quats))
    track = clip.objects[0]
    track = replace(track, positions=se3.rotate(turn, track.positions), quats=se3.quat_multiply(turn, track.quats))
    return replace(clip, people=(person,), objects=(track,))


def bones(person):
    return np.linalg.norm(person.joint_positions[:, 1:] - person.joint_positions[:, PARENTS], axis=2)


@settings(deadline=None, max_examples=15)
@given(height=st.floats(0.0, 1.2), yaw=st.floats(-3.0, 3.0), seconds=st.floats(1.0, 3.0))
def test_a_lead_ends_in_the_recording_and_its_person_stays_whole(height, yaw, seconds):
    clip = lifted_foot(height, yaw)
    led = with_leads(clip, seconds, 0.0)
    frames = led.frames - clip.frames
    assert frames == round(seconds * clip.fps)
    (person,), (recorded,) = led.people, clip.people
    np.testing.assert_array_equal(person.joint_positions[frames:], recorded.joint_positions)
    np.testing.assert_allclose(person.joint_quats[frames:], recorded.joint_quats, atol=1e-12)
    np.testing.assert_array_equal(led.objects[0].positions[:frames], clip.objects[0].positions[:1].repeat(frames, 0))
    np.testing.assert_allclose(bones(person), bones(recorded)[:1].repeat(led.frames, 0), atol=2e-3)
    bone = person.joint_positions[:, 1:] - person.joint_positions[:, PARENTS]
    offsets = se3.rotate_inverse(person.joint_quats[:, PARENTS], bone)
    np.testing.assert_allclose(offsets[:frames], offsets[[frames]].repeat(frames, 0), atol=1e-6)
    steps = np.linalg.norm(np.diff(person.joint_positions, axis=0), axis=2).max(axis=1) * clip.fps
    assert steps[frames - 1] < 0.5, "no jump where the recording begins"
    assert steps[0] < 0.1, "it begins at rest"
    chest, pelvis = person.position("neck")[0], person.position("pelvis")[0]
    assert np.linalg.norm((chest - pelvis)[:2]) < 0.1, "upright"


@pytest.mark.parametrize("height", [0.0, 0.8])
def test_feet_that_stand_stay_and_the_other_one_steps(height):
    clip = lifted_foot(height)
    person = with_leads(clip, 2.0, 0.0).people[0]
    lead = slice(0, round(2.0 * clip.fps))
    assert np.ptp(person.position("right_ankle")[lead], axis=0).max() < 1e-9
    assert stance(person, clip.fps)[0].all(), "both stand at the begin"
    moved = np.ptp(person.position("left_ankle")[lead], axis=0).max()
    assert (moved > 0.2) == (height > 0.0)


def test_a_lead_out_is_a_lead_in_of_the_reversed_recording():
    clip = cut(BOX, 40)
    backwards = with_leads(clip, 0.0, 1.5).people[0]
    (person,) = clip.people
    reversed_person = replace(
        person, joint_positions=person.joint_positions[::-1], joint_quats=person.joint_quats[::-1]
    )
    forwards = with_leads(replace(clip, people=(reversed_person,)), 1.5, 0.0).people[0]
    np.testing.assert_array_equal(backwards.joint_positions[::-1], forwards.joint_positions)


def test_the_lead_of_a_mirror_image_is_the_mirror_image_of_the_lead():
    clip = lifted_foot(0.8)
    one, other = with_leads(mirrored(clip), 1.0, 0.0).people[0], mirrored(with_leads(clip, 1.0, 0.0)).people[0]
    np.testing.assert_allclose(one.joint_positions, other.joint_positions, atol=1e-9)
    assert se3.angle_between(one.joint_quats, other.joint_quats).max() < 1e-6


def test_contacts_and_leads_of_an_opened_clip():
    clip, led = open_clip("builtin:carry_box"), open_clip("builtin:carry_box", ReadOptions(lead_in=1.0, lead_out=2.0))
    first, last = round(clip.fps), round(2.0 * clip.fps)
    for before, after in zip(clip.contacts, led.contacts, strict=True):
        np.testing.assert_array_equal(after.active, np.pad(before.active, (first, last)))
        np.testing.assert_array_equal(after.contact_points[first:-last], before.contact_points)
    assert sum("--lead-" in note for note in led.source.notes) == 2


def test_nobody_stands_at_rest_beside_what_moves_or_is_held():
    lift = BOX.contacts[0].segments[0][0] + 60
    carried = cut(BOX, lift + 30, first=lift)
    with pytest.raises(ClipError, match="first frame"):
        with_leads(carried, 1.0, 0.0)
    track = BOX.objects[0]
    sliding = track.positions + np.outer(np.arange(BOX.frames), [2.0 * LARGEST_SPEED / BOX.fps, 0.0, 0.0])
    with pytest.raises(ClipError, match=r"moves at 0.10 m/s in its first frame"):
        with_leads(replace(BOX, objects=(replace(track, positions=sliding),)), 1.0, 0.0)
    with pytest.raises(ArgumentError, match=r"lead-out 0.2"):
        ReadOptions(lead_out=0.2)


def test_a_robot_that_is_led_stands_and_touches_as_before():
    clip = open_clip("builtin:carry_box", ReadOptions(lead_in=1.0))
    motion = retarget(clip, load_robot("unitree_g1"))
    frames = round(clip.fps)
    assert not motion.contact_flags[:frames].any()
    assert np.ptp(motion.qpos[: frames // 2, 2]) < 0.05


@pytest.mark.parametrize("hinged", [True, False])
def test_an_object_that_is_touched_where_it_rests_is_not_held(hinged):
    clip, _ = open_laptop()
    begun = taken(clip, np.arange(43, clip.frames))  # The hand is at the lid, which is closed yet.
    lid, base, stand = begun.objects
    lid = lid if hinged else replace(lid, joint=None)
    led = with_leads(replace(begun, objects=(lid, base, stand)), 1.0, 0.0)
    assert led.frames == begun.frames + 30
    alone = replace(begun, objects=(replace(lid, joint=None),))
    with pytest.raises(ClipError, match="held in the air"):
        with_leads(alone, 1.0, 0.0)
