"""Forward kinematics and Jacobians against MuJoCo, and the manifold's laws."""

from dataclasses import fields, replace
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from hoi_retarget.errors import ArgumentError, RobotError
from hoi_retarget.numerics import se3
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import load_model
from hoi_retarget.robots.spec import SITES, SitePose
from trajectories import MODELS, random_qpos


@pytest.fixture(params=list(MODELS))
def model(request):
    return MODELS[request.param]


def mujoco_states(model, qpos):
    compiled = mujoco.MjModel.from_xml_path(str(model.spec.mjcf))
    data = mujoco.MjData(compiled)
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(compiled, data)
        mujoco.mj_comPos(compiled, data)
        yield compiled, data


def test_poses_agree_with_mujoco(model):
    qpos = random_qpos(model, 12, np.random.default_rng(0), wander=0.5)
    kinematics = model.forward(qpos)
    for frame, (compiled, data) in enumerate(mujoco_states(model, qpos)):
        for site in model.site_names:
            assert np.allclose(data.site(site).xpos, kinematics.site_position(site)[frame], atol=1e-9)
            assert np.allclose(data.site(site).xmat.reshape(3, 3), kinematics.site_rotation(site)[frame], atol=1e-9)
        bodies = [compiled.body(name).id for name in model.body_names]
        assert np.allclose(data.xpos[bodies], kinematics.body_positions[frame], atol=1e-9)


def test_site_jacobians_agree_with_mujoco(model):
    qpos = random_qpos(model, 4, np.random.default_rng(1), wander=0.5)
    kinematics = model.forward(qpos)
    for frame, (compiled, data) in enumerate(mujoco_states(model, qpos)):
        for site in ("left_palm", "right_toe", "head", "pelvis"):
            linear, angular = np.zeros((3, compiled.nv)), np.zeros((3, compiled.nv))
            mujoco.mj_jacSite(compiled, data, linear, angular, compiled.site(site).id)
            assert np.allclose(kinematics.jacobian(site)[frame], np.vstack([linear, angular]), atol=1e-9)


def test_integrate_follows_mujoco(model):
    rng = np.random.default_rng(2)
    qpos, tangent = random_qpos(model, 5, rng), rng.normal(size=(5, model.nv))
    compiled = mujoco.MjModel.from_xml_path(str(model.spec.mjcf))
    stepped = model.integrate(qpos, tangent)
    for before, step, after in zip(qpos, tangent, stepped, strict=True):
        expected = before.copy()
        mujoco.mj_integratePos(compiled, expected, step, 1.0)
        assert np.allclose(after, expected, atol=1e-12)


def test_an_unknown_site_is_named_with_those_that_exist(model):
    kinematics = model.forward(model.home_qpos[None])
    with pytest.raises(RobotError, match=r"'left_paw'.*left_palm"):
        kinematics.site_position("left_paw")


def test_several_hinges_on_one_body_anchors_and_reference_angles_follow_mujoco(tmp_path):
    """Humanoids from elsewhere have ball-like joints of three hinges, shifted anchors and `ref`."""
    sites = "".join(f'<site name="{name}" pos="0.1 0.02 0.3" quat="0.8 0.6 0 0"/>' for name in SITES)
    hinges = "".join(
        f'<joint name="j{i}" axis="{axis}" pos="0.05 -0.02 {0.1 * i}" ref="{0.2 * i}" range="-1 1"/>'
        for i, axis in enumerate(("1 0 0", "0 1 0", "0.6 0 0.8"))
    )
    mjcf = tmp_path / "robot.xml"
    mjcf.write_text(
        '<mujoco><compiler angle="radian" autolimits="true"/><worldbody><body name="base" pos="0 0 1"><freejoint/>'
        '<geom size="0.1"/><body name="fixed" pos="0.1 0 0" quat="0.6 0.8 0 0"><geom size="0.1"/>'
        f'<body name="arm" pos="0 0.2 0.1" quat="0.8 0 0.6 0">{hinges}<geom size="0.1"/>{sites}</body>'
        "</body></body></worldbody></mujoco>"
    )
    spec = next(iter(MODELS.values())).spec
    model = load_model(replace(spec, mjcf=mjcf, speed_limits={f"j{i}": 1.0 for i in range(3)}, home={}))
    qpos = random_qpos(model, 6, np.random.default_rng(3), wander=0.4)
    kinematics = model.forward(qpos)
    for frame, (compiled, data) in enumerate(mujoco_states(model, qpos)):
        assert np.allclose(data.site("head").xpos, kinematics.site_position("head")[frame], atol=1e-12)
        assert np.allclose(data.site("head").xmat.reshape(3, 3), kinematics.site_rotation("head")[frame], atol=1e-12)
        bodies = [compiled.body(name).id for name in model.body_names]
        assert np.allclose(data.xpos[bodies], kinematics.body_positions[frame], atol=1e-12)
        linear, angular = np.zeros((3, compiled.nv)), np.zeros((3, compiled.nv))
        mujoco.mj_jacSite(compiled, data, linear, angular, compiled.site("head").id)
        assert np.allclose(kinematics.jacobian("head")[frame], np.vstack([linear, angular]), atol=1e-12)


def test_frames_of_geometries_and_bodies_follow_mujoco(model):
    qpos = random_qpos(model, 3, np.random.default_rng(4))
    kinematics = model.forward(qpos)
    for frame, (compiled, data) in enumerate(mujoco_states(model, qpos)):
        for geom, place in enumerate(model.geometries.frames):
            assert np.allclose(kinematics.point(place)[:, frame], data.geom_xpos[geom], atol=1e-9)
            turn = data.geom_xmat[geom].reshape(3, 3)
            assert np.allclose(kinematics.orientation(place)[:, :, frame], turn, atol=1e-9)
        assert model.body_frames.names == tuple(compiled.body(index).name for index in range(1, compiled.nbody))
        for body, place in enumerate(model.body_frames.frames.values(), start=1):
            assert np.allclose(kinematics.point(place)[:, frame], data.xpos[body], atol=1e-9)


def test_geometries_are_those_of_mujoco(model):
    compiled, geometries = mujoco.MjModel.from_xml_path(str(model.spec.mjcf)), model.geometries
    assert geometries.bodies == tuple(compiled.body(body).name for body in compiled.geom_bodyid)
    kinds = [mujoco.mjtGeom(kind).name for kind in compiled.geom_type]
    assert kinds == [f"mjGEOM_{kind.upper()}" for kind in geometries.types]
    assert set(geometries.meshes) == {""}, "primitives only"
    np.testing.assert_array_equal(geometries.sizes, compiled.geom_size)
    np.testing.assert_array_equal(geometries.groups, compiled.geom_group)


def test_inertias_and_torque_limits_are_those_of_mujoco(model):
    """Kinetic energy of a random motion, once by the bodies' inertias and once by MuJoCo's mass matrix."""
    rng = np.random.default_rng(5)
    ((compiled, data),) = mujoco_states(model, random_qpos(model, 1, rng))
    data.qvel[:] = rng.normal(size=compiled.nv)
    mujoco.mj_forward(compiled, data)
    momentum = np.zeros(compiled.nv)
    mujoco.mj_mulM(compiled, data, momentum, data.qvel)
    armature = float(data.qvel**2 @ compiled.dof_armature)
    energy = 0.0
    for name, mass, centre in zip(model.body_names, model.inertias.masses, model.inertias.centres, strict=True):
        body = compiled.body(name).id
        own_axes = se3.quat_to_matrix(compiled.body_iquat[body])
        tensor = own_axes * compiled.body_inertia[body] @ own_axes.T
        linear, angular = np.zeros((3, compiled.nv)), np.zeros((3, compiled.nv))
        turn = data.xmat[body].reshape(3, 3)
        mujoco.mj_jac(compiled, data, linear, angular, data.xpos[body] + turn @ centre, body)
        velocity, spin = linear @ data.qvel, turn.T @ angular @ data.qvel
        energy += mass * velocity @ velocity + spin @ tensor @ spin
    assert energy + armature == pytest.approx(momentum @ data.qvel, rel=1e-9)
    limits = [compiled.jnt_actfrcrange[compiled.joint(name).id, 1] for name in model.joint_names]
    np.testing.assert_array_equal(model.torque_limits, limits)


def arrays_of(owner):
    values = {field.name: getattr(owner, field.name) for field in fields(owner)}
    return {name: value for name, value in values.items() if isinstance(value, np.ndarray)}


def test_arrays_of_a_model_are_read_only(model):
    owners = (model, model.bodies, model.sites, model.body_frames, model.inertias, model.geometries)
    arrays = [array for owner in owners for array in arrays_of(owner).values()]
    arrays += [*model.levels, *(frame.position for frame in model.sites.frames.values())]
    assert len(arrays) > 30 and not any(array.flags.writeable for array in arrays)


def test_sites_of_a_specification_are_as_good_as_those_of_the_file(tmp_path):
    """The G1 with its sites taken out of the file and given as data is the same model to the bit."""
    model = MODELS["unitree_g1"]
    compiled = mujoco.MjModel.from_xml_path(str(model.spec.mjcf))
    root = ElementTree.fromstring(model.spec.mjcf.read_text())
    sites, unturned = {}, (("pos", "0 0 0"), ("quat", "1 0 0 0"))
    for body in root.iter("body"):
        for site in body.findall("site"):
            place, quat = (tuple(map(float, site.get(*default).split())) for default in unturned)
            sites[site.attrib["name"]] = SitePose(body.attrib["name"], place, quat)
            body.remove(site)
    mjcf = tmp_path / "robot.xml"
    mjcf.write_text(ElementTree.tostring(root, encoding="unicode"))
    assert len(sites) == compiled.nsite and not mujoco.MjModel.from_xml_path(str(mjcf)).nsite
    with pytest.raises(RobotError, match=r"sites are missing: pelvis, torso"):
        load_model(replace(model.spec, mjcf=mjcf))
    other = load_model(replace(model.spec, mjcf=mjcf, sites=sites))
    assert other.site_names == model.site_names and other.site_bodies == model.site_bodies
    for ours, theirs in ((other, model), (other.sites, model.sites), (other.bodies, model.bodies)):
        for name, array in arrays_of(theirs).items():
            np.testing.assert_array_equal(arrays_of(ours)[name], array)


def test_a_site_on_an_unknown_body_is_refused():
    spec = MODELS["unitree_g1"].spec
    with pytest.raises(RobotError, match=r"site 'tail' is on the body 'tail_link'.*left_knee_link"):
        load_model(replace(spec, sites={"tail": SitePose("tail_link", (0.0, 0.0, 0.0))}))
    with pytest.raises(RobotError, match=r"unitree_g1\.xml: MuJoCo cannot (add the site .head|compile it).*repeated"):
        load_model(replace(spec, sites={"head": SitePose("pelvis", (0.0, 0.0, 0.0))}))


def test_a_robot_is_compiled_once():
    assert load_robot("unitree_g1") is load_robot("unitree_g1")
    with pytest.raises(ArgumentError, match=r"'unitree_g3'.*unitree_g1, unitree_h2"):
        load_robot("unitree_g3")


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_a_site_moves_with_the_body_that_carries_it(model):
    for site in model.site_names:
        assert model.sites.frames[site].node == model.body_frames.frames[model.body_of(site)].node
