"""Solves a clip again after its contacts or pins changed, but only around the frames in which they did.

Contacts and pins enter the trajectory's optimization alone: targets of the body and inverse kinematics stay as
they are. The frames around a change are solved again between pinned ones, which takes as long as the
change is, not as the clip is. What comes out is a preview: the whole clip solved at once may differ by
what the optimum gains from moving the pinned frames too, and by where its solve ends: where parts are pinned, by
centimetres.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_dilation

from hoi_retarget.clip.clip import Clip
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.numerics.filters import frames_in
from hoi_retarget.retargeting.config import PINNED, Config, Solver
from hoi_retarget.retargeting.pipeline import on_surfaces, one_thread, retarget_with_targets, scored, solve_trajectory
from hoi_retarget.retargeting.surfaces.solve import ProblemOf, SurfaceProblems
from hoi_retarget.retargeting.targets import Targets, with_contacts_of, with_pins
from hoi_retarget.retargeting.trajopt.problem import Problem
from hoi_retarget.retargeting.trajopt.table import trajectory_terms
from hoi_retarget.retargeting.trajopt.windows import report_window
from hoi_retarget.robots.model import RobotModel

MARGIN_SECONDS = 1.0  # On either side of a change: what an arm needs to get from one place to another.
_AT_ONCE = 4  # Times as many frames as are around a change: no longer clips are solved whole when pins change.


@dataclass(frozen=True, eq=False)
class Draft:
    """One robot's motion for one person of a clip, and what is needed to revise it."""

    clip: Clip
    person: int
    targets: Targets
    motion: Motion


def draft(clip: Clip, model: RobotModel, config: Config, *, person: int = 0) -> Draft:
    """Solve a whole clip; raises what `retarget` raises."""
    motion, targets = retarget_with_targets(clip, model, config, person=person)
    return Draft(clip, person, targets, motion)


def revise(before: Draft, clip: Clip, model: RobotModel, config: Config, *, quickly: bool = False) -> Draft:
    """Return the draft for a clip that is equal to the draft's own but for its contacts and pins.

    Unless it is to go quickly, pins that change in a short clip make it what `draft` makes of it, to the bit.

    Raises `SolveError` when the frames around a change end without a usable trajectory.
    """
    with one_thread():
        unpinned = before.targets.unpinned or before.targets
        targets = with_contacts_of(unpinned, clip, model, person=before.person)
        targets = with_pins(targets, clip, model, before.motion.stages[0].qpos, person=before.person)
        qpos = before.motion.qpos.copy()
        pieces = _pieces(before.targets, targets)
        around = sum(stop - first for first, stop in pieces)
        whole = not quickly and len(qpos) <= _AT_ONCE * around and _repinned(before.targets, targets).any()
        if whole or any(stop - first > config.horizon.length for first, stop in pieces):
            qpos = solve_trajectory(model, targets, before.motion.stages[0].qpos, config)[0]
        else:
            for first, stop in pieces:
                qpos[first:stop] = _solve_piece(model, targets, before.motion.stages[0].qpos, qpos, config, first, stop)
        motion = replace(
            before.motion.with_qpos(qpos),
            contact_flags=targets.contact_flags,
            contact_object=targets.contact_object,
            contact_points=targets.contact_points,
        )
        return Draft(clip, before.person, targets, scored(motion, targets, clip, model, before.person))


def _pieces(before: Targets, after: Targets) -> tuple[tuple[int, int], ...]:
    """Return the frames to solve again as (first, one past the last): those that changed, and a margin."""
    margin = frames_in(MARGIN_SECONDS, after.fps) + PINNED
    changed = changed_frames(before, after)
    return runs(binary_dilation(changed, np.ones(2 * margin + 1)))


def changed_frames(before: Targets, after: Targets) -> np.ndarray:
    """Return in which frames contacts or pins ask for something else, T booleans."""
    asked = (before.contact_weights > 0) | (after.contact_weights > 0)
    moved = (before.carried_contact_points != after.carried_contact_points).any(axis=2)
    exchanged = before.carried_contact_object != after.carried_contact_object
    weighed = before.contact_weights != after.contact_weights
    turned = before.contact_rotation_weights != after.contact_rotation_weights
    return ((asked & (moved | exchanged)) | weighed | turned).any(axis=1) | _repinned(before, after)


def _repinned(before: Targets, after: Targets) -> np.ndarray:
    changed = (before.foot_positions != after.foot_positions).any(axis=(1, 2))
    changed |= (before.foot_quats != after.foot_quats).any(axis=(1, 2))
    old, new = ({pin.site: pin for pin in targets.pins} for targets in (before, after))
    for site in old | new:
        one, other = old.get(site), new.get(site)
        if one is None or other is None:
            changed |= (one or new[site]).weights > 0
            continue
        asked = (one.weights > 0) | (other.weights > 0)
        moved = (one.positions != other.positions).any(axis=1) | (one.quats != other.quats).any(axis=1)
        changed |= (asked & moved) | (one.weights != other.weights) | (one.turn_weights != other.turn_weights)
    return changed


def _solve_piece(  # noqa: PLR0913, PLR0917 - what a problem is made of
    model: RobotModel,
    targets: Targets,
    ik_qpos: np.ndarray,
    qpos: np.ndarray,
    config: Config,
    first: int,
    stop: int,
) -> np.ndarray:
    piece, frames = targets.window(first, stop), stop - first
    pinned, pinned_after = (PINNED if first > 0 else 0), (PINNED if stop < len(qpos) else 0)

    def solve(problem_of: ProblemOf, start: np.ndarray, solver: Solver, last: bool) -> np.ndarray:
        problem = replace(problem_of(0, frames, pinned), pinned_after=pinned_after)
        # The first pass starts from inverse kinematics, but what is pinned is as it was.
        begun = qpos[first:stop] if start is reference else start
        solution = solver.solve(problem, begun)
        if last:
            report_window(first, stop, problem, solution)
        return solution.qpos

    reference = ik_qpos[first:stop]
    if on_surfaces(targets, config):
        return SurfaceProblems.of(model, piece, reference, config).passes(solve)
    terms = trajectory_terms(config.weights, piece, model.forward(reference))
    return solve(
        lambda _first, _stop, pinned: Problem(model, terms, targets.fps, pinned), reference, config.solver, True
    )
