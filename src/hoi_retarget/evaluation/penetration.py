"""Penetration figures: links in objects, in other links and in the floor; links inside an object, one by one."""

from functools import lru_cache
from itertools import combinations

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.evaluation.comparison import Comparison, figure, max_or_none, mean_or_none, percentile_or_none
from hoi_retarget.evaluation.contact_figures import surface_curves
from hoi_retarget.evaluation.surface_distances import part_skins
from hoi_retarget.motion.motion_report import Event
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.robots.link_depths import pair_depths, posed_links
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.skin import link_heights, skin_of

_MAX_NEAR_JOINTS, _MAX_NEAR_JOINTS_ALONG_LIMB = 2, 3
"""Links with so many joints between them, or fewer, are no pair: they meet at their joints. The second number is for a
link that carries the other."""
_MAX_HOME_DEPTH = 1e-3  # Links that are deeper than this in each other [m] in the home pose are built so.
MAX_DEPTH_M, _MIN_FRAMES = 5e-3, 3
"""A link is sunk where it is deeper than this [m] for so many frames: skins and meshes are known to a millimetre, and
palms of rubber give way by as much."""
_MAX_HUMAN_DEPTH_M = 2e-3  # A human part that is deeper inside the object [m] asks the robot's to be there.


@figure("penetration", "mm", slow=True)
def penetration_mean_m(view: Comparison) -> float | None:
    """Mean depth of the deepest point of the robot in objects, while it touches [m]."""
    depths = _penetration(view)
    never = np.zeros(view.clip.frames - view.first, dtype=bool)
    touching = np.logical_or.reduce([never, *(track.active for track in view.contacts)])
    return mean_or_none(depths[touching]) if depths.size else None


@figure("penetration p95", "mm", slow=True)
def penetration_p95_m(view: Comparison) -> float | None:
    """That depth, exceeded in 5 % of all frames [m]."""
    return percentile_or_none(_penetration(view))


@figure("penetration max", "mm", slow=True)
def penetration_max_m(view: Comparison) -> float | None:
    """That depth at its largest [m]."""
    return max_or_none(_penetration(view))


@figure("self-penetration", "mm")
def self_penetration_max_m(view: Comparison) -> float | None:
    """Largest depth of one part of the robot in another [m]."""
    depths, _, _ = self_depths(view.kinematics, view.first)
    return max_or_none(depths) if skin_of(view.kinematics.model).links else None


@figure("in another robot", "mm")
def robot_penetration_max_m(view: Comparison) -> float | None:
    """Largest depth of the robot in another one [m]."""
    return view.motion.report.figures.get("robot_penetration_max_m")


@figure("link below floor", "mm", needs_floor=True)
def link_below_floor_m(view: Comparison) -> float | None:
    """Depth of the deepest part below the floor [m]."""
    return max_or_none(np.maximum(-link_heights(view.kinematics, view.first), 0.0))


def _penetration(view: Comparison) -> Float[np.ndarray, "F"]:
    """Return the depth of the deepest point in every counted frame, both ways [m]; empty without objects or skins."""
    curves = view.cached(surface_curves)
    return curves.penetration if curves.depth.size else np.zeros(0)


def self_depths(
    kinematics: Kinematics, first: int = 0
) -> tuple[Float[np.ndarray, "F"], Int[np.ndarray, "F"], tuple[tuple[str, str], ...]]:
    """Return the largest depth [m] of links in each other from one frame on, which pair has it, and the pairs."""
    links = posed_links(kinematics, first)
    depths, near = pair_depths(links, links, self_collision_pairs(kinematics.model))
    if not len(depths):
        return np.zeros(len(kinematics.qpos) - first), np.zeros(len(kinematics.qpos) - first, dtype=int), ()
    worst = depths.argmax(axis=0)
    return depths.max(axis=0), worst, tuple((one.link, other.link) for one, other in near)


@lru_cache(maxsize=8)
def self_collision_pairs(model: RobotModel) -> tuple[tuple[int, int], ...]:
    """Return the pairs of links that can be in each other, as indices into the skin's links."""
    skin = skin_of(model)
    nodes = [link.frame.node for link in skin.links]
    pairs = [
        (one, other)
        for one, other in combinations(range(len(nodes)), 2)
        if _far_apart(model.supports, nodes[one], nodes[other])
    ]
    home = posed_links(model.forward(model.home_qpos[None]))
    depths, _ = pair_depths(home, home, pairs, keep_all=True)
    return tuple(
        pair for pair, depth in zip(pairs, depths.max(axis=1, initial=0.0), strict=True) if depth <= _MAX_HOME_DEPTH
    )


def _far_apart(supports: Float[np.ndarray, "N N"], one: int, other: int) -> bool:
    shared = supports[:, one] * supports[:, other]
    joints = supports[:, one].sum() + supports[:, other].sum() - 2 * shared.sum()
    along = bool(supports[one, other] or supports[other, one])
    return bool(joints > (_MAX_NEAR_JOINTS_ALONG_LIMB if along else _MAX_NEAR_JOINTS))


def sunk_links(view: Comparison) -> tuple[Event, ...]:
    """Return the stretches of frames of the motion in which a link is sunk in an object.

    Raises `GeometryError` when an object's mesh cannot be read.
    """
    curves = view.cached(surface_curves)
    found = []
    for index, name in enumerate(view.motion.object_names):
        for link, depth in zip(curves.links, curves.depth[index], strict=True):
            for first, stop in sunk_runs(depth):
                inside, largest = _human_depth(view, index, link, first, stop), float(depth[first:stop].max())
                reason = "no pose near by keeps the contacts and is free of it"
                if inside > _MAX_HUMAN_DEPTH_M:
                    reason = f"the human's own part is up to {1e3 * inside:.0f} mm inside it there"
                frames = view.first + first, view.first + stop - 1
                found.append(Event("sunk_link", *frames, largest, subject=link, object=name, reason=reason))
    return tuple(found)


def sunk_runs(depth: Float[np.ndarray, "F"]) -> tuple[tuple[int, int], ...]:
    """Return the runs of frames that are sunk by their depth [m], as (first, one past the last)."""
    return runs(depth > MAX_DEPTH_M, _MIN_FRAMES)


def _human_depth(view: Comparison, index: int, link: str, first: int, stop: int) -> float:
    """Return the depth in the object of the contact points of the part that a link stands for [m]."""
    model = view.kinematics.model
    points = [
        track.contact_points[first:stop][track.active[first:stop]]
        for track in view.contacts
        if track.object == index and link in {skin.link for skin in part_skins(model, track.part)}
    ]
    pooled = np.concatenate([np.zeros((0, 3)), *points])
    if not len(pooled):
        return 0.0
    scale = float(view.motion.object_scale[index])
    return scale * max(0.0, -float(surface_of(view.clip.objects[index].geometry).signed_distances(pooled).min()))
