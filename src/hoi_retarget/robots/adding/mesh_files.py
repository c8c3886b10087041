"""Mesh files of a description: found by their names below one folder, read (STL, OBJ, COLLADA) and made coarser.

Nodes of a COLLADA file (`.dae`) are transformed and its unit becomes metres. Its `up_axis` is applied only when asked
for: rviz, Gazebo and Pinocchio leave it out, and most manufacturers place their meshes accordingly. Textures, lights,
cameras, skeletons are left out. Source: Khronos, COLLADA 1.4.1 and 1.5.0.
"""

import io
import os
from collections import ChainMap
from collections.abc import Iterator, Mapping, MutableMapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import trimesh
from jaxtyping import Float, Int

from hoi_retarget.errors import ReadError
from hoi_retarget.files.reading import parse_xml, read_bytes
from hoi_retarget.numerics import se3

Colour = tuple[float, ...]  # Red, green, blue, each from 0 to 1.
_MAX_BYTES, _MAX_NODES, _MAX_TRIANGLES = 64 << 20, 2_000, 2_000_000  # Instances of instances would grow without end.
_PRIMITIVES = ("triangles", "polylist", "polygons", "trifans", "tristrips")
_UPRIGHT = {
    "X_UP": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "Y_UP": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
}
"""Turns from the axes of a file to those with z up."""
SUFFIXES = (".stl", ".obj", ".dae")
"""Of mesh files that can be read; of one that is not there, a file of the same stem is taken, the first of these."""
MESH_FOLDERS = ("meshes", "assets", "visuals", "mesh")
_LEVELS_UP = 2
_MAX_FILES = 20_000
_MAX_FILE_BYTES = 48 << 20
_MAX_FACES = 2500
_STL_HEAD = 84
_STL_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
_FINEST = 256  # Parts of a mesh's extent at first, when vertices that are near to each other become one.


@dataclass(frozen=True, eq=False)
class ColladaSurface:
    """Triangles of one colour."""

    vertices: Float[np.ndarray, "V 3"]  # [m]
    faces: Int[np.ndarray, "T 3"]
    colour: Colour | None  # None where the file says none, or a texture.


@dataclass(frozen=True, eq=False)
class Collada:
    """A file's scene."""

    surfaces: tuple[ColladaSurface, ...]  # One a colour.
    other_up: bool  # Whether it says that another axis than z is up.


def read_collada(content: bytes, *, upright: bool = False) -> Collada:
    """Return a file's scene, turned such that z is up with `upright`.

    Raises `ValueError` where it is no COLLADA file, is damaged, or refers to other files.
    """
    if len(content) > _MAX_BYTES:
        raise ValueError(f"it is larger than {_MAX_BYTES >> 20} MiB.")
    root = parse_xml(content)
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    if root.tag != "COLLADA":
        raise ValueError(f"it is no COLLADA file: its outermost element is <{root.tag}>.")
    by_id = {element.get("id"): element for element in root.iter() if element.get("id")}
    axis = root.findtext("asset/up_axis", "Y_UP").strip()
    turn = _UPRIGHT.get(axis, np.eye(3)) if upright else np.eye(3)
    surfaces: dict[Colour | None, list[np.ndarray]] = {}
    geometries: dict[ET.Element, list[tuple[np.ndarray, str | None]]] = {}
    count = 0
    try:
        metres = root.find("asset/unit[@meter]")
        unit = 1.0 if metres is None else float(metres.attrib["meter"])
        for instance, place in _instances(_scene(root, by_id), by_id):
            geometry = _target(instance, by_id)
            if geometry not in geometries:
                geometries[geometry] = list(_primitives(geometry, by_id))
            for triangles, symbol in geometries[geometry]:
                count += len(triangles)
                if count > _MAX_TRIANGLES:
                    raise ValueError(f"it has more than {_MAX_TRIANGLES} triangles.")
                surfaces.setdefault(_colour(instance, symbol, by_id), []).append(
                    unit * _moved(triangles, place) @ turn.T
                )
    except (LookupError, OverflowError) as error:
        raise ValueError(f"it is damaged ({type(error).__name__}: {error}).") from error
    return Collada(
        tuple(_collada_surface(np.concatenate(parts), colour) for colour, parts in surfaces.items()), axis in _UPRIGHT
    )


def _collada_surface(triangles: Float[np.ndarray, "T 3 3"], colour: Colour | None) -> ColladaSurface:
    return ColladaSurface(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), colour)


def _target(element: ET.Element, by_id: Mapping[str | None, ET.Element], attribute: str = "url") -> ET.Element:
    """Return the element that another one refers to, in the same file."""
    address = element.get(attribute, "")
    if not address.startswith("#") or address[1:] not in by_id:
        raise ValueError(f"<{element.tag}> refers to {address!a}, which is not in it.")
    return by_id[address[1:]]


def _scene(root: ET.Element, by_id: Mapping[str | None, ET.Element]) -> ET.Element:
    shown = root.find("scene/instance_visual_scene")
    scene = root.find("library_visual_scenes/visual_scene") if shown is None else _target(shown, by_id)
    if scene is None:
        raise ValueError("it has no scene.")
    return scene


def _instances(
    scene: ET.Element, by_id: Mapping[str | None, ET.Element]
) -> Iterator[tuple[ET.Element, Float[np.ndarray, "4 4"]]]:
    """Yield every instance of a geometry, with its place in the scene."""
    pending = [(node, np.eye(4)) for node in scene.findall("node")]
    for _ in range(_MAX_NODES):
        if not pending:
            return
        node, above = pending.pop()
        place = above @ _transform(node)
        for child in node:
            if child.tag == "instance_geometry":
                yield child, place
            elif child.tag == "node":
                pending.append((child, place))
            elif child.tag == "instance_node":
                pending.append((_target(child, by_id), place))
    raise ValueError(f"it has more than {_MAX_NODES} nodes.")


def _transform(node: ET.Element) -> Float[np.ndarray, "4 4"]:
    whole = np.eye(4)
    for child in node:
        step = np.eye(4)
        if child.tag == "matrix":
            step = _numbers(child).reshape(4, 4)
        elif child.tag == "translate":
            step[:3, 3] = _numbers(child)
        elif child.tag == "scale":
            step[:3, :3] = np.diag(_numbers(child).reshape(3))
        elif child.tag == "rotate":
            axis, degrees = np.split(_numbers(child).reshape(4), [3])
            length = float(np.linalg.norm(axis)) or 1.0
            step[:3, :3] = se3.quat_to_matrix(se3.exp(axis / length * np.radians(degrees)))
        elif child.tag in {"lookat", "skew"}:
            raise ValueError(f"it transforms a node by <{child.tag}>, which is not read.")
        whole = whole @ step
    return whole


def _moved(triangles: Float[np.ndarray, "T 3 3"], place: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "T 3 3"]:
    moved = triangles @ place[:3, :3].T + place[:3, 3]
    return moved[:, ::-1] if np.linalg.det(place[:3, :3]) < 0 else moved


def _primitives(
    geometry: ET.Element, by_id: MutableMapping[str | None, ET.Element]
) -> Iterator[tuple[Float[np.ndarray, "T 3 3"], str | None]]:
    """Yield triangles in a geometry's own frame and unit, with the symbol of their material.

    Some exporters use the same ids in every geometry: a geometry's own come first.
    """
    own = {element.get("id"): element for element in geometry.iter() if element.get("id")}
    by_id = ChainMap(own, by_id)
    for primitive in (child for kind in _PRIMITIVES for child in geometry.findall(f"mesh/{kind}")):
        vertex = primitive.find("input[@semantic='VERTEX']")
        position = None if vertex is None else _target(vertex, by_id, "source").find("input[@semantic='POSITION']")
        if vertex is None or position is None:
            raise ValueError("triangles without vertices.")
        points = _points(_target(position, by_id, "source"))
        stride = 1 + max(int(one.get("offset", 0)) for one in primitive.findall("input"))
        offset = int(vertex.get("offset", 0))
        runs = [_numbers(run, int).reshape(-1, stride)[:, offset] for run in primitive.iter("p")]
        corners = np.concatenate([np.zeros(0, dtype=int), *runs])
        if len(corners) and not 0 <= corners.min() <= corners.max() < len(points):
            raise ValueError(f"a corner of its triangles is none of {len(points)} vertices.")
        yield points[corners[_triangles(primitive, [len(run) for run in runs])]], primitive.get("material")


def _points(source: ET.Element) -> Float[np.ndarray, "V 3"]:
    accessor, array = source.find("technique_common/accessor"), source.find("float_array")
    if accessor is None or array is None:
        raise ValueError("vertices without numbers.")
    stride, first = int(accessor.get("stride", 1)), int(accessor.get("offset", 0))
    points = _numbers(array)[first:].reshape(-1, stride)
    if stride < 3 or not np.isfinite(points).all():
        raise ValueError("vertices that are no points.")
    return points[:, :3]


def _triangles(primitive: ET.Element, runs: list[int]) -> Int[np.ndarray, "T 3"]:
    """Return triangles by the numbers of their corners in a primitive."""
    if primitive.find("ph") is not None:
        raise ValueError("it has polygons with holes, which are not read.")
    if primitive.tag == "triangles":
        return np.arange(sum(runs)).reshape(-1, 3)
    count = primitive.find("vcount")
    sizes = _numbers(count, int) if primitive.tag == "polylist" and count is not None else np.array(runs, dtype=int)
    if sizes.sum() != sum(runs) or (sizes < 0).any():
        raise ValueError("the corners of its polygons are not as many as it says.")
    fans = np.maximum(sizes - 2, 0)
    first = np.repeat(np.cumsum(sizes) - sizes, fans)
    along = np.arange(fans.sum()) - np.repeat(np.cumsum(fans) - fans, fans)
    if primitive.tag == "tristrips":
        odd = along % 2
        return np.stack([first + along + odd, first + along + 1 - odd, first + along + 2], axis=1)
    return np.stack([first, first + along + 1, first + along + 2], axis=1)


def _colour(instance: ET.Element, symbol: str | None, by_id: Mapping[str | None, ET.Element]) -> Colour | None:
    """Return the colour of an instance's triangles of a symbol."""
    for bound in instance.iterfind("bind_material/technique_common/instance_material"):
        if bound.get("symbol") != symbol:
            continue
        effect = _target(bound, by_id, "target").find("instance_effect")
        colour = None if effect is None else _target(effect, by_id).find(".//diffuse/color")
        if colour is not None:
            return tuple(np.clip(_numbers(colour)[:3], 0.0, 1.0).round(3).tolist())
    return None


def _numbers(element: ET.Element, kind: type = float) -> np.ndarray:
    return np.array((element.text or "").split(), dtype=kind)


@dataclass(frozen=True)
class MeshFolder:
    """All mesh files below some folders; nothing outside of them is ever opened."""

    folders: tuple[Path, ...]
    files: tuple[Path, ...]

    def find(self, name: str) -> Path | None:
        """Return the file that a description means by a path, of which only the last parts count."""
        path_parts = name.replace("\\", "/").lower().split("/")
        stem = os.path.splitext(path_parts[-1])[0]  # noqa: PTH122  # no path of this machine
        for names in ((path_parts[-1],), tuple(stem + suffix for suffix in SUFFIXES)):
            hits = [file for file in self.files if file.name.lower() in names]
            if hits:
                return max(
                    hits,
                    key=lambda file: (_common_end(path_parts, file), -len(file.parts), file.suffix.lower() != ".dae"),
                )
        return None


def mesh_folder(description: Path, meshes: Path | None) -> MeshFolder:
    """Return the mesh files of a description: in its own folder, or in its package's, and in `meshes`.

    The folder of the package is one above with a folder of meshes in it: `robot/urdf/robot.urdf`, `robot/meshes`.
    """
    own = description.resolve().parent
    above = (own, *own.parents)[: _LEVELS_UP + 1]
    package = next((top for top in above if any((top / name).is_dir() for name in MESH_FOLDERS)), own)
    folders = (*((meshes.resolve(),) if meshes is not None else ()), package)
    return MeshFolder(folders, tuple(file for folder in folders for file in _below(folder)))


def _below(folder: Path) -> Iterator[Path]:
    count = 0
    for top, _, names in os.walk(folder):
        for name in sorted(names):
            count += 1
            if count > _MAX_FILES:
                return
            file = Path(top) / name
            # A link may lead out of the folder, and pipes never end.
            if name.lower().endswith(SUFFIXES) and file.resolve().is_relative_to(folder) and file.is_file():
                yield file


def _common_end(path_parts: Sequence[str], file: Path) -> int:
    parts = [part.lower() for part in file.parts]
    same = 0
    for one, other in zip(reversed(path_parts[:-1]), reversed(parts[:-1]), strict=False):
        if one != other:
            break
        same += 1
    return same


@dataclass(frozen=True)
class Mesh:
    """A mesh file, made coarser."""

    parts: tuple[tuple[bytes, Colour | None], ...]  # Binary STLs with the colours that the file says.
    other_up: bool  # Whether it says that another axis than z is up.


def read_mesh(file: Path, *, upright: bool = False) -> Mesh:
    """Return a mesh file, turned such that z is up with `upright`.

    Raises `ValueError` where it is too large, damaged, or has no surface.
    """
    if file.stat().st_size > _MAX_FILE_BYTES:
        raise ValueError(f"it is larger than {_MAX_FILE_BYTES >> 20} MiB.")
    try:
        content, kind = read_bytes(file), file.suffix.lower().removeprefix(".")
    except ReadError as error:
        raise ValueError(str(error).removeprefix(f"{file}: ")) from error
    if kind == "dae":
        read = read_collada(content, upright=upright)
    else:
        read = Collada((_surface(content, kind),), other_up=False)
    total = max(sum(len(surface.faces) for surface in read.surfaces), 1)
    parts = ((_coarse(surface, _MAX_FACES * len(surface.faces) // total), surface.colour) for surface in read.surfaces)
    shown = tuple((stl, colour) for stl, colour in parts if stl is not None)
    if not shown:
        raise ValueError("it has no surface.")
    return Mesh(shown, read.other_up)


def coarse_stl(content: bytes, kind: str) -> bytes | None:
    """Return a mesh of a kind, `stl` or `obj`, made coarser, as a binary STL; None where there is no surface."""
    try:
        return _coarse(_surface(content, kind), _MAX_FACES)
    except ValueError:
        return None


def joined_stl(parts: Sequence[bytes]) -> bytes:
    """Return the triangles of several binary STLs as one."""
    records = b"".join(part[_STL_HEAD:] for part in parts)
    return b"\0" * 80 + np.uint32(len(records) // _STL_RECORD.itemsize).tobytes() + records


def _surface(content: bytes, kind: str) -> ColladaSurface:
    """Return an STL or an OBJ; raises `ValueError`."""
    try:
        mesh = trimesh.load(io.BytesIO(content), file_type=kind, force="mesh", process=False, skip_materials=True)
        if not isinstance(mesh, trimesh.Trimesh):
            raise ValueError("no triangles")
        return ColladaSurface(np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=int), None)
    except Exception as error:  # Whatever a damaged mesh does to its reader.
        raise ValueError(f"it is damaged ({type(error).__name__}: {error}).") from error


def _coarse(surface: ColladaSurface, most: int) -> bytes | None:
    if not len(surface.faces) or not np.isfinite(surface.vertices).all():
        return None
    vertices, faces = coarser(surface.vertices, surface.faces, most)
    return _stl(vertices[faces]) if len(faces) else None


def coarser(vertices: np.ndarray, faces: np.ndarray, most: int = _MAX_FACES) -> tuple[np.ndarray, np.ndarray]:
    """Return a mesh of few triangles, `most` where it can: vertices in one cell of a grid become one, at their mean."""
    low, extent = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max())
    parts = _FINEST
    while len(faces) > most and parts > 8:
        cells = np.floor((vertices - low) / (extent / parts)).astype(np.int64)
        _, cell = np.unique(cells @ [1, 4 * _FINEST, 16 * _FINEST**2], return_inverse=True)
        cell = cell.ravel()
        count = np.bincount(cell)
        vertices = np.stack([np.bincount(cell, axis) / count for axis in vertices.T], axis=1)
        faces = cell[faces]
        faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
        # Of walls that became one, both sides stay: viewers draw only the side that a triangle is wound for.
        turns = (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3
        one, two, three = np.take_along_axis(faces, turns, axis=1).T
        # One number a triangle: sorting rows takes ten times as long.
        _, edge = np.unique(one * len(count) + two, return_inverse=True)
        _, first = np.unique(edge * len(count) + three, return_index=True)
        faces = faces[np.sort(first)]
        parts = int(parts * 0.75)
    return vertices, faces


def _stl(triangles: np.ndarray) -> bytes:
    records = np.zeros(len(triangles), dtype=_STL_RECORD)
    records["corners"] = triangles
    return b"\0" * 80 + np.uint32(len(triangles)).tobytes() + records.tobytes()
