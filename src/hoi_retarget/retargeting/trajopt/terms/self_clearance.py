"""Skin of a robot's links outside the solids of its other links; the paper has no such term, and its hands sink."""

from collections.abc import Iterator
from dataclasses import dataclass

from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.link_pairs import LinkPair, near_pairs
from hoi_retarget.retargeting.trajopt.rows import FrameRows, PairRows
from hoi_retarget.robots.limbs import separable_pairs
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import skin_of

MARGIN = 3e-3  # [m]


@dataclass(frozen=True, eq=False)
class SelfClearance:
    """`max(0, margin - distance)^2` [m^2] of links' skin points from the solids of other links."""

    name: str
    pairs: tuple[LinkPair, ...]
    margin: float
    """[m]"""
    weight: float

    def rows(self, kinematics: Kinematics) -> tuple[PairRows, ...]:
        """Return the rows of the pairs that meet at a trajectory."""
        met = ((pair, pair.meeting(kinematics, kinematics, self.margin)) for pair in self.pairs)
        return tuple(
            PairRows(
                FrameRows(pair.link, found.depths, found.inwards, found.moments, self.weight, found.frames), pair.other
            )
            for pair, found in met
            if found is not None
        )


def self_clearance_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[SelfClearance]:
    """Yield the clearance of links that come near to each other at the trajectory a solve starts from, if any do."""
    if weights.self_clearance == 0:
        return
    skins = skin_of(reference.model).by_link
    pairs = tuple(
        pair
        for first, second in separable_pairs(reference.model, tuple(skins))
        for pair in near_pairs(skins[first], skins[second], reference, reference)
        if pair is not None
    )
    if pairs:
        yield SelfClearance("self_clearance", pairs, MARGIN, weights.self_clearance)
