"""Inverse kinematics over all frames at once: the reference that trajectory optimization refines."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import SolveError
from hoi_retarget.motion.report import OrientationFlip, Status, Window
from hoi_retarget.retargeting.config import Horizon, IkConfig
from hoi_retarget.retargeting.ik_starts import Start, in_one_branch, interpolated, seated, standing, straightened
from hoi_retarget.retargeting.orientation_flips import rotation_errors_deg, short_flips
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.problem import Problem
from hoi_retarget.retargeting.trajopt.table import ik_terms
from hoi_retarget.retargeting.trajopt.windows import solve_windows
from hoi_retarget.retargeting.trunk_turns import trunk_turns
from hoi_retarget.robots.model import RobotModel

STIFFER = 1000.0
"""A coarse solve so much smoother keeps a joint on one side where frames on their own would change sides."""
ROUNDS = 4
"""In which flips that are left are taken out."""


def solve_ik(
    model: RobotModel, targets: Targets, config: IkConfig, horizon: Horizon
) -> tuple[Float[np.ndarray, "T nq"], tuple[Window, ...]]:
    """Return the IK trajectory of a robot for its targets.

    Where it does not converge, is turned over or flips, other starts are tried; the best one is returned.
    """
    search = _Search(model, targets, config, horizon)
    found = search.solve(search.coarse(standing))
    straight = straightened(model, found.qpos, found.errors, targets.fps)
    if straight is not None:
        # Near half a turn a Gauss-Newton step does not see that turning back would be cheaper.
        found = min(found, search.solve(straight), key=lambda candidate: candidate.cost)
    if found.is_faulty:
        found = search.improved(found)
    return found.qpos, found.windows


@dataclass(frozen=True, eq=False)
class _Candidate:
    qpos: Float[np.ndarray, "T nq"]
    windows: tuple[Window, ...]
    errors: Mapping[str, Float[np.ndarray, "T"]]
    """How far sites are from their rotations [deg]."""
    flips: tuple[OrientationFlip, ...]
    """That no person does."""
    turned: bool
    """Whether the trunk is turned over."""

    @property
    def cost(self) -> float:
        return sum(window.cost for window in self.windows)

    @property
    def converged(self) -> bool:
        return all(window.status is Status.SOLVED for window in self.windows)

    @property
    def rank(self) -> tuple[bool, int, float]:
        """A key to sort by: whether it is unfit for use, frames of flips, cost."""
        return self.turned or not self.converged, sum(flip.frames for flip in self.flips), self.cost

    @property
    def is_faulty(self) -> bool:
        return any(self.rank[:2])


@dataclass(frozen=True, eq=False)
class _Search:
    """The IK problem of one clip, solved from one start after the other."""

    model: RobotModel
    targets: Targets
    config: IkConfig
    horizon: Horizon

    def solve(self, start: np.ndarray) -> _Candidate:
        qpos, windows = _solve(self.model, self.targets, self.config, self.horizon, start)
        kinematics = self.model.forward(qpos)
        errors = rotation_errors_deg(kinematics, self.targets)
        turned = bool(trunk_turns(kinematics, self.targets))
        return _Candidate(qpos, windows, errors, short_flips(errors, self.targets.fps), turned)

    def coarse(self, start: Start, *, stiffer: float = 1.0) -> np.ndarray:
        """Return the start that the solution for every n-th frame is, interpolated."""
        targets, weights = self.targets.every(self.config.stride), self.config.weights
        config = replace(self.config, weights=replace(weights, smoothness=stiffer * weights.smoothness))
        qpos, _ = _solve(self.model, targets, config, self.horizon, start(self.model, targets))
        return interpolated(qpos, self.config.stride, self.targets.frames)

    def improved(self, found: _Candidate) -> _Candidate:
        """Return the best of a faulty candidate and those from other starts, tried until one has no faults."""
        rank = attrgetter("rank")
        best = self._finished(found)
        for start, stiffer in ((standing, STIFFER), (seated, 1.0), (seated, STIFFER)):
            if not best.is_faulty:
                return best
            with suppress(SolveError):
                best = min(best, self._finished(self.solve(self.coarse(start, stiffer=stiffer))), key=rank)
        last = best
        with suppress(SolveError):
            for _ in range(ROUNDS):
                again = in_one_branch(self.model, last.qpos, last.flips)
                if again is None:
                    break
                # What is no better at once may be a step towards it.
                last = self._finished(self.solve(again))
                best = min(best, last, key=rank)
        return best

    def _finished(self, candidate: _Candidate) -> _Candidate:
        """Return a candidate that did not converge after as many iterations again, and again."""
        for _ in range(ROUNDS):
            if candidate.converged:
                break
            candidate = self.solve(candidate.qpos)
        return candidate


def _solve(
    model: RobotModel, targets: Targets, config: IkConfig, horizon: Horizon, start: np.ndarray
) -> tuple[np.ndarray, tuple[Window, ...]]:
    def problem_of(first: int, stop: int, pinned: int) -> Problem:
        return Problem(model, ik_terms(config.weights, targets.window(first, stop), model), targets.fps, pinned)

    if targets.base_qpos is not None and model.spec.base == "stays":
        # Means of equal rotations are not equal to the bit.
        start = np.concatenate([targets.base_qpos, start[:, 7:]], axis=1)
    return solve_windows(problem_of, start, horizon, config.solver)
