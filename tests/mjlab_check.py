"""Runs in mjlab's environment: resets and steps an exported task, and prints what came of it as JSON.

Arguments: the task's name, and how many steps to make.
"""

import json
import sys

import mjlab.tasks  # noqa: F401  # finds the tasks
import numpy as np
import torch
from mjlab.envs import ManagerBasedRlEnv
from mjlab.tasks.registry import load_env_cfg

ENVIRONMENTS = 2


def main(task: str, steps: int) -> None:
    cfg = load_env_cfg(task)
    cfg.scene.num_envs = ENVIRONMENTS
    env = ManagerBasedRlEnv(cfg=cfg, device="cpu")
    found = {"contacts": _contacts(env), "reset": _resets(env), "drives": _drives(env)}
    found["squeezed"] = _squeezed(task)
    observations, _ = env.reset()
    found["observations"] = {name: list(values.shape) for name, values in observations.items()}
    finite, ended = True, 0
    for _ in range(steps):
        observations, rewards, terminated, _, _ = env.step(
            torch.zeros(ENVIRONMENTS, env.action_manager.total_action_dim)
        )
        finite &= all(bool(torch.isfinite(values).all()) for values in (*observations.values(), rewards))
        ended += int(terminated.sum())
    found |= {"steps": steps, "finite": finite, "ended": ended}
    found["terms"] = {
        "reward": env.reward_manager.active_terms,
        "termination": env.termination_manager.active_terms,
        "actor": env.observation_manager.active_terms["actor"],
    }
    sys.stdout.write(json.dumps(found) + "\n")


def _contacts(env) -> dict:
    """Return how each kind of geometry touches: dimension, priority, friction."""
    model = env.sim.mj_model
    bodies = [model.body(int(body)).name for body in model.geom_bodyid]
    found = {}
    for kind in ("terrain", "object_0", "robot"):
        which = [number for number, name in enumerate(bodies) if name.partition("/")[0] == kind]
        found[kind] = {
            "condim": sorted({int(model.geom_condim[number]) for number in which}),
            "priority": sorted({int(model.geom_priority[number]) for number in which}),
            "friction": sorted({round(float(model.geom_friction[number, 0]), 6) for number in which}),
        }
    return found


def _drives(env) -> dict:
    """Return stiffness, damping, torque and armature of each joint, as mjlab simulates them."""
    model = env.sim.mj_model
    found = {}
    for number in range(model.nu):
        joint = int(model.actuator_trnid[number, 0])
        found[model.joint(joint).name.partition("/")[2]] = [
            float(model.actuator_gainprm[number, 0]),
            float(-model.actuator_biasprm[number, 2]),
            float(model.actuator_forcerange[number, 1]),
            float(model.dof_armature[model.jnt_dofadr[joint]]),
        ]
    return found


def _resets(env) -> dict:
    """Return how far bodies and objects are from the reference after resets to its frames, at random and told ones."""
    command, everybody = env.command_manager.get_term("motion"), torch.arange(ENVIRONMENTS)
    data = np.load(command.cfg.motion_file, allow_pickle=False)
    told = {"body": 0.0, "object": 0.0, "object_speed": 0.0, "robot_speed": 0.0}
    for frame in np.linspace(0, len(data["joint_pos"]) - 1, 9).astype(int).tolist():
        command.reset_to_frame(everybody, frame)
        env.sim.forward()
        origins = env.scene.env_origins.numpy()
        bodies = command.robot.data.body_link_pos_w.numpy() - origins[:, None]
        told["body"] = max(told["body"], float(np.abs(bodies - data["body_pos_w"][frame]).max()))
        speeds = command.robot.data.body_link_lin_vel_w.numpy()
        told["robot_speed"] = max(told["robot_speed"], float(np.abs(speeds - data["body_lin_vel_w"][frame]).max()))
        places = command.simulated_object_pos_w.numpy() - origins[:, None]
        told["object"] = max(told["object"], float(np.abs(places - data["object_pos_w"][frame]).max()))
        moving = torch.cat([command.of_objects("lin_vel"), command.of_objects("ang_vel")], dim=-1).numpy()
        wanted = np.concatenate([data[f"object_{kind}_vel_w"][frame] for kind in ("lin", "ang")], axis=-1)
        told["object_speed"] = max(told["object_speed"], float(np.abs(moving - wanted).max()))
    random = {"held": 0.0, "held_resets": 0, "free_resets": 0, "free": 0.0}
    for _ in range(10):
        env.reset()
        frames = command.time_steps.numpy()
        bodies = command.robot.data.body_link_pos_w.numpy() - env.scene.env_origins.numpy()[:, None]
        for number, frame in enumerate(frames):
            # The step that a reset ends with moves the reference on by one frame.
            away = min(float(np.abs(bodies[number] - data["body_pos_w"][f]).max()) for f in (frame, max(frame - 1, 0)))
            kind = "held" if command._handled[max(frame - 1, 0)] and command._handled[frame] else "free"
            random[kind] = max(random[kind], away)
            random[f"{kind}_resets"] += 1
    return {"told": told, "random": random}


def _squeezed(task: str) -> dict:
    """Return what sensors and rewards tell while the G1 presses the object that it holds from both sides."""
    cfg = load_env_cfg(task)
    cfg.scene.num_envs, cfg.events, cfg.terminations = ENVIRONMENTS, {}, {}  # Nothing at random, and no end.
    env = ManagerBasedRlEnv(cfg=cfg, device="cpu")
    env.reset()
    command, everybody = env.command_manager.get_term("motion"), torch.arange(ENVIRONMENTS)
    action = env.action_manager.get_term("joint_pos")
    inwards = torch.zeros(len(command.robot.joint_names))
    for number, name in enumerate(command.robot.joint_names):
        if name.endswith(("shoulder_roll_joint", "shoulder_yaw_joint")):
            inwards[number] = -0.4 if name.startswith("left") else 0.4
    labelled = torch.nonzero(command._labels.flatten(1).any(dim=1)).flatten()
    command.reset_to_frame(everybody, int(labelled[len(labelled) // 2]))
    env.sim.forward()
    found = {"force": 0.0, "made": 0.0, "labels": int(command.labels[0].sum())}
    terms = env.reward_manager.active_terms
    for _ in range(25):
        targets = command.joint_pos + inwards - command.robot.data.default_joint_pos
        env.step(targets / action._scale)
        forces = command.touching("force")[command.labels].reshape(ENVIRONMENTS, -1)
        found["force"] = max(found["force"], float(forces.min()) if forces.numel() else 0.0)
        made = env.reward_manager._step_reward[:, terms.index("contact_made")]
        found["made"] = max(found["made"], float(made.min()))
    return found


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
