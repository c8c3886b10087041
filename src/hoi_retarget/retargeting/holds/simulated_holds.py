"""Holds with which two free hands in simulation keep an object, near the chosen ones.

Where the chosen holds lose the object, each hand is tried with its longest hold throughout, then with poses near by:
they just touch, and pairs go by their forces and costs, until enough of them keep the object. The best is taken.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.dynamics.free_hands import FreeHands, KeptObject, Touch, palm_skin, touch_of
from hoi_retarget.dynamics.object_bodies import collision_shape, object_body
from hoi_retarget.dynamics.object_support import object_load
from hoi_retarget.dynamics.physics_scene import SceneObject
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.errors import GeometryError, install_hint
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import evenly_spaced
from hoi_retarget.retargeting.holds.arm_reach import reach
from hoi_retarget.retargeting.holds.hand_settling import depths, touching_areas
from hoi_retarget.retargeting.holds.hand_shape import HandPoses, hand_shape
from hoi_retarget.retargeting.holds.hold import Hold
from hoi_retarget.retargeting.holds.hold_choice import DEEPEST, ENOUGH_AREA, MIRRORED, TOUCHING
from hoi_retarget.retargeting.surfaces.skin_points import MovingObject
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.spec import PALMS

CANDIDATES, SHIFT, TURN, LONGEST_TURN = 400, 0.09, 0.45, 1.0
"""Poses of a hand by lot, and how far from its longest hold they are, along and about each axis [m, rad]."""
FARTHEST, FARTHEST_TURN = 0.11, np.radians(75.0)
"""[m, rad]; a hold that is farther from the person's palm does not stand for it."""
SETTLING_STEPS, LONGEST_STEP = 6, 0.03  # In which a hand is moved until it just touches, and the longest of them [m].
OPTIONS = 80  # Poses of a hand that are left: those that cost least.
DISTANCE_COST, LEVER, AREA_COST, REACH_COST = 1.0, 0.05, 200.0, 0.02
"""Of a metre from the chosen holds, in which a turn counts by a lever [m]; of a square metre of palmar skin that does
not touch; and of a unit of reach."""
OFF, TURNED, DEEP, BENT = 0.01, 0.2, 0.006, 1.5  # Errors of reach that are units [m, rad, m, rad].
LARGEST_COST, REACH_FRAMES = 10.0, 8  # Units in one frame at most, and frames in which the reach is looked at.
PAIRS, ROUNDS, BEST_PAIRS = 400, 2, 6
"""Pairs by lot, and rounds in which the hands of so many best ones are paired anew."""
FRAMES, EASY_FORCE, FORCE_COST = 6, 25.0, 0.002
"""Frames in which a pair's forces are found, an easy force [N], and the cost of a newton more; all weight's is 1."""
SIMULATED, ENOUGH, EVERY = 60, 12, 2
"""Pairs that are simulated at most, those that keep the object after which no more are, and frames a force counts."""
OFF_HOLD = 0.0015  # [m]; a solved body has its hands about so far off their holds.
TURN_COST, LARGEST_OFF, OPTION_SHARE = 0.15, 0.5, 0.15
"""Metres off its path that count as much as an object's turn by a radian, the most that count, and the weight of what
holds cost."""


def simulated_holds(  # noqa: PLR0913, PLR0917  # the parts of a choice
    targets: Targets,
    objects: tuple[MovingObject, ...],
    holds: Sequence[Hold],
    start: Kinematics,
    physics: Physics,
    index: int,
) -> tuple[Hold, ...]:
    """Return the holds, with those on one object that keep it, or as they were where none are found.

    Raises `GeometryError` where the object is not convex, and nothing that cuts it into convex parts is installed.

    Args: `targets`: of the robot, of two frames or more; `objects`: of its world; `holds`: all that were chosen;
    `start`: the IK trajectory; `physics`: masses and frictions; `index`: of the object; no other robot's hands hold it.
    """
    name, scale = targets.object_names[index], float(targets.object_scale[index])
    shape = collision_shape(geometry := targets.object_geometry[index])
    if not shape.fits:
        raise GeometryError(
            f"{name}: holds are simulated on an object's convex parts, and nothing finds them here. "
            f"{install_hint('coacd')}, or leave --holds simulated out."
        )
    item = SceneObject("object", object_body(name, geometry, scale, physics), shape, scale)
    poses = np.concatenate([targets.object_pos, targets.object_quat], axis=2)[:, [index]]
    path = targets.object_pos[:, index], targets.object_quat[:, index]
    load = object_load(name, geometry, scale, path, targets.fps, physics)
    free_hands = FreeHands(start.model, (item,), poses, (load,), targets.fps, physics)
    sites = [targets.contact_links[hold.episode.link] for hold in holds]
    on_it = [number for number, hold in enumerate(holds) if hold.episode.object == index]
    own = [[number for number in on_it if sites[number] == palm] for palm in PALMS]
    return _HoldSearch(free_hands, objects[index], holds, own, start).holds_of_best()


@dataclass(frozen=True, eq=False)
class _Option:
    """A pose of a hand, and its cost; none for a hand that does not touch the object."""

    touch: Touch | None
    cost: float = 0.0


@dataclass(frozen=True, eq=False)
class _Trial:
    """Poses by the number of a hold, the outcome for the object, and its cost."""

    touches: dict[int, Touch]
    found: KeptObject
    cost: float


@dataclass(frozen=True, eq=False)
class _HoldSearch:
    free_hands: FreeHands
    moving_object: MovingObject
    holds: Sequence[Hold]
    own: list[list[int]]  # Numbers of the holds of each hand on the object.
    start: Kinematics

    def holds_of_best(self) -> tuple[Hold, ...]:
        """Return all holds, those on the object as in the best trial."""
        best = self._best()
        return tuple(
            self._held(number, best) if number in best.touches else hold for number, hold in enumerate(self.holds)
        )

    def _best(self) -> _Trial:
        chosen = self._trial(self.chosen)
        if chosen.found.kept:
            return chosen
        of = [hold.episode for hold in self.holds]
        longest = [max(own, key=lambda number: of[number].stop - of[number].first, default=None) for own in self.own]
        one = self._trial(self._with([None if number is None else self.chosen[number] for number in longest]))
        if one.found.kept:
            return one
        options = [[_Option(None)] if number is None else self._options(number) for number in longest]
        trials = [chosen, one]
        for left, right in self._ordered(options):
            trials.append(self._trial(self._with([left.touch, right.touch]), left.cost + right.cost))
            if sum(trial.found.kept for trial in trials) >= ENOUGH:
                break
        near = [trial for trial in trials if trial.found.kept or trial.found.near]
        return min(near, key=lambda trial: trial.cost, default=chosen)

    @cached_property
    def chosen(self) -> dict[int, Touch]:
        """The poses of the chosen holds."""
        return {number: self.holds[number].touch for own in self.own for number in own}

    def _touch(self, palm: str, position: Float[np.ndarray, "3"], rotation: Float[np.ndarray, "3 3"]) -> Touch:
        return touch_of(palm_skin(self.start.model, palm), self.moving_object.field, position, rotation)

    def _with(self, touches: Sequence[Touch | None]) -> dict[int, Touch]:
        """Return one pose a hand for all its holds; holds of which the person's palm is too far keep their own."""
        found = dict(self.chosen)
        for own, touch in zip(self.own, touches, strict=True):
            for number in own:
                if touch and np.linalg.norm(touch.position - self.holds[number].person_position) < FARTHEST:
                    found[number] = touch
        return found

    def _trial(self, touches: dict[int, Touch], options_cost: float = 0.0) -> _Trial:
        hands: list[list[Touch | None]] = [[None] * len(self.free_hands.poses) for _ in PALMS]
        for own, by_frame in zip(self.own, hands, strict=True):
            for number in own:
                of = self.holds[number].episode
                by_frame[of.frames] = [touches[number]] * (of.stop - of.first)
        found = self.free_hands.keep((hands[0], hands[1]), every=EVERY, off=OFF_HOLD)[0]
        turned = TURN_COST * np.radians(min(found.off_deg, 90.0))
        return _Trial(touches, found, min(found.off_m, LARGEST_OFF) + turned + OPTION_SHARE * options_cost)

    @cached_property
    def _active(self) -> Bool[np.ndarray, "2 T"]:
        active = np.zeros((2, len(self.free_hands.poses)), dtype=bool)
        for row, own in zip(active, self.own, strict=True):
            for number in own:
                row[self.holds[number].episode.frames] = True
        return active

    def _options(self, number: int) -> list[_Option]:
        """Return its own pose and the cheapest ones about a hold that just touch."""
        poses, touches = self._candidates(number)
        hand = 0 if number in self.own[0] else 1
        shape, palm = hand_shape(self.start.model, PALMS[hand]), PALMS[hand]
        others = [HandPoses(self.chosen[n].position[None], self.chosen[n].rotation[None]) for n in self.own[hand]]
        away = [np.linalg.norm(poses.away_from(other).reshape(-1, 2, 3), axis=2) @ [1.0, LEVER] for other in others]
        missing = np.maximum(1e-4 * ENOUGH_AREA - touching_areas(shape, self.moving_object, poses, TOUCHING), 0.0)
        costs = DISTANCE_COST * np.min(away, axis=0) + AREA_COST * missing
        kept = np.argsort(costs, kind="stable")[:OPTIONS]
        kept = kept[depths(shape, self.moving_object, poses.take(kept)) < DEEPEST]
        if not kept.size:
            return [_Option(self.chosen[number])]
        frames = np.flatnonzero(self._active[hand])
        frames = frames[evenly_spaced(len(frames), REACH_FRAMES)]
        near = reach(self.start, palm, self.moving_object, frames, poses.take(kept))
        units = (near.off / OFF) ** 2 + (near.turned / TURNED) ** 2 + (near.bent / BENT) ** 2
        units += (np.maximum(near.depth, 0.0) / DEEP) ** 2
        costs[kept] += REACH_COST * np.minimum(units, LARGEST_COST).mean(axis=1)
        return [_Option(self.chosen[number]), *(_Option(touches[at], float(costs[at])) for at in kept)]

    def _candidates(self, number: int) -> tuple[HandPoses, list[Touch]]:
        own, field = self.chosen[number], self.moving_object.field
        hand, random = 0 if number in self.own[0] else 1, np.random.default_rng(0)
        palm, mirrored = PALMS[hand], MIRRORED if hand else 1.0
        shifts = SHIFT * random.uniform(-1.0, 1.0, (CANDIDATES, 3))
        turns = np.clip(TURN * random.standard_normal((CANDIDATES, 3)), -LONGEST_TURN, LONGEST_TURN)
        shifts, turns = np.split(mirrored * np.concatenate([shifts, turns], axis=1), 2, axis=1)
        positions = own.position + shifts @ own.rotation.T
        poses = HandPoses(positions, own.rotation @ se3.quat_to_matrix(se3.exp(turns)))
        skin, least = palm_skin(self.start.model, palm)[0][::2], np.full(CANDIDATES, np.inf)
        for _ in range(SETTLING_STEPS):
            points = poses.placed(skin)
            nearest = field.distances(points.reshape(-1, 3)).reshape(CANDIDATES, -1).argmin(axis=1)
            least, outward = field.distances_and_normals(points[np.arange(CANDIDATES), nearest])
            step = np.clip(least, -LONGEST_STEP, LONGEST_STEP)[:, None] * outward
            poses = HandPoses(poses.positions - step, poses.rotations)
        away = np.linalg.norm(poses.away_from(self.holds[number].person.palm).reshape(-1, 2, 3), axis=2)
        poses = poses.take(np.flatnonzero((away < [FARTHEST, FARTHEST_TURN]).all(axis=1) & (np.abs(least) < TOUCHING)))
        touches = [self._touch(palm, *pose) for pose in zip(poses.positions, poses.rotations, strict=True)]
        touching = [at for at, touch in enumerate(touches) if len(touch.points)]
        return poses.take(np.array(touching, dtype=int)), [touches[at] for at in touching]

    def _ordered(self, options: Sequence[list[_Option]]) -> Iterator[tuple[_Option, _Option]]:
        """Yield pairs of options in the order of the weight that they lack, their forces, and their costs."""
        left, right = options
        scores: dict[tuple[int, int], float] = {}

        def best(pairs: list[tuple[int, int]], count: int) -> list[tuple[int, int]]:
            for pair in pairs:
                if pair not in scores:
                    scores[pair] = self._score(left[pair[0]], right[pair[1]])
            return sorted(scores, key=lambda pair: scores[pair])[:count]

        # Both ways, so that mirrored hands have mirrored pairs.
        lots = np.random.default_rng(0).uniform(size=(PAIRS // 2, 2))
        pairs = (np.concatenate([lots, lots[:, ::-1]]) * [len(left), len(right)]).astype(int)
        found = best([(first, second) for first, second in pairs.tolist()], BEST_PAIRS)
        for _ in range(ROUNDS):
            found = best([(first, second) for first, _ in found for _, second in found], BEST_PAIRS)
        for first, second in best([], SIMULATED):
            yield left[first], right[second]

    def _score(self, left: _Option, right: _Option) -> float:
        frames = np.flatnonzero(self._active.any(axis=0))
        missing, largest = [], 0.0
        for frame in frames[evenly_spaced(len(frames), FRAMES)].tolist():
            pairs = zip((left, right), self._active[:, frame], strict=True)
            touches = [option.touch for option, active in pairs if active and option.touch]
            share, forces = self.free_hands.forces(frame, touches)
            missing.append(min(share, 1.0))
            largest = max(largest, *(float(np.linalg.norm(own.sum(axis=0))) for _, own in forces))
        return float(np.mean(missing)) + FORCE_COST * max(0.0, largest - EASY_FORCE) + left.cost + right.cost

    def _held(self, number: int, best: _Trial) -> Hold:
        """Return a hold as it is in a trial."""
        hold, touch, hand = self.holds[number], best.touches[number], 0 if number in self.own[0] else 1
        hold = replace(hold, kept=best.found.kept)
        if touch is self.chosen[number]:
            return hold
        pose, shape = HandPoses(touch.position[None], touch.rotation[None]), hand_shape(self.start.model, PALMS[hand])
        off = reach(self.start, PALMS[hand], self.moving_object, hold.frames, pose).off[0]
        area = float(touching_areas(shape, self.moving_object, pose, TOUCHING)[0])
        return replace(hold, touch=touch, off=off, area=area)
