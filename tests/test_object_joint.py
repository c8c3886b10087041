"""Joints between objects: fitted from poses, kept at any size and in the mirror, in files, scenes and tasks."""

import json
import os
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hoi_retarget.cli import main
from hoi_retarget.clip.augment import mirrored
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.dynamics.feasibility import not_free
from hoi_retarget.dynamics.physics_scene import scene_of
from hoi_retarget.errors import ClipError
from hoi_retarget.motion.result_file import load, save
from hoi_retarget.numerics import se3
from hoi_retarget.objects.object_joint import (
    MAX_OFF,
    depth_first,
    distance_from,
    fitted_joint,
    parents_of,
    path_of,
    scaled,
)
from hoi_retarget.objects.track import ObjectGeometry, ObjectJoint, ObjectTrack
from hoi_retarget.readers import read_clip
from hoi_retarget.readers.open import open_clip
from hoi_retarget.readers.own_layout import encode, write
from hoi_retarget.readers.parahome import with_fitted_joints
from hoi_retarget.retargeting.config import Scaling
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.retargeting.targets import make_targets
from hoi_retarget.robots import load_robot
from npz_changes import changed
from synthetic.jointed import open_door, open_laptop
from test_mjlab_task import MJLAB_PYTHON, with_tasks

G1 = load_robot("unitree_g1")
SHAPE = ObjectGeometry(np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.2, 0.2) for z in (-0.3, 0.3)]))
FRAMES = 40
SEEDS = st.integers(0, 2**31)
SCENES = {"door": open_door, "laptop": open_laptop}


def wandering(generator, name="whole", joint=None):
    """An object that moves and turns freely."""
    steps = generator.normal(size=(FRAMES, 6)) * 0.02
    turns = se3.exp(np.cumsum(steps[:, 3:], axis=0))
    return ObjectTrack(name, np.cumsum(steps[:, :3], axis=0), turns, SHAPE, joint)


def part_on(parent, joint, states, generator, name="part"):
    """A part that moves by a joint, in any place and attitude on its parent."""
    place, turn = generator.normal(size=3) * 0.3, se3.quat_normalize(generator.normal(size=4))
    axis, anchor = np.array(joint.axis), np.array(joint.anchor)
    if joint.kind == "hinge":
        own = se3.exp(states[:, None] * axis)
        places, quats = anchor + se3.rotate(own, place - anchor), se3.quat_multiply(own, turn)
    else:
        places, quats = place + states[:, None] * axis, np.tile(turn, (FRAMES, 1))
    world = parent.positions + se3.rotate(parent.quats, places)
    return ObjectTrack(name, world, se3.quat_multiply(parent.quats, quats), SHAPE, joint)


def random_joint(kind, generator, parent="whole"):
    axis = generator.normal(size=3)
    return ObjectJoint(
        parent, kind, tuple((axis / np.linalg.norm(axis)).tolist()), tuple(generator.normal(size=3) * 0.4)
    )


def random_states(kind, generator):
    span = generator.uniform(0.3, 4.0) if kind == "hinge" else generator.uniform(0.05, 0.5)
    start = generator.uniform(-1.0, 1.0)
    return start + span * np.sin(np.linspace(0.0, generator.uniform(1.0, 6.0), FRAMES)) * generator.choice([-1.0, 1.0])


@settings(deadline=None, max_examples=60)
@given(seed=SEEDS, kind=st.sampled_from(["hinge", "slide"]))
def test_a_fitted_joint_is_the_joint_by_which_a_part_moves(seed, kind):
    generator = np.random.default_rng(seed)
    parent, joint, states = wandering(generator), random_joint(kind, generator), random_states(kind, generator)
    moved = states - states[0]
    assume(np.ptp(states) > 0.15 if kind == "hinge" else np.ptp(states) > 0.03)
    part = part_on(parent, joint, states, generator)
    found = fitted_joint(parent, part)
    assert found is not None and found.kind == kind and found.parent == "whole"
    sign = np.sign(np.dot(found.axis, joint.axis))
    np.testing.assert_allclose(np.array(found.axis) * sign, joint.axis, atol=1e-7)
    # The axis points such that the state that is farthest from the first one is positive.
    assert moved[np.abs(moved).argmax()] * sign > 0.0
    if kind == "hinge":
        off = np.cross(np.subtract(found.anchor, joint.anchor), joint.axis)
        np.testing.assert_allclose(off, 0.0, atol=1e-6)
    path = path_of(found, parent, part)
    np.testing.assert_allclose(path.states, sign * moved, atol=1e-6)
    off_metres, off_degrees = distance_from(path, parent, part)
    assert off_metres < 1e-6 and off_degrees < 1e-4
    # A part is where its path in its parent's frame says.
    place, turn = path.in_world(parent.positions, parent.quats, 1.0)
    np.testing.assert_allclose(place, part.positions, atol=1e-6)
    assert se3.angle_between(turn, part.quats).max() < 1e-5


@settings(deadline=None, max_examples=25)
@given(seed=SEEDS)
def test_parts_that_keep_their_place_are_fixed_and_free_ones_have_no_joint(seed):
    generator = np.random.default_rng(seed)
    parent = wandering(generator)
    still = part_on(parent, random_joint("hinge", generator), np.zeros(FRAMES), generator)
    assert fitted_joint(parent, still) == ObjectJoint("whole", "fixed")
    assert fitted_joint(parent, still, "hinge") is None and fitted_joint(parent, still, "slide") is None
    assert fitted_joint(parent, wandering(generator, "other")) is None


@settings(deadline=None, max_examples=25)
@given(seed=SEEDS, kind=st.sampled_from(["hinge", "slide"]), scale=st.floats(0.3, 3.0))
def test_a_part_keeps_its_joint_at_any_size(seed, kind, scale):
    generator = np.random.default_rng(seed)
    parent, joint = wandering(generator), random_joint(kind, generator)
    path = path_of(joint, parent, part_on(parent, joint, random_states(kind, generator), generator))
    larger = ObjectTrack("part", *path.in_world(parent.positions, parent.quats, scale), SHAPE)
    again = path_of(scaled(joint, scale), parent, larger)
    assert max(distance_from(again, parent, larger)) < 1e-6
    np.testing.assert_allclose(again.states, path.states * (scale if kind == "slide" else 1.0), atol=1e-9)


@pytest.mark.parametrize("name", SCENES)
def test_a_mirrored_part_has_its_joint_and_its_states_and_twice_is_identity(name):
    clip, truth = SCENES[name]()
    seen = mirrored(clip)
    part, parent = seen.objects[0], seen.objects[1]
    assert part.joint is not None
    path = path_of(part.joint, parent, part)
    assert max(distance_from(path, parent, part)) < 1e-6
    np.testing.assert_allclose(path.states, truth, atol=1e-9)
    for one, other in zip(mirrored(seen).objects, clip.objects, strict=True):
        assert one.joint == other.joint


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("size", [0.6, 1.0, 1.4])
def test_a_robots_object_keeps_its_joint_and_moves_by_the_recorded_angle(name, size):
    clip, truth = SCENES[name]()
    targets = make_targets(clip, G1, Scaling(size_multiplier=size))
    parent, part = (
        replace(clip.objects[index], positions=targets.object_pos[:, index], quats=targets.object_quat[:, index])
        for index in (1, 0)
    )
    joint = clip.objects[0].joint
    assert joint is not None
    path = path_of(scaled(joint, float(targets.object_scale[0])), parent, part)
    assert max(distance_from(path, parent, part)) < 1e-5
    assert np.degrees(np.abs(path.states - truth)).max() < 1.0  # By smoothing.


@pytest.mark.parametrize("name", SCENES)
def test_joints_are_written_and_read_and_found_where_a_clip_names_no_axis(name, tmp_path):
    clip, _ = SCENES[name]()
    path = tmp_path / "clip.npz"
    write(clip, path)
    assert [track.joint for track in read_clip(path, ReadOptions()).objects] == [track.joint for track in clip.objects]
    changed(path, object_0_axis=None, object_0_anchor=None)
    found, known = read_clip(path, ReadOptions()).objects[0].joint, clip.objects[0].joint
    assert found is not None and known is not None
    np.testing.assert_allclose(found.axis, known.axis, atol=1e-9)
    np.testing.assert_allclose(np.cross(np.subtract(found.anchor, known.anchor), known.axis), 0.0, atol=1e-9)


FAULTS = {
    "a kind that there is not": ({"object_0_joint": np.str_("screw")}, "object_0_joint is 'screw'"),
    "another kind": ({"object_0_joint": np.str_("slide"), "object_0_axis": None}, "does not move as on a slide"),
    "no parent": ({"object_0_parent": None}, "object_0_parent"),
    "itself": ({"object_0_parent": np.str_("door")}, "no other object"),
    "nobody": ({"object_0_parent": np.str_("house")}, "no other object"),
    "another axis": ({"object_0_axis": np.array([1.0, 0.0, 0.0])}, "from where object_0_axis and object_0_anchor put"),
    "no unit vector": ({"object_0_axis": np.array([0.0, 0.0, 2.0])}, "no unit vector"),
    "a world that moves": ({"object_0_joint": np.str_("fixed"), "object_0_parent": None}, "from where object_0_axis"),
    "half an axis": ({"object_0_anchor": None}, "object_0_anchor"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_wrong_with_a_joint_is_told(fault, tmp_path):
    values, said = FAULTS[fault]
    path = tmp_path / "clip.npz"
    path.write_bytes(encode(open_door()[0], tmp_path))
    if values.get("object_0_axis", 0) is None:
        values = {**values, "object_0_anchor": None}
    changed(path, **values)
    with pytest.raises(ClipError, match=said):
        read_clip(path, ReadOptions())


def test_a_clip_refuses_parts_of_nothing_and_circles():
    clip, _ = open_door()
    panel, frame = clip.objects
    with pytest.raises(ClipError, match="hangs on 'house'; the objects are door, frame"):
        replace(clip, objects=(replace(panel, joint=ObjectJoint("house", "fixed")), frame))
    with pytest.raises(ClipError, match="in a circle"):
        replace(clip, objects=(panel, replace(frame, joint=ObjectJoint("door", "fixed"))))
    with pytest.raises(ClipError, match="needs a parent"):
        ObjectJoint("", "hinge")


def cup_in_drawer():
    """A cabinet on the floor, its drawer that is pulled out, and a cup that lies in it."""
    clip, _ = open_door()
    frames, flat = clip.frames, np.tile(se3.IDENTITY_QUAT, (clip.frames, 1))
    pulled = np.array([-0.3, 0.0, 0.0]) * np.linspace(0.0, 1.0, frames)[:, None]

    def block(name, size, place, joint=None):
        points = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size
        return ObjectTrack(name, place + np.zeros((frames, 3)), flat, ObjectGeometry(points), joint)

    cabinet = block("cabinet", (0.5, 0.5, 0.8), np.array([2.0, 0.0, 0.4]))
    drawer = block(
        "drawer",
        (0.4, 0.4, 0.05),
        pulled + np.array([1.9, 0.0, 0.9]),
        ObjectJoint("cabinet", "slide", (-1.0, 0.0, 0.0)),
    )
    cup = block("cup", (0.08, 0.08, 0.1), pulled + np.array([1.85, 0.0, 0.975]))
    return replace(clip, objects=(cup, drawer, cabinet), contacts=())


@pytest.mark.parametrize("size", [0.8, 1.0, 1.2])
@pytest.mark.parametrize("robot", ["unitree_g1", "unitree_h2"])
def test_what_lies_in_a_part_goes_with_it(robot, size):
    clip = cup_in_drawer()
    targets = make_targets(clip, load_robot(robot), Scaling(size_multiplier=size))
    scale = float(targets.object_scale[0])
    cup, drawer = targets.object_pos[:, 0], targets.object_pos[:, 1]
    recorded = scale * (clip.objects[0].positions - clip.objects[1].positions)
    np.testing.assert_allclose(cup - drawer, recorded, atol=2e-3)


@pytest.mark.parametrize("size", [0.8, 1.0, 1.2])
@pytest.mark.parametrize("robot", ["unitree_g1", "unitree_h2"])
def test_the_lowest_part_stands_where_the_whole_does(robot, size):
    """A door on a lintel: its parent is in the air, and it reaches the floor."""
    clip, _ = open_door()
    door, frame = clip.objects
    top = frame.geometry.points[:, 2] > 0.9
    lintel = replace(frame, geometry=ObjectGeometry(frame.geometry.points[top]))
    targets = make_targets(replace(clip, objects=(door, lintel)), load_robot(robot), Scaling(size_multiplier=size))
    bottom = targets.object_pos[:, 0, 2] + targets.object_scale[0] * door.geometry.points[:, 2].min()
    np.testing.assert_allclose(bottom, targets.root_scale * door.lowest, atol=5e-3)


def test_a_part_that_moves_with_nobody_near_is_told_and_not_refused(tmp_path):
    clip, _ = open_door()
    away = replace(clip.people[0], joint_positions=clip.people[0].joint_positions + np.array([3.0, 0.0, 0.0]))
    write(replace(clip, people=(away,), contacts=()), tmp_path / "clip.npz")
    assert [warning.code for warning in open_clip(tmp_path / "clip.npz").source.warnings]


def test_parts_that_lie_still_apart_are_not_fixed_to_each_other():
    generator = np.random.default_rng(1)
    still = replace(
        wandering(generator, "pan_base"), positions=np.zeros((FRAMES, 3)), quats=np.tile([1.0, 0, 0, 0], (FRAMES, 1))
    )
    lid = replace(still, name="pan_part1", positions=still.positions + np.array([1.1, 0.0, 0.0]))
    assert with_fitted_joints((still, lid))[1].joint is None
    moving = wandering(generator, "pan_base")
    with_it = part_on(moving, random_joint("hinge", generator), np.zeros(FRAMES), generator, "pan_part1")
    assert with_fitted_joints((moving, replace(with_it, joint=None)))[1].joint == ObjectJoint("pan_base", "fixed")


def test_names_of_parahome_tell_parts_of_one_object():
    generator = np.random.default_rng(0)
    base, joint = wandering(generator, "oven_base"), random_joint("hinge", generator, "oven_base")
    door = part_on(base, joint, np.linspace(0.0, 1.0, FRAMES), generator, "oven_part1")
    drawer = part_on(base, random_joint("slide", generator), np.linspace(0.0, 0.3, FRAMES), generator, "oven_part2")
    loose, other = wandering(generator, "oven_part3"), wandering(generator, "pan_part1")
    tracks = (replace(drawer, joint=None), base, replace(door, joint=None), loose, other)
    found = with_fitted_joints(tracks)
    assert [track.joint and track.joint.kind for track in found] == ["slide", None, "hinge", None, None]
    assert parents_of(found) == (1, -1, 1, -1, -1)
    assert depth_first(parents_of(found)) == [1, 0, 2, 3, 4]
    assert depth_first((1, -1, 0), 1) == [1, 0, 2]  # A part of a part.


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    """Doors and laptops opened by a G1: their folder, with clips and results."""
    folder = tmp_path_factory.mktemp("opened")
    for name, make in SCENES.items():
        write(make()[0], folder / f"{name}.npz")
        clip = read_clip(folder / f"{name}.npz", ReadOptions())
        save(retarget(clip, G1), folder / "results" / f"{name}.npz")
    return folder


@pytest.mark.parametrize("name", SCENES)
def test_a_door_is_opened_by_hand_with_the_recorded_angle(name, opened, monkeypatch):
    motion, truth = load(opened / "results" / f"{name}.npz"), SCENES[name]()[1]
    assert motion.report.figures["touch_share"] == pytest.approx(1.0, abs=0.02)  # Within 2 mm.
    monkeypatch.chdir(opened)
    assert main(["scene", f"results/{name}.npz", "--out", f"scene_{name}"]) == 0
    simulated = mujoco.MjModel.from_xml_path(f"scene_{name}/scene.xml")
    clip = read_clip(opened / f"{name}.npz", ReadOptions())
    scene = scene_of(motion, G1, clip.objects)
    qpos, data = scene.qpos(motion), mujoco.MjData(simulated)
    assert qpos.shape[1] == simulated.nq
    part = scene.objects[0]
    joint = simulated.joint(f"{part.body_name}_joint")
    assert joint.type == mujoco.mjtJoint.mjJNT_HINGE
    assert np.degrees(np.abs(qpos[:, joint.qposadr[0]] - truth)).max() < 1.0
    for frame in range(0, motion.frames, 7):
        data.qpos[:] = qpos[frame]
        mujoco.mj_kinematics(simulated, data)
        for index, item in enumerate(scene.objects):
            body = data.body(item.body_name)
            np.testing.assert_allclose(body.xpos, motion.object_pos[frame, index], atol=1e-6)
            assert se3.angle_between(body.xquat[None], motion.object_quat[frame, index, None]).max() < 1e-6
    np.testing.assert_allclose(simulated.key_qpos[-1], qpos[-1], atol=1e-12)
    # A panel and its frame, and a lid and its base, do not push each other.
    pair = [simulated.body(item.body_name).id for item in (scene.objects[1], part)]
    assert (pair[0] << 16) + pair[1] in simulated.exclude_signature


def test_parts_are_not_judged_as_free_bodies_and_not_refined(opened, monkeypatch, capsys):
    clip = read_clip(opened / "door.npz", ReadOptions())
    assert not_free(clip, 0).all()
    stand = not_free(read_clip(opened / "laptop.npz", ReadOptions()), 0)
    assert stand[:, :2].all() and not stand[:, 2].any()
    monkeypatch.chdir(opened)
    assert main(["refine", "results/door.npz", "--out", "refined"]) == 1
    assert "parts on joints, which are not refined yet" in " ".join(capsys.readouterr().err.split())
    assert main(["feasible", "results/door.npz", "--json", "facts.json"]) == 0
    assert json.loads(Path("facts.json").read_text())[0]["object_missing_wrench_p95_share"] is None


def test_another_robot_opens_the_same_door(opened, monkeypatch):
    monkeypatch.chdir(opened)
    options = ReadOptions(from_robot="unitree_g1")
    clip, motion = read_clip(Path("results/door.npz"), options), load(Path("results/door.npz"))
    door, frame = clip.objects
    assert door.joint is not None and frame.joint == ObjectJoint("", "fixed")
    off, turned = distance_from(path_of(door.joint, frame, door), frame, door)
    assert off < MAX_OFF / 100 and turned < 0.01
    assert np.ptp(door.geometry.points[:, 1]) == pytest.approx(float(motion.object_scale[0]), rel=1e-6)  # 1 m as made.


@pytest.mark.slow
@pytest.mark.skipif(MJLAB_PYTHON is None, reason="HOI_RETARGET_MJLAB_PYTHON names no Python that has mjlab 1.6")
@pytest.mark.parametrize("name", SCENES)
def test_mjlab_sets_parts_to_the_reference(name, opened, monkeypatch):
    assert MJLAB_PYTHON is not None
    monkeypatch.chdir(opened)
    assert main(["export", f"results/{name}.npz", "--to", "mjlab-task", "--out", "tasks"]) == 0
    script = os.fspath(Path(__file__).with_name("mjlab_check.py"))
    found = json.loads(with_tasks(opened, MJLAB_PYTHON, script, f"Hoi-{name}", "20").splitlines()[-1])
    told = found["reset"]["told"]
    assert max(told["body"], told["object"]) < 1e-6 and told["object_speed"] < 1e-2
