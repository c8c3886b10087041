"""What a clip refuses, what it keeps, and the tree of joints it is about."""

from dataclasses import FrozenInstanceError, replace
from itertools import pairwise

import jaxtyping
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.errors import ClipError
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import HANDS, HEIGHT_OVER_CHAIN, JOINT_INDEX, JOINTS, PARENT, PARTS
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from synthetic import make

LAWS = settings(max_examples=50, deadline=None, derandomize=True, database=None)
FRAMES = 6


def person(frames: int = FRAMES, *, name: str = "ann", seed: int = 0) -> Person:
    rng = np.random.default_rng(seed)
    quats = se3.exp(rng.normal(size=(frames, len(JOINTS), 3)))
    return Person(name, rng.normal(size=(frames, len(JOINTS), 3)), quats)


def thing(frames: int = FRAMES, *, name: str = "box") -> ObjectTrack:
    rng = np.random.default_rng(1)
    return ObjectTrack(
        name, rng.normal(size=(frames, 3)), se3.exp(rng.normal(size=(frames, 3))), ObjectGeometry(np.eye(3))
    )


def contact(frames: int = FRAMES, **changes: object) -> ContactTrack:
    values = {"person": 0, "object": 0, "part": "left_hand", "active": np.ones(frames, dtype=bool)}
    values |= {"contact_points": np.zeros((frames, 3))} | changes
    return ContactTrack(**values)  # pyright: ignore[reportArgumentType]


def clip(**changes: object) -> Clip:
    values = {"name": "scene", "fps": 30.0, "people": (person(),), "objects": (thing(),), "contacts": (contact(),)}
    return Clip(**(values | changes))  # pyright: ignore[reportArgumentType]


@pytest.fixture
def uninstrumented():
    """Leave out the run-time annotations of the tests, which would refuse a shape before the package does."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


def with_value(array: np.ndarray, index: object, value: object) -> np.ndarray:
    """Return a writable copy with one part replaced."""
    changed = array.copy()
    changed[index] = value
    return changed


# What is refused


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_refused_with_owner_and_frame(bad):
    good, track = person(), thing()
    with pytest.raises(ClipError, match=r"person 'ann': joint_positions is not finite in 1 frame \(4\)"):
        replace(good, joint_positions=with_value(good.joint_positions, (4, 7, 1), bad))
    with pytest.raises(ClipError, match=r"person 'ann': joint_quats is not finite in 1 frame \(2\)"):
        replace(good, joint_quats=with_value(good.joint_quats, (2, 51, 3), bad))
    with pytest.raises(ClipError, match=r"object 'box': positions is not finite in 2 frames \(0, 5\)"):
        replace(track, positions=with_value(track.positions, ([0, 5], 2), bad))
    with pytest.raises(ClipError, match=r"object 'box': quats is not finite in 1 frame \(5\)"):
        replace(track, quats=with_value(track.quats, (5, 0), bad))
    with pytest.raises(ClipError, match=r"object geometry: points is not finite in 1 frame \(1\)"):
        ObjectGeometry(with_value(np.eye(3), (1, 1), bad))
    with pytest.raises(ClipError, match=r"contact of 'left_hand': active without a point in 1 frame \(3\)"):
        contact(contact_points=with_value(np.zeros((FRAMES, 3)), (3, 0), bad))


def test_many_bad_frames_are_counted_and_the_first_named():
    track = thing(40)
    with pytest.raises(ClipError, match=r"35 frames \(5, 6, 7, 8, 9, \.\.\.\)"):
        replace(track, positions=with_value(track.positions, slice(5, None), np.nan))


@pytest.mark.parametrize("length", [0.0, 0.985, 1.015, 2.0])
def test_rotations_far_from_unit_length_are_refused(length):
    good, track = person(), thing()
    with pytest.raises(ClipError, match=r"person 'ann': joint_quats are not unit quaternions in 1 frame \(3\)"):
        replace(good, joint_quats=with_value(good.joint_quats, (3, 9), length * good.joint_quats[3, 9]))
    with pytest.raises(ClipError, match=r"object 'box': quats are not unit quaternions in 1 frame \(1\)"):
        replace(track, quats=with_value(track.quats, 1, length * track.quats[1]))


@pytest.mark.parametrize("length", [0.995, 1.005])
def test_rotations_a_little_off_are_rounding_and_become_unit(length):
    good = person()
    mended = replace(good, joint_quats=length * good.joint_quats)
    np.testing.assert_allclose(mended.joint_quats, good.joint_quats, atol=1e-12)


@pytest.mark.parametrize(
    ("make_bad", "message"),
    [
        (lambda: Person("ann", np.zeros((4, 51, 3)), np.zeros((4, 52, 4))), "'ann'.*joint_positions.*shape.*4, 52, 3"),
        (lambda: replace(person(), joint_quats=np.zeros((FRAMES, 52, 3))), "'ann'.*joint_quats.*shape.*6, 52, 4"),
        (lambda: replace(person(), joint_quats=person(5).joint_quats), "'ann'.*joint_quats.*shape.*6, 52, 4"),
        (lambda: replace(thing(), positions=np.zeros((FRAMES, 2))), "'box'.*positions.*shape.*6, 3"),
        (lambda: replace(thing(), quats=thing(5).quats), "'box'.*quats.*shape.*6, 4"),
        (lambda: ObjectGeometry(np.zeros((5, 2))), "geometry.*points.*shape.*5, 3"),
        (lambda: ObjectGeometry(np.zeros((0, 3))), "geometry.*no points"),
        (lambda: contact(part="left_ear"), "'left_ear': no such part.*left_hand, right_hand, left_foot, right_foot"),
        (lambda: contact(contact_points=np.zeros((FRAMES, 2))), "'left_hand'.*contact_points.*shape.*6, 3"),
        (lambda: clip(fps=0.0), "'scene'.*0.0 frames a second.*1 to 1000"),
        (lambda: clip(fps=-30.0), "'scene'.*1 to 1000"),
        (lambda: clip(fps=float("nan")), "'scene'.*1 to 1000"),
        (lambda: clip(fps=float("inf")), "'scene'.*1 to 1000"),
        (lambda: clip(people=(), contacts=()), "'scene'.*no person"),
        (lambda: clip(objects=(thing(7),)), "'scene'.*differ.*person 'ann': 6.*object 'box': 7"),
        (lambda: clip(people=(person(), person(7, name="bob"))), "'scene'.*differ.*'bob': 7"),
        (lambda: clip(contacts=(contact(5),)), "'scene'.*differ.*contact of 'left_hand': 5"),
        (lambda: clip(contacts=(contact(person=1),)), "'scene'.*'left_hand' names an absent person or object"),
        (lambda: clip(contacts=(contact(person=-1),)), "'scene'.*absent"),
        (lambda: clip(contacts=(contact(object=1),)), "'scene'.*absent"),
        (lambda: clip(contacts=(contact(object=-1),)), "'scene'.*absent"),
        (lambda: clip(objects=()), "'scene'.*absent"),
    ],
)
@pytest.mark.usefixtures("uninstrumented")
def test_what_does_not_fit_is_refused_by_name(make_bad, message):
    with pytest.raises(ClipError, match=f"(?s){message}"):
        make_bad()


@pytest.mark.parametrize("frames", [0, 1, 2, 3])
def test_fewer_than_four_frames_are_refused(frames):
    with pytest.raises(ClipError, match=f"'scene': {frames} usable.*at least 4"):
        clip(people=(person(frames),), objects=(thing(frames),), contacts=())


def test_four_frames_suffice_and_neither_object_nor_contact_is_needed():
    assert clip(people=(person(4),), objects=(), contacts=()).frames == 4


# What is kept


def test_all_arrays_are_read_only_copies():
    positions, quats = person().joint_positions.copy(), person().joint_quats.copy()
    active, points, vertices = np.ones(FRAMES, dtype=bool), np.zeros((FRAMES, 3)), np.eye(3)
    places, turns = thing().positions.copy(), thing().quats.copy()
    ann, geometry = Person("ann", positions, quats), ObjectGeometry(vertices)
    box, touch = ObjectTrack("box", places, turns, geometry), contact(active=active, contact_points=points)
    kept = {
        "joint_positions": (ann.joint_positions, positions),
        "joint_quats": (ann.joint_quats, quats),
        "points": (geometry.points, vertices),
        "positions": (box.positions, places),
        "quats": (box.quats, turns),
        "active": (touch.active, active),
        "contact_points": (touch.contact_points, points),
    }
    for name, (inside, given_array) in kept.items():
        before = inside.copy()
        given_array[...] = ~given_array if given_array.dtype == bool else 1.0 + 2.0 * given_array
        np.testing.assert_array_equal(inside, before, err_msg=name)
        with pytest.raises(ValueError, match="read-only"):
            inside[0] = 0
    with pytest.raises(FrozenInstanceError):
        ann.name = "bob"  # pyright: ignore[reportAttributeAccessIssue]


def test_points_of_inactive_frames_are_dropped():
    active = np.array([True, False, True, False, False, True])
    touch = contact(active=active, contact_points=np.full((FRAMES, 3), 7.0))
    assert np.isnan(touch.contact_points[~active]).all()
    np.testing.assert_array_equal(touch.contact_points[active], 7.0)


@LAWS
@given(active=st.lists(st.booleans(), min_size=1, max_size=40))
def test_segments_are_the_maximal_runs(active):
    flags = np.array(active)
    segments = contact(len(flags), active=flags).segments
    rebuilt = np.zeros(len(flags), dtype=bool)
    for first, stop in segments:
        assert first < stop
        assert not rebuilt[first:stop].any()
        rebuilt[first:stop] = True
    np.testing.assert_array_equal(rebuilt, flags)
    assert all(stop < first for (_, stop), (first, _) in pairwise(segments)), "runs are maximal"


@LAWS
@given(seed=st.integers(0, 1000), size=st.floats(0.5, 2.0))
def test_height_scales_with_the_person_and_no_movement_changes_it(seed, size):
    ann = person(seed=seed)
    turn = se3.exp(np.random.default_rng(seed).normal(size=3))
    moved = size * se3.rotate(turn, ann.joint_positions) + np.array([1.0, 2.0, 3.0])
    assert replace(ann, joint_positions=moved).height == pytest.approx(size * ann.height)


def test_height_is_the_chain_of_the_legs_mean_and_the_trunk():
    """Joints of the chain on a staircase: the sum of its bones is known. The right leg is 6 long, the left one 4."""
    chain = ["left_ankle", "left_knee", "left_hip", "pelvis", "spine1", "spine2", "spine3", "neck", "head"]
    positions = np.full((4, len(JOINTS), 3), 99.0)
    for step, joint in enumerate(chain):
        positions[:, JOINT_INDEX[joint]] = [0.0, 0.0, step**2]
    for side, length in (("hip", 0.0), ("knee", 3.0), ("ankle", 6.0)):
        positions[:, JOINT_INDEX[f"right_{side}"]] = [0.0, length, 0.0]
    # All steps but the one from hip to pelvis, which is no bone of the chain.
    expected = HEIGHT_OVER_CHAIN * (8**2 - 3**2 + (2**2 + 6) / 2)
    assert replace(person(4), joint_positions=positions).height == pytest.approx(expected)


def test_height_of_synthetic_people_is_what_was_asked_for():
    for height in (1.5, 1.75, 1.95):
        assert make("carry_box", height=height, seconds=1.0).people[0].height == pytest.approx(height, abs=0.01)


@pytest.mark.parametrize("side", ["left", "right"])
def test_hands_are_between_wrist_and_middle_finger_and_feet_at_the_ankle(side):
    ann = person()
    hand = 0.5 * (ann.position(f"{side}_wrist") + ann.position(f"{side}_middle3"))
    np.testing.assert_allclose(ann.part_position(f"{side}_hand"), hand, atol=1e-15)
    np.testing.assert_array_equal(ann.part_quat(f"{side}_hand"), ann.quat(f"{side}_wrist"))
    np.testing.assert_array_equal(ann.part_position(f"{side}_foot"), ann.position(f"{side}_ankle"))
    np.testing.assert_array_equal(ann.part_quat(f"{side}_foot"), ann.quat(f"{side}_ankle"))


def test_positions_and_rotations_are_looked_up_by_the_order_of_joints():
    ann = person()
    for index, joint in enumerate(JOINTS):
        np.testing.assert_array_equal(ann.position(joint), ann.joint_positions[:, index])
        np.testing.assert_array_equal(ann.quat(joint), ann.joint_quats[:, index])


def test_points_in_the_objects_frame_lead_back_to_the_world():
    track, rng = thing(), np.random.default_rng(3)
    points = rng.normal(size=(FRAMES, 3))
    inside = track.to_object(points)
    matrices = se3.quat_to_matrix(track.quats)
    np.testing.assert_allclose(np.einsum("tij,tj->ti", matrices, inside) + track.positions, points, atol=1e-12)


# The skeleton


def test_joints_are_a_tree_rooted_at_the_pelvis_with_parents_first():
    assert len(JOINTS) == len(set(JOINTS)) == 52
    assert set(PARENT) == set(JOINTS)
    assert [joint for joint, parent in PARENT.items() if parent is None] == ["pelvis"]
    for joint, parent in PARENT.items():
        if parent is not None:
            assert JOINT_INDEX[parent] < JOINT_INDEX[joint]
    assert all(JOINTS[index] == joint for joint, index in JOINT_INDEX.items())


def test_the_tree_is_mirror_symmetric():
    def mirror(name: str | None) -> str | None:
        if name is None or "_" not in name:
            return name
        side, rest = name.split("_", 1)
        return f"{ {'left': 'right', 'right': 'left'}[side] }_{rest}"

    for joint, parent in PARENT.items():
        mirrored = mirror(joint)
        assert mirrored is not None
        assert PARENT[mirrored] == mirror(parent)


def test_every_finger_hangs_on_its_own_wrist_in_three_bones():
    for joint in JOINTS[22:]:
        side, bone = joint.split("_")
        steps, at = 0, joint
        while at != f"{side}_wrist":
            parent = PARENT[at]
            assert parent is not None
            steps, at = steps + 1, parent
        assert steps == int(bone[-1])


def test_parts_name_joints_that_exist():
    for name, part in PARTS.items():
        assert part.name == name
        assert {*part.point_joints, part.rotation_joint, *part.label_joints} <= set(JOINTS)
        assert all(joint.startswith(name.split("_")[0]) for joint in part.label_joints)
    assert all(len(PARTS[hand].label_joints) == 15 for hand in HANDS)


def test_the_lowest_point_is_the_lowest_of_all_however_many_frames_are_looked_at_at_once(monkeypatch):
    track = make("carry_box", seconds=2.0).objects[0]
    turned = replace(track, quats=se3.exp(np.linspace([0.0, 0.0, 0.1], [1.0, -2.0, 0.5], len(track.quats))))
    points = se3.rotate(turned.quats[:, None], track.geometry.points[None]) + track.positions[:, None]
    for block in (1, 100, 1_000_000):
        monkeypatch.setattr("hoi_retarget.objects.track._BLOCK", block)
        np.testing.assert_allclose(turned.lowest, points[..., 2].min(axis=1), atol=1e-12)
