"""Inverse kinematics over all frames at once: the reference that trajectory optimization refines.

Its starts are poses that follow the person, and other branches of limbs. A robot's trunk and thighs are thicker than a
person's scaled skeleton: where a person sits, kneels or lies, inverse kinematics puts them into the floor, and floor
terms alone may roll a lying robot over. So the whole robot is raised above the floor afterwards.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.errors import SolveError
from hoi_retarget.motion.motion_report import Event, Status, Window
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import rate_limited_upper_envelope, seconds_to_frames, smoothstep_around
from hoi_retarget.retargeting.config import Horizon, IkConfig
from hoi_retarget.retargeting.orientation_flips import limb_joints, rotation_errors_deg, short_flips, trunk_turns
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.problem import Problem
from hoi_retarget.retargeting.trajopt.trajectory_terms import ik_terms
from hoi_retarget.retargeting.trajopt.windows import FrameRange, solve_windows, windows_of
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.skin import link_heights, skin_of

Start = Callable[[RobotModel, Targets], Float[np.ndarray, "T nq"]]

MIN_TWIST_DEG = 60.0  # Off a target by more, a limb may have gone the wrong way around.
TWIST_MARGIN_SECONDS = 0.17  # On either side, for such a limb to come back.
MIN_BRANCH_CHANGE_RAD = 1.0  # [rad]; a joint that differs by more before and after a flip has changed its branch.
COARSE_SMOOTHNESS_FACTOR = 1000.0
"""A coarse solve so much smoother keeps a joint on one side where frames on their own would change sides."""
ROUNDS = 4  # In which flips that are left are taken out.
MIN_LIFT_M = 0.02  # [m]; links that are less deep are pushed out by the trajectory's optimization alone.


def standing(model: RobotModel, targets: Targets) -> Float[np.ndarray, "T nq"]:
    """Return the home pose in every frame, moved along with the pelvis target [m, rad]."""
    return _home(model, targets, targets.site_quats[:, _pelvis(model)])


def seated(model: RobotModel, targets: Targets) -> Float[np.ndarray, "T nq"]:
    """Return the home pose in every frame, its trunk turned as the person's [m, rad]; a bent back turns the pelvis."""
    return _home(model, targets, se3.matrix_to_quat(targets.trunk_rotations))


def _pelvis(model: RobotModel) -> int:
    return [row.site for row in model.spec.ik].index("pelvis")


def _home(model: RobotModel, targets: Targets, quats: Float[np.ndarray, "T 4"]) -> Float[np.ndarray, "T nq"]:
    """Return the home pose, its pelvis where its target is and turned by `quats`; the root may be any other link.

    On a base it is where the base goes.
    """
    if targets.base_qpos is not None:
        return np.concatenate([targets.base_qpos, np.tile(model.home_qpos[7:], (targets.frames, 1))], axis=1)
    at_origin = np.concatenate([[0, 0, 0, 1, 0, 0, 0], model.home_qpos[7:]])
    pelvis = model.forward(at_origin[None])
    place, turn = pelvis.site_position("pelvis")[0], pelvis.site_rotation("pelvis")[0]
    qpos = np.tile(model.home_qpos, (targets.frames, 1))
    qpos[:, 3:7] = se3.quat_multiply(quats, se3.matrix_to_quat(turn.T))
    qpos[:, :3] = targets.site_positions[:, _pelvis(model)] - se3.rotate(qpos[:, 3:7], place)
    return qpos


def interpolated(qpos: np.ndarray, stride: int, frames: int) -> np.ndarray:
    """Return a trajectory at all frames from its every `stride`-th."""
    place = np.minimum(np.arange(frames) / stride, len(qpos) - 1)
    before = np.minimum(place.astype(int), max(len(qpos) - 2, 0))
    after = np.minimum(before + 1, len(qpos) - 1)
    fraction = place - before
    blended = qpos[before] + fraction[:, None] * (qpos[after] - qpos[before])
    blended[:, 3:7] = se3.slerp(qpos[before, 3:7], qpos[after, 3:7], fraction)
    return blended


def untwisted(
    model: RobotModel, qpos: Float[np.ndarray, "T nq"], errors: Mapping[str, Float[np.ndarray, "T"]], fps: float
) -> Float[np.ndarray, "T nq"] | None:
    """Return a trajectory with twisted limbs interpolated from before and after; None where no limb is twisted.

    `model`: the robot; `qpos`: the trajectory [m, rad]; `errors`: rotation errors of its sites [deg]; `fps`: frames a
    second.
    """
    straight = qpos.copy()
    for site, degrees in errors.items():
        if degrees.max() >= MIN_TWIST_DEG:
            near = smoothstep_around(degrees >= MIN_TWIST_DEG, seconds_to_frames(TWIST_MARGIN_SECONDS, fps)) > 0
            _bridge(straight, model, 7 + limb_joints(model, site), near)
    return None if np.array_equal(straight, qpos) else straight


def in_one_branch(
    model: RobotModel, qpos: Float[np.ndarray, "T nq"], flips: Sequence[Event]
) -> Float[np.ndarray, "T nq"] | None:
    """Return a trajectory that does not change branches where limbs flip [m, rad]; None where no limb flips.

    A flip is the way from one branch of a limb to another. The joints that swing in it are bridged over the flip and
    over what comes before or after it until the next one, whichever is shorter.
    """
    start = qpos.copy()
    for site in dict.fromkeys(flip.subject for flip in flips):
        spans = [(flip.first_frame, flip.last_frame + 1) for flip in flips if flip.subject == site]
        swung, left = np.zeros(qpos.shape[1], dtype=bool), np.zeros(len(qpos), dtype=bool)
        for index, (first, stop) in enumerate(spans):
            begin = spans[index - 1][1] if index else 0
            end = spans[index + 1][0] if index + 1 < len(spans) else len(qpos)
            swung |= np.abs(qpos[min(stop, len(qpos) - 1)] - qpos[max(first - 1, 0)]) > MIN_BRANCH_CHANGE_RAD
            left[slice(begin, stop) if first - begin < end - stop else slice(first, end)] = True
        limb = 7 + limb_joints(model, site)
        _bridge(start, model, limb[swung[limb]], left)
    return None if np.array_equal(start, qpos) else start


def _bridge(qpos: np.ndarray, model: RobotModel, joints: np.ndarray, left: Bool[np.ndarray, "T"]) -> None:
    """Interpolate joints over frames from those around, in place; all frames at once are taken home."""
    if left.all():
        qpos[:, joints] = model.home_qpos[joints]
        return
    frames, kept = np.arange(len(qpos)), np.flatnonzero(~left)
    for joint in joints:
        qpos[left, joint] = np.interp(frames[left], kept, qpos[kept, joint])


def solve_ik(
    model: RobotModel, targets: Targets, config: IkConfig, horizon: Horizon
) -> tuple[Float[np.ndarray, "T nq"], tuple[Window, ...]]:
    """Return the IK trajectory of a robot for its targets [m, rad], and the report of each window.

    Where it does not converge, is turned over or flips, other starts follow; the best result is returned.
    Raises `SolveError` where a window ends without a usable trajectory.

    `model`: the robot; `targets`: of all frames; `config`: options of this stage; `horizon`: frames that are solved at
    once.
    """
    search = _Search(model, targets, config, horizon)
    found = search.solve(search.coarse(standing))
    straight = untwisted(model, found.qpos, found.errors, targets.fps)
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
    errors: Mapping[str, Float[np.ndarray, "T"]]  # How far sites are from their rotations [deg].
    flips: tuple[Event, ...]  # That no person does.
    turned: bool  # Whether the trunk is turned over.

    @property
    def cost(self) -> float:
        """Weighted sum of squares [unitless]."""
        return sum(window.cost for window in self.windows)

    @property
    def converged(self) -> bool:
        return all(window.status is Status.SOLVED for window in self.windows)

    @property
    def rank(self) -> tuple[bool, int, float]:
        """A key to sort by: whether it is unfit for use, number of frames of flips, cost [unitless]."""
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
        for start, stiffer in ((standing, COARSE_SMOOTHNESS_FACTOR), (seated, 1.0), (seated, COARSE_SMOOTHNESS_FACTOR)):
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
    def problem_of(window: FrameRange) -> Problem:
        terms = ik_terms(config.weights, targets.window(window.first, window.stop), model)
        return Problem(model, terms, targets.fps, window.pinned)

    if targets.base_qpos is not None and model.spec.base == "stays":
        # Means of equal rotations are not equal to the bit.
        start = np.concatenate([targets.base_qpos, start[:, 7:]], axis=1)
    return solve_windows(problem_of, start, windows_of(horizon, len(start)), config.solver)


def raised_above_floor(
    model: RobotModel, targets: Targets, qpos: Float[np.ndarray, "T nq"]
) -> Float[np.ndarray, "T nq"]:
    """Return a trajectory [m, rad] with no link but hands and feet deeper than `MIN_LIFT_M` under the floor.

    It rises and falls slowly. Where nothing is deeper, or a base carries it, it is the same array.
    """
    if targets.base_qpos is not None:
        return qpos
    ends = {model.site_bodies[model.sites.index[site]] for site in targets.contact_links}
    inner = [skin.link not in ends for skin in skin_of(model).links]
    depth = -link_heights(model.forward(qpos))[inner].min(axis=0, initial=0.0)
    if depth.max(initial=0.0) <= MIN_LIFT_M:
        return qpos
    above = qpos.copy()
    above[:, 2] += rate_limited_upper_envelope(np.maximum(depth - MIN_LIFT_M, 0.0), targets.fps)
    return above
