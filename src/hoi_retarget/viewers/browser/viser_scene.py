"""Draws a `Scene` with Viser, for a browser or for a file that a browser plays."""

from functools import cache
from typing import Protocol, runtime_checkable

import numpy as np
import trimesh
from viser import FrameHandle, SceneApi

from hoi_retarget.viewers.scene.drawing import Kind, Layer, Lines, Part, Scene, Shapes, Solid

_VANISHED = 1e-6  # Size of a copy that is not there in a frame [m].
_LINE_THICKNESS = 0.006  # [m]


@runtime_checkable
class _Drawn(Protocol):
    """A part's node; `takes` another part where it can show it without being made anew."""

    def show(self, frame: int) -> None: ...
    def takes(self, part: Part) -> bool: ...


class ViserScene:
    """The nodes of a scene in one Viser scene tree, and their poses frame by frame."""

    def __init__(self, api: SceneApi, scene: Scene, *, root: str = "") -> None:
        self._api, self._root, self._scene = api, root, scene
        self._drawn: list[dict[str, list[_Drawn]]] = []
        self._subjects: list[FrameHandle] = []
        self._layers: dict[tuple[int, str], FrameHandle] = {}
        for index, subject in enumerate(scene.subjects):
            self._subjects.append(api.add_frame(f"{root}/{index}", show_axes=False))
            self._drawn.append({})
            for layer in subject.layers:
                self._add_layer(index, layer, visible=layer.shown)
        self._frames = [-1] * len(scene.subjects)
        self.show(0)

    def show(self, frame: int) -> None:
        """Move everything to its place in a frame of the scene; what stands still sends nothing."""
        frames = [self._scene.frame_of(subject, frame) for subject in self._scene.subjects]
        for index, layers in enumerate(self._drawn):
            if frames[index] != self._frames[index]:
                for drawn in (part for parts in layers.values() for part in parts):
                    drawn.show(frames[index])
        self._frames = frames

    def redraw(self, scene: Scene) -> None:
        """Draw another scene of as many subjects with the same layers, at the same frame.

        Nodes stay where parts are as many and as large as before: a change is then a few messages.
        """
        self._scene = scene
        for index, subject in enumerate(scene.subjects):
            for layer in subject.layers:
                drawn = self._drawn[index].get(layer.name, [])
                fits = [old.takes(new) for old, new in zip(drawn, layer.parts, strict=False)]
                if not all(fits) or len(drawn) != len(layer.parts):
                    self._add_layer(index, layer, visible=self._layers[index, layer.name].visible)
        shown, self._frames = self._frames, [-1] * len(scene.subjects)
        self.show(max(shown))

    def show_layer(self, subject: int, name: str, visible: bool) -> None:
        """Show or hide a layer of a subject, if it has one of this name."""
        node = self._layers.get((subject, name))
        if node is not None:
            node.visible = visible

    def show_subject(self, subject: int, visible: bool) -> None:
        """Show or hide a subject."""
        self._subjects[subject].visible = visible

    def _add_layer(self, index: int, layer: Layer, *, visible: bool) -> None:
        name = f"{self._root}/{index}/{layer.name.replace('/', ' ')}"
        if (index, layer.name) in self._layers:
            self._layers[index, layer.name].remove()
        self._layers[index, layer.name] = self._api.add_frame(name, show_axes=False, visible=visible)
        opacity = None if layer.opacity == 1.0 else layer.opacity
        self._drawn[index][layer.name] = [
            _add_part(self._api, f"{name}/{number}", part, opacity) for number, part in enumerate(layer.parts)
        ]


def _add_part(api: SceneApi, name: str, part: Part, opacity: float | None) -> _Drawn:
    match part:
        case Shapes():
            return _Copies(api, name, part, opacity)
        case Solid():
            return _Rigid(api, name, part, opacity)
        case Lines():
            return _Segments(api, name, part)


class _Copies:
    """One message a frame for all positions, one for all rotations."""

    def __init__(self, api: SceneApi, name: str, shapes: Shapes, opacity: float | None) -> None:
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

    def takes(self, part: Part) -> bool:
        old = self._shapes
        if not isinstance(part, Shapes) or part.kind is not old.kind or not np.array_equal(part.colours, old.colours):
            return False
        self._shapes = part
        return True

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
    def __init__(self, api: SceneApi, name: str, solid: Solid, opacity: float | None) -> None:
        self._solid = solid
        self._node = api.add_mesh_simple(
            name, solid.vertices, solid.faces, color=solid.colour, opacity=opacity, flat_shading=True, side="double"
        )

    def takes(self, part: Part) -> bool:
        if not isinstance(part, Solid) or not np.array_equal(part.vertices, self._solid.vertices):
            return False
        self._solid = part
        return True

    def show(self, frame: int) -> None:
        self._node.position = self._solid.positions[frame]
        self._node.wxyz = self._solid.quats[frame]


class _Segments:
    def __init__(self, api: SceneApi, name: str, lines: Lines) -> None:
        self._lines = lines
        self._node = api.add_line_segments(name, self._points(0), self._colours(0), thickness=_LINE_THICKNESS)

    def takes(self, part: Part) -> bool:
        if not isinstance(part, Lines) or part.starts.shape[1] != self._lines.starts.shape[1]:
            return False
        self._lines = part
        return True

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
            mesh = trimesh.creation.uv_sphere(radius=1.0, count=[8, 14])
            mesh.merge_vertices()
        case Kind.CYLINDER:
            mesh = trimesh.creation.cylinder(radius=1.0, height=2.0, sections=14)
        case Kind.BOX:
            mesh = trimesh.creation.box(extents=(2.0, 2.0, 2.0))
    return np.asarray(mesh.vertices, dtype=np.float32), np.asarray(mesh.faces)
