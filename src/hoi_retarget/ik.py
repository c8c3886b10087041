"""Inverse kinematics over all frames at once: the reference that trajectory optimization refines."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget import se3
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.targets import Targets
from hoi_retarget.trajopt.problem import Problem
from hoi_retarget.trajopt.solvers.banded import BandedInteriorPoint
from hoi_retarget.trajopt.table import IkWeights, ik_terms
from hoi_retarget.trajopt.windows import Horizon, WindowReport, solve_windows


@dataclass(frozen=True)
class IkConfig:
    """Options of the IK stage."""

    weights: IkWeights = IkWeights()
    stride: int = 10
    """The first solve sees every so-manieth frame; the second starts from its interpolation."""
    solver: BandedInteriorPoint = BandedInteriorPoint(tolerance=1e-3)


def solve_ik(
    model: RobotModel, targets: Targets, config: IkConfig, horizon: Horizon
) -> tuple[Float[np.ndarray, "T nq"], tuple[WindowReport, ...]]:
    """Return the IK trajectory of a robot for its targets."""
    coarse = targets.every(config.stride)
    start, _ = _solve(model, coarse, config, horizon, _standing(model, coarse))
    return _solve(model, targets, config, horizon, _interpolate(start, config.stride, targets.frames))


def _solve(
    model: RobotModel, targets: Targets, config: IkConfig, horizon: Horizon, start: np.ndarray
) -> tuple[np.ndarray, tuple[WindowReport, ...]]:
    def problem_of(first: int, stop: int, pinned: int) -> Problem:
        return Problem(model, ik_terms(config.weights, targets.window(first, stop), model), targets.fps, pinned)

    return solve_windows(problem_of, start, horizon, config.solver)


def _standing(model: RobotModel, targets: Targets) -> Float[np.ndarray, "T nq"]:
    """Return the home pose in every frame, carried along by the pelvis target."""
    pelvis = [row.site for row in model.spec.ik].index("pelvis")
    qpos = np.tile(model.home_qpos, (targets.frames, 1))
    qpos[:, :3] = targets.site_positions[:, pelvis]
    qpos[:, 3:7] = targets.site_quats[:, pelvis]
    return qpos


def _interpolate(qpos: np.ndarray, stride: int, frames: int) -> np.ndarray:
    """Return a trajectory at all frames from its every `stride`-th."""
    place = np.minimum(np.arange(frames) / stride, len(qpos) - 1)
    before = np.minimum(place.astype(int), max(len(qpos) - 2, 0))
    after = np.minimum(before + 1, len(qpos) - 1)
    fraction = place - before
    blended = qpos[before] + fraction[:, None] * (qpos[after] - qpos[before])
    blended[:, 3:7] = se3.slerp(qpos[before, 3:7], qpos[after, 3:7], fraction)
    return blended
