"""Skins of a robot's colliding geometries, for robots without a file of skins.

Primitives have exact distances. Meshed and passed through `outer_skin` instead, the skin of the G1's primitives takes
70 times as long, and the solid is up to 11 mm off in place of 2 mm.
"""

from collections.abc import Callable
from functools import partial

import mujoco
import numpy as np
from jaxtyping import Float

from hoi_retarget.kernels.shape import DistanceGrid
from hoi_retarget.numerics import se3
from hoi_retarget.robots import outer_skin
from hoi_retarget.robots.mjcf import compile_mjcf, mesh_of
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.spec import SIDES

Distances = Callable[[np.ndarray], np.ndarray]
Shape = tuple[Distances, np.ndarray]  # Distances in a body's frame and the corners of a box around, all [m].
_CANDIDATE_SPACING = 0.6  # Of candidates for points, as a share of the points' spacing.
_COARSER_BALLS = {"palm": 1.25, "forearm": 2.0, "other": 1.5}
"""Than those of the resolution: hollows up to 9 mm wide count as solid, up to 3 mm in hands, in half of the time."""
_MAX_NODES = 250_000  # Of the grid of one link's solid: larger links have coarser skins.
_COARSER = 4
_PROJECTIONS = 3
_DIFFERENCE = 1e-5  # [m]


def collision_skins(
    model: RobotModel, progress: Callable[[float], None] | None = None
) -> dict[str, outer_skin.OuterSkin]:
    """Return the skin of every link with a colliding geometry; bodies without a joint are part of a link.

    `progress` is called with the share that is done.
    """
    if not model.geometries.bodies:
        return {}
    compiled = compile_mjcf(model.spec.mjcf, model.spec.sites)
    colliding: dict[str, list[int]] = {}
    for geom in np.flatnonzero((compiled.geom_contype != 0) | (compiled.geom_conaffinity != 0)).tolist():
        link = int(compiled.body_weldid[compiled.geom_bodyid[geom]])
        colliding.setdefault(compiled.body(link).name, []).append(geom)
    skins: dict[str, outer_skin.OuterSkin] = {}
    palms = {model.body_of(f"{side}_palm") for side in SIDES}
    for number, (body, geoms) in enumerate(colliding.items()):
        if progress is not None:
            progress(number / len(colliding))
        if body in model.body_frames.index:
            resolution = outer_skin.resolution_of(model, body)
            kind = "palm" if body in palms else "forearm" if resolution == outer_skin.HAND else "other"
            balls = _COARSER_BALLS[kind]
            size = np.ptp(np.concatenate([_box_of(compiled, geom) for geom in geoms]), axis=0)
            much = max(1.0, float(size.prod() / _MAX_NODES) ** (1.0 / 3.0) / resolution.grid)
            resolution = outer_skin.SkinResolution(
                *(much * balls * length for length in (resolution.nodes, resolution.ball)),
                *(much * length for length in (resolution.spacing, resolution.grid)),
            )
            if shapes := _shapes(compiled, geoms, resolution):
                skins[body] = _skin(shapes, resolution)
    return skins


def _box_of(compiled: mujoco.MjModel, geom: int) -> np.ndarray:
    turn, place = _pose(compiled, geom)
    centre, half = np.split(compiled.geom_aabb[geom], 2)
    signs = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), axis=-1).reshape(-1, 3)
    return (centre + signs * half) @ turn.T + place


def _shapes(compiled: mujoco.MjModel, geoms: list[int], resolution: outer_skin.SkinResolution) -> list[Shape]:
    """Return the solids of a link's geometries; its meshes are one solid: a single one may not be closed."""
    kinds = {geom: mujoco.mjtGeom(compiled.geom_type[geom]) for geom in geoms}
    meshes = [geom for geom, kind in kinds.items() if kind == mujoco.mjtGeom.mjGEOM_MESH]
    shapes = [_mesh_shape(compiled, meshes, resolution)] if meshes else []
    return shapes + [_primitive_shape(compiled, geom, kind) for geom, kind in kinds.items() if kind in _DISTANCES]


def _skin(shapes: list[Shape], resolution: outer_skin.SkinResolution) -> outer_skin.OuterSkin:
    """Return the skin of solids that overlap, each with its distances and the corners of its box."""

    def distances(points: np.ndarray) -> np.ndarray:
        return np.min([of(points) for of, _ in shapes], axis=0)

    corners = np.concatenate([box for _, box in shapes])
    near = _CANDIDATE_SPACING * resolution.spacing
    points = _nodes_near(distances, corners, near)
    for _ in range(_PROJECTIONS):
        points = points - distances(points)[:, None] * _gradients(distances, points)
    points = points[np.abs(distances(points)) < 1e-2 * near]
    _, first = np.unique(np.floor(points / near).astype(np.int64), axis=0, return_index=True)
    points = points[first]
    points = points[outer_skin.farthest_points(points, resolution.spacing)]
    origin, shape = outer_skin.grid_around(corners, resolution.grid, 2 * resolution.grid)
    values = distances(outer_skin.grid_nodes(origin, resolution.grid, shape)).reshape(shape).astype(np.float32)
    return outer_skin.OuterSkin(points, _gradients(distances, points), DistanceGrid(origin, resolution.grid, values))


def _nodes_near(distances: Distances, corners: np.ndarray, step: float) -> Float[np.ndarray, "K 3"]:
    """Return the nodes of a grid that are at most a step from the surface, found from a coarser grid."""
    origin, shape = outer_skin.grid_around(corners, _COARSER * step, _COARSER * step)
    nodes = outer_skin.grid_nodes(origin, _COARSER * step, shape)
    nodes = nodes[np.abs(distances(nodes)) <= (0.5 * np.sqrt(3.0) * _COARSER + 1.0) * step]
    around = step * (outer_skin.grid_nodes(np.zeros(3), 1.0, (_COARSER, _COARSER, _COARSER)) - 0.5 * (_COARSER - 1))
    nodes = (nodes[:, None] + around).reshape(-1, 3)
    return nodes[np.abs(distances(nodes)) <= step]


def _gradients(distances: Distances, points: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K 3"]:
    rises = [distances(points + _DIFFERENCE * axis) - distances(points - _DIFFERENCE * axis) for axis in np.eye(3)]
    gradients = np.transpose(rises)
    return gradients / np.maximum(np.linalg.norm(gradients, axis=1, keepdims=True), 1e-12)


def _mesh_shape(compiled: mujoco.MjModel, geoms: list[int], resolution: outer_skin.SkinResolution) -> Shape:
    """Return the solid of meshes, computed in the frame of the first."""
    turn, place = _pose(compiled, geoms[0])
    vertices, faces, count = [], [], 0
    for geom in geoms:
        own, own_faces = mesh_of(compiled, geom)
        if geom != geoms[0]:
            own_turn, own_place = _pose(compiled, geom)
            own = (own @ own_turn.T + own_place - place) @ turn
        vertices.append(own)
        faces.append(own_faces + count)
        count += len(own)
    corners = np.concatenate(vertices)
    distances = outer_skin.outer_solid(corners, np.concatenate(faces), resolution).distances
    return _placed(distances, corners.min(axis=0), corners.max(axis=0), turn, place)


def _primitive_shape(compiled: mujoco.MjModel, geom: int, kind: mujoco.mjtGeom) -> Shape:
    size = compiled.geom_size[geom]
    reach = {
        mujoco.mjtGeom.mjGEOM_SPHERE: size[[0, 0, 0]],
        mujoco.mjtGeom.mjGEOM_CAPSULE: np.array([size[0], size[0], size[0] + size[1]]),
        mujoco.mjtGeom.mjGEOM_CYLINDER: size[[0, 0, 1]],
    }.get(kind, size)
    return _placed(partial(_DISTANCES[kind], size), -reach, reach, *_pose(compiled, geom))


def _pose(compiled: mujoco.MjModel, geom: int) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Return a geometry's rotation and place in its link [m], such as a finger's in the hand."""
    turn, place = se3.quat_to_matrix(compiled.geom_quat[geom]), compiled.geom_pos[geom].copy()
    body = int(compiled.geom_bodyid[geom])
    while body != compiled.body_weldid[body]:
        above = se3.quat_to_matrix(compiled.body_quat[body])
        turn, place = above @ turn, above @ place + compiled.body_pos[body]
        body = int(compiled.body_parentid[body])
    return turn, place


def _placed(distances: Distances, low: np.ndarray, high: np.ndarray, turn: np.ndarray, place: np.ndarray) -> Shape:
    box = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
    return (lambda points: distances((points - place) @ turn)), box @ turn.T + place


def _sphere(size: np.ndarray, points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points, axis=1) - size[0]


def _capsule(size: np.ndarray, points: np.ndarray) -> np.ndarray:
    along = np.clip(points[:, 2], -size[1], size[1])
    return np.linalg.norm(points - along[:, None] * [0.0, 0.0, 1.0], axis=1) - size[0]


def _cylinder(size: np.ndarray, points: np.ndarray) -> np.ndarray:
    return _box(size[:2], np.stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]], axis=1))


def _box(half: np.ndarray, points: np.ndarray) -> np.ndarray:
    beyond = np.abs(points) - half
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)


def _ellipsoid(size: np.ndarray, points: np.ndarray) -> np.ndarray:
    # To first order in the distance, which is enough near the surface.
    level = np.linalg.norm(points / size, axis=1)
    slope = np.linalg.norm(points / size**2, axis=1)
    return np.where(slope > 0.0, level * (level - 1.0) / np.maximum(slope, 1e-12), -size.min())


_DISTANCES: dict[mujoco.mjtGeom, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    mujoco.mjtGeom.mjGEOM_SPHERE: _sphere,
    mujoco.mjtGeom.mjGEOM_CAPSULE: _capsule,
    mujoco.mjtGeom.mjGEOM_CYLINDER: _cylinder,
    mujoco.mjtGeom.mjGEOM_BOX: _box,
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: _ellipsoid,
}
