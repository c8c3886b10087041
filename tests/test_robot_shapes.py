"""What added robots look like: their maker's meshes, where the maker has them, closed and in the maker's colours."""

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

import hoi_retarget as hr
from hoi_retarget.cli import run
from hoi_retarget.cli.robots import without_shapes
from hoi_retarget.dynamics.physics_scene import scene_files, scene_of
from hoi_retarget.numerics import se3
from hoi_retarget.robots import load_robot, user_robots
from hoi_retarget.robots.adding.build import build_robot
from hoi_retarget.robots.adding.description import read_description
from hoi_retarget.robots.adding.findings import Hints
from hoi_retarget.robots.adding.mesh_files import coarser
from hoi_retarget.robots.collision_skin import collision_skins
from hoi_retarget.robots.model import load_model
from hoi_retarget.robots.outer_skin import SkinResolution
from hoi_retarget.studio.scene.drawing import Solid
from hoi_retarget.studio.scene.robot_shapes import robot_parts
from synthetic_humanoids import Choices, humanoid
from tiny_robot import tiny_robot

LINKS = ("left_shank", "torso")


def with_meshes(folder, seed):
    """Write a humanoid with a mesh on some links: off its origin, scaled, and turned against its geometry."""
    rng = np.random.default_rng(seed)
    text = humanoid(Choices(seed, yaw=1.0)).mjcf
    for link in LINKS:
        ball = trimesh.creation.icosphere(subdivisions=1)
        corners = ball.vertices * rng.uniform(0.02, 0.05, 3) + rng.uniform(-0.3, 0.3, 3)
        trimesh.Trimesh(corners, ball.faces).export(folder / f"{link}.stl")
        numbers = {"refpos": rng.normal(0, 0.1, 3), "refquat": rng.normal(size=4), "scale": rng.uniform(0.5, 2.0, 3)}
        asset = " ".join(f'{name}="{" ".join(map(str, values))}"' for name, values in numbers.items())
        place, turn = (" ".join(map(str, rng.normal(size=count))) for count in (3, 4))
        own = f'<geom type="mesh" mesh="{link}" contype="0" conaffinity="0" pos="{place}" quat="{turn}"/>'
        text = text.replace("<worldbody>", f'<asset><mesh file="{link}.stl" {asset}/></asset><worldbody>', 1)
        text = text.replace(f'<body name="{link}"', f'{own}<body name="{link}"', 1)
    path = folder / "maker.xml"
    path.write_text(text)
    return path


def test_shapes_in_groups_that_viewers_do_not_draw_are_no_look(tmp_path):
    path = with_meshes(tmp_path, 0)
    hidden = '<geom type="box" size="0.1 0.1 0.1" contype="0" conaffinity="0" group="3" rgba="0 1 0 0.4"/>'
    path.write_text(path.read_text().replace('<body name="left_shank"', f'{hidden}<body name="left_shank"', 1))
    built = build_robot(path, "made", Hints())
    assert "mesh" in built.mjcf and "0 1 0" not in built.mjcf


@pytest.mark.parametrize("seed", range(3))
def test_meshes_lie_where_the_makers_file_has_them(tmp_path, monkeypatch, seed):
    """MuJoCo moves the vertices of a mesh into the frame of its inertia, and its geometry the other way."""
    monkeypatch.setenv("HOI_RETARGET_ROBOTS", str(tmp_path / "robots"))
    path = with_meshes(tmp_path, seed)
    compiled = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(compiled)
    mujoco.mj_kinematics(compiled, data)
    built = build_robot(path, f"made{seed}", Hints())
    user_robots.save(built.spec, built.mjcf)
    model = load_robot(f"made{seed}")
    posed = model.forward(np.concatenate([[0, 0, 0, 1, 0, 0, 0], np.zeros(model.n)])[None])
    solids = [part for part in robot_parts(model, posed, None) if isinstance(part, Solid)]
    root = compiled.body(model.body_names[0]).id
    makers, ours = [], []
    for geom in np.flatnonzero(compiled.geom_type == mujoco.mjtGeom.mjGEOM_MESH):
        mesh = compiled.mesh(int(compiled.geom_dataid[geom]))
        corners = compiled.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]]
        world = corners @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        makers.append((world - data.xpos[root]) @ data.xmat[root].reshape(3, 3))
    for solid in solids:
        ours.append(se3.rotate(solid.quats[0], solid.vertices) + solid.positions[0])
    assert len(makers) == len(ours) == len(LINKS)
    for one, other in ((makers, ours), (ours, makers)):
        away, _ = KDTree(np.concatenate(one)).query(np.concatenate(other))
        assert away.max() < 5e-5


def test_coarser_mesh_of_a_thin_wall_is_seen_from_both_sides():
    outer, inner = (trimesh.creation.icosphere(subdivisions=5, radius=radius) for radius in (0.1, 0.0998))
    faces = np.concatenate([outer.faces, inner.faces[:, ::-1] + len(outer.vertices)])
    corners, triangles = coarser(np.concatenate([outer.vertices, inner.vertices]), faces)
    assert len(triangles) < len(faces) / 5
    coarse = trimesh.Trimesh(corners, triangles, process=False)
    outward = np.einsum("ki,ki->k", coarse.face_normals, coarse.triangles_center) > 0
    for side in (outward, ~outward):
        assert coarse.area_faces[side].sum() > 0.9 * outer.area


def test_colours_that_a_urdf_names_once_are_those_of_its_links(tmp_path):
    box = '<geometry><box size="0.1 0.1 0.1"/></geometry>'
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    path = tmp_path / "robot.urdf"
    path.write_text(
        f"""<robot name="one"><material name="red"><color rgba="0.9 0.1 0 1"/></material>
        <link name="base">{mass}<visual>{box}<material name="red"/></visual></link>
        <link name="arm">{mass}<visual>{box}<material name="own"><color rgba="0 0.2 0.7 1"/></material></visual>
        <visual>{box}<material name="unknown"/></visual></link>
        <joint name="elbow" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
        <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
    )
    colours = read_description(path).compiled.geom_rgba
    np.testing.assert_allclose(colours, [[0.9, 0.1, 0, 1], [0, 0.2, 0.7, 1], [0.5, 0.5, 0.5, 1]], atol=1e-6)


def test_skin_of_meshes_is_computed_once_and_said(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("HOI_RETARGET_ROBOTS", str(tmp_path / "robots"))
    computed = []
    monkeypatch.setattr(run, "skin_of", computed.append)
    built = build_robot(with_meshes(tmp_path, 0), "with_meshes", Hints())
    user_robots.save(built.spec, built.mjcf)
    model = load_robot("with_meshes")
    for _ in range(2):
        run.prepare_skin(model)
        run.prepare_skin(load_robot("unitree_g1"))
    assert computed == [model]
    assert capsys.readouterr().out.count("with_meshes: computing the skins") == 1


@pytest.mark.parametrize("pieces", [1, 2])
def test_link_whose_colours_are_meshes_of_their_own_is_one_solid(tmp_path, pieces):
    """Each piece is open, and a ball that fills what is outside would come in."""
    model = tiny_robot(tmp_path)
    box = trimesh.creation.box((0.04, 0.06, 0.08))
    box.apply_translation((0.01, 0.0, 0.0))
    assets, geoms = "", ""
    for index, faces in enumerate(np.split(box.faces[np.argsort(box.triangles_center[:, 2])], pieces)):
        corners, triangles = (" ".join(map(str, values.ravel())) for values in (box.vertices, faces))
        assets += f'<mesh name="m{index}" vertex="{corners}" face="{triangles}" inertia="shell"/>'
        geoms += f'<geom type="mesh" mesh="m{index}" pos="0 0.1 0" quat="1 1 0 0"/>'
    text = model.spec.mjcf.read_text().replace('<geom type="box" size="0.1 0.15 0.3"/>', geoms)
    model.spec.mjcf.write_text(text.replace("<worldbody>", f"<asset>{assets}</asset><worldbody>"))
    skin = collision_skins(load_model(model.spec))["trunk"]
    places = np.array([[0.02, 0.1, 0.0], [0.01, 0.13, 0.0], [0.01, 0.15, 0.0], [0.01, 0.1, 0.025]])
    np.testing.assert_allclose(skin.solid.distances(places), [-0.01, -0.01, 0.01, -0.005], atol=2e-3)


def test_fingers_that_are_held_are_part_of_the_hand(tmp_path, monkeypatch):
    """Bodies without joints move with the link that they hang on: its skin is theirs."""
    coarse = SkinResolution(nodes=0.01, ball=0.015, spacing=0.03, grid=0.02)
    monkeypatch.setattr("hoi_retarget.robots.outer_skin.resolution_of", lambda *_: coarse)
    box = '<geom type="box" size="0.1 0.15 0.3"/>'
    finger = '<geom type="capsule" size="0.02 0.1" pos="0 0 0.1"/>'
    model, here = tiny_robot(tmp_path), 'pos="0.2 0.1 0" quat="1 1 0 0"'
    text = model.spec.mjcf.read_text()
    skins = []
    for held in (
        finger.replace('pos="0 0 0.1"', here),
        f'<body name="finger" {here}><body name="tip" pos="0 0 -0.1">{finger}</body></body>',
    ):
        model.spec.mjcf.write_text(text.replace(box, box + held))
        skins.append(collision_skins(load_model(model.spec)))
    assert list(skins[0]) == list(skins[1])
    places = np.random.default_rng(0).uniform((-0.2, -0.2, -0.4), (0.3, 0.3, 0.4), (200, 3))
    alone, part = (skin["trunk"].solid.distances(places) for skin in skins)
    np.testing.assert_allclose(part, alone, atol=1e-6)
    assert skins[0]["trunk"].points[:, 0].max() > 0.2


def test_scene_of_a_robot_with_meshes_opens_and_is_the_robot(tmp_path, monkeypatch):
    monkeypatch.setenv("HOI_RETARGET_ROBOTS", str(tmp_path / "robots"))
    path = with_meshes(tmp_path, 4)
    path.write_text(path.read_text().replace("<joint ", '<joint actuatorfrcrange="-60 60" '))
    built = build_robot(path, "with_meshes", Hints())
    user_robots.save(built.spec, built.mjcf)
    model = load_robot("with_meshes")
    clip = hr.open_clip("builtin:carry_box")
    motion = hr.retarget(clip, without_shapes(built.spec, built.mjcf, tmp_path), hr.Config(contact="landmark"))
    scene = scene_of(motion, model, clip.objects)
    for place, content in scene_files(scene, motion).items():
        (tmp_path / "scene" / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "scene" / place).write_bytes(content)
    path.unlink()
    opened = mujoco.MjModel.from_xml_path(str(tmp_path / "scene" / "scene.xml"))
    data = mujoco.MjData(opened)
    key = opened.nkey - 1
    mujoco.mj_resetDataKeyframe(opened, data, key)
    mujoco.mj_forward(opened, data)
    posed = model.forward(motion.qpos[-1:])
    for site in model.site_names:
        np.testing.assert_allclose(data.site(site).xpos, posed.site_position(site)[0], atol=1e-9)
    own = mujoco.MjModel.from_xml_string(built.mjcf)
    drawn, parts = ((opened.geom_group == 3) == colliding for colliding in (False, True))
    meshes = opened.geom_type == mujoco.mjtGeom.mjGEOM_MESH
    assert sum(meshes & drawn) == sum(own.geom_type == mujoco.mjtGeom.mjGEOM_MESH) > 0
    assert sum(meshes & parts) > len(model.body_frames.names) / 2
    assert sum(opened.body(name).mass[0] for name in model.body_names) == pytest.approx(own.body_mass.sum())
