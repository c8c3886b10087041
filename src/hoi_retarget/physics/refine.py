"""A reference made into a motion that a simulated robot performs: sampling with a receding horizon.

Every fifth of a second, changes of the drives' targets for the next second are sampled, simulated with feedback, and
drawn towards those of least cost, three times over. Until the next plan, their mean is performed, or the best of them
where it is much better. Where costs run away, the last second is planned again with more samples; where the robot falls
even so, the last two seconds, and from there on objects count little. Leads are added first (`lead.py`), and what did
not fall is smoothed last (`smoother.py`).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.physics.closed_loop import KNOT, Course, changes_at, simulated_costs
from hoi_retarget.physics.costs import TrackingCost
from hoi_retarget.physics.feedback import feedback_gains
from hoi_retarget.physics.lead import led
from hoi_retarget.physics.performed_gains import performed_gains
from hoi_retarget.physics.reference import TICK, Reference
from hoi_retarget.physics.rollout import Rollout, drive_targets, has_fallen, stepped, tracked
from hoi_retarget.physics.scene import Scene, compiled
from hoi_retarget.physics.settings import Refinement
from hoi_retarget.physics.smoother import smoother

_ARMS, _OTHERS = 0.1, 0.04  # Noise of the targets [rad].
_LEAN, _TURN = 0.03, 0.05  # Of where feedback has the base [m], [rad].
_TINY = 1e-9
_LEAST_NOISE = 0.3  # Of the noise at first, after narrowing.
_ELITE = 0.15  # Share of the samples that are averaged.
_WORTH = 1.1  # How much a smoother plan may cost, over a rougher one.
_SIZE, _ROUGH = 0.005, 0.02  # Cost of changes as large as the noise, and of such steps from knot to knot.
_RUNAWAY = 7.0  # A cost that a robot about to fall has, or an object that is lost.
_BACK = 5  # Plans that are made again.
_LET_GO = 0.5  # Most that an object costs once the robot fell over it.
_BUDGET = 1.6  # Steps that a refinement may take, over those of a refinement that never plans again.


@dataclass(frozen=True)
class Progress:
    """Where a refinement is."""

    seconds: float
    """Of the motion, performed so far."""
    cost: float
    """Of the plan, a mean over its horizon."""
    samples: int


@dataclass(frozen=True, eq=False)
class Refined:
    """A performed motion."""

    rollout: Rollout
    gains: Float[np.ndarray, "K n x"]
    """From deviations from the performed motion to changes of the drives' targets."""
    steps: int
    """How many steps were simulated."""
    let_go_after: float | None = None
    """When objects began to count little, because the robot fell over them [s]; None where it did not."""
    lead_in: "Lead | None" = None
    """From a stance at rest to the first tick, where the reference begins off balance."""
    lead_out: "Lead | None" = None
    """From the last tick to a stance at rest, where the reference ends off balance, unless the robot fell before."""


@dataclass(frozen=True, eq=False)
class Lead:
    """What is performed before a motion or after it, with the tick in which they meet."""

    rollout: Rollout
    gains: Float[np.ndarray, "L n x"]


@dataclass(frozen=True, eq=False)
class _State:
    """All that the rest of a refinement depends on, but for the random numbers."""

    tick: int
    simulation: np.ndarray
    knots: Float[np.ndarray, "M n"]
    """Of the plan that goes on."""


def refine(
    scene: Scene,
    reference: Reference,
    settings: Refinement = Refinement(),
    *,
    seed: int = 0,
    on_progress: Callable[[Progress], None] = lambda _: None,
) -> Refined:
    """Return a motion near a reference that drives perform in simulation, up to its end or a fall.

    The same arguments give the same bytes, with one version of MuJoCo on one kind of processor.

    Args:
        scene: Robot, objects, and floor.
        reference: What is to be performed; the simulation begins with its first state.
        settings: How much is tried.
        seed: Of the random numbers.
        on_progress: Is called after every plan.

    Raises:
        RobotError: MuJoCo cannot compile the robot with the objects.
    """
    return _Refinement(scene, reference, settings, seed).run(on_progress)


class _Refinement:
    def __init__(self, scene: Scene, reference: Reference, settings: Refinement, seed: int) -> None:
        simulated = compiled(scene)
        whole = led(scene, reference)
        self.first, self.asked = whole.before, reference
        reference = whole.reference
        gains = feedback_gains(scene, simulated, reference, objects=False)
        cost = TrackingCost(scene, reference)
        self.course = Course(scene, simulated, reference, drive_targets(scene, reference), gains, cost)
        self.settings, self.random = settings, np.random.default_rng(seed)
        self.noise = settings.noise * _noise(scene)
        self.data = mujoco.MjData(simulated)
        self.let_go_after: float | None = None
        self.last = len(reference.qpos) - 1
        self.qpos, self.qvel = np.empty_like(reference.qpos), np.empty_like(reference.qvel)
        self.given = np.empty_like(reference.torques)
        self.performed = 0  # Last tick in which the robot is on its feet.
        self.steps = 0
        ahead = round(settings.horizon / TICK) * self.course.steps
        self.budget = _BUDGET * settings.iterations * settings.samples * ahead * self.last / KNOT

    def run(self, on_progress: Callable[[Progress], None]) -> Refined:
        reference = self.course.reference
        self.data.qpos[:], self.data.qvel[:] = reference.qpos[0], reference.qvel[0]
        self.qpos[0], self.qvel[0] = reference.qpos[0], reference.qvel[0]
        states = [self._state(0, np.zeros((round(self.settings.horizon / (KNOT * TICK)) + 1, len(self.noise))))]
        samples, until, fell = self.settings.samples, 0, False
        while states[-1].tick < self.last and not fell:
            now = states[-1]
            if now.tick >= until:
                samples = self.settings.samples
            knots, cost = self._planned(now, samples)
            fell = not self._performed(now.tick, knots)
            tick = min(now.tick + KNOT, self.last)
            on_progress(Progress(float(np.clip(TICK * (tick - self.first), 0.0, self.asked.seconds)), cost, samples))
            if (fell or cost > _RUNAWAY) and samples < self.settings.most_samples and self.steps < self.budget:
                until = max(until, tick + KNOT)  # It never shrinks, so that there is an end.
                samples, fell = min(2 * samples, self.settings.most_samples), False
                states = self._back(states, _BACK)
            elif fell and self.let_go_after is None and self.course.scene.objects:
                until, fell = 0, False
                states = self._back(states, 2 * _BACK)
                self._let_objects_go(states[-1].tick)
            elif not fell:
                states.append(self._state(tick, np.concatenate([knots[1:], 0.8 * knots[-1:]])))
        return self._refined()

    def _back(self, states: list[_State], plans: int) -> list[_State]:
        kept = states[: max(1, len(states) - plans)]
        self._restore(kept[-1])
        return kept

    def _let_objects_go(self, tick: int) -> None:
        self.let_go_after = TICK * max(0, tick - self.first)
        cost = TrackingCost(self.course.scene, self.course.reference, lost=_LET_GO)
        self.course = replace(self.course, cost=cost)
        self.budget = _BUDGET * max(self.budget, self.steps)

    def _planned(self, state: _State, samples: int) -> tuple[np.ndarray, float]:
        """Return knots of little cost, and the cost: the mean, which is smoother, or the best sample."""
        length = min(KNOT * (len(state.knots) - 1), self.last - state.tick)
        mean, spread = state.knots, np.tile(self.noise, (len(state.knots), 1))
        best, least = state.knots, np.inf
        elite = max(4, round(_ELITE * samples))
        for _ in range(self.settings.iterations):
            knots = mean + spread * self.random.standard_normal((samples, *mean.shape))
            knots[0], knots[1] = mean, best
            knots[:, 0] = state.knots[0]  # Targets go on where they are.
            cost = self._costs(state.tick, knots, length)
            order = np.argsort(cost, kind="stable")[:elite]
            if cost[order[0]] < least:
                best, least = knots[order[0]], float(cost[order[0]])
            if not np.isfinite(cost[order[-1]]):
                continue
            mean, found = _drawn(knots[order], cost[order])
            spread = np.maximum(0.5 * (spread + found), _LEAST_NOISE * self.noise)
        final = np.stack([mean, best])
        final[:, 0] = state.knots[0]
        smooth, rough = self._costs(state.tick, final, length).tolist()
        return (final[0], smooth) if smooth <= _WORTH * rough else (best, rough)

    def _costs(self, tick: int, knots: np.ndarray, length: int) -> np.ndarray:
        cost = simulated_costs(self.course, self.data, tick, knots, length)
        self.steps += len(knots) * length * self.course.steps
        sizes = knots / np.maximum(self.noise, _TINY)
        rough = np.mean(np.diff(sizes, axis=1) ** 2, axis=(1, 2))
        return cost + _SIZE * np.mean(sizes**2, axis=(1, 2)) + _ROUGH * rough

    def _performed(self, tick: int, knots: np.ndarray) -> bool:
        """Perform a plan until the next one; return whether the robot is on its feet."""
        course, data = self.course, self.data
        for now in range(tick, min(tick + KNOT, self.last)):
            changes = changes_at(knots[None], now - tick)
            if now in (self.first, self.first + len(self.asked.qpos) - 1):
                data.qacc_warmstart[:] = 0.0  # As where a simulation of the motion, or of a lead, begins.
            data.ctrl[:] = course.given(now, data.qpos[None], data.qvel[None], changes)[0]
            self.given[now] = data.ctrl
            if not stepped(course.simulated, data) or has_fallen(course.reference, now + 1, data):
                self.performed = now
                return False
            self.qpos[now + 1], self.qvel[now + 1] = data.qpos, data.qvel
            self.performed = now + 1
        return True

    def _state(self, tick: int, knots: np.ndarray) -> _State:
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        simulation = np.empty(mujoco.mj_stateSize(self.course.simulated, kind))
        mujoco.mj_getState(self.course.simulated, self.data, simulation, kind)
        return _State(tick, simulation, knots)

    def _restore(self, state: _State) -> None:
        mujoco.mj_resetData(self.course.simulated, self.data)
        mujoco.mj_setState(self.course.simulated, self.data, state.simulation, mujoco.mjtState.mjSTATE_INTEGRATION)

    def _refined(self) -> Refined:
        course, ticks = self.course, self.performed + 1
        self.given[self.last] = self.given[self.last - 1]
        qpos, qvel, given = (item[:ticks] for item in (self.qpos, self.qvel, self.given))
        gains = performed_gains(course.scene, course.simulated, Rollout(qpos, qvel, given, None))

        def part(first: int, stop: int) -> Lead:
            cut = slice(first, stop)
            fell_after = TICK * (ticks - first) if ticks < stop else None
            return Lead(Rollout(frozen(qpos[cut]), frozen(qvel[cut]), frozen(given[cut]), fell_after), gains[cut])

        first, stop = self.first, self.first + len(self.asked.qpos)
        lead_in = part(0, first + 1) if first else None
        if ticks <= first:
            asked = self.asked
            none = Rollout(asked.qpos[:1], asked.qvel[:1], asked.qpos[:1, 7 : 7 + gains.shape[1]], TICK)
            return Refined(none, np.zeros_like(gains[:1]), self.steps, self.let_go_after, lead_in)
        motion = part(first, stop)
        lead_out = part(stop - 1, self.last + 1) if stop <= min(self.last, ticks) else None
        if motion.rollout.fell_after is None and self.settings.noise > 0.0:
            motion = Lead(*smoother(course.scene, course.simulated, self.asked, motion.rollout, motion.gains))
            lead_out = lead_out and self._going_on(motion.rollout, lead_out)
        return Refined(motion.rollout, motion.gains, self.steps, self.let_go_after, lead_in, lead_out)

    def _going_on(self, motion: Rollout, lead_out: Lead) -> Lead:
        """Return a lead-out from where another motion ends."""
        if lead_out.rollout.fell_after is not None:
            return lead_out
        qpos, qvel = lead_out.rollout.qpos.copy(), lead_out.rollout.qvel.copy()
        qpos[0], qvel[0] = motion.qpos[-1], motion.qvel[-1]
        last = slice(self.last + 1 - len(qpos), None)
        whole = self.course.reference
        path = replace(
            whole, qpos=frozen(qpos), qvel=frozen(qvel), torques=whole.torques[last], touched=whole.touched[last]
        )
        found = tracked(self.course.simulated, path, lead_out.rollout.targets, lead_out.gains)
        return Lead(found, lead_out.gains[: len(found.qpos)])


def _noise(scene: Scene) -> Float[np.ndarray, "n"]:
    """Return the noise of each joint's target; an arm's joints move one palm, not both. Then that of the base."""
    model = scene.model
    left, right = (model.supports[1:, model.sites.frames[f"{side}_palm"].node] for side in ("left", "right"))
    return np.concatenate([np.where(left != right, _ARMS, _OTHERS), [_LEAN] * 3, [_TURN] * 3])


def _drawn(knots: np.ndarray, cost: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and spread of good samples, the better ones counting more."""
    share = np.exp(-(cost - cost[0]) / max(1e-6, 0.5 * (cost[-1] - cost[0])))
    share /= share.sum()
    mean = np.einsum("s,smn->mn", share, knots)
    return mean, np.sqrt(np.einsum("s,smn->mn", share, (knots - mean) ** 2))
