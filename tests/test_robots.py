"""The robots' MJCFs and specifications, held against the maker's own files where those are at hand."""

import dataclasses
import json
import re
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
import trimesh

from hoi_retarget.errors import ArgumentError
from hoi_retarget.human.skeleton import JOINTS, PARTS
from hoi_retarget.numerics import se3
from hoi_retarget.robots import ROBOTS, robot
from hoi_retarget.robots.spec import SIDES, SITES, SOLE_CORNERS

NAMES = tuple(ROBOTS)
TABLE = json.loads((Path(__file__).parent / "data" / "robot_fk.json").read_text())
MAKER = Path(__file__).resolve().parents[1].parent / "shared" / "data" / "robots"
URDF = {
    "unitree_g1": MAKER / "unitree_g1" / "g1_29dof_rev_1_0.urdf",
    "unitree_g1_dex3": MAKER / "unitree_g1_hands" / "g1_29dof_with_hand_rev_1_0.urdf",
    "unitree_h2": MAKER / "unitree_h2" / "H2.urdf",
}
"""The makers' files with limits; meshes are beside them."""
needs_maker = pytest.mark.skipif(not MAKER.is_dir(), reason=f"the maker's files are not at {MAKER}")

# A human who stands along +z and looks along +x; all joints of the T-pose share this rotation.
QUAT_HUMAN = np.array([0.5, 0.5, 0.5, 0.5])


def original(name):
    """Return the robot whose maker's files describe another: itself, or the one with the same MJCF."""
    return next(known for known in TABLE if ROBOTS[known].mjcf == ROBOTS[name].mjcf)


def compiled(name):
    return mujoco.MjModel.from_xml_path(str(ROBOTS[name].mjcf))


def hinges(model):
    return [index for index in range(model.njnt) if model.jnt_type[index] == mujoco.mjtJoint.mjJNT_HINGE]


def posed(model, angles, root=(0, 0, 0, 1, 0, 0, 0)):
    """Return data after forward kinematics; `angles` by joint name [rad], the others at zero."""
    data = mujoco.MjData(model)
    if model.nq == len(hinges(model)) + 7:
        data.qpos[:7] = root
    for joint, angle in angles.items():
        data.joint(joint).qpos = angle
    mujoco.mj_forward(model, data)
    return data


def standing(name):
    """Return model and data of the home pose as the model's file places the root."""
    model = compiled(name)
    return model, posed(model, ROBOTS[name].home, model.qpos0[:7])


def quat_of(frame):
    return se3.matrix_to_quat(frame.xmat.reshape(3, 3))


def random_angles(model, seed):
    rng = np.random.default_rng(seed)
    return {model.joint(index).name: rng.uniform(*model.jnt_range[index]) for index in hinges(model)}


def maker_model(name):
    """Compile the maker's file without its meshes, whose paths MuJoCo cannot resolve for the H2."""
    path = URDF[original(name)].with_suffix(".xml") if original(name) == "unitree_g1" else URDF[original(name)]
    text = re.sub(r"<!--.*?-->", "", path.read_text(), flags=re.S)
    if path.suffix == ".urdf":
        text = re.sub(r"<(visual|collision)>.*?</\1>", "", text, flags=re.S)
        text = text.replace('dont_collapse="true"', "")
        return mujoco.MjModel.from_xml_string(re.sub(r"<compiler.*?/>", '<compiler fusestatic="false"/>', text))
    text = re.sub(r"<mesh [^>]*/>", "", text)
    return mujoco.MjModel.from_xml_string(re.sub(r"<geom [^>]*mesh=[^>]*/>", "", text))


# --- names, limits, roles ---------------------------------------------------------------------------


def test_robot_by_name_and_unknown_name():
    assert robot("unitree_g1") is ROBOTS["unitree_g1"]
    with pytest.raises(ArgumentError, match=r"'unitree_g3'.*unitree_g1, unitree_h2"):
        robot("unitree_g3")
    with pytest.raises(TypeError):
        ROBOTS["other"] = ROBOTS["unitree_g1"]


@pytest.mark.parametrize("name", NAMES)
def test_root_is_free_and_called_pelvis(name):
    model = compiled(name)
    assert model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
    assert model.body(1).name == "pelvis"
    assert model.nq == 7 + len(hinges(model)), "only hinges besides the root"


@pytest.mark.parametrize("name", NAMES)
def test_joints_in_the_makers_order_each_with_its_body(name):
    model = compiled(name)
    joints = [model.joint(index).name for index in hinges(model)]
    assert joints == TABLE[original(name)]["joints"]
    for index, joint in zip(hinges(model), joints, strict=True):
        expected = "torso_link" if joint == "waist_pitch_joint" else joint.replace("_joint", "_link")
        assert model.body(model.jnt_bodyid[index]).name == expected
    assert [body for body in TABLE[original(name)]["configurations"][0]["positions"]] == [
        model.body(index).name for index in range(1, model.nbody)
    ]


@pytest.mark.parametrize("name", NAMES)
def test_sites_are_complete_and_unturned_except_palms_of_rubber(name):
    model = compiled(name)
    present = {model.site(index).name for index in range(model.nsite)}
    assert set(SITES) <= present
    for site in SITES:
        turned = not np.allclose(model.site(site).quat, [1, 0, 0, 0])
        assert turned == (site.endswith("palm") and original(name) != "unitree_g1_dex3"), site


@pytest.mark.parametrize("name", NAMES)
def test_every_hinge_has_range_effort_and_speed_limit(name):
    model, spec = compiled(name), ROBOTS[name]
    joints = [model.joint(index).name for index in hinges(model)]
    assert set(spec.speed_limits) == set(joints)
    assert all(0 < limit < 200 for limit in spec.speed_limits.values())
    for index in hinges(model):
        low, high = model.jnt_range[index]
        straight = "hand_" in model.joint(index).name and 0.0 in (low, high)  # A finger that does not overstretch.
        assert model.jnt_limited[index] and -np.pi <= low <= 0 <= high <= np.pi and (straight or low < 0 < high)
        assert model.jnt_actfrclimited[index] and model.jnt_actfrcrange[index, 1] > 0


@pytest.mark.parametrize("name", NAMES)
def test_home_lies_strictly_inside_the_ranges(name):
    model, home = compiled(name), ROBOTS[name].home
    assert set(home) <= {model.joint(index).name for index in hinges(model)}
    for index in hinges(model):
        low, high = model.jnt_range[index]
        assert low + 0.05 < home.get(model.joint(index).name, 0.0) < high - 0.05


@pytest.mark.parametrize("name", NAMES)
def test_specification_speaks_of_sites_and_joints_that_exist(name):
    spec = ROBOTS[name]
    assert {row.site for row in spec.ik} <= set(SITES)
    assert {row.human_joint for row in spec.ik} <= set(JOINTS)
    assert set(spec.part_sites) == set(PARTS) and set(spec.part_sites.values()) <= set(SITES)
    bodies = {compiled(name).body(index).name for index in range(compiled(name).nbody)}
    assert set(spec.meshes) == bodies - {"world"}
    assert dataclasses.replace(spec) == spec


@pytest.mark.parametrize("name", NAMES)
def test_ik_weights_are_those_of_the_published_table_but_for_shoulders_and_elbows(name):
    """Those two follow the human's places more closely: it bends arms as the human does (docs/design.md)."""
    weights = {row.site: (row.position_weight, row.rotation_weight) for row in ROBOTS[name].ik}
    assert weights.pop("pelvis") == (100, 5)
    assert weights.pop("torso") == (0, 10)
    assert {weights.pop(f"{side}_toe") for side in SIDES} == {(100, 50)}
    assert {weights.pop(f"{side}_shoulder") for side in SIDES} == {(20, 5)}
    assert {weights.pop(f"{side}_elbow") for side in SIDES} == {(25, 5)}
    assert len(weights) == 6 and set(weights.values()) == {(10, 5)}


# --- geometry of the roles --------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_home_stands_flat_on_the_floor_on_the_lowest_points_of_the_robot(name):
    model, data = standing(name)
    corners = np.array([data.site(f"{side}_sole_{corner}").xpos for side in SIDES for corner in SOLE_CORNERS])
    np.testing.assert_allclose(corners[:, 2], 0.0, atol=2e-4)
    lowest = trimesh.util.concatenate([_primitive(model, data, geom) for geom in range(model.ngeom)]).bounds[0, 2]
    assert lowest == pytest.approx(corners[:, 2].min(), abs=5e-4)


@pytest.mark.parametrize("name", NAMES)
def test_sole_corners_are_called_by_where_they_are(name):
    _, data = standing(name)
    for side, outward in zip(SIDES, (1, -1), strict=True):
        at = {corner: data.site(f"{side}_sole_{corner}").xpos for corner in SOLE_CORNERS}
        for end in ("heel", "toe"):
            assert outward * at[f"{end}_outer"][1] > outward * at[f"{end}_inner"][1] > 0
        for edge in ("inner", "outer"):
            assert 0.15 < at[f"toe_{edge}"][0] - at[f"heel_{edge}"][0] < 0.25


@pytest.mark.parametrize("name", NAMES)
def test_head_is_in_the_head_and_moves_with_the_trunk(name):
    model, data = standing(name)
    head, shoulders = data.site("head").xpos, data.body("left_shoulder_pitch_link").xpos
    top = trimesh.util.concatenate([_primitive(model, data, geom) for geom in range(model.ngeom)]).bounds[1, 2]
    assert shoulders[2] + 0.1 < head[2] < top - 0.05
    assert abs(head[1]) < 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_palms_look_inwards_ahead_of_the_wrists(name):
    data = posed(compiled(name), {})
    for side, outward in zip(SIDES, (1, -1), strict=True):
        offset = data.site(f"{side}_palm").xpos - data.site(f"{side}_wrist").xpos
        assert 0.07 < offset[0] < 0.14 and -0.06 < outward * offset[1] < -0.02


@pytest.mark.parametrize("name", NAMES)
def test_rotation_offsets_fit_the_pose_that_mimics_a_human_t_pose(name):
    spread = {}
    for side, outward in zip(SIDES, (1, -1), strict=True):
        spread[f"{side}_shoulder_roll_joint"] = outward * np.pi / 2
        spread[f"{side}_elbow_joint"] = np.pi / 2
    data = posed(compiled(name), spread)
    for row in ROBOTS[name].ik:
        target = se3.quat_multiply(QUAT_HUMAN, np.array(row.rotation_offset))
        residual = np.degrees(se3.angle_between(quat_of(data.site(row.site))[None], target))[0]
        # The G1's hips ask for 5.7 degrees of flexion on purpose.
        bound = 5.8 if original(name) != "unitree_h2" and row.site.endswith("hip") else 0.1
        assert residual < bound, row.site
    hand = data.site("left_wrist").xpos - data.site("left_shoulder").xpos
    assert hand[1] > 0.95 * np.linalg.norm(hand), "the left arm points to the left"


def _mirrored(angles):
    def other(joint):
        return joint.replace("left_", "@").replace("right_", "left_").replace("@", "right_")

    return {other(joint): angle if _is_pitch(joint) else -angle for joint, angle in angles.items()}


def _is_pitch(joint):
    return any(word in joint for word in ("pitch", "knee", "elbow", "thumb_0"))


@pytest.mark.parametrize("name", NAMES)
def test_left_and_right_mirror_each_other(name):
    model = compiled(name)
    # The ranges mirror too, so that the mirrored pose is one the robot can take.
    for index in hinges(model):
        joint = model.joint(index).name
        (mirror,) = _mirrored({joint: 1.0})
        low, high = model.joint(mirror).range
        expected = (low, high) if _is_pitch(joint) else (-high, -low)
        np.testing.assert_allclose(model.jnt_range[index], expected, atol=1e-9)
    for seed in range(5):
        angles = random_angles(model, seed)
        data, mirror = posed(model, angles), posed(model, _mirrored(angles))
        for frames in (SITES, [model.body(index).name for index in range(1, model.nbody)]):
            kind = "site" if frames is SITES else "body"
            for frame in frames:
                if frame == "head_pitch_link":
                    continue  # its origin lies beside the middle plane, on its own axis
                (twin,) = _mirrored({frame: 0.0})
                here, there = getattr(data, kind)(frame).xpos, getattr(mirror, kind)(twin).xpos
                np.testing.assert_allclose(here * [1, -1, 1], there, atol=1e-4, err_msg=frame)


@pytest.mark.parametrize("name", NAMES)
def test_neighbours_do_not_collide_where_the_robot_stands(name):
    model, data = standing(name)
    for angles in ({}, ROBOTS[name].home):
        data = posed(model, angles, (0, 0, 2, 1, 0, 0, 0))
        touching = {
            tuple(model.body(model.geom_bodyid[geom]).name for geom in contact.geom) for contact in data.contact
        }
        assert not touching
    crossed = {"left_hip_roll_joint": -0.4, "right_hip_roll_joint": 0.4}
    assert posed(model, crossed, (0, 0, 2, 1, 0, 0, 0)).ncon > 0, "self-collision must still be seen"


# --- against the maker's numbers --------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_forward_kinematics_against_the_committed_table(name):
    model = compiled(name)
    assert model.body_mass.sum() == pytest.approx(TABLE[original(name)]["total_mass"], abs=1e-5)
    for configuration in TABLE[original(name)]["configurations"]:
        data = posed(model, configuration["angles"])
        for body, position in configuration["positions"].items():
            np.testing.assert_allclose(data.body(body).xpos, position, atol=2e-6, err_msg=body)


@needs_maker
@pytest.mark.parametrize("name", NAMES)
def test_forward_kinematics_against_the_makers_file(name):
    ours, maker = compiled(name), maker_model(name)
    turned = 2e-6 if original(name) == "unitree_g1_dex3" else 1e-6  # A URDF has angles.
    for seed in range(100):
        angles = random_angles(ours, seed)
        here, there = posed(ours, angles), posed(maker, angles)
        for index in range(1, ours.nbody):
            body = ours.body(index).name
            np.testing.assert_allclose(here.body(body).xpos, there.body(body).xpos, atol=1e-6, err_msg=body)
            np.testing.assert_allclose(here.body(body).xmat, there.body(body).xmat, atol=turned, err_msg=body)


def _spatial_inertia(model, data, bodies):
    """Return mass, first moment and inertia about the world's origin of several bodies together."""
    mass, moment, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    for body in bodies:
        index = model.body(body).id
        turn, place, own = data.ximat[index].reshape(3, 3), data.xipos[index], model.body_mass[index]
        mass += own
        moment = moment + own * place
        inertia = inertia + turn @ np.diag(model.body_inertia[index]) @ turn.T
        inertia = inertia - own * se3.skew(place) @ se3.skew(place)
    return mass, moment, inertia


@needs_maker
@pytest.mark.parametrize("name", NAMES)
def test_masses_and_inertias_against_the_makers_file(name):
    ours, maker = compiled(name), maker_model(name)
    here, there = posed(ours, {}), posed(maker, {})
    for index in range(1, ours.nbody):
        body = ours.body(index).name
        welds = maker.body_weldid[1:]
        together = [
            maker.body(1 + int(other)).name for other in np.flatnonzero(welds == welds[maker.body(body).id - 1])
        ]
        for mine, their in zip(
            _spatial_inertia(ours, here, [body]), _spatial_inertia(maker, there, together), strict=True
        ):
            # Its numbers are those of the maker's MJCF; the URDF has a cover and a logo of 1 g besides.
            covered = body in ("pelvis", "torso_link") and original(name) == "unitree_g1_dex3"
            np.testing.assert_allclose(mine, their, atol=1.01e-3 if covered else 2e-6, err_msg=body)


@needs_maker
@pytest.mark.parametrize("name", URDF)
def test_limits_against_the_makers_urdf(name):
    model, seen = compiled(name), set()
    for joint in ElementTree.parse(URDF[name]).getroot().iter("joint"):
        limit, joint_name = joint.find("limit"), joint.get("name")
        if limit is None:
            continue
        seen.add(joint_name)
        assert ROBOTS[name].speed_limits[joint_name] == float(limit.get("velocity"))
        assert model.jnt_actfrcrange[model.joint(joint_name).id, 1] == float(limit.get("effort"))
        expected = [float(limit.get("lower")), float(limit.get("upper"))]
        np.testing.assert_allclose(model.joint(joint_name).range, expected, atol=1e-5)
    assert seen == set(ROBOTS[name].speed_limits)


def _primitive(model, data, geom):
    """Return a closed mesh of one primitive, in the world."""
    kinds, size = mujoco.mjtGeom, model.geom_size[geom]
    kind = kinds(model.geom_type[geom])
    if kind == kinds.mjGEOM_CAPSULE:
        mesh = trimesh.creation.capsule(height=2 * size[1], radius=size[0])
        mesh.apply_translation([0, 0, -mesh.bounds.mean(axis=0)[2]])
    elif kind == kinds.mjGEOM_BOX:
        mesh = trimesh.creation.box(extents=2 * size)
    elif kind == kinds.mjGEOM_CYLINDER:
        mesh = trimesh.creation.cylinder(radius=size[0], height=2 * size[1])
    else:
        mesh = trimesh.creation.icosphere(subdivisions=3)
        mesh.apply_scale(size)
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]
    return mesh.apply_transform(place)


@needs_maker
@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_primitives_cover_the_makers_surface(name):
    model = compiled(name)
    data = posed(model, {})
    covered, area = 0.0, 0.0
    for body, files in ROBOTS[name].meshes.items():
        index = model.body(body).id
        parts = [_primitive(model, data, geom) for geom in range(model.ngeom) if model.geom_bodyid[geom] == index]
        for file in files:
            mesh = trimesh.load_mesh(URDF[original(name)].with_name("meshes") / file)
            points = np.asarray(trimesh.sample.sample_surface(mesh, 500, seed=0)[0])
            site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"mesh_{Path(file).stem}")
            origin = data.site_xpos[site] if site >= 0 else data.xpos[index]
            points = points @ data.xmat[index].reshape(3, 3).T + origin
            covered += mesh.area * np.mean(np.min([_height_over(part, points) for part in parts], axis=0) < 0.015)
            area += mesh.area
    assert covered / area > 0.95


def _height_over(convex, points):
    """Return how far points lie outside a convex mesh [m], negative inside."""
    return ((points[:, None] - convex.triangles_center) * convex.face_normals).sum(axis=2).max(axis=1)
