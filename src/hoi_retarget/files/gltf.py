"""Reads binary glTF 2.0 files (`.glb`) with their animations, through pygltflib: nodes over time, meshes, bind poses.

pygltflib gives the tables of a file; what they say of its bytes is checked and decoded here. Values are of the file's
world: y up, metres.
"""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, is_dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.errors import ReadError
from hoi_retarget.numerics import se3

MAGIC = b"glTF"
MISSING = (
    '.glb files are read with pygltflib, which is not installed. In a clone: pip install ".[humoto]"; '
    'otherwise: pip install "pygltflib>=1.16".'
)
ChannelPath = Literal["translation", "rotation", "scale"]
"""What of a node is animated, as glTF calls it."""

_HEADER = 20  # Bytes before the text of a `.glb` file; the last eight tell the text's length and kind.
_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_WIDTH_OF: dict[ChannelPath, int] = {"translation": 3, "rotation": 4, "scale": 3}
_TRIANGLES = 4
_UNEVEN = 0.01
"""Part by which a scale's three numbers may differ, or change over time, and still be one number."""
_ON_FRAME = 0.05
"""[frames]; keys this near a frame are on it: times are stored in single precision."""
_LARGEST = 1e6  # Of any number; damage stays a number otherwise.


def text_of(content: bytes) -> bytes:
    """Return the text of a `.glb` file, in which all names stand; empty where it is none."""
    if not content.startswith(MAGIC):
        return b""
    return content[_HEADER : _HEADER + int.from_bytes(content[12:16], "little")]


@dataclass(frozen=True, eq=False)
class Channel:
    """What an animation does with one of a node's three values."""

    node: int
    path: ChannelPath
    times: Float[np.ndarray, "K"]
    """Ascending [s]."""
    values: Float[np.ndarray, "K w"]
    """Rotations are wxyz."""
    steps: bool
    """Whether values stay until the next one; otherwise they go there evenly."""

    @property
    def constant(self) -> bool:
        """Whether it is the same value all the time."""
        return bool((self.values == self.values[0]).all())

    def at(self, frames: Float[np.ndarray, "T"], rate: float) -> Float[np.ndarray, "T w"]:
        """Return the values at frames of `rate` frames a second, held before the first key and after the last."""
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
    quats: Float[np.ndarray, "T N 4"]
    """wxyz"""
    scales: Float[np.ndarray, "T N"]


class Gltf:
    """A file's nodes, animations, meshes and skins; raises `ReadError` where they contradict each other."""

    def __init__(self, path: Path, content: bytes) -> None:
        self.path = path
        document = _document(path, content)
        self._blob = document.binary_blob() or b""
        if getattr(document, "extensionsRequired", None):
            raise self._wrong(f"it needs extensions of glTF ({document.extensionsRequired!s:.80})")
        self._nodes = self._list(document, "nodes")
        self._animations = self._list(document, "animations")
        self._meshes, self._skins = self._list(document, "meshes"), self._list(document, "skins")
        self._accessors, self._views = self._list(document, "accessors"), self._list(document, "bufferViews")
        self.names = tuple(
            str(getattr(node, "name", None) or f"node {index}") for index, node in enumerate(self._nodes)
        )
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
        mesh, skin = self._nodes[node].mesh, self._nodes[node].skin
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
        stored = getattr(self._nodes[node], path, None)
        if getattr(self._nodes[node], "matrix", None) is not None:
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
                node, path = getattr(item.target, "node", None), getattr(item.target, "path", None)
                if path not in _WIDTH_OF or node is None:
                    continue  # Weights of morph targets.
                self._checked(node, self._nodes, "node")
                if (node, path) in known:
                    raise self._wrong(f"the {path} of node {self.names[node]!r} is animated twice; export one action")
                known.add((node, path))
                channels.append(self._channel(node, path, self._checked(item.sampler, samplers, "sampler")))
        return tuple(channels)

    def _channel(self, node: int, path: ChannelPath, sampler: Any) -> Channel:
        what = f"the {path} of node {self.names[node]!r}"
        if sampler.interpolation not in (None, "LINEAR", "STEP"):
            raise self._wrong(f"{what} is interpolated by {sampler.interpolation!s:.20}, expected LINEAR or STEP")
        times = self.array(sampler.input, 1, f"times of {what}")[:, 0].astype(float)
        values = self.array(sampler.output, _WIDTH_OF[path], what).astype(float)
        if len(times) == 0 or len(times) != len(values):
            raise self._wrong(f"{what} has {len(times)} times and {len(values)} values")
        if (np.diff(times) <= 0).any():
            raise self._wrong(f"the times of {what} do not ascend")
        values = self._wxyz(values) if path == "rotation" else values
        return Channel(node, path, times, values, steps=sampler.interpolation == "STEP")

    # Meshes and skins

    def mesh(self, index: int) -> tuple[Float[np.ndarray, "V 3"], Int[np.ndarray, "F 3"]]:
        """Return the vertices and triangles of a mesh, all its parts in one."""
        mesh = self._checked(index, self._meshes, "mesh")
        vertices, faces, count = [], [], 0
        for part in self._list(mesh, "primitives"):
            if part.mode not in (None, _TRIANGLES):
                raise self._wrong(f"mesh {mesh.name!s:.40} has points or lines, expected triangles")
            corner = getattr(part.attributes, "POSITION", None)
            points = self.array(corner, 3, f"vertices of mesh {mesh.name!s:.40}").astype(float)
            corners = np.arange(len(points))
            if part.indices is not None:
                corners = self.array(part.indices, 1, f"triangles of mesh {mesh.name!s:.40}")[:, 0].astype(np.int64)
            if len(corners) % 3 or (corners >= len(points)).any() or (corners < 0).any():
                raise self._wrong(f"the triangles of mesh {mesh.name!s:.40} are of vertices that are not there")
            vertices.append(points)
            faces.append(corners.reshape(-1, 3) + count)
            count += len(points)
        if not vertices or not sum(map(len, faces)):
            raise self._wrong(f"mesh {mesh.name!s:.40} has no triangles")
        return np.concatenate(vertices), np.concatenate(faces)

    def skins(self) -> Iterator[tuple[tuple[int, ...], Float[np.ndarray, "J 4 4"]]]:
        """Yield the joints of each skin and the matrices that bring the bound mesh into their frames."""
        for skin in self._skins:
            joints = self._indices(skin, "joints")
            if skin.inverseBindMatrices is None:
                raise self._wrong("a skin has no inverse bind matrices; export it with its bind pose")
            columns = self.array(skin.inverseBindMatrices, 16, "inverse bind matrices").astype(float)
            if len(columns) != len(joints):
                raise self._wrong(f"a skin has {len(joints)} joints and {len(columns)} inverse bind matrices")
            yield joints, columns.reshape(-1, 4, 4).transpose(0, 2, 1)

    # Bytes

    def array(self, index: Any, width: int, meaning: str) -> np.ndarray:
        """Return what an accessor shows of the file's bytes, (count, width)."""
        accessor = self._checked(index, self._accessors, f"accessor of {meaning}")
        if accessor.sparse is not None or accessor.bufferView is None:
            raise self._wrong(f"{meaning}: stored sparsely or compressed; export without compression")
        kind = np.dtype(f"<{_COMPONENTS.get(accessor.componentType, 'V1')}")
        if kind.kind == "V" or _WIDTHS.get(accessor.type) != width:
            raise self._wrong(f"{meaning}: stored as {accessor.type!s:.10} of kind {accessor.componentType!s:.10}")
        if kind.kind != "f" and accessor.normalized:
            raise self._wrong(f"{meaning}: stored as fractions in whole numbers; export without quantization")
        view = self._checked(accessor.bufferView, self._views, "buffer view")
        if view.buffer != 0:
            raise self._wrong(f"{meaning}: stored in another file; export one binary file")
        size = kind.itemsize * width
        places = (accessor.count, view.byteStride or size, view.byteOffset or 0, accessor.byteOffset or 0)
        if not all(type(place) is int and place >= 0 for place in places) or places[1] < size:
            raise self._wrong(f"{meaning}: its place in the file is no number")
        count, stride, first = *places[:2], sum(places[2:])
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

    def _list(self, owner: Any, name: str) -> list:
        values = getattr(owner, name, None)
        values = values if isinstance(values, list) else []
        if not all(is_dataclass(value) for value in values):
            raise self._wrong(f"its {name} are no list of tables")
        return values

    def _indices(self, owner: Any, name: str) -> tuple[int, ...]:
        """Return nodes that something refers to."""
        values = getattr(owner, name, None)
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


def _document(path: Path, content: bytes) -> Any:
    """Return pygltflib's tables of a file; raises `ReadError`."""
    try:
        import pygltflib  # noqa: PLC0415 # pyright: ignore[reportMissingImports] - optional
    except ImportError as error:
        raise ReadError(f"{path}: {MISSING}") from error
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            document = pygltflib.GLTF2.load_from_bytes(content)
    except Exception as error:  # pygltflib and what it calls raise anything on damaged files
        raise ReadError(f"{path}: not readable as binary glTF ({error!s:.200}). Download it again.") from error
    if document is None:
        raise ReadError(f"{path}: not readable as binary glTF: it has no text. Download it again.")
    return document
