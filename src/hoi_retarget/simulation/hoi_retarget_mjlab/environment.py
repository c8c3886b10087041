"""A task's environment: mjlab's tracking task with the robot of the data, and rewards and terminations of objects."""

import json
import re
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
from mjlab.actuator import BuiltinPositionActuatorCfg
from mjlab.entity import EntityArticulationInfoCfg, EntityCfg
from mjlab.envs import ManagerBasedRlEnvCfg
from mjlab.envs import mdp as common
from mjlab.envs.mdp import dr
from mjlab.managers.event_manager import EventTermCfg
from mjlab.managers.observation_manager import ObservationTermCfg
from mjlab.managers.reward_manager import RewardTermCfg
from mjlab.managers.scene_entity_config import SceneEntityCfg
from mjlab.managers.termination_manager import TerminationTermCfg
from mjlab.rl import RslRlOnPolicyRunnerCfg
from mjlab.sensor import ContactMatch, ContactSensorCfg
from mjlab.tasks.registry import register_mjlab_task
from mjlab.tasks.tracking.config.g1.rl_cfg import unitree_g1_tracking_ppo_runner_cfg
from mjlab.tasks.tracking.rl import MotionTrackingOnPolicyRunner
from mjlab.tasks.tracking.tracking_env_cfg import make_tracking_env_cfg
from mjlab.utils.noise import UniformNoiseCfg

from . import terms
from .command import ObjectMotionCommandCfg

FORMAT = "hoi-retarget mjlab task 2"
FLOOR = "terrain"  # Entity, body and geometry of mjlab's plane.
FRICTION_STIFFNESS = 10.0  # As in the scene: with pyramidal cones, what is held creeps.
OFFSETS = {"x": (-0.03, 0.03), "y": (-0.03, 0.03), "z": (-0.01, 0.01), "roll": (-0.05, 0.05), "pitch": (-0.05, 0.05)}
OFFSETS["yaw"] = (-0.1, 0.1)
PUSHES = {"x": (-0.3, 0.3), "y": (-0.3, 0.3), "z": (-0.1, 0.1), "roll": (-0.3, 0.3), "pitch": (-0.3, 0.3)}
PUSHES["yaw"] = (-0.4, 0.4)  # Less than mjlab's by about half: a robot with a load in its hands is pushed.


def register_task(folder: Path) -> None:
    """Tell mjlab of the task in a folder."""
    task = json.loads((folder / "task.json").read_text(encoding="utf-8"))
    if task["format"] != FORMAT:
        raise ValueError(f"{folder}: its format is {task['format']!r}, and this package reads {FORMAT!r}.")
    register_mjlab_task(
        task_id=task["id"],
        env_cfg=environment(task, folder),
        play_env_cfg=environment(task, folder, play=True),
        rl_cfg=training(task),
        runner_cls=MotionTrackingOnPolicyRunner,
    )


def training(task: dict[str, Any]) -> RslRlOnPolicyRunnerCfg:
    """Return the settings of PPO: those of mjlab's tracking task, and logs that need no account."""
    settings = unitree_g1_tracking_ppo_runner_cfg()
    settings.experiment_name = task["id"]
    settings.logger, settings.upload_model = "tensorboard", False
    return settings


def environment(task: dict[str, Any], folder: Path, *, play: bool = False) -> ManagerBasedRlEnvCfg:
    """Return an environment; to `play` means from the first frame on, without noise, pushes and end."""
    cfg = make_tracking_env_cfg()
    _set_scene(cfg, task, folder)
    _set_robot(cfg, task, folder)
    if task["objects"]:
        _add_objects(cfg, task)
    if play:
        cfg.episode_length_s = 1e9
        cfg.observations["actor"].enable_corruption = False
        cfg.events.pop("push_robot")
        command = cfg.commands["motion"]
        command.pose_range, command.velocity_range, command.joint_position_range = {}, {}, (0.0, 0.0)
        command.sampling_mode = "start"
    return cfg


def _set_scene(cfg: ManagerBasedRlEnvCfg, task: dict[str, Any], folder: Path) -> None:
    names = [f"object_{item['root']}" for item in task["objects"]]
    cfg.scene.entities = {"robot": _robot(task, folder)}
    for number, item in _roots(task):
        name = f"object_{number}"
        read = partial(_read, str(folder / f"{name}.xml"))
        start = EntityCfg.InitialStateCfg(pos=tuple(item["pos"]), rot=tuple(item["quat"]))
        cfg.scene.entities[name] = EntityCfg(spec_fn=read, init_state=start)
    cfg.scene.spec_fn = partial(_set_floor, task["floor"])
    cfg.scene.sensors = tuple(
        ContactSensorCfg(
            name=f"touch_{number}",
            primary=ContactMatch("body", _exactly(task["contact_bodies"]), "robot"),
            secondary=ContactMatch("body", _exactly([item["body"]])[0], name),
            fields=("found", "force"),
            reduce="netforce",
        )
        for number, (name, item) in enumerate(zip(names, task["objects"], strict=True))
        if task["contact_bodies"]
    )
    cfg.decimation = task["decimation"]
    cfg.sim.mujoco.timestep = task["timestep"]
    cfg.sim.mujoco.cone, cfg.sim.mujoco.impratio = "elliptic", FRICTION_STIFFNESS
    cfg.sim.nconmax, cfg.sim.njmax = task["most_contacts"], task["most_constraints"]


def _robot(task: dict[str, Any], folder: Path) -> EntityCfg:
    drives: dict[tuple[float, ...], list[str]] = {}
    for joint in task["joints"]:
        gains = tuple(joint[name] for name in ("stiffness", "damping", "torque", "armature"))
        drives.setdefault(gains, []).append(joint["name"])
    actuators = tuple(
        BuiltinPositionActuatorCfg(
            target_names_expr=_exactly(names),
            stiffness=stiffness,
            damping=damping,
            effort_limit=torque,
            armature=armature,
        )
        for (stiffness, damping, torque, armature), names in drives.items()
    )
    home = {pattern: joint["home"] for joint in task["joints"] for pattern in _exactly([joint["name"]])}
    return EntityCfg(
        spec_fn=partial(_read, str(folder / "robot.xml")),
        init_state=EntityCfg.InitialStateCfg(
            pos=tuple(task["root"]["pos"]), rot=tuple(task["root"]["quat"]), joint_pos=home
        ),
        articulation=EntityArticulationInfoCfg(actuators=actuators, soft_joint_pos_limit_factor=1.0),
        sort_actuators=True,
    )


def _set_robot(cfg: ManagerBasedRlEnvCfg, task: dict[str, Any], folder: Path) -> None:
    """Fill in the open fields of mjlab's tracking task, and its fields for its own G1 alone."""
    scale = {pattern: joint["action_scale"] for joint in task["joints"] for pattern in _exactly([joint["name"]])}
    cfg.actions["joint_pos"].scale = scale
    cfg.commands["motion"] = ObjectMotionCommandCfg(
        entity_name="robot",
        resampling_time_range=(1e9, 1e9),
        debug_vis=True,
        pose_range=OFFSETS,
        velocity_range=PUSHES,
        joint_position_range=(-0.05, 0.05),
        motion_file=str(folder / "motion.npz"),
        anchor_body_name=task["anchor_body"],
        body_names=tuple(task["tracked_bodies"]),
        object_names=tuple(f"object_{item['root']}" for item in task["objects"]),
        object_bodies=tuple(item["body"] for item in task["objects"]),
        object_joints=tuple(item["joint"] for item in task["objects"]),
        viz=ObjectMotionCommandCfg.VizCfg(mode="frames"),  # Ghosts are of geometries that do not collide.
    )
    for group in cfg.observations.values():
        # The robot's MJCF has no sensors: the state of its root is observed itself.
        group.terms["base_lin_vel"].func, group.terms["base_lin_vel"].params = common.base_lin_vel, {}
        group.terms["base_ang_vel"].func, group.terms["base_ang_vel"].params = common.base_ang_vel, {}
    cfg.rewards.pop("self_collisions")  # The robot of the data does not collide with itself.
    cfg.terminations["ee_body_pos"].params["body_names"] = tuple(task["end_bodies"])
    cfg.events["push_robot"].params["velocity_range"] = PUSHES
    cfg.events["base_com"].params["asset_cfg"].body_names = (task["anchor_body"],)
    friction = task["floor_friction"]
    cfg.events["foot_friction"].params |= {
        "asset_cfg": SceneEntityCfg("robot", geom_names=_exactly(task["soles"])),
        "ranges": (0.5 * friction, 1.5 * friction),
    }
    cfg.viewer.body_name = task["anchor_body"]


def _add_objects(cfg: ManagerBasedRlEnvCfg, task: dict[str, Any]) -> None:
    noisy = {"object_pose": 0.02, "object_target": 0.0, "object_velocity": 0.2}
    if task["contact_bodies"]:
        noisy |= {"contact_labels": 0.0, "contact_offsets": 0.02}
    for name, noise in noisy.items():
        func = getattr(terms, name)
        drawn = UniformNoiseCfg(n_min=-noise, n_max=noise) if noise else None
        cfg.observations["actor"].terms[name] = ObservationTermCfg(func=func, noise=drawn)
        cfg.observations["critic"].terms[name] = ObservationTermCfg(func=func)
    cfg.rewards["object_position"] = RewardTermCfg(func=terms.object_position, weight=1.0, params={"std": 0.2})
    cfg.rewards["object_orientation"] = RewardTermCfg(func=terms.object_orientation, weight=1.0, params={"std": 0.5})
    if task["contact_bodies"]:
        cfg.observations["critic"].terms["contact_forces"] = ObservationTermCfg(func=terms.contact_forces)
        cfg.rewards["contact_place"] = RewardTermCfg(func=terms.contact_place, weight=1.0, params={"std": 0.1})
        cfg.rewards["contact_made"] = RewardTermCfg(func=terms.contact_made, weight=0.5)
        cfg.rewards["contact_unwanted"] = RewardTermCfg(func=terms.contact_unwanted, weight=-0.1)
    cfg.terminations["object_away"] = TerminationTermCfg(func=terms.object_away, params={"threshold": 0.3})
    cfg.terminations["object_turned"] = TerminationTermCfg(func=terms.object_turned, params={"threshold": 1.2})
    if task["touching"]:
        cfg.events["hand_friction"] = _friction("robot", _exactly(task["touching"]), task["hand_friction"])
    for number, _ in _roots(task):
        cfg.events[f"object_{number}_friction"] = _friction(f"object_{number}", (".*",), task["object_friction"])
        cfg.events[f"object_{number}_mass"] = EventTermCfg(
            mode="startup",
            func=dr.pseudo_inertia,
            params={
                "asset_cfg": SceneEntityCfg(f"object_{number}", body_names=(".*",)),
                "alpha_range": (-0.1, 0.1),  # Mass and inertia times exp(2 alpha): 0.82 to 1.22.
            },
        )


def _roots(task: dict[str, Any]) -> list[tuple[int, dict[str, Any]]]:
    """Return the objects that are no parts of others, with their numbers: each is an entity, its parts included."""
    return [(number, item) for number, item in enumerate(task["objects"]) if item["root"] == number]


def _friction(entity: str, geoms: tuple[str, ...], friction: float) -> EventTermCfg:
    return EventTermCfg(
        mode="startup",
        func=dr.geom_friction,
        params={
            "asset_cfg": SceneEntityCfg(entity, geom_names=geoms),
            "operation": "abs",
            "ranges": (0.6 * friction, 1.4 * friction),
            "shared_random": True,
        },
    )


def _exactly(names: list[str]) -> tuple[str, ...]:
    """Return patterns that match these names alone."""
    return tuple(f"^{re.escape(name)}$" for name in names)


def _read(path: str) -> mujoco.MjSpec:
    return mujoco.MjSpec.from_file(path)


def _set_floor(floor: dict[str, Any], description: mujoco.MjSpec) -> None:
    """Give mjlab's plane the contacts of the scene's floor."""
    (plane,) = (geom for geom in description.geoms if geom.name == FLOOR)
    for name, value in floor.items():
        setattr(plane, name, value)
