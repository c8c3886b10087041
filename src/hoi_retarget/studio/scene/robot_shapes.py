"""Robots as vendor meshes or as the primitives of their MJCF, and objects as meshes, over all frames at once.

The package ships no vendor meshes: they are fetched, of a folder of the user's, or of MuJoCo Menagerie, and are drawn
in the place of the primitives. Every geometry is fixed to a node of the kinematic tree.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.errors import ReadError, RobotError
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.robots.fetched_meshes import fetched_meshes
from hoi_retarget.robots.frames import Geometries, geometries_of, tree_of
from hoi_retarget.robots.mjcf import compile_mjcf, read_mjcf
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.spec import RobotSpec
from hoi_retarget.studio.scene.drawing import Colour, Kind, Lines, Part, Shapes, Solid
from hoi_retarget.studio.scene.marks import axes

MAX_FACES = 20_000
COLOURS: tuple[Colour, ...] = ((190, 144, 92), (112, 148, 176), (150, 160, 110), (176, 122, 138))
"""Of a clip's objects, in their order and again from the start."""
AXIS_LENGTH, _AXIS_RADIUS = 0.15, 0.006  # [m]

Vertices = Float[np.ndarray, "_ 3"]
Faces = Int[np.ndarray, "_ 3"]


def object_solid(
    geometry: ObjectGeometry,
    scale: float,
    positions: Float[np.ndarray, "T 3"],
    quats: Float[np.ndarray, "T 4"],
    colour: Colour,
) -> Solid:
    """Return an object's mesh, scaled about its origin, at its poses; raises `GeometryError` for an unreadable file.

    Args: `geometry`: the object's shape at captured size; `scale`: factor of its size; `positions`: [m]; `quats`: wxyz;
    `colour`: of the mesh.
    """
    surface = surface_of(geometry)
    vertices, faces = decimated(surface.vertices, surface.faces)
    return Solid(scale * vertices, faces, colour, positions.astype(np.float32), quats.astype(np.float32))


def object_axes(positions: Float[np.ndarray, "T 3"], quats: Float[np.ndarray, "T 4"]) -> Shapes:
    """Return the axes of an object of unknown shape."""
    return axes(positions[:, None], quats[:, None], AXIS_LENGTH, _AXIS_RADIUS)


def decimated(vertices: Vertices, faces: Faces, most: int = MAX_FACES) -> tuple[Vertices, Faces]:
    """Return a mesh of at most `most` triangles: vertices in one cell of a grid become their mean.

    A mesh that is small enough is returned as it is.
    """
    if len(faces) <= most:
        return vertices, faces
    corners = vertices[faces]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    cell = np.sqrt(2.0 * area / most)  # A cell that a surface passes keeps about two triangles.
    size = float(np.ptp(vertices, axis=0).max())
    cell = max(float(cell), 1e-4 * size)
    while True:
        fewer = _clustered(vertices, faces, cell)
        if len(fewer[1]) == 0:
            # So thin that all corners of every triangle are in one cell.
            import trimesh  # noqa: PLC0415  # takes a third of a second, and hardly anything is so thin

            box = trimesh.creation.box(bounds=[vertices.min(axis=0), vertices.max(axis=0)])
            return np.asarray(box.vertices), np.asarray(box.faces)
        if len(fewer[1]) <= most:
            return fewer
        cell *= 1.1


def _clustered(vertices: Vertices, faces: Faces, cell: float) -> tuple[Vertices, Faces]:
    cells = np.floor((vertices - vertices.min(axis=0)) / cell).astype(int)
    _, cluster, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    means = np.stack([np.bincount(cluster, weights=axis) for axis in vertices.T], axis=1) / counts[:, None]
    joined = cluster[faces]
    whole = (joined[:, 0] != joined[:, 1]) & (joined[:, 1] != joined[:, 2]) & (joined[:, 2] != joined[:, 0])
    joined = joined[whole]
    # Triangles of the same three clusters are one, whichever they begin with.
    _, first = np.unique(np.sort(joined, axis=1), axis=0, return_index=True)
    return means, joined[np.sort(first)]


_LIGHT, _DARK = (0.78, 0.79, 0.8, 1.0), (0.16, 0.16, 0.18, 1.0)


def attach_visual_meshes(description: mujoco.MjSpec, spec: RobotSpec, folder: Path) -> None:
    """Add the vendor meshes to the bodies.

    A mesh lies in its body's frame, or where the MJCF has a site `mesh_FILE`. It looks like the first primitive of its
    body; what is put on (head, logo, hands: what has such a site) is drawn dark. Raises `RobotError` when the
    specification names no meshes, `ReadError` when a mesh file is missing.
    """
    if not spec.meshes:
        raise RobotError(f"{spec.name}: its specification names no mesh files, so only its primitives can be drawn.")
    found = {path.name: path for path in sorted(folder.rglob("*")) if path.is_file()}
    missing = [file for files in spec.meshes.values() for file in files if file not in found]
    if missing:
        shown = ", ".join(missing[:4]) + (", ..." if len(missing) > 4 else "")
        raise ReadError(f"{folder}: {len(missing)} mesh files of {spec.title} are not there: {shown}.")
    places = {site.name: site for site in description.sites}
    for body, files in spec.meshes.items():
        own = description.body(body).first_geom()
        for file in files:
            stem = Path(file).stem
            description.add_mesh(name=f"vendor_{stem}", file=str(found[file].resolve()))
            place = places.get(f"mesh_{stem}")
            description.body(body).add_geom(
                type=mujoco.mjtGeom.mjGEOM_MESH,
                meshname=f"vendor_{stem}",
                pos=place.pos if place is not None else [0, 0, 0],
                quat=place.quat if place is not None else [1, 0, 0, 0],
                rgba=_DARK if place is not None or (own is not None and own.material == "dark") else _LIGHT,
                group=2,  # As in MuJoCo's own models: what is seen, not what collides
                contype=0,
                conaffinity=0,
                density=0,
            )


_JOINT, _GREY = 0.015, (96, 100, 110)  # Radius of a joint's ball over the stature, of robots without any surface.
_DRAWN_GROUPS = 3  # As in MuJoCo's own viewer; robots keep what only collides in the groups above.


@dataclass(frozen=True, eq=False)
class _Attached:
    """A geometry of a compiled model, fixed to a node of the tree."""

    geom: int
    colour: Colour
    node: int
    position: Float[np.ndarray, "3"]
    quat: Float[np.ndarray, "4"]


def robot_parts(
    model: RobotModel, kinematics: Kinematics, meshes: Path | None, beyond: str | None = None
) -> tuple[Part, ...]:
    """Return a robot over time: its vendor meshes, or the shapes of its MJCF where there are none.

    Raises `RobotError` when the specification names no meshes, `ReadError` when a mesh file is missing or damaged.

    `model`: the robot; `kinematics`: its poses; `meshes`: a folder with the files; None for those that were fetched, if
    any; `beyond`: a site; only the link that carries it and links that hang from that one are returned.
    """
    nodes = None
    if beyond is not None:
        nodes = np.flatnonzero(model.supports[model.sites.frames[beyond].node]).tolist()
    folder = meshes or fetched_meshes(model.spec)
    if folder is not None:
        return _solids(_vendor_meshes(model, folder), kinematics, nodes)
    if not _primitives(model) and not _own_meshes(model):
        return _joints(kinematics, nodes)
    return (*robot_shapes(model, kinematics, nodes), *_solids(_own_meshes(model), kinematics, nodes))


def _joints(kinematics: Kinematics, nodes: Collection[int] | None) -> tuple[Part, ...]:
    """Return a robot of which no surface is known: a ball at each joint, and a line from each to the one before."""
    model = kinematics.model
    own = [node for node in range(model.n + 1) if nodes is None or node in nodes]
    places = kinematics.node_position.transpose(2, 1, 0).astype(np.float32)
    balls = Shapes.of(Kind.SPHERE, _JOINT * model.spec.stature, _GREY, places[:, own])
    hinges = [node for node in own if node > 0]
    shape = (len(places), len(hinges))
    return balls, Lines(
        starts=places[:, [model.parents[node - 1] for node in hinges]],
        ends=places[:, hinges],
        colours=np.broadcast_to(np.array(_GREY, dtype=np.uint8), (*shape, 3)),
        visible=np.ones(shape, dtype=bool),
    )


def robot_shapes(model: RobotModel, kinematics: Kinematics, nodes: Collection[int] | None = None) -> tuple[Shapes, ...]:
    """Return a robot's primitives over time, one `Shapes` for each kind of them; those of some nodes, or of all."""
    shapes = []
    for kind, pieces in _primitives(model).items():
        own = [(size, item) for size, item in pieces if nodes is None or item.node in nodes]
        if own:
            sizes, attached = zip(*own, strict=True)
            colours = [item.colour for item in attached]
            shapes.append(Shapes.of(kind, np.stack(sizes), colours, *_world_poses(kinematics, attached)))
    return tuple(shapes)


@dataclass(frozen=True, eq=False)
class _Mesh:
    """A mesh of a compiled model, and its geometry."""

    vertices: Float[np.ndarray, "V 3"]  # [m]
    faces: Int[np.ndarray, "F 3"]
    attached: _Attached


@lru_cache(maxsize=8)
def _own_meshes(model: RobotModel) -> Sequence[_Mesh]:
    """Return the meshes of a robot's MJCF."""
    if not any(model.geometries.meshes):
        return ()
    return _meshes(compile_mjcf(model.spec.mjcf, model.spec.sites))


@lru_cache(maxsize=8)
def _vendor_meshes(model: RobotModel, folder: Path) -> Sequence[_Mesh]:
    description = read_mjcf(model.spec.mjcf, model.spec.sites)
    attach_visual_meshes(description, model.spec, folder)
    try:
        return _meshes(description.compile())
    except ValueError as error:
        raise ReadError(f"{folder}: MuJoCo cannot read the meshes of {model.spec.title}: {error}") from error


def _meshes(compiled: mujoco.MjModel) -> Sequence[_Mesh]:
    geometries = geometries_of(compiled, tree_of(compiled))
    found = []
    for item in _attached(geometries):
        if geometries.meshes[item.geom]:
            mesh = compiled.mesh(geometries.meshes[item.geom])
            vertices = compiled.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]].astype(float)
            faces = compiled.mesh_face[mesh.faceadr[0] :][: mesh.facenum[0]].astype(int)
            found.append(_Mesh(vertices, faces, item))
    return tuple(found)


def _solids(meshes: Sequence[_Mesh], kinematics: Kinematics, nodes: Collection[int] | None) -> tuple[Solid, ...]:
    """Return meshes over time."""
    own = [mesh for mesh in meshes if nodes is None or mesh.attached.node in nodes]
    if not own:
        return ()
    positions, quats = _world_poses(kinematics, [mesh.attached for mesh in own])
    return tuple(
        Solid(mesh.vertices, mesh.faces, mesh.attached.colour, positions[:, index], quats[:, index])
        for index, mesh in enumerate(own)
    )


def _world_poses(
    kinematics: Kinematics, attached: Sequence[_Attached]
) -> tuple[Float[np.ndarray, "T K 3"], Float[np.ndarray, "T K 4"]]:
    """Return world positions [m] and rotations of geometries, in single precision."""
    nodes = [item.node for item in attached]
    turns = se3.matrix_to_quat(kinematics.node_rotation.transpose(3, 2, 0, 1)).astype(np.float32)[:, nodes]
    places = kinematics.node_position.transpose(2, 1, 0).astype(np.float32)[:, nodes]
    within = np.stack([item.position for item in attached]).astype(np.float32)
    quats = np.stack([item.quat for item in attached]).astype(np.float32)
    return places + se3.rotate(turns, within), se3.quat_multiply(turns, quats)


@lru_cache(maxsize=8)
def _primitives(model: RobotModel) -> Mapping[Kind, Sequence[tuple[np.ndarray, _Attached]]]:
    """Return the unit shapes of each kind that the robot is made of: half extents [m] and place."""
    geometries = model.geometries
    found: dict[Kind, list[tuple[np.ndarray, _Attached]]] = {kind: [] for kind in Kind}
    for item in _attached(geometries):
        for kind, size, along in _unit_shapes(geometries.types[item.geom], geometries.sizes[item.geom]):
            position = item.position + se3.rotate(item.quat, np.array([0.0, 0.0, along]))
            found[kind].append((size, replace(item, position=position)))
    return {kind: pieces for kind, pieces in found.items() if pieces}


def _attached(geometries: Geometries) -> Iterator[_Attached]:
    """Yield the geometries that are to be seen."""
    for geom, (group, colour) in enumerate(zip(geometries.groups, geometries.colours, strict=True)):
        if group < _DRAWN_GROUPS and colour[3] > 0:
            frame, (red, green, blue) = geometries.frames[geom], (round(255 * float(share)) for share in colour[:3])
            yield _Attached(geom, (red, green, blue), frame.node, frame.position, se3.matrix_to_quat(frame.rotation))


def _unit_shapes(geometry: str, size: np.ndarray) -> Iterator[tuple[Kind, np.ndarray, float]]:
    """Yield the unit shapes of a primitive: kind, half extents, and offset along its axis [m]."""
    radius, half = size[0], size[1]
    match geometry:
        case "capsule":
            yield Kind.CYLINDER, np.array([radius, radius, half]), 0.0
            yield Kind.SPHERE, np.full(3, radius), float(half)
            yield Kind.SPHERE, np.full(3, radius), -float(half)
        case "cylinder":
            yield Kind.CYLINDER, np.array([radius, radius, half]), 0.0
        case "sphere":
            yield Kind.SPHERE, np.full(3, radius), 0.0
        case "ellipsoid":
            yield Kind.SPHERE, size.copy(), 0.0
        case "box":
            yield Kind.BOX, size.copy(), 0.0
