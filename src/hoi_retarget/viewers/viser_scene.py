"""Draws a `Scene` with Viser, for a browser or for a file that a browser plays."""

from collections.abc import Iterator
from functools import cache
from typing import TYPE_CHECKING, Protocol

import numpy as np
import trimesh

from hoi_retarget.viewers.drawing import Kind, Layer, Lines, Part, Scene, Shapes, Solid

if TYPE_CHECKING:
    from viser import FrameHandle, SceneApi

_VANISHED = 1e-6  # Size of a copy that is not there in a frame [m].
_LINE_THICKNESS = 0.006  # [m]


class _Drawn(Protocol):
    def show(self, frame: int) -> None: ...


class ViserScene:
    """The nodes of a scene in one Viser scene tree, and their poses frame by frame."""

    def __init__(self, api: "SceneApi", scene: Scene, *, root: str = "") -> None:
        self._scene = scene
        self._drawn: list[tuple[int, _Drawn]] = []
        self._layers: dict[tuple[int, str], FrameHandle] = {}
        self._frames = np.full(len(scene.subjects), -1)
        for index, subject in enumerate(scene.subjects):
            for number, layer in enumerate(subject.layers):
                name = f"{root}/{index}/{number}"
                node = api.add_frame(name, show_axes=False, visible=layer.shown)
                self._layers[index, layer.name] = node
                self._drawn += [(index, drawn) for drawn in _add_layer(api, name, layer)]
        self.show(0)

    def show(self, frame: int) -> None:
        """Move everything to its place in a frame of the scene; what stands still sends nothing."""
        frames = np.array([self._scene.frame_of(subject, frame) for subject in self._scene.subjects])
        for index, drawn in self._drawn:
            if frames[index] != self._frames[index]:
                drawn.show(int(frames[index]))
        self._frames = frames

    def show_layer(self, subject: int, name: str, visible: bool) -> None:
        """Show or hide a layer of a subject, if it has one of this name."""
        node = self._layers.get((subject, name))
        if node is not None:
            node.visible = visible


def _add_layer(api: "SceneApi", name: str, layer: Layer) -> Iterator[_Drawn]:
    for number, part in enumerate(layer.parts):
        yield _add_part(api, f"{name}/{number}", part, None if layer.opacity == 1.0 else layer.opacity)


def _add_part(api: "SceneApi", name: str, part: Part, opacity: float | None) -> _Drawn:
    match part:
        case Shapes():
            return _Copies(api, name, part, opacity)
        case Solid():
            return _Rigid(api, name, part, opacity)
        case Lines():
            return _Segments(api, name, part)


class _Copies:
    """One message a frame for all positions, one for all rotations."""

    def __init__(self, api: "SceneApi", name: str, shapes: Shapes, opacity: float | None) -> None:
        self._shapes = shapes
        vertices, faces = _unit_mesh(shapes.kind)
        self._node = api.add_batched_meshes_simple(
            name,
            vertices,
            faces,
            shapes.quats[0],
            shapes.positions[0],
            batched_scales=self._sizes(0),
            batched_colors=shapes.colours,
            opacity=opacity,
            lod="off",
            flat_shading=shapes.kind is Kind.BOX,
            cast_shadow=opacity is None,
        )

    def _sizes(self, frame: int) -> np.ndarray:
        if self._shapes.visible is None:
            return self._shapes.sizes.astype(np.float32)
        return np.where(self._shapes.visible[frame, :, None], self._shapes.sizes, _VANISHED).astype(np.float32)

    def show(self, frame: int) -> None:
        self._node.batched_positions = self._shapes.positions[frame].astype(np.float32)
        self._node.batched_wxyzs = self._shapes.quats[frame].astype(np.float32)
        visible = self._shapes.visible
        if visible is not None:
            self._node.batched_scales = self._sizes(frame)


class _Rigid:
    def __init__(self, api: "SceneApi", name: str, solid: Solid, opacity: float | None) -> None:
        self._solid = solid
        self._node = api.add_mesh_simple(
            name, solid.vertices, solid.faces, color=solid.colour, opacity=opacity, flat_shading=True, side="double"
        )

    def show(self, frame: int) -> None:
        self._node.position = self._solid.positions[frame]
        self._node.wxyz = self._solid.quats[frame]


class _Segments:
    def __init__(self, api: "SceneApi", name: str, lines: Lines) -> None:
        self._lines = lines
        self._node = api.add_line_segments(name, self._points(0), self._colours(0), thickness=_LINE_THICKNESS)

    def _points(self, frame: int) -> np.ndarray:
        starts = self._lines.starts[frame]
        # A line of no length is not drawn; their number has to stay the same.
        ends = np.where(self._lines.visible[frame, :, None], self._lines.ends[frame], starts)
        return np.stack([starts, ends], axis=1).astype(np.float32)

    def _colours(self, frame: int) -> np.ndarray:
        return np.repeat(self._lines.colours[frame, :, None], 2, axis=1)

    def show(self, frame: int) -> None:
        self._node.points = self._points(frame)
        self._node.colors = self._colours(frame)


@cache
def _unit_mesh(kind: Kind) -> tuple[np.ndarray, np.ndarray]:
    match kind:
        case Kind.SPHERE:
            mesh = trimesh.creation.icosphere(subdivisions=2)
        case Kind.CYLINDER:
            mesh = trimesh.creation.cylinder(radius=1.0, height=2.0, sections=24)
        case Kind.BOX:
            mesh = trimesh.creation.box(extents=(2.0, 2.0, 2.0))
    return np.asarray(mesh.vertices, dtype=np.float32), np.asarray(mesh.faces)
