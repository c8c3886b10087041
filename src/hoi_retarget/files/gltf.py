"""Binary glTF 2.0 files (`.glb`) with their animations: nodes over time, meshes, bind poses.

Such a file is a text in JSON, the tables, and bytes that they describe. Values are of the file's world: y up, metres.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.errors import ReadError
from hoi_retarget.numerics import se3

MAGIC = b"glTF"
ChannelPath = Literal["translation", "rotation", "scale"]  # Animated value of a node, in glTF's words.

_HEADER = 20  # Bytes before the text of a `.glb` file; the last eight tell the text's length and kind.
_BYTES_HEADER = 8  # Likewise between the text and the bytes.
# As text, like all that is looked up: a damaged file may have a list there.
_COMPONENTS = {"5120": "i1", "5121": "u1", "5122": "i2", "5123": "u2", "5125": "u4", "5126": "f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_WIDTH_OF: dict[ChannelPath, int] = {"translation": 3, "rotation": 4, "scale": 3}
_TRIANGLES = 4
_UNEVEN = 0.01  # Part by which a scale's three numbers may differ, or change over time, and still be one number.
_ON_FRAME = 0.05  # [frames]; keys this near a frame are on it: times are stored in single precision.
_LARGEST = 1e6  # Of any number; damage stays a number otherwise.


def text_of(content: bytes) -> bytes:
    """Return the text of a `.glb` file, in which all names stand; empty where it is none."""
    if not content.startswith(MAGIC):
        return b""
    return content[_HEADER : _HEADER + int.from_bytes(content[12:16], "little")]


def _bytes_of(content: bytes) -> bytes:
    """Return the bytes behind the text of a `.glb` file; empty where there are none."""
    start = _HEADER + int.from_bytes(content[12:16], "little") + _BYTES_HEADER
    return content[start : start + int.from_bytes(content[start - _BYTES_HEADER : start - 4], "little")]


def _table(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


@dataclass(frozen=True, eq=False)
class Channel:
    """The animation of one of a node's three values."""

    node: int
    path: ChannelPath
    times: Float[np.ndarray, "K"]  # Ascending [s].
    values: Float[np.ndarray, "K w"]  # Rotations are wxyz.
    steps: bool  # Whether values stay until the next one; otherwise they go there evenly.

    @property
    def constant(self) -> bool:
        """Whether it is the same value all the time."""
        return bool((self.values == self.values[0]).all())

    def at(self, frames: Float[np.ndarray, "T"], rate: float) -> Float[np.ndarray, "T w"]:
        """Return the values, in their unit, at frames of `rate` [Hz], held before the first key and after the last."""
        keys = self.times * rate
        whole = np.rint(keys)
        keys = np.where(np.abs(keys - whole) < _ON_FRAME, whole, keys)
        if len(keys) == len(frames) and (keys == frames).all():
            return self.values
        before = np.clip(np.searchsorted(keys, frames, side="right") - 1, 0, len(keys) - 1)
        after = np.minimum(before + 1, len(keys) - 1)
        span = keys[after] - keys[before]
        share = np.clip((frames - keys[before]) / np.where(span > 0, span, 1.0), 0.0, 1.0) * (span > 0)
        if self.steps:
            return self.values[before]
        if self.path == "rotation":
            return se3.slerp(self.values[before], self.values[after], share)
        return self.values[before] + share[:, None] * (self.values[after] - self.values[before])


@dataclass(frozen=True, eq=False)
class NodePoses:
    """Where all nodes are in the world, frame by frame."""

    positions: Float[np.ndarray, "T N 3"]
    quats: Float[np.ndarray, "T N 4"]  # wxyz
    scales: Float[np.ndarray, "T N"]


class Gltf:
    """A file's nodes, animations, meshes and skins; raises `ReadError` where they contradict each other."""

    def __init__(self, path: Path, content: bytes) -> None:
        self.path = path
        try:
            document = _table(json.loads(text_of(content)))
        except (ValueError, RecursionError) as error:
            raise self._wrong(f"its text cannot be read ({error!s:.200})") from error
        self._blob = _bytes_of(content)
        if document.get("extensionsRequired"):
            raise self._wrong(f"it needs extensions of glTF ({document['extensionsRequired']!s:.80})")
        self._nodes = self._list(document, "nodes")
        self._animations = self._list(document, "animations")
        self._meshes, self._skins = self._list(document, "meshes"), self._list(document, "skins")
        self._accessors, self._views = self._list(document, "accessors"), self._list(document, "bufferViews")
        self.names = tuple(str(node.get("name") or f"node {index}") for index, node in enumerate(self._nodes))
        self.parents = self._parents()

    # Nodes

    @cached_property
    def order(self) -> tuple[int, ...]:
        """All nodes, each behind its parent."""
        depths = [len(tuple(self.ancestors(node))) for node in range(len(self._nodes))]
        return tuple(sorted(range(len(self._nodes)), key=lambda node: (depths[node], node)))

    def ancestors(self, node: int) -> Iterator[int]:
        """Yield a node's parent, its parent's, and so on to the root; raises `ReadError` for a ring of nodes."""
        seen = 0
        while self.parents[node] >= 0:
            node, seen = self.parents[node], seen + 1
            if seen > len(self._nodes):
                raise self._wrong("its nodes are their own ancestors")
            yield node

    def mesh_of(self, node: int) -> int | None:
        """Return the mesh that a node carries and nothing deforms; None without."""
        mesh, skin = self._nodes[node].get("mesh"), self._nodes[node].get("skin")
        return None if mesh is None or skin is not None else mesh

    def poses(self, frames: Float[np.ndarray, "T"], rate: float) -> NodePoses:
        """Return where the nodes are at frames of `rate` frames a second."""
        moved = {(channel.node, channel.path): channel for channel in self.channels}
        shape = len(frames), len(self._nodes)
        positions, quats, scales = np.empty((*shape, 3)), np.empty((*shape, 4)), np.empty(shape)
        for node in self.order:
            values = {
                path: channel.at(frames, rate) if (channel := moved.get((node, path))) else self._rest(node, path)
                for path in _WIDTH_OF
            }
            own_scale = self._one_scale(node, values["scale"])
            parent = self.parents[node]
            if parent < 0:
                positions[:, node], quats[:, node] = values["translation"], values["rotation"]
                scales[:, node] = own_scale
                continue
            offset = scales[:, parent, None] * values["translation"]
            positions[:, node] = positions[:, parent] + se3.rotate(quats[:, parent], offset)
            quats[:, node] = se3.quat_multiply(quats[:, parent], values["rotation"])
            scales[:, node] = scales[:, parent] * own_scale
        return NodePoses(positions, quats, scales)

    def _one_scale(self, node: int, values: Float[np.ndarray, "t 3"]) -> Float[np.ndarray, "t"]:
        mean = values.mean(axis=-1)
        if (mean <= 0).any() or (np.ptp(values, axis=-1) > _UNEVEN * mean).any():
            raise self._wrong(
                f"node {self.names[node]!r} is scaled unevenly or mirrored; apply scales before exporting"
            )
        return mean

    def _rest(self, node: int, path: ChannelPath) -> np.ndarray:
        stored = self._nodes[node].get(path)
        if self._nodes[node].get("matrix") is not None:
            raise self._wrong(f"node {self.names[node]!r} has a matrix, expected translation, rotation and scale")
        default = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}[path]
        values = self._numbers(stored if stored is not None else default, f"{path} of node {self.names[node]!r}")
        if values.shape != (_WIDTH_OF[path],):
            raise self._wrong(f"the {path} of node {self.names[node]!r} has {values.size} numbers")
        return self._wxyz(values[None]) if path == "rotation" else values[None]

    def _parents(self) -> tuple[int, ...]:
        parents = [-1] * len(self._nodes)
        for index, node in enumerate(self._nodes):
            for child in self._indices(node, "children"):
                if parents[child] >= 0:
                    raise self._wrong(f"node {self.names[child]!r} has two parents")
                parents[child] = index
        return tuple(parents)

    # Animations

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """All that is animated, by whichever of the file's animations."""
        channels: list[Channel] = []
        known: set[tuple[int, str]] = set()
        for animation in self._animations:
            samplers = self._list(animation, "samplers")
            for item in self._list(animation, "channels"):
                target = _table(item.get("target"))
                node, path = target.get("node"), target.get("path")
                if not isinstance(path, str) or path not in _WIDTH_OF or node is None:
                    continue  # Weights of morph targets.
                self._checked(node, self._nodes, "node")
                if (node, path) in known:
                    raise self._wrong(f"the {path} of node {self.names[node]!r} is animated twice; export one action")
                known.add((node, path))
                channels.append(self._channel(node, path, self._checked(item.get("sampler"), samplers, "sampler")))
        return tuple(channels)

    def _channel(self, node: int, path: ChannelPath, sampler: dict[str, Any]) -> Channel:
        what = f"the {path} of node {self.names[node]!r}"
        interpolation = sampler.get("interpolation")
        if interpolation not in (None, "LINEAR", "STEP"):
            raise self._wrong(f"{what} is interpolated by {interpolation!s:.20}, expected LINEAR or STEP")
        times = self.array(sampler.get("input"), 1, f"times of {what}")[:, 0].astype(float)
        values = self.array(sampler.get("output"), _WIDTH_OF[path], what).astype(float)
        if len(times) == 0 or len(times) != len(values):
            raise self._wrong(f"{what} has {len(times)} times and {len(values)} values")
        if (np.diff(times) <= 0).any():
            raise self._wrong(f"the times of {what} do not ascend")
        values = self._wxyz(values) if path == "rotation" else values
        return Channel(node, path, times, values, steps=interpolation == "STEP")

    # Meshes and skins

    def mesh(self, index: int) -> tuple[Float[np.ndarray, "V 3"], Int[np.ndarray, "F 3"]]:
        """Return the vertices [m] and triangles of a mesh, all its parts in one."""
        name, parts = self._primitives(index)
        vertices, faces, count = [], [], 0
        for part in parts:
            corner = _table(part.get("attributes")).get("POSITION")
            points = self.array(corner, 3, f"vertices of {name}").astype(float)
            corners = np.arange(len(points))
            if part.get("indices") is not None:
                corners = self.array(part["indices"], 1, f"triangles of {name}")[:, 0].astype(np.int64)
            if len(corners) % 3 or (corners >= len(points)).any() or (corners < 0).any():
                raise self._wrong(f"the triangles of {name} are of vertices that are not there")
            vertices.append(points)
            faces.append(corners.reshape(-1, 3) + count)
            count += len(points)
        if not vertices or not sum(map(len, faces)):
            raise self._wrong(f"{name} has no triangles")
        return np.concatenate(vertices), np.concatenate(faces)

    def _primitives(self, index: int) -> tuple[str, list[dict[str, Any]]]:
        """Return a mesh's name, for messages, and its parts, which are of triangles."""
        mesh = self._checked(index, self._meshes, "mesh")
        name, parts = f"mesh {mesh.get('name')!s:.40}", self._list(mesh, "primitives")
        if any(part.get("mode") not in (None, _TRIANGLES) for part in parts):
            raise self._wrong(f"{name} has points or lines, expected triangles")
        return name, parts

    def bound_meshes(self, skin: int) -> tuple[int, ...]:
        """Return the meshes that nodes bind to the joints of a skin, each once."""
        bound = [node for node in self._nodes if node.get("skin") == skin and node.get("mesh") is not None]
        return tuple(dict.fromkeys(node["mesh"] for node in bound))

    def vertex_weights(self, index: int, joints: int) -> Float[np.ndarray, "V J"]:
        """Return the weights of a skin's joints at each vertex of a mesh; rows sum to 1."""
        name, parts = self._primitives(index)
        found = []
        for part in parts:
            attributes = _table(part.get("attributes"))
            chosen = self.array(attributes.get("JOINTS_0"), 4, f"joints of {name}").astype(int)
            shares = self.array(attributes.get("WEIGHTS_0"), 4, f"weights of {name}").astype(float)
            sums = shares.sum(axis=1, keepdims=True)
            if chosen.shape != shares.shape or (chosen >= joints).any() or (shares < 0).any() or not (sums > 0).all():
                raise self._wrong(f"the weights of {name} are not those of its vertices and its skin's {joints} joints")
            weights = np.zeros((len(shares), joints))
            np.add.at(weights, (np.arange(len(shares))[:, None], chosen), shares / sums)
            found.append(weights)
        return np.concatenate(found)

    def skins(self) -> Iterator[tuple[tuple[int, ...], Float[np.ndarray, "J 4 4"]]]:
        """Yield the joints of each skin and the matrices that bring the bound mesh [m] into their frames."""
        for skin in self._skins:
            joints = self._indices(skin, "joints")
            matrices = skin.get("inverseBindMatrices")
            if matrices is None:
                raise self._wrong("a skin has no inverse bind matrices; export it with its bind pose")
            columns = self.array(matrices, 16, "inverse bind matrices").astype(float)
            if len(columns) != len(joints):
                raise self._wrong(f"a skin has {len(joints)} joints and {len(columns)} inverse bind matrices")
            yield joints, columns.reshape(-1, 4, 4).transpose(0, 2, 1)

    # Bytes

    def array(self, index: Any, width: int, meaning: str) -> np.ndarray:
        """Return the values that an accessor shows of the file's bytes, (count, width)."""
        accessor = self._checked(index, self._accessors, f"accessor of {meaning}")
        if accessor.get("sparse") is not None or accessor.get("bufferView") is None:
            raise self._wrong(f"{meaning}: stored sparsely or compressed; export without compression")
        component, layout = str(accessor.get("componentType")), str(accessor.get("type"))
        kind = np.dtype(f"<{_COMPONENTS.get(component, 'V1')}")
        if kind.kind == "V" or _WIDTHS.get(layout) != width:
            raise self._wrong(f"{meaning}: stored as {layout:.10} of kind {component:.10}")
        if kind.kind != "f" and accessor.get("normalized"):
            raise self._wrong(f"{meaning}: stored as fractions in whole numbers; export without quantization")
        view = self._checked(accessor["bufferView"], self._views, "buffer view")
        if view.get("buffer") != 0:
            raise self._wrong(f"{meaning}: stored in another file; export one binary file")
        size = kind.itemsize * width
        offsets = view.get("byteOffset") or 0, accessor.get("byteOffset") or 0
        places = (accessor.get("count"), view.get("byteStride") or size, *offsets)
        if not all(type(place) is int and place >= 0 for place in places) or places[1] < size:
            raise self._wrong(f"{meaning}: its place in the file is no number")
        count, stride, first = *places[:2], sum(offsets)
        if count and first + stride * (count - 1) + size > len(self._blob):
            raise self._wrong(f"{meaning}: reaches beyond the file's {len(self._blob)} bytes of data; it is cut off")
        if not count:
            return np.zeros((0, width), dtype=kind)
        values = np.ndarray((count, width), kind, self._blob, first, (stride, kind.itemsize))
        if not (np.abs(values) <= _LARGEST).all():
            raise self._wrong(f"{meaning}: holds numbers that are not finite, or absurdly large")
        return values

    def _wxyz(self, xyzw: np.ndarray) -> np.ndarray:
        lengths = np.linalg.norm(xyzw, axis=-1, keepdims=True)
        if (np.abs(lengths - 1.0) > 0.01).any():
            raise self._wrong("a rotation is no unit quaternion")
        return se3.quat_from_xyzw(xyzw / lengths)

    def _numbers(self, values: Any, what: str) -> np.ndarray:
        try:
            array = np.array(values, dtype=float)
        except (TypeError, ValueError) as error:
            raise self._wrong(f"the {what} is no list of numbers") from error
        if not (np.abs(array) <= _LARGEST).all():
            raise self._wrong(f"the {what} is not finite, or absurdly large")
        return array

    def _list(self, owner: dict[str, Any], name: str) -> list[dict[str, Any]]:
        values = owner.get(name)
        values = values if isinstance(values, list) else []
        if not all(isinstance(value, dict) for value in values):
            raise self._wrong(f"its {name} are no list of tables")
        return values

    def _indices(self, owner: dict[str, Any], name: str) -> tuple[int, ...]:
        """Return nodes that something refers to."""
        values = owner.get(name)
        values = tuple(values) if isinstance(values, list) else ()
        for value in values:
            self._checked(value, self._nodes, "node")
        return values

    def _checked(self, index: Any, items: list, what: str) -> Any:
        if type(index) is not int or not 0 <= index < len(items):
            raise self._wrong(f"it refers to a {what} {index!s:.20} that is not there")
        return items[index]

    def _wrong(self, what: str) -> ReadError:
        return ReadError(f"{self.path}: not readable as binary glTF: {what}. Download it again.")
