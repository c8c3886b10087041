"""Laws of exported tasks for mjlab: kinematics as ours, drives and contacts of the scene, names that stay data.

The fast tests need nothing of mjlab. The slow one trains, with an mjlab 1.6 in an environment of its own: the variable
HOI_RETARGET_MJLAB_PYTHON names its Python; without it the test is skipped.
"""

import ast
import json
import os
import re
import shlex
import subprocess
from dataclasses import replace
from importlib.metadata import distributions
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from export_motions import as_result, smooth_motion
from hoi_retarget.cli import main
from hoi_retarget.dynamics.actuators import actuators_of
from hoi_retarget.dynamics.physics_scene import scene_of
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.errors import ClipError
from hoi_retarget.motion import result_file
from hoi_retarget.motion.links import link_states
from hoi_retarget.motion.motion import SIMULATED, Stage
from hoi_retarget.motion.motion_report import Optimality, Status, Window
from hoi_retarget.motion.resample import resample
from hoi_retarget.motion.result import Result
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.robots import load_robot
from hoi_retarget.simulation import mjlab_task
from hoi_retarget.simulation.mjlab_task import package_files, plain_name, task_of
from plain_motions import plain_motion, standing_qpos, tracks_of
from synthetic import make

G1, H2 = load_robot("unitree_g1"), load_robot("unitree_h2")
CORNERS = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.1, 0.1) for z in (-0.15, 0.15)])
TASK = Path("hoi_retarget_mjlab") / "tasks" / "take"
MJLAB_PYTHON = os.environ.get("HOI_RETARGET_MJLAB_PYTHON")
UNSOLVED = Window(0, 40, Status.FAILED, 3, 1.0, {}, Optimality(1.0, 1.0, 0.0))
HOSTILE = "x'\"); __import__('os').system('touch pwned')  # ../../<body>&{0}%s\n${HOME}"


def task(result: Result, **physics):
    tracks = tracks_of(result.motion, [ObjectGeometry(CORNERS)] * len(result.motion.object_names))
    return task_of(result, scene_of(result.motion, result.model, tracks, Physics(**physics)))


def arrays(content: bytes, tmp_path: Path) -> dict[str, np.ndarray]:
    (tmp_path / "motion.npz").write_bytes(content)
    with np.load(tmp_path / "motion.npz", allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


@pytest.mark.parametrize("objects", [0, 1, 2])
@pytest.mark.parametrize("model", [G1, H2], ids=["g1", "h2"])
def test_kinematics_of_the_files_are_ours_in_all_frames(model, objects, tmp_path):
    result = as_result(model, objects=objects)
    files = task(result).files
    held, ours = arrays(files[TASK / "motion.npz"], tmp_path), resample(result.motion, model, 50.0)
    robot = mujoco.MjModel.from_xml_string(files[TASK / "robot.xml"].decode())
    data, kinematics = mujoco.MjData(robot), model.forward(ours.qpos)
    names = [robot.body(number).name for number in range(1, robot.nbody)]
    assert held["body_names"].tolist() == names and len(held["joint_pos"]) == ours.frames == 66
    for frame in range(ours.frames):
        data.qpos[:3], data.qpos[3:7] = held["body_pos_w"][frame, 0], held["body_quat_w"][frame, 0]
        data.qpos[7:] = held["joint_pos"][frame]
        mujoco.mj_kinematics(robot, data)
        np.testing.assert_allclose(data.xpos[1:], held["body_pos_w"][frame], atol=1e-9)
        for site in model.site_names:
            np.testing.assert_allclose(data.site(site).xpos, kinematics.site_position(site)[frame], atol=1e-9)
    states = link_states(ours)
    np.testing.assert_allclose(held["body_pos_w"], states.pos, atol=1e-9)
    np.testing.assert_allclose(held["body_lin_vel_w"], states.lin_vel, atol=1e-7)
    np.testing.assert_allclose(held["body_ang_vel_w"], states.ang_vel, atol=1e-7)
    same = np.abs(np.sum(held["body_quat_w"] * states.quat, axis=-1))
    np.testing.assert_allclose(same, 1.0, atol=1e-12)
    np.testing.assert_allclose(held["object_pos_w"], ours.object_pos, atol=1e-12)
    np.testing.assert_allclose(held["object_lin_vel_w"], ours.object_lin_vel, atol=1e-12)
    np.testing.assert_array_equal(held["contact_object"], ours.contact_object)


@pytest.mark.parametrize("model", [G1, H2], ids=["g1", "h2"])
def test_what_is_told_of_the_robot_is_in_its_files(model):
    files = task(as_result(model, objects=2), floor_friction=0.6, hand_friction=0.9, object_mass=1.5).files
    told, drives = json.loads(files[TASK / "task.json"]), actuators_of(model)
    for name in ("stiffness", "damping", "torque", "armature"):
        np.testing.assert_array_equal([joint[name] for joint in told["joints"]], getattr(drives, name))
    assert tuple(joint["name"] for joint in told["joints"]) == model.joint_names
    robot = mujoco.MjModel.from_xml_string(files[TASK / "robot.xml"].decode())
    bodies = {robot.body(number).name for number in range(1, robot.nbody)}
    assert told["tracked_bodies"][0] == robot.body(1).name  # mjlab resets the first one as the root.
    assert told["anchor_body"] in told["tracked_bodies"]
    assert set(told["end_bodies"]) <= set(told["tracked_bodies"]) <= bodies
    assert set(told["contact_bodies"]) <= bodies
    assert (robot.geom_condim >= 3).all() and robot.nu == 0
    assert told["timestep"] * told["decimation"] == pytest.approx(0.02)
    # The robot before floor and objects: then these frictions are the ones that count.
    assert "priority" not in told["floor"] and robot.geom_priority.min() == 1
    soles = [robot.geom(name).id for name in told["soles"]]
    assert len(soles) == 8 and set(robot.geom_friction[soles, 0]) == {told["floor_friction"]} == {0.6}
    assert set(np.delete(robot.geom_friction[:, 0], soles)) == {0.9}
    assert set(told["contact_bodies"]) == {robot.body(robot.geom(name).bodyid[0]).name for name in told["touching"]}
    assert told["floor"]["friction"][0] == told["object_friction"] == 0.4
    # mjlab makes environments of these places, in which nothing may be inside anything else.
    np.testing.assert_allclose(robot.qpos0[:7], [*told["root"]["pos"], *told["root"]["quat"]], atol=1e-12)
    for number, item in enumerate(told["objects"]):
        thing = mujoco.MjModel.from_xml_string(files[TASK / f"object_{number}.xml"].decode())
        assert thing.body(item["body"]).mass == pytest.approx(1.5) and thing.njnt == 1
        np.testing.assert_allclose(thing.qpos0, [*item["pos"], *item["quat"]], atol=1e-12)
        assert thing.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
        np.testing.assert_allclose(thing.geom_friction[:, 0], told["object_friction"])
        # With the robot and the floor it collides, as bits of both tell.
        assert all(thing.geom_conaffinity[0] & bits for bits in set(robot.geom_contype) - {0})
        assert thing.geom_contype[0] & told["floor"]["conaffinity"]


def test_mjcf_is_in_words_of_older_mujocos_too():
    files = task(as_result(G1)).files
    for place, content in files.items():
        if place.suffix == ".xml":
            tags = {element.tag for element in ElementTree.fromstring(content).iter()}
            assert not tags & {"actuator", "general", "sensor", "keyframe"}


def test_the_last_stage_is_the_reference(tmp_path):
    result = as_result(G1)
    moved = result.motion.qpos.copy()
    moved[:, 7:] = np.clip(moved[:, 7:] + 0.05, G1.lower, G1.upper)
    performed = replace(result.motion, stages=(*result.motion.stages, Stage(SIMULATED, moved)))
    files = task(Result("take", result.sha256, performed, G1)).files
    told = json.loads(files[TASK / "task.json"])
    assert (told["stage"], told["performed_in_simulation"]) == (SIMULATED, True)
    np.testing.assert_allclose(arrays(files[TASK / "motion.npz"], tmp_path)["joint_pos"][::5], moved[::3, 7:][:14])


# Names are data


@given(st.text())
def test_names_are_plain_whatever_a_file_is_called(text):
    assert re.fullmatch(r"[A-Za-z0-9_-]+", plain_name(text)) and plain_name(text)[0] not in "-_"


def test_what_files_and_objects_are_called_is_nowhere_but_in_json():
    motion = smooth_motion(G1, objects=1, object_names=(HOSTILE,))
    files = {**package_files(), **task(Result(HOSTILE, "ab" * 32, motion, G1)).files}
    for place, content in files.items():
        assert re.fullmatch(r"[A-Za-z0-9_.-]+", "".join(place.parts)) and ".." not in place.parts
        if place.suffix == ".xml":
            names = [element.get("name", "plain") for element in ElementTree.fromstring(content).iter()]
            assert all(re.fullmatch(r"\w+", name) for name in names)
        if place.suffix not in (".json", ".npz"):
            assert b"pwned')" not in content
    (told,) = (json.loads(content) for place, content in files.items() if place.suffix == ".json")
    assert told["objects"][0]["name"] == HOSTILE and re.fullmatch(r"Hoi-[\w-]+", told["id"])


def test_code_is_the_packages_own_to_the_byte():
    source = Path(mjlab_task.__file__).with_name("hoi_retarget_mjlab")
    code = {place.name: content for place, content in package_files().items() if place.suffix == ".py"}
    assert code == {path.name: path.read_bytes() for path in source.glob("*.py")} and len(code) == 4
    for content in code.values():
        called = [node.func for node in ast.walk(ast.parse(content)) if isinstance(node, ast.Call)]
        names = {node.id for node in called if isinstance(node, ast.Name)}
        assert not names & {"eval", "exec", "compile", "__import__"}


# The command


@pytest.fixture
def export(tmp_path, monkeypatch, capsys):
    """Run `hoi-retarget export --to mjlab-task` in an empty folder; return exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*words: object):
        code = main(["export", *map(str, words), "--to", "mjlab-task", "--out", "tasks"])
        return code, *capsys.readouterr()

    return call


def standing(name: str, model=G1, **changes):
    """Write a result of the built-in clip's length in which the robot stands."""
    motion = plain_motion(model, standing_qpos(model, make("carry_box").frames), **changes)
    result_file.save(motion, Path(name))
    return motion


def test_tasks_of_several_results_are_in_one_package_that_mjlab_finds(export, tmp_path):
    standing("carry.npz")
    standing("alone 1.npz", H2, object_names=())
    code, out, err = export("carry.npz", "--clip", "builtin:carry_box", "--object-mass", "2")
    assert code == 0, err
    assert "Hoi-carry " in out and "2.00 kg (as asked for), collides as a box" in out
    assert "PYTHONPATH=tasks train Hoi-carry" in out
    before = {path: path.read_bytes() for path in (tmp_path / "tasks").rglob("*") if path.is_file()}
    assert export("alone 1.npz")[0] == 0
    assert all(path.read_bytes() == content for path, content in before.items())
    folders = sorted(path.name for path in (tmp_path / "tasks" / "hoi_retarget_mjlab" / "tasks").iterdir())
    assert folders == ["alone_1", "carry"]
    (found,) = distributions(path=[str(tmp_path / "tasks")])
    assert [(entry.group, entry.value) for entry in found.entry_points] == [("mjlab.tasks", "hoi_retarget_mjlab")]
    assert export("carry.npz", "--clip", "builtin:carry_box", "--object-mass", "2")[0] == 0
    assert all(path.read_bytes() == content for path, content in before.items())


def test_what_is_no_reference_is_refused_and_nothing_is_written(export, tmp_path):
    motion = standing("good.npz")
    (tmp_path / "fell.npz.failed").write_bytes((tmp_path / "good.npz").read_bytes())
    early = replace(motion, stages=(Stage("ik", motion.qpos),))
    result_file.save(early, tmp_path / "early.npz")
    result_file.save(plain_motion(G1, standing_qpos(G1, 1), object_names=()), tmp_path / "one.npz")
    for name, words in {
        "fell.npz.failed": "kept to be looked at",
        "early.npz": "ends with inverse kinematics",
        "one.npz": "one frame",
    }.items():
        code, _, err = export(name)
        assert code == 1 and words in " ".join(err.split()), err
    for option, words in {
        ("--fps", "30"): "50 actions a second",
        ("--object", "box"): "has all objects",
        ("--clip", "builtin:push_table"): "Name the clip it was made from",
    }.items():
        code, _, err = export("good.npz", *option)
        assert code != 0 and words in " ".join(err.split()), err
    assert not (tmp_path / "tasks").exists()


def test_a_motion_that_was_not_solved_is_no_reference():
    motion = smooth_motion(G1)
    unsolved = Stage("trajectory", motion.qpos, (UNSOLVED,))
    with pytest.raises(ClipError, match="no reference to train on"):
        task(Result("take", "ab" * 32, replace(motion, stages=(unsolved,)), G1))


def test_masses_are_for_tasks_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    standing("good.npz")
    assert main(["export", "good.npz", "--to", "mjlab", "--out", "out", "--object-mass", "2"]) == 2
    assert "only mjlab-task has masses" in " ".join(capsys.readouterr().err.split())


# mjlab


def with_tasks(folder: Path, *words: str) -> str:
    """Run a program of mjlab's environment on the tasks in a folder, without a GPU, and return its output."""
    surroundings = {**os.environ, "PYTHONPATH": str(folder / "tasks"), "CUDA_VISIBLE_DEVICES": ""}
    surroundings |= {"MUJOCO_GL": "disabled", "MJLAB_WARP_QUIET": "1"}
    done = subprocess.run(words, env=surroundings, capture_output=True, text=True, check=False)
    # mjlab's `list-envs` exits with the number of tasks.
    assert done.returncode == 0 or words[0].endswith("list-envs"), done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


@pytest.mark.slow
@pytest.mark.skipif(MJLAB_PYTHON is None, reason="HOI_RETARGET_MJLAB_PYTHON names no Python that has mjlab 1.6")
def test_mjlab_resets_and_steps(tmp_path, monkeypatch):
    assert MJLAB_PYTHON is not None
    monkeypatch.chdir(tmp_path)
    assert main(["demo", "--no-look", "--out", "results"]) == 0
    assert main(["export", "results/carry_box.npz", "--to", "mjlab-task", "--out", "tasks"]) == 0
    script = str(Path(__file__).with_name("mjlab_check.py"))
    found = json.loads(with_tasks(tmp_path, MJLAB_PYTHON, script, "Hoi-carry_box", "200").splitlines()[-1])
    assert found["contacts"]["terrain"] == {"condim": [3], "priority": [0], "friction": [0.4]}
    assert found["contacts"]["object_0"] == {"condim": [3], "priority": [0], "friction": [0.4]}
    assert found["contacts"]["robot"] == {"condim": [3, 4], "priority": [1], "friction": [0.8]}
    drives = actuators_of(G1)
    ours = np.stack([drives.stiffness, drives.damping, drives.torque, drives.armature], axis=1)
    np.testing.assert_allclose([found["drives"][name] for name in G1.joint_names], ours, rtol=1e-6)
    told, random = found["reset"]["told"], found["reset"]["random"]
    assert max(told["body"], told["object"]) < 1e-6  # Single precision.
    assert max(told["robot_speed"], told["object_speed"]) < 1e-5
    # Both palms press, sensors feel it, and the reward is the whole one.
    assert found["squeezed"]["labels"] == 2 and found["squeezed"]["force"] > 5.0
    assert found["squeezed"]["made"] == pytest.approx(0.5)
    assert random["held_resets"] and random["held"] < 1e-5
    assert random["free_resets"] and random["free"] > 1e-3
    assert found["finite"] and found["steps"] == 200


@pytest.mark.slow
@pytest.mark.skipif(MJLAB_PYTHON is None, reason="HOI_RETARGET_MJLAB_PYTHON names no Python that has mjlab 1.6")
def test_the_pages_commands_lead_from_zero_to_the_trainers_first_steps(tmp_path, monkeypatch):
    """Installations apart, and with two environments and one update in the place of a GPU's thousands."""
    assert MJLAB_PYTHON is not None
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parents[1] / "docs" / "training.md").read_text()
    lines = page.partition("```sh\n")[2].partition("```")[0].splitlines()
    for line in (line for line in lines if " hoi-retarget" in f" {line.replace('/', ' ')}" and "install" not in line):
        words = shlex.split(line)[1:]
        assert main([*words, "--no-look"] if words[0] == "demo" else words) == 0
    programs = [shlex.split(line)[1:] for line in lines if line.startswith("PYTHONPATH=tasks ")]
    assert [Path(words[0]).name for words in programs] == ["list-envs", "train", "play"]
    few = ("--gpu-ids", "None", "--env.scene.num-envs", "2", "--agent.max-iterations", "1", "--log-root", "logs")
    (listing, *_), (train, name, *_), (_, played, *_) = programs
    of_mjlab = Path(MJLAB_PYTHON)
    assert name == played and name in with_tasks(tmp_path, str(of_mjlab.with_name(Path(listing).name)))
    assert "object_position" in with_tasks(tmp_path, str(of_mjlab.with_name(Path(train).name)), name, *few)
    assert list((tmp_path / "logs").rglob("model_*.pt"))
