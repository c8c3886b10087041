"""Augmented clips: mirrors undo themselves, speeds too, and what the robot does is augmented like the clip."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.clip.augment import at_rate, at_speed, augment, describe, mirrored
from hoi_retarget.clip.clip import Augmentation, Clip, ContactTrack
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, ClipError, GeometryError
from hoi_retarget.human.skeleton import PARENT
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.robots import ROBOTS
from hoi_retarget.robots.model import load_model
from intermimic_writer import random_clip, write_box
from short_clips import cut
from synthetic import make

LAWS = settings(max_examples=10, deadline=None)
MIRROR = np.array([1.0, -1.0, 1.0])
SIDES = {"left": "right", "right": "left"}


def other(name: str) -> str:
    side, _, rest = name.partition("_")
    return f"{SIDES[side]}_{rest}" if side in SIDES else name


def check_same(a: Clip, b: Clip, atol: float = 0.0) -> None:
    """Two clips agree in every number; rotations as rotations, shapes as surfaces."""
    for x, y in zip(a.people, b.people, strict=True):
        np.testing.assert_allclose(x.joint_positions, y.joint_positions, atol=atol, rtol=0)
        np.testing.assert_allclose(se3.angle_between(x.joint_quats, y.joint_quats), 0.0, atol=max(10 * atol, 1e-7))
    for x, y in zip(a.objects, b.objects, strict=True):
        np.testing.assert_allclose(x.positions, y.positions, atol=atol, rtol=0)
        np.testing.assert_allclose(se3.angle_between(x.quats, y.quats), 0.0, atol=max(10 * atol, 1e-7))
    for x, y in zip(a.contacts, b.contacts, strict=True):
        assert (x.person, x.object, x.part) == (y.person, y.object, y.part)
        np.testing.assert_array_equal(x.active, y.active)
        np.testing.assert_allclose(x.contact_points, y.contact_points, atol=atol, rtol=0)


# mirror


@LAWS
@given(seed=st.integers(0, 1000))
def test_mirroring_twice_is_the_identity_to_the_bit(seed):
    clip = random_clip(seed)
    twice = mirrored(mirrored(clip))
    for before, after in zip(clip.people, twice.people, strict=True):
        np.testing.assert_array_equal(before.joint_positions, after.joint_positions)
        # Normalized once more when the person is made.
        np.testing.assert_allclose(before.joint_quats, after.joint_quats, atol=1e-15, rtol=0)
    check_same(clip, twice)
    assert twice.source.augmentation == Augmentation()


@LAWS
@given(seed=st.integers(0, 1000))
def test_bones_are_the_mirror_images_of_the_other_sides(seed):
    """In its parent's frame each bone is where the other side's was, left for right."""
    clip = random_clip(seed)
    (before,), (after,) = clip.people, mirrored(clip).people
    for joint in ("left_knee", "right_wrist", "spine2", "left_thumb3"):
        parent = PARENT[joint]
        offsets = [
            se3.rotate_inverse(person.quat(up), person.position(down) - person.position(up))
            for person, down, up in ((before, joint, parent), (after, other(joint), other(parent)))
        ]
        np.testing.assert_allclose(offsets[1], offsets[0] * [-1.0, 1.0, 1.0], atol=1e-12)


@LAWS
@given(seed=st.integers(0, 1000))
def test_contact_points_are_mirrored_in_the_world_and_touched_by_the_other_side(seed):
    clip = random_clip(seed)
    reflected = mirrored(clip)
    for before, after in zip(clip.contacts, reflected.contacts, strict=True):
        assert after.part == other(before.part)
        np.testing.assert_array_equal(after.active, before.active)
        places = [
            (track.positions + se3.rotate(track.quats, contact.contact_points))[contact.active]
            for track, contact in ((clip.objects[0], before), (reflected.objects[0], after))
        ]
        np.testing.assert_allclose(places[1], places[0] * MIRROR, atol=1e-12)
        # What the reader does, the point is where the part is, still holds.
        on_part = reflected.objects[0].to_object(reflected.people[0].part_position(after.part))
        np.testing.assert_allclose(after.contact_points[after.active], on_part[after.active], atol=1e-12)


def test_an_upright_person_stays_upright_and_looks_the_mirrored_way():
    clip = make("carry_box", seconds=2.0)
    before, after = clip.people[0], mirrored(clip).people[0]
    for axis in ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]):  # up, forward
        directions = [se3.rotate(person.quat("pelvis"), np.array(axis)) for person in (before, after)]
        np.testing.assert_allclose(directions[1], directions[0] * MIRROR, atol=1e-12)
    assert after.height == pytest.approx(before.height)


def test_a_mirrored_mesh_is_the_mirror_image_with_its_faces_outwards(tmp_path):
    write_box(tmp_path, "box")
    mesh = tmp_path / "box" / "box.obj"
    clip = make("carry_box", seconds=1.0)
    geometry = ObjectGeometry(np.ones((1, 3)), mesh_path=mesh)
    (track,) = mirrored(replace(clip, objects=(replace(clip.objects[0], geometry=geometry),))).objects
    assert track.geometry.mesh_path is None
    before, after = surface_of(geometry), surface_of(track.geometry)
    np.testing.assert_allclose(after.vertices, before.vertices * MIRROR)
    normals = [
        np.cross(s.triangles[:, 1] - s.triangles[:, 0], s.triangles[:, 2] - s.triangles[:, 0]) for s in (before, after)
    ]
    np.testing.assert_allclose(normals[1], normals[0] * MIRROR, atol=1e-12)
    points = ObjectGeometry(np.array([[0.1, 0.2, 0.3]]))
    (track,) = mirrored(replace(clip, objects=(replace(clip.objects[0], geometry=points),))).objects
    np.testing.assert_array_equal(track.geometry.points, [[0.1, -0.2, 0.3]])
    gone = replace(clip.objects[0], geometry=ObjectGeometry(np.ones((1, 3)), mesh_path=Path("gone.obj")))
    with pytest.raises(GeometryError, match=r"gone\.obj"):
        mirrored(replace(clip, objects=(gone,)))


@pytest.mark.parametrize("name", list(ROBOTS))
def test_the_robot_does_in_the_mirror_what_it_does(name):
    """The robots are symmetric and the solver knows no side: sites agree to its tolerance."""
    model, clip = load_model(ROBOTS[name]), make("move_chair", seconds=2.0)
    motions = [retarget(item, model, Config(contact="landmark")) for item in (clip, mirrored(clip))]
    before, after = (model.forward(motion.qpos) for motion in motions)
    for site in model.site_names:
        if not site.startswith("mesh_") and other(site) in model.site_names:
            reflected = before.site_position(site) * MIRROR
            np.testing.assert_allclose(after.site_position(other(site)), reflected, atol=1e-4, err_msg=site)
    gaps = [motion.report.figures["contact_gap_m"] for motion in motions]
    assert gaps[1] == pytest.approx(gaps[0], abs=1e-5)


# speed


def test_the_same_speed_is_the_clip_itself():
    clip = random_clip()
    assert at_speed(clip, 1.0) is clip
    assert augment(clip, Augmentation()) is clip


@pytest.mark.parametrize("speed", [0.5, 0.8, 0.9])
def test_slower_and_back_is_close_to_the_identity(speed):
    clip = make("carry_box", seconds=4.0)
    back = at_speed(at_speed(clip, speed), 1.0 / speed)
    assert back.frames == clip.frames
    assert back.source.augmentation.speed == pytest.approx(1.0)
    for before, after in zip(clip.people, back.people, strict=True):
        np.testing.assert_allclose(after.joint_positions, before.joint_positions, atol=2e-3)
        assert np.degrees(se3.angle_between(after.joint_quats, before.joint_quats)).max() < 1.0
    for before, after in zip(clip.contacts, back.contacts, strict=True):
        assert np.sum(before.active != after.active) <= 2 * len(before.segments), "a frame at either end, at most"
        both = before.active & after.active
        np.testing.assert_allclose(after.contact_points[both], before.contact_points[both], atol=2e-3)


@LAWS
@given(speed=st.floats(0.3, 3.0))
def test_ends_stay_and_uniform_movement_stays_uniform(speed):
    clip = make("carry_box", seconds=2.0)
    line = np.arange(clip.frames)[:, None] * np.array([0.01, -0.02, 0.03])
    turning = se3.exp(np.arange(clip.frames)[:, None] * np.array([0.0, 0.0, 0.05]))
    (track,) = at_speed(
        replace(clip, objects=(replace(clip.objects[0], positions=line, quats=turning),)), speed
    ).objects
    np.testing.assert_allclose(track.positions[[0, -1]], line[[0, -1]], atol=1e-12)
    np.testing.assert_allclose(np.diff(track.positions, n=2, axis=0), 0.0, atol=1e-12)
    turns = se3.angle_between(track.quats[1:], track.quats[:-1])
    np.testing.assert_allclose(turns, turns.mean(), atol=1e-4)
    assert np.linalg.norm(track.positions[1] - track.positions[0]) == pytest.approx(
        speed * np.linalg.norm(line[1]), rel=0.5 / (len(track.positions) - 1) + 1e-9
    )


@LAWS
@given(speed=st.floats(0.3, 3.0), seed=st.integers(0, 100))
def test_contacts_keep_their_number_and_their_points(speed, seed):
    """Contacts far enough apart stay apart; fixed points stay fixed; none is lost, however short."""
    rng = np.random.default_rng(seed)
    clip = make("carry_box", seconds=2.0)
    active, points = np.zeros(clip.frames, dtype=bool), np.full((clip.frames, 3), np.nan)
    for start in (0, 20, 40):
        stop = start + int(rng.integers(1, 8))
        active[start:stop], points[start:stop] = True, rng.normal(size=3)
    track = ContactTrack(0, 0, "left_hand", active, points)
    (after,) = at_speed(replace(clip, contacts=(track,)), speed).contacts
    assert len(after.segments) == len(track.segments)
    for (first, stop), (new_first, new_stop) in zip(track.segments, after.segments, strict=True):
        np.testing.assert_allclose(
            after.contact_points[new_first:new_stop], np.tile(points[first], (new_stop - new_first, 1))
        )
        assert new_stop - new_first == pytest.approx((stop - first) / speed, abs=1.5)


@pytest.mark.parametrize("frame", [0, 7, 30, 52])
def test_a_contact_of_one_frame_that_falls_between_two_is_in_the_nearest_one(frame):
    clip = make("carry_box", seconds=2.0)
    active, points = np.zeros(clip.frames, dtype=bool), np.full((clip.frames, 3), np.nan)
    active[frame], points[frame] = True, (0.1, 0.2, 0.3)
    clip = replace(clip, contacts=(ContactTrack(0, 0, "left_hand", active, points),))
    for speed in (2.0, 2.5, 3.0):
        (after,) = at_speed(clip, speed).contacts
        ((first, stop),) = after.segments
        nearest = frame / (clip.frames - 1) * (len(after.active) - 1)
        assert stop - first == 1 and abs(first - nearest) <= 0.5 + 1e-9
        np.testing.assert_allclose(after.contact_points[first], points[frame])


def test_speeds_that_cannot_be():
    for speed in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ArgumentError, match="positive"):
            at_speed(random_clip(), speed)
    with pytest.raises(ClipError, match="3 of 12 frames"):
        at_speed(random_clip(frames=12), 5.0)


# both


@LAWS
@given(speed=st.floats(0.5, 2.0))
def test_mirror_and_speed_can_be_done_in_either_order(speed):
    clip = make("carry_box", seconds=1.0)
    check_same(mirrored(at_speed(clip, speed)), at_speed(mirrored(clip), speed), atol=1e-12)


def test_a_clip_tells_what_was_done_to_it():
    clip = augment(random_clip(), Augmentation(mirrored=True, speed=0.5))
    assert clip.source.augmentation == Augmentation(mirrored=True, speed=0.5)
    assert describe(clip.source.augmentation) == ("speed 0.5", "mirrored")
    assert describe(Augmentation()) == ()
    assert [note.split()[0] for note in clip.source.notes] == ["Played", "Mirrored"]
    assert clip.source.sha256 == random_clip().source.sha256, "its parent is still named"
    assert at_speed(clip, 2.0).source.augmentation == Augmentation(mirrored=True)


def test_a_rate_is_kept_from_the_first_frame_on():
    clip = make("carry_box")
    for rate in (20.0, 90.0):
        other = at_rate(clip, rate)
        assert abs((other.frames - 1) / rate - (clip.frames - 1) / clip.fps) <= 1.0 / rate
        back = at_rate(other, clip.fps)
        shared = min(back.frames, clip.frames)
        ours, theirs = (item.people[0].joint_positions[:shared] for item in (back, clip))
        np.testing.assert_allclose(ours, theirs, atol=0.01)
        np.testing.assert_allclose(ours[0], theirs[0], atol=1e-9)
    assert at_rate(clip, None) is at_rate(clip, clip.fps) is clip
    with pytest.raises(ArgumentError, match="--fps 5: recordings are resampled to 10 to 240"):
        ReadOptions(fps=5.0)
    with pytest.raises(ClipError, match="at 10 frames a second, 2 of 4 frames are left"):
        at_rate(cut(clip, 4), 10.0)
