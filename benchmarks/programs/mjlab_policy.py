"""A policy for one exported task: PPO for some iterations, then episodes of it from the motion's first frame on.

Runs in mjlab's environment, with the folder of tasks on Python's path.

    PYTHONPATH=tasks python mjlab_policy.py TASK FOLDER ITERATIONS ENVIRONMENTS EPISODES

Writes checkpoints and curves for TensorBoard into the folder. Prints, as JSON, seconds of training, and of the
episodes: how many keep robot and objects to the end, how far objects are from their paths until then, and hands from
their places on them.
"""

import json
import sys
import time
from dataclasses import asdict

import mjlab.tasks  # noqa: F401  # finds the tasks
import torch
from mjlab.envs import ManagerBasedRlEnv
from mjlab.rl import MjlabOnPolicyRunner, RslRlVecEnvWrapper
from mjlab.tasks.registry import load_env_cfg, load_rl_cfg, load_runner_cls
from mjlab.utils.lab_api.math import quat_error_magnitude
from mjlab.utils.torch import configure_torch_backends


def main(task: str, folder: str, iterations: int, environments: int, episodes: int) -> None:
    configure_torch_backends()
    device = "cuda:0" if torch.cuda.is_available() else "cpu"
    settings = load_rl_cfg(task)
    env = wrapped(task, environments, device, play=False)
    runner = (load_runner_cls(task) or MjlabOnPolicyRunner)(env, asdict(settings), folder, device)
    start = time.time()
    runner.learn(num_learning_iterations=iterations, init_at_random_ep_len=True)
    seconds = time.time() - start
    steps = iterations * environments * settings.num_steps_per_env
    env.close()
    found = played(wrapped(task, episodes, device, play=True), runner.get_inference_policy(device=device))
    found |= {"task": task, "device": device, "seconds": seconds, "iterations": iterations, "steps": steps}
    sys.stdout.write(json.dumps(found) + "\n")


def wrapped(task: str, environments: int, device: str, *, play: bool) -> RslRlVecEnvWrapper:
    """Return environments of a task; to play, without noise and pushes, from the first frame on."""
    cfg = load_env_cfg(task, play=play)
    cfg.scene.num_envs = environments
    return RslRlVecEnvWrapper(ManagerBasedRlEnv(cfg=cfg, device=device), clip_actions=load_rl_cfg(task).clip_actions)


def played(env: RslRlVecEnvWrapper, policy) -> dict:
    """Return the figures of one episode in each environment, each up to its end."""
    command = env.unwrapped.command_manager.get_term("motion")
    frames = command.motion.time_step_total
    observations, _ = env.reset()
    alive = torch.ones(env.num_envs, dtype=torch.bool, device=env.device)
    lasted, sums, counts = torch.zeros(env.num_envs, device=env.device), torch.zeros(3), torch.zeros(3)
    for _ in range(frames - 1):
        with torch.inference_mode():
            observations, _, ended, _ = env.step(policy(observations))
        alive &= ~ended.bool()
        lasted += alive
        away = torch.linalg.norm(command.object_pos_w - command.simulated_object_pos_w, dim=-1)
        turned = quat_error_magnitude(command.object_quat_w, command.simulated_object_quat_w)
        gap = torch.linalg.norm(command.link_targets_w - command.link_points_w, dim=-1)
        labelled = command.labels.any(dim=2)
        for index, values in enumerate((away[alive], turned[alive], gap[alive][labelled[alive]])):
            sums[index] += values.sum().cpu()
            counts[index] += values.numel()
    object_m, object_rad, gap_m = (sums / counts.clamp(min=1)).tolist()
    return {
        "episodes": env.num_envs,
        "whole": float(alive.float().mean()),
        "lasted_share": float(lasted.mean()) / (frames - 1),
        "object_m": object_m,
        "object_rad": object_rad,
        "gap_m": gap_m,
    }


if __name__ == "__main__":
    main(*sys.argv[1:3], *map(int, sys.argv[3:]))
