"""From a clip to a robot motion, in the order of the paper's Sec. III."""

import time
from contextlib import AbstractContextManager
from dataclasses import asdict, replace
from typing import Any

import mujoco
import numpy as np
import scipy
from threadpoolctl import ThreadpoolController

from hoi_retarget import __version__
from hoi_retarget.clip.clip import Clip
from hoi_retarget.evaluate import evaluate_kinematics, unreached_contacts
from hoi_retarget.motion.motion import Motion
from hoi_retarget.retarget.config import Config
from hoi_retarget.retarget.ik import solve_ik
from hoi_retarget.retarget.orientation_flips import turned_over
from hoi_retarget.retarget.targets import Targets, make_targets
from hoi_retarget.retarget.trajopt.problem import Problem
from hoi_retarget.retarget.trajopt.table import trajectory_terms
from hoi_retarget.retarget.trajopt.windows import WindowReport, solve_windows
from hoi_retarget.robots.model import RobotModel

_LINEAR_ALGEBRA = ThreadpoolController()


def retarget(clip: Clip, model: RobotModel, config: Config, *, person: int = 0) -> Motion:
    """Return the motion of one robot for one person of a clip.

    Raises `SolveError` when a window ends without a usable trajectory.
    """
    with one_thread():
        return _retarget(clip, model, config, person)


def one_thread() -> AbstractContextManager[Any]:
    """Return a context in which linear algebra uses one thread.

    The matrices are small: several threads on them wait for each other, and slow a solve down many times.
    """
    return _LINEAR_ALGEBRA.limit(limits=1, user_api="blas")


def _retarget(clip: Clip, model: RobotModel, config: Config, person: int) -> Motion:
    clock = [time.process_time()]
    targets = make_targets(clip, model, config.scaling, person=person)
    clock.append(time.process_time())
    ik_qpos, ik_reports = solve_ik(model, targets, config.ik, config.horizon)
    clock.append(time.process_time())
    qpos, reports = solve_trajectory(model, targets, ik_qpos, config)
    clock.append(time.process_time())
    seconds = dict(zip(("targets", "ik", "trajectory"), np.diff(clock).tolist(), strict=True))
    report = _report(clip, targets, config, ik_reports, reports) | {"person": person, "cpu_seconds": seconds}
    motion = replace(_motion(clip, model, targets, ik_qpos, qpos), report=report)
    return scored(motion, targets, clip, model, person)


def solve_trajectory(
    model: RobotModel, targets: Targets, ik_qpos: np.ndarray, config: Config
) -> tuple[np.ndarray, tuple[WindowReport, ...]]:
    """Return the optimized trajectory (paper Sec. III-B) and how each window went."""

    def problem_of(first: int, stop: int, pinned: int) -> Problem:
        reference = model.forward(ik_qpos[first:stop])
        terms = trajectory_terms(config.weights, targets.window(first, stop), reference)
        return Problem(model, terms, targets.fps, pinned)

    return solve_windows(problem_of, ik_qpos, config.horizon, config.solver)


def scored(motion: Motion, targets: Targets, clip: Clip, model: RobotModel, person: int) -> Motion:
    """Return the motion with its figures and what went wrong in the report."""
    start = time.process_time()
    kinematics = model.forward(motion.qpos)
    figures = asdict(evaluate_kinematics(motion, clip, model, kinematics, person=person))
    unreached = [asdict(segment) for segment in unreached_contacts(motion, kinematics)]
    turned = [asdict(segment) for segment in turned_over(kinematics, targets)]
    seconds = motion.report["cpu_seconds"] | {"metrics": time.process_time() - start}
    found = {"figures": figures, "unreached_contacts": unreached, "turned_over": turned, "cpu_seconds": seconds}
    return replace(motion, report=dict(motion.report) | found)


def _motion(clip: Clip, model: RobotModel, targets: Targets, ik_qpos: np.ndarray, qpos: np.ndarray) -> Motion:
    return Motion(
        robot=model.spec.name,
        fps=clip.fps,
        joint_names=model.joint_names,
        qpos=qpos,
        ik_qpos=ik_qpos,
        object_names=targets.object_names,
        object_pos=targets.object_pos,
        object_quat=targets.object_quat,
        object_scale=targets.object_scale,
        contact_links=targets.contact_links,
        contact_flags=targets.contact_flags,
        contact_object=targets.contact_object,
        contact_points=targets.contact_points,
        stance_flags=targets.stance_flags,
        first_source_frame=clip.first_source_frame,
        human_height=targets.human_height,
        report={},
    )


def _report(
    clip: Clip,
    targets: Targets,
    config: Config,
    ik_reports: tuple[WindowReport, ...],
    reports: tuple[WindowReport, ...],
) -> dict[str, Any]:
    return {
        "clip": clip.name,
        "source": asdict(clip.source),
        "root_scale": targets.root_scale,
        "config": asdict(config),
        "versions": {
            "hoi_retarget": __version__,
            "mujoco": mujoco.__version__,
            "numpy": np.__version__,
            "scipy": scipy.__version__,
        },
        "ik_windows": [_window(report) for report in ik_reports],
        "windows": [_window(report) for report in reports],
    }


def _window(report: WindowReport) -> dict[str, Any]:
    return asdict(report) | {"status": report.status.name}
