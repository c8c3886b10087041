"""Skin of a robot's links outside the solids of its other links; the paper has no such term, and its hands sink."""

from collections.abc import Iterator
from dataclasses import dataclass

from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.trajopt.link_pairs import REACH, LinkPair, near_pairs
from hoi_retarget.retargeting.trajopt.problem import FrameRows, PairRows
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import LinkSkin, separable_pairs, skin_of

MARGIN = 3e-3  # [m]


@dataclass(frozen=True, eq=False)
class SelfClearance:
    """`max(0, margin - distance)^2` [m^2] of links' skin points from the solids of other links."""

    name: str
    pairs: tuple[LinkPair, ...]
    margin: float  # [m]
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


def self_depth(kinematics: Kinematics) -> float:
    """Return the largest depth of a link's skin in another link [m]; negative where links keep apart."""
    rows = (rows for term in _terms(1.0, kinematics) for rows in term.rows(kinematics))
    return max((float(found.residual.max()) for found in rows), default=0.0) - MARGIN


def self_clearance_terms(weights: Weights, reference: Kinematics) -> Iterator[SelfClearance]:
    """Return the clearance of links that come near to each other at the trajectory a solve starts from, if any do."""
    return iter(()) if weights.self_clearance == 0 else _terms(weights.self_clearance, reference)


def _terms(weight: float, reference: Kinematics) -> Iterator[SelfClearance]:
    pairs = tuple(
        pair
        for first, second in _within_reach(reference)
        for pair in near_pairs(first, second, reference, reference)
        if pair is not None
    )
    if pairs:
        yield SelfClearance("self_clearance", pairs, MARGIN, weight)


def _within_reach(reference: Kinematics) -> Iterator[tuple[LinkSkin, LinkSkin]]:
    """Yield pairs of links that must stay apart and come near to each other in any frame."""
    skins = skin_of(reference.model).by_link
    centres = {link: reference.point(skin.middle) for link, skin in skins.items()}
    for first, second in separable_pairs(reference.model, tuple(skins)):
        apart = ((centres[first] - centres[second]) ** 2).sum(axis=0).min()
        if apart < (skins[first].radius + skins[second].radius + REACH) ** 2:
            yield skins[first], skins[second]
