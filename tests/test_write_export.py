"""Every format: what is written is read back by its readers' conventions, in a few lines of numpy of our own."""

import io
import json
import pickle
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from export_motions import LINKS, SOURCE, as_result, smooth_motion
from hoi_retarget import __version__
from hoi_retarget.errors import ArgumentError, RobotError
from hoi_retarget.motion.contact_arrays import outward_normals
from hoi_retarget.motion.formats import WRITABLE
from hoi_retarget.motion.formats import read as read_motion
from hoi_retarget.motion.formats.containers import to_pickle
from hoi_retarget.motion.motion_report import Report
from hoi_retarget.motion.result import Result
from hoi_retarget.motion.write_export import NAMES, Exported, export, format_named
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import Surface
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.robots import load_robot, robot
from hoi_retarget.robots.model import RobotModel
from synthetic import make
from synthetic_humanoids import Choices, humanoid
from trajectories import MODELS

EXPORTS = Path(__file__).resolve().parents[1].parent / "shared" / "data" / "exports"
G1, H2 = MODELS["unitree_g1"], MODELS["unitree_h2"]
LAWS = settings(max_examples=8, deadline=None, derandomize=True, database=None)
every_format = pytest.mark.parametrize("name", WRITABLE)

# Isaac Lab's order of the G1's joints, as programs that deploy BeyondMimic's policies list it.
ISAAC_JOINTS = [
    *(f"{side}_hip_pitch" for side in ("left", "right")),
    "waist_yaw",
    *(f"{side}_hip_roll" for side in ("left", "right")),
    "waist_roll",
    *(f"{side}_hip_yaw" for side in ("left", "right")),
    "waist_pitch",
    *(f"{side}_knee" for side in ("left", "right")),
    *(f"{side}_shoulder_pitch" for side in ("left", "right")),
    *(f"{side}_ankle_pitch" for side in ("left", "right")),
    *(f"{side}_shoulder_roll" for side in ("left", "right")),
    *(f"{side}_ankle_roll" for side in ("left", "right")),
    *(f"{side}_shoulder_yaw" for side in ("left", "right")),
    *(f"{side}_elbow" for side in ("left", "right")),
    *(f"{side}_wrist_roll" for side in ("left", "right")),
    *(f"{side}_wrist_pitch" for side in ("left", "right")),
    *(f"{side}_wrist_yaw" for side in ("left", "right")),
]


@dataclass
class Read:
    """A file as its reader understands it: root wxyz, everything by name."""

    fps: float | None
    root: np.ndarray
    joints: dict[str, np.ndarray]
    joint_vel: dict[str, np.ndarray] | None = None
    bodies: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] | None = None
    thing: np.ndarray | None = None
    """The object's position and rotation wxyz."""

    def qpos(self, model: RobotModel) -> np.ndarray:
        return np.concatenate([self.root, np.stack([self.joints[name] for name in model.joint_names], axis=1)], axis=1)


def named(names: list[str], array: np.ndarray) -> dict[str, np.ndarray]:
    assert array.shape[1] == len(names)
    return {name: array[:, column] for column, name in enumerate(names)}


def bodies_of(names: list[str], data: dict[str, np.ndarray]) -> dict:
    keys = ("body_pos_w", "body_quat_w", "body_lin_vel_w", "body_ang_vel_w")
    return {name: tuple(data[key][:, column] for key in keys) for column, name in enumerate(names)}


def npz(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def tracking(path: Path, joint_names: list[str], body_names: list[str]) -> Read:
    data = npz(path)
    bodies = bodies_of(body_names, data)
    root = np.concatenate([data["body_pos_w"][:, 0], data["body_quat_w"][:, 0]], axis=1)
    joints, speeds = named(joint_names, data["joint_pos"]), named(joint_names, data["joint_vel"])
    return Read(float(data["fps"][0]), root, joints, speeds, bodies)


def read_beyondmimic(path: Path, model: RobotModel) -> Read:
    if model is not G1:
        compiled = mujoco.MjModel.from_xml_path(str(model.spec.mjcf))
        levels = [0] * compiled.nbody
        for body in range(1, compiled.nbody):
            levels[body] = levels[compiled.body_parentid[body]] + 1
        order = sorted(range(1, compiled.nbody), key=levels.__getitem__)
        joints = [compiled.joint(int(compiled.body_jntadr[body])).name for body in order[1:]]
        return tracking(path, joints, [compiled.body(body).name for body in order])
    joints = [f"{name}_joint" for name in ISAAC_JOINTS]
    bodies = ["pelvis", *(f"{name}_link" for name in ISAAC_JOINTS)]
    return tracking(path, joints, ["torso_link" if name == "waist_pitch_link" else name for name in bodies])


def read_mjlab(path: Path, model: RobotModel) -> Read:
    compiled = mujoco.MjModel.from_xml_path(str(model.spec.mjcf))
    joints = [compiled.joint(joint).name for joint in range(1, compiled.njnt)]
    return tracking(path, joints, [compiled.body(body).name for body in range(1, compiled.nbody)])


def read_holosoma(path: Path, model: RobotModel) -> Read:
    data = npz(path)
    joint_names, body_names = data["joint_names"].tolist(), data["body_names"].tolist()
    thing = None
    if "object_pos_w" in data:
        thing = np.concatenate([data["object_pos_w"], data["object_quat_w"]], axis=1)
    joints, speeds = named(joint_names, data["joint_pos"][:, 7:]), named(joint_names, data["joint_vel"][:, 6:])
    bodies = bodies_of(body_names, data)
    root = np.concatenate(bodies["pelvis"][:2], axis=1)
    np.testing.assert_allclose(data["joint_pos"][:, :3], root[:, :3], atol=1e-12)
    return Read(float(data["fps"][0]), root, joints, speeds, bodies, thing)


def read_holosoma_qpos(path: Path, model: RobotModel) -> Read:
    data = npz(path)
    qpos = data["qpos"]
    robot = qpos[:, : 7 + model.n]
    thing = qpos[:, 7 + model.n :] if qpos.shape[1] > 7 + model.n else None
    return Read(float(data["fps"]), robot[:, :7], named(list(model.joint_names), robot[:, 7:]), thing=thing)


def read_hdmi(path: Path, model: RobotModel) -> Read:
    data, meta = npz(path / "motion.npz"), json.loads((path / "meta.json").read_text())
    assert list(meta) == ["body_names", "joint_names", "fps"]
    bodies = bodies_of(meta["body_names"], data)
    root = np.concatenate(bodies["pelvis"][:2], axis=1)
    thing = np.concatenate(bodies["thing_0"][:2], axis=1) if "thing_0" in bodies else None
    joints, speeds = named(meta["joint_names"], data["joint_pos"]), named(meta["joint_names"], data["joint_vel"])
    return Read(meta["fps"], root, joints, speeds, bodies, thing)


def read_gmr(path: Path, model: RobotModel) -> Read:
    data = pickle.loads(path.read_bytes())
    root = np.concatenate([data["root_pos"], data["root_rot"][:, [3, 0, 1, 2]]], axis=1)
    return Read(data["fps"], root, named(list(model.joint_names), data["dof_pos"]))


def read_unitree_csv(path: Path, model: RobotModel) -> Read:
    rows = np.loadtxt(path, delimiter=",")
    root = np.concatenate([rows[:, :3], rows[:, [6, 3, 4, 5]]], axis=1)
    return Read(None, root, named(list(model.joint_names), rows[:, 7:]))


def read_named_csv(path: Path, model: RobotModel) -> Read:
    header, *_ = path.read_text().splitlines()
    rows = named(header.split(","), np.loadtxt(path, delimiter=",", skiprows=1))
    root = [f"root_{name}" for name in ("x", "y", "z", "qw", "qx", "qy", "qz")]
    fps = (len(rows["time"]) - 1) / (rows["time"][-1] - rows["time"][0])
    return Read(fps, np.stack([rows[name] for name in root], axis=1), rows)


def read_as_the_package_does(path: Path, model: RobotModel) -> Read:
    """Read a format that has no reader of our own here: by its `Format`, in its convention."""
    file = read_motion(path)
    assert file.root is not None
    pos, quat = file.convention.split(file.root)
    root = np.concatenate([pos, quat if file.convention.quat_order == "wxyz" else se3.quat_from_xyzw(quat)], axis=1)
    return Read(file.fps, root, named(list(file.joint_names or model.joint_names), file.joint_pos))


READERS: dict[str, Callable[[Path, RobotModel], Read]] = {
    **dict.fromkeys(WRITABLE, read_as_the_package_does),
    "beyondmimic": read_beyondmimic,
    "mjlab": read_mjlab,
    "holosoma": read_holosoma,
    "holosoma-qpos": read_holosoma_qpos,
    "hdmi": read_hdmi,
    "gmr": read_gmr,
    "unitree-csv": read_unitree_csv,
    "named-csv": read_named_csv,
}


def written(folder: Path, result: Result, name: str, **options) -> tuple[Path, Exported]:
    """Export and return the main file's path."""
    exported = export(result, WRITABLE[name], name="take", **options)
    for file, content in exported.files.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_bytes(content)
    return folder / f"take{WRITABLE[name].suffix}", exported


def fk(model: RobotModel, qpos: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return MuJoCo's own body positions and rotations."""
    compiled = mujoco.MjModel.from_xml_path(str(model.spec.mjcf))
    data = mujoco.MjData(compiled)
    places = np.zeros((len(qpos), compiled.nbody, 7))
    for frame, configuration in enumerate(qpos):
        data.qpos[:] = configuration
        mujoco.mj_kinematics(compiled, data)
        places[frame] = np.concatenate([data.xpos, data.xquat], axis=1)
    return {compiled.body(k).name: (places[:, k, :3], places[:, k, 3:]) for k in range(1, compiled.nbody)}


def assert_same_rotations(a: np.ndarray, b: np.ndarray, tolerance: float) -> None:
    assert se3.angle_between(a.astype(float), b.astype(float)).max() < tolerance


# round trips


@every_format
@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_at_the_results_own_rate_reading_gives_the_configurations_back(name, model, tmp_path):
    result = as_result(model, seed=1)
    path, _ = written(tmp_path, result, name, fps=30.0)
    read = READERS[name](path, model)
    qpos, expected = read.qpos(model), result.motion.qpos
    assert read.fps in (30.0, None)
    np.testing.assert_allclose(qpos[:, :3], expected[:, :3], atol=3e-7)
    np.testing.assert_allclose(qpos[:, 7:], expected[:, 7:], atol=3e-7)
    assert_same_rotations(qpos[:, 3:7], expected[:, 3:7], 2e-6)


@every_format
def test_bodies_are_where_forward_kinematics_of_the_file_has_them(name, tmp_path):
    path, exported = written(tmp_path, as_result(G1, seed=2), name)
    read = READERS[name](path, G1)
    assert read.root.shape[0] == exported.frames
    places = fk(G1, read.qpos(G1))
    for body, (pos, quat, *_) in (read.bodies or {}).items():
        if body in places:
            np.testing.assert_allclose(pos, places[body][0], atol=1e-5)
            assert_same_rotations(quat, places[body][1], 1e-5)


@pytest.mark.parametrize("name", ["beyondmimic", "mjlab", "holosoma", "hdmi"])
def test_velocities_are_those_of_the_point_the_reader_compares(name, tmp_path):
    """At 1000 frames a second, differences of positions are velocities."""
    path, _ = written(tmp_path, as_result(G1, seed=3, frames=12), name, fps=1000.0)
    read = READERS[name](path, G1)
    compiled = mujoco.MjModel.from_xml_path(str(G1.spec.mjcf))
    of_link = name == "mjlab"
    for joint, speed in (read.joint_vel or {}).items():
        np.testing.assert_allclose(speed[1:-1], (read.joints[joint][2:] - read.joints[joint][:-2]) * 500, atol=5e-3)
    for body, (pos, quat, lin, ang) in (read.bodies or {}).items():
        known = body not in ("world", "thing_0", "thing_0_link")
        centre = compiled.body(body).ipos if known and not of_link else np.zeros(3)
        point = pos + se3.rotate(quat.astype(float), np.broadcast_to(centre, pos.shape))
        np.testing.assert_allclose(lin[1:-1], (point[2:] - point[:-2]) * 500, atol=5e-3)
        turned = se3.log(se3.quat_multiply(quat[2:], se3.quat_conjugate(quat[:-2])).astype(float)) * 500
        np.testing.assert_allclose(ang[1:-1], turned, atol=2e-2)


@pytest.mark.parametrize("name", ["holosoma", "holosoma-qpos", "hdmi"])
def test_the_objects_path_is_in_the_file(name, tmp_path):
    result = as_result(G1, seed=4)
    path, _ = written(tmp_path, result, name, fps=30.0)
    thing = READERS[name](path, G1).thing
    assert thing is not None
    np.testing.assert_allclose(thing[:, :3], result.motion.object_pos[:, 0], atol=1e-12)
    assert_same_rotations(thing[:, 3:], result.motion.object_quat[:, 0], 1e-7)


@every_format
def test_our_own_readers_of_other_programs_files_read_it(name, tmp_path):
    result = as_result(G1, seed=5)
    path, exported = written(tmp_path, result, name, fps=30.0)
    file = read_motion(path)
    assert file.frames == exported.frames == result.motion.frames
    order = [f"{joint}_joint" for joint in ISAAC_JOINTS] if name == "beyondmimic" else list(G1.joint_names)
    columns = [order.index(joint) for joint in G1.joint_names]
    np.testing.assert_allclose(file.joint_pos[:, columns], result.motion.qpos[:, 7:], atol=3e-7)


# rates


@every_format
def test_the_rate_is_what_the_formats_readers_expect(name, tmp_path):
    trackers = dict.fromkeys(("beyondmimic", "mjlab", "holosoma", "hdmi"), 50.0)
    usual = {**trackers, "holosoma-qpos": 30.0, "gmr": 24.0, "named-csv": 24.0, "unitree-csv": 30.0}
    path, exported = written(tmp_path, as_result(G1, fps=24.0), name)
    read = READERS[name](path, G1)
    assert exported.fps == usual.get(name, WRITABLE[name].fps or 24.0)
    assert read.fps is None or abs(read.fps - exported.fps) < 1e-6
    assert abs(len(read.root) / exported.fps - 40 / 24.0) < 0.05


@every_format
@settings(LAWS, max_examples=25)
@given(fps=st.floats(5.0, 200.0))
def test_every_format_states_any_rate_to_the_last_digit(name, fps, tmp_path_factory):
    folder = tmp_path_factory.mktemp("rate")
    path, exported = written(folder, as_result(G1, frames=13), name, fps=fps)
    stated = READERS[name](path, G1).fps
    assert (stated is None) == (name == "unitree-csv")
    assert stated is None or abs(stated - fps) < 1e-6
    assert exported.frames == int(12 * fps / 30.0 + 1e-6) + 1


# layouts


def test_layouts_are_those_of_real_files():
    if not EXPORTS.is_dir():
        pytest.skip("the published files are not here")
    result = as_result(G1)
    real_hdmi = npz(EXPORTS / "hdmi_motion.npz")
    meta = json.loads((EXPORTS / "hdmi_meta.json").read_text())
    files = export(result, WRITABLE["hdmi"], name="take").files
    ours_meta = json.loads(files["take/meta.json"])
    assert list(ours_meta) == list(meta) and ours_meta["joint_names"] == meta["joint_names"]
    assert ours_meta["body_names"][:-1] == meta["body_names"][:-1] and ours_meta["fps"] == meta["fps"]
    ours = arrays_in(files["take/motion.npz"])
    assert_layout(ours, real_hdmi, extra=())

    real = npz(EXPORTS / "holosoma_wbt_with_object.npz")
    ours = arrays_in(export(result, WRITABLE["holosoma"], name="take").files["take.npz"])
    assert_layout(ours, real, extra=("contact_",), other_bodies=True)
    assert ours["joint_names"].tolist() == real["joint_names"].tolist()
    theirs = [name for name in real["body_names"].tolist() if name in ours["body_names"]]
    assert [*theirs, "thing_0_link"] == ours["body_names"].tolist(), "the same order"
    lacking = set(real["body_names"].tolist()) - set(theirs) - {"largebox_link"}
    described = json.loads(export(result, WRITABLE["holosoma"], name="take").files["take.meta.json"])
    assert all(name in described["notes"][1] for name in lacking), "what is not there is told"

    real = npz(EXPORTS / "holosoma_retarget_with_object.npz")
    ours = arrays_in(export(result, WRITABLE["holosoma-qpos"], name="take").files["take.npz"])
    for name in ("qpos", "fps"):
        assert ours[name].dtype == real[name].dtype and ours[name].shape[1:] == real[name].shape[1:]

    rows = (EXPORTS / "unitree_lafan_first300.csv").read_text().splitlines()
    ours_rows = export(result, WRITABLE["unitree-csv"], name="take").files["take.csv"].decode().splitlines()
    assert len(ours_rows[0].split(",")) == len(rows[0].split(",")) == 36

    names = {"fps", "root_pos", "root_rot", "dof_pos", "local_body_pos", "link_body_list"}
    assert set(pickle.loads(export(result, WRITABLE["gmr"], name="take").files["take.pkl"])) == names
    assert all(name.encode() in (EXPORTS / "gmr.pkl").read_bytes() for name in names)


def test_real_files_bodies_are_those_of_our_model():
    """The G1 of HDMI's own file is ours to the last digit: rates, orders and names mean the same."""
    if not EXPORTS.is_dir():
        pytest.skip("the published files are not here")
    data = npz(EXPORTS / "hdmi_motion.npz")
    meta = json.loads((EXPORTS / "hdmi_meta.json").read_text())
    root = np.concatenate([data["body_pos_w"][:, 0], data["body_quat_w"][:, 0]], axis=1)[::40]
    joints = named(meta["joint_names"], data["joint_pos"][::40])
    places = fk(G1, Read(None, root, joints).qpos(G1))
    for column, name in enumerate(meta["body_names"][:-1]):
        np.testing.assert_allclose(data["body_pos_w"][::40, column], places[name][0], atol=1e-5)


def arrays_in(content: bytes) -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def assert_layout(ours: dict, real: dict, *, extra: tuple[str, ...], other_bodies: bool = False) -> None:
    assert {name for name in ours if not name.startswith(extra)} == set(real) if extra else set(ours) == set(real)
    for name, array in real.items():
        assert ours[name].dtype.kind == array.dtype.kind and ours[name].ndim == array.ndim, name
        if array.dtype.kind == "f":
            assert ours[name].dtype == array.dtype, name
        if not other_bodies or "body" not in name:
            assert ours[name].shape[1:] == array.shape[1:], name


@pytest.mark.parametrize("name", ["beyondmimic", "mjlab"])
def test_trackers_files_have_their_keys_in_single_precision(name):
    arrays = arrays_in(export(as_result(G1), WRITABLE[name], name="take").files["take.npz"])
    shapes = {"joint_pos": (29,), "joint_vel": (29,), "body_pos_w": (30, 3), "body_quat_w": (30, 4)}
    shapes |= {"body_lin_vel_w": (30, 3), "body_ang_vel_w": (30, 3)}
    for key, shape in shapes.items():
        assert arrays[key].dtype == np.float32 and arrays[key].shape[1:] == shape
    assert arrays["fps"].shape == (1,) and arrays["fps"][0] == 50
    assert all(key in shapes or key == "fps" or key.startswith("contact_") for key in arrays)


def test_the_two_trackers_orders_differ_as_they_should():
    result = as_result(G1)
    (isaac, mujoco_) = (
        arrays_in(export(result, WRITABLE[name], name="take").files["take.npz"]) for name in ("beyondmimic", "mjlab")
    )
    bodies = ["pelvis", *("torso_link" if joint == "waist_pitch" else f"{joint}_link" for joint in ISAAC_JOINTS)]
    columns = [G1.body_names.index(body) for body in bodies]
    np.testing.assert_array_equal(isaac["body_pos_w"], mujoco_["body_pos_w"][:, columns])
    assert columns != sorted(columns)


@every_format
def test_the_same_result_makes_the_same_bytes(name):
    result = as_result(G1)
    assert export(result, WRITABLE[name], name="take").files == export(result, WRITABLE[name], name="take").files


def test_pickles_name_nothing_that_only_numpy_2_has():
    content = to_pickle({"fps": 30, "a": np.arange(6.0).reshape(2, 3), "b": np.zeros(2)})
    assert b"numpy._core" not in content
    read = pickle.loads(content)
    np.testing.assert_array_equal(read["a"], np.arange(6.0).reshape(2, 3))
    assert read["a"].flags.writeable and read["fps"] == 30


# contacts and what stands beside a file


@every_format
def test_contacts_are_in_the_file_or_beside_it(name):
    result = as_result(G1, objects=2)
    options = {"object_name": "thing_1"} if WRITABLE[name].place_for_object else {}
    exported = export(result, WRITABLE[name], name="take", fps=30.0, **options)
    inside = WRITABLE[name].contacts_inside
    assert ("take.contacts.npz" in exported.files) is not inside
    arrays = arrays_in(exported.files["take.npz" if inside else "take.contacts.npz"])
    motion = result.motion
    np.testing.assert_array_equal(arrays["contact_flags"], motion.contact_flags)
    np.testing.assert_array_equal(arrays["contact_object"], motion.contact_object)
    np.testing.assert_array_equal(arrays["contact_points"], motion.contact_points)
    np.testing.assert_array_equal(arrays["contact_object_pos_w"], motion.object_pos)
    np.testing.assert_array_equal(arrays["contact_stance"], motion.stance_flags)
    assert arrays["contact_links"].tolist() == list(LINKS)
    assert arrays["contact_bodies"].tolist()[:2] == ["left_wrist_yaw_link", "right_wrist_yaw_link"]
    assert np.isnan(arrays["contact_normals"]).all(), "without the clip there is no surface"


def test_the_touching_point_of_a_body_is_the_contact_links_place():
    result = as_result(G1)
    arrays = arrays_in(export(result, WRITABLE["mjlab"], name="take", fps=30.0).files["take.npz"])
    kinematics, places = G1.forward(result.motion.qpos), fk(G1, result.motion.qpos)
    for column, link in enumerate(LINKS):
        pos, quat = places[arrays["contact_bodies"][column]]
        point = pos + se3.rotate(quat, np.broadcast_to(arrays["contact_body_points"][column], pos.shape))
        np.testing.assert_allclose(point, kinematics.site_position(link), atol=1e-9)


def test_hdmis_contact_flag_is_that_of_the_object_in_the_file():
    result = as_result(G1, objects=2, seed=6)
    for index in range(2):
        files = export(result, WRITABLE["hdmi"], name="take", fps=50.0, object_name=f"thing_{index}").files
        contacts, motion = arrays_in(files["take.contacts.npz"]), arrays_in(files["take/motion.npz"])
        touched = (contacts["contact_flags"] & (contacts["contact_object"] == index)).any(axis=1)
        np.testing.assert_array_equal(motion["object_contact"][:, 0], touched)


@pytest.mark.parametrize("name", ["holosoma", "holosoma-qpos", "hdmi"])
def test_motions_without_objects_are_exported_without_one(name, tmp_path):
    path, exported = written(tmp_path, as_result(G1, objects=0), name)
    assert READERS[name](path, G1).thing is None
    file = path / "motion.npz" if path.is_dir() else path
    assert not [key for key in npz(file) if key.startswith("object")]
    assert json.loads(exported.files["take.meta.json"])["objects"] == []


@every_format
def test_the_description_says_what_the_file_does_not(name):
    result = as_result(G1, seed=7)
    exported = export(result, WRITABLE[name], name="take")
    text = exported.files["take.meta.json"].decode()
    meta = json.loads(text)
    assert meta["format"] == name and meta["robot"] == "unitree_g1" and meta["hoi_retarget"] == __version__
    assert sorted(meta["joint_names"]) == sorted(G1.joint_names)
    assert meta["fps"] == exported.fps and meta["frames"] == exported.frames
    assert meta["quaternions"] == ("xyzw" if name in ("gmr", "unitree-csv") else "wxyz")
    assert meta["source"]["licence"] == SOURCE.licence and meta["source"]["sha256"] == SOURCE.sha256
    assert meta["source"]["name"] == "sub1_box_000.pt" and meta["result"]["sha256"] == result.sha256
    assert meta["objects"][0]["name"] == "thing_0" and meta["objects"][0]["scale"] == 0.7
    assert set(meta["files"]) == set(exported.files) - {"take.meta.json"}
    assert "/home" not in text and "somebody" not in text


def test_names_in_the_description_are_in_the_files_order():
    result = as_result(G1)
    meta = json.loads(export(result, WRITABLE["beyondmimic"], name="take").files["take.meta.json"])
    assert meta["joint_names"] == [f"{joint}_joint" for joint in ISAAC_JOINTS]
    assert meta["body_names"][:4] == ["pelvis", "left_hip_pitch_link", "right_hip_pitch_link", "waist_yaw_link"]
    meta = json.loads(export(result, WRITABLE["mjlab"], name="take").files["take.meta.json"])
    assert meta["body_names"] == list(G1.body_names)


def test_a_report_that_says_nothing_is_told_as_unknown():
    result = as_result(G1, report=Report())
    meta = json.loads(export(result, WRITABLE["gmr"], name="take").files["take.meta.json"])
    assert meta["source"]["name"] == meta["source"]["licence"] == "unknown"


# surfaces


def box(*, inverted: bool = False) -> Surface:
    """Return a box of 0.4 x 0.2 x 0.6 m."""
    corners = np.array([(x, y, z) for x in (-0.2, 0.2) for y in (-0.1, 0.1) for z in (-0.3, 0.3)])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([face for a, b, c, d in sides for face in ((a, b, c), (a, c, d))])
    return Surface(corners, faces[:, ::-1] if inverted else faces)


@pytest.mark.parametrize("inverted", [False, True])
def test_normals_face_outwards_however_triangles_are_wound(inverted):
    points = np.array([(0.25, 0, 0), (0.15, 0, 0), (-0.19, 0.01, 0.1), (0, 0.3, 0.05), (0, -0.09, 0), (0, 0, 0.29)])
    expected = np.array([(1, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1)], dtype=float)
    np.testing.assert_allclose(outward_normals(box(inverted=inverted), points), expected, atol=1e-9)


def test_at_an_edge_or_a_corner_the_normal_is_the_mean_of_the_sides():
    points = np.array([(0.3, 0.2, 0.0), (0.3, 0.2, 0.5)])
    expected = np.array([(1, 1, 0) / np.sqrt(2), (1, 1, 1) / np.sqrt(3)])
    np.testing.assert_allclose(outward_normals(box(), points), expected, atol=1e-9)


@LAWS
@given(seed=st.integers(0, 10**6))
def test_normals_of_a_ball_point_away_from_its_middle(seed):
    rng = np.random.default_rng(seed)
    ball = rng.normal(size=(600, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    points = rng.normal(size=(30, 3)) * 0.2
    points += 0.9 * points / np.linalg.norm(points, axis=1, keepdims=True)
    normals = outward_normals(Surface(ball, ConvexHull(ball).simplices, exact=False), points)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-9)
    assert (np.einsum("ki,ki->k", normals, points) > 0.85 * np.linalg.norm(points, axis=1)).all()


def test_normals_of_no_points_are_none():
    assert outward_normals(box(), np.zeros((0, 3))).shape == (0, 3)


@pytest.fixture(scope="module")
def carried() -> Result:
    """A built-in clip's result, with its clip."""
    clip = make("carry_box")
    return Result("carry_box", "ef" * 32, retarget(clip, G1, Config(contact="landmark")), G1, clip)


def test_contacts_with_an_object_of_known_shape_have_normals(carried):
    exported = export(carried, WRITABLE["mjlab"], name="take")
    arrays = arrays_in(exported.files["take.npz"])
    flags, normals = arrays["contact_flags"], arrays["contact_normals"]
    assert flags.any() and np.isfinite(normals[flags]).all() and np.isnan(normals[~flags]).all()
    np.testing.assert_allclose(np.linalg.norm(normals[flags], axis=1), 1.0, atol=1e-9)
    left, right = (normals[flags[:, column], column].mean(axis=0) for column in (0, 1))
    assert left @ right < -0.9, "two hands that carry a box press on opposite sides"
    meta = json.loads(exported.files["take.meta.json"])
    assert meta["contacts"]["normals_of"] == [meta["objects"][0]["name"]]
    assert meta["objects"][0]["shape"] == "triangles"


def test_scaling_an_object_turns_no_normal(carried):
    bigger = replace(
        carried.motion,
        object_scale=2.0 * carried.motion.object_scale,
        contact_points=2.0 * carried.motion.contact_points,
    )
    a, b = (
        arrays_in(export(result, WRITABLE["mjlab"], name="take").files["take.npz"])["contact_normals"]
        for result in (carried, replace(carried, motion=bigger))
    )
    np.testing.assert_allclose(a, b, atol=1e-9)


# what is refused


def test_formats_that_do_not_exist_are_told_with_those_that_do():
    with pytest.raises(ArgumentError) as caught:
        format_named("usd")
    assert all(name in str(caught.value) for name in NAMES)


def test_files_of_added_robots_hold_what_moves_level_by_level(tmp_path, monkeypatch):
    monkeypatch.setenv("HOI_RETARGET_ROBOTS", str(tmp_path / "robots"))
    path = tmp_path / "maker.xml"
    path.write_text(humanoid(Choices(2, fingers=3)).mjcf)
    model = load_robot(robot(str(path)).name)
    assert model.spec.held
    motion = smooth_motion(model)
    files = export(Result("take", "", motion, model), WRITABLE["beyondmimic"], name="take").files
    arrays, meta = arrays_in(files["take.npz"]), json.loads(files["take.meta.json"])
    assert sorted(meta["joint_names"]) == sorted(model.joint_names)
    names = ("", *model.joint_names)
    parent = {name: names[above] for name, above in zip(names[1:], model.parents.tolist(), strict=True)}
    order = {name: place for place, name in enumerate(meta["joint_names"])}
    assert all(not above or order[above] < order[name] for name, above in parent.items())
    assert arrays["joint_pos"].shape[1] == model.n and arrays["body_pos_w"].shape[1] == len(set(meta["body_names"]))
    table = export(Result("take", "", motion, model), WRITABLE["unitree-csv"], name="take").files["take.csv"]
    assert len(table.decode().splitlines()[0].split(",")) == 7 + len(model.spec.joint_order)


@pytest.mark.parametrize("name", ["holosoma", "holosoma-qpos", "hdmi"])
def test_several_objects_ask_for_one_of_them(name, tmp_path):
    result = as_result(G1, objects=3)
    with pytest.raises(ArgumentError, match=r"--object.*thing_0, thing_1, thing_2"):
        export(result, WRITABLE[name], name="take")
    with pytest.raises(ArgumentError, match=r"no such object.*thing_0, thing_1, thing_2"):
        export(result, WRITABLE[name], name="take", object_name="box")
    meta = json.loads(export(result, WRITABLE[name], name="take", object_name="thing_2").files["take.meta.json"])
    assert [item["in_the_format"] for item in meta["objects"]] == [False, False, True]


@pytest.mark.parametrize("name", ["beyondmimic", "mjlab", "gmr", "unitree-csv"])
def test_formats_without_a_place_for_objects_say_so(name):
    with pytest.raises(ArgumentError, match="no place for an object"):
        export(as_result(G1), WRITABLE[name], name="take", object_name="thing_0")


def test_results_that_are_not_the_robots_are_refused():
    motion = as_result(G1).motion
    with pytest.raises(RobotError, match="differing: head_pitch_joint, head_yaw_joint"):
        Result("take", "", motion, H2)
    with pytest.raises(RobotError, match="tail"):
        Result("take", "", replace(motion, contact_links=("left_palm", "right_palm", "left_foot", "tail")), G1)


def test_every_format_has_its_reader_here_and_its_table_in_the_documentation():
    assert set(READERS) == set(WRITABLE)
    text = (Path(__file__).parents[1] / "docs" / "exports.md").read_text()
    assert all(f"## `{name}`" in text for name in NAMES)
