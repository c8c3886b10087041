"""The terms of contact between surfaces, on top of the cost table: touch, and nothing inside anything."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.numerics.arrays import runs
from hoi_retarget.numerics.filters import seconds_to_frames, smoothstep_around
from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.surfaces import skin_terms
from hoi_retarget.retargeting.surfaces.contact_targets import RESTING_SITES
from hoi_retarget.retargeting.surfaces.depenetration import MIN_DEPTH_M, EscapePath
from hoi_retarget.retargeting.surfaces.skin_points import LinkAtObject, MovingObject, levers, near_skin
from hoi_retarget.retargeting.targets import Targets, finger_links, finger_touch
from hoi_retarget.retargeting.trajopt.problem import Term
from hoi_retarget.retargeting.trajopt.terms.object_contact import ObjectContact
from hoi_retarget.retargeting.trajopt.terms.self_clearance import self_clearance_terms
from hoi_retarget.retargeting.trajopt.trajectory_terms import trajectory_terms
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.skin import LinkSkin, Skin, contact_skins, skins_from
from hoi_retarget.robots.spec import PALMS

TOUCH_SECONDS = 2 / 30  # Ramp of touch before and after a contact.
TRAPPED_DEPTH_M = 0.012  # [m]; a link that is still so deep after a solve finds no way out.
RELAXED_SHARE, RELAXED_SECONDS = 0.3, 0.5
"""Share of the clearances' weight around trapped links, and its ramp: more weight would tear at the motion."""
CLEARANCE_SHARE_ON_ESCAPE = 0.1  # Share of a link's clearance on an escape path.
ALONG_NORMAL = 0.05  # Share of the contact's cost along its side: there the surfaces decide.
RESTING_PLACE = 0.1
"""Share of the contact's cost of a part that rests: where it does depends on the length of the legs."""
PART_POINTS, AS_NEAR = 150, 0.005
"""Of a coarse skin; links of one part whose distances differ by less [m], on average, touch together."""
HAND_POINTS, LINK_POINTS, SAMPLES = 24, 6, 14
HAND_SPREAD, LINK_SPREAD = 0.008, 0.03  # [m] between points of one link.


Clearance = skin_terms.SkinContact | skin_terms.ObjectOutsideLink


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Objects, the robot's skin, and the side of each contact."""

    objects: tuple[MovingObject, ...]
    skin: Skin
    sides: Float[np.ndarray, "T C 3"]

    def window(self, start: int, stop: int) -> "Surfaces":
        """Return the surfaces in some consecutive frames."""
        objects = tuple(
            replace(item, position=item.position[:, start:stop], rotation=item.rotation[:, :, start:stop])
            for item in self.objects
        )
        return Surfaces(objects, self.skin, self.sides[start:stop])


def surface_terms(  # noqa: PLR0913, PLR0917  # the parts of the terms
    weights: Weights,
    targets: Targets,
    reference: Kinematics,
    start: Kinematics,
    surfaces: Surfaces,
    near: tuple[Clearance, ...],
    paths: tuple[EscapePath, ...] = (),
    *,
    relaxed: bool = False,
) -> tuple[Term, ...]:
    """Return the cost table with the contact's points free along their sides, and the terms between surfaces.

    Args: `weights`: of the table; `targets`: with contact points at which the robot's skin touches; `reference`: the IK
    trajectory; `start`: the trajectory that the solve starts from, by which points are chosen; `surfaces`: of the same
    frames; `near`: `clearances` at the start; `paths`: of links out of objects; the clearance of these links hardly
    weighs, as its nearest way may differ; `relaxed`: whether links trapped in an object at the start may stay there,
    and links that are out by then have their clearance in full.
    """
    table = (
        _along_surface(term, targets, surfaces) if isinstance(term, ObjectContact) and term.site not in PALMS else term
        for term in trajectory_terms(weights, targets, reference)
    )
    kept_apart = tuple(_relaxed_on_escapes(term, paths, start if relaxed else None) for term in near)
    if relaxed:
        kept_apart = _relaxed_around_trapped_links(kept_apart, start, seconds_to_frames(RELAXED_SECONDS, targets.fps))
    return (*table, *kept_apart, *paths, *self_clearance_terms(weights, start))


def clearances(weights: Weights, targets: Targets, start: Kinematics, surfaces: Surfaces) -> tuple[Clearance, ...]:
    """Return the terms of links and objects that are near each other along a trajectory."""
    return tuple(_clearances(weights, targets, start, surfaces))


def free_depth(near: tuple[Clearance, ...], kinematics: Kinematics) -> float:
    """Return the largest depth of links and objects in each other [m], where they are not trapped."""
    depths = (term.depths(kinematics) for term in near)
    return max((float(found[found < TRAPPED_DEPTH_M].max(initial=0.0)) for found in depths), default=0.0)


def _relaxed_on_escapes(term: Clearance, paths: tuple[EscapePath, ...], left: Kinematics | None) -> Clearance:
    """Return a term that hardly weighs on its link's escape paths; where links have left, only while still deep."""
    of_link = [path.frames for path in paths if path.link == term.skin.link]
    if not of_link:
        return term
    on = np.isin(term.frames, np.concatenate(of_link))
    on &= True if left is None else term.depths(left) > MIN_DEPTH_M
    return replace(term, weights=np.where(on, CLEARANCE_SHARE_ON_ESCAPE, 1.0) * term.weights)


def _relaxed_around_trapped_links(
    clearances: tuple[Clearance, ...], start: Kinematics, ramp: int
) -> tuple[Clearance, ...]:
    """Return the terms with less weight around the frames in which any link is trapped at the start."""
    trapped = np.zeros(len(start.qpos), dtype=bool)
    for term in clearances:
        trapped[term.frames[term.depths(start) > TRAPPED_DEPTH_M]] = True
    share = 1.0 - (1.0 - RELAXED_SHARE) * smoothstep_around(trapped, ramp)
    return tuple(replace(term, weights=share[term.frames] * term.weights) for term in clearances)


def _along_surface(term: ObjectContact, targets: Targets, surfaces: Surfaces) -> ObjectContact:
    sides = surfaces.sides[:, targets.contact_links.index(term.site)].T
    across = (1.0 - np.sqrt(ALONG_NORMAL)) * np.einsum("it,jt->ijt", sides, sides)
    share = RESTING_PLACE if term.site in RESTING_SITES else 1.0
    return replace(term, projection=np.eye(3)[:, :, None] - across, weight=share * term.weight)


def _clearances(weights: Weights, targets: Targets, start: Kinematics, surfaces: Surfaces) -> Iterator[Clearance]:
    links = {
        skin.link: (column, skins)
        for column, site in enumerate(targets.contact_links)
        for skins in (touching_skins(targets, start.model, site),)
        for skin in skins
    }
    hands = {skin.link for palm in PALMS if start.model.spec.fingers for skin in skins_from(start.model, palm)}
    for index, moving_object in enumerate(surfaces.objects):
        for skin in surfaces.skin.links:
            column, skins = links.get(skin.link, (None, ()))
            touch = None if column is None else _touch_weights(targets, column, index, weights.surface_touch)
            if touch is not None and len(skins) > 1:
                touch = touch * _nearest_of(skins, skin, moving_object, start, touch > 0.0)
            count, apart = (HAND_POINTS, HAND_SPREAD) if skin.link in {*links, *hands} else (LINK_POINTS, LINK_SPREAD)
            name, link = f"{skin.link}_{moving_object.name}", LinkAtObject(skin, moving_object, start)
            near = near_skin(link, count, apart)
            terms = (
                skin_terms.skin_contact(f"{name}_contact", link, near, weights.clearance, touch),
                skin_terms.object_outside_link(f"{name}_inside", link, near, weights.clearance, SAMPLES, apart),
            )
            yield from (term for term in terms if term is not None)


def touching_skins(targets: Targets, model: RobotModel, site: str) -> tuple[LinkSkin, ...]:
    """Return the skins that a contact brings to an object: of a hand's all links where fingers have no contacts."""
    whole = site in PALMS and model.spec.fingers and not any(finger_links(targets, site))
    return skins_from(model, site) if whole else contact_skins(model, site)


def _nearest_of(
    skins: tuple[LinkSkin, ...],
    own: LinkSkin,
    moving_object: MovingObject,
    start: Kinematics,
    touching: Bool[np.ndarray, "T"],
) -> Bool[np.ndarray, "T"]:
    """Return where a link is the nearest of several that stand for one part, or as near, over each run of contact."""
    found = np.zeros(len(touching), dtype=bool)
    for first, stop in runs(touching):
        frames = np.arange(first, stop)
        least = {}
        for skin in skins:
            lever = levers(
                start, skin.frame, skin.points[:PART_POINTS].T[:, :, None].repeat(len(frames), axis=2), frames
            )
            inside = moving_object.inside(start.point(skin.frame)[:, None, frames] + lever, frames)
            least[skin.link] = moving_object.distances(inside).min(axis=0)
        nearest = np.min(list(least.values()), axis=0)
        found[first:stop] = (least[own.link] - nearest).mean() < AS_NEAR
    return found


def _touch_weights(targets: Targets, column: int, index: int, weight: float) -> Float[np.ndarray, "T"] | None:
    touching = targets.contact_flags[:, column] & (targets.contact_object[:, column] == index)
    if targets.contact_links[column] in PALMS:
        touching &= ~finger_touch(targets, column)  # Fingers touch, the palm may not.
    ramp = seconds_to_frames(TOUCH_SECONDS, targets.fps)
    return weight * smoothstep_around(touching, ramp) if touching.any() else None
