"""What a robot is asked to do: the rules of scaling, the planting of objects, and cutting in time."""

import functools
from dataclasses import fields, replace
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.errors import ArgumentError
from hoi_retarget.human.person import stance
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import smooth, smooth_quats
from hoi_retarget.retargeting.config import ContactKind, Scaling
from hoi_retarget.retargeting.targets import MAXIMUM_SINK, Targets, make_targets
from hoi_retarget.robots.spec import FINGER_SITES, SIDES
from synthetic import SCENES, make
from trajectories import MODELS

LAWS = settings(max_examples=8, deadline=None, derandomize=True, database=None)
every_robot = pytest.mark.parametrize("model", MODELS.values(), ids=list(MODELS))
scales = st.floats(0.4, 1.6)


@functools.cache
def scene(name: str = "carry_box") -> Clip:
    return make(name, seed=1)


def moved(clip: Clip, *, turn: float = 0.0, shift: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Clip:
    """Return the clip turned about the vertical through the origin [rad], then shifted [m]."""
    about = se3.exp(np.array([0.0, 0.0, turn]))

    def place(points: np.ndarray) -> np.ndarray:
        return se3.rotate(about, points) + np.array(shift)

    return replace(
        clip,
        people=tuple(
            replace(
                person,
                joint_positions=place(person.joint_positions),
                joint_quats=se3.quat_multiply(about, person.joint_quats),
            )
            for person in clip.people
        ),
        objects=tuple(
            replace(track, positions=place(track.positions), quats=se3.quat_multiply(about, track.quats))
            for track in clip.objects
        ),
    )


def lowest(targets: Targets, clip: Clip, index: int = 0) -> np.ndarray:
    """Return the height of an object's lowest point in every frame."""
    points = targets.object_scale[index] * clip.objects[index].geometry.points
    turned = se3.rotate(targets.object_quat[:, index, None], points[None])
    return targets.object_pos[:, index, 2] + turned[..., 2].min(axis=1)


def captured_lowest(clip: Clip, index: int = 0) -> np.ndarray:
    track = clip.objects[index]
    turned = se3.rotate(track.quats[:, None], track.geometry.points[None])
    return track.positions[:, 2] + turned[..., 2].min(axis=1)


# Contact points


@every_robot
@pytest.mark.parametrize("name", list(SCENES))
def test_points_of_parts_are_where_the_human_has_them_beside_the_object_nearest_in_time(model, name):
    clip = scene(name)
    for person, human in enumerate(clip.people):
        for multiplier in (0.5, 1.0):
            targets = make_targets(clip, model, Scaling(size_multiplier=multiplier), person=person)
            for link, part in enumerate(model.spec.part_sites):
                own = [track for track in clip.contacts if (track.person, track.part) == (person, part)]
                for index in {track.object for track in own if track.active.any()}:
                    frames = targets.carried_contact_object[:, link] == index
                    place = clip.objects[index].to_object(human.part_position(part))[frames]
                    expected = targets.object_scale[index] * place
                    np.testing.assert_allclose(targets.part_points[frames, link], expected, atol=1e-12)
                    assert frames.any()


@every_robot
@pytest.mark.parametrize("name", list(SCENES))
def test_contact_points_scale_exactly_with_the_geometry(model, name):
    clip = scene(name)
    for person in range(len(clip.people)):
        for multiplier in (0.5, 1.0, 1.5):
            targets = make_targets(clip, model, Scaling(size_multiplier=multiplier), person=person)
            tracks = [track for track in clip.contacts if track.person == person]
            assert tracks
            for track in tracks:
                link = targets.contact_links.index(model.spec.part_sites[track.part])
                np.testing.assert_array_equal(targets.contact_flags[:, link], track.active)
                expected = targets.object_scale[track.object] * track.contact_points
                np.testing.assert_array_equal(targets.contact_points[:, link], expected)
                np.testing.assert_array_equal(targets.contact_object[track.active, link], track.object)
            parts = [link not in FINGER_SITES for link in targets.contact_links]
            assert targets.contact_flags[:, parts].sum() == sum(track.active.sum() for track in tracks)
            assert (targets.contact_object[~targets.contact_flags] == -1).all()
            assert np.isnan(targets.contact_points[~targets.contact_flags]).all()


@every_robot
@LAWS
@given(root=scales, size=scales)
def test_no_root_scale_moves_a_contact_point_in_the_objects_frame(model, root, size):
    clip = scene()
    one = make_targets(clip, model, Scaling(root_scale=1.0, object_scale=size))
    other = make_targets(clip, model, Scaling(root_scale=root, object_scale=size))
    np.testing.assert_array_equal(one.contact_points, other.contact_points)
    np.testing.assert_array_equal(one.carried_contact_points, other.carried_contact_points)
    np.testing.assert_array_equal(one.object_quat, other.object_quat)


# Objects


@every_robot
@LAWS
@given(root=scales, multiplier=scales)
def test_the_lowest_point_scales_with_the_root_whatever_the_size(model, root, multiplier):
    clip = scene()
    targets = make_targets(clip, model, Scaling(root_scale=root, size_multiplier=multiplier))
    size = (root if model.spec.object_size == "root" else 1.0) * multiplier
    np.testing.assert_allclose(targets.object_scale, size)
    np.testing.assert_array_equal(targets.object_quat[:, 0], smooth_quats(clip.objects[0].quats, clip.fps))
    wanted = root * captured_lowest(clip)
    # The path is smoothed, the rule is not.
    assert np.abs(lowest(targets, clip) - wanted).max() < 0.006
    assert np.median(np.abs(lowest(targets, clip) - wanted)) < 1e-4
    assert lowest(targets, clip).min() > -MAXIMUM_SINK - 1e-9


@every_robot
@LAWS
@given(root=scales)
def test_an_object_scaled_with_the_root_keeps_its_place_in_the_scaled_world(model, root):
    """The paper's rule: geometry and path by one number."""
    clip = scene("drag_suitcase")
    targets = make_targets(clip, model, Scaling(root_scale=root, object_scale=root))
    expected = smooth(root * clip.objects[0].positions, clip.fps)
    np.testing.assert_allclose(targets.object_pos[:, 0, :2], expected[:, :2], atol=1e-9)
    np.testing.assert_allclose(targets.object_pos[:, 0, 2], expected[:, 2], atol=MAXIMUM_SINK)


@every_robot
@LAWS
@given(root=scales)
def test_an_object_of_captured_size_is_lifted_by_what_scaling_would_sink_it(model, root):
    clip = scene("drag_suitcase")
    targets = make_targets(clip, model, Scaling(root_scale=root, object_scale=1.0), contact="landmark")
    track = clip.objects[0]
    drop = track.positions[:, 2] - captured_lowest(clip)
    expected = np.column_stack([root * track.positions[:, :2], root * track.positions[:, 2] + (1 - root) * drop])
    assert np.ptp(drop) > 0.01, "the suitcase must tilt for this to be a test"
    unsmoothed_floor = expected[:, 2] - MAXIMUM_SINK
    path = smooth(expected, clip.fps)
    path[:, 2] = np.maximum(path[:, 2], unsmoothed_floor)
    np.testing.assert_allclose(targets.object_pos[:, 0], path, atol=1e-9)


@every_robot
@LAWS
@given(depth=st.floats(0.0, 0.3), root=scales, multiplier=scales)
def test_no_object_is_more_than_a_little_under_the_floor(model, depth, root, multiplier):
    clip = scene()
    noise = 0.02 * np.random.default_rng(0).normal(size=(clip.frames, 3))
    track = replace(clip.objects[0], positions=clip.objects[0].positions + noise - np.array([0, 0, depth]))
    sunk = replace(clip, objects=(track,))
    targets = make_targets(sunk, model, Scaling(root_scale=root, size_multiplier=multiplier))
    assert lowest(targets, sunk).min() > -0.005 - 1e-9


@every_robot
@LAWS
@given(tip=st.floats(0.0, 1.0), multiplier=st.floats(0.25, 1.5))
def test_no_object_is_under_the_floor_in_surface_contact_and_none_jumps_out_of_it(model, tip, multiplier):
    """Also one that tips over an edge at once, whose rotation is smoothed."""
    clip = scene()
    track = clip.objects[0]
    turn = se3.exp(np.outer(np.arange(clip.frames) > clip.frames // 2, [tip, 0.0, 0.0]))
    tipping = replace(track, quats=se3.quat_multiply(turn, track.quats))
    tipping = replace(tipping, positions=tipping.positions - tipping.lowest[:, None] * np.array([0.0, 0.0, 1.0]))
    tipped = replace(clip, objects=(tipping,))
    surface, landmark = (
        make_targets(tipped, model, Scaling(size_multiplier=multiplier), contact=kind) for kind in get_args(ContactKind)
    )
    assert lowest(surface, tipped).min() > -1e-9
    lift = (surface.object_pos - landmark.object_pos)[:, 0]
    assert (lift[:, :2] == 0).all()
    assert lift[:, 2].min() > -1e-9
    depth = max(0.0, -float(lowest(landmark, tipped).min()))
    assert lift[:, 2].max() <= depth + 1e-9
    assert np.abs(np.diff(lift[:, 2])).max() <= depth / 5 + 1e-9


@every_robot
def test_automatic_scales_are_the_robots(model):
    clip = scene()
    targets = make_targets(clip, model, Scaling())
    assert targets.root_scale == pytest.approx(model.spec.stature / clip.people[0].height)
    assert targets.human_height == clip.people[0].height
    expected = targets.root_scale if model.spec.object_size == "root" else 1.0
    np.testing.assert_array_equal(targets.object_scale, expected)
    doubled = make_targets(clip, model, Scaling(object_scale=1.2, size_multiplier=2.0))
    np.testing.assert_allclose(doubled.object_scale, 2.4)


@pytest.mark.parametrize("name", ["root_scale", "object_scale", "size_multiplier"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf"), float("-inf")])
def test_scales_that_are_no_sizes_are_refused_by_their_option(name, value):
    with pytest.raises(ArgumentError, match=f"{name.replace('_', '-')} is {value}; it must be a positive number"):
        Scaling(**{name: value})


# Places and headings


WORLD_POINTS = ("site_positions", "foot_positions", "object_pos")
WORLD_TURNS = ("site_quats", "foot_quats", "palm_quats", "contact_quats", "torso_quats", "object_quat")


@every_robot
@LAWS
@given(
    move=st.tuples(st.floats(-3.0, 3.0), st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)),
    root=scales,
    name=st.sampled_from([*SCENES]),
)
def test_turning_and_shifting_the_clip_turns_and_shifts_the_targets(model, move, root, name):
    turn, x, y = move
    clip, scaling = scene(name), Scaling(root_scale=root)
    before = make_targets(clip, model, scaling)
    after = make_targets(moved(clip, turn=turn, shift=(x, y, 0.0)), model, scaling)
    about, shift = se3.exp(np.array([0.0, 0.0, turn])), root * np.array([x, y, 0.0])
    for field in fields(Targets):
        ours, theirs = getattr(before, field.name), getattr(after, field.name)
        if field.name in WORLD_POINTS:
            np.testing.assert_allclose(theirs, se3.rotate(about, ours) + shift, atol=1e-8, err_msg=field.name)
        elif field.name in WORLD_TURNS:
            assert se3.angle_between(theirs, se3.quat_multiply(about, ours)).max() < 1e-6, field.name
        elif field.name == "trunk_rotations":
            np.testing.assert_allclose(theirs, se3.quat_to_matrix(about) @ ours, atol=1e-8)
        elif isinstance(ours, np.ndarray):
            np.testing.assert_allclose(theirs, ours, atol=1e-9, err_msg=field.name)
        else:
            assert theirs == pytest.approx(ours), field.name


# Hands and feet


@every_robot
@pytest.mark.parametrize("name", list(SCENES))
def test_feet_stand_on_the_floor_and_are_never_under_it(model, name):
    clip = scene(name)
    targets = make_targets(clip, model, Scaling())
    np.testing.assert_array_equal(targets.stance_flags, stance(clip.people[0], clip.fps))
    standing = model.forward(model.home_qpos[None])
    for index, side in enumerate(SIDES):
        origin, turn = standing.site_position(f"{side}_foot")[0], standing.site_rotation(f"{side}_foot")[0]
        corners = [
            turn.T @ (standing.site_position(site)[0] - origin)
            for site in model.site_names
            if site.startswith(f"{side}_sole")
        ]
        world = targets.foot_positions[:, index, None] + se3.rotate(
            targets.foot_quats[:, index, None], np.stack(corners)[None]
        )
        height = world[..., 2].min(axis=1)
        assert height.min() > -1e-9
        stands = targets.stance_flags[:, index]
        inside = stands & np.roll(stands, 3) & np.roll(stands, -3)
        assert stands.any() and np.abs(height[inside]).max() < 1e-6
        toe = [row.site for row in model.spec.ik].index(f"{side}_toe")
        offset = turn.T @ (standing.site_position(f"{side}_toe")[0] - origin)
        np.testing.assert_allclose(
            targets.site_positions[:, toe],
            targets.foot_positions[:, index] + se3.rotate(targets.foot_quats[:, index], offset[None]),
            atol=1e-9,
        )


@every_robot
def test_a_clip_recorded_off_the_floor_stands_on_it_all_the_same(model):
    clip = scene()
    ann = clip.people[0]
    for height in (-0.05, 0.02):
        lifted = replace(
            clip, people=(replace(ann, joint_positions=ann.joint_positions + np.array([0.0, 0.0, height])),)
        )
        one, other = (make_targets(each, model, Scaling()) for each in (clip, lifted))
        np.testing.assert_allclose(other.foot_positions, one.foot_positions, atol=1e-8)
        np.testing.assert_allclose(other.site_positions, one.site_positions, atol=1e-8)


@every_robot
def test_palms_turn_with_the_wrists_targets(model):
    """Fixed to the wrist as on the robot: one constant rotation a side."""
    targets = make_targets(scene(), model, Scaling())
    home = model.forward(model.home_qpos[None])
    rows = [row.site for row in model.spec.ik]
    for index, side in enumerate(SIDES):
        wrist = se3.quat_to_matrix(targets.site_quats[:, rows.index(f"{side}_wrist")])
        fixed = home.site_rotation(f"{side}_wrist")[0].T @ home.site_rotation(f"{side}_palm")[0]
        np.testing.assert_allclose(se3.quat_to_matrix(targets.palm_quats[:, index]), wrist @ fixed, atol=1e-9)


@every_robot
def test_the_body_is_scaled_about_the_floor_and_each_row_about_the_pelvis(model):
    clip, root = scene(), 0.7
    targets = make_targets(clip, model, Scaling(root_scale=root))
    pelvis = clip.people[0].position("pelvis")
    rows = [(k, row) for k, row in enumerate(model.spec.ik) if not row.site.endswith("toe")]
    lowered = targets.site_positions[:, rows[0][0], 2] - root * pelvis[:, 2]
    assert np.ptp(lowered) < 1e-9
    for k, row in rows:
        joint = clip.people[0].position(row.human_joint)
        expected = root * (pelvis + row.scale * (joint - pelvis)) + [0.0, 0.0, lowered[0]]
        np.testing.assert_allclose(targets.site_positions[:, k], expected, atol=1e-9, err_msg=row.site)
        turn = se3.quat_multiply(clip.people[0].quat(row.human_joint), np.array([row.rotation_offset]))
        # Offsets are printed with five digits.
        assert se3.angle_between(targets.site_quats[:, k], se3.quat_normalize(turn)).max() < 1e-6


def test_aims_continue_a_contact_and_fade():
    clip = scene()
    model = MODELS["unitree_g1"]
    targets = make_targets(clip, model, Scaling())
    link = targets.contact_links.index("left_palm")
    active = targets.contact_flags[:, link]
    first, stop = clip.contacts[0].segments[0]
    assert 0 < first < stop < clip.frames
    assert np.isfinite(targets.carried_contact_points).all()
    np.testing.assert_array_equal(targets.carried_contact_points[active, link], targets.contact_points[active, link])
    np.testing.assert_array_equal(
        targets.carried_contact_points[:first, link], np.tile(targets.contact_points[first, link], (first, 1))
    )
    for weights in (targets.contact_weights[:, link], targets.contact_rotation_weights[:, link]):
        assert (weights[active] == 1).all()
        assert 0 < weights[first - 1] < 1
        assert (weights[: first - 5] == 0).all() and (weights[stop + 5 :] == 0).all()
    feet = [targets.contact_links.index(f"{side}_foot") for side in SIDES]
    assert (targets.contact_weights[:, feet] == 0).all()


def test_one_link_touches_one_object_the_first_that_is_named():
    clip = scene()
    other = replace(clip.objects[0], name="other")
    second = ContactTrack(0, 1, "left_hand", np.ones(clip.frames, dtype=bool), np.ones((clip.frames, 3)))
    both = replace(clip, objects=(*clip.objects, other), contacts=(*clip.contacts, second))
    targets = make_targets(both, MODELS["unitree_g1"], Scaling(object_scale=1.0))
    link = targets.contact_links.index("left_palm")
    first = clip.contacts[0]
    assert first.part == "left_hand"
    np.testing.assert_array_equal(targets.contact_object[:, link], np.where(first.active, 0, 1))
    np.testing.assert_array_equal(targets.carried_contact_object[:, link], np.where(first.active, 0, 1))
    np.testing.assert_array_equal(targets.contact_points[~first.active, link], 1.0)


@every_robot
def test_a_clip_without_objects_has_empty_tracks(model):
    targets = make_targets(replace(scene(), objects=(), contacts=()), model, Scaling())
    assert targets.object_pos.shape == (targets.frames, 0, 3)
    assert targets.object_quat.shape == (targets.frames, 0, 4)
    assert not targets.contact_flags.any()


# Cutting in time


def over_time(targets: Targets) -> dict[str, np.ndarray]:
    """Return every array with an entry a frame, found by its length: no list of names to forget one in."""
    arrays = {field.name: getattr(targets, field.name) for field in fields(targets)}
    return {
        name: array for name, array in arrays.items() if isinstance(array, np.ndarray) and len(array) == targets.frames
    }


@every_robot
@LAWS
@given(start=st.integers(0, 60), length=st.integers(1, 60), stride=st.integers(1, 20))
def test_windows_and_strides_cut_every_array_over_time(model, start, length, stride):
    targets = make_targets(scene("carry_table"), model, Scaling())
    constant = {field.name for field in fields(Targets)} - set(over_time(targets))
    assert constant == {
        "fps", "root_scale", "human_height", "object_names", "object_geometry", "object_scale", "contact_links",
        "rotation_jumps", "contact", "base_qpos", "pins", "unpinned",
    }, "an array over time has another length than the clip"  # fmt: skip
    window, coarse = targets.window(start, start + length), targets.every(stride)
    for name, array in over_time(targets).items():
        np.testing.assert_array_equal(getattr(window, name), array[start : start + length], err_msg=name)
        np.testing.assert_array_equal(getattr(coarse, name), array[::stride], err_msg=name)
    assert window.frames == length
    assert window.fps == targets.fps
    assert coarse.fps == pytest.approx(targets.fps / stride)
    for name in constant - {"fps"}:
        np.testing.assert_array_equal(getattr(window, name), getattr(targets, name))
        np.testing.assert_array_equal(getattr(coarse, name), getattr(targets, name))


@every_robot
def test_all_arrays_are_read_only_and_finite_where_they_must_be(model):
    targets = make_targets(scene(), model, Scaling())
    for field in fields(Targets):
        array = getattr(targets, field.name)
        if isinstance(array, np.ndarray):
            assert not array.flags.writeable, field.name
            assert field.name == "contact_points" or np.isfinite(array).all(), field.name
    for name in WORLD_TURNS:
        np.testing.assert_allclose(np.linalg.norm(getattr(targets, name), axis=-1), 1.0, atol=1e-9, err_msg=name)
