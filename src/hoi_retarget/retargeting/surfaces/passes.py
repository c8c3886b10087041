"""Trajectories of hands that touch with their surface, solved in passes: contact points first, then surfaces.

The first pass is the paper's problem, coarsely, with contact points moved to places where the robot's hand touches.
It ends near the solution of the others, in which distances between surfaces count. These differ only in their
points, which each pass chooses anew at the end of the pass before it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.orientation_flips import orientation_flips, rotation_errors_deg, trunk_turns
from hoi_retarget.retargeting.surfaces import contact_targets
from hoi_retarget.retargeting.surfaces import surface_terms as between_surfaces
from hoi_retarget.retargeting.surfaces.depenetration import EscapePath, escape_paths, paths_within
from hoi_retarget.retargeting.surfaces.skin_points import moving_objects
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.problem import Problem
from hoi_retarget.retargeting.trajopt.solvers.solver import Effort
from hoi_retarget.retargeting.trajopt.terms.self_clearance import self_depth
from hoi_retarget.retargeting.trajopt.trajectory_terms import trajectory_terms
from hoi_retarget.retargeting.trajopt.windows import FrameRange, ProblemOf
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.skin import skin_of

NEAR = 3e-3
"""Share of joints' ranges: each pass starts near its solution, and a wrist moved off its stop would lose its hold."""
COARSE = Effort(300.0, max_iterations=15, restarts=False, start_margin=NEAR)
"""Of the passes that choose contact points: contacts weigh so much that a smaller tolerance shows nowhere."""
FINE = Effort(20.0, max_iterations=15, restarts=False, start_margin=NEAR)  # Of the first pass between surfaces.
FINAL = Effort(7.0, max_iterations=150, kinks=True, start_margin=NEAR)
"""Of the last pass, which does not try for ever to free a trapped link."""
MET_DEPTH_M = 2.5e-3  # [m]; what was too far apart before the last pass for its terms may be in each other at its end.
ROUNDS = 3  # In which links leave objects.
COARSE_FRAMES = 3
"""Wrong frames that later passes may mend; with more after a coarse pass, ways out of an object are given up."""

LONG = 2000  # [frames]; what is near along more of them is found piece by piece, and forgotten.
LOST_DISTANCE = 0.12  # [m]; a hand farther from its contact point has let go of the object.

SolvePass = Callable[[ProblemOf, Float[np.ndarray, "T nq"], Effort, bool], Float[np.ndarray, "T nq"]]
"""Solves one pass from a start with an effort; the last argument says whether it is the last pass."""


@dataclass(frozen=True, eq=False)
class SurfaceProblems:
    """The problems of one robot's targets, one for each pass."""

    model: RobotModel
    targets: Targets
    ik_qpos: Float[np.ndarray, "T nq"]
    config: Config
    surfaces: between_surfaces.Surfaces

    @classmethod
    def of(
        cls, model: RobotModel, targets: Targets, ik_qpos: Float[np.ndarray, "T nq"], config: Config
    ) -> "SurfaceProblems":
        """Return the problems.

        Raises `GeometryError` where an object's mesh cannot be read.
        """
        objects = moving_objects(targets)
        surfaces = between_surfaces.Surfaces(objects, skin_of(model), contact_targets.contact_sides(targets, objects))
        return cls(model, targets, ik_qpos, config, surfaces)

    def first_pass(self, solve_pass: SolvePass) -> Float[np.ndarray, "T nq"]:
        """Return the trajectory [m, rad, quaternions] with hands at their holds, at the end of the first pass alone."""
        return solve_pass(self._with_points(self._touching(self.ik_qpos), ()), self.ik_qpos, COARSE, True)

    def passes(self, solve_pass: SolvePass) -> Float[np.ndarray, "T nq"]:
        """Return the trajectory [m, rad, quaternions] at the end of all passes."""
        qpos: np.ndarray = self.ik_qpos
        first = qpos
        paths: tuple[EscapePath, ...] = ()
        for _ in range(1 + ROUNDS):
            qpos = solve_pass(self._with_points(self._touching(qpos), paths), qpos, COARSE, False)
            further = self._escape_paths(qpos, paths)
            if not further:
                break
            paths = (*paths, *further)
            first = qpos if len(paths) == len(further) else first
        if not paths:
            return self._between_surfaces(solve_pass, qpos, ())
        # Links must not leave an object by turning the robot over, or by letting go of it.
        wrong = self._wrong_frames(first)
        if self._wrong_frames(qpos) <= wrong + COARSE_FRAMES:
            solved = self._between_surfaces(solve_pass, qpos, paths)
            if self._wrong_frames(solved) <= wrong:
                return solved
        return self._between_surfaces(solve_pass, first, ())

    def _between_surfaces(
        self, solve_pass: SolvePass, qpos: np.ndarray, paths: tuple[EscapePath, ...]
    ) -> Float[np.ndarray, "T nq"]:
        touching = self._resting(qpos)
        # Skin that was far from the surface before a pass may have sunk in: each pass chooses its points anew.
        for effort, last in ((FINE, False), (FINAL, True)):
            qpos = solve_pass(
                self._with_surfaces(_Start(self, touching, qpos), paths, relaxed=last), qpos, effort, last
            )
        start = _Start(self, touching, qpos)
        if start.met_depth < MET_DEPTH_M:
            return qpos
        again = solve_pass(self._with_surfaces(start, paths, relaxed=True), qpos, FINAL, True)
        return again if _Start(self, touching, again).met_depth < start.met_depth else qpos

    def _wrong_frames(self, qpos: np.ndarray) -> int:
        """Return the number of frames of links that point away from the human's, of turned trunks and of lost hands."""
        kinematics, targets = self.model.forward(qpos), self.targets
        flips = orientation_flips(rotation_errors_deg(kinematics, targets))
        frames = sum(event.frames for event in (*flips, *trunk_turns(kinematics, targets)))
        for column, site in enumerate(targets.contact_links):
            for index, moving_object in enumerate(self.surfaces.objects):
                touching = targets.contact_flags[:, column] & (targets.contact_object[:, column] == index)
                at = np.flatnonzero(touching)
                place = moving_object.inside(kinematics.site_position(site)[at].T[:, None], at)[:, 0].T
                off = np.linalg.norm(place - targets.carried_contact_points[at, column], axis=1)
                frames += int(np.count_nonzero(off > LOST_DISTANCE))
        return frames

    def last(self, qpos: Float[np.ndarray, "T nq"]) -> ProblemOf:
        """Return the problem of the last pass, for a trajectory that has been through all of them."""
        return self._with_surfaces(_Start(self, self._resting(qpos), qpos), (), relaxed=True)

    def _escape_paths(self, qpos: np.ndarray, earlier: tuple[EscapePath, ...]) -> tuple[EscapePath, ...]:
        """Return paths for links that are deep in an object, except for links in contact, and in its frames."""
        of, targets, touching = self.surfaces, self.targets, {}
        for column, site in enumerate(targets.contact_links):
            if site not in contact_targets.RESTING_SITES:
                for skin in between_surfaces.touching_skins(targets, self.model, site):
                    touching[skin.link] = targets.contact_weights[:, column] > 0
        weight, start = self.config.weights.clearance, self.model.forward(qpos)
        return escape_paths(of.objects, targets.limbs, of.skin, touching, start, earlier, weight, targets.fps)

    def _touching(self, qpos: np.ndarray) -> Targets:
        of = self.surfaces
        return contact_targets.touching_targets(self.targets, of.objects, of.sides, self.model.forward(qpos))

    def _resting(self, qpos: np.ndarray) -> Targets:
        return contact_targets.resting_palms(self._touching(qpos), self.surfaces.objects, self.model.forward(qpos))

    def _with_points(self, targets: Targets, paths: tuple[EscapePath, ...]) -> ProblemOf:
        def problem_of(window: FrameRange) -> Problem:
            first, stop = window.first, window.stop
            reference = self.model.forward(self.ik_qpos[first:stop])
            terms = trajectory_terms(self.config.weights.with_surfaces, targets.window(first, stop), reference)
            terms = (*terms, *paths_within(paths, first, stop))
            return Problem(self.model, terms, targets.fps, window.pinned, window.pinned_after)

        return problem_of

    def _with_surfaces(self, start: "_Start", paths: tuple[EscapePath, ...], *, relaxed: bool) -> ProblemOf:
        def problem_of(window: FrameRange) -> Problem:
            first, stop = window.first, window.stop
            begin = start if stop - first == len(start.qpos) else start.window(first, stop)
            terms = between_surfaces.surface_terms(
                self.config.weights.with_surfaces,
                begin.touching,
                self.model.forward(self.ik_qpos[first:stop]),
                begin.kinematics,
                begin.problems.surfaces,
                begin.near,
                paths_within(paths, first, stop),
                relaxed=relaxed,
            )
            return Problem(self.model, terms, begin.touching.fps, window.pinned, window.pinned_after)

        return problem_of


@dataclass(frozen=True, eq=False)
class _Start:
    """A trajectory that a pass starts from or ends with, and terms of things that are near along it, made once."""

    problems: SurfaceProblems
    touching: Targets
    qpos: Float[np.ndarray, "T nq"]

    def window(self, first: int, stop: int) -> "_Start":
        """Return it in some consecutive frames."""
        problems = replace(self.problems, surfaces=self.problems.surfaces.window(first, stop))
        return _Start(problems, self.touching.window(first, stop), self.qpos[first:stop])

    @cached_property
    def kinematics(self) -> Kinematics:
        return self.problems.model.forward(self.qpos)

    @cached_property
    def near(self) -> tuple[between_surfaces.Clearance, ...]:
        return between_surfaces.clearances(
            self.problems.config.weights.with_surfaces, self.touching, self.kinematics, self.problems.surfaces
        )

    @cached_property
    def met_depth(self) -> float:
        """The largest depth of links in each other and in objects [m], trapped ones left out."""
        frames = len(self.qpos)
        if frames > LONG:
            return max(self.window(first, min(first + LONG, frames)).met_depth for first in range(0, frames, LONG))
        in_links = self_depth(self.kinematics) if self.problems.config.weights.with_surfaces.self_clearance else 0.0
        return max(in_links, between_surfaces.free_depth(self.near, self.kinematics))
