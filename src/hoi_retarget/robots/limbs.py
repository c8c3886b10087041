"""Which links of a robot must stay apart: those that can meet, other than at a joint."""

from functools import lru_cache
from itertools import combinations

import numpy as np

from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.spec import SIDES

# Links with so many joints between them overlap by design; on one limb, whose joints are short, one more.
_MEETING, _MEETING_ON_LIMB = 2, 3


@lru_cache(maxsize=8)
def separable_pairs(model: RobotModel, links: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    """Return the pairs of some links that must stay apart: a link of an arm with any other, or one of each leg."""
    arms, legs = _limbs(model, "palm"), _limbs(model, "foot")
    frames = model.body_frames.frames
    node = {link: frames[link].node for link in links}
    limb = {link: next((k for k, nodes in enumerate((*arms, *legs)) if node[link] in nodes), None) for link in links}

    def apart(first: str, second: str) -> bool:
        ways = model.supports[1:, [node[first], node[second]]]
        one_limb = limb[first] is not None and limb[first] == limb[second]
        joints = np.abs(ways[:, 0] - ways[:, 1]).sum()
        return bool(joints > (_MEETING_ON_LIMB if one_limb else _MEETING))

    def meet(first: str, second: str) -> bool:
        between = (limb[first], limb[second])
        return None not in between or any(k is not None and k < len(arms) for k in between)

    return tuple(pair for pair in combinations(links, 2) if meet(*pair) and apart(*pair))


def _limbs(model: RobotModel, end: str) -> list[set[int]]:
    """Return, for each side, the nodes on the way to the end of its limb that are not on the other side's."""
    ends = (model.sites.frames[f"{side}_{end}"].node for side in SIDES)
    ways = [set(np.flatnonzero(model.supports[:, node]).tolist()) for node in ends]
    return [way - ways[1 - k] for k, way in enumerate(ways)]
