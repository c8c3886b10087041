"""Which column of angles is which joint's, where bodies tell the joints' angles."""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.motion.check.body_poses import BodyReading, implied_angles
from hoi_retarget.motion.check.interpretation import Interpretation
from hoi_retarget.motion.formats import Bodies
from hoi_retarget.numerics.arrays import evenly_spaced
from hoi_retarget.robots.model import RobotModel

_MOST_OPEN = 4  # Joints whose columns are told by trying all orders.
_FRAMES = 40


@dataclass(frozen=True, eq=False)
class AnglesOfBodies:
    """Joint angles that bodies imply, and the columns that are to be them."""

    model: RobotModel
    there: BodyReading
    bodies: Bodies
    joint_pos: Float[np.ndarray, "T c"]

    @cached_property
    def implied(self) -> Float[np.ndarray, "T n"]:
        """Return the angles that bodies imply [rad]; NaN for joints whose bodies are not all there."""
        return implied_angles(self.model, self.there, self.bodies.pos, self.bodies.quat)

    @property
    def has_column(self) -> Bool[np.ndarray, "n"]:
        """Return which joints the file has."""
        return np.array(self.there.reading.columns) >= 0

    @property
    def told(self) -> Bool[np.ndarray, "n"]:
        """Return which of them bodies tell."""
        return np.isfinite(self.implied).all(axis=0) & self.has_column

    def errors(self, reading: Interpretation) -> Float[np.ndarray, "k"]:
        """Return how far the columns are from the angles, of those joints that are told [rad]."""
        told = self.told
        return angles_apart(self.implied[:, told] - reading.angles(self.joint_pos)[:, told])

    def in_best_order(self, claim: Interpretation) -> Interpretation:
        """Return a claim with that order of its columns that fits best.

        Joints between whose bodies others are missing are told by where the bodies behind them are, up to four.
        """
        from scipy.optimize import linear_sum_assignment  # noqa: PLC0415  # takes a quarter of a second

        told, columns = self.told, np.array(claim.columns)
        there = columns[columns >= 0]
        apart = np.abs(self.implied[:, told, None] - self.joint_pos[:, None, there]).mean(axis=0)
        columns[told] = there[linear_sum_assignment(apart)[1]]
        left = np.setdiff1d(there, columns[told]).tolist()
        untold = np.flatnonzero(~told & (columns >= 0))
        orders = permutations(left) if len(left) <= _MOST_OPEN else [left]
        readings = []
        for order in orders:
            columns[untold] = order
            readings.append(replace(claim, columns=tuple(columns.tolist())))
        return min(readings, key=self._body_error) if len(readings) > 1 else readings[0]

    def _body_error(self, reading: Interpretation) -> float:
        """Return the mean distance of bodies from where the joint angles put them [m]."""
        frames = evenly_spaced(len(self.joint_pos), _FRAMES)
        pos, quat = self.bodies.pos[frames], self.bodies.quat[frames]
        names, places = list(self.there.places), list(self.there.places.values())
        root = self.there.places[self.model.body_names[0]]
        qpos = reading.qpos(pos[:, root], quat[:, root], self.joint_pos[frames])
        at = self.model.forward(qpos).body_positions[:, [self.model.body_names.index(name) for name in names]]
        return float(np.linalg.norm(at - reading.position(pos[:, places]), axis=-1).mean())


def angles_apart(difference: Float[np.ndarray, "T k"]) -> Float[np.ndarray, "k"]:
    """Return the root mean square of differences of angles over time, whole turns left out [rad]."""
    with np.errstate(over="ignore"):
        wrapped = np.abs(np.angle(np.exp(1j * np.clip(difference, -1e6, 1e6))))
    # Angles that are far beyond a turn would look near by chance.
    return np.sqrt(np.mean(np.where(np.abs(difference) > 7.0, np.pi, wrapped) ** 2, axis=0))
