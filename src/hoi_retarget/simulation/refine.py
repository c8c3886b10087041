"""Refinement of a reference to a motion that a simulated robot performs: sampling with a receding horizon.

Every fifth of a second, changes of the drives' targets for the next second are sampled, simulated with feedback, and
drawn towards those of least cost, three times over. Until the next plan, their mean is simulated, or the best of them
where it costs much less. Where costs run away, the robot falls, or an object begins to go astray, the last second is
planned again with more samples. Leads are added first (`balance_transition.py`), and a whole motion is smoothed last.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from jaxtyping import Float

from hoi_retarget.dynamics.inverse_dynamics import movement_of
from hoi_retarget.dynamics.physics_scene import PhysicsScene, compiled
from hoi_retarget.dynamics.physics_settings import Refinement
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.numerics.filters import savitzky_golay
from hoi_retarget.robots.spec import PALMS
from hoi_retarget.simulation import control
from hoi_retarget.simulation.approach import arm_joints
from hoi_retarget.simulation.balance_transition import with_lead_in_and_out
from hoi_retarget.simulation.object_hold import MEAN_M, off_path
from hoi_retarget.simulation.rollout import (
    TICK,
    Reference,
    Rollout,
    TrackingCost,
    drive_targets,
    has_fallen,
    object_errors,
    object_poses,
    step_tick,
    track,
)

_SMOOTHING_WINDOWS = ((0.14, 0.3), (0.3, 0.3), (0.14, 0.14))  # Of path and targets [s].
_PASSES = 3
_ERROR_FACTOR, _ERROR_SLACK = 1.05, 0.002  # By which errors of objects may grow: a factor, and more [m].
_CUBIC = 3
_ARM_NOISE, _NOISE = 0.1, 0.04  # Of the targets of an arm's joints and of others [rad].
_BASE_NOISE, _BASE_TURN_NOISE = 0.03, 0.05  # Of the base's pose in the feedback [m], [rad].
_MIN_NOISE = 1e-9
_MIN_SPREAD = 0.3  # After narrowing, as a share of the noise at first.
_ELITE = 0.15  # Share of the samples that are averaged.
_SMOOTH_COST_FACTOR = 1.1  # Up to which a smoother plan may cost more than a rougher one.
_SIZE, _ROUGH = 0.005, 0.02  # Cost of changes as large as the noise, and of such steps from knot to knot.
_STRAY_M, _STRAY_DEG = 0.06, 12.0  # Of an object from its path: plans are made again.
_RUNAWAY = 7.0  # Cost of a robot about to fall, or of a lost object.
_BACKTRACK = 5  # Plans that are made again.
_BUDGET = 1.5  # Of steps, over those of a refinement that never plans again.


@dataclass(frozen=True, eq=False)
class ControlledRollout:
    """A simulated motion with the feedback about it."""

    rollout: Rollout
    gains: Float[np.ndarray, "K n x"]  # From deviations from the motion to changes of the drives' targets.


@dataclass(frozen=True, eq=False)
class Refined(ControlledRollout):
    """A refined motion, with its lead-in and its lead-out; they share a tick with it."""

    steps: int  # Number of simulated steps.
    lead_in: ControlledRollout | None = None
    """From a stance at rest to the first tick, where the reference begins off balance."""
    lead_out: ControlledRollout | None = None
    """From the last tick to a stance at rest, where the reference ends off balance, unless the robot fell before."""


@dataclass(frozen=True)
class Progress:
    """Progress of a refinement."""

    seconds: float  # Of the motion, simulated so far [s].
    cost: float  # Of the plan, a mean over its horizon.
    samples: int


@dataclass(frozen=True, eq=False)
class _SampledState:
    """A state from which a refinement can be continued, but for the random numbers."""

    tick: int
    simulation: np.ndarray
    knots: Float[np.ndarray, "M n"]  # Of the plan that is continued.


def refine(
    scene: PhysicsScene,
    reference: Reference,
    settings: Refinement = Refinement(),
    *,
    seed: int = 0,
    on_progress: Callable[[Progress], None] = lambda _: None,
) -> Refined:
    """Return a motion near a reference that drives perform in simulation, up to its end, a fall, or a lost object.

    The same arguments give the same bytes, with one version of MuJoCo on one kind of processor.
    Raises `RobotError` where MuJoCo cannot compile the robot with the objects.

    Args: `scene`: robot, objects, and floor; `reference`: the reference; the simulation begins with its first state;
    `settings`: samples and iterations of the search; `seed`: of the random numbers; `on_progress`: is called after
    every plan.
    """
    return _Refinement(scene, reference, settings, seed).run(on_progress)


class _Refinement:
    def __init__(self, scene: PhysicsScene, reference: Reference, settings: Refinement, seed: int) -> None:
        simulated = compiled(scene)
        self.unextended = reference
        reference, self.first, _ = with_lead_in_and_out(scene, reference)
        gains = control.feedback_gains(scene, simulated, reference, objects=False)
        cost = TrackingCost(scene, reference)
        self.problem = control.TrackingProblem(
            scene, simulated, reference, drive_targets(scene, reference), gains, cost
        )
        self.settings, self.random = settings, np.random.default_rng(seed)
        self.noise = settings.noise * _noise(scene)
        self.data = mujoco.MjData(simulated)
        self.last = len(reference.qpos) - 1
        self.qpos, self.qvel = np.empty_like(reference.qpos), np.empty_like(reference.qvel)
        self.applied = np.empty_like(reference.torques)
        self.performed = 0  # Last tick of the robot on its feet.
        self.steps = 0
        ahead = round(settings.horizon / TICK) * self.problem.steps
        self.budget = _BUDGET * settings.iterations * settings.samples * ahead * self.last / control.KNOT

    def run(self, on_progress: Callable[[Progress], None]) -> Refined:
        reference = self.problem.reference
        self.data.qpos[:], self.data.qvel[:] = reference.qpos[0], reference.qvel[0]
        self.qpos[0], self.qvel[0] = reference.qpos[0], reference.qvel[0]
        states = [
            self._saved_state(0, np.zeros((round(self.settings.horizon / (control.KNOT * TICK)) + 1, len(self.noise))))
        ]
        samples, until, fell = self.settings.samples, 0, False
        while states[-1].tick < self.last and not fell:
            now = states[-1]
            if now.tick >= until:
                samples = self.settings.samples
            knots, cost = self._plan(now, samples)
            fell = not self._execute(now.tick, knots)
            tick = min(now.tick + control.KNOT, self.last)
            performed = float(np.clip(TICK * (tick - self.first), 0.0, self.unextended.seconds))
            on_progress(Progress(performed, cost, samples))
            failing = fell or cost > _RUNAWAY or self._strays(tick)
            if failing and samples < self.settings.most_samples and self.steps < self.budget:
                kept = states[: max(1, len(states) - _BACKTRACK)]
                if fell or not self._strays(kept[-1].tick):
                    until = max(until, tick + control.KNOT)  # It never shrinks, so that there is an end.
                    states, samples, fell = kept, min(2 * samples, self.settings.most_samples), False
                    self._restore(states[-1])
                    continue
            if fell or self._is_lost(tick):
                break
            states.append(self._saved_state(tick, np.concatenate([knots[1:], 0.8 * knots[-1:]])))
        return self._refined(fell)

    def _off(self, first: int, stop: int) -> tuple[np.ndarray, np.ndarray]:
        problem = self.problem
        return off_path(self.qpos[first:stop], problem.reference.qpos[first:stop], problem.scene.model.n)

    def _strays(self, tick: int) -> bool:
        """Return whether an object that is touched is so far from its path that it may be lost."""
        off, turned = self._off(tick, tick + 1)
        touched = [index for index in self.problem.reference.touched[tick] if index >= 0]
        return bool((off[0, touched] > _STRAY_M).any() or (turned[0, touched] > _STRAY_DEG).any())

    def _is_lost(self, tick: int) -> bool:
        """Return whether an object that the robot should touch is lost whatever comes."""
        first, ticks = self.first, len(self.unextended.qpos)
        means = self._off(first, min(tick, first + ticks))[0].sum(axis=0) / ticks
        touched = [index for index in np.unique(self.unextended.touched) if index >= 0]
        return bool((means[touched] > MEAN_M).any())

    def _plan(self, state: _SampledState, samples: int) -> tuple[np.ndarray, float]:
        """Return knots of little cost, and the cost: the mean, which is smoother, or the best sample."""
        length = min(control.KNOT * (len(state.knots) - 1), self.last - state.tick)
        mean, spread = state.knots, np.tile(self.noise, (len(state.knots), 1))
        best, least = state.knots, np.inf
        elite = max(4, round(_ELITE * samples))
        for _ in range(self.settings.iterations):
            knots = mean + spread * self.random.standard_normal((samples, *mean.shape))
            knots[0], knots[1] = mean, best
            knots[:, 0] = state.knots[0]  # The first targets stay as they are.
            cost = self._costs(state.tick, knots, length)
            order = np.argsort(cost, kind="stable")[:elite]
            if cost[order[0]] < least:
                best, least = knots[order[0]], float(cost[order[0]])
            if not np.isfinite(cost[order[-1]]):
                continue
            mean, found = _mean_and_spread(knots[order], cost[order])
            spread = np.maximum(0.5 * (spread + found), _MIN_SPREAD * self.noise)
        final = np.stack([mean, best])
        final[:, 0] = state.knots[0]
        smooth, rough = self._costs(state.tick, final, length).tolist()
        return (final[0], smooth) if smooth <= _SMOOTH_COST_FACTOR * rough else (best, rough)

    def _costs(self, tick: int, knots: np.ndarray, length: int) -> np.ndarray:
        cost = control.simulated_costs(self.problem, self.data, tick, knots, length)
        self.steps += len(knots) * length * self.problem.steps
        sizes = knots / np.maximum(self.noise, _MIN_NOISE)
        rough = np.mean(np.diff(sizes, axis=1) ** 2, axis=(1, 2))
        return cost + _SIZE * np.mean(sizes**2, axis=(1, 2)) + _ROUGH * rough

    def _execute(self, tick: int, knots: np.ndarray) -> bool:
        """Simulate a plan until the next one; return whether the robot is on its feet."""
        problem, data = self.problem, self.data
        for now in range(tick, min(tick + control.KNOT, self.last)):
            changes = control.changes_at(knots[None], now - tick)
            if now in (self.first, self.first + len(self.unextended.qpos) - 1):
                data.qacc_warmstart[:] = 0.0  # As where a simulation of the motion, or of a lead, begins.
            data.ctrl[:] = problem.targets_at(now, data.qpos[None], data.qvel[None], changes)[0]
            self.applied[now] = data.ctrl
            if not step_tick(problem.simulated, data) or has_fallen(problem.reference, now + 1, data):
                self.performed = now
                return False
            self.qpos[now + 1], self.qvel[now + 1] = data.qpos, data.qvel
            self.performed = now + 1
        return True

    def _saved_state(self, tick: int, knots: np.ndarray) -> _SampledState:
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        simulation = np.empty(mujoco.mj_stateSize(self.problem.simulated, kind))
        mujoco.mj_getState(self.problem.simulated, self.data, simulation, kind)
        return _SampledState(tick, simulation, knots)

    def _restore(self, state: _SampledState) -> None:
        mujoco.mj_resetData(self.problem.simulated, self.data)
        mujoco.mj_setState(self.problem.simulated, self.data, state.simulation, mujoco.mjtState.mjSTATE_INTEGRATION)

    def _refined(self, fell: bool) -> Refined:
        problem, ticks = self.problem, self.performed + 1
        self.applied[self.last] = self.applied[self.last - 1]
        qpos, qvel, applied = (item[:ticks] for item in (self.qpos, self.qvel, self.applied))
        gains = control.rollout_gains(problem.scene, Rollout(qpos, qvel, applied, None))

        def part(first: int, stop: int) -> ControlledRollout:
            cut = slice(first, stop)
            fell_after = TICK * (ticks - first) if fell and ticks < stop else None
            return ControlledRollout(
                Rollout(frozen(qpos[cut]), frozen(qvel[cut]), frozen(applied[cut]), fell_after), gains[cut]
            )

        first, stop = self.first, self.first + len(self.unextended.qpos)
        lead_in = part(0, first + 1) if first else None
        if ticks <= first:
            start = self.unextended
            standing = Rollout(start.qpos[:1], start.qvel[:1], start.qpos[:1, 7 : 7 + gains.shape[1]], TICK)
            return Refined(standing, np.zeros_like(gains[:1]), self.steps, lead_in)
        motion = part(first, stop)
        lead_out = part(stop - 1, self.last + 1) if stop <= min(self.last, ticks) else None
        if ticks >= stop and self.settings.noise > 0.0:
            motion = smooth(problem.scene, problem.simulated, self.unextended, motion)
            lead_out = lead_out and self._retrack_lead_out(motion.rollout, lead_out)
        return Refined(motion.rollout, motion.gains, self.steps, lead_in, lead_out)

    def _retrack_lead_out(self, motion: Rollout, lead_out: ControlledRollout) -> ControlledRollout:
        """Return a lead-out from where another motion ends."""
        if lead_out.rollout.fell_after is not None:
            return lead_out
        qpos, qvel = lead_out.rollout.qpos.copy(), lead_out.rollout.qvel.copy()
        qpos[0], qvel[0] = motion.qpos[-1], motion.qvel[-1]
        last = slice(self.last + 1 - len(qpos), None)
        whole = self.problem.reference
        torques, touched = whole.torques[last], whole.touched[last]
        path = replace(whole, qpos=frozen(qpos), qvel=frozen(qvel), torques=torques, touched=touched)
        found = track(self.problem.simulated, path, lead_out.rollout.targets, lead_out.gains)
        return ControlledRollout(found, lead_out.gains[: len(found.qpos)])


def _noise(scene: PhysicsScene) -> Float[np.ndarray, "n"]:
    """Return the noise of each joint's target, then that of the base; an arm's joints move one palm, not both."""
    model = scene.model
    carried = model.supports[[model.sites.frames[palm].node for palm in PALMS], 1:].any(axis=0)
    joints = np.where(carried, 0.0, _NOISE)  # Fingers are too weak for noise to change what is held.
    joints[np.concatenate([arm_joints(model, palm) for palm in PALMS])] = _ARM_NOISE
    return np.concatenate([joints, [_BASE_NOISE] * 3, [_BASE_TURN_NOISE] * 3])


def _mean_and_spread(knots: np.ndarray, cost: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and spread of good samples, the better ones counting more."""
    share = np.exp(-(cost - cost[0]) / max(1e-6, 0.5 * (cost[-1] - cost[0])))
    share /= share.sum()
    mean = np.einsum("s,smn->mn", share, knots)
    return mean, np.sqrt(np.einsum("s,smn->mn", share, (knots - mean) ** 2))


def smooth(
    scene: PhysicsScene, simulated: mujoco.MjModel, reference: Reference, motion: ControlledRollout
) -> ControlledRollout:
    """Return a smoother simulated motion than one that did not fall, or the same.

    Motions that follow each other's plans, and the noise in them, jerk. The motion, with the high frequencies of its
    path and its targets filtered out, is simulated again in several ways; the smoothest one that keeps the objects in
    their places is returned.

    `scene`: robot and objects; `simulated`: the same, compiled; `reference`: the reference, for the places of objects;
    `motion`: the motion; the smoother one begins in the same state.
    """
    n, rollout, gains = scene.model.n, motion.rollout, motion.gains
    allowed = _ERROR_FACTOR * object_errors(rollout, reference, n).mean(axis=0) + _ERROR_SLACK
    for _ in range(_PASSES):
        found = [track(simulated, path, targets, gains) for path, targets in _paths(scene, reference, rollout)]
        kept = [item for item in found if item.fell_after is None]
        kept = [item for item in kept if (object_errors(item, reference, n).mean(axis=0) <= allowed).all()]
        best = min([rollout, *kept], key=lambda item: jerk(scene, item))
        if best is rollout:
            break
        rollout, gains = best, control.rollout_gains(scene, best)
    return ControlledRollout(rollout, gains)


def jerk(scene: PhysicsScene, rollout: Rollout) -> float:
    """Return the mean jerk of the robot's bodies [m/s^3]."""
    if len(rollout.qpos) < 4:
        return 0.0
    places = scene.model.forward(rollout.qpos[:, : 7 + scene.model.n]).body_positions
    return float(np.linalg.norm(np.diff(places, 3, axis=0), axis=2).mean() / TICK**3)


def _paths(scene: PhysicsScene, reference: Reference, rollout: Rollout) -> Iterator[tuple[Reference, np.ndarray]]:
    n = scene.model.n
    bodies = [rollout.qpos[:, : 7 + n], *np.moveaxis(object_poses(rollout.qpos, n), 1, 0)]
    for of_path, of_targets in _SMOOTHING_WINDOWS:
        moved = [movement_of(body, 1.0 / TICK, of_path) for body in bodies]
        qpos = np.concatenate([body.qpos for body in moved], axis=1)
        qvel = np.concatenate([body.qvel for body in moved], axis=1)
        qpos[0], qvel[0] = rollout.qpos[0], rollout.qvel[0]
        window = 2 * round(0.5 * (of_targets / TICK - 1.0)) + 1
        targets = rollout.targets
        if len(targets) > window > _CUBIC:
            targets = savitzky_golay(targets, window, _CUBIC)
        yield replace(reference, qpos=frozen(qpos), qvel=frozen(qvel)), targets
