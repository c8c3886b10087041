"""What is drawn: where MuJoCo has it, where the contact is, and the same whoever stands beside it."""

from dataclasses import replace
from itertools import pairwise

import mujoco
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import ArgumentError
from hoi_retarget.evaluation.surface_distances import distances_of_motion
from hoi_retarget.human.body_model import BodyShape
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, PARENT
from hoi_retarget.motion.motion import Motion, Stage
from hoi_retarget.motion.motion_report import Report
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import Surface, surface_of
from hoi_retarget.readers.body_parameters import load_body_model
from hoi_retarget.robots import ROBOTS
from hoi_retarget.studio.scene.drawing import Kind, Lines, Solid
from hoi_retarget.studio.scene.marks import gap_colour, rotations_to
from hoi_retarget.studio.scene.robot_shapes import AXIS_LENGTH, decimated
from hoi_retarget.studio.scene.scene import SceneItem, group_by_shared_objects, make_scene
from source_people import write_models
from synthetic import make
from trajectories import MODELS, random_qpos

CLIPS = {name: make(name, seconds=0.5, fps=10.0) for name in ("carry_box", "carry_table")}
G1 = MODELS["unitree_g1"]
seeds = st.integers(0, 2**32 - 1)
few = settings(deadline=None, max_examples=4)


def moved_clip(clip: Clip, shift: np.ndarray) -> Clip:
    people = tuple(replace(person, joint_positions=person.joint_positions + shift) for person in clip.people)
    objects = tuple(replace(track, positions=track.positions + shift) for track in clip.objects)
    return replace(clip, people=people, objects=objects)


def motion_of(clip: Clip, seed: int, *, person: int = 0, model=G1, shift=(0.0, 0.0, 0.0)) -> Motion:
    """A random motion beside the clip's objects, that touches them now and then."""
    rng = np.random.default_rng(seed)
    frames = clip.frames
    links = tuple(model.spec.part_sites.values())
    flags = rng.random((frames, len(links))) < 0.6
    positions = np.stack([track.positions for track in clip.objects], axis=1)
    qpos = random_qpos(model, frames, rng)
    return Motion(
        robot=model.spec.name,
        fps=clip.fps,
        joint_names=model.joint_names,
        stages=(
            Stage("ik", random_qpos(model, frames, rng)),
            Stage("trajectory", qpos + np.concatenate([shift, np.zeros(model.nv + 1 - 3)])),
        ),
        object_names=tuple(track.name for track in clip.objects),
        object_pos=positions + shift,
        object_quat=np.stack([track.quats for track in clip.objects], axis=1),
        object_scale=np.full(len(clip.objects), 0.8),
        contact_links=links,
        contact_flags=flags,
        contact_object=np.where(flags, 0, -1),
        contact_points=np.where(flags[..., None], rng.normal(size=(frames, len(links), 3)), np.nan),
        stance_flags=rng.random((frames, 2)) < 0.5,
        first_source_frame=0,
        human_height=1.75,
        report=Report(clip.name, person, clip.source),
    )


def shown(seed: int, name: str = "carry_box", *, person: int = 0, clip: Clip | None = None) -> SceneItem:
    clip = clip or CLIPS[name]
    return SceneItem(f"result {seed}", motion_of(clip, seed, person=person), G1, clip, person)


def layer_of(subject, name):
    (found,) = (layer for layer in subject.layers if layer.name == name)
    return found


def points_of(layer, frame=None) -> np.ndarray:
    """Every place that a layer's parts are drawn at, in all frames or one: (K, 3)."""
    arrays = []
    for part in layer.parts:
        for array in (part.starts, part.ends) if isinstance(part, Lines) else (part.positions,):
            arrays.append((array if frame is None else array[frame]).reshape(-1, 3))
    return np.concatenate(arrays) if arrays else np.zeros((0, 3))


# the robot is where MuJoCo has it


def expected_shapes(compiled, data):
    """Return, by kind, the half extents, places and rotations of MuJoCo's geometries, capsules as three shapes."""
    found = {kind: [] for kind in Kind}
    for geom in range(compiled.ngeom):
        size, place, turn = compiled.geom_size[geom], data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
        along = turn[:, 2] * size[1]
        match compiled.geom_type[geom]:
            case mujoco.mjtGeom.mjGEOM_CAPSULE:
                found[Kind.CYLINDER].append(((size[0], size[0], size[1]), place, turn))
                found[Kind.SPHERE] += [((size[0],) * 3, place + along, turn), ((size[0],) * 3, place - along, turn)]
            case mujoco.mjtGeom.mjGEOM_CYLINDER:
                found[Kind.CYLINDER].append(((size[0], size[0], size[1]), place, turn))
            case mujoco.mjtGeom.mjGEOM_SPHERE:
                found[Kind.SPHERE].append(((size[0],) * 3, place, turn))
            case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
                found[Kind.SPHERE].append((size, place, turn))
            case mujoco.mjtGeom.mjGEOM_BOX:
                found[Kind.BOX].append((size, place, turn))
    return found


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("layer", ["robot", "inverse kinematics"])
@few
@given(seed=seeds)
def test_every_shape_of_the_robot_is_where_mujoco_has_it(name, layer, seed):
    model = MODELS[name]
    motion = motion_of(CLIPS["carry_box"], seed, model=model)
    (subject,) = make_scene([SceneItem("one", motion, model)]).subjects
    compiled = mujoco.MjModel.from_xml_path(str(model.spec.mjcf))
    data = mujoco.MjData(compiled)
    frame = seed % motion.frames
    data.qpos[:] = (motion.qpos if layer == "robot" else motion.stages[0].qpos)[frame]
    mujoco.mj_kinematics(compiled, data)
    expected = expected_shapes(compiled, data)
    parts = layer_of(subject, layer).parts
    assert [part.kind for part in parts] == [kind for kind in Kind if expected[kind]]
    for part in parts:
        sizes, places, turns = (np.array(column) for column in zip(*expected[part.kind], strict=True))
        np.testing.assert_allclose(part.sizes, sizes, atol=1e-7)
        np.testing.assert_allclose(part.positions[frame], places, atol=1e-6)
        np.testing.assert_allclose(se3.quat_to_matrix(part.quats[frame].astype(float)), turns, atol=1e-6)


def test_the_robot_has_the_colours_of_its_description():
    (subject,) = make_scene([SceneItem("one", motion_of(CLIPS["carry_box"], 0), G1)]).subjects
    colours = {tuple(colour) for part in layer_of(subject, "robot").parts for colour in part.colours.tolist()}
    assert colours == {(199, 201, 204), (33, 33, 38), (8, 10, 15)}


def write_tetrahedron(path, corners):
    """Write a binary STL file of four triangles."""
    triangles = corners[[[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]].astype("<f4")
    records = np.zeros(4, dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    records["corners"] = triangles
    path.write_bytes(bytes(80) + np.uint32(4).tobytes() + records.tobytes())


def test_the_vendor_meshes_are_where_their_bodies_are(tmp_path):
    rng = np.random.default_rng(0)
    corners = {}
    for name in (name for files in G1.spec.meshes.values() for name in files):
        corners[name] = rng.uniform(0.01, 0.02, 3) + 0.1 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
        write_tetrahedron(tmp_path / name, corners[name])
    motion = motion_of(CLIPS["carry_box"], 4)
    layer = layer_of(make_scene([SceneItem("one", motion, G1, meshes=tmp_path)]).subjects[0], "robot")
    assert len(layer.parts) == len(corners) and all(isinstance(part, Solid) for part in layer.parts)
    compiled = mujoco.MjModel.from_xml_path(str(G1.spec.mjcf))
    data = mujoco.MjData(compiled)
    data.qpos[:] = motion.qpos[3]
    mujoco.mj_kinematics(compiled, data)
    drawn = [part.positions[3] + se3.rotate(part.quats[3].astype(float), part.vertices) for part in layer.parts]
    for body, files in G1.spec.meshes.items():
        for name in files:
            site = f"mesh_{name.removesuffix('.STL')}"
            sites = [compiled.site(index).name for index in range(compiled.nsite)]
            place = data.site(site) if site in sites else data.body(body)
            world = place.xpos + corners[name] @ place.xmat.reshape(3, 3).T
            nearest = min(np.abs(np.sort(points, axis=0) - np.sort(world, axis=0)).max() for points in drawn)
            assert nearest < 1e-5, name


# contacts and stance


@few
@given(seed=seeds)
def test_contacts_are_patches_on_the_surface_and_balls_at_the_robots_links(seed):
    item = shown(seed)
    motion, clip = item.motion, item.clip
    (subject,) = make_scene([item]).subjects
    patches, balls, lines = layer_of(subject, "contacts").parts
    kinematics = G1.forward(motion.qpos)
    surface = surface_of(clip.objects[0].geometry)
    for frame in range(motion.frames):
        links = np.flatnonzero(motion.contact_flags[frame])
        turn = se3.quat_to_matrix(motion.object_quat[frame, 0])
        targets = np.array([turn @ motion.contact_points[frame, link] for link in links]).reshape(-1, 3)
        targets += motion.object_pos[frame, 0]
        sites = [kinematics.site_position(motion.contact_links[link])[frame] for link in links]
        there = patches.visible[frame]
        within = (patches.positions[frame][there] - motion.object_pos[frame, 0]) @ turn / motion.object_scale[0]
        assert surface.distances(within.astype(float)).max(initial=0.0) < 1e-5
        nearest = motion.contact_points[frame, links] / motion.object_scale[0]
        np.testing.assert_allclose(within, surface.closest_points(nearest), atol=1e-5)
        normals = se3.quat_to_matrix(patches.quats[frame][there].astype(float))[..., 2] @ turn
        np.testing.assert_allclose(normals, surface.normals(nearest), atol=1e-5)
        np.testing.assert_allclose(balls.positions[frame][balls.visible[frame]], np.reshape(sites, (-1, 3)), atol=1e-5)
        np.testing.assert_allclose(lines.starts[frame][lines.visible[frame]], targets, atol=1e-5)
        np.testing.assert_allclose(lines.ends[frame][lines.visible[frame]], np.reshape(sites, (-1, 3)), atol=1e-5)
        gaps = np.linalg.norm(targets - np.reshape(sites, (-1, 3)), axis=1)
        for part in (patches, balls):
            colours = part.colours[part.visible[frame]].astype(int)
            np.testing.assert_allclose(colours, gap_colour(gaps), atol=35, err_msg="to the nearest level")


@few
@given(seed=seeds)
def test_contacts_of_surfaces_have_the_colour_of_the_skins_distance(seed):
    item = shown(seed)
    kinematics = G1.forward(item.motion.qpos)
    sites = np.stack([kinematics.site_position(link) for link in item.motion.contact_links], axis=1)
    away = sites - item.motion.object_pos[:, :1]
    on_palms = se3.rotate_inverse(np.broadcast_to(item.motion.object_quat[:, :1], (*away.shape[:2], 4)), away)
    motion = replace(item.motion, contact_points=on_palms, report=Report(config={"contact": "surface"}))
    _, gaps = distances_of_motion(motion, G1, tuple(track.geometry for track in item.clip.objects))
    (subject,) = make_scene([replace(item, motion=motion)]).subjects
    patches, balls, lines = layer_of(subject, "contacts").parts
    for frame in range(motion.frames):
        off = np.abs(gaps[frame, motion.contact_flags[frame]])
        np.testing.assert_array_equal(lines.colours[frame][lines.visible[frame]], gap_colour(off))
        for part in (patches, balls):
            assert np.abs(part.colours[part.visible[frame]].astype(int) - gap_colour(off)).max(initial=0) <= 35


@few
@given(seed=seeds)
def test_contacts_of_unknown_objects_are_balls_at_their_targets(seed):
    motion = motion_of(CLIPS["carry_box"], seed)
    (subject,) = make_scene([SceneItem("one", motion, G1)]).subjects
    targets, sites, lines = layer_of(subject, "contacts").parts
    for frame in range(motion.frames):
        drawn = targets.positions[frame][targets.visible[frame]]
        np.testing.assert_allclose(drawn, lines.starts[frame][lines.visible[frame]], atol=1e-6)
        assert targets.kind is sites.kind is Kind.SPHERE


@given(seed=seeds)
def test_patches_lie_flat_on_any_normal(seed):
    normals = np.random.default_rng(seed).normal(size=(6, 3))
    normals[:3] = [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1e-12, 0.0, -1.0]]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    turned = se3.quat_to_matrix(rotations_to(normals))
    np.testing.assert_allclose(turned[..., 2], normals, atol=1e-6)
    np.testing.assert_allclose(turned @ turned.swapaxes(1, 2), np.tile(np.eye(3), (6, 1, 1)), atol=1e-9)


def test_hands_can_be_looked_at_from_near():
    items = [shown(0, "carry_table", person=person) for person in (0, 1)]
    for item, subject in zip(items, make_scene([*items]).subjects, strict=True):
        kinematics = G1.forward(item.motion.qpos)
        assert set(subject.look_at_targets) == {"left hand", "right hand", "feet"}
        np.testing.assert_allclose(
            subject.look_at_targets["left hand"], kinematics.site_position("left_palm"), atol=1e-6
        )


def test_what_is_not_drawn_is_still_somewhere():
    patches, balls, lines = layer_of(make_scene([shown(3)]).subjects[0], "contacts").parts
    places = (patches.positions, patches.quats, balls.positions, lines.starts, lines.ends)
    assert all(np.isfinite(array).all() for array in places)


def test_a_motion_that_touches_nothing_has_no_contacts():
    motion = motion_of(CLIPS["carry_box"], 0)
    nothing = np.zeros_like(motion.contact_flags)
    motion = replace(motion, contact_flags=nothing, contact_object=np.where(nothing, 0, -1))
    assert layer_of(make_scene([SceneItem("one", motion, G1)]).subjects[0], "contacts").parts == ()


@given(a=st.floats(0.0, 0.2), b=st.floats(0.0, 0.2))
def test_larger_gaps_are_never_greener(a, b):
    near, far = gap_colour(np.array(sorted((a, b)))).astype(int)
    assert far[0] - far[1] >= near[0] - near[1]
    if max(a, b) <= 0.01:
        np.testing.assert_array_equal(near, far)


def test_gap_colours_begin_green_and_end_red():
    green, yellow, red = gap_colour(np.array([0.01, 0.03, 0.05])).astype(int)
    assert green[1] > 2 * green[0] and red[0] > 2 * red[1] and min(yellow[:2]) > 4 * yellow[2]
    np.testing.assert_array_equal(gap_colour(np.array([0.0, 1.0])), [green, red])


@few
@given(seed=seeds)
def test_stance_plates_surround_the_soles(seed):
    item = shown(seed)
    kinematics = G1.forward(item.motion.qpos)
    (plates,) = layer_of(make_scene([item]).subjects[0], "stance").parts
    np.testing.assert_array_equal(plates.visible, item.motion.stance_flags)
    for foot, side in enumerate(("left", "right")):
        for corner in ("heel_inner", "heel_outer", "toe_inner", "toe_outer"):
            away = kinematics.site_position(f"{side}_sole_{corner}") - plates.positions[:, foot]
            within = se3.rotate_inverse(plates.quats[:, foot].astype(float), away)
            assert (np.abs(within) <= plates.sizes[foot] + 1e-5).all()


# objects and humans


@few
@given(seed=seeds)
def test_objects_are_scaled_and_where_the_motion_has_them(seed):
    item = shown(seed, "carry_table")
    subject = make_scene([item]).subjects[0]
    for name, scale, positions in (
        ("object", 0.8, item.motion.object_pos[:, 0]),
        ("human's object", 1.0, item.clip.objects[0].positions),
    ):
        (solid,) = layer_of(subject, name).parts
        assert isinstance(solid, Solid)
        np.testing.assert_allclose(solid.vertices, scale * item.clip.objects[0].geometry.points)
        away = solid.positions - positions
        np.testing.assert_allclose(away, away[[0]].repeat(len(away), axis=0), atol=1e-5)


def test_an_object_of_unknown_shape_is_its_axes():
    motion = motion_of(CLIPS["carry_box"], 5)
    (axes,) = layer_of(make_scene([SceneItem("one", motion, G1)]).subjects[0], "object").parts
    turn = se3.quat_to_matrix(motion.object_quat[:, 0])
    tips = axes.positions + se3.rotate(axes.quats.astype(float), np.array([0.0, 0.0, 0.5 * AXIS_LENGTH]))
    np.testing.assert_allclose(tips, motion.object_pos + AXIS_LENGTH * turn.transpose(0, 2, 1), atol=1e-5)


def test_limbs_reach_from_joint_to_joint():
    person = CLIPS["carry_box"].people[0]
    (subject,) = make_scene([SceneItem("clip", clip=CLIPS["carry_box"])]).subjects
    limbs, rounded = layer_of(subject, "human").parts
    half = se3.rotate(limbs.quats.astype(float), limbs.sizes * [0.0, 0.0, 1.0])
    bones = [(joint, parent) for joint, parent in PARENT.items() if parent is not None]
    for index, (joint, parent) in enumerate(bones):
        start, end = person.position(parent), person.position(joint)
        np.testing.assert_allclose((limbs.positions - half)[:, index], start, atol=2e-3)
        np.testing.assert_allclose((limbs.positions + half)[:, index], end, atol=2e-3)
    np.testing.assert_allclose(rounded.positions[:, : len(JOINT_INDEX)], person.joint_positions, atol=1e-5)


def test_a_limb_that_points_straight_down_is_drawn():
    clip = CLIPS["carry_box"]
    places = clip.people[0].joint_positions.copy()
    elbow, wrist = JOINT_INDEX["left_elbow"], JOINT_INDEX["left_wrist"]
    places[:, wrist] = places[:, elbow] - [0.0, 0.0, 0.25]
    down = replace(clip, people=(replace(clip.people[0], joint_positions=places),))
    limbs, _ = layer_of(make_scene([SceneItem("clip", clip=down)]).subjects[0], "human").parts
    np.testing.assert_allclose(np.linalg.norm(limbs.quats, axis=-1), 1.0, atol=1e-6)


def test_a_known_skin_is_drawn_in_pieces_that_move_with_their_joints(tmp_path):
    clip = make("carry_box")
    folder = write_models(tmp_path, clip.people, "smplx", ["neutral"])
    person = clip.people[0]
    shape = BodyShape(load_body_model(folder, "neutral", "smplx"), np.zeros(10))
    subject = make_scene([SceneItem("clip", clip=replace(clip, people=(replace(person, shape=shape),)))]).subjects[0]
    pieces = layer_of(subject, "human").parts
    assert len(pieces) == len(JOINTS)
    for piece, joint in zip(pieces, JOINTS, strict=True):
        world = piece.positions[50] + se3.rotate(piece.quats[50], piece.vertices)
        rest = shape.rest_joints[JOINTS.index(joint)]
        expected = person.position(joint)[50] + se3.rotate(person.quat(joint)[50], piece.vertices)
        np.testing.assert_allclose(world, expected, atol=1e-12)
        # The tiny body has a tetrahedron around each joint, and around jaw and eyes, which are the head's.
        nearest = np.linalg.norm(shape.rest_vertices - rest - piece.vertices[:, None], axis=-1).min(axis=1)
        assert nearest.max() < 1e-12 and len(piece.faces) == 4 * (4 if joint == "head" else 1)


def test_human_contacts_are_those_of_the_clip():
    clip = make("carry_box")
    (subject,) = make_scene([SceneItem("clip", clip=clip)]).subjects
    (balls,) = layer_of(subject, "human's contacts").parts
    for index, track in enumerate(clip.contacts):
        np.testing.assert_array_equal(balls.visible[:, index], track.active)
        part = clip.people[0].part_position(track.part)[track.active]
        assert np.linalg.norm(balls.positions[track.active, index] - part, axis=1).max() < 0.06, "at the hand"


@settings(deadline=None, max_examples=20)
@given(seed=seeds, most=st.integers(50, 400))
@example(seed=3431433, most=50)
def test_thinned_meshes_keep_to_the_surface(seed, most):
    rng = np.random.default_rng(seed)
    angles = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    heights = np.linspace(-1.0, 1.0, 30)
    vertices = np.concatenate([np.column_stack([ring, np.full(40, height)]) for height in heights])
    vertices = vertices * rng.uniform(0.1, 2.0, size=3)
    corner = np.arange(29 * 40)
    beside = corner - corner % 40 + (corner + 1) % 40
    faces = np.concatenate(
        [np.column_stack([corner, beside, corner + 40]), np.column_stack([beside, beside + 40, corner + 40])]
    )
    fewer_vertices, fewer_faces = decimated(vertices, faces, most)
    assert 0 < len(fewer_faces) <= most
    assert fewer_faces.max() < len(fewer_vertices)
    size = np.ptp(vertices, axis=0).max()
    assert Surface(vertices, faces).distances(fewer_vertices).max() < 0.3 * size
    assert (decimated(vertices, faces, len(faces))[1] is faces) and (
        decimated(vertices, faces, len(faces))[0] is vertices
    )


# places beside each other


def sides_of(scene):
    """Return the points of each place: the robot's and the human's of each subject."""
    human = ("human", "human's object", "human's contacts")
    for subject in scene.subjects:
        for names in (("robot", "object"), human[:2]):
            found = [points_of(layer) for layer in subject.layers if layer.name in names]
            if found:
                yield np.concatenate(found)


@few
@given(seed=seeds, count=st.integers(1, 3))
def test_nobody_stands_in_anothers_place(seed, count):
    scene = make_scene([shown(seed + index) for index in range(count)])
    spans = [(points.min(axis=0), points.max(axis=0)) for points in sides_of(scene)]
    assert len(spans) == 2 * count
    axes = [axis for axis in (0, 1) if all(low[axis] > high[axis] for (_, high), (low, _) in pairwise(spans))]
    assert axes, "one axis along which each begins where the one before has ended"


@pytest.mark.slow
@few
@given(seed=seeds)
def test_neighbours_change_nothing_but_the_place(seed):
    items = [shown(seed), shown(seed + 1)]
    together_, alone = make_scene(items), [make_scene([item]) for item in items]
    for subject, own in zip(together_.subjects, (scene.subjects[0] for scene in alone), strict=True):
        assert [layer.name for layer in subject.layers] == [layer.name for layer in own.layers]
        for names in (("robot", "inverse kinematics", "object", "contacts", "stance"), ("human", "human's object")):
            shifts = [
                points_of(layer) - points_of(same)
                for layer, same in zip(subject.layers, own.layers, strict=True)
                if layer.name in names
            ]
            shift = np.concatenate(shifts)
            np.testing.assert_allclose(shift, shift[:1].repeat(len(shift), axis=0), atol=1e-5)
            assert abs(shift[0, 2]) < 1e-6, "only sideways"


@few
@given(seed=seeds, x=st.floats(-9.0, 9.0), y=st.floats(-9.0, 9.0))
def test_places_do_not_depend_on_where_the_world_begins(seed, x, y):
    shift = np.array([x, y, 0.0])
    clip = CLIPS["carry_box"]
    there = moved_clip(clip, shift)
    here = make_scene([SceneItem("a", motion_of(clip, seed), G1, clip), SceneItem("b", clip=clip)])
    moved = make_scene([SceneItem("a", motion_of(clip, seed, shift=shift), G1, there), SceneItem("b", clip=there)])
    for a, b in zip(sides_of(here), sides_of(moved), strict=True):
        np.testing.assert_allclose(b - a, np.broadcast_to(shift, a.shape), atol=2e-5)


def mirrored(clip: Clip) -> Clip:
    """The clip's paths with y turned round; rotations stay, which places do not look at."""
    sign = np.array([1.0, -1.0, 1.0])
    people = tuple(replace(person, joint_positions=person.joint_positions * sign) for person in clip.people)
    objects = tuple(replace(track, positions=track.positions * sign) for track in clip.objects)
    return replace(clip, people=people, objects=objects)


def test_places_are_as_far_apart_for_mirrored_motions():
    pair = [CLIPS["carry_box"], moved_clip(CLIPS["carry_table"], np.array([3.0, 2.0, 0.0]))]
    frees = []
    for clips in (pair, [mirrored(clip) for clip in pair]):
        scene = make_scene([SceneItem("clip", clip=clip) for clip in clips])
        pelvises = [layer_of(subject, "human").parts[1].positions[:, 0] for subject in scene.subjects]
        (first, second), axis = pelvises, 0 if np.ptp(pelvises[0][:, 0]) < np.ptp(pelvises[0][:, 1]) else 1
        frees.append((axis, second.min(axis=0)[axis] - first.max(axis=0)[axis]))
    assert frees[0] == pytest.approx(frees[1], abs=1e-4)


def test_the_first_result_stands_where_it_was_computed():
    item = shown(7)
    (subject,) = make_scene([item]).subjects
    np.testing.assert_allclose(points_of(layer_of(subject, "object")), item.motion.object_pos[:, 0], atol=1e-6)


def test_two_peoples_robots_share_a_place_and_the_object():
    items = [shown(1, "carry_table", person=0), shown(2, "carry_table", person=1)]
    assert group_by_shared_objects(items) == (0, 0)
    first, second = make_scene(items).subjects
    names = {layer.name for layer in first.layers}
    assert {layer.name for layer in second.layers} == names - {"object", "human's object"}
    for name, place in (("robot", items[1].motion.qpos), ("human", items[1].clip.people[1].position("pelvis"))):
        spread = points_of(layer_of(second, name), 0) - points_of(layer_of(first, name), 0)[:1]
        assert np.isfinite(place).all() and np.linalg.norm(spread, axis=1).max() < 6.0
    alone = make_scene([items[1]]).subjects[0]
    np.testing.assert_allclose(points_of(layer_of(second, "robot")), points_of(layer_of(alone, "robot")), atol=1e-6)


def test_only_different_people_with_the_same_objects_share_a_place():
    first, second = shown(1, "carry_table", person=0), shown(2, "carry_table", person=1)
    elsewhere = replace(second, motion=replace(second.motion, object_pos=second.motion.object_pos + 0.1))
    other_clip = replace(second, motion=replace(second.motion, report=replace(second.motion.report, clip="other")))
    assert (
        group_by_shared_objects([first, elsewhere])
        == group_by_shared_objects([first, other_clip])
        == group_by_shared_objects([first, first])
        == (0, 1)
    )
    assert group_by_shared_objects([first, first, second, second]) == (0, 1, 0, 1)
    clip = CLIPS["carry_table"]
    assert group_by_shared_objects(
        [SceneItem("a", clip=clip), SceneItem("b", clip=clip, person=1), SceneItem("c", clip=clip)]
    ) == (0, 0, 2)


# what a camera follows


@few
@given(seed=seeds)
def test_the_centre_is_calmer_than_the_pelvis_and_near_it(seed):
    item = shown(seed)
    (subject,) = make_scene([item]).subjects
    pelvis = item.motion.qpos[:, :3]
    assert np.abs(np.diff(subject.centre, 2, axis=0)).max() < max(1e-6, np.abs(np.diff(pelvis, 2, axis=0)).max())
    assert np.linalg.norm((subject.centre - pelvis)[:, :2], axis=1).max() < 1.0


def test_subjects_play_at_their_own_rate():
    slow = make("carry_box", seconds=1.0, fps=10.0)
    fast = make("carry_box", seconds=1.0, fps=20.0)
    scene = make_scene([SceneItem("slow", clip=slow), SceneItem("fast", clip=fast)])
    assert (scene.fps, scene.frames) == (20.0, fast.frames)
    assert [scene.frame_of(scene.subjects[0], frame) for frame in (0, 2, 4)] == [0, 1, 2]


def test_arrays_are_small():
    for layer in make_scene([shown(0)]).subjects[0].layers:
        for part in layer.parts:
            arrays = (part.starts, part.ends) if isinstance(part, Lines) else (part.positions, part.quats)
            assert all(array.dtype == np.float32 for array in arrays)


# what cannot be shown


@pytest.mark.parametrize(
    ("make_it", "message"),
    [
        (lambda: make_scene([]), "nothing to show"),
        (lambda: SceneItem("x"), "x: neither a result nor a clip"),
        (lambda: SceneItem("x", motion_of(CLIPS["carry_box"], 0)), "x: a result is drawn with its robot"),
        (lambda: SceneItem("x", clip=CLIPS["carry_box"], person=1), "x: no person 1"),
        (
            lambda: SceneItem("x", motion_of(CLIPS["carry_box"], 0), G1, make("carry_box", seconds=2.0)),
            "Name the clip that the result was made from",
        ),
    ],
)
def test_what_cannot_be_shown_is_told(make_it, message):
    with pytest.raises(ArgumentError, match=message):
        make_it()
