"""Writes robot motions in other programs' layouts, from a retarget, with MuJoCo's own kinematics."""

import json
import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import synthetic
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.result_file import encode
from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.robots import ROBOTS
from hoi_retarget.robots.model import RobotModel, load_model
from torch_writer import STATE_CONVERSION, Call, torch_bytes

Content = dict[str, Any]


@cache
def model(robot: str = "unitree_g1") -> RobotModel:
    return load_model(ROBOTS[robot])


@cache
def motion(scene: str = "carry_box", robot: str = "unitree_g1", fps: float = 50.0) -> Motion:
    return retarget(synthetic.make(scene, fps=fps, seconds=5.0), model(robot), Config(contact="landmark"))


@dataclass(frozen=True, eq=False)
class Bodies:
    """World poses and velocities of all bodies of an MJCF, the world's left out."""

    names: tuple[str, ...]
    pos: np.ndarray
    quat: np.ndarray
    lin_vel: np.ndarray
    ang_vel: np.ndarray


def velocity(values: np.ndarray, fps: float) -> np.ndarray:
    return np.gradient(values, axis=0) * fps


def angular_velocity(quat: np.ndarray, fps: float) -> np.ndarray:
    before = np.concatenate([quat[:1], quat[:-1]])
    after = np.concatenate([quat[1:], quat[-1:]])
    steps = np.full(len(quat), 2.0)
    steps[[0, -1]] = 1.0
    turn = se3.log(se3.quat_multiply(after, se3.quat_conjugate(before)))
    return turn * fps / steps.reshape(-1, *(1,) * (quat.ndim - 1))


@cache
def bodies(scene: str = "carry_box", robot: str = "unitree_g1") -> Bodies:
    source = motion(scene, robot)
    compiled = mujoco.MjModel.from_xml_path(str(ROBOTS[robot].mjcf))
    data = mujoco.MjData(compiled)
    pos, quat = [], []
    for qpos in source.qpos:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(compiled, data)
        pos.append(data.xpos[1:].copy())
        quat.append(data.xquat[1:].copy())
    names = tuple(compiled.body(index).name for index in range(1, compiled.nbody))
    rotations = se3.quat_continuous(np.array(quat))
    return Bodies(
        names, np.array(pos), rotations, velocity(np.array(pos), source.fps), angular_velocity(rotations, source.fps)
    )


def breadth_first(robot: str = "unitree_g1") -> tuple[np.ndarray, np.ndarray]:
    """Return bodies and joints in Isaac Lab's order, by walking MuJoCo's tree."""
    compiled = mujoco.MjModel.from_xml_path(str(ROBOTS[robot].mjcf))
    order, generation = [], [1]
    while generation:
        order += generation
        generation = [
            body for parent in generation for body in range(1, compiled.nbody) if compiled.body_parentid[body] == parent
        ]
    joints = [int(compiled.body_jntadr[body]) - 1 for body in order[1:]]
    return np.array(order) - 1, np.array(joints)


def tracking(source: Motion, *, breadth: bool) -> Content:
    world = bodies(robot=source.robot)
    order, joints = breadth_first(source.robot) if breadth else (slice(None), slice(None))
    return {
        "fps": np.array([int(source.fps)]),
        "joint_pos": source.qpos[:, 7:][:, joints].astype(np.float32),
        "joint_vel": velocity(source.qpos[:, 7:], source.fps)[:, joints].astype(np.float32),
        "body_pos_w": world.pos[:, order].astype(np.float32),
        "body_quat_w": world.quat[:, order].astype(np.float32),
        "body_lin_vel_w": world.lin_vel[:, order].astype(np.float32),
        "body_ang_vel_w": world.ang_vel[:, order].astype(np.float32),
    }


def holosoma_wbt(source: Motion) -> Content:
    world = bodies(robot=source.robot)
    fps, frames = source.fps, source.frames
    object_pos, object_quat = source.object_pos[:, 0], se3.quat_continuous(source.object_quat[:, 0])

    def around(values: np.ndarray, first: list[float], last: np.ndarray) -> np.ndarray:
        """Return bodies' values with those of the world before them and of the object behind."""
        return np.concatenate([np.tile(first, (frames, 1, 1)), values, last[:, None]], axis=1)

    object_lin, object_ang = velocity(object_pos, fps), angular_velocity(object_quat, fps)
    nothing = [0.0, 0.0, 0.0]
    root_vel = np.concatenate([velocity(source.qpos[:, :3], fps), angular_velocity(source.qpos[:, 3:7], fps)], axis=1)
    return {
        "fps": np.array([int(fps)]),
        "joint_pos": source.qpos.copy(),
        "joint_vel": np.concatenate([root_vel, velocity(source.qpos[:, 7:], fps)], axis=1),
        "body_pos_w": around(world.pos, nothing, object_pos),
        "body_quat_w": around(world.quat, [1.0, *nothing], object_quat),
        "body_lin_vel_w": around(world.lin_vel, nothing, object_lin),
        "body_ang_vel_w": around(world.ang_vel, nothing, object_ang),
        "object_pos_w": object_pos,
        "object_quat_w": object_quat,
        "object_lin_vel_w": object_lin,
        "object_ang_vel_w": object_ang,
        "joint_names": np.array(source.joint_names),
        "body_names": np.array(["world", *world.names, "box_link"]),
    }


def hdmi(source: Motion) -> Content:
    world = bodies(robot=source.robot)
    kept = [index for index, name in enumerate(world.names) if name not in ("waist_yaw_link", "waist_roll_link")]
    pose = source.object_pos[:, 0], se3.quat_continuous(source.object_quat[:, 0])

    def with_object(values: np.ndarray, last: np.ndarray) -> np.ndarray:
        return np.concatenate([values[:, kept], last[:, None]], axis=1)

    return {
        "body_pos_w": with_object(world.pos, pose[0]),
        "body_quat_w": with_object(world.quat, pose[1]),
        "body_lin_vel_w": with_object(world.lin_vel, velocity(pose[0], source.fps)),
        "body_ang_vel_w": with_object(world.ang_vel, angular_velocity(pose[1], source.fps)),
        "joint_pos": source.qpos[:, 7:].copy(),
        "joint_vel": velocity(source.qpos[:, 7:], source.fps),
        "object_contact": source.contact_flags[:, :1],
        "meta": {
            "body_names": [*(world.names[index] for index in kept), "box"],
            "joint_names": list(source.joint_names),
            "fps": source.fps,
        },
    }


def object_pose(source: Motion) -> np.ndarray:
    return np.concatenate([source.object_pos[:, 0], source.object_quat[:, 0]], axis=1)


def swapped(pose: np.ndarray) -> np.ndarray:
    """Return free joints with the rotation before the position."""
    return np.concatenate([pose[:, 3:], pose[:, :3]], axis=1)


def holosoma_retarget(source: Motion) -> Content:
    qpos = np.concatenate([source.qpos, object_pose(source)], axis=1)
    return {
        "qpos": qpos,
        "human_joints": np.zeros((source.frames, 52, 3)),
        "fps": np.array(source.fps),
        "cost": np.array(0.5),
    }


def omniretarget(source: Motion) -> Content:
    qpos = np.concatenate([swapped(source.qpos[:, :7]), source.qpos[:, 7:], swapped(object_pose(source))], axis=1)
    return {"qpos": qpos, "human_joints": np.zeros((source.frames, 52, 3), np.float32), "fps": np.array(source.fps)}


def gmr(source: Motion) -> Content:
    return {
        "fps": source.fps,
        "root_pos": source.qpos[:, :3].copy(),
        "root_rot": se3.quat_to_xyzw(source.qpos[:, 3:7]),
        "dof_pos": source.qpos[:, 7:].copy(),
        "local_body_pos": None,
        "link_body_list": None,
    }


def sbto(source: Motion) -> Content:
    return {
        **gmr(source),
        "object_root_pos": source.object_pos[:, 0].copy(),
        "object_rot": se3.quat_to_xyzw(source.object_quat[:, 0]),
    }


def asap(source: Motion) -> Content:
    kept = [index for index, name in enumerate(source.joint_names) if "wrist" not in name]
    return {
        "walk": {
            "root_trans_offset": source.qpos[:, :3].astype(np.float32),
            "pose_aa": np.zeros((source.frames, 27, 3), np.float32),
            "dof": source.qpos[:, 7:][:, kept].astype(np.float32),
            "root_rot": se3.quat_to_xyzw(source.qpos[:, 3:7]),
            "smpl_joints": np.zeros((source.frames, 24, 3), np.float32),
            "fps": int(source.fps),
        }
    }


def unitree_csv(source: Motion) -> Content:
    root = np.concatenate([source.qpos[:, :3], se3.quat_to_xyzw(source.qpos[:, 3:7])], axis=1)
    return {"table": np.concatenate([root, source.qpos[:, 7:]], axis=1)}


def gmr_npz(source: Motion) -> Content:
    content = gmr(source)
    return {name: np.asarray(content[name]) for name in ("fps", "root_pos", "root_rot")} | {
        "joint_pos": source.qpos[:, 7:].astype(np.float32)
    }


def protomotions(source: Motion) -> Content:
    """Return the G1 with a head and hands, which are fixed to other bodies."""
    world = bodies(robot=source.robot)
    order = list(range(len(world.names)))
    if source.robot == "unitree_g1":
        order.insert(1, world.names.index("torso_link"))
        for side in ("left", "right"):
            wrist = world.names.index(f"{side}_wrist_yaw_link")
            order.insert(order.index(wrist) + 1, wrist)
    floats = {
        "dof_pos": source.qpos[:, 7:],
        "dof_vel": velocity(source.qpos[:, 7:], source.fps),
        "rigid_body_pos": world.pos[:, order],
        "rigid_body_rot": se3.quat_to_xyzw(world.quat[:, order]),
        "rigid_body_vel": world.lin_vel[:, order],
        "rigid_body_ang_vel": world.ang_vel[:, order],
    }
    return {
        "state_conversion": Call(STATE_CONVERSION, ("common",)),
        "fps": int(source.fps),
        **{name: array.astype(np.float32) for name, array in floats.items()},
        "rigid_body_contacts": np.zeros((source.frames, len(order)), dtype=bool),
    }


def named_csv(source: Motion) -> Content:
    times = np.arange(source.frames)[:, None] / source.fps
    header = ["time", *(f"root_{axis}" for axis in "xyz"), *(f"root_q{axis}" for axis in "wxyz"), *source.joint_names]
    return {"header": header, "table": np.concatenate([times, source.qpos], axis=1)}


def seed_csv(source: Motion) -> Content:
    header = ["Frame", *(f"root_{kind}{axis}" for kind in ("translate", "rotate") for axis in "XYZ")]
    angles = Rotation.from_quat(se3.quat_to_xyzw(source.qpos[:, 3:7])).as_euler("xyz", degrees=True)
    columns = [np.arange(source.frames)[:, None], 100.0 * source.qpos[:, :3], angles, np.degrees(source.qpos[:, 7:])]
    return {
        "header": [*header, *(f"{name}_dof" for name in source.joint_names)],
        "table": np.concatenate(columns, axis=1),
    }


def sonic(source: Motion) -> Content:
    order, joints = breadth_first(source.robot)
    world, kept = bodies(robot=source.robot), order[[0, 4, 10]]
    tables = {
        "joint_pos": source.qpos[:, 7:][:, joints],
        "joint_vel": velocity(source.qpos[:, 7:], source.fps)[:, joints],
        "body_pos": world.pos[:, kept].reshape(source.frames, -1),
        "body_quat": world.quat[:, kept].reshape(source.frames, -1),
        "body_lin_vel": world.lin_vel[:, kept].reshape(source.frames, -1),
        "body_ang_vel": world.ang_vel[:, kept].reshape(source.frames, -1),
    }
    return {f"{name}.csv": table for name, table in tables.items()}


MAKERS: dict[str, Callable[[Motion], Content]] = {
    "beyondmimic": lambda source: tracking(source, breadth=True),
    "mjlab": lambda source: tracking(source, breadth=False),
    "holosoma-wbt": holosoma_wbt,
    "hdmi": hdmi,
    "holosoma-retarget": holosoma_retarget,
    "omniretarget": omniretarget,
    "gmr": gmr,
    "sbto": sbto,
    "asap": asap,
    "unitree-csv": unitree_csv,
    "gmr-npz": gmr_npz,
    "protomotions": protomotions,
    "named-csv": named_csv,
    "bones-seed": seed_csv,
    "sonic": sonic,
}
WITHOUT_RATE = {"unitree-csv": 30.0, "bones-seed": 120.0, "sonic": 50.0}
"""Formats that state no rate, with the one that their files have."""
_PICKLES = ("gmr", "sbto", "asap")
_TABLES = ("unitree-csv", "named-csv", "bones-seed")


def save(name: str, content: Content, folder: Path) -> Path:
    """Write content in the layout of a format; return what to read."""
    if name in _TABLES:
        path = folder / "motion.csv"
        _save_table(path, content["table"], content.get("header", ()))
        return path
    if name == "sonic":
        for file, table in content.items():
            _save_table(folder / file, table, [f"{Path(file).stem}_{column}" for column in range(table.shape[1])])
        return folder
    if name == "protomotions":
        path = folder / "walk.motion"
        path.write_bytes(torch_bytes(content))
        return path
    if name in _PICKLES:
        path = folder / "motion.pkl"
        path.write_bytes(pickle.dumps(content))
        return path
    arrays = {key: value for key, value in content.items() if key != "meta"}
    path = folder / "motion.npz"
    np.savez(path, **arrays)
    if "meta" not in content:
        return path
    (folder / "meta.json").write_text(json.dumps(content["meta"]))
    return folder


def _save_table(path: Path, table: np.ndarray, header: Sequence[str]) -> None:
    np.savetxt(path, table, delimiter=",", fmt="%.9f", header=",".join(header), comments="")
    if not header:
        path.write_text(path.read_text().lstrip("\n"))


def write(name: str, folder: Path, spoil: Callable[[Content], None] | None = None) -> Path:
    """Write the test's motion in a format, spoilt where asked; return what to read."""
    if name == "hoi-retarget":
        path = folder / "result.npz"
        path.write_bytes(encode(motion()))
        return path
    content = MAKERS[name](motion())
    if spoil is not None:
        spoil(content)
    return save(name, content, folder)
