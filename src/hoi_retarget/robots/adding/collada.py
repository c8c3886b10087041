"""Triangles and colours of a COLLADA file (`.dae`).

Nodes are transformed and the file's unit becomes metres. Its `up_axis` is applied only when asked for: rviz, Gazebo
and Pinocchio leave it out, and most makers place their meshes by what they see there. Textures, lights, cameras,
skeletons are left out.

Source: Khronos, COLLADA 1.4.1 and 1.5.0.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.files.xml_file import parse_xml
from hoi_retarget.numerics import se3

Colour = tuple[float, ...]
"""Red, green, blue, each from 0 to 1."""
_MOST_BYTES, _MOST_NODES, _MOST_TRIANGLES = 64 << 20, 5_000, 5_000_000
"""Instances of instances would grow without end."""
_PRIMITIVES = ("triangles", "polylist", "polygons", "trifans", "tristrips")
_UPRIGHT = {
    "X_UP": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "Y_UP": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
}
"""Turns from the axes of a file to those with z up."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles of one colour."""

    vertices: Float[np.ndarray, "V 3"]
    """[m]"""
    faces: Int[np.ndarray, "T 3"]
    colour: Colour | None
    """None where the file says none, or a texture."""


@dataclass(frozen=True, eq=False)
class Collada:
    """A file's scene."""

    surfaces: tuple[Surface, ...]
    """One a colour."""
    other_up: bool
    """Whether it says that another axis than z is up."""


def read_collada(content: bytes, *, upright: bool = False) -> Collada:
    """Return a file's scene.

    Args:
        content: Of the file.
        upright: Whether to turn it such that z is up.

    Raises:
        ValueError: It is no COLLADA file, is damaged, or refers to other files.
    """
    if len(content) > _MOST_BYTES:
        raise ValueError(f"it is larger than {_MOST_BYTES >> 20} MiB.")
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
                if count > _MOST_TRIANGLES:
                    raise ValueError(f"it has more than {_MOST_TRIANGLES} triangles.")
                surfaces.setdefault(_colour(instance, symbol, by_id), []).append(
                    unit * _moved(triangles, place) @ turn.T
                )
    except (LookupError, OverflowError) as error:
        raise ValueError(f"it is damaged ({type(error).__name__}: {error}).") from error
    return Collada(
        tuple(_surface(np.concatenate(parts), colour) for colour, parts in surfaces.items()), axis in _UPRIGHT
    )


def _surface(triangles: Float[np.ndarray, "T 3 3"], colour: Colour | None) -> Surface:
    return Surface(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), colour)


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
    for _ in range(_MOST_NODES):
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
    raise ValueError(f"it has more than {_MOST_NODES} nodes.")


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
    geometry: ET.Element, by_id: Mapping[str | None, ET.Element]
) -> Iterator[tuple[Float[np.ndarray, "T 3 3"], str | None]]:
    """Yield triangles in a geometry's own frame and unit, with the symbol of their material."""
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
    """Return what an instance paints triangles of a symbol with."""
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
