"""The outer skin of a robot's links, points with normals and the enclosed solids, its files, and links that may meet.

A robot of this package has its skin in a file, made by `tools/make_skins.py` from the manufacturer's meshes; the skin
of any other robot is that of its colliding geometries. Files hold whole numbers of small steps.
"""

import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations
from pathlib import Path

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float, Int

from hoi_retarget.errors import RobotError
from hoi_retarget.files import npz
from hoi_retarget.kernels.shape import DistanceGrid
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.robots.collision_skin import collision_skins
from hoi_retarget.robots.frames import Frame
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.outer_skin import OuterSkin
from hoi_retarget.robots.spec import SIDES
from hoi_retarget.robots.user_robots import store_skin

_POINT_STEP = 2e-5  # [m]
_NORMAL_STEP = 1.0 / 127.0
_DISTANCE_STEP = 1e-4  # [m]
_MIRROR = np.array([1.0, -1.0, 1.0])
_CELL_NEIGHBOURS, _CELL_SAMPLES = 16, 256
"""Of a point's cell on the skin: neighbours that can bound it, and places of which it is made."""
_SAME_SIDE = -0.1
"""Cosine between normals from which on two points share the skin: both sides of an edge do, those of a plate do not."""
_PALMAR_DEG = 75.0  # Skin that faces so near to the palm's direction is palmar, fingers' and thumb's too [degrees].
_MAX_OVERLAP_JOINTS, _MAX_OVERLAP_JOINTS_ON_LIMB = 2, 3
"""Links with so many joints between them overlap by design; on one limb the joints are short."""


def mirrored_skin(skin: OuterSkin) -> OuterSkin:
    """Return the skin of the link on the other side: y turned around."""
    solid = skin.solid
    _, width, _ = solid.values.shape
    last = solid.origin[1] + (width - 1) * solid.step
    origin = np.array([solid.origin[0], -last, solid.origin[2]])
    return OuterSkin(
        skin.points * _MIRROR, skin.normals * _MIRROR, DistanceGrid(origin, solid.step, solid.values[:, ::-1])
    )


def write_skins(path: Path | io.BytesIO, skins: Mapping[str, OuterSkin], mirrored: Mapping[str, str]) -> None:
    """Write skins by link, and the pairs of a link and the link with the mirrored skin."""
    own = list(skins.values())
    grids = [skin.solid for skin in own]
    np.savez_compressed(
        path,
        links=np.array(list(skins)),
        mirrored=np.array(list(mirrored.items())).reshape(-1, 2),
        counts=np.array([len(skin.points) for skin in own], np.int32),
        points=np.concatenate([_whole(skin.points, _POINT_STEP, np.int32) for skin in own]),
        normals=np.concatenate([_whole(skin.normals, _NORMAL_STEP, np.int8) for skin in own]),
        origins=np.array([grid.origin for grid in grids]),
        steps=np.array([grid.step for grid in grids]),
        shapes=np.array([grid.values.shape for grid in grids], np.int32),
        # Neighbours differ little, so their differences pack well.
        values=np.concatenate(
            [
                np.diff(_whole(grid.values, _DISTANCE_STEP, np.int16), axis=2, prepend=np.int16(0)).ravel()
                for grid in grids
            ]
        ),
    )


def read_skins(path: Path) -> dict[str, OuterSkin]:
    """Return the skins in a file by link; raises `RobotError` when it is missing or damaged."""
    try:
        arrays = {name: npz.array(name, entry, "fiU") for name, entry in npz.members(path.read_bytes()).items()}
        counts, shapes = arrays["counts"], arrays["shapes"]
        points = np.split(arrays["points"] * _POINT_STEP, np.cumsum(counts)[:-1])
        normals = np.split(arrays["normals"].astype(float), np.cumsum(counts)[:-1])
        values = np.split(arrays["values"], np.cumsum(shapes.prod(axis=1))[:-1])
        skins = {
            str(link): OuterSkin(
                places,
                along / np.linalg.norm(along, axis=1, keepdims=True),
                DistanceGrid(
                    origin,
                    float(step),
                    (np.cumsum(steps.reshape(shape), axis=2, dtype=np.int32) * _DISTANCE_STEP).astype(np.float32),
                ),
            )
            for link, places, along, origin, step, shape, steps in zip(
                arrays["links"], points, normals, arrays["origins"], arrays["steps"], shapes, values, strict=True
            )
        }
        return {**skins, **{str(link): mirrored_skin(skins[str(other)]) for link, other in arrays["mirrored"]}}
    except (OSError, ValueError, KeyError) as error:
        raise RobotError(f"{path}: no skin can be read from it ({error}). Make it with tools/make_skins.py.") from error


def _whole(values: np.ndarray, unit: float, dtype: type[np.integer]) -> np.ndarray:
    numbers = np.rint(values / unit)
    if np.abs(numbers).max() > np.iinfo(dtype).max:
        raise ValueError(f"numbers up to {np.abs(values).max():g} do not fit into steps of {unit:g}")
    return numbers.astype(dtype)


def extreme_points(points: Float[np.ndarray, "P 3"]) -> Float[np.ndarray, "H 3"]:
    """Return the corners of the hull of points; all of them where they are few, or in one plane."""
    try:
        return points[scipy.spatial.ConvexHull(points).vertices]
    except (scipy.spatial.QhullError, ValueError):
        return points


@dataclass(frozen=True, eq=False)
class LinkSkin:
    """Skin of one link, in the frame of its body."""

    link: str  # Body.
    frame: Frame
    points: Float[np.ndarray, "P 3"]  # In farthest-point order: the first n are a coarser skin [m].
    normals: Float[np.ndarray, "P 3"]  # Outward, of unit length.
    solid: DistanceGrid

    @cached_property
    def centre(self) -> Float[np.ndarray, "3"]:
        """Centre of a ball around the whole link [m]."""
        return 0.5 * (self.points.min(axis=0) + self.points.max(axis=0))

    @cached_property
    def middle(self) -> Frame:
        """A frame at that centre."""
        return self.frame.of(self.centre, np.eye(3))

    @cached_property
    def radius(self) -> float:
        """Radius of that ball [m]."""
        return float(np.linalg.norm(self.points - self.centre, axis=1).max())

    @cached_property
    def areas(self) -> Float[np.ndarray, "P"]:
        """Area of the skin that is nearer to each point than to any other [m^2].

        In the tangent plane, a cell is the part of a disc that no neighbour is nearer to, a neighbour being as far as
        it is in space. The disc's radius is the smallest distance of two points, from which no place of the skin is
        farther than that (`farthest_points`).
        """
        count = min(_CELL_NEIGHBOURS + 1, len(self.points))
        if count < 2:
            return np.zeros(len(self.points))
        lengths, near = (found[:, 1:] for found in scipy.spatial.KDTree(self.points).query(self.points, k=count))
        radius = lengths[:, 0].min()
        along = np.eye(3)[np.abs(self.normals).argmin(axis=1)]
        first = np.cross(self.normals, along)
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        plane = np.stack([first, np.cross(self.normals, first)], axis=1)
        ways = np.einsum("pai,pki->pka", plane, self.points[near] - self.points[:, None])
        ways *= (lengths / np.maximum(np.linalg.norm(ways, axis=2), 1e-9))[:, :, None]
        number = np.arange(_CELL_SAMPLES) + 0.5
        angle = number * np.pi * (3.0 - np.sqrt(5.0))  # Evenly over the disc, as seeds of a sunflower.
        disc = radius * np.sqrt(number / _CELL_SAMPLES) * np.array([np.cos(angle), np.sin(angle)])
        taken = 2.0 * ways @ disc > lengths[:, :, None] ** 2
        taken &= (np.einsum("pki,pi->pk", self.normals[near], self.normals) > _SAME_SIDE)[:, :, None]
        return np.pi * radius**2 * (1.0 - taken.any(axis=1).mean(axis=1))

    @cached_property
    def extreme_points(self) -> Float[np.ndarray, "H 3"]:
        """Points of which one is the farthest in any direction [m]."""
        return extreme_points(self.points)


@dataclass(frozen=True, eq=False)
class Skin:
    """Skins of all links of a robot that have a surface."""

    links: tuple[LinkSkin, ...]

    @cached_property
    def by_link(self) -> dict[str, LinkSkin]:
        """Skins by body."""
        return {skin.link: skin for skin in self.links}


@lru_cache(maxsize=32)
def pose_at_home(model: RobotModel, site: str, frame: Frame) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Return the rotation and the place [m] of a frame in a site's, in the home pose."""
    home = model.forward(model.home_qpos[None])
    turn = home.site_rotation(site)[0].T
    return turn @ home.orientation(frame)[:, :, 0], turn @ (home.point(frame)[:, 0] - home.site_position(site)[0])


def skins_from(model: RobotModel, site: str) -> tuple[LinkSkin, ...]:
    """Return the skins of a site's link and of the links that it carries, such as a hand's; raises as `skin_of`.

    Of the trunk and the limbs they are those up to the next joint: the pelvis with the links of the hips, then a thigh;
    a forearm.
    """
    if site in _LIMB_ENDS:
        return tuple(link for link in skin_of(model).links if _stands_for(model, link.frame.node, site))
    node = model.sites.frames[site].node
    return tuple(link for link in skin_of(model).links if model.supports[node, link.frame.node])


_LIMB_ENDS = {"pelvis": ("left_hip", "right_hip")} | {
    f"{side}_{first}": (f"{side}_{second}",)
    for side in SIDES
    for first, second in (("hip", "knee"), ("elbow", "wrist"))
}


def _stands_for(model: RobotModel, node: int, site: str) -> bool:
    """Return whether a link is between a site of the trunk or a limb and the next ones."""
    begin, nodes = model.sites.frames[site].node, [model.sites.frames[end].node for end in _LIMB_ENDS[site]]
    between = bool(model.supports[begin, node] and any(model.supports[node, end] for end in nodes))
    return between and (site == "pelvis" or node not in nodes) and (not site.endswith("hip") or node != begin)


def contact_skins(model: RobotModel, site: str) -> tuple[LinkSkin, ...]:
    """Return the skins that a contact of a site brings to an object: of its link alone, or as `skins_from` of a body's.

    Raises as `skin_of`.
    """
    if site in _LIMB_ENDS:
        return skins_from(model, site)
    own = skin_of(model).by_link.get(model.body_of(site))
    return () if own is None else (own,)


@lru_cache(maxsize=64)
def palmar_points(model: RobotModel, site: str, skin: LinkSkin) -> Int[np.ndarray, "K"]:
    """Return which points of a skin are on the palmar side of a hand, as in the home pose.

    The palm faces along -y of a left hand's palm site, along +y of a right one's: x is along the fingers.
    """
    home = model.forward(model.home_qpos[None])
    palm = home.site_rotation(site)[0][:, 1] * (-1.0 if site.startswith("left") else 1.0)
    facing = skin.normals @ (home.orientation(skin.frame)[:, :, 0].T @ palm)
    return np.flatnonzero(facing > np.cos(np.radians(_PALMAR_DEG)))


@lru_cache(maxsize=8)
def skin_of(model: RobotModel) -> Skin:
    """Return a robot's skin, computed once per model.

    Raises `RobotError` when the specification's skin file is missing or damaged, or names links that the robot has not.
    """
    file = model.spec.skin
    skins = read_skins(file) if file is not None else make_skin(model)
    frames = model.body_frames.frames
    if unknown := sorted(set(skins) - set(frames)):
        raise RobotError(f"{file}: skins of links that {model.spec.name} has not: {', '.join(unknown)}.")
    return Skin(
        tuple(
            LinkSkin(link, frames[link], frozen(skin.points), frozen(skin.normals), skin.solid)
            for link, skin in skins.items()
        )
    )


def make_skin(model: RobotModel, progress: Callable[[float], None] | None = None) -> Mapping[str, OuterSkin]:
    """Compute the skin of a robot without one by link, and store it beside an added robot.

    `progress` is called with the share that is done.
    """
    skins = collision_skins(model, progress)
    if skins:
        content = io.BytesIO()
        write_skins(content, skins, {})
        store_skin(model.spec, content.getvalue())
    return skins


@lru_cache(maxsize=8)
def separable_pairs(model: RobotModel, links: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    """Return the pairs of some links that must stay apart: a link of a limb with any other."""
    arms, legs = _limbs(model, "palm"), _limbs(model, "foot")
    frames = model.body_frames.frames
    node = {link: frames[link].node for link in links}
    limb = {link: next((k for k, nodes in enumerate((*arms, *legs)) if node[link] in nodes), None) for link in links}

    def apart(first: str, second: str) -> bool:
        ways = model.supports[1:, [node[first], node[second]]]
        one_limb = limb[first] is not None and limb[first] == limb[second]
        joints = np.abs(ways[:, 0] - ways[:, 1]).sum()
        return bool(joints > (_MAX_OVERLAP_JOINTS_ON_LIMB if one_limb else _MAX_OVERLAP_JOINTS))

    def meet(first: str, second: str) -> bool:
        return limb[first] is not None or limb[second] is not None

    return tuple(pair for pair in combinations(links, 2) if meet(*pair) and apart(*pair))


def _limbs(model: RobotModel, end: str) -> list[set[int]]:
    """Return, for each side, the nodes on the way to the end of its limb that are not on the other side's."""
    ends = (model.sites.frames[f"{side}_{end}"].node for side in SIDES)
    ways = [set(np.flatnonzero(model.supports[:, node]).tolist()) for node in ends]
    return [way - ways[1 - k] for k, way in enumerate(ways)]


def link_heights(kinematics: Kinematics, first: int = 0) -> Float[np.ndarray, "L F"]:
    """Return the height of the lowest skin point of each link of the skin [m], from one frame on."""
    skins = skin_of(kinematics.model).links
    found = [
        np.reshape([lowest_skin(part, skin)[2] for skin in skins], (len(skins), len(part.qpos)))
        for part in kinematics.parts(first)
    ]
    return np.concatenate([np.zeros((len(skins), 0)), *found], axis=1)


def lowest_skin(kinematics: Kinematics, skin: LinkSkin) -> Float[np.ndarray, "3 T"]:
    """Return the lowest skin point of a link in every frame, in the world [m]."""
    rotation = kinematics.orientation(skin.frame)
    lowest = (skin.extreme_points @ rotation[2]).argmin(axis=0)
    return kinematics.point(skin.frame) + np.einsum("ijt,tj->it", rotation, skin.extreme_points[lowest])
