"""Motions of other programs in tables, archives and torch files: columns by their names, orders by the numbers."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import motion_writers as writers
from hoi_retarget.errors import ReadError
from hoi_retarget.motion.check import check
from hoi_retarget.motion.formats import read
from hoi_retarget.numerics import se3
from torch_writer import STATE_CONVERSION, Call, torch_bytes

FOREIGN = Path(__file__).resolve().parents[1].parent / "shared" / "data" / "foreign" / "motions"
needs_foreign = pytest.mark.skipif(not FOREIGN.is_dir(), reason="no files of other programs here")
BOUNDED = settings(derandomize=True, deadline=None, max_examples=25, database=None)
QPOS = writers.motion().qpos
JOINTS = list(writers.motion().joint_names)
ROOT = [*(f"root_{axis}" for axis in "xyz"), *(f"root_q{axis}" for axis in "wxyz")]


def table(folder: Path, header: list[str], columns: np.ndarray, frames: int = 5) -> Path:
    path = folder / "motion.csv"
    lines = [",".join(header), *(",".join(map(repr, row.tolist())) for row in columns[:frames])]
    path.write_text("\n".join(lines))
    return path


def refused(path: Path, *words: str) -> None:
    with pytest.raises(ReadError) as caught:
        read(path)
    for word in words:
        assert word in str(caught.value), str(caught.value)


# Columns by their names


@BOUNDED
@given(st.permutations(range(36)))
def test_columns_in_any_order_are_one_motion(tmp_path_factory, order):
    header = [[*ROOT, *JOINTS][column] for column in order]
    file = read(table(tmp_path_factory.mktemp("csv"), header, QPOS[:, order]))
    assert file.format == "named-csv"
    assert file.convention.quat_order == "wxyz"
    assert file.root is not None
    assert file.joint_names is not None
    assert np.array_equal(file.root, QPOS[:5, :7])
    for column, name in enumerate(file.joint_names):
        assert np.array_equal(file.joint_pos[:, column], QPOS[:5, 7 + JOINTS.index(name)])


@pytest.mark.parametrize(
    ("position", "rotation"),
    [
        ("x y z", "qw qx qy qz"),
        ("root_tx root_ty root_tz", "root_qw root_qx root_qy root_qz"),
        ("root_pos_x root_pos_y root_pos_z", "root_rot_w root_rot_x root_rot_y root_rot_z"),
        ("Root_PosX Root_PosY Root_PosZ", "Root_QuatW Root_QuatX Root_QuatY Root_QuatZ"),
        ("pelvis_x pelvis_y pelvis_z", "pelvis_quat_w pelvis_quat_x pelvis_quat_y pelvis_quat_z"),
        ("base.position.x base.position.y base.position.z", "orientation_w orientation_x orientation_y orientation_z"),
        ("root_x root_y root_z", "quat_w quat_x quat_y quat_z"),
    ],
)
@pytest.mark.parametrize("ending", ["", "_dof", "_pos"])
def test_roots_are_found_by_the_names_in_use(position, rotation, ending, tmp_path):
    header = [*position.split(), *rotation.split(), *(f"{name}{ending}" for name in JOINTS)]
    file = read(table(tmp_path, header, QPOS))
    assert file.root is not None
    assert np.array_equal(file.root, QPOS[:5, :7])
    assert file.joint_names == tuple(JOINTS)


def test_a_header_may_be_quoted_or_a_comment(tmp_path):
    for first in ('"{}"', "# {}"):
        header = [*ROOT, *JOINTS]
        path = table(tmp_path, [first.format(header[0]), *header[1:]], QPOS)
        assert read(path).joint_names == tuple(JOINTS)


def test_numbered_joints_are_taken_by_their_numbers(tmp_path):
    order = np.random.default_rng(0).permutation(29)
    header = [*ROOT, *(f"joint_{number}" for number in order)]
    file = read(table(tmp_path, header, np.concatenate([QPOS[:, :7], QPOS[:, 7:][:, order]], axis=1)))
    assert file.joint_names is None
    assert np.array_equal(file.joint_pos, QPOS[:5, 7:])


def test_times_give_the_rate_and_counters_are_no_joints(tmp_path):
    times = np.arange(len(QPOS))[:, None] / 120.0
    columns = np.concatenate([np.arange(len(QPOS))[:, None], times, QPOS], axis=1)
    path = table(tmp_path, ["Frame", "time", *ROOT, *JOINTS], columns)
    assert read(path).fps == pytest.approx(120.0)
    assert read(path).joint_names == tuple(JOINTS)
    columns[3:, 1] += 0.5
    refused(table(tmp_path, ["Frame", "time", *ROOT, *JOINTS], columns), "no even steps", "0.508")


def test_columns_that_are_no_joint_of_the_robot_are_named(tmp_path):
    columns = np.concatenate([QPOS, QPOS[:, :1]], axis=1)
    checked = check(read(table(tmp_path, [*ROOT, *JOINTS, "left_contact"], columns, 200)), writers.model())
    assert not checked.contradictions
    assert any("the file has others, too: left_contact" in item.numbers for item in checked.findings)


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ([*ROOT[:3], "root_rx", "root_ry", "root_rz", *JOINTS], "three angles"),
        ([*ROOT[:3], "a", "b", "c", "d", *JOINTS], "no columns name the root's rotation"),
        (["a", "b", "c", *ROOT[3:], *JOINTS], "no columns name the root's position"),
        ([*ROOT, "base_x", "base_y", "base_z"], "several columns name the root's position"),
        (ROOT, "no column is a joint"),
        ([*ROOT, *JOINTS[:-1], JOINTS[0]], "twice"),
    ],
)
def test_tables_whose_names_do_not_tell_are_refused(header, words, tmp_path):
    refused(table(tmp_path, header, np.ones((5, len(header)))), words, "motion.csv")


@BOUNDED
@given(st.floats(-170, 170), st.floats(-80, 80), st.floats(-170, 170))
def test_angles_of_bones_seed_turn_about_the_axes_of_the_world(tmp_path_factory, x, y, z):
    header = [f"root_{kind}{axis}" for kind in ("translate", "rotate") for axis in "XYZ"]
    row = np.array([[100.0, 200.0, 80.0, x, y, z, 90.0]])
    file = read(table(tmp_path_factory.mktemp("seed"), [*header, "left_knee_joint_dof"], np.repeat(row, 4, axis=0)))
    assert file.root is not None
    cos, sin = np.cos(np.radians([x, y, z])), np.sin(np.radians([x, y, z]))
    about_x = np.array([[1, 0, 0], [0, cos[0], -sin[0]], [0, sin[0], cos[0]]])
    about_y = np.array([[cos[1], 0, sin[1]], [0, 1, 0], [-sin[1], 0, cos[1]]])
    about_z = np.array([[cos[2], -sin[2], 0], [sin[2], cos[2], 0], [0, 0, 1]])
    assert np.abs(se3.quat_to_matrix(file.root[0, 3:]) - about_z @ about_y @ about_x).max() < 1e-12
    assert np.allclose(file.root[0, :3], [1.0, 2.0, 0.8])
    assert np.allclose(file.joint_pos, np.pi / 2)


# Folders


def test_a_folder_of_tables_without_the_root_is_refused(tmp_path):
    (writers.write("sonic", tmp_path) / "body_quat.csv").unlink()
    refused(tmp_path, "body_quat.csv: there is no such file")


def test_tables_of_one_folder_have_the_same_frames(tmp_path):
    path = writers.write("sonic", tmp_path) / "body_pos.csv"
    path.write_text("\n".join(path.read_text().splitlines()[:-1]))
    refused(tmp_path, "are no pose over time")


def test_a_folder_of_one_motion_is_that_motion_and_of_several_names_them(tmp_path):
    (tmp_path / "first").mkdir()
    writers.write("sonic", tmp_path / "first")
    (tmp_path / "notes.txt").write_text("no motion")
    assert read(tmp_path).format == "sonic"
    writers.write("unitree-csv", tmp_path)
    refused(tmp_path, "2 motions in this folder (first, motion.csv)", "Name one")


# Orders by the numbers


@pytest.mark.parametrize("quaternions", ["xyzw", "wxyz"])
@pytest.mark.parametrize("isaac_lab", [False, True])
@pytest.mark.parametrize("stated", [False, True])
def test_orders_that_a_format_leaves_open_are_found_and_said(quaternions, isaac_lab, stated, tmp_path):
    content = writers.gmr_npz(writers.motion())
    content["root_rot"] = se3.quat_to_xyzw(QPOS[:, 3:7]) if quaternions == "xyzw" else QPOS[:, 3:7]
    content["joint_pos"] = QPOS[:, 7:][:, writers.breadth_first()[1]] if isaac_lab else QPOS[:, 7:]
    if stated:
        content["quat_convention"] = np.array(quaternions)
    checked = check(read(writers.save("gmr-npz", content, tmp_path)), writers.model())
    assert not checked.contradictions
    assert np.abs(checked.qpos - QPOS).max() < 1e-12
    said = [item.numbers for item in checked.findings if item.subject == "orders"]
    order = "Isaac Lab's breadth-first" if isaac_lab else "MuJoCo's depth-first"
    assert said[0].startswith(f"quaternions {quaternions}, joints in {order} order:")


def test_a_stated_order_that_the_numbers_contradict_is_wrong(tmp_path):
    content = writers.gmr_npz(writers.motion()) | {"quat_convention": np.array("wxyz")}
    path = writers.save("gmr-npz", content, tmp_path)
    assert "quaternion order" in {item.subject for item in check(read(path), writers.model()).contradictions}
    refused(writers.save("gmr-npz", content | {"quat_convention": np.array("zyx")}, tmp_path), "'zyx'")


# Torch files


def test_a_motion_in_a_simulators_own_order_is_refused(tmp_path):
    content = writers.protomotions(writers.motion())
    content["state_conversion"] = Call(STATE_CONVERSION, ("simulator",))
    refused(writers.save("protomotions", content, tmp_path), "'simulator'", "walk.motion")


@pytest.mark.parametrize(
    "value", [Call(STATE_CONVERSION, (1,)), Call(STATE_CONVERSION, ()), Call(print, ("executed",))]
)
def test_nothing_but_a_text_stands_for_a_member(value, tmp_path, capsys):
    path = tmp_path / "evil.motion"
    path.write_bytes(torch_bytes({"state_conversion": value}))
    refused(path, "evil.motion")
    assert not capsys.readouterr().out


def test_a_motion_of_another_robot_has_no_names(tmp_path):
    content = writers.protomotions(writers.motion())
    content = {name: array[:, :24] if name.startswith("rigid") else array for name, array in content.items()}
    file = read(writers.save("protomotions", content, tmp_path))
    assert file.body_names is None
    checked = check(file, writers.model())
    assert any(item.subject == "body order" and item.level == "unknown" for item in checked.findings)
    assert not checked.contradictions


# Other people's files


@needs_foreign
def test_the_two_files_of_kimodo_are_one_motion():
    csv, motion = (
        check(read(FOREIGN / "kimodo" / f"output_walk.{kind}"), writers.model()) for kind in ("csv", "motion")
    )
    assert {item.subject for item in csv.contradictions} == {"quaternion order"}
    assert not motion.contradictions
    turned = se3.angle_between(csv.qpos[:, 3:7], motion.qpos[:, 3:7])
    assert turned.max() < 1e-6
    assert np.abs(csv.qpos[:, 7:] - motion.qpos[:, 7:]).max() < 1e-6
    assert np.abs(csv.qpos[:, :2] - motion.qpos[:, :2]).max() < 1e-6
    # ProtoMotions' converter moves every frame up or down until its lowest body is at one height.
    assert np.abs(csv.qpos[:, 2] - motion.qpos[:, 2]).max() < 0.02


@needs_foreign
def test_an_archive_in_isaac_labs_order_is_no_contradiction():
    checked = check(read(FOREIGN / "gmr_view" / "000007.npz"), writers.model())
    said = [item.numbers for item in checked.findings if item.subject == "orders"]
    assert said[0].startswith("quaternions wxyz, joints in Isaac Lab's breadth-first order")
    assert {item.subject for item in checked.contradictions} <= {"jump"}
