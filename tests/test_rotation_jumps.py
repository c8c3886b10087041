"""Joints that a recording turns faster than any person can: found wherever they are planted, and taken out."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.human.person import Person
from hoi_retarget.human.rotation_jumps import FASTEST, MOMENT_SECONDS, without_rotation_jumps
from hoi_retarget.human.skeleton import BODY_PARENTS, JOINT_INDEX
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import seconds_to_frames
from synthetic import SCENES, make

FPS = 30.0
PERSON = make("carry_box", seconds=4.0).people[0]
FRAMES = len(PERSON.joint_positions)
WRIST = JOINT_INDEX["left_wrist"]
FOREARM = np.array([1.0, 0.0, 0.0])
"""The axis of the left one, in its own frame."""


def rolled(first: int, stop: int, degrees: float) -> Person:
    """The person whose left hand is turned about the forearm in some frames."""
    quats = PERSON.joint_quats.copy()
    quats[first:stop, WRIST] = se3.quat_multiply(quats[first:stop, WRIST], se3.exp(np.radians(degrees) * FOREARM))
    return replace(PERSON, joint_quats=quats)


def steps(person: Person) -> np.ndarray:
    """Return how fast the left wrist turns against the forearm [rad/s]."""
    elbow = se3.quat_conjugate(person.quat("left_elbow"))
    local = se3.quat_multiply(elbow, person.quat("left_wrist"))
    return se3.angle_between(local[1:], local[:-1]) * FPS


def test_people_without_jumps_are_themselves():
    for scene in SCENES:
        for person in make(scene).people:
            assert without_rotation_jumps(person, FPS) == (person, ())


@given(st.integers(5, FRAMES - 40), st.integers(1, 25), st.floats(100, 179), st.sampled_from([-1, 1]))
@settings(max_examples=15, deadline=None)
def test_a_hand_that_flips_for_a_moment_goes_on_as_before(first, length, degrees, sign):
    found, (jump,) = without_rotation_jumps(rolled(first, first + length, sign * degrees), FPS)
    assert (jump.joint, jump.first_frame, jump.last_frame) == ("left_wrist", first, first + length - 1)
    np.testing.assert_allclose(se3.angle_between(found.joint_quats, PERSON.joint_quats)[:, :22], 0.0, atol=0.25)
    outside = np.r_[:first, first + length : FRAMES]
    np.testing.assert_allclose(found.joint_quats[outside], PERSON.joint_quats[outside], atol=1e-12)


@pytest.mark.parametrize("longer", [-1, 0, 1])
def test_what_stays_for_a_moment_or_longer_are_two_jumps(longer):
    length = seconds_to_frames(MOMENT_SECONDS, FPS) + longer
    _, jumps = without_rotation_jumps(rolled(30, 30 + length, 150.0), FPS)
    ends = [(30, 29 + length)] if longer < 0 else [(30, None), (30 + length, None)]
    assert [(jump.first_frame, jump.last_frame) for jump in jumps] == ends


@given(st.integers(20, FRAMES - 40), st.floats(100, 175))
@settings(max_examples=15, deadline=None)
def test_a_hand_that_flips_and_stays_turns_there_at_a_speed_that_people_have(first, degrees):
    found, (jump,) = without_rotation_jumps(rolled(first, FRAMES, degrees), FPS)
    assert (jump.first_frame, jump.last_frame) == (first, None)
    assert steps(rolled(first, FRAMES, degrees)).max() > FASTEST + 20 and steps(found).max() < FASTEST
    nearest = se3.angle_between(found.joint_quats, rolled(first, FRAMES, degrees).joint_quats)
    assert np.degrees(nearest.max()) < 90.0, "never further than halfway from the recording"


def test_what_hangs_from_a_joint_turns_with_it():
    """A forearm that jumps takes the hand along, whose rotation to the forearm stays."""
    quats, elbow = PERSON.joint_quats.copy(), JOINT_INDEX["left_elbow"]
    assert BODY_PARENTS[WRIST] == elbow
    axis = se3.rotate(quats[50:60, elbow], np.tile(FOREARM, (10, 1)))
    turns = se3.exp(np.radians(120.0) * axis)
    for joint in (elbow, WRIST):
        quats[50:60, joint] = se3.quat_multiply(turns, quats[50:60, joint])
    jumping = replace(PERSON, joint_quats=quats)
    found, (jump,) = without_rotation_jumps(jumping, FPS)
    assert jump.joint == "left_elbow"
    hands = [
        se3.quat_multiply(se3.quat_conjugate(p.quat("left_elbow")), p.quat("left_wrist")) for p in (found, jumping)
    ]
    np.testing.assert_allclose(se3.angle_between(*hands), 0.0, atol=1e-6)
    np.testing.assert_allclose(se3.angle_between(found.quat("left_wrist"), PERSON.quat("left_wrist")), 0.0, atol=0.25)


@pytest.mark.parametrize("joint", ["pelvis", "left_hip", "spine1", "right_shoulder"])
def test_all_that_hangs_from_a_joint_comes_back_with_it(joint):
    quats, index = PERSON.joint_quats.copy(), JOINT_INDEX[joint]
    below = [index]
    for child, parent in enumerate(BODY_PARENTS):
        if parent in below:
            below.append(child)
    turn = se3.exp(np.radians([0.0, 0.0, 120.0]))
    for child in below:
        quats[50:60, child] = se3.quat_multiply(turn, quats[50:60, child])
    found, (jump,) = without_rotation_jumps(replace(PERSON, joint_quats=quats), FPS)
    assert (jump.joint, jump.first_frame, jump.last_frame) == (joint, 50, 59)
    np.testing.assert_allclose(se3.angle_between(found.joint_quats, PERSON.joint_quats)[:, :22], 0.0, atol=0.25)
