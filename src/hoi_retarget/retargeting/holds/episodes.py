"""Episodes of a contact: stretches of time in which the person's hand keeps its place on the object."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.numerics.arrays import runs
from hoi_retarget.numerics.filters import closed_and_opened, seconds_to_frames

JOINED_SECONDS = 0.2  # Labels that are off for less than this flicker: no hand lets go and takes hold again so quickly.
STEP = 0.04  # [m]; a hand that moves by twice as much, and stays there for a second, has taken hold anew.
SHORTEST_SECONDS = 0.3  # A hand that stays for less has not taken hold.


@dataclass(frozen=True)
class Episode:
    """One hand on one object, in consecutive frames."""

    link: int  # Column of the targets' contact links.
    object: int
    first: int
    stop: int  # One past its last frame.

    @property
    def frames(self) -> slice:
        """Its frames."""
        return slice(self.first, self.stop)


def joined(active: Bool[np.ndarray, "T"], fps: float) -> Bool[np.ndarray, "T"]:
    """Return labels without the gaps in which no hand lets go."""
    return closed_and_opened(active, gap=seconds_to_frames(JOINED_SECONDS, fps), shortest=1)


def episodes(
    link: int, touched: Int[np.ndarray, "T"], path: Float[np.ndarray, "T k"], fps: float
) -> tuple[Episode, ...]:
    """Return the episodes of one hand, in the order of time.

    `link`: column of the hand; `touched`: index of the touched object in every frame, -1 for none; `path`: of the hand
    in the object's frame: places of one or more of its points [m]; `fps`: frames a second.
    """
    found, shortest = [], seconds_to_frames(SHORTEST_SECONDS, fps)
    for index in np.unique(touched[touched >= 0]).tolist():
        for first, stop in runs(touched == index):
            edges = first + _without_short(steps(path[first:stop], fps * STEP**2), shortest)
            found += [Episode(link, index, *ends) for ends in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)]
    return tuple(sorted(found, key=lambda episode: episode.first))


def steps(path: Float[np.ndarray, "F k"], price: float) -> Int[np.ndarray, "S"]:
    """Return the ends of stretches, 0 and F included, of the path that changes in steps and is nearest to a path [m].

    The squared distance from the mean of each stretch, summed over its frames, and a price for each stretch are least
    (Potts' functional, by dynamic programming).
    """
    frames = len(path)
    sums = np.concatenate([np.zeros((1, path.shape[1])), np.cumsum(path, axis=0)])
    squares = np.concatenate([[0.0], np.cumsum(np.einsum("fk,fk->f", path, path))])
    least, before = np.zeros(frames + 1), np.zeros(frames + 1, dtype=int)
    for stop in range(1, frames + 1):
        within = sums[stop] - sums[:stop]
        spread = squares[stop] - squares[:stop] - np.einsum("fk,fk->f", within, within) / (stop - np.arange(stop))
        total = least[:stop] + spread
        before[stop] = total.argmin()
        least[stop] = total[before[stop]] + price
    ends = [frames]
    while ends[-1] > 0:
        ends.append(int(before[ends[-1]]))
    return np.array(ends[::-1])


def _without_short(edges: Int[np.ndarray, "S"], shortest: int) -> Int[np.ndarray, "R"]:
    """Return the ends of stretches after short ones went to their longer neighbours, the shortest first."""
    left = edges.tolist()
    while len(left) > 2 and (lengths := np.diff(left)).min() < shortest:
        short = int(lengths.argmin())
        around = np.concatenate([[-1], lengths, [-1]])
        del left[short if around[short] > around[short + 2] else short + 1]
    return np.array(left)
