"""The paper's way against the package's: the same problems solved by IPOPT and by the banded solver.

Every window is stated a second time in CasADi (`casadi_problem.py`) and solved by IPOPT with exact
derivatives from the same start; both optima are evaluated by the package's own problem. Three ways
to write it in CasADi are timed, since they differ tenfold:

- `map`: one function of a frame, mapped over the frames; derivatives as CasADi finds them,
- `expand`: the same, expanded to scalar operations: faster to evaluate, slow to build,
- `blocks`: `map` with the Hessian put together by hand from blocks of one and two frames.

Needs the extra `benchmark`: `pip install '.[benchmark]'`.
"""

import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import casadi as ca
import numpy as np
import tyro
from casadi_problem import Statement, parameters_of, show_left_out, start_of, stated, structure_of, trajectory_of
from common import Source, pin_threads, show, write_json

from hoi_retarget.motion.motion_report import Optimality, Status
from hoi_retarget.retargeting.config import Config, Horizon
from hoi_retarget.retargeting.ik import solve_ik
from hoi_retarget.retargeting.targets import Targets, make_targets
from hoi_retarget.retargeting.trajopt.problem import Problem, Term, cost_by_term
from hoi_retarget.retargeting.trajopt.solvers.solver import BandedInteriorPoint, Effort
from hoi_retarget.retargeting.trajopt.solvers.solver_result import SolverResult
from hoi_retarget.retargeting.trajopt.trajectory_terms import trajectory_terms
from hoi_retarget.retargeting.trajopt.windows import FrameRange, solve_windows, windows_of
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import RobotModel

Way = Literal["map", "expand", "blocks"]
AGREEMENT = 1e-3  # Relative difference of optimal costs that counts as the same optimum.
HORIZONS = {"whole": Horizon(length=10**9), "windowed": Horizon(length=60, overlap=3, pinned=3)}
POLISH = {"mu_init": 1e-9, "bound_push": 1e-9, "bound_frac": 1e-9, "slack_bound_push": 1e-9, "slack_bound_frac": 1e-9}


@dataclass(frozen=True)
class Arguments:
    """Solve one clip's trajectory problems by IPOPT and by the banded solver, and compare."""

    source: tyro.conf.OmitArgPrefixes[Source] = field(default_factory=Source)
    robot: str = "unitree_g1"
    horizons: tuple[Literal["whole", "windowed"], ...] = ("whole", "windowed")
    """Whole clip as one problem, and the paper's windows of 60 frames with 3 shared and pinned."""
    ways: tuple[Way, ...] = ("map", "expand", "blocks")
    """How the problem is written in CasADi."""
    repeats: int = 3
    """Solves by the banded solver, of which the fastest counts; IPOPT solves once."""
    json: Path | None = None


@dataclass
class Ipopt:
    """IPOPT with its default options as a solver of the package's problems; graphs are built once per structure."""

    way: Way
    options: dict[str, Any] = field(default_factory=dict)
    build_seconds: float = 0.0
    solve_seconds: float = 0.0
    builds: int = 0
    iterations_to_agreement: int = 0
    """Until the objective stays within `AGREEMENT` of its last value."""
    _built: dict[Any, ca.Function] = field(default_factory=dict)

    def solve(self, problem: Problem, qpos: np.ndarray, effort: Effort = Effort()) -> SolverResult:
        """Return IPOPT's solution from a start, with its multipliers in the package's order and sign."""
        frames, key = len(qpos), structure_of(problem, len(qpos))
        if key not in self._built:
            start = time.process_time()
            self._built[key] = self._build(problem, frames)
            self.build_seconds += time.process_time() - start
            self.builds += 1
        start = time.process_time()
        solver = self._built[key]
        result = solver(x0=_flat(start_of(qpos)), p=parameters_of(problem, qpos), **_limits(problem, qpos))
        self.solve_seconds += time.process_time() - start
        found = trajectory_of(np.array(result["x"]).reshape(problem.model.nv, frames, order="F"), qpos)
        stats = solver.stats()
        self.iterations_to_agreement += _iterations_to_agreement(stats["iterations"])
        terms = cost_by_term(problem.linearize(problem.model.forward(found)))
        return SolverResult(
            qpos=found,
            multipliers=_multipliers(problem, result, frames),
            status=Status.SOLVED if stats["success"] else Status.STALLED,
            iterations=stats["iter_count"],
            cost=sum(terms.values()),
            cost_by_term=terms,
        )

    def _build(self, problem: Problem, frames: int) -> ca.Function:
        statement = Statement(problem, frames)
        ipopt = {"print_level": 0, "sb": "yes", "linear_solver": "mumps"} | self.options
        options: dict[str, Any] = {"ipopt": ipopt, "print_time": False}
        if self.way == "expand":
            options["expand"] = True
        if self.way == "blocks":
            options["hess_lag"] = statement.hessian()
        return ca.nlpsol("solver", "ipopt", statement.program(), options)


@dataclass
class Timed:
    """The package's solver with a stopwatch."""

    solver: BandedInteriorPoint
    solve_seconds: float = 0.0

    def solve(self, problem: Problem, qpos: np.ndarray, effort: Effort = Effort()) -> SolverResult:
        """Return the solver's result."""
        start = time.process_time()
        solution = self.solver.solve(problem, qpos, effort)
        self.solve_seconds += time.process_time() - start
        return solution


@dataclass(frozen=True, eq=False)
class Outcome:
    """One solver on all windows of a clip."""

    name: str
    build_seconds: float
    solve_seconds: float
    iterations: int
    iterations_to_agreement: int | None
    cost: float
    """Of the whole trajectory, by the package's problem over the whole clip."""
    optimality: Optimality
    """Worst over the windows."""
    qpos: np.ndarray

    @property
    def seconds(self) -> float:
        """Building included."""
        return self.build_seconds + self.solve_seconds


@dataclass(frozen=True, eq=False)
class Case:
    """A clip with its IK solution: where both solvers start."""

    model: RobotModel
    targets: Targets
    ik_qpos: np.ndarray
    config: Config

    @classmethod
    def of(cls, source: Source, robot: str) -> "Case":
        """Return the case of a clip and a robot."""
        clip, model, config = source.read(), load_robot(robot), Config()
        targets = make_targets(clip, model, config.scaling)
        return cls(model, targets, solve_ik(model, targets, config.ik, config.horizon)[0], config)

    def problem(self, window: FrameRange) -> Problem:
        """Return the pipeline's problem over some frames, without the terms that CasADi does not have."""
        return Problem(self.model, stated(self.terms(window.first, window.stop)), self.targets.fps, window.pinned)

    def terms(self, first: int, stop: int) -> tuple[Term, ...]:
        """Return the pipeline's terms over some frames."""
        reference = self.model.forward(self.ik_qpos[first:stop])
        return trajectory_terms(self.config.weights, self.targets.window(first, stop), reference)

    def run(self, name: str, solver: Ipopt | Timed, horizon: Horizon, whole: Problem) -> Outcome:
        """Return how a solver does on the pipeline's windows."""
        qpos, reports = solve_windows(self.problem, self.ik_qpos, windows_of(horizon, len(self.ik_qpos)), solver)
        qualities = [report.optimality for report in reports]
        return Outcome(
            name=name,
            build_seconds=getattr(solver, "build_seconds", 0.0),
            solve_seconds=solver.solve_seconds,
            iterations=sum(report.iterations for report in reports),
            iterations_to_agreement=getattr(solver, "iterations_to_agreement", None),
            cost=_cost(whole, qpos),
            optimality=Optimality(
                max(quality.stationarity for quality in qualities),
                max(quality.complementarity for quality in qualities),
                max(quality.violation for quality in qualities),
            ),
            qpos=qpos,
        )


def _cost(problem: Problem, qpos: np.ndarray) -> float:
    return sum(cost_by_term(problem.linearize(problem.model.forward(qpos))).values())


def _flat(values: np.ndarray) -> np.ndarray:
    return values.reshape(-1, order="F")


def _limits(problem: Problem, qpos: np.ndarray) -> dict[str, np.ndarray]:
    """Return bounds on the unknowns and on the joint steps; pinned frames are fixed where they start."""
    model, frames, pinned = problem.model, len(qpos), problem.pinned
    free = np.full((6, frames), np.inf)
    low = np.concatenate([-free, np.repeat(model.lower[:, None], frames, axis=1)])
    high = np.concatenate([free, np.repeat(model.upper[:, None], frames, axis=1)])
    low[:, :pinned] = high[:, :pinned] = start_of(qpos)[:, :pinned]
    step = np.repeat(problem.step_limits[:, None], frames - 1, axis=1)
    step[:, : max(pinned - 1, 0)] = np.inf
    return {"lbx": _flat(low), "ubx": _flat(high), "lbg": _flat(-step), "ubg": _flat(step)}


def _multipliers(problem: Problem, result: dict[str, ca.DM], frames: int) -> np.ndarray:
    """Return multipliers as `Bounds` stacks them; half of IPOPT's, since half the cost is meant there."""
    unknowns = np.array(result["lam_x"]).reshape(problem.model.nv, frames, order="F")[6:].T[problem.pinned :]
    steps = np.array(result["lam_g"]).reshape(problem.model.n, frames - 1, order="F").T
    steps = steps[max(problem.pinned - 1, 0) :]
    stacked = [np.maximum(-unknowns, 0), np.maximum(unknowns, 0), np.maximum(steps, 0), np.maximum(-steps, 0)]
    return 0.5 * np.concatenate(stacked)


def _iterations_to_agreement(history: dict[str, list[float]]) -> int:
    objective = np.array(history["obj"])
    away = np.flatnonzero(np.abs(objective - objective[-1]) > AGREEMENT * abs(objective[-1]))
    return int(away[-1]) + 1 if away.size else 0


def compare(case: Case, whole: Problem, horizon: Horizon, ways: tuple[Way, ...], repeats: int) -> list[Outcome]:
    """Return the banded solver's outcome, then IPOPT's in every way."""
    ours = [case.run("banded", Timed(case.config.solver), horizon, whole) for _ in range(repeats + 1)][1:]
    outcomes = [min(ours, key=lambda outcome: outcome.solve_seconds)]
    return outcomes + [case.run(f"IPOPT, {way}", Ipopt(way), horizon, whole) for way in ways]


def polish(case: Case, whole: Problem, ours: Outcome, theirs: Outcome) -> dict[str, float]:
    """Return the relative decrease of cost that either solver finds from the other one's solution."""
    further = Ipopt("blocks", POLISH).solve(whole, ours.qpos)
    back = replace(case.config.solver, tolerance=1e-9).solve(whole, theirs.qpos)
    return {
        "IPOPT from the banded solution": 1.0 - further.cost / ours.cost,
        "banded from IPOPT's solution": 1.0 - back.cost / theirs.cost,
        "banded with tolerance 1e-9, from IK": 1.0 - _tight(case, whole).cost / ours.cost,
    }


def _tight(case: Case, whole: Problem) -> SolverResult:
    return replace(case.config.solver, tolerance=1e-9).solve(whole, case.ik_qpos)


def report(outcomes: list[Outcome], title: str, frames: int) -> None:
    ours = outcomes[0]
    header = ("solver", "cost", "rel. diff.", "stationary", "compl.", "violation", "iterations",
              "to 1e-3", "build [s]", "solve [s]", "ms/frame", "ratio solve", "ratio total")  # fmt: skip
    rows = [
        (
            item.name,
            f"{item.cost:.6f}",
            f"{item.cost / ours.cost - 1.0:+.1e}",
            f"{item.optimality.stationarity:.0e}",
            f"{item.optimality.complementarity:.0e}",
            f"{item.optimality.violation:.0e}",
            str(item.iterations),
            "" if item.iterations_to_agreement is None else str(item.iterations_to_agreement),
            f"{item.build_seconds:.2f}",
            f"{item.solve_seconds:.3f}",
            f"{1e3 * item.solve_seconds / frames:.2f}",
            f"{item.solve_seconds / ours.solve_seconds:.0f}",
            f"{item.seconds / ours.seconds:.0f}",
        )
        for item in outcomes
    ]
    note = "CPU seconds, one thread. Ratio: IPOPT's time over the banded solver's, without and with building the graph."
    show(title, header, rows, note)


def document_of(outcomes: list[Outcome]) -> list[dict[str, Any]]:
    kept = ("name", "build_seconds", "solve_seconds", "iterations", "iterations_to_agreement", "cost")
    return [{name: getattr(item, name) for name in kept} | vars(item.optimality) for item in outcomes]


def main(arguments: Arguments) -> None:
    case = Case.of(arguments.source, arguments.robot)
    frames = case.targets.frames
    whole = case.problem(FrameRange(0, frames))
    show_left_out(case.terms(0, frames))
    document: dict[str, Any] = {"frames": frames, "robot": arguments.robot}
    agreed = True
    for name in arguments.horizons:
        outcomes = compare(case, whole, HORIZONS[name], arguments.ways, arguments.repeats)
        report(outcomes, f"Trajectory stage, {name}, {frames} frames, {arguments.robot}", frames)
        document[name] = document_of(outcomes)
        agreed &= all(abs(item.cost / outcomes[0].cost - 1.0) <= AGREEMENT for item in outcomes)
        if name == "whole" and len(outcomes) > 1:
            document["polish"] = polish(case, whole, outcomes[0], outcomes[-1])
            rows = [(key, f"{value:+.1e}") for key, value in document["polish"].items()]
            show("Can the other solver still decrease the cost?", ("start", "relative decrease"), rows)
    print("The optima agree." if agreed else f"THE OPTIMA DIFFER by more than {AGREEMENT:g}.")
    write_json(arguments.json, document | {"agreed": agreed})


if __name__ == "__main__":
    pin_threads()
    main(tyro.cli(Arguments, description=__doc__))
