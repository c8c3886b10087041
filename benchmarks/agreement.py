"""Are the solutions optima? IPOPT, with exact second derivatives, tries to improve every one of them.

Both stages of every clip are solved as the pipeline does; IPOPT then starts from that solution and,
on its own, from where the solver had started. A decrease says that the solver stopped too early or
in a worse local minimum. Needs the extra `benchmark`.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from casadi_problem import show_left_out, stated
from common import Source, clip_files, pin_threads, show, write_json
from ipopt import AGREEMENT, HORIZONS, POLISH, Ipopt

import synthetic
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.ik import solve_ik
from hoi_retarget.retargeting.solve import solve_trajectory
from hoi_retarget.retargeting.targets import make_targets
from hoi_retarget.retargeting.trajopt.problem import Problem
from hoi_retarget.retargeting.trajopt.solvers.solver import BandedInteriorPoint, Effort
from hoi_retarget.retargeting.trajopt.solvers.solver_result import SolverResult
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import RobotModel


@dataclass(frozen=True)
class Arguments:
    """Try to improve the solutions of some clips by IPOPT."""

    robot: str = "unitree_g1"
    synthetic: tuple[str, ...] = tuple(synthetic.SCENES)
    """Scenes to make clips from; not used with recorded clips."""
    data: Path | None = None
    """Folder with recorded clips."""
    objects: Path | None = None
    limit: int | None = None
    """Only so many recorded clips, spread evenly over their names."""
    frames: int | None = None
    """Only the first so many frames of every clip."""
    json: Path | None = None


@dataclass
class Recorder:
    """The package's solver on the terms that are stated in CasADi, with the last problem, start and solution kept."""

    solver: BandedInteriorPoint
    last: list[tuple[Problem, np.ndarray, SolverResult]] = field(default_factory=list)

    def solve(self, problem: Problem, qpos: np.ndarray, effort: Effort = Effort()) -> SolverResult:
        """Return the solver's solution."""
        show_left_out(problem.terms)
        problem = replace(problem, terms=stated(problem.terms))
        solution = self.solver.solve(problem, qpos, effort)
        self.last = [(problem, qpos.copy(), solution)]
        return solution


def solutions(source: Source, model: RobotModel) -> dict[str, tuple[Problem, np.ndarray, SolverResult]]:
    """Return problem, start and solution of both stages over the whole clip."""
    config = Config(horizon=HORIZONS["whole"])
    targets = make_targets(source.read(), model, config.scaling)
    ik, trajectory = Recorder(config.ik.solver), Recorder(config.solver)
    found, _ = solve_ik(model, targets, replace(config.ik, solver=ik), config.horizon)
    solve_trajectory(model, targets, found, replace(config, solver=trajectory))
    return {"ik": ik.last[0], "trajectory": trajectory.last[0]}


def improve(problem: Problem, start: np.ndarray, solution: SolverResult) -> dict[str, Any]:
    """Return by how much IPOPT undercuts a solution, from there and from the start."""
    further = Ipopt("blocks", POLISH).solve(problem, solution.qpos)
    alone = Ipopt("blocks").solve(problem, start)
    return {
        "cost": solution.cost,
        "iterations": solution.iterations,
        "decrease": 1.0 - further.cost / solution.cost,
        "decrease_from_start": 1.0 - alone.cost / solution.cost,
        "ipopt_iterations": alone.iterations,
    }


def row_of(clip: str, stage: str, result: dict[str, Any]) -> tuple[str, ...]:
    mark = "  <--" if max(result["decrease"], result["decrease_from_start"]) > AGREEMENT else ""
    return (f"{clip}, {stage}", f"{result['cost']:.4f}", str(result["iterations"]), str(result["ipopt_iterations"]),
            f"{result['decrease']:+.1e}", f"{result['decrease_from_start']:+.1e}{mark}")  # fmt: skip


def main(arguments: Arguments) -> None:
    model, frames = load_robot(arguments.robot), arguments.frames
    if arguments.data is None:
        sources = {name: Source(synthetic=name, frames=frames) for name in arguments.synthetic}
    else:
        files = clip_files(arguments.data, arguments.limit)
        sources = {file.stem: Source(clip=file, objects=arguments.objects, frames=frames) for file in files}
    results = {
        name: {stage: improve(*solved) for stage, solved in solutions(source, model).items()}
        for name, source in sources.items()
    }
    header = ("clip, stage", "cost", "iterations", "IPOPT's", "decrease from solution", "decrease from start")
    rows = [row_of(name, stage, value) for name, stages in results.items() for stage, value in stages.items()]
    show(f"What IPOPT still gains, relative to the cost, {arguments.robot}", header, rows)
    worse = sum(row[-1].endswith("<--") for row in rows)
    results_of = [result for stages in results.values() for result in stages.values()]
    apart = sum(result["decrease_from_start"] < -AGREEMENT for result in results_of)
    print(f"IPOPT undercuts {worse} of {len(rows)} solutions by more than {AGREEMENT:g} of the cost;")
    print(f"on its own, it ends that much higher in {apart}.")
    write_json(arguments.json, {"robot": arguments.robot, "results": results})


if __name__ == "__main__":
    pin_threads()
    main(tyro.cli(Arguments, description=__doc__))
