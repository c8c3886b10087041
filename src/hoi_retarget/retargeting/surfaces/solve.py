"""Trajectories whose hands touch with their surface, solved in passes: contact points first, then surfaces.

The first pass is the paper's problem, roughly, with contact points moved to where the robot's hand touches. It ends
near the solution of the others, in which distances between surfaces count. These differ only in the points that they
look at, which each pass chooses anew from where the one before ended.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import RobotError
from hoi_retarget.motion.report import Window
from hoi_retarget.retargeting.config import BandedInteriorPoint, Config, Solver
from hoi_retarget.retargeting.surfaces.contact_sides import contact_sides
from hoi_retarget.retargeting.surfaces.moving_object import moving_objects
from hoi_retarget.retargeting.surfaces.table import Surfaces, surface_terms
from hoi_retarget.retargeting.surfaces.touching_targets import touching_targets
from hoi_retarget.retargeting.surfaces.ways_out import WayOut, ways_out, windows_of
from hoi_retarget.retargeting.targets import PALMS, Targets
from hoi_retarget.retargeting.trajopt.problem import Problem
from hoi_retarget.retargeting.trajopt.solvers.banded import solve_once
from hoi_retarget.retargeting.trajopt.solvers.base import Solution
from hoi_retarget.retargeting.trajopt.table import trajectory_terms
from hoi_retarget.retargeting.trajopt.windows import solve_windows
from hoi_retarget.retargeting.trunk_turns import trunk_turns
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.skin import Skin, skin_of, skins_from

ROUGHLY, CLOSELY, TO_THE_END = 300.0, 20.0, 7.0
"""Tolerances of the passes, as multiples of the solver's own: contacts weigh so much that less shows nowhere."""

ROUNDS = 3
"""Of ways out of an object."""
ON_THE_WAY, MOST_ITERATIONS = 15, 40
"""Iterations of each pass on the way to the last one, and of that one."""

ProblemOf = Callable[[int, int, int], Problem]
"""The problem of the frames from the first to the one before the second, of which so many leading ones are pinned."""


@dataclass(frozen=True, eq=False)
class SurfaceProblems:
    """The problems of one robot's targets, pass by pass."""

    model: RobotModel
    targets: Targets
    ik_qpos: Float[np.ndarray, "T nq"]
    config: Config
    surfaces: Surfaces

    @classmethod
    def of(
        cls, model: RobotModel, targets: Targets, ik_qpos: Float[np.ndarray, "T nq"], config: Config
    ) -> "SurfaceProblems":
        """Return the problems.

        Raises:
            GeometryError: An object's mesh cannot be read.
            RobotError: The robot's hands have no shapes.
        """
        if not all(skins_from(model, palm) for palm in PALMS):
            raise RobotError(
                f"{model.spec.name}: its hands have no shapes, so surfaces cannot touch. Use --contact landmark, "
                "or add the robot again with its meshes."
            )
        objects = moving_objects(targets)
        surfaces = Surfaces(objects, skin_of(model), contact_sides(targets, objects))
        return cls(model, targets, ik_qpos, config, surfaces)

    def passes(
        self, solve: Callable[[ProblemOf, Float[np.ndarray, "T nq"], Solver, bool], Float[np.ndarray, "T nq"]]
    ) -> Float[np.ndarray, "T nq"]:
        """Return the trajectory at the end of all passes.

        Args:
            solve: Solves one pass from a start with a solver, and is told whether it is the last one.
        """
        solver = self.config.solver
        qpos: np.ndarray = self.ik_qpos
        first = qpos
        ways: tuple[WayOut, ...] = ()
        for _ in range(1 + ROUNDS):
            qpos = solve(self._with_points(self._moved(qpos), ways), qpos, _on_the_way(solver, ROUGHLY), False)
            further = self._ways_out(qpos, ways)
            if not further:
                break
            ways = (*ways, *further)
            first = qpos if len(ways) == len(further) else first
        if ways and trunk_turns(self.model.forward(qpos), self.targets):
            # Ways that turn the robot over are none.
            qpos, ways = first, ()
        moved = self._moved(qpos)
        qpos = solve(self._with_surfaces(moved, qpos, ways, yielding=False), qpos, _on_the_way(solver, CLOSELY), False)
        return solve(self._with_surfaces(moved, qpos, ways, yielding=True), qpos, to_the_end(solver), True)

    def last(self, qpos: Float[np.ndarray, "T nq"]) -> ProblemOf:
        """Return the problem of the last pass, for a trajectory that has been through all of them."""
        return self._with_surfaces(self._moved(qpos), qpos, (), yielding=True)

    def _ways_out(self, qpos: np.ndarray, earlier: tuple[WayOut, ...]) -> tuple[WayOut, ...]:
        """Return ways out for links that are deep in an object, other than those that are to touch it."""
        of, targets = self.surfaces, self.targets
        touching = {self.model.body_of(site) for site in targets.contact_links}
        free = Skin(tuple(skin for skin in of.skin.links if skin.link not in touching))
        weight, start = self.config.weights.clearance, self.model.forward(qpos)
        return ways_out(of.objects, targets.limbs, free, start, earlier, weight, targets.fps)

    def _moved(self, qpos: np.ndarray) -> Targets:
        of = self.surfaces
        return touching_targets(self.targets, of.objects, of.sides, of.skin, self.model.forward(qpos))

    def _with_points(self, moved: Targets, ways: tuple[WayOut, ...]) -> ProblemOf:
        def problem_of(first: int, stop: int, pinned: int) -> Problem:
            reference = self.model.forward(self.ik_qpos[first:stop])
            terms = trajectory_terms(self.config.weights.with_surfaces, moved.window(first, stop), reference)
            return Problem(self.model, (*terms, *windows_of(ways, first, stop)), moved.fps, pinned)

        return problem_of

    def _with_surfaces(
        self, moved: Targets, qpos: np.ndarray, ways: tuple[WayOut, ...], *, yielding: bool
    ) -> ProblemOf:
        def problem_of(first: int, stop: int, pinned: int) -> Problem:
            terms = surface_terms(
                self.config.weights.with_surfaces,
                moved.window(first, stop),
                self.model.forward(self.ik_qpos[first:stop]),
                self.model.forward(qpos[first:stop]),
                self.surfaces.window(first, stop),
                windows_of(ways, first, stop),
                yielding=yielding,
            )
            return Problem(self.model, terms, moved.fps, pinned)

        return problem_of


def solve_on_surfaces(
    model: RobotModel, targets: Targets, ik_qpos: Float[np.ndarray, "T nq"], config: Config
) -> tuple[Float[np.ndarray, "T nq"], tuple[Window, ...]]:
    """Return the trajectory and how each window of the last pass went.

    Raises:
        GeometryError: An object's mesh cannot be read.
        SolveError: A window fails, or its trajectory breaks a joint range or a joint speed.
    """
    windows: tuple[Window, ...] = ()

    def solve(problem_of: ProblemOf, start: np.ndarray, solver: Solver, last: bool) -> np.ndarray:
        nonlocal windows
        qpos, windows = solve_windows(problem_of, start, config.horizon, solver, reported=last)
        return qpos

    return SurfaceProblems.of(model, targets, ik_qpos, config).passes(solve), windows


def to_the_end(solver: Solver) -> Solver:
    """Return the solver of the last pass."""
    return _loosened(solver, TO_THE_END, MOST_ITERATIONS)


@dataclass(frozen=True)
class _OnTheWay:
    """The solver of a pass before the last one: it need not converge, and is not begun again where it does not."""

    options: BandedInteriorPoint

    def solve(self, problem: Problem, qpos: Float[np.ndarray, "T nq"]) -> Solution:
        return solve_once(self.options, problem, qpos, bounds_damp=True)


def _on_the_way(solver: Solver, factor: float) -> Solver:
    loosened = _loosened(solver, factor, ON_THE_WAY)
    return _OnTheWay(loosened) if isinstance(loosened, BandedInteriorPoint) else loosened


def _loosened(solver: Solver, factor: float, most: int) -> Solver:
    """Return a solver with another tolerance, which does not try for ever to get out what is trapped."""
    if not isinstance(solver, BandedInteriorPoint):
        return solver
    iterations = min(solver.max_iterations, most)
    return replace(solver, tolerance=factor * solver.tolerance, max_iterations=iterations)
