"""Joint range and joint speed as linear inequalities `c(theta) >= 0` over the frames of a window.

The rows, all [rad], are stacked along axis 0: distance to the lower and to the upper end of the
range, one row a frame, then the slack of a step down and of a step up, one row a pair of frames
(paper Eq. 2b and 2c).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.retargeting.trajopt.problem import Problem


@dataclass(frozen=True, eq=False)
class Bounds:
    """The inequalities of a problem."""

    lower: Float[np.ndarray, "n"]
    upper: Float[np.ndarray, "n"]
    step: Float[np.ndarray, "n"]
    pinned: int
    pinned_after: int

    @classmethod
    def of(cls, problem: Problem) -> "Bounds":
        """Return the bounds of a problem."""
        model = problem.model
        return cls(model.lower, model.upper, problem.step_limits, problem.pinned, problem.pinned_after)

    @property
    def width(self) -> int:
        """Diagonals that the inequalities fill in a band: a joint is coupled with itself one frame on."""
        return 6 + len(self.lower) + 1

    def values(self, theta: Float[np.ndarray, "T n"]) -> Float[np.ndarray, "rows n"]:
        """Return the slack [rad] of every inequality."""
        stop = len(theta) - self.pinned_after
        unknown = theta[self.pinned : stop]
        change = np.diff(theta[max(self.pinned - 1, 0) : stop + self._closed], axis=0)
        return np.concatenate([unknown - self.lower, self.upper - unknown, self.step - change, self.step + change])

    def apply(self, change: Float[np.ndarray, "U n"]) -> Float[np.ndarray, "rows n"]:
        """Return the change of the slacks with the unknown joint angles [rad]."""
        still = np.zeros((1, change.shape[1]))
        steps = np.diff(change, axis=0, prepend=still[: self._open], append=still[: self._closed])
        return np.concatenate([change, -change, -steps, steps])

    def apply_transposed(self, rows: Float[np.ndarray, "rows n"]) -> Float[np.ndarray, "U n"]:
        """Return the transpose of `apply` on one number, of any unit, per inequality."""
        low, high, down, up = self._split(rows)
        total = low - high
        into, out_of = self._steps_at_each_frame(up - down)
        total[len(total) - len(into) :] += into
        total[: len(out_of)] -= out_of
        return total

    def add_normal(self, band: Float[np.ndarray, "U nv width"], weights: Float[np.ndarray, "rows n"]) -> None:
        """Add `A^T diag(weights) A` to a band in place."""
        low, high, down, up = self._split(weights)
        nv = band.shape[1]
        band[:, 6:, 0] += low + high
        into, out_of = self._steps_at_each_frame(down + up)
        band[len(band) - len(into) :, 6:, 0] += into
        band[: len(out_of), 6:, 0] += out_of
        band[:-1, 6:, nv] -= out_of[: len(band) - 1]

    def widths(self, rows: int) -> Float[np.ndarray, "rows n"]:
        """Return the size [rad] of the interval that each inequality is one end of."""
        frames = self._frames(rows)
        ranges = np.tile(self.upper - self.lower, (2 * frames, 1))
        return np.concatenate([ranges, np.tile(2.0 * self.step, (rows - 2 * frames, 1))])

    @property
    def _open(self) -> int:
        """Number of steps from a pinned frame into the first unknown one."""
        return min(self.pinned, 1)

    @property
    def _closed(self) -> int:
        """Number of steps from the last unknown frame to a pinned one."""
        return min(self.pinned_after, 1)

    def _steps_at_each_frame(self, steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the steps to an unknown frame, the last ones, and the steps from one, the first ones."""
        return steps[: len(steps) - self._closed], steps[self._open :]

    def _frames(self, rows: int) -> int:
        return (rows + 2 - 2 * (self._open + self._closed)) // 4

    def _split(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        frames = self._frames(len(rows))
        pairs = (len(rows) - 2 * frames) // 2
        a, b = 2 * frames, 2 * frames + pairs
        return rows[:frames], rows[frames:a], rows[a:b], rows[b:]
