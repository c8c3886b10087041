"""From a clip to a robot's motion, in the order of the paper's Sec. III; nothing is judged here."""

import time
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float
from threadpoolctl import ThreadpoolController

from hoi_retarget import __version__
from hoi_retarget.clip.clip import Clip
from hoi_retarget.dynamics.feasibility import not_free
from hoi_retarget.motion.motion import Motion, Stage
from hoi_retarget.motion.motion_report import Report, Window
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.fingers import with_fingers
from hoi_retarget.retargeting.holds.grasps import with_grasps
from hoi_retarget.retargeting.holds.held_targets import with_holds
from hoi_retarget.retargeting.holds.object_path import shift_between
from hoi_retarget.retargeting.ik import raised_above_floor, solve_ik
from hoi_retarget.retargeting.orientation_flips import orientation_flips, rotation_errors_deg, trunk_turns, with_reasons
from hoi_retarget.retargeting.surfaces.passes import SurfaceProblems
from hoi_retarget.retargeting.targets import Targets, make_targets, pinned_parts, with_pins
from hoi_retarget.retargeting.trajopt.problem import Problem
from hoi_retarget.retargeting.trajopt.solvers.solver import Effort
from hoi_retarget.retargeting.trajopt.trajectory_terms import trajectory_terms
from hoi_retarget.retargeting.trajopt.windows import FrameRange, ProblemOf, solve_windows, windows_of
from hoi_retarget.robots.model import Kinematics, RobotModel

_LINEAR_ALGEBRA = ThreadpoolController()


@dataclass(frozen=True, eq=False)
class Solution:
    """One robot's motion for one person of a clip, and the targets that it follows; it has no figures."""

    clip: Clip
    person: int
    targets: Targets
    motion: Motion
    kinematics: Kinematics  # The model's `forward(motion.qpos)`.

    @classmethod
    def of(cls, clip: Clip, person: int, targets: Targets, motion: Motion, model: RobotModel) -> "Solution":
        """Return the solution; its motion's report names pins, flipped limbs and turns of the trunk.

        Args: `clip`: the recording; `person`: index of the person; `targets`: of the robot; `motion`: follows them;
        `model`: the robot.
        """
        kinematics = model.forward(motion.qpos)
        flips = orientation_flips(rotation_errors_deg(kinematics, targets))
        motion = motion.with_report(
            pins=pinned_parts(kinematics, targets),
            orientation_flips=with_reasons(flips, kinematics, targets),
            trunk_turns=trunk_turns(kinematics, targets),
            rotation_jumps=targets.rotation_jumps,
        )
        return cls(clip, person, targets, motion, kinematics)

    @property
    def model(self) -> RobotModel:
        """The robot."""
        return self.kinematics.model

    @property
    def stages(self) -> tuple[Stage, ...]:
        """Trajectories of inverse kinematics and of the optimization, with the report of each window."""
        return self.motion.stages


def solve(clip: Clip, model: RobotModel, config: Config = Config(), *, person: int = 0) -> Solution:
    """Return the motion of one robot for one person of a clip, without figures.

    Raises `SolveError` where a window ends without a usable trajectory.

    `clip`: the recording; `model`: the robot; `config`: scales, weights, solvers; `person`: index of the person that
    the robot follows.
    """
    with one_thread():
        clock = [time.process_time()]
        targets = make_targets(clip, model, config.scaling, contact=config.contact, person=person)
        clock.append(time.process_time())
        ik_qpos, ik_windows = solve_ik(model, targets, config.ik, config.horizon)
        if config.contact == "surface":
            ik_qpos = raised_above_floor(model, targets, ik_qpos)
        ik_qpos = with_fingers(model, targets, clip.people[person], ik_qpos)
        targets = with_pins(targets, clip, model, ik_qpos, person=person)
        clock.append(time.process_time())
        recorded, holds = targets, ()
        if on_surfaces(targets, config):
            shared, simulated = (not_free(clip, person).any(axis=0), config.holds == "simulated" and clip.frames > 1)
            alone = np.flatnonzero(~shared).tolist() if simulated else ()
            # Of several objects one may carry another, and what people share is in one place for all.
            one = (
                config.object_path == "free"
                and len(clip.people) == len(clip.objects) == 1
                and not clip.objects[0].joint
            )
            contacts = [track for track in clip.contacts if track.person == person]
            given = targets, model, ik_qpos, config.physics, alone
            targets, holds = with_holds(*given, gives_way=one, contacts=contacts)
            ik_qpos = with_grasps(model, targets, clip.people[person], holds, ik_qpos)
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
            holds=tuple(hold.note(targets) for hold in holds),
            object_shift=shift_between(recorded, targets) if holds else None,
            config=config.as_json(),
            versions=_versions(),
            cpu_seconds=dict(zip(("targets", "ik", "holds", "trajectory"), np.diff(clock).tolist(), strict=True)),
        )
        stages = (Stage("ik", ik_qpos, ik_windows), Stage("trajectory", qpos, windows))
        return Solution.of(clip, person, targets, _motion(clip, model, targets, stages, report), model)


def one_thread() -> AbstractContextManager[Any]:
    """Return a context in which linear algebra uses one thread.

    The matrices are small: several threads on them wait for each other, and slow a solve down many times.
    """
    return _LINEAR_ALGEBRA.limit(limits=1, user_api="blas")


def solve_trajectory(  # noqa: PLR0913  # the parts of a solve
    model: RobotModel,
    targets: Targets,
    ik_qpos: Float[np.ndarray, "T nq"],
    config: Config,
    *,
    windows: Sequence[FrameRange] | None = None,
    start: Float[np.ndarray, "T nq"] | None = None,
    first_frame: int = 0,
    roughly: bool = False,
) -> tuple[Float[np.ndarray, "T nq"], tuple[Window, ...]]:
    """Return the optimized trajectory [m, rad] (paper Sec. III-B) and the report of each window.

    Args: `model`: the robot; `targets`: of the T frames; `ik_qpos`: the reference; `config`: weights, solver, contact;
    `windows`: frames that are solved at once; by default those of the horizon; `start`: holds the pinned frames, and is
    the start of the first pass; by default the reference; `first_frame`: frame of the clip in which the targets start,
    for messages; `roughly`: hands go to their holds, and surfaces may be in each other. Raises `GeometryError`: an
    object's mesh cannot be read; `SolveError`: a window fails, or its trajectory breaks a joint range or a joint speed.
    """
    frames = windows_of(config.horizon, targets.frames) if windows is None else windows

    def at_landmarks(window: FrameRange) -> Problem:
        reference = model.forward(ik_qpos[window.first : window.stop])
        terms = trajectory_terms(config.weights, targets.window(window.first, window.stop), reference)
        return Problem(model, terms, targets.fps, window.pinned, window.pinned_after)

    passes: list[tuple[np.ndarray, tuple[Window, ...]]] = []

    def solve_pass(problem_of: ProblemOf, begin: np.ndarray, effort: Effort, last: bool) -> np.ndarray:
        begin = start if start is not None and begin is ik_qpos else begin
        passes.append(
            solve_windows(problem_of, begin, frames, config.solver, effort, first_frame=first_frame, reported=last)
        )
        return passes[-1][0]

    if on_surfaces(targets, config):
        problems = SurfaceProblems.of(model, targets, ik_qpos, config)
        qpos = (problems.first_pass if roughly else problems.passes)(solve_pass)
    else:
        qpos = solve_pass(at_landmarks, ik_qpos, Effort(), True)
    return qpos, next(reports for solved, reports in passes if solved is qpos)


def on_surfaces(targets: Targets, config: Config) -> bool:
    """Return whether the trajectory is that of surfaces in contact: there is an object, and the config says so."""
    return config.contact == "surface" and bool(targets.object_names)


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
