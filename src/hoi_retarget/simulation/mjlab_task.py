"""A motion as a task for mjlab: data of one motion, and the Python package that trains on it.

The package is `hoi_retarget_mjlab` beside this file, copied byte for byte: nothing of a motion is ever put into code.
The data of a motion is in JSON, MJCF and arrays with plain letters as names, so that names in recordings are data
and nothing else. A folder beside the package tells Python's `importlib.metadata` that it has tasks for mjlab.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float

from hoi_retarget.dynamics import physics_scene
from hoi_retarget.errors import ClipError
from hoi_retarget.evaluation.thresholds import fatal_fault
from hoi_retarget.files import npz
from hoi_retarget.motion.contact_arrays import contact_arrays
from hoi_retarget.motion.formats.containers import to_json
from hoi_retarget.motion.motion import SIMULATED, Motion
from hoi_retarget.motion.resample import ResampledMotion, resample
from hoi_retarget.motion.result import Result
from hoi_retarget.numerics import se3
from hoi_retarget.objects.object_joint import root_of
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.spec import SIDES

NAME = "mjlab-task"  # As `--to` has it.
FORMAT = "hoi-retarget mjlab task 2"
PACKAGE, TASKS = "hoi_retarget_mjlab", "tasks"
RATE = 50.0  # Of the policy [1/s]; mjlab's environment makes four steps of 5 ms for each of its actions.
_TIMESTEP = 0.005
_ACTION_SHARE = 0.25
"""An action of 1 moves a drive's target so far that the drive gives this share of its torque limit."""
_MIN_CONTACTS = 96
_TRACKED = ("hip", "knee", "foot", "shoulder", "elbow", "palm")
"""Sites on either side whose bodies are compared with the reference, beside root and torso."""
_ENDS = ("foot", "palm")  # Those of them whose height ends an episode when it is far off.
_ENTRY_POINTS = f"[mjlab.tasks]\n{PACKAGE} = {PACKAGE}\n"
_METADATA = f"Metadata-Version: 2.1\nName: {PACKAGE.replace('_', '-')}\nVersion: 1\n"


@dataclass(frozen=True, eq=False)
class TrainingTask:
    """A motion as a task."""

    id: str  # What mjlab's commands call it.
    files: Mapping[Path, bytes]  # By their places in the folder of all tasks, without those of the package.
    frames: int  # At `RATE`.


def check_usable(motion: Motion) -> None:
    """Raise `ClipError` for a motion that no robot should be trained on."""
    if fault := fatal_fault(motion):
        raise ClipError(f"it is no reference to train on: {fault}")
    if motion.stages[-1].name == "ik":
        raise ClipError(
            "it ends with inverse kinematics, in which hands do not touch anything yet; the stages to train on are "
            "the trajectory and what was performed in simulation. Run the retarget again."
        )


def task_of(result: Result, scene: physics_scene.PhysicsScene) -> TrainingTask:
    """Return a result as a task, with the masses, frictions and drives of its scene; its last stage is the reference.

    Raises `ClipError`: it is no reference to train on, or has a single frame; `RobotError`: MuJoCo cannot compile the
    robot with the objects, or it has meshes.
    """
    check_usable(result.motion)
    name = plain_name(result.stem)
    resampled = resample(result.motion, result.model, RATE)
    states = _states(resampled, scene)
    folder = Path(PACKAGE) / TASKS / name
    robot = physics_scene.robot_description(scene)
    physics_scene.check_no_meshes(scene, robot)
    _place(robot, resampled.qpos[0])
    root = physics_scene.exact_xml(scene, robot)
    for actuators in root.findall("actuator"):  # mjlab makes the drives of the task's numbers.
        root.remove(actuators)
    files = {folder / "robot.xml": physics_scene.to_bytes(root)}
    for number in [index for index, item in enumerate(scene.objects) if item.parent < 0]:
        description = physics_scene.object_description(scene, number)
        _place(description, _first_pose(resampled, number))
        # An object that is fixed in the world stands in each of mjlab's environments, which moves such bodies alone.
        description.worldbody.first_body().mocap = scene.objects[number].path is not None
        files[folder / f"object_{number}.xml"] = physics_scene.to_bytes(physics_scene.exact_xml(scene, description))
    files[folder / "motion.npz"] = npz.encode(_arrays(resampled, states, scene))
    facts = _description(result, scene, resampled, states, f"Hoi-{name}")
    geoms = [geom.name for body in facts["contact_bodies"] for geom in robot.body(body).geoms if geom.contype]
    facts["touching"] = [name for name in geoms if name not in physics_scene.SOLES]
    files[folder / "task.json"] = to_json(facts)
    return TrainingTask(f"Hoi-{name}", files, resampled.frames)


def package_files() -> Mapping[Path, bytes]:
    """Return the files shared by all tasks of a folder, by place: code, and its registration with mjlab."""
    source = Path(__file__).with_name(PACKAGE)
    code = {Path(PACKAGE) / path.name: path.read_bytes() for path in sorted(source.glob("*.py"))}
    known = Path(f"{PACKAGE}-1.dist-info")
    return {**code, known / "METADATA": _METADATA.encode(), known / "entry_points.txt": _ENTRY_POINTS.encode()}


def plain_name(text: str) -> str:
    """Return a name of letters, digits, `_` and `-` for a folder, a task and a command line."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", text).strip("_-") or "motion"


def tracked_bodies(model: RobotModel) -> tuple[str, ...]:
    """Return the bodies that are compared with the reference: the root, which is first, the torso, and the limbs'."""
    sites = ("torso", *(f"{side}_{part}" for side in SIDES for part in _TRACKED))
    return tuple(dict.fromkeys((model.body_frames.names[0], *map(model.body_of, sites))))


@dataclass(frozen=True, eq=False)
class _States:
    """All bodies of a scene's robot along a motion, as MuJoCo has them; B bodies in the MJCF's order."""

    names: tuple[str, ...]
    pos: Float[np.ndarray, "T B 3"]
    quat: Float[np.ndarray, "T B 4"]
    lin_vel: Float[np.ndarray, "T B 3"]  # Of the bodies' origins [m/s].
    ang_vel: Float[np.ndarray, "T B 3"]
    contacts: int  # Most contacts of a frame, and of the pose in which mjlab makes its environments.


def _states(resampled: ResampledMotion, scene: physics_scene.PhysicsScene) -> _States:
    simulated = physics_scene.compiled(scene)
    data, twist = mujoco.MjData(simulated), np.empty(6)
    count = len(scene.model.body_frames.names)
    qpos, qvel = _coordinates(resampled, scene)
    pos, quat = np.empty((len(qpos), count, 3)), np.empty((len(qpos), count, 4))
    lin_vel, ang_vel, contacts = np.empty_like(pos), np.empty_like(pos), 0
    for frame in range(len(qpos)):
        data.qpos[:], data.qvel[:] = qpos[frame], qvel[frame]
        mujoco.mj_forward(simulated, data)
        contacts = max(contacts, data.ncon)
        pos[frame], quat[frame] = data.xpos[1 : 1 + count], data.xquat[1 : 1 + count]
        for body in range(count):
            mujoco.mj_objectVelocity(simulated, data, mujoco.mjtObj.mjOBJ_XBODY, 1 + body, twist, 0)
            ang_vel[frame, body], lin_vel[frame, body] = twist[:3], twist[3:]
    data.qpos[:] = qpos[0]
    data.qpos[7 : 7 + scene.model.n] = 0.0
    mujoco.mj_forward(simulated, data)
    names = tuple(simulated.body(1 + body).name for body in range(count))
    contacts = max(contacts, data.ncon)
    return _States(names, pos, se3.quat_continuous(quat), lin_vel, ang_vel, contacts)


def _coordinates(resampled: ResampledMotion, scene: physics_scene.PhysicsScene) -> tuple[np.ndarray, np.ndarray]:
    """Return a scene's configurations and velocities: MuJoCo has a free body's spin in the body's own axes."""
    spins = se3.rotate(se3.quat_conjugate(resampled.object_quat), resampled.object_ang_vel)
    speeds = np.concatenate([resampled.object_lin_vel, spins], axis=2)
    root_spin = se3.rotate(se3.quat_conjugate(resampled.qpos[:, 3:7]), resampled.root_ang_vel)
    qpos, qvel = [resampled.qpos], [resampled.root_lin_vel, root_spin, resampled.joint_vel]
    for index, own in scene.object_qpos(resampled.object_pos, resampled.object_quat).items():
        qpos.append(own)
        qvel.append(speeds[:, index] if scene.objects[index].path is None else np.gradient(own, 1.0 / RATE, axis=0))
    return np.concatenate(qpos, axis=1), np.concatenate(qvel, axis=1)


def _arrays(resampled: ResampledMotion, states: _States, scene: physics_scene.PhysicsScene) -> dict[str, np.ndarray]:
    """Return the arrays of mjlab's tracking task, and behind them objects and contacts."""
    contacts = contact_arrays(resampled, {})
    names = ("contact_links", "contact_bodies", "contact_body_points", "contact_flags", "contact_object")
    angles = np.zeros((resampled.frames, len(scene.objects)))  # Of objects on joints.
    for index, own in scene.object_qpos(resampled.object_pos, resampled.object_quat).items():
        angles[:, index] = own[:, 0] if own.shape[1] == 1 else 0.0
    return {
        "fps": np.array([RATE]),
        "joint_names": np.array(resampled.motion.joint_names, dtype=np.str_),
        "body_names": np.array(states.names, dtype=np.str_),
        "joint_pos": resampled.qpos[:, 7:],
        "joint_vel": resampled.joint_vel,
        "body_pos_w": states.pos,
        "body_quat_w": states.quat,
        "body_lin_vel_w": states.lin_vel,
        "body_ang_vel_w": states.ang_vel,
        "object_pos_w": resampled.object_pos,
        "object_quat_w": resampled.object_quat,
        "object_lin_vel_w": resampled.object_lin_vel,
        "object_ang_vel_w": resampled.object_ang_vel,
        "object_joint_pos": angles,
        "object_joint_vel": np.asarray(np.gradient(angles, 1.0 / RATE, axis=0)),
        **{name: contacts[name] for name in names},
    }


def _description(
    result: Result, scene: physics_scene.PhysicsScene, resampled: ResampledMotion, states: _States, task_id: str
) -> dict[str, Any]:
    model, motion, physics = scene.model, result.motion, scene.physics
    most = max(_MIN_CONTACTS, 2 * states.contacts)  # A fall makes more of them than the motion has.
    return {
        "format": FORMAT,
        "id": task_id,
        "robot": motion.robot,
        "stage": motion.stages[-1].name,
        "performed_in_simulation": motion.stages[-1].name == SIMULATED,
        "frames": len(states.pos),
        "joints": [_joint(scene, index) for index in range(model.n)],
        "root": _pose(resampled.qpos[0]),
        "anchor_body": model.body_of("torso"),
        "tracked_bodies": list(tracked_bodies(model)),
        "end_bodies": list(_bodies(model, [f"{side}_{part}" for side in SIDES for part in _ENDS])),
        "contact_bodies": list(_bodies(model, motion.contact_links)),
        "objects": [
            {
                "name": item.body.name,
                "body": item.body_name,
                "mass": item.body.mass,
                "shape": item.shape.text,
                "root": root_of([one.parent for one in scene.objects], index),
                "joint": "free" if item.path is None else item.path.joint.kind,
                **_pose(_first_pose(resampled, index)),
            }
            for index, item in enumerate(scene.objects)
        ],
        "floor": physics_scene.floor_contacts(physics),
        "soles": sorted(physics_scene.SOLES),
        "hand_friction": physics.hand_friction,
        "floor_friction": physics.floor_friction,
        "object_friction": physics.object_friction,
        "timestep": _TIMESTEP,
        "decimation": round(1.0 / RATE / _TIMESTEP),
        "most_contacts": most,
        "most_constraints": 6 * most + 2 * model.n,  # Friction pyramids with torsion have six edges.
        **result.origin(),
    }


def _joint(scene: physics_scene.PhysicsScene, index: int) -> dict[str, Any]:
    drives = scene.actuators
    stiffness, torque = float(drives.stiffness[index]), float(drives.torque[index])
    return {
        "name": scene.model.joint_names[index],
        "home": float(scene.model.home_qpos[7 + index]),
        "stiffness": stiffness,
        "damping": float(drives.damping[index]),
        "armature": float(drives.armature[index]),
        "torque": torque,
        "action_scale": _ACTION_SHARE * torque / stiffness,
    }


def _pose(values: np.ndarray) -> dict[str, list[float]]:
    return {"pos": values[:3].tolist(), "quat": values[3:7].tolist()}


def _bodies(model: RobotModel, sites: Sequence[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(map(model.body_of, sites)))


def _first_pose(resampled: ResampledMotion, index: int) -> Float[np.ndarray, "7"]:
    return np.concatenate([resampled.object_pos[0, index], resampled.object_quat[0, index]])


def _place(description: mujoco.MjSpec, pose: np.ndarray) -> None:
    """Put a free body where it is at first: where mjlab makes its environments, nothing is inside anything else."""
    body = description.worldbody.first_body()
    body.pos, body.quat = pose[:3], pose[3:7]
