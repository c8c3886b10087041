"""Laws of the figures of merit, on small hand-made worlds, without a solver."""

import csv
import dataclasses
import functools
import io
import json
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.errors import ArgumentError, ClipError, RobotError
from hoi_retarget.evaluation import (
    COLUMNS,
    FIGURES,
    Comparison,
    Figure,
    Score,
    contact_figures,
    evaluate,
    figures_of,
    hand_slip,
    mean_values,
    penetration,
    table_rows,
    to_csv,
    to_json,
    unreached_contacts,
    worst_values,
)
from hoi_retarget.evaluation.figure_table import grouped_columns
from hoi_retarget.evaluation.motion_figures import HUMAN_TO_ROBOT_AXES
from hoi_retarget.evaluation.physics_figures import PERFORMED
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import HANDS, JOINTS
from hoi_retarget.motion.motion import Motion, Stage
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.robots import ROBOTS, load_robot
from hoi_retarget.robots.frames import Attachments, Frame, Geometries
from hoi_retarget.robots.model import Kinematics, RobotModel, load_model
from hoi_retarget.robots.spec import SIDES, SITES, SOLE_CORNERS, SitePose

FPS = 30.0
FRAMES = 40
RESTING = 6  # Frames for which objects stand on the floor.
SEGMENT = slice(8, 28)
SITE_OF_JOINT = {
    "pelvis": "pelvis",
    "torso": "spine3",
    "head": "head",
    **{
        f"{side}_{site}": f"{side}_{joint}"
        for side in SIDES
        for site, joint in (
            ("hip", "hip"),
            ("knee", "knee"),
            ("foot", "ankle"),
            ("toe", "foot"),
            ("shoulder", "shoulder"),
            ("elbow", "elbow"),
            ("wrist", "wrist"),
        )
    },
}
COMPARISONS = (
    "contact_gap_m",
    "contact_gap_p95_m",
    "contact_gap_max_m",
    "trunk_deviation_deg",
    "trunk_deviation_p95_deg",
    "trunk_deviation_max_deg",
    "trunk_lean_p95_deg",
    "body_pose_deviation_deg",
    "link_velocity_direction_deg",
    "relative_hand_rotation_deg",
    "object_path_error_m",
)
"""Figures that are zero for a robot that does exactly what the human does."""


@functools.cache
def two_joints() -> RobotModel:
    """Return a robot of two joints, a and b, all of whose sites are on its root."""
    hinges = "".join(
        f'<body><joint name="{name}" axis="1 0 0" range="-{reach} {reach}"/><geom size="0.1"/></body>'
        for name, reach in (("a", 1), ("b", 2))
    )
    with tempfile.TemporaryDirectory() as folder:
        mjcf = Path(folder) / "robot.xml"
        mjcf.write_text(
            '<mujoco><compiler angle="radian"/><worldbody><body name="base" pos="0 0 1"><freejoint/>'
            f'<geom size="0.1"/>{hinges}</body></worldbody></mujoco>'
        )
        sites = {name: SitePose("base", (0.0, 0.0, 0.0)) for name in SITES}
        speeds = {"a": 5.0, "b": 7.0}
        spec = dataclasses.replace(
            ROBOTS["unitree_g1"], mjcf=mjcf, sites=sites, speed_limits=speeds, home={}, skin=None
        )
        return load_model(spec)


# A robot without geometries has no surface to touch with, and one without torque limits no forces that are judged.
OF_SURFACES = {
    *(figure.name for figure in vars(penetration).values() if isinstance(figure, Figure)),
    *(figure.name for figure in FIGURES if figure.slow),
}
# Nobody's hand here holds still on an object: tests/test_contact_figures.py has hands that do.
OF_HOLDS = {figure.name for figure in vars(hand_slip).values() if isinstance(figure, Figure)}
OF_STACKS = {"support_height_error_m"}  # Of objects that another one carries.
OF_FINGERS = {"finger_touch_share", "finger_place_m", "finger_depth_max_m"}
OF_COUPLINGS = {"coupling_error_rad"}  # Of added robots with some.


@dataclasses.dataclass(frozen=True)
class RobotPoses:
    """Sites and bodies of a robot that may be anywhere, whatever its joints do."""

    points: Mapping[str, np.ndarray]
    rotations: Mapping[str, np.ndarray]
    body_positions: np.ndarray

    def real(self) -> Kinematics:
        """Return them as kinematics, of a model in which every site and body has a node of its own."""
        frames, bodies, _ = self.body_positions.shape
        upright = np.tile(np.eye(3), (frames, 1, 1))
        places = [*self.points.values(), *self.body_positions.swapaxes(0, 1)]
        turns = [self.rotations.get(name, upright) for name in self.points] + [upright] * bodies
        own = [Frame(node, np.zeros(3), np.eye(3)) for node in range(len(places))]
        model = dataclasses.replace(
            two_joints(),
            sites=Attachments.named(zip(self.points, own[:-bodies], strict=True)),
            bodies=Attachments.named((f"body{place.node}", place) for place in own[-bodies:]),
            geometries=Geometries((), (), (), np.zeros((0, 3)), (), np.zeros((0, 4)), np.zeros(0, dtype=int)),
        )
        qpos = np.tile(model.home_qpos, (frames, 1))
        return Kinematics(model, qpos, np.array(places).transpose(2, 0, 1), np.array(turns).transpose(2, 3, 0, 1))


@dataclasses.dataclass(frozen=True)
class World:
    """A clip with the robot that was asked to follow it."""

    clip: Clip
    motion: Motion
    kinematics: RobotPoses

    def figures(self, person: int = 0) -> Mapping:
        kinematics = self.kinematics.real()
        return figures_of(Comparison(self.motion, self.clip, person, kinematics))


def smooth(rng, *shape, size=0.3, frames=FRAMES):
    """Smooth curves over time, frames first."""
    t = np.arange(frames)[:, None] / FPS
    flat = np.zeros((frames, int(np.prod(shape))))
    for _ in range(4):
        flat += rng.normal(size=flat.shape[1]) * np.sin(
            rng.uniform(1, 6, flat.shape[1]) * t + rng.uniform(0, 7, flat.shape[1])
        )
    return size * flat.reshape(frames, *shape)


def smooth_quats(rng, *shape):
    return se3.exp(smooth(rng, *shape, 3, size=0.5))


def exact_kinematics(person: Person, rng) -> RobotPoses:
    """A robot whose sites are the human's joints, with hand frames of its own."""
    points = {site: person.position(joint) for site, joint in SITE_OF_JOINT.items()}
    rotations = {site: se3.quat_to_matrix(person.quat(SITE_OF_JOINT[site])) for site in ("pelvis", "torso")}
    rotations = {site: rotation @ HUMAN_TO_ROBOT_AXES for site, rotation in rotations.items()}
    for side in SIDES:
        points[f"{side}_palm"] = person.part_position(f"{side}_hand")
        offset = se3.quat_to_matrix(se3.exp(rng.normal(size=3)))
        rotations[f"{side}_palm"] = se3.quat_to_matrix(person.part_quat(f"{side}_hand")) @ offset
        for number, corner in enumerate(SOLE_CORNERS):
            place = points[f"{side}_foot"] + rng.normal(size=3, scale=0.05)
            place[:, 2] = 0.03 * number + 0.01 * np.sin(np.arange(len(place)))
            points[f"{side}_sole_{corner}"] = place
    assert set(points) == set(SITES)
    return RobotPoses(points, rotations, np.stack(list(points.values()), axis=1))


def hull(points):
    """Return the solid around points."""
    return ObjectGeometry(points, faces=ConvexHull(points).simplices)


def make_world(seed: int = 0, *, objects: int = 1, people: int = 1, first_source_frame: int = 1) -> World:
    rng = np.random.default_rng(seed)
    persons, tracks, contacts = [], [], []
    for number in range(objects):
        geometry = hull(np.random.default_rng(number).normal(size=(30, 3), scale=0.1))  # One field for all seeds.
        path, turns = 1.0 + smooth(rng, 3), smooth_quats(rng)
        path[:RESTING], turns[:RESTING] = path[RESTING], turns[RESTING]
        track = ObjectTrack(f"object{number}", path, turns, geometry)
        tracks.append(dataclasses.replace(track, positions=path - [0.0, 0.0, track.lowest[0] - 0.02]))
    for number in range(people):
        rest = rng.normal(size=(len(JOINTS), 3), scale=0.4) + np.array([0.0, 0.0, 1.0])
        person = Person(f"person{number}", rest + smooth(rng, len(JOINTS), 3), smooth_quats(rng, len(JOINTS)))
        persons.append(person)
        for part in HANDS if objects else ():
            active = np.zeros(FRAMES, dtype=bool)
            active[SEGMENT] = True
            active[33:36] = True
            contacts.append(ContactTrack(number, 0, part, active, tracks[0].to_object(person.part_position(part))))
    clip = Clip("made", FPS, tuple(persons), tuple(tracks), tuple(contacts), first_source_frame=first_source_frame)
    return World(clip, make_motion(clip, rng), exact_kinematics(persons[0], rng))


def make_motion(clip: Clip, rng) -> Motion:
    root = np.tile(np.array([0, 0, 1.0, 1, 0, 0, 0]), (clip.frames, 1))
    qpos = np.concatenate([root, smooth(rng, 2, size=0.1)], axis=1)
    stance = np.ones((clip.frames, 2), dtype=bool)
    stance[10:20, 0] = stance[25:30, 1] = False
    own = [track for track in clip.contacts if track.person == 0]
    return Motion(
        robot="stub",
        fps=clip.fps,
        joint_names=("a", "b"),
        stages=(Stage("trajectory", qpos),),
        object_names=tuple(track.name for track in clip.objects),
        object_pos=np.array([track.positions for track in clip.objects]).reshape(-1, clip.frames, 3).swapaxes(0, 1),
        object_quat=np.array([track.quats for track in clip.objects]).reshape(-1, clip.frames, 4).swapaxes(0, 1),
        object_scale=np.ones(len(clip.objects)),
        contact_links=tuple(track.part.replace("hand", "palm") for track in own),
        contact_flags=np.array([track.active for track in own], dtype=bool).reshape(-1, clip.frames).T,
        contact_object=np.array([np.where(track.active, track.object, -1) for track in own], dtype=int)
        .reshape(-1, clip.frames)
        .T,
        contact_points=np.array([track.contact_points for track in own]).reshape(-1, clip.frames, 3).swapaxes(0, 1),
        stance_flags=stance,
        first_source_frame=clip.first_source_frame,
        human_height=1.7,
    )


def edit_clip(world: World, **changes) -> World:
    return dataclasses.replace(world, clip=dataclasses.replace(world.clip, **changes))


def edit_motion(world: World, **changes) -> World:
    return dataclasses.replace(world, motion=dataclasses.replace(world.motion, **changes))


def edit_kinematics(world: World, **changes) -> World:
    return dataclasses.replace(world, kinematics=dataclasses.replace(world.kinematics, **changes))


def move_sites(world: World, **places: np.ndarray) -> World:
    return edit_kinematics(world, points={**world.kinematics.points, **places})


def imperfect(seed: int) -> World:
    """A world whose robot errs in everything, so that no figure is trivially zero."""
    world = make_world(seed)
    rng = np.random.default_rng(seed + 1000)
    kinematics = world.kinematics
    points = {name: place + smooth(rng, 3, size=0.03) for name, place in kinematics.points.items()}
    rotations = {
        name: rotation @ se3.quat_to_matrix(se3.exp(smooth(rng, 3, size=0.1)))
        for name, rotation in kinematics.rotations.items()
    }
    world = edit_kinematics(
        world, points=points, rotations=rotations, body_positions=np.stack(list(points.values()), axis=1)
    )
    sinking = np.linspace(0.3, -1.0, FRAMES)[:, None, None] * [0.0, 0.0, 1.0]
    position = world.motion.object_pos + smooth(rng, 1, 3, size=0.05) + sinking
    turn = se3.exp(smooth(rng, 1, 3, size=0.1))
    return edit_motion(
        world,
        object_pos=position,
        object_quat=se3.quat_multiply(world.motion.object_quat, turn),
        object_scale=np.array([0.9]),
    )


def assert_same(a: Mapping, b: Mapping, *, without: tuple[str, ...] = (), tolerance: float = 1e-7) -> None:
    for name, value in dict(a).items():
        if name not in without:
            assert value == pytest.approx(b[name], abs=tolerance), name


def transform(world: World, point: Callable, rotation: Callable, points_local: Callable = lambda p: p) -> World:
    """Map world points and rotations (matrices), and an object's own points, on both sides."""

    def quats(values):
        return se3.matrix_to_quat(rotation(se3.quat_to_matrix(values)))

    def geometry(old):
        return ObjectGeometry(points_local(old.points), faces=old.faces)

    people = tuple(Person(p.name, point(p.joint_positions), quats(p.joint_quats)) for p in world.clip.people)
    objects = tuple(
        ObjectTrack(o.name, point(o.positions), quats(o.quats), geometry(o.geometry)) for o in world.clip.objects
    )
    contacts = tuple(
        dataclasses.replace(track, contact_points=points_local(track.contact_points)) for track in world.clip.contacts
    )
    world = edit_clip(world, people=people, objects=objects, contacts=contacts)
    world = edit_motion(world, object_pos=point(world.motion.object_pos), object_quat=quats(world.motion.object_quat))
    kinematics = world.kinematics
    return edit_kinematics(
        world,
        points={name: point(place) for name, place in kinematics.points.items()},
        rotations={name: rotation(turn) for name, turn in kinematics.rotations.items()},
        body_positions=point(kinematics.body_positions),
    )


# Laws that hold for any world


@pytest.mark.parametrize("seed", range(5))
def test_robot_that_does_what_the_human_does_scores_zero(seed):
    figures = make_world(seed).figures()
    for name in COMPARISONS:
        assert figures[name] == pytest.approx(0.0, abs=1e-5), name


@pytest.mark.parametrize("seed", range(5))
def test_imperfect_world_leaves_no_figure_at_zero(seed):
    for name, value in dict(imperfect(seed).figures()).items():
        if name in OF_SURFACES | OF_HOLDS | OF_STACKS | OF_COUPLINGS:
            assert value is None, name
        else:
            assert value is not None and abs(value) > 1e-4, name


@pytest.mark.parametrize("seed", range(5))
def test_turning_and_shifting_the_world_on_its_floor_changes_nothing(seed):
    world = imperfect(seed)
    yaw = se3.quat_to_matrix(se3.exp(np.array([0.0, 0.0, 1.1 + seed])))
    shift = np.array([3.0, -2.0, 0.0])
    assert_same(transform(world, lambda p: p @ yaw.T + shift, lambda r: yaw @ r).figures(), world.figures())


@pytest.mark.parametrize("seed", range(3))
def test_any_rigid_motion_of_the_world_leaves_what_needs_no_floor(seed):
    world = imperfect(seed)
    turn = se3.quat_to_matrix(se3.exp(np.array([0.5, -0.8, 0.3])))
    moved = transform(world, lambda p: p @ turn.T + 5.0, lambda r: turn @ r)
    floor = tuple(figure.name for figure in FIGURES if figure.needs_floor)
    before, after = world.figures(), moved.figures()
    assert_same(after, before, without=floor)
    changed = {name for name, value in before.items() if value is not None and value != pytest.approx(after[name])}
    assert changed == {name for name in floor if before[name] is not None}


@pytest.mark.parametrize("seed", range(5))
def test_mirrored_world_gives_the_same_figures(seed):
    """Reflect y of the world, swap sides; local frames are reflected in their own left-right axis."""
    world = imperfect(seed)
    flip_x, flip_y = np.diag([-1.0, 1.0, 1.0]), np.diag([1.0, -1.0, 1.0])

    def other(name):
        swap = {"left": "right", "right": "left"}
        side, _, rest = name.partition("_")
        return f"{swap[side]}_{rest}" if side in swap else name

    # The left-right axis is x in the human's frames, y in the robot's; for objects any axis will do.
    mirrored = transform(world, lambda p: p @ flip_y, lambda r: flip_y @ r @ flip_y, lambda p: p @ flip_y)
    person = world.clip.people[0]
    order = [JOINTS.index(other(name)) for name in JOINTS]
    turns = flip_y @ se3.quat_to_matrix(person.joint_quats) @ flip_x
    people = (Person("mirrored", (person.joint_positions @ flip_y)[:, order], se3.matrix_to_quat(turns)[:, order]),)
    contacts = tuple(dataclasses.replace(track, part=other(track.part)) for track in mirrored.clip.contacts)
    kinematics = mirrored.kinematics
    mirrored = edit_kinematics(
        mirrored,
        points={other(name): place for name, place in kinematics.points.items()},
        rotations={other(name): turn for name, turn in kinematics.rotations.items()},
    )
    mirrored = edit_motion(
        edit_clip(mirrored, people=people, contacts=contacts), stance_flags=world.motion.stance_flags[:, ::-1]
    )
    assert_same(mirrored.figures(), world.figures())


@pytest.mark.parametrize("seed", range(5))
def test_constant_offset_of_hand_frames_cancels(seed):
    world, rng = imperfect(seed), np.random.default_rng(seed)
    rotations = {
        name: turn @ se3.quat_to_matrix(se3.exp(rng.normal(size=3))) if "palm" in name else turn
        for name, turn in world.kinematics.rotations.items()
    }
    assert_same(edit_kinematics(world, rotations=rotations).figures(), world.figures())


def test_hand_rotation_is_written_in_the_object_frame():
    """Both hands and both objects ride on one turntable: nothing changes relative to the object."""
    world = make_world()
    table = se3.quat_to_matrix(se3.exp(np.linspace(0, 2, FRAMES)[:, None] * np.array([0.3, 0.5, 0.9])))
    rotations = {name: table @ turn if "palm" in name else turn for name, turn in world.kinematics.rotations.items()}
    quats = se3.matrix_to_quat(table @ se3.quat_to_matrix(world.motion.object_quat[:, 0]))[:, None]
    turned = edit_motion(edit_kinematics(world, rotations=rotations), object_quat=quats)
    assert turned.figures()["relative_hand_rotation_deg"] == pytest.approx(0.0, abs=1e-5)


def test_time_may_run_backwards():
    """Whatever has no first frame of its own is the same for the reversed recording."""
    world = imperfect(3)
    # One object rotation throughout: a backward difference is written in the frame of its later end.
    still = se3.IDENTITY_QUAT * np.ones((FRAMES, 1, 1))
    world = edit_motion(world, object_quat=still)
    world = edit_clip(world, objects=(dataclasses.replace(world.clip.objects[0], quats=still[:, 0]),))
    person, track = world.clip.people[0], world.clip.objects[0]
    kinematics, motion = world.kinematics, world.motion
    backwards = World(
        dataclasses.replace(
            world.clip,
            people=(Person("a", person.joint_positions[::-1], person.joint_quats[::-1]),),
            objects=(ObjectTrack("o", track.positions[::-1], track.quats[::-1], track.geometry),),
            contacts=tuple(
                ContactTrack(c.person, c.object, c.part, c.active[::-1], c.contact_points[::-1])
                for c in world.clip.contacts
            ),
        ),
        dataclasses.replace(
            motion.with_qpos(motion.qpos[::-1]),
            object_pos=motion.object_pos[::-1],
            object_quat=motion.object_quat[::-1],
            stance_flags=motion.stance_flags[::-1],
        ),
        RobotPoses(
            {name: place[::-1] for name, place in kinematics.points.items()},
            {name: turn[::-1] for name, turn in kinematics.rotations.items()},
            kinematics.body_positions[::-1],
        ),
    )
    assert_same(backwards.figures(), world.figures(), without=("object_path_error_m", "relative_hand_rotation_deg"))


# Which frames, which person, which object


def spoil_first_frame(world: World) -> World:
    points = {name: place.copy() for name, place in world.kinematics.points.items()}
    for place in points.values():
        place[0] += np.array([1.0, -2.0, -3.0])
    bodies = world.kinematics.body_positions.copy()
    bodies[0] += 1.0
    objects = world.motion.object_pos.copy()
    objects[0] -= 4.0
    return edit_motion(edit_kinematics(world, points=points, body_positions=bodies), object_pos=objects)


def test_first_frame_of_the_source_does_not_count():
    world = edit_clip(imperfect(0), first_source_frame=0)
    assert_same(spoil_first_frame(world).figures(), world.figures())


@pytest.mark.parametrize("dropped", [1, 2])
def test_first_frame_counts_when_the_reader_dropped_earlier_ones(dropped):
    world = edit_clip(imperfect(0), first_source_frame=dropped)
    spoiled, good = spoil_first_frame(world).figures(), world.figures()
    assert spoiled["floor_penetration_max_m"] > good["floor_penetration_max_m"] + 2
    assert spoiled["object_path_error_m"] > good["object_path_error_m"] + 1


def test_limits_count_in_every_frame():
    world = make_world(first_source_frame=0)
    qpos = world.motion.qpos.copy()
    qpos[0, 7] = 1.25
    figures = edit_motion(world, stages=(Stage("trajectory", qpos),)).figures()
    assert figures["joint_range_margin_rad"] == pytest.approx(-0.25)
    assert figures["joint_speed_margin_radps"] == pytest.approx(5.0 - FPS * abs(qpos[1, 7] - 1.25))


def test_only_the_followed_person_counts():
    world = make_world(people=2)
    assert world.figures(0)["contact_gap_m"] == pytest.approx(0.0, abs=1e-9)
    assert world.figures(1)["contact_gap_m"] > 0.01
    only_other = edit_clip(world, contacts=tuple(track for track in world.clip.contacts if track.person == 1))
    assert only_other.figures(0)["contact_gap_m"] is None
    assert only_other.figures(1)["contact_gap_m"] is not None


def test_velocity_is_relative_to_the_object_touched_longest():
    world = make_world(objects=2)
    spoiled = world.motion.object_pos.copy()
    spoiled[:, 0] += smooth(np.random.default_rng(9), 3)
    on_first = edit_motion(world, object_pos=spoiled)
    assert on_first.figures()["link_velocity_direction_deg"] > 1.0
    contacts = tuple(dataclasses.replace(track, object=1) for track in world.clip.contacts)
    assert edit_clip(on_first, contacts=contacts).figures()["link_velocity_direction_deg"] == pytest.approx(0, abs=1e-5)
    # Untouched objects: the first one.
    assert edit_clip(on_first, contacts=()).figures()["link_velocity_direction_deg"] > 1.0


def test_undefined_figures_are_none():
    figures = edit_clip(make_world(), contacts=()).figures()
    assert figures["contact_gap_m"] is figures["contact_gap_p95_m"] is figures["contact_gap_max_m"] is None
    assert figures["hand_slip_mps"] is None
    assert figures["relative_hand_rotation_deg"] is None
    assert figures["link_velocity_direction_deg"] is not None
    figures = make_world(objects=0).figures()
    assert figures["object_below_floor_m"] is figures["object_float_m"] is figures["object_path_error_m"] is None
    assert figures["body_pose_deviation_deg"] is not None
    in_the_air = edit_motion(make_world(), stance_flags=np.zeros((FRAMES, 2), dtype=bool)).figures()
    assert (
        in_the_air["stance_slide_mps"] is in_the_air["stance_sole_height_abs_m"] is in_the_air["stance_float_m"] is None
    )
    assert in_the_air["floor_penetration_max_m"] is not None


def test_inputs_that_do_not_belong_together_are_refused():
    world = make_world()
    for changes in ({"fps": 25.0}, {"objects": world.clip.objects * 2}):
        with pytest.raises(ClipError, match="the motion has"):
            edit_clip(world, **changes).figures()
    shorter = {
        name: getattr(world.motion, name)[1:]
        for name, field in world.motion.__dataclass_fields__.items()
        if field.name != "object_scale" and isinstance(getattr(world.motion, name), np.ndarray)
    }
    stages = (Stage("trajectory", world.motion.qpos[1:]),)
    with pytest.raises(ClipError, match="39 frames, the clip 40"):
        edit_motion(world, stages=stages, **shorter).figures()
    with pytest.raises(RobotError, match="another order"):
        evaluate(edit_motion(world, joint_names=("b", "a")).motion, world.clip, world.kinematics.real().model)
    with pytest.raises(ArgumentError, match="no person 1"):
        world.figures(1)


# Errors planted in a perfect world come out as planted


def test_palm_one_centimetre_off_is_a_gap_of_one_centimetre():
    world = make_world()
    side = np.array([0.6, 0.0, 0.8]) * 0.01
    palms = {f"{s}_palm": world.kinematics.points[f"{s}_palm"] + side for s in SIDES}
    figures = move_sites(world, **palms).figures()
    assert figures["contact_gap_m"] == pytest.approx(0.01)
    assert figures["contact_gap_p95_m"] == pytest.approx(0.01)
    assert figures["contact_gap_max_m"] == pytest.approx(0.01)
    one_hand = move_sites(world, left_palm=palms["left_palm"]).figures()
    assert one_hand["contact_gap_m"] == pytest.approx(0.005)
    assert one_hand["contact_gap_max_m"] == pytest.approx(0.01)


def test_gap_is_measured_on_the_scaled_object():
    world = make_world()
    scale = np.array([0.8])
    palms = {}
    for track in world.clip.contacts:
        inside = np.nan_to_num(track.contact_points) * scale
        pose = world.clip.objects[0]
        palms[track.part.replace("hand", "palm")] = pose.positions + se3.rotate(pose.quats, inside)
    assert move_sites(edit_motion(world, object_scale=scale), **palms).figures()["contact_gap_m"] == pytest.approx(0.0)


def test_one_bone_turned_by_sixteen_degrees_is_a_mean_of_one():
    world = make_world()
    wrist, palm = world.kinematics.points["left_wrist"], world.kinematics.points["left_palm"]
    bone = palm - wrist
    axis = np.cross(bone, np.array([0.2, 0.3, 0.9]))
    axis *= np.radians(16.0) / np.linalg.norm(axis, axis=1, keepdims=True)
    figures = move_sites(world, left_palm=wrist + 1.3 * se3.rotate(se3.exp(axis), bone)).figures()
    assert figures["body_pose_deviation_deg"] == pytest.approx(1.0)


@pytest.mark.parametrize(("axis", "lean"), [((1.0, 0.0, 0.0), 36.0), ((0.0, 1.0, 0.0), 0.0), ((0.0, 0.0, 1.0), 0.0)])
def test_a_torso_turned_by_36_degrees_leans_only_when_it_rolls(axis, lean):
    """The person stands upright; the robot's axes are ahead, left and up."""
    world = make_world()
    person = world.clip.people[0]
    upright = se3.matrix_to_quat(np.tile(HUMAN_TO_ROBOT_AXES.T, (FRAMES, person.joint_quats.shape[1], 1, 1)))
    world = edit_clip(world, people=(Person(person.name, person.joint_positions, upright),))
    torso = np.zeros((FRAMES, 3, 3))
    torso[:] = se3.quat_to_matrix(se3.exp(np.radians(36.0) * np.array(axis)))
    torso[30:] = np.eye(3)
    rotations = {**world.kinematics.rotations, "torso": torso, "pelvis": np.tile(np.eye(3), (FRAMES, 1, 1))}
    figures = edit_kinematics(world, rotations=rotations).figures()
    assert figures["trunk_deviation_deg"] == pytest.approx(36.0 * 30 / FRAMES, abs=1e-6)
    assert figures["trunk_deviation_p95_deg"] == pytest.approx(36.0, abs=1e-6)
    assert figures["trunk_deviation_max_deg"] == pytest.approx(36.0, abs=1e-6)
    assert figures["trunk_lean_p95_deg"] == pytest.approx(lean, abs=1e-6)


def test_hips_that_roll_under_a_straight_chest_lean():
    world = make_world()
    person = world.clip.people[0]
    upright = se3.matrix_to_quat(np.tile(HUMAN_TO_ROBOT_AXES.T, (FRAMES, person.joint_quats.shape[1], 1, 1)))
    world = edit_clip(world, people=(Person(person.name, person.joint_positions, upright),))
    straight = np.tile(np.eye(3), (FRAMES, 1, 1))
    rolled = straight @ se3.quat_to_matrix(se3.exp(np.radians(12.3) * np.array([1.0, 0.0, 0.0])))
    rotations = {**world.kinematics.rotations, "torso": straight, "pelvis": rolled}
    figures = edit_kinematics(world, rotations=rotations).figures()
    assert figures["trunk_deviation_deg"] == pytest.approx(0.0, abs=1e-6)
    assert figures["trunk_lean_p95_deg"] == pytest.approx(12.3, abs=1e-6)


def test_velocity_direction_counts_only_what_moves():
    world = edit_clip(make_world(), contacts=())
    t = np.arange(FRAMES)[:, None] / FPS
    person = world.clip.people[0]
    resting = np.tile(person.joint_positions[:1], (FRAMES, 1, 1))
    ahead, aside = np.array([0.1, 0, 0]), 0.1 * np.array([np.cos(np.radians(30)), np.sin(np.radians(30)), 0])
    resting[:, JOINTS.index("head")] += t * ahead
    resting[:, JOINTS.index("left_ankle")] += t * ahead
    resting[:, JOINTS.index("pelvis")] += t * 0.019 * np.array([1.0, 0, 0])
    still = ObjectTrack(
        "o", np.zeros((FRAMES, 3)), np.tile(se3.IDENTITY_QUAT, (FRAMES, 1)), ObjectGeometry(np.zeros((1, 3)))
    )
    world = edit_clip(world, people=(Person("a", resting, person.joint_quats),), objects=(still,))
    world = edit_motion(world, object_pos=still.positions[:, None], object_quat=still.quats[:, None])
    # The robot's pelvis is fast enough but the human's is not, and the other way round the left ankle.
    slow = t * np.array([0.0, 0.019, 0.0])
    world = move_sites(world, head=t * aside, pelvis=t * np.array([0.0, 1.0, 0.0]), left_foot=slow)
    assert world.figures()["link_velocity_direction_deg"] == pytest.approx(30.0)
    # Without objects velocities are those in the world, as relative to an object that rests there.
    alone = edit_clip(world, objects=())
    nothing = {"object_pos": np.zeros((FRAMES, 0, 3)), "object_quat": np.zeros((FRAMES, 0, 4))}
    flags = world.motion.contact_flags
    nobody = {"contact_flags": np.zeros_like(flags), "contact_object": np.full(flags.shape, -1)}
    alone = edit_motion(alone, **nothing, **nobody, object_names=(), object_scale=np.zeros(0))
    assert alone.figures()["link_velocity_direction_deg"] == pytest.approx(30.0)


def test_velocity_is_written_in_the_axes_of_the_later_frame():
    """A head that always steps ahead as its turning object sees it, beside one whose object does not turn."""
    world = edit_clip(make_world(), contacts=())
    person, step = world.clip.people[0], np.array([0.01, 0.0, 0.0])
    turning = se3.exp(np.linspace(0, 3, FRAMES)[:, None] * np.array([0.0, 0.0, 1.0]))
    places = np.tile(person.joint_positions[:1], (FRAMES, 1, 1))
    places[1:, JOINTS.index("head")] += np.cumsum(se3.rotate(turning[1:], step), axis=0)
    still = np.zeros((FRAMES, 3))
    track = ObjectTrack("o", still, turning, ObjectGeometry(np.zeros((1, 3))))
    world = edit_clip(world, people=(Person("a", places, person.joint_quats),), objects=(track,))
    world = edit_motion(world, object_pos=still[:, None], object_quat=np.tile(se3.IDENTITY_QUAT, (FRAMES, 1, 1)))
    world = move_sites(world, head=np.arange(FRAMES)[:, None] * step)
    assert world.figures()["link_velocity_direction_deg"] == pytest.approx(0.0, abs=1e-6)


def test_hand_turned_after_the_first_contact_frame():
    world = make_world()
    rotations = dict(world.kinematics.rotations)
    extra = np.zeros((FRAMES, 3))
    extra[SEGMENT.start + 1 :, 1] = np.radians(10.0)
    for side in SIDES:
        rotations[f"{side}_palm"] = rotations[f"{side}_palm"] @ se3.quat_to_matrix(se3.exp(extra))
    # 10 degrees in all but the first of 20 frames; nothing changes within the second segment of 3 frames.
    expected = 10.0 * 19 / 23
    assert edit_kinematics(world, rotations=rotations).figures()["relative_hand_rotation_deg"] == pytest.approx(
        expected
    )


def with_bodies(curve: np.ndarray) -> Mapping:
    return edit_kinematics(make_world(), body_positions=np.stack([curve, curve], axis=1)).figures()


def test_jerk_of_a_cubic_is_its_third_derivative():
    t = np.arange(FRAMES)[:, None] / FPS
    figures = with_bodies(t**3 / 6.0 * np.array([12.0, 0.0, -16.0]) + t**2 - 3 * t)
    assert figures["body_jerk_mps3"] == pytest.approx(20.0)
    assert figures["body_jerk_max_mps3"] == pytest.approx(20.0)


def test_jerk_of_constant_acceleration_is_zero():
    t = np.arange(FRAMES)[:, None] / FPS
    figures = with_bodies(0.5 * t**2 * np.array([9.81, -3.0, 1.0]) + t)
    assert figures["body_jerk_max_mps3"] == pytest.approx(0.0, abs=1e-8)


def test_planted_slide_counts_only_in_stance_and_only_horizontally():
    world = make_world()
    t = np.arange(FRAMES)[:, None] / FPS
    stance = world.motion.stance_flags[:, 0]
    jumps = np.where(stance, 0.0, 5.0)[:, None]
    left = t * np.array([0.03, 0.04, 2.0]) + jumps
    moved = move_sites(world, left_foot=left, right_foot=np.zeros((FRAMES, 3)))
    pairs = [np.count_nonzero(f[1:] & f[:-1]) for f in world.motion.stance_flags.T]
    assert moved.figures()["stance_slide_mps"] == pytest.approx(0.05 * pairs[0] / sum(pairs))


@pytest.mark.parametrize("first_source_frame", [0, 1])
def test_stance_flags_belong_to_their_frames(first_source_frame):
    stance = np.zeros((FRAMES, 2), dtype=bool)
    stance[20:22, 1] = True
    world = edit_motion(make_world(first_source_frame=first_source_frame), stance_flags=stance)
    foot = world.kinematics.points["right_foot"]
    soles = [world.kinematics.points[f"right_sole_{corner}"][:, 2] for corner in SOLE_CORNERS]
    figures = world.figures()
    assert figures["stance_slide_mps"] == pytest.approx(FPS * np.linalg.norm((foot[21] - foot[20])[:2]))
    assert figures["stance_float_m"] == pytest.approx(np.maximum(np.min(soles, axis=0), 0)[20:22].mean())


@pytest.mark.parametrize(("height", "penetration", "floating"), [(-0.005, 0.005, 0.0), (0.004, 0.0, 0.004)])
def test_planted_sole_height(height, penetration, floating):
    world = make_world()
    soles = {}
    for side in SIDES:
        for corner in SOLE_CORNERS:
            place = world.kinematics.points[f"{side}_sole_{corner}"].copy()
            place[:, 2] = height if corner == "toe_outer" else height + 0.01
            soles[f"{side}_sole_{corner}"] = place
    figures = move_sites(world, **soles).figures()
    assert figures["floor_penetration_max_m"] == pytest.approx(penetration)
    assert figures["stance_sole_height_abs_m"] == pytest.approx(abs(height))
    assert figures["stance_float_m"] == pytest.approx(floating)


def test_object_sunk_seven_millimetres():
    world = make_world()
    half, scale = np.array([0.2, 0.1, 0.3]), 0.5
    corners = half * np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    box = dataclasses.replace(world.clip.objects[0], geometry=ObjectGeometry(corners))
    world = edit_clip(world, objects=(box,))
    # On its side: y is vertical.
    quats = np.tile(se3.exp(np.array([np.pi / 2, 0, 0])), (FRAMES, 1, 1))
    places = np.full((FRAMES, 1, 3), 0.5 * 0.1)
    for sunk, expected in ((0.0, 0.0), (0.007, 0.007)):
        places[20, 0, 2] = 0.05 - sunk
        moved = edit_motion(world, object_pos=places, object_quat=quats, object_scale=np.array([scale]))
        assert moved.figures()["object_below_floor_m"] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("height", [-0.01, 0.0, 0.007, 0.06])
def test_a_box_that_floats_while_the_humans_rests(height):
    """Only frames count in which the human's box is still, untouched and near the floor."""
    world = make_world()
    half = np.array([0.2, 0.1, 0.3])
    corners = half * np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    upright = np.tile(se3.IDENTITY_QUAT, (FRAMES, 1))
    lift = np.zeros(FRAMES)
    lift[SEGMENT] = 0.5  # Carried by both hands; on the floor again until it is lifted once more.
    lift[36:] = 0.4
    places = np.outer(lift + half[2], [0.0, 0.0, 1.0])
    box = dataclasses.replace(world.clip.objects[0], positions=places, quats=upright, geometry=hull(corners))
    robot = places + np.array([0.0, 0.0, height])
    robot[SEGMENT] += 5.0
    robot[33:] += 5.0  # Contact frames, and those in the air without one.
    world = edit_motion(edit_clip(world, objects=(box,)), object_pos=robot[:, None], object_quat=upright[:, None])
    assert world.figures()["object_float_m"] == pytest.approx(max(height, 0.0), abs=1e-9)
    on_a_table = edit_clip(world, objects=(dataclasses.replace(box, positions=places + np.array([0.0, 0.0, 0.7])),))
    assert on_a_table.figures()["object_float_m"] is None


def test_the_object_that_floats_most_counts():
    world = make_world(objects=2)
    still = np.tile(se3.IDENTITY_QUAT, (FRAMES, 1))
    cube = hull(0.1 * np.array(np.meshgrid([-1, 1], [-1, 1], [0, 2])).reshape(3, -1).T)
    at = np.zeros((2, FRAMES, 3))
    at[1, :, 0] = 1.0
    boxes = tuple(
        dataclasses.replace(track, positions=place, quats=still, geometry=cube)
        for track, place in zip(world.clip.objects, at, strict=True)
    )
    moved = at + np.array([0.002, 0.03])[:, None, None] * [0.0, 0.0, 1.0]
    world = edit_motion(
        edit_clip(world, objects=boxes, contacts=()),
        object_pos=moved.swapaxes(0, 1),
        object_quat=np.stack([still, still], axis=1),
    )
    assert world.figures()["object_float_m"] == pytest.approx(0.03)


def test_object_path_shrunk_to_four_fifths():
    world = make_world()
    path = world.clip.objects[0].positions
    expected = 0.2 * np.linalg.norm(path - path[:1], axis=1).mean()
    figures = edit_motion(world, object_pos=0.8 * path[:, None] + 1.0).figures()
    assert figures["object_path_error_m"] == pytest.approx(expected)


# Contacts that were not reached


def test_perfect_world_has_no_unreached_contact():
    world = make_world()
    assert unreached_contacts(world.motion, world.kinematics.real()) == ()


def test_unreached_segment_is_named_with_its_residual():
    world = make_world()
    palm = world.kinematics.points["right_palm"].copy()
    palm[SEGMENT] += np.array([0.0, 0.03, 0.0])
    palm[SEGMENT.start] += np.array([0.0, 0.03, 0.0])
    world = move_sites(world, right_palm=palm)
    (segment,) = unreached_contacts(world.motion, world.kinematics.real())
    assert (segment.subject, segment.object) == ("right_palm", "object0")
    assert (segment.first_frame, segment.last_frame) == (SEGMENT.start, SEGMENT.stop - 1)
    assert segment.mean == pytest.approx((19 * 0.03 + 0.06) / 20)  # 3.15 cm
    assert segment.value == pytest.approx(0.06)
    assert "right_palm on 'object0', frames 8 to 27: 3.2 cm" in str(segment)
    assert unreached_contacts(world.motion, world.kinematics.real(), limit_m=0.04) == ()
    parts = edit_motion(world, contact_links=HANDS)
    assert [s.subject for s in unreached_contacts(parts.motion, parts.kinematics.real())] == ["right_hand"]


def test_a_stretch_of_a_long_contact_is_not_hidden_by_the_rest_of_it():
    world = make_world()
    palm = world.kinematics.points["right_palm"].copy()
    palm[SEGMENT.start + 4 : SEGMENT.start + 7] += np.array([0.0, 0.03, 0.0])
    (stretch,) = unreached_contacts(world.motion, move_sites(world, right_palm=palm).kinematics.real())
    assert (stretch.first_frame, stretch.last_frame) == (SEGMENT.start + 4, SEGMENT.start + 6)
    assert stretch.mean == pytest.approx(0.03)
    palm[SEGMENT.start + 5] = world.kinematics.points["right_palm"][SEGMENT.start + 5]
    assert unreached_contacts(world.motion, move_sites(world, right_palm=palm).kinematics.real()) == ()


def test_change_of_object_starts_a_new_segment():
    world = make_world(objects=2)
    touched = world.motion.contact_object.copy()
    touched[18:28] = 1
    segments = unreached_contacts(edit_motion(world, contact_object=touched).motion, world.kinematics.real())
    assert [(s.subject, s.object, s.first_frame, s.last_frame) for s in segments] == [
        ("left_palm", "object1", 18, 27),
        ("right_palm", "object1", 18, 27),
    ]


# Tables


def scores() -> tuple[Score, ...]:
    with_contact = dict(imperfect(0).figures())
    without = dict(edit_clip(imperfect(1), contacts=()).figures())
    return Score("one", with_contact, FRAMES, 2.0), Score("two", without, FRAMES)


def test_every_figure_has_one_column():
    assert [column.name for column in COLUMNS] == [*(figure.name for figure in (*FIGURES, *PERFORMED)), "compute_s"]


SHOWN = {
    ("m", "mm"): 1e3,
    ("m", "cm"): 1e2,
    ("mps", "mm/s"): 1e3,
    ("mps", "cm/s"): 1e2,
    ("share", "%"): 1e2,
    **dict.fromkeys(
        (("deg", "deg"), ("rad", "rad"), ("radps", "rad/s"), ("mps3", "m/s^3"), ("s", "s"), ("g", "g")), 1.0
    ),
}
"""Shown number over stored number, by the unit at the end of a figure's name and the one that tables show."""


@pytest.mark.parametrize("figure", COLUMNS, ids=lambda figure: figure.name)
def test_numbers_are_shown_in_the_unit_beside_them(figure):
    stored = 25.0
    shown = float(figure.text(stored))
    assert shown == pytest.approx(stored * SHOWN[figure.name.rpartition("_")[2], figure.unit], abs=10.0**-figure.digits)
    assert figure.text(None) == "-" and figure.header.endswith(f"[{figure.unit}]")


def test_mean_ignores_what_is_undefined_and_worst_knows_the_direction():
    one, two = scores()
    mean, worst = mean_values((one, two)), worst_values((one, two))
    assert mean["contact_gap_m"] == one.figures["contact_gap_m"]
    assert mean["compute_s"] == 2.0
    assert mean["body_jerk_mps3"] == pytest.approx((one.figures["body_jerk_mps3"] + two.figures["body_jerk_mps3"]) / 2)
    assert worst["body_jerk_mps3"] == max(one.figures["body_jerk_mps3"], two.figures["body_jerk_mps3"])
    margins = [score.figures["joint_range_margin_rad"] for score in (one, two)]
    assert worst["joint_range_margin_rad"] == min(margins)
    assert mean_values((two,))["contact_gap_m"] is None
    assert mean_values(()) == worst_values(()) == dict.fromkeys((column.name for column in COLUMNS), None)


def test_json_and_csv_hold_the_stored_numbers():
    one, two = scores()
    document = json.loads(to_json((one, two)))
    assert document["clips"] == 2
    assert document["per_clip"][0] == {**one.facts(), **one.values()}
    assert document["per_clip"][1]["contact_gap_m"] is None
    assert document["mean"] == mean_values((one, two))
    rows = list(csv.DictReader(io.StringIO(to_csv((one, two)))))
    assert [row["name"] for row in rows] == ["one", "two", "mean", "worst"]
    assert float(rows[0]["contact_gap_m"]) == one.figures["contact_gap_m"]
    assert rows[1]["contact_gap_m"] == ""


def test_table_rows_are_as_long_as_their_header():
    rows = table_rows(scores())
    assert {len(row) for row in rows} == {6 + len(COLUMNS)}
    assert rows[0][:7] == ("clip", "robot", "object scale", "frames", "motion", "physics", "contact gap [mm]")
    assert [row[0] for row in rows[1:]] == ["one", "two", "mean", "worst"]
    assert rows[2][4:7] == ("-", "-", "-")
    assert len(table_rows(scores()[:1])) == 2


def test_the_figures_of_a_table_come_in_groups_touch_first_and_each_once():
    surfaces, landmarks = (
        [dataclasses.replace(score, at_landmarks=at_landmarks) for score in scores()] for at_landmarks in (False, True)
    )
    assert list(grouped_columns(surfaces)) == ["figure", "further figures", "paper's figures"]
    assert list(grouped_columns(surfaces, every=False)) == ["figure"]
    assert list(grouped_columns(landmarks, every=False)) == ["paper's figures", "figure"]
    for results in (surfaces, landmarks):
        shown = [column.name for columns in grouped_columns(results).values() for column in columns]
        filled = {name for score in results for name, value in score.values().items() if value is not None}
        assert len(shown) == len(set(shown)) and set(shown) == filled & {column.name for column in COLUMNS}


def test_runs_of_one_clip_can_be_told_apart():
    figures = scores()[0].figures
    g1 = Score("one", figures, FRAMES, file="a/one.npz", robot="g1", root_scale=0.75, object_scale=(0.5,))
    h2 = Score("one", figures, FRAMES, file="b/one.npz", robot="h2", object_scale=(1.0, 0.25))
    rows = table_rows((g1, h2))
    assert [row[:3] for row in rows[1:3]] == [("a/one.npz", "g1", "0.500"), ("b/one.npz", "h2", "1.000 0.250")]
    assert table_rows((g1,))[1][0] == "one"
    first, second = json.loads(to_json((g1, h2)))["per_clip"]
    assert (first["file"], first["robot"], first["root_scale"], first["object_scale"]) == (
        "a/one.npz",
        "g1",
        0.75,
        [0.5],
    )
    assert second["object_scale"] == [1.0, 0.25]
    table = list(csv.DictReader(io.StringIO(to_csv((g1, h2)))))
    assert [row["robot"] for row in table] == ["g1", "h2", "", ""]
    assert [row["object_scale"] for row in table[:2]] == ["0.5", "1.0 0.25"]


# The robots themselves


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_robots_offer_what_the_figures_need(name):
    """A robot that stands still: every figure is defined, limits hold, links do not move."""
    model, world = load_robot(name), make_world()
    qpos = np.tile(model.home_qpos, (FRAMES, 1))
    motion = dataclasses.replace(
        world.motion, robot=name, joint_names=model.joint_names, stages=(Stage("trajectory", qpos),)
    )
    figures = evaluate(motion, world.clip, model)
    # A link that stands still has no direction to compare; relative to a moving object it does.
    undefined = {name for name, value in figures.items() if value is None}
    alone, unedited = penetration.robot_penetration_max_m, contact_figures.recorded_place_m
    feet = contact_figures.foot_touch_share, contact_figures.foot_touch_gap_p95_m
    rests = contact_figures.rest_share, contact_figures.rest_gap_p95_m
    others = {figure.name for figure in (*feet, *rests, alone, unedited)}
    of_fingers = OF_FINGERS - {"finger_depth_max_m"} if model.spec.fingers else OF_FINGERS
    assert undefined == others | OF_HOLDS | OF_STACKS | OF_COUPLINGS | of_fingers
    assert figures["body_jerk_max_mps3"] == pytest.approx(0.0, abs=1e-8)
    assert figures["stance_slide_mps"] == pytest.approx(0.0, abs=1e-12)
    assert figures["joint_range_margin_rad"] >= 0.0
    assert figures["joint_speed_margin_radps"] == pytest.approx(model.speed_limits.min())
    assert unreached_contacts(motion, model.forward(qpos))
