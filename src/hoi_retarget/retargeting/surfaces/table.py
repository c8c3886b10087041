"""The terms of contact between surfaces, on top of the cost table: touch, and nothing inside anything."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics.filters import fade, frames_in
from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.surfaces.moving_object import MovingObject
from hoi_retarget.retargeting.surfaces.object_outside_link import ObjectOutsideLink, object_outside_link
from hoi_retarget.retargeting.surfaces.skin_contact import SkinContact, skin_contact
from hoi_retarget.retargeting.surfaces.ways_out import WayOut
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.problem import Term
from hoi_retarget.retargeting.trajopt.table import trajectory_terms
from hoi_retarget.retargeting.trajopt.terms.object_contact import ObjectContact
from hoi_retarget.retargeting.trajopt.terms.self_clearance import self_clearance_terms
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import Skin

TOUCH_SECONDS = 2 / 30
"""Over which touch comes and goes before and after a contact."""
TRAPPED = 0.012
"""[m]; a link that is still so deep after a solve has no way out near by."""
YIELDING, YIELDING_SECONDS = 0.3, 0.5
"""Share of the clearances' weight then, and for how long before and after: more would tear at the motion."""
ON_A_WAY = 0.1
"""Share of a link's clearance while it is on a way out."""
ALONG_NORMAL = 0.05
"""Share of the contact's cost along its side: there the surfaces decide."""
HAND_POINTS, LINK_POINTS, SAMPLES = 24, 6, 14
HAND_SPREAD, LINK_SPREAD = 0.008, 0.03
"""[m] between points of one link."""


Clearance = SkinContact | ObjectOutsideLink


@dataclass(frozen=True, eq=False)
class Surfaces:
    """What contact between surfaces is made of: objects, the robot's skin, and the contacts' sides."""

    objects: tuple[MovingObject, ...]
    skin: Skin
    sides: Float[np.ndarray, "T C 3"]

    def window(self, start: int, stop: int) -> "Surfaces":
        """Return some consecutive frames of it."""
        objects = tuple(
            replace(thing, position=thing.position[:, start:stop], rotation=thing.rotation[:, :, start:stop])
            for thing in self.objects
        )
        return Surfaces(objects, self.skin, self.sides[start:stop])


def surface_terms(  # noqa: PLR0913, PLR0917 - what the terms are made of
    weights: Weights,
    targets: Targets,
    reference: Kinematics,
    start: Kinematics,
    surfaces: Surfaces,
    ways: tuple[WayOut, ...] = (),
    *,
    yielding: bool = False,
) -> tuple[Term, ...]:
    """Return the cost table with the contact's points free along their sides, and the terms between surfaces.

    Args:
        weights: Of the table.
        targets: With contact points at which the robot's skin touches.
        reference: The IK trajectory.
        start: The trajectory that the solve starts from, by which points are chosen.
        surfaces: Of the same frames.
        ways: Of links out of objects: these links' clearance hardly weighs, for it has other ideas of the way.
        yielding: Whether links that are trapped in an object at the start may stay there.
    """
    table = (
        _along_surface(term, targets, surfaces) if isinstance(term, ObjectContact) else term
        for term in trajectory_terms(weights, targets, reference)
    )
    clearances = tuple(_on_ways(term, ways) for term in _clearances(weights, targets, start, surfaces))
    if yielding:
        clearances = _yielding(clearances, start, frames_in(YIELDING_SECONDS, targets.fps))
    return (*table, *clearances, *ways, *self_clearance_terms(weights, targets, start))


def _on_ways(term: Clearance, ways: tuple[WayOut, ...]) -> Clearance:
    """Return a term that hardly weighs in the frames in which its link is on a way out."""
    of_link = [way.frames for way in ways if way.link == term.skin.link]
    if not of_link:
        return term
    on = np.isin(term.frames, np.concatenate(of_link))
    return replace(term, weights=np.where(on, ON_A_WAY, 1.0) * term.weights)


def _yielding(clearances: tuple[Clearance, ...], start: Kinematics, ramp: int) -> tuple[Clearance, ...]:
    """Return the terms with less weight around the frames in which any link is trapped at the start."""
    trapped = np.zeros(len(start.qpos), dtype=bool)
    for term in clearances:
        trapped[term.frames[term.depths(start) > TRAPPED]] = True
    share = 1.0 - (1.0 - YIELDING) * fade(trapped, ramp)
    return tuple(replace(term, weights=share[term.frames] * term.weights) for term in clearances)


def _along_surface(term: ObjectContact, targets: Targets, surfaces: Surfaces) -> ObjectContact:
    sides = surfaces.sides[:, targets.contact_links.index(term.site)].T
    across = (1.0 - np.sqrt(ALONG_NORMAL)) * np.einsum("it,jt->ijt", sides, sides)
    return replace(term, projection=np.eye(3)[:, :, None] - across)


def _clearances(weights: Weights, targets: Targets, start: Kinematics, surfaces: Surfaces) -> Iterator[Clearance]:
    links = {start.model.body_of(site): column for column, site in enumerate(targets.contact_links)}
    for index, thing in enumerate(surfaces.objects):
        for skin in surfaces.skin.links:
            column = links.get(skin.link)
            touch = None if column is None else _touch_weights(targets, column, index, weights.surface_touch)
            count, apart = (LINK_POINTS, LINK_SPREAD) if column is None else (HAND_POINTS, HAND_SPREAD)
            name = f"{skin.link}_{thing.name}"
            terms = (
                skin_contact(f"{name}_contact", skin, thing, start, weights.clearance, touch, count, apart),
                object_outside_link(f"{name}_inside", skin, thing, start, weights.clearance, SAMPLES, apart),
            )
            yield from (term for term in terms if term is not None)


def _touch_weights(targets: Targets, column: int, index: int, weight: float) -> Float[np.ndarray, "T"] | None:
    touching = targets.contact_flags[:, column] & (targets.contact_object[:, column] == index)
    ramp = frames_in(TOUCH_SECONDS, targets.fps)
    return weight * fade(touching, ramp) if touching.any() else None
