"""Contacts from geometry: against exactly known ones, and the laws that hold for any clip."""

from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from hoi_retarget.clip import label_contacts as contact_labels
from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.clip.label_contacts import FAR, PROXIMITY, Proximity, label_contacts, part_object_distances, touching
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError
from hoi_retarget.human.capsules import PART_CAPSULES, spheres
from hoi_retarget.human.skeleton import FEET, HANDS, PARTS
from hoi_retarget.human.skinned_mesh import vertices_of
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers import read_clip
from hoi_retarget.readers.body_parameters import BodyParameters, person_of
from source_people import parameters_of, write_models
from synthetic import make

FAST = settings(max_examples=4, deadline=None, derandomize=True, database=None)
SHARED = Path(__file__).resolve().parents[1].parent / "shared" / "data"
FPS = 15.0
SLOW_CLOSING = 3  # Frames.


@cache
def clip() -> Clip:
    return make("carry_box", fps=FPS)


@cache
def labels(**rule: float) -> dict[str, np.ndarray]:
    return flags(label_contacts(clip(), rule=Proximity(**rule)))


def flags(tracks: tuple[ContactTrack, ...]) -> dict[str, np.ndarray]:
    return {track.part: track.active for track in tracks}


def moved(source: Clip, turn: float, shift: np.ndarray) -> Clip:
    """The whole recording, turned about the vertical and moved."""
    quat = se3.exp(np.array([0.0, 0.0, turn]))
    people = tuple(
        replace(
            person,
            joint_positions=se3.rotate(quat, person.joint_positions) + shift,
            joint_quats=se3.quat_multiply(quat, person.joint_quats),
        )
        for person in source.people
    )
    objects = tuple(
        replace(track, positions=se3.rotate(quat, track.positions) + shift, quats=se3.quat_multiply(quat, track.quats))
        for track in source.objects
    )
    return replace(source, people=people, objects=objects)


def reversed_(source: Clip) -> Clip:
    people = tuple(
        replace(person, joint_positions=person.joint_positions[::-1], joint_quats=person.joint_quats[::-1])
        for person in source.people
    )
    objects = tuple(
        replace(track, positions=track.positions[::-1], quats=track.quats[::-1]) for track in source.objects
    )
    return replace(source, people=people, objects=objects, contacts=())


# The truth


@pytest.mark.parametrize("name", ["carry_box", "push_table"])
def test_labels_are_the_known_contacts_within_some_frames(name):
    source = make(name, fps=FPS)
    found = {(track.person, track.object, track.part): track for track in label_contacts(source)}
    assert len(found) == len(source.people) * len(source.objects) * len(PARTS)
    for known in source.contacts:
        track = found.pop((known.person, known.object, known.part))
        # Synthetic hands close over a third of a second and slow down over the last centimetres: surfaces are near
        # some frames before a hand holds, and some after.
        for (first, stop), (own_first, own_stop) in zip(known.segments, track.segments, strict=True):
            assert abs(first - own_first) <= SLOW_CLOSING
            assert abs(stop - own_stop) <= SLOW_CLOSING
        both = known.active & track.active
        np.testing.assert_allclose(track.contact_points[both], known.contact_points[both], atol=1e-3)
    for track in found.values():
        assert not track.active.any(), f"{track.part} touches nothing"


def test_points_are_the_parts_own_or_the_objects_nearest():
    own, surface = label_contacts(clip()), label_contacts(clip(), points="surface")
    mesh = surface_of(clip().objects[0].geometry)
    person, track = clip().people[0], clip().objects[0]
    for part, on_object in zip(own, surface, strict=True):
        np.testing.assert_array_equal(part.active, on_object.active)
        expected = track.to_object(person.part_position(part.part))[part.active]
        np.testing.assert_allclose(part.contact_points[part.active], expected, atol=1e-12)
        if on_object.active.any():
            assert mesh.distances(on_object.contact_points[on_object.active]).max() < 1e-9


def plate() -> ObjectGeometry:
    """A plate that is wide enough for its edges not to matter."""
    corners = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.2, 0.2) for z in (-0.02, 0.02)])
    return ObjectGeometry(corners, faces=ConvexHull(corners).simplices)


def descending(speed: float = 0.3, *, through: bool = False) -> Clip:
    """A frozen person who comes down on a raised plate with the left hand's lowest point, and goes up again or on."""
    source = clip()
    person = source.people[0]
    down = np.arange(20.0, -20.0, -1.0)
    steps = (down if through else np.abs(down))[:, None] * speed / FPS
    still = np.repeat(person.joint_positions[:1], len(steps), axis=0)
    frozen = replace(person, joint_positions=still, joint_quats=np.repeat(person.joint_quats[:1], len(steps), axis=0))
    balls = spheres(frozen, PART_CAPSULES["left_hand"])
    bottom = (balls.middles[0, :, 2] - balls.radii).argmin()
    # The plate's upper side is where the hand's lowest point is in the middle of the clip.
    place = balls.middles[0, bottom] - [0.0, 0.0, balls.radii[bottom] + 0.02]
    still = still + steps[:, None] * [0.0, 0.0, 1.0]
    quats = np.tile(se3.IDENTITY_QUAT, (len(steps), 1))
    track = ObjectTrack("plate", np.tile(place, (len(steps), 1)), quats, plate())
    return replace(source, people=(replace(frozen, joint_positions=still),), objects=(track,), contacts=())


@pytest.mark.parametrize("touch", [0.005, 0.01, 0.03])
def test_a_hand_that_comes_down_on_a_plate_touches_exactly_while_it_is_near(touch):
    speed = 0.06
    active = flags(label_contacts(descending(speed), rule=Proximity(touch=touch, release=touch)))["left_hand"]
    heights = np.abs(np.arange(20, -20, -1)) * speed / FPS
    clear = np.abs(heights - touch) > 1e-9  # At the threshold itself rounding decides.
    np.testing.assert_array_equal(active[clear], (heights < touch)[clear])


# Distances


def soup() -> ObjectGeometry:
    """Triangles of all sizes about where the box is."""
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(60, 1, 3)) * 0.25 + 10.0 ** rng.uniform(-2.5, -0.5, (60, 1, 1)) * rng.normal(
        size=(60, 3, 3)
    )
    return ObjectGeometry(corners.reshape(-1, 3), faces=np.arange(180).reshape(-1, 3))


@pytest.mark.parametrize("other", [None, soup()])
def test_distances_are_those_of_all_spheres_to_all_triangles(other):
    person, track = clip().people[0], clip().objects[0]
    track = track if other is None else replace(track, geometry=other)
    mesh = surface_of(track.geometry)
    frames = np.arange(0, clip().frames, 3)
    for item in part_object_distances(replace(clip(), objects=(track,))):
        balls = spheres(person, PART_CAPSULES[item.part])
        middles = se3.rotate_inverse(track.quats[:, None], balls.middles - track.positions[:, None])[frames]
        naive = (mesh.distances(middles.reshape(-1, 3)).reshape(len(frames), -1) - balls.radii).min(axis=1)
        expected = np.where(naive <= FAR, naive, np.inf)
        np.testing.assert_allclose(item.distances[frames], expected, atol=1e-9)


def test_nearest_points_are_known_where_distances_are_and_lie_on_the_surface():
    high, surface = 0.5 * np.ptp(plate().points, axis=0), surface_of(plate())
    for item in part_object_distances(descending()):
        known = np.isfinite(item.distances)
        np.testing.assert_array_equal(known, np.isfinite(item.contact_points).all(axis=1))
        np.testing.assert_allclose(surface.distances(item.contact_points[known]), 0.0, atol=1e-9)
        if item.part == "left_hand":
            assert (item.contact_points[known, 2] > high[2] - 1e-9).any()


# Laws


@FAST
@given(turn=st.floats(-3.0, 3.0), shift=st.tuples(*3 * [st.floats(-5.0, 5.0)]))
def test_a_clip_moved_as_a_whole_has_the_same_labels(turn, shift):
    for part, active in flags(label_contacts(moved(clip(), turn, np.array(shift)))).items():
        np.testing.assert_array_equal(active, labels()[part])


def test_a_clip_backwards_has_the_same_labels_backwards():
    for part, active in flags(label_contacts(reversed_(clip()))).items():
        np.testing.assert_array_equal(active[::-1], labels()[part])


def test_wider_thresholds_never_end_a_contact():
    widths = [{"touch": touch, "release": touch + 0.005} for touch in (0.001, 0.005, 0.01, 0.02, 0.05, 0.09)]
    for narrow, wide in pairwise(widths):
        for part, active in labels(**narrow).items():
            assert not (active & ~labels(**wide)[part]).any()
    assert sum(active.sum() for active in labels(**widths[-1]).values()) > sum(a.sum() for a in labels().values())


@FAST
@given(seed=st.integers(0, 10_000), gap=st.floats(0.0, 0.5), shortest=st.floats(0.0, 0.5))
def test_no_gap_and_no_contact_is_shorter_than_asked_for(seed, gap, shortest):
    rng = np.random.default_rng(seed)
    item = part_object_distances(clip())[0]
    # Distances that flicker; the speed limit is out of the way.
    noisy = replace(item, distances=rng.choice([0.0, 0.012, 0.05], size=clip().frames, p=[0.3, 0.3, 0.4]))
    rule = Proximity(gap=gap, shortest=shortest, speed=1e6)
    (active,) = touching(clip(), [noisy], rule)
    inside = [(first, stop) for first, stop in runs(active) if first > 0 and stop < len(active)]
    assert all(stop - first >= np.floor(shortest * FPS) for first, stop in inside)
    if shortest == 0:
        between = [(first, stop) for first, stop in runs(~active) if first > 0 and stop < len(active)]
        assert all(stop - first > np.floor(gap * FPS + 1e-6) for first, stop in between)
    (bare,) = touching(clip(), [noisy], Proximity(gap=0.0, shortest=0.0, speed=1e6))
    for first, stop in runs(bare):
        assert (noisy.distances[first:stop] < rule.touch).any(), "hysteresis begins with a touch"


@pytest.mark.parametrize(("pause", "closed"), [(1, True), (3, True), (4, False)])
def test_interruptions_up_to_the_gap_are_closed(pause, closed):
    item = part_object_distances(clip())[0]
    away = np.zeros(clip().frames)
    away[10 : 10 + pause] = 0.05
    rule = Proximity(gap=3 / FPS, speed=1e6)
    (active,) = touching(clip(), [replace(item, distances=away)], rule)
    assert active[10 : 10 + pause].all() == closed
    assert active[:10].all() and active[10 + pause :].all()


def test_a_hand_that_passes_by_fast_does_not_touch():
    for speed, expected in ((0.3, True), (3.0, False)):
        source = descending(speed, through=True)
        near = [item for item in part_object_distances(source) if item.part == "left_hand"]
        assert near[0].distances.min() < PROXIMITY.touch
        assert touching(source, near)[0].any() == expected


def test_one_thin_triangle_is_an_object_like_others():
    corners = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 1e-3, 0.0]])
    sliver = ObjectGeometry(corners, faces=np.array([[0, 1, 2]]))
    (track,) = clip().objects
    other = replace(clip(), objects=(replace(track, geometry=sliver),), contacts=())
    assert len(label_contacts(other)) == len(PARTS)


@pytest.mark.parametrize(
    "wrong",
    [{"touch": 0.02, "release": 0.01}, {"release": FAR + 0.01}, {"touch": -1e-3}, {"speed": 0.0}, {"gap": -1.0}],
)
def test_thresholds_out_of_order_are_refused(wrong):
    with pytest.raises(ArgumentError, match="must be"):
        Proximity(**wrong)


# Recordings


@pytest.mark.skipif(not SHARED.is_dir(), reason="recorded clips are not here")
@pytest.mark.parametrize("name", ["sub2_largetable_004", "sub8_largebox_000"])
def test_recorded_labels_are_found(name):
    source = read_clip(SHARED / "omomo" / f"{name}.pt", ReadOptions(objects=SHARED / "objects"))
    found = flags(label_contacts(source))
    for known in source.contacts:
        if known.part in HANDS:
            assert (found[known.part] == known.active).mean() > 0.97
        if known.part in FEET:
            assert not found[known.part].any()


# The skin, where a body model is at hand


@pytest.fixture(scope="module")
def skinned(tmp_path_factory):
    """A clip whose person was read from a body's parameters."""
    clip = make("carry_box")
    folder = write_models(tmp_path_factory.mktemp("models"), clip.people, "smplx", ["neutral"])
    asked = parameters_of(clip.people[0], "smplx")
    body = np.concatenate([asked["root"], asked["body"]], axis=1)
    hands = asked["left_hand"], asked["right_hand"]
    parameters = BodyParameters("smplx", "neutral", np.zeros(10), asked["translation"], body, *hands, True)
    return replace(clip, people=(person_of(Path("clip"), "person", parameters, folder),))


def test_a_skin_is_as_near_as_its_nearest_vertex(skinned):
    person, track = skinned.people[0], skinned.objects[0]
    surface = surface_of(track.geometry)
    frames = slice(90, 130)
    for item in part_object_distances(skinned):
        joints = {capsule.joint for capsule in PART_CAPSULES[item.part]}
        vertices = vertices_of(person.shape.owners, joints)
        skin = person.shape.skin(person.joint_positions, person.joint_quats, vertices)[frames]
        inside = se3.rotate_inverse(track.quats[frames, None], skin - track.positions[frames, None])
        away = np.linalg.norm(inside - surface.closest_points(inside.reshape(-1, 3)).reshape(inside.shape), axis=-1)
        nearest = away.min(axis=1)
        np.testing.assert_allclose(item.distances[frames], np.where(nearest <= FAR, nearest, np.inf), atol=1e-12)


def test_a_skin_in_pieces_is_the_skin(skinned, monkeypatch):
    whole = part_object_distances(skinned)
    monkeypatch.setattr(contact_labels, "_SKIN_FRAMES", 100)
    for one, other in zip(whole, part_object_distances(skinned), strict=True):
        np.testing.assert_array_equal(one.distances, other.distances)
        np.testing.assert_array_equal(one.contact_points, other.contact_points)
