"""From a clip to a robot motion, in the order of the paper's Sec. III."""

import time
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import scipy
from threadpoolctl import ThreadpoolController

from hoi_retarget import __version__
from hoi_retarget.clip.clip import Clip
from hoi_retarget.evaluation import Comparison, figures_of, sunk_links, surface_residuals, unreached_contacts
from hoi_retarget.evaluation.object_shape import surface_kind
from hoi_retarget.motion.motion import Motion, Stage
from hoi_retarget.motion.report import Report, Window
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.floor_lift import lifted
from hoi_retarget.retargeting.ik import solve_ik
from hoi_retarget.retargeting.orientation_flips import orientation_flips, rotation_errors_deg, with_reasons
from hoi_retarget.retargeting.surfaces.solve import solve_on_surfaces
from hoi_retarget.retargeting.targets import Targets, make_targets, pinned_parts, with_pins
from hoi_retarget.retargeting.trajopt.problem import Problem
from hoi_retarget.retargeting.trajopt.table import trajectory_terms
from hoi_retarget.retargeting.trajopt.windows import solve_windows
from hoi_retarget.retargeting.trunk_turns import trunk_turns
from hoi_retarget.robots.model import RobotModel

_LINEAR_ALGEBRA = ThreadpoolController()


def retarget(clip: Clip, model: RobotModel, config: Config = Config(), *, person: int = 0) -> Motion:
    """Return the motion of one robot for one person of a clip.

    Raises `SolveError` when a window ends without a usable trajectory.
    """
    return retarget_with_targets(clip, model, config, person=person)[0]


def retarget_with_targets(clip: Clip, model: RobotModel, config: Config, *, person: int = 0) -> tuple[Motion, Targets]:
    """Do the same as `retarget`, and return the targets that the motion follows, too."""
    with one_thread():
        return _retarget(clip, model, config, person)


def one_thread() -> AbstractContextManager[Any]:
    """Return a context in which linear algebra uses one thread.

    The matrices are small: several threads on them wait for each other, and slow a solve down many times.
    """
    return _LINEAR_ALGEBRA.limit(limits=1, user_api="blas")


def _retarget(clip: Clip, model: RobotModel, config: Config, person: int) -> tuple[Motion, Targets]:
    clock = [time.process_time()]
    targets = make_targets(clip, model, config.scaling, contact=config.contact, person=person)
    clock.append(time.process_time())
    ik_qpos, ik_windows = solve_ik(model, targets, config.ik, config.horizon)
    if config.contact == "surface":
        ik_qpos = lifted(model, targets, ik_qpos)
    targets = with_pins(targets, clip, model, ik_qpos, person=person)
    clock.append(time.process_time())
    qpos, windows = solve_trajectory(model, targets, ik_qpos, config)
    clock.append(time.process_time())
    report = Report(
        clip=clip.name,
        person=person,
        source=clip.source,
        robot_file=model.spec.description_file,
        robot_sha256=model.spec.description_sha256,
        root_scale=targets.root_scale,
        config=config.as_json(),
        versions=_versions(),
        cpu_seconds=dict(zip(("targets", "ik", "trajectory"), np.diff(clock).tolist(), strict=True)),
    )
    stages = (Stage("ik", ik_qpos, ik_windows), Stage("trajectory", qpos, windows))
    motion = _motion(clip, model, targets, stages, report)
    return scored(motion, targets, clip, model, person), targets


def solve_trajectory(
    model: RobotModel, targets: Targets, ik_qpos: np.ndarray, config: Config
) -> tuple[np.ndarray, tuple[Window, ...]]:
    """Return the optimized trajectory (paper Sec. III-B) and how each window went."""
    if on_surfaces(targets, config):
        return solve_on_surfaces(model, targets, ik_qpos, config)

    def problem_of(first: int, stop: int, pinned: int) -> Problem:
        reference = model.forward(ik_qpos[first:stop])
        terms = trajectory_terms(config.weights, targets.window(first, stop), reference)
        return Problem(model, terms, targets.fps, pinned)

    return solve_windows(problem_of, ik_qpos, config.horizon, config.solver)


def on_surfaces(targets: Targets, config: Config) -> bool:
    """Return whether the trajectory is that of surfaces in contact: there is an object, and they are asked for."""
    return config.contact == "surface" and bool(targets.object_names)


def scored(motion: Motion, targets: Targets, clip: Clip, model: RobotModel, person: int) -> Motion:
    """Return the motion with its figures and what went wrong in the report."""
    start = time.process_time()
    kinematics = model.forward(motion.qpos)
    view = Comparison(motion, clip, person, kinematics)
    surfaces = motion.report.touches_with_surfaces
    flips = orientation_flips(rotation_errors_deg(kinematics, targets))
    figures = figures_of(view)
    unreached = unreached_contacts(motion, kinematics, residuals=surface_residuals(view) if surfaces else None)
    sunk = sunk_links(view) if surfaces else ()
    seconds = {**motion.report.cpu_seconds, "metrics": time.process_time() - start}
    report = replace(
        motion.report,
        figures=figures,
        object_surfaces={track.name: surface_kind(track.geometry) for track in clip.objects},
        unreached_contacts=unreached,
        sunk_links=sunk,
        pins=pinned_parts(kinematics, targets),
        orientation_flips=with_reasons(flips, kinematics, targets),
        trunk_turns=trunk_turns(kinematics, targets),
        rotation_jumps=targets.rotation_jumps,
        cpu_seconds=seconds,
    )
    return replace(motion, report=report)


def _motion(clip: Clip, model: RobotModel, targets: Targets, stages: tuple[Stage, ...], report: Report) -> Motion:
    return Motion(
        robot=model.spec.name,
        fps=clip.fps,
        joint_names=model.joint_names,
        stages=stages,
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
        report=report,
    )


def _versions() -> dict[str, str]:
    return {
        "hoi_retarget": __version__,
        "mujoco": mujoco.__version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
    }
