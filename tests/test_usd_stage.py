"""Laws of USD stages, read back with usd-core: kinematics as MuJoCo's, sizes of shapes, masses, and who is moved."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from hoi_retarget.cli import main
from hoi_retarget.dynamics import usd_stage
from hoi_retarget.dynamics.physics_scene import compiled, scene_of
from hoi_retarget.numerics import se3
from hoi_retarget.robots import load_robot
from plain_motions import plain_motion, tracks_of
from synthetic import make
from synthetic.jointed import open_laptop
from trajectories import random_qpos

pxr = pytest.importorskip("pxr", reason="usd-core is not installed")
from pxr import Usd, UsdGeom, UsdPhysics  # noqa: E402 - after it is known to be there

FRAMES = 12


@pytest.fixture(scope="module", params=["unitree_g1", "unitree_h2"])
def written(request, tmp_path_factory):
    model, generator = load_robot(request.param), np.random.default_rng(1)
    quats = se3.quat_normalize(generator.normal(size=(FRAMES, 1, 4)))
    motion = plain_motion(model, random_qpos(model, FRAMES, generator), object_quat=quats)
    (track,) = make("move_chair").objects
    scene = scene_of(motion, model, tracks_of(motion, (track.geometry,)))
    file = tmp_path_factory.mktemp("usd") / usd_stage.NAME
    file.write_bytes(usd_stage.usd_file(scene, motion))
    return motion, scene, Usd.Stage.Open(str(file))


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo")
    assert main(["run", "builtin:carry_box", "--contact", "landmark", "--figures", "none", "--out", str(folder)]) == 0
    return folder / "carry_box.npz"


def test_bodies_are_where_mujoco_has_them_in_every_frame(written):
    motion, scene, stage = written
    assert (
        stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == motion.fps
        and stage.GetEndTimeCode() == FRAMES - 1
    )
    assert UsdGeom.GetStageUpAxis(stage) == "Z" and UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    simulated = compiled(scene)
    data, qpos = mujoco.MjData(simulated), scene.qpos(motion)
    for frame in range(FRAMES):
        data.qpos[:] = qpos[frame]
        mujoco.mj_kinematics(simulated, data)
        cache = UsdGeom.XformCache(frame)
        for body, path in enumerate(usd_stage._paths(simulated, [simulated.nbody - 1])):
            found = np.array(cache.GetLocalToWorldTransform(stage.GetPrimAtPath(path)))  # Rows are axes.
            np.testing.assert_allclose(found[3, :3], data.xpos[body], atol=1e-9)
            np.testing.assert_allclose(found[:3, :3].T, data.xmat[body].reshape(3, 3), atol=1e-9)


def test_shapes_are_as_large_as_mujocos(written):
    _, scene, stage = written
    simulated = compiled(scene)
    cache = UsdGeom.BBoxCache(0, [UsdGeom.Tokens.default_, UsdGeom.Tokens.guide])
    counted = 0
    for prim in stage.Traverse():
        if prim.GetName().startswith("shape_") and not prim.GetPath().HasPrefix("/World/ground"):
            geom = int(prim.GetName().removeprefix("shape_"))
            box = cache.ComputeUntransformedBound(prim).ComputeAlignedRange()
            middle, half = simulated.geom_aabb[geom, :3], simulated.geom_aabb[geom, 3:]
            scale = prim.GetAttribute("xformOp:scale")
            sizes = np.array(scale.Get() if scale else (1.0, 1.0, 1.0))
            np.testing.assert_allclose(np.array(box.GetMin()) * sizes, middle - half, atol=2e-6)
            np.testing.assert_allclose(np.array(box.GetMax()) * sizes, middle + half, atol=2e-6)
            counted += 1
    assert counted == simulated.ngeom - 1


def test_the_robot_is_moved_and_the_object_has_its_mass(written):
    _, scene, stage = written
    rigid = [prim for prim in stage.Traverse() if prim.HasAPI(UsdPhysics.RigidBodyAPI)]
    free = [prim for prim in rigid if not UsdPhysics.RigidBodyAPI(prim).GetKinematicEnabledAttr().Get()]
    assert len(rigid) == compiled(scene).nbody - 1 and [str(prim.GetPath()) for prim in free] == ["/World/objects/box"]
    assert UsdPhysics.MassAPI(free[0]).GetMassAttr().Get() == pytest.approx(scene.objects[0].body.mass, rel=1e-6)
    colliding = [child for child in free[0].GetChildren() if child.HasAPI(UsdPhysics.CollisionAPI)]
    assert len(colliding) == len(scene.objects[0].shape.parts)


def test_scene_writes_one_where_it_is_asked_for_or_says_what_is_missing(demo, tmp_path, monkeypatch, capsys):
    command = ["scene", str(demo), "--out", str(tmp_path / "scene"), "--usd"]
    with monkeypatch.context() as patched:
        patched.setattr(usd_stage, "install_hint", lambda _: "pip install usd-core")
        patched.setattr("hoi_retarget.cli.physics.load_motion", None)  # It is told before anything is done.
        assert main(command) == 1 and "pip install usd-core" in capsys.readouterr().err
        assert not (tmp_path / "scene").exists()
    assert main(command) == 0
    assert Usd.Stage.Open(str(tmp_path / "scene" / usd_stage.NAME)).GetPrimAtPath("/World/robot/pelvis")


def test_an_object_with_parts_is_moved_as_they_are(tmp_path):
    (clip, _), model = open_laptop(), load_robot("unitree_g1")
    names = tuple(track.name for track in clip.objects)
    places = np.stack([track.positions[:FRAMES] for track in clip.objects], axis=1)
    quats = np.stack([track.quats[:FRAMES] for track in clip.objects], axis=1)
    qpos = random_qpos(model, FRAMES, np.random.default_rng(0))
    motion = plain_motion(model, qpos, object_names=names, object_pos=places, object_quat=quats)
    recorded = [replace(one, positions=one.positions[:FRAMES], quats=one.quats[:FRAMES]) for one in clip.objects]
    (tmp_path / "a.usdc").write_bytes(usd_stage.usd_file(scene_of(motion, model, recorded), motion))
    stage = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    kinematic = {
        prim.GetName(): UsdPhysics.RigidBodyAPI(prim).GetKinematicEnabledAttr().Get()
        for prim in stage.GetPrimAtPath("/World/objects").GetChildren()
    }
    assert kinematic == {"lid": True, "base": True, "stand": False}
