"""Draws a `Scene` with Viser, for a browser or for a file that a browser plays."""

from collections.abc import Collection
from functools import cache

import numpy as np
import trimesh
from viser import BatchedMeshHandle, FrameHandle, LineSegmentsHandle, MeshHandle, SceneApi

from hoi_retarget.viewers.scene.drawing import Kind, Layer, Lines, Part, Scene, Shapes, Solid

_VANISHED = 1e-6  # Size of a copy that is not there in a frame [m].
_LINE_THICKNESS = 0.006  # [m]

_Node = BatchedMeshHandle | MeshHandle | LineSegmentsHandle


class ViserScene:
    """The nodes of a scene in one Viser scene tree, and their poses frame by frame."""

    def __init__(self, api: SceneApi, scene: Scene, *, root: str = "") -> None:
        self._api, self._root, self._scene = api, root, scene
        self._subjects: list[FrameHandle] = []
        self._layers: dict[tuple[int, str], FrameHandle] = {}
        self._nodes: dict[tuple[int, str], list[_Node]] = {}
        self._seen_through: dict[str, float] = {}
        for index, subject in enumerate(scene.subjects):
            self._subjects.append(api.add_frame(f"{root}/{index}", show_axes=False))
            for layer in subject.layers:
                self._add_layer(index, layer, visible=layer.shown)
        self._frames = [-1] * len(scene.subjects)
        self.show(0)

    def show(self, frame: int) -> None:
        """Move everything to its place in a frame of the scene; what stands still sends nothing."""
        frames = [self._scene.frame_of(subject, frame) for subject in self._scene.subjects]
        for index, subject in enumerate(self._scene.subjects):
            if frames[index] != self._frames[index]:
                for layer in subject.layers:
                    for node, part in zip(self._nodes[index, layer.name], layer.parts, strict=True):
                        _place(node, part, frames[index])
        self._frames = frames

    def redraw(self, scene: Scene) -> None:
        """Draw another scene of as many subjects with the same layers, at the same frame.

        Nodes stay where parts are as many and as large as before: a change is then a few messages.
        """
        for index, (before, subject) in enumerate(zip(self._scene.subjects, scene.subjects, strict=True)):
            for old, new in zip(before.layers, subject.layers, strict=True):
                fitting = list(map(_fits_node_of, new.parts, old.parts))
                if not all(fitting) or len(old.parts) != len(new.parts):
                    self._add_layer(index, new, visible=self._layers[index, new.name].visible)
        self._scene = scene
        shown, self._frames = self._frames, [-1] * len(scene.subjects)
        self.show(max(shown))

    def show_layer(self, name: str, visible: bool) -> None:
        """Show or hide a layer of all subjects that have one of this name."""
        for (_, own), node in self._layers.items():
            if own == name:
                node.visible = visible

    def see_through(self, names: Collection[str], opacity: float | None) -> None:
        """Draw the meshes of some layers with an opacity, or with that of their layer."""
        self._seen_through = dict.fromkeys(names, opacity) if opacity is not None else {}
        for (index, name), nodes in self._nodes.items():
            if name in names:
                for node in nodes:
                    if isinstance(node, MeshHandle):
                        node.opacity = self._opacity(index, name)

    def _opacity(self, index: int, name: str) -> float | None:
        own = next(layer.opacity for layer in self._scene.subjects[index].layers if layer.name == name)
        return self._seen_through.get(name, None if own == 1.0 else own)

    def show_subject(self, subject: int, visible: bool) -> None:
        """Show or hide a subject."""
        self._subjects[subject].visible = visible

    def _add_layer(self, index: int, layer: Layer, *, visible: bool) -> None:
        name, key = f"{self._root}/{index}/{layer.name.replace('/', ' ')}", (index, layer.name)
        if key in self._layers:
            self._layers[key].remove()
        self._layers[key] = self._api.add_frame(name, show_axes=False, visible=visible)
        opacity = self._opacity(index, layer.name)
        self._nodes[key] = [
            _add_part(self._api, f"{name}/{number}", part, opacity) for number, part in enumerate(layer.parts)
        ]


def _add_part(api: SceneApi, name: str, part: Part, opacity: float | None) -> _Node:
    match part:
        case Shapes():
            return api.add_batched_meshes_simple(
                name,
                *_unit_mesh(part.kind),
                part.quats[0],
                part.positions[0],
                batched_scales=_sizes(part, 0),
                batched_colors=part.colours,
                opacity=opacity,
                lod="off",
                flat_shading=part.kind is Kind.BOX,
                cast_shadow=opacity is None,
            )
        case Solid():
            return api.add_mesh_simple(
                name, part.vertices, part.faces, color=part.colour, opacity=opacity, flat_shading=True, side="double"
            )
        case Lines():
            return api.add_line_segments(name, _points(part, 0), _colours(part, 0), thickness=_LINE_THICKNESS)


def _fits_node_of(new: Part, old: Part) -> bool:
    """Return whether the node of an old part can show a new one."""
    match new, old:
        case Shapes(), Shapes():
            return new.kind is old.kind and np.array_equal(new.colours, old.colours)
        case Solid(), Solid():
            return np.array_equal(new.vertices, old.vertices)
        case Lines(), Lines():
            return new.count == old.count
    return False


def _place(node: _Node, part: Part, frame: int) -> None:
    """Show a part in a frame; of many copies, all positions are one message and all rotations another."""
    match node, part:
        case BatchedMeshHandle(), Shapes():
            node.batched_positions = part.positions[frame].astype(np.float32)
            node.batched_wxyzs = part.quats[frame].astype(np.float32)
            if part.visible is not None:
                node.batched_scales = _sizes(part, frame)
        case MeshHandle(), Solid():
            node.position, node.wxyz = part.positions[frame], part.quats[frame]
        case LineSegmentsHandle(), Lines():
            node.points, node.colors = _points(part, frame), _colours(part, frame)


def _sizes(shapes: Shapes, frame: int) -> np.ndarray:
    visible = True if shapes.visible is None else shapes.visible[frame, :, None]
    return np.where(visible, shapes.sizes, _VANISHED).astype(np.float32)


def _points(lines: Lines, frame: int) -> np.ndarray:
    starts = lines.starts[frame]
    # A line of no length is not drawn; their number has to stay the same.
    ends = np.where(lines.visible[frame, :, None], lines.ends[frame], starts)
    return np.stack([starts, ends], axis=1).astype(np.float32)


def _colours(lines: Lines, frame: int) -> np.ndarray:
    return np.repeat(lines.colours[frame, :, None], 2, axis=1)


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
