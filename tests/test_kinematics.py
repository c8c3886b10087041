"""Forward kinematics and Jacobians against MuJoCo, and the manifold's laws."""

import mujoco
import numpy as np
import pytest

from hoi_retarget.errors import RobotError
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
    from dataclasses import replace

    from hoi_retarget.robots.model import load_model
    from hoi_retarget.robots.spec import SITES

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
