"""Which objects rest on the floor: still, untouched, with nothing under them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from hoi_retarget.clip.clip import ContactTrack
from hoi_retarget.clip.resting import FLOOR_REACH, floor_rests
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.synthetic import make

CLIP = replace(make("carry_box", seconds=2.0), contacts=())
FRAMES = CLIP.frames


def box(name, place, size=(0.2, 0.2, 0.1), velocity=(0.0, 0.0, 0.0)):
    """Return a box of some size that stands at a place, moving evenly."""
    corners = np.array(size) * (np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T - [0.5, 0.5, 0.0])
    positions = np.array(place) + np.arange(FRAMES)[:, None] / CLIP.fps * np.array(velocity)
    geometry = ObjectGeometry(corners, faces=ConvexHull(corners).simplices)
    return ObjectTrack(name, positions, np.tile(se3.IDENTITY_QUAT, (FRAMES, 1)), geometry)


def rests(*objects, contacts=()):
    return floor_rests(replace(CLIP, objects=objects, contacts=contacts))


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
    for place, alone in (((0.1, 0, 0.05), False), ((0.1, 0, 0.03), False), ((0.5, 0, 0.05), True)):
        pair = (tray, box("cup", place, size=(0.05, 0.05, 0.05)))
        found = rests(*(pair[index] for index in order))
        assert found[order.index(0)].all(), "the tray"
        assert (found[order.index(1)] == alone).all(), "the cup, beside it or on it"


def test_furniture_that_stands_under_other_furniture_rests_on_the_floor():
    table, chair = box("table", (0, 0, 0.002), size=(1.5, 1.0, 0.7)), box("chair", (0.3, 0, 0.0), size=(0.4, 0.4, 0.8))
    assert rests(table, chair).all()
