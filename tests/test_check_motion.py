"""The checker of robot motions: it says nothing against good files, and names every planted fault."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import motion_writers as writers
from hoi_retarget.cli import main
from hoi_retarget.cli.files import facts
from hoi_retarget.errors import ClipError
from hoi_retarget.motion.check import CheckedMotion, as_qpos, check
from hoi_retarget.motion.formats import WRITABLE, read
from hoi_retarget.motion.result import Result
from hoi_retarget.motion.write_export import export, format_named
from hoi_retarget.numerics import se3
from motion_writers import Content

EXPORTS = Path(__file__).resolve().parents[1].parent / "shared" / "data" / "exports"
FORMATS = ("hoi-retarget", *writers.MAKERS)


def checked_as(name: str, folder: Path, spoil: Callable[[Content], None] | None = None) -> CheckedMotion:
    return check(read(writers.write(name, folder, spoil)), writers.model())


def told(checked: CheckedMotion) -> str:
    return "\n".join(f"{item.subject}: {item.numbers}" for item in checked.contradictions)


# Good files


@pytest.mark.parametrize("name", FORMATS)
def test_nothing_is_said_against_a_good_file(name, tmp_path):
    checked = checked_as(name, tmp_path)
    assert checked.format == name
    assert not checked.contradictions, told(checked)
    assert checked.frames == writers.motion().frames


@pytest.mark.parametrize("name", FORMATS)
def test_a_good_file_comes_back_as_it_was_written(name, tmp_path):
    source = writers.motion()
    converted = as_qpos(read(writers.write(name, tmp_path)), writers.model())
    known = np.array([joint not in converted.missing_joints for joint in source.joint_names])
    assert converted.fps == pytest.approx(writers.WITHOUT_RATE.get(name, source.fps))
    assert converted.fps_assumed == (name in writers.WITHOUT_RATE)
    assert np.abs(converted.qpos[:, 7:][:, known] - source.qpos[:, 7:][:, known]).max() < 1e-5
    assert np.abs(converted.qpos[:, :3] - source.qpos[:, :3]).max() < 1e-5
    assert np.abs(se3.angle_between(converted.qpos[:, 3:7], source.qpos[:, 3:7])).max() < 1e-5
    assert known.all() == (name != "asap")
    for path in converted.objects:
        assert np.abs(path.pos - source.object_pos[:, 0]).max() < 1e-5
        assert np.abs(se3.angle_between(path.quat, source.object_quat[:, 0])).max() < 1e-5
    with_object = {"hoi-retarget", "holosoma-wbt", "hdmi", "holosoma-retarget", "omniretarget", "sbto"}
    assert len(converted.objects) == (1 if name in with_object else 0)


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["push_table", "drag_suitcase", "move_chair", "carry_table"])
@pytest.mark.parametrize("robot", ["unitree_g1", "unitree_h2"])
def test_other_motions_and_robots_are_not_complained_about(scene, robot, tmp_path):
    source = writers.motion(scene, robot, 30.0)
    for name in ("gmr", "omniretarget"):
        path = writers.save(name, writers.MAKERS[name](source), tmp_path)
        checked = check(read(path), writers.model(robot))
        assert not checked.contradictions, told(checked)


# Planted faults


def swap_components(*names: str) -> Callable[[Content], None]:
    def spoil(content: Content) -> None:
        for name in names:
            content[name] = se3.quat_to_xyzw(content[name])

    return spoil


def to_wxyz(content: Content) -> None:
    content["root_rot"] = se3.quat_from_xyzw(content["root_rot"])


def label_30(content: Content) -> None:
    content["fps"] = np.array([30])


def bodies_breadth_first(content: Content) -> None:
    order, _ = writers.breadth_first()
    for name in ("body_pos_w", "body_quat_w", "body_lin_vel_w", "body_ang_vel_w"):
        content[name] = content[name][:, order]


def named_bodies_breadth_first(content: Content) -> None:
    order = np.concatenate([[0], 1 + writers.breadth_first()[0], [len(writers.bodies().names) + 1]])
    for name in ("body_pos_w", "body_quat_w", "body_lin_vel_w", "body_ang_vel_w"):
        content[name] = content[name][:, order]


def isaac_joints(key: str, start: int = 0, also: str | None = None) -> Callable[[Content], None]:
    def spoil(content: Content) -> None:
        _, joints = writers.breadth_first()
        for name, first in ((key, start), (also, start - 1 if start else 0)):
            if name is not None:
                values = content[name].copy()
                values[:, first : first + len(joints)] = content[name][:, first + joints]
                content[name] = values

    return spoil


def degrees(content: Content) -> None:
    content["dof_pos"] = np.degrees(content["dof_pos"])


def degrees_tracking(content: Content) -> None:
    for name in ("joint_pos", "joint_vel"):
        content[name] = np.degrees(content[name])


def centimetres(content: Content) -> None:
    content["root_pos"] = 100 * content["root_pos"]


def centimetres_bodies(content: Content) -> None:
    for name in ("body_pos_w", "body_lin_vel_w"):
        content[name] = 100 * content[name]


LEGS, ARMS = ("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist")


def exchange(content: Content, key: str, parts: tuple[str, ...], negated: tuple[str, ...] = ()) -> None:
    names = list(writers.motion().joint_names)
    values = content[key].copy()
    for index, name in enumerate(names):
        if any(part in name for part in parts):
            other = name.replace("left", "#").replace("right", "left").replace("#", "right")
            sign = -1.0 if any(part in name for part in negated) else 1.0
            values[:, index] = sign * content[key][:, names.index(other)]
    content[key] = values


def swap_legs(content: Content) -> None:
    exchange(content, "dof_pos", LEGS)


def swap_arms(content: Content) -> None:
    exchange(content, "dof_pos", ARMS)


def swap_legs_tracking(content: Content) -> None:
    for key in ("joint_pos", "joint_vel"):
        exchange(content, key, LEGS)


def mirror_legs(content: Content) -> None:
    for key in ("joint_pos", "joint_vel"):
        exchange(content, key, LEGS, ("roll", "yaw"))


def shift_joints(content: Content) -> None:
    content["dof_pos"] = np.roll(content["dof_pos"], 1, axis=1)


def frame_numbers(content: Content) -> None:
    table = content["table"]
    content["table"] = np.concatenate([np.arange(len(table))[:, None], table], axis=1)


def rotation_first(content: Content) -> None:
    content["qpos"] = np.concatenate([writers.swapped(content["qpos"][:, :7]), content["qpos"][:, 7:]], axis=1)


def rotation_first_csv(content: Content) -> None:
    table = content["table"]
    content["table"] = np.concatenate([writers.swapped(table[:, :7]), table[:, 7:]], axis=1)


Y_UP = se3.exp(np.array([-0.5 * np.pi, 0.0, 0.0]))


def y_up(content: Content) -> None:
    content["root_pos"] = se3.rotate(Y_UP, content["root_pos"])
    content["root_rot"] = se3.quat_to_xyzw(se3.quat_multiply(Y_UP, se3.quat_from_xyzw(content["root_rot"])))


def y_up_bodies(content: Content) -> None:
    for name in ("body_pos_w", "body_lin_vel_w", "body_ang_vel_w"):
        content[name] = se3.rotate(Y_UP, content[name])
    content["body_quat_w"] = se3.quat_multiply(Y_UP, content["body_quat_w"])


def negate(key: str, joint: str, start: int = 0) -> Callable[[Content], None]:
    def spoil(content: Content) -> None:
        values = content[key].copy()
        values[:, start + writers.motion().joint_names.index(joint)] *= -1
        content[key] = values

    return spoil


def raised(content: Content) -> None:
    content["qpos"] = content["qpos"] + np.eye(content["qpos"].shape[1])[2] * 0.1


def raised_bodies(content: Content) -> None:
    content["body_pos_w"] = content["body_pos_w"] + np.array([0.0, 0.0, 0.1])


def sunk(content: Content) -> None:
    content["root_pos"] = content["root_pos"] - np.array([0.0, 0.0, 0.1])


def angular_in_body_axes(content: Content) -> None:
    content["body_ang_vel_w"] = se3.rotate_inverse(content["body_quat_w"], content["body_ang_vel_w"])


def angular_rotated_twice(content: Content) -> None:
    content["body_ang_vel_w"] = se3.rotate(content["body_quat_w"], content["body_ang_vel_w"])


def linear_in_root_axes(content: Content) -> None:
    content["body_lin_vel_w"] = se3.rotate_inverse(content["body_quat_w"][:, :1], content["body_lin_vel_w"])


def velocities_of_30(content: Content) -> None:
    for name in ("joint_vel", "body_lin_vel_w", "body_ang_vel_w"):
        content[name] = content[name] * (30 / 50)


def joint_velocities_of_30(content: Content) -> None:
    content["joint_vel"] = content["joint_vel"] * (30 / 50)


def frozen_frames(content: Content) -> None:
    for name in ("root_pos", "root_rot", "dof_pos"):
        values = content[name].copy()
        values[60:65] = values[60]
        content[name] = values


def doubled_frames(content: Content) -> None:
    kept = np.arange(len(content["dof_pos"])) // 2 * 2
    for name in ("root_pos", "root_rot", "dof_pos"):
        content[name] = content[name][kept]


def jumping_root(content: Content) -> None:
    content["root_pos"] = content["root_pos"] + np.where(np.arange(len(content["root_pos"])) < 80, 0.0, 0.3)[
        :, None
    ] * [1, 0, 0]


def one_wrong_frame(content: Content) -> None:
    values = content["dof_pos"].copy()
    values[50, 18] += 0.8
    content["dof_pos"] = values


def missing_joint(content: Content) -> None:
    content["table"] = content["table"][:, :-1]


def missing_named_joint(content: Content) -> None:
    for name in ("joint_pos", "joint_vel"):
        content[name] = np.delete(content[name], 5, axis=1)
    del content["meta"]["joint_names"][5]


def conjugated_bodies(content: Content) -> None:
    content["body_quat_w"] = se3.quat_conjugate(content["body_quat_w"])


def conjugated_root(content: Content) -> None:
    content["root_rot"] = content["root_rot"] * np.array([-1, -1, -1, 1])


def inverse_object(content: Content) -> None:
    quat = se3.quat_conjugate(se3.quat_from_xyzw(content["object_rot"]))
    content["object_root_pos"] = -se3.rotate(quat, content["object_root_pos"])
    content["object_rot"] = se3.quat_to_xyzw(quat)


def object_rotation_first(content: Content) -> None:
    content["qpos"] = np.concatenate([content["qpos"][:, :-7], writers.swapped(content["qpos"][:, -7:])], axis=1)


def no_unit_quaternions(content: Content) -> None:
    content["root_rot"] = 1.2 * content["root_rot"]


def foreign_root(content: Content) -> None:
    joint_pos = content["joint_pos"].copy()
    joint_pos[:, :7] = joint_pos[::-1, :7]
    content["joint_pos"] = joint_pos


ISAAC = isaac_joints("joint_pos", also="joint_vel")
ISAAC_NAMED = isaac_joints("joint_pos", 7, "joint_vel")
WRIST = "left_wrist_roll_joint"
OF_BODIES = "angular velocities of bodies"
FAULTS: dict[str, tuple[str, Callable[[Content], None], str, str]] = {
    # What: format, how it is spoilt, subject of the finding, words in it.
    "wxyz for xyzw, pickle": ("gmr", to_wxyz, "quaternion order", "wxyz"),
    "xyzw for wxyz, bodies": ("mjlab", swap_components("body_quat_w"), "quaternion order", "xyzw"),
    "xyzw for wxyz, Isaac's order": ("beyondmimic", swap_components("body_quat_w"), "quaternion order", "xyzw"),
    "50 labelled 30": ("mjlab", label_30, "rate", "imply 50"),
    "bodies breadth-first": ("mjlab", bodies_breadth_first, "joint and body order", "breadth-first"),
    "bodies breadth-first under names": ("holosoma-wbt", named_bodies_breadth_first, "body order", "breadth-first"),
    "Isaac's joints, no bodies": ("gmr", isaac_joints("dof_pos"), "joint order", "breadth-first"),
    "Isaac's joints, with bodies": (
        "mjlab",
        isaac_joints("joint_pos", also="joint_vel"),
        "joint and body order",
        "breadth",
    ),
    "Isaac's joints under names": (
        "holosoma-wbt",
        isaac_joints("joint_pos", 7, "joint_vel"),
        "joint order",
        "breadth-first",
    ),
    "degrees": ("gmr", degrees, "angle unit", "degrees"),
    "degrees, with bodies": ("beyondmimic", degrees_tracking, "angle unit", "degrees"),
    "centimetres": ("gmr", centimetres, "length unit", "centimetres"),
    "centimetres, bodies": ("mjlab", centimetres_bodies, "length unit", "100 times"),
    "arms swapped": ("gmr", swap_arms, "left and right", "arms exchanged"),
    "legs swapped, with bodies": ("mjlab", swap_legs_tracking, "left and right", "legs exchanged"),
    "legs mirrored": ("mjlab", mirror_legs, "left and right", "legs mirrored"),
    "joints shifted by a column": ("gmr", shift_joints, "shifted columns", "by 1 column"),
    "frame numbers before all": ("unitree-csv", frame_numbers, "shifted columns", "columns 4 to 7"),
    "rotation before position": ("holosoma-retarget", rotation_first, "root order", "columns 0 to 3"),
    "rotation before position, table": ("unitree-csv", rotation_first_csv, "root order", "columns 0 to 3"),
    "y up": ("gmr", y_up, "up axis", "y up"),
    "y up, bodies": ("mjlab", y_up_bodies, "up axis", "y up"),
    "a knee negated": ("gmr", negate("dof_pos", "left_knee_joint"), "joint sign", "left_knee_joint"),
    "an ankle negated": ("sbto", negate("dof_pos", "right_ankle_pitch_joint"), "joint sign", "right_ankle_pitch_joint"),
    "a wrist negated, with bodies": (
        "mjlab",
        negate("joint_pos", "left_wrist_roll_joint"),
        "joint sign",
        "left_wrist_roll",
    ),
    "10 cm above the floor": ("holosoma-retarget", raised, "floor", "100 mm"),
    "10 cm above the floor, bodies": ("mjlab", raised_bodies, "floor", "100 mm"),
    "10 cm below the floor": ("gmr", sunk, "floor", "-100 mm"),
    "angular velocities in body axes": (
        "mjlab",
        angular_in_body_axes,
        "angular velocities of bodies",
        "body's own axes",
    ),
    "angular velocities rotated twice": ("mjlab", angular_rotated_twice, OF_BODIES, "too often"),
    "linear velocities in root axes": ("mjlab", linear_in_root_axes, "linear velocities of bodies", "root's axes"),
    "velocities of another rate": ("beyondmimic", velocities_of_30, "rate", "imply 30"),
    "only joint velocities of another rate": ("mjlab", joint_velocities_of_30, "rate", "the velocities differ"),
    "frozen frames": ("gmr", frozen_frames, "repeated frames", "4 frames (61, 62, 63, 64)"),
    "every other frame repeated": ("gmr", doubled_frames, "repeated frames", "repeat the one before"),
    "the root jumps": ("gmr", jumping_root, "jump", "frame (80)"),
    "a joint jumps for a frame": ("gmr", one_wrong_frame, "jump", "left_elbow_joint"),
    "a joint is missing": ("unitree-csv", missing_joint, "joint count", "28 columns"),
    "a named joint is missing": ("hdmi", missing_named_joint, "joint count", "left_ankle_roll_joint"),
    "bodies' rotations inverted": ("mjlab", conjugated_bodies, "quaternion inverse", "inverted"),
    "root's rotation inverted": ("gmr", conjugated_root, "quaternion inverse", "inverted"),
    "the object's pose inverted": ("sbto", inverse_object, "object", "its pose is inverted"),
    "the object's rotation first": ("holosoma-retarget", object_rotation_first, "object", "exchanged"),
    "no unit quaternions": ("gmr", no_unit_quaternions, "root layout", "0.2"),
    "a root of another motion": ("holosoma-wbt", foreign_root, "root", "apart"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_named_and_few_others(fault, tmp_path):
    name, spoil, subject, words = FAULTS[fault]
    checked = checked_as(name, tmp_path, spoil)
    found = [item for item in checked.contradictions if item.subject == subject and words in item.numbers]
    assert found, f"{subject} ({words}) is not among:\n{told(checked)}"
    assert all(item.advice for item in checked.contradictions)
    assert len({item.subject for item in checked.contradictions}) <= 2, told(checked)


def test_twenty_kinds_of_faults_are_planted():
    assert len(FAULTS) > 2 * 20
    assert len({spoil for _, spoil, _, _ in FAULTS.values()}) > 2 * 20


def test_swapped_legs_are_named_where_the_robot_walks(tmp_path):
    content = writers.gmr(writers.motion("move_chair", fps=30.0))
    swap_legs(content)
    checked = check(read(writers.save("gmr", content, tmp_path)), writers.model())
    assert [item.subject for item in checked.contradictions] == ["left and right"], told(checked)
    assert "legs exchanged" in checked.contradictions[0].numbers


@pytest.mark.parametrize("absent", [("wrist",), ("waist",)])
@pytest.mark.parametrize("breadth", [True, False])
def test_columns_of_some_joints_are_read_in_either_order(absent, breadth, tmp_path):
    """Where the format leaves the order open, and the file has no names."""
    motion = writers.motion()
    kept = [all(part not in name for part in absent) for name in motion.joint_names]
    order = writers.breadth_first()[1] if breadth else range(len(kept))
    content = writers.gmr_npz(motion)
    content["joint_pos"] = content["joint_pos"][:, [joint for joint in order if kept[joint]]]
    checked = check(read(writers.save("gmr-npz", content, tmp_path)), writers.model())
    assert not checked.contradictions, told(checked)
    np.testing.assert_allclose(checked.qpos[:, 7:], motion.qpos[:, 7:] * kept, atol=1e-6)


def test_what_this_motion_cannot_tell_is_said(tmp_path):
    findings = [item for item in checked_as("gmr", tmp_path).findings if item.level == "unknown"]
    said = "\n".join(f"{item.subject}: {item.numbers}" for item in findings)
    assert "rate: no velocities" in said
    assert "left_wrist_roll_joint" in said
    assert "left_knee_joint" not in said
    assert not [item for item in checked_as("mjlab", tmp_path).findings if item.level == "unknown"]


def test_a_file_that_contradicts_itself_is_not_converted(tmp_path):
    with pytest.raises(ClipError, match=r"quaternion order.*check-motion"):
        as_qpos(read(writers.write("gmr", tmp_path, to_wxyz)), writers.model())


def test_wrong_velocities_do_not_stop_a_conversion(tmp_path):
    converted = as_qpos(read(writers.write("mjlab", tmp_path, angular_rotated_twice)), writers.model())
    assert np.abs(converted.qpos - writers.motion().qpos).max() < 1e-5


@pytest.mark.parametrize(
    "fault", ["wxyz for xyzw, pickle", "Isaac's joints, no bodies", "degrees", "centimetres", "arms swapped", "y up"]
)
def test_what_the_numbers_say_is_the_motion_that_was_spoilt(fault, tmp_path):
    name, spoil, _, _ = FAULTS[fault]
    qpos = checked_as(name, tmp_path, spoil).qpos
    source = writers.motion().qpos
    assert qpos is not None
    assert np.abs(np.delete(qpos - source, [3, 4, 5, 6], axis=1)).max() < 1e-6
    assert se3.angle_between(qpos[:, 3:7], source[:, 3:7]).max() < 1e-6


# Numbers of any kind


@settings(derandomize=True, deadline=None, max_examples=12, database=None)
@given(st.integers(0, 10_000), st.sampled_from([3, 4, 9, 40]), st.sampled_from([0.0, 1e-300, 1.0, 1e6]))
def test_any_numbers_have_an_answer(tmp_path_factory, seed, frames, size):
    rng = np.random.default_rng(seed)
    folder = tmp_path_factory.mktemp("any")
    for name in ("gmr", "mjlab", "holosoma-wbt", "sbto"):
        content = {
            key: size * rng.normal(size=(frames, *value.shape[1:]))
            if isinstance(value, np.ndarray) and value.dtype.kind == "f" and value.ndim > 1
            else value
            for key, value in writers.MAKERS[name](writers.motion()).items()
        }
        checked = check(read(writers.save(name, content, folder)), writers.model())
        assert checked.contradictions
        assert json.dumps(facts(checked), allow_nan=False)


# The command


def test_exit_codes_and_json(tmp_path, capsys):
    good, bad = tmp_path / "good", tmp_path / "bad"
    good.mkdir()
    bad.mkdir()
    assert main(["check-motion", str(writers.write("gmr", good)), "--robot", "unitree_g1"]) == 0
    assert "Nothing contradicts" in capsys.readouterr().out
    spoilt = str(writers.write("gmr", bad, to_wxyz))
    assert main(["check-motion", spoilt, "--json", str(tmp_path / "found.json")]) == 1
    assert "WRONG    quaternion order (" in capsys.readouterr().out
    found = json.loads((tmp_path / "found.json").read_text())
    assert found["format"] == "gmr"
    assert found["contradictions"] == 1
    assert [item["subject"] for item in found["findings"] if item["level"] == "contradiction"] == ["quaternion order"]
    assert main(["check-motion", spoilt, "--robot", "nobody"]) == 2
    assert main(["check-motion", str(tmp_path / "nothing.npz")]) == 1
    assert "no such file" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["gmr", "hdmi"])
def test_what_was_found_is_not_written_over_the_motion(name, tmp_path, capsys):
    path = writers.write(name, tmp_path)
    files = [path] if path.is_file() else sorted(path.iterdir())
    for file in files:
        content = file.read_bytes()
        assert main(["check-motion", str(path), "--json", str(file)]) == 2
        assert "would be written over" in capsys.readouterr().err
        assert file.read_bytes() == content


# Our own exports


@pytest.mark.parametrize("robot", ["unitree_g1", pytest.param("unitree_h2", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", WRITABLE)
def test_our_exports_are_what_they_claim(name, robot, tmp_path):
    source = writers.motion(robot=robot)
    chosen = format_named(name)
    for file, content in export(
        Result("clip", "0" * 64, source, writers.model(robot)), chosen, name="clip"
    ).files.items():
        path = tmp_path / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    inside = [path for path in sorted(tmp_path.iterdir()) if path.is_dir()]
    motions = [path for suffix in ("npz", "pkl", "csv") for path in tmp_path.glob(f"clip.{suffix}")]
    checked = check(read((inside or motions)[0]), writers.model(robot))
    assert not checked.contradictions, told(checked)


# Other people's files


@pytest.mark.skipif(not EXPORTS.is_dir(), reason="no files of other programs here")
@pytest.mark.parametrize(
    ("name", "format_name", "subjects"),
    [
        ("asap_phc.pkl", "asap", set()),
        ("gmr.pkl", "gmr", set()),
        ("hdmi_motion.npz", "hdmi", set()),
        ("holosoma_retarget_with_object.npz", "holosoma-retarget", set()),
        # Published with angular velocities that were rotated once too often.
        (
            "holosoma_wbt_with_object.npz",
            "holosoma-wbt",
            {"angular velocities of bodies", "linear velocities of bodies"},
        ),
        ("omniretarget_dataset.npz", "omniretarget", set()),
        ("sbto.pkl", "sbto", set()),
        ("unitree_lafan_first300.csv", "unitree-csv", set()),
    ],
)
def test_real_files(name, format_name, subjects):
    file = read(EXPORTS / name)
    checked = check(file, writers.model())
    assert checked.format == format_name
    assert {item.subject for item in checked.contradictions} == subjects, told(checked)
    converted = as_qpos(file, writers.model())
    assert converted.qpos.shape == (file.frames, 36)
