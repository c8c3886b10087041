"""The laws that make synthetic clips a ground truth: bones, contacts, stance, objects, time."""

import functools

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import ArgumentError
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, PARENT
from hoi_retarget.human.t_pose import rest_offsets
from hoi_retarget.numerics import se3
from synthetic import OBJECTS, SCENES, make
from synthetic.object_shapes import shape

FAST_SETTINGS = settings(
    max_examples=2, deadline=None, phases=(Phase.explicit, Phase.generate), derandomize=True, database=None
)


@functools.cache
def cycle(name: str, height: float = 1.75, seed: int = 0) -> Clip:
    return make(name, height=height, seed=seed, repetitions=1)


every_scene = pytest.mark.parametrize("name", list(SCENES))


def lowest_points(clip: Clip, index: int) -> np.ndarray:
    track = clip.objects[index]
    heights = [
        track.positions[:, 2] + se3.rotate(track.quats, np.broadcast_to(point, track.positions.shape))[:, 2]
        for point in track.geometry.points
    ]
    return np.min(heights, axis=0)


def held(clip: Clip, index: int) -> np.ndarray:
    return np.any([track.active for track in clip.contacts if track.object == index], axis=0)


def planted(person: Person, side: str) -> np.ndarray:
    """Frames from each to the next in which the whole foot stays where it is."""
    moves = [np.abs(np.diff(person.position(f"{side}_{joint}"), axis=0)).max(axis=1) for joint in ("ankle", "foot")]
    return np.max(moves, axis=0) < 1e-9


def check_bones(person: Person, height: float) -> None:
    offsets = rest_offsets(height)
    for joint in JOINTS[1:]:
        parent, offset = PARENT[joint], offsets[JOINT_INDEX[joint]]
        assert parent is not None
        bone = person.position(joint) - person.position(parent)
        assert np.abs(np.linalg.norm(bone, axis=1) - np.linalg.norm(offset)).max() < 1e-9
        carried = se3.rotate(person.quat(parent), np.broadcast_to(offset, bone.shape))
        assert np.abs(carried - bone).max() < 1e-9, joint


def check_contacts(clip: Clip) -> None:
    for track in clip.contacts:
        person, thing = clip.people[track.person], clip.objects[track.object]
        points = thing.to_object(person.part_position(track.part))
        assert len(track.segments) == 2
        for first, end in track.segments:
            assert np.abs(points[first:end] - track.contact_points[first:end]).max() < 1e-9
            assert np.abs(np.diff(track.contact_points[first:end], axis=0)).max() == 0.0


def check_motion(clip: Clip) -> None:
    for person in clip.people:
        turn = se3.angle_between(person.joint_quats[1:], person.joint_quats[:-1])
        assert np.degrees(turn).max() < 25.0
        speed = np.linalg.norm(np.diff(person.joint_positions, axis=0), axis=2) * clip.fps
        assert speed[:, [JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"]]].max() < 3.0
        assert speed[:, JOINT_INDEX["head"]].max() < 2.0
        assert person.joint_positions[..., 2].min() > 0.0
        up = se3.rotate(person.quat("head"), np.broadcast_to([0.0, 1.0, 0.0], (clip.frames, 3)))[:, 2]
        assert np.degrees(np.arccos(up)).max() < 60.0


def check_stance(person: Person, height: float) -> None:
    stands = {side: planted(person, side) for side in ("left", "right")}
    assert (stands["left"] | stands["right"]).all()
    for side, still in stands.items():
        toe, ankle = person.position(f"{side}_foot"), person.position(f"{side}_ankle")
        scale = height / 1.75
        assert np.abs(toe[:-1][still, 2] - 0.025 * scale).max() < 0.002
        assert np.abs(ankle[:-1][still, 2] - 0.083 * scale).max() < 0.002


def check_objects(clip: Clip) -> None:
    for index, track in enumerate(clip.objects):
        lowest = lowest_points(clip, index)
        free = ~held(clip, index)
        assert lowest.min() > -1e-9
        assert np.abs(lowest[free]).max() < 1e-9
        still = free[1:] & free[:-1]
        assert np.abs(np.diff(track.positions, axis=0)[still]).max() < 1e-9
        acceleration = np.diff(track.positions, n=2, axis=0) * clip.fps**2
        assert np.abs(acceleration).max() < 8.0


def heights_of(name: str, height: float) -> tuple[float, ...]:
    return (height, 0.96 * height) if name == "carry_table" else (height,)


@every_scene
@FAST_SETTINGS
@given(height=st.floats(1.2, 2.2), seed=st.integers(0, 1000))
def test_laws_hold_for_all_heights_and_seeds(name: str, height: float, seed: int) -> None:
    clip = make(name, height=height, seed=seed, repetitions=1)
    assert len(clip.people) == len(heights_of(name, height))
    for person, tall in zip(clip.people, heights_of(name, height), strict=True):
        assert abs(person.height - tall) < 0.01
        check_bones(person, tall)
        check_stance(person, tall)
    check_contacts(clip)
    check_motion(clip)
    check_objects(clip)


@every_scene
def test_default_clip_goes_one_way_and_rests_at_its_end(name: str) -> None:
    clip = make(name)
    assert clip.fps == 30.0
    assert 150 <= clip.frames <= 290
    assert clip.source.format == "synthetic"
    assert clip.source.licence.startswith("Apache-2.0")
    for person in clip.people:
        assert np.linalg.norm(np.diff(person.joint_positions[-3:], axis=0), axis=2).max() < 0.01
        assert abs(person.height - 1.75) < 0.01 or len(clip.people) == 2
    assert all(len(track.segments) == 1 for track in clip.contacts)
    hands = {"drag_suitcase": 1, "carry_table": 4}.get(name, 2)
    assert len(clip.contacts) == hands


@every_scene
def test_contact_points_are_palm_clearance_outside_the_surface(name: str) -> None:
    clip = make(name)
    for track in clip.contacts:
        point = track.contact_points[np.flatnonzero(track.active)[0]]
        blocks = clip.objects[track.object].geometry.points.reshape(-1, 8, 3)
        low, high = blocks.min(axis=1), blocks.max(axis=1)
        outside = np.linalg.norm(np.maximum(np.maximum(low - point, point - high), 0.0), axis=1)
        assert abs(outside.min() - 0.025) < 1e-3


@every_scene
def test_palm_faces_the_surface_it_touches(name: str) -> None:
    clip = make(name)
    for track in clip.contacts:
        person, thing = clip.people[track.person], clip.objects[track.object]
        frame = track.segments[0][0]
        palm_world = se3.rotate(person.part_quat(track.part)[frame], np.array([0.0, -1.0, 0.0]))
        palm = se3.rotate_inverse(thing.quats[frame], palm_world)
        point = track.contact_points[frame]
        blocks = thing.geometry.points.reshape(-1, 8, 3)
        nearest = np.clip(point, blocks.min(axis=1), blocks.max(axis=1))
        toward = nearest[np.argmin(np.linalg.norm(nearest - point, axis=1))] - point
        assert palm @ toward / np.linalg.norm(toward) > 0.9


@every_scene
def test_a_cycle_ends_where_it_begins(name: str) -> None:
    once, twice = cycle(name), make(name, repetitions=2)
    assert twice.frames == 2 * once.frames
    for person, both in zip(once.people, twice.people, strict=True):
        seam = both.joint_positions[once.frames - 1 : once.frames + 1]
        assert np.linalg.norm(np.diff(seam, axis=0), axis=2).max() < 1e-3
        assert np.abs(both.joint_positions[once.frames :] - person.joint_positions).max() < 1e-9
        turn = se3.angle_between(both.joint_quats[1:], both.joint_quats[:-1])
        assert np.degrees(turn).max() < 25.0
    for track, both in zip(once.objects, twice.objects, strict=True):
        assert np.abs(both.positions[once.frames :] - track.positions).max() < 1e-9
        assert np.abs(track.positions[-1] - track.positions[0]).max() < 1e-9


@every_scene
def test_the_motion_does_not_depend_on_the_rate(name: str) -> None:
    slow, fast = make(name, fps=30.0), make(name, fps=60.0)
    for person, other in zip(slow.people, fast.people, strict=True):
        assert np.abs(person.joint_positions - other.joint_positions[::2]).max() < 1e-9
        assert se3.angle_between(person.joint_quats, other.joint_quats[::2]).max() < 1e-6
    for track, other in zip(slow.contacts, fast.contacts, strict=True):
        assert np.array_equal(track.active, other.active[::2])


@every_scene
def test_accelerations_do_not_jump(name: str) -> None:
    # With continuous accelerations, halving the time step halves their largest change; a jump would stay.
    changes = []
    for fps in (120.0, 240.0):
        positions = make(name, fps=fps).people[0].joint_positions
        changes.append(np.abs(np.diff(positions, n=3, axis=0)).max() * fps**2)
    assert changes[1] < 0.7 * changes[0]


@every_scene
def test_stance_feet_satisfy_the_stance_rule_and_swinging_ones_do_not(name: str) -> None:
    clip = cycle(name)
    for person in clip.people:
        for side in ("left", "right"):
            toe = person.position(f"{side}_foot")
            speed = np.linalg.norm(np.diff(toe, axis=0), axis=1) * clip.fps
            rule = (speed < 0.30) & (toe[1:, 2] < 0.10)
            still = planted(person, side)
            assert rule[still].all()
            assert 0.4 < rule.mean() < 0.97


@every_scene
def test_the_seed_decides_everything(name: str) -> None:
    first, again, other = make(name, seed=3), make(name, seed=3), make(name, seed=4)
    assert np.array_equal(first.people[0].joint_positions, again.people[0].joint_positions)
    assert first.source.sha256 == again.source.sha256 != other.source.sha256
    assert not np.array_equal(first.objects[0].geometry.points, other.objects[0].geometry.points)


def test_seconds_set_the_duration() -> None:
    clip = make("push_table", seconds=40.0, fps=25.0)
    assert clip.frames == 1001
    assert np.array_equal(
        make("push_table", seconds=2.0).objects[0].positions, make("push_table").objects[0].positions[:61]
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"name": "juggle"}, "carry_box, push_table"),
        ({"height": 1.19}, "1.2"),
        ({"height": 2.21}, "2.2"),
        ({"height": float("nan")}, "height"),
        ({"fps": 0.0}, "positive"),
        ({"fps": float("inf")}, "positive"),
        ({"seed": -1}, "negative"),
        ({"seconds": 0.0}, "positive"),
        ({"seconds": 0.05}, "frames"),
        ({"repetitions": 0}, "at least one"),
        ({"seconds": 1.0, "repetitions": 1}, "Both"),
    ],
)
def test_bad_arguments_are_refused(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        make(**{"name": "carry_box", **arguments})  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("thing", OBJECTS)
def test_objects_are_closed_boxes_about_the_origin(thing: str) -> None:
    vertices, faces = shape(thing).mesh
    assert np.abs(vertices.min(axis=0) + vertices.max(axis=0)).max() < 1e-12
    # Closed boxes with outward faces: the volume is positive and the signed volumes add up.
    triangles = vertices[faces]
    signed = np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).reshape(-1, 12)
    assert (signed.sum(axis=1) > 0.0).all()


@every_scene
def test_object_meshes_are_those_of_the_clips(name: str) -> None:
    clip = make(name, height=1.6, seed=5)
    for track in clip.objects:
        vertices, _ = shape(track.name, height=1.6, seed=5).mesh
        assert np.abs(track.geometry.points - vertices).max() < 1e-12


def test_unknown_objects_are_refused() -> None:
    with pytest.raises(ArgumentError, match="suitcase"):
        shape("sofa")
