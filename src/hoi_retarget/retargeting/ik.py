"""Inverse kinematics over all frames at once: the reference that trajectory optimization refines."""

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.report import Window
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import fade, frames_in
from hoi_retarget.retargeting.config import Horizon, IkConfig
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.problem import Problem
from hoi_retarget.retargeting.trajopt.table import ik_terms
from hoi_retarget.retargeting.trajopt.windows import solve_windows
from hoi_retarget.robots.model import RobotModel

TWISTED = np.radians(60.0)  # Off a target by more, a limb may have gone the wrong way around.
TWIST_MARGIN_SECONDS = 0.17  # On either side, for such a limb to come back.


def solve_ik(
    model: RobotModel, targets: Targets, config: IkConfig, horizon: Horizon
) -> tuple[Float[np.ndarray, "T nq"], tuple[Window, ...]]:
    """Return the IK trajectory of a robot for its targets."""
    coarse = targets.every(config.stride)
    start, _ = _solve(model, coarse, config, horizon, _standing(model, coarse))
    found = _solve(model, targets, config, horizon, _interpolate(start, config.stride, targets.frames))
    straightened = _straighten(model, targets, found[0])
    if straightened is None:
        return found
    # Near half a turn a Gauss-Newton step does not see that turning back would be cheaper.
    again = _solve(model, targets, config, horizon, straightened)
    return min(found, again, key=lambda pair: sum(report.cost for report in pair[1]))


def _straighten(model: RobotModel, targets: Targets, qpos: np.ndarray) -> np.ndarray | None:
    """Return a trajectory whose twisted limbs are interpolated from before and after; None where none is."""
    kinematics = model.forward(qpos)
    supports, sites = model.supports[1:].astype(bool), model.sites
    trunk = supports[:, sites.nodes[sites.index["torso"]]]
    straight = qpos.copy()
    for column, row in enumerate(model.spec.ik_rows):
        wanted = se3.quat_to_matrix(targets.site_quats[:, column])
        angles = se3.matrix_angle_between(kinematics.site_rotation(row.site), wanted)
        if row.rotation_weight == 0 or angles.max() < TWISTED:
            continue
        near = fade(angles >= TWISTED, frames_in(TWIST_MARGIN_SECONDS, targets.fps)) > 0
        limb = 7 + np.flatnonzero(supports[:, sites.nodes[sites.index[row.site]]] & ~trunk)
        if near.all():
            straight[:, limb] = model.home_qpos[limb]
        else:
            frames, kept = np.arange(len(qpos)), np.flatnonzero(~near)
            for joint in limb:
                straight[near, joint] = np.interp(frames[near], kept, straight[kept, joint])
    return None if np.array_equal(straight, qpos) else straight


def _solve(
    model: RobotModel, targets: Targets, config: IkConfig, horizon: Horizon, start: np.ndarray
) -> tuple[np.ndarray, tuple[Window, ...]]:
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
