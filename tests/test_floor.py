"""Which objects rest on the floor: still, untouched, with nothing under them; and feet as witnesses of it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from hoi_retarget.clip.clip import ContactTrack, Severity
from hoi_retarget.clip.floor import FLOOR_REACH, FLOOR_TOLERANCE, floor_height, on_floor, rests_on_floor
from hoi_retarget.human.skeleton import FEET
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from synthetic import make

CLIP = replace(make("carry_box", seconds=2.0), contacts=())
FRAMES = CLIP.frames


def box(name, place, size=(0.2, 0.2, 0.1), velocity=(0.0, 0.0, 0.0)):
    """Return a box of some size that stands at a place, moving evenly."""
    corners = np.array(size) * (np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T - [0.5, 0.5, 0.0])
    positions = np.array(place) + np.arange(FRAMES)[:, None] / CLIP.fps * np.array(velocity)
    geometry = ObjectGeometry(corners, faces=ConvexHull(corners).simplices)
    return ObjectTrack(name, positions, np.tile(se3.IDENTITY_QUAT, (FRAMES, 1)), geometry)


def rests(*objects, contacts=()):
    return rests_on_floor(replace(CLIP, objects=objects, contacts=contacts))


@pytest.mark.parametrize("height", [-0.3, -0.01, 0.0, 0.04, FLOOR_REACH + 0.01, 0.7])
def test_what_stands_still_near_the_floor_rests_on_it(height):
    assert (rests(box("box", (0, 0, height))) == (height < FLOOR_REACH)).all()


def test_what_is_known_by_sample_points_alone_is_not_judged():
    track = box("box", (0, 0, 0))
    assert not rests(replace(track, geometry=ObjectGeometry(track.geometry.points))).any()


@pytest.mark.parametrize("velocity", [(0.1, 0, 0), (0, 0, 0.1)])
def test_what_moves_does_not_rest(velocity):
    assert not rests(box("box", (0, 0, 0), velocity=velocity)).any()


def test_what_turns_on_the_spot_does_not_rest():
    track = box("box", (0, 0, 0))
    turning = se3.exp(np.outer(np.arange(FRAMES) / CLIP.fps, [0.0, 0.0, 1.0]))
    assert not rests(replace(track, quats=turning)).any()


def test_what_is_touched_does_not_rest():
    active = np.arange(FRAMES) % 30 < 15
    contact = ContactTrack(0, 0, "left_hand", active, np.zeros((FRAMES, 3)))
    np.testing.assert_array_equal(rests(box("box", (0, 0, 0)), contacts=(contact,))[0], ~active)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_what_lies_on_or_in_another_object_does_not_rest_on_the_floor(order):
    tray = box("tray", (0, 0, 0), size=(0.4, 0.4, 0.05))
    under = ((0.1, 0, 0.05), False), ((0.1, 0, 0.03), False), ((0.15, -0.15, 0.05), False)
    beside = ((0.5, 0, 0.05), True), ((0, 0.5, 0.05), True), ((0, -0.5, 0.05), True)
    for place, alone in (*under, *beside):
        pair = (tray, box("cup", place, size=(0.05, 0.05, 0.05)))
        found = rests(*(pair[index] for index in order))
        assert found[order.index(0)].all(), "the tray"
        assert (found[order.index(1)] == alone).all(), "the cup, beside it or on it"


def test_furniture_that_stands_under_other_furniture_rests_on_the_floor():
    table, chair = box("table", (0, 0, 0.002), size=(1.5, 1.0, 0.7)), box("chair", (0.3, 0, 0.0), size=(0.4, 0.4, 0.8))
    assert rests(table, chair).all()


def test_the_floor_is_below_the_toes_by_their_height_in_the_skeleton():
    person = CLIP.people[0]
    toes = np.concatenate([person.position(foot)[:, 2] for foot in FEET])
    for height in (0.0, 0.02, 0.07):
        found, frames = floor_height(replace(CLIP, people=(replace(person, toe_height=height),)))
        assert found == pytest.approx(np.quantile(toes, 0.1) - height, abs=0.01) and frames > FRAMES


def test_the_floor_is_as_high_as_a_tenth_of_the_standing_soles():
    person = CLIP.people[0]
    still = np.repeat(person.joint_positions[:1], FRAMES, axis=0)
    still[..., 2] += 1e-3 * np.arange(FRAMES)[:, None]
    turned = np.repeat(person.joint_quats[:1], FRAMES, axis=0)
    risen = replace(person, joint_positions=still, joint_quats=turned, toe_height=0.03)
    soles = np.concatenate([risen.position(foot)[:, 2] - 0.03 for foot in FEET])
    height, frames = floor_height(replace(CLIP, people=(risen,)))
    assert frames == 2 * FRAMES and height == pytest.approx(np.quantile(soles, 0.1), abs=1e-12)


@pytest.mark.parametrize("off", [-2.0, -0.5, -0.1, 0.0, 0.1, 0.5, 2.0])
@pytest.mark.parametrize("floor", [None, 0.0, 0.3])
def test_feet_that_stand_elsewhere_than_on_a_given_floor_are_reported(off, floor):
    up = np.array([0.0, 0.0, off + (floor or 0.0)])
    people = tuple(replace(person, joint_positions=person.joint_positions + up) for person in CLIP.people)
    clip = replace(CLIP, people=people)
    height = floor_height(clip)[0]
    warnings = on_floor(clip, at_zero=True, floor=floor).source.warnings
    texts = [str(warning) for warning in warnings]
    assert len(texts) == (abs(off) > FLOOR_TOLERANCE)
    assert all((warning.severity is Severity.ERROR) == (abs(off) > 1.0) for warning in warnings)
    assert all(f"pass --floor {height:.2f} unless" in text for text in texts)
    along = np.arange(FRAMES)[:, None, None] * np.array([0.5, 0.0, 0.0]) / CLIP.fps
    gliding = tuple(replace(person, joint_positions=person.joint_positions + along) for person in people)
    walked = on_floor(replace(clip, people=gliding), at_zero=True, floor=floor)
    assert walked.source.warnings == (), "feet that never stand are no witnesses"
