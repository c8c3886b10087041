"""Draws a `Scene` with Viser, for a browser or for a file that a browser plays."""

from collections.abc import Collection

import numpy as np
from viser import FrameHandle, LineSegmentsHandle, MeshHandle, SceneApi

from hoi_retarget.viewers.browser.rigid_bodies import RigidBody, bodies_of, body_of
from hoi_retarget.viewers.scene.drawing import Layer, Lines, Scene, Shapes, Solid

_LINE_THICKNESS = 0.006  # [m]

_Drawn = RigidBody | Lines
_Node = MeshHandle | LineSegmentsHandle


class ViserScene:
    """The nodes of a scene in one Viser scene tree, and their poses frame by frame.

    Layers that nobody has looked at yet have no nodes, and hidden ones are sent nothing.
    """

    def __init__(self, api: SceneApi, scene: Scene, *, root: str = "") -> None:
        self._api, self._root, self._scene = api, root, scene
        self._subjects: list[FrameHandle] = []
        self._layers: dict[tuple[int, str], FrameHandle] = {}
        self._nodes: dict[tuple[int, str], list[tuple[_Node, _Drawn]]] = {}
        self._seen_through: dict[str, float] = {}
        for index, subject in enumerate(scene.subjects):
            self._subjects.append(api.add_frame(f"{root}/{index}", show_axes=False))
            for layer in subject.layers:
                name = f"{root}/{index}/{layer.name.replace('/', ' ')}"
                self._layers[index, layer.name] = api.add_frame(name, show_axes=False, visible=layer.shown)
        self._frames = [-1] * len(scene.subjects)
        self.show(0)

    def show(self, frame: int) -> None:
        """Move everything to its place in a frame of the scene; what stands still sends nothing."""
        frames = [self._scene.frame_of(subject, frame) for subject in self._scene.subjects]
        for index, subject in enumerate(self._scene.subjects):
            if frames[index] != self._frames[index]:
                for layer in subject.layers:
                    self._place_layer(index, layer, frames[index])
        self._frames = frames

    def redraw(self, scene: Scene) -> None:
        """Draw another scene of as many subjects with the same layers, at the same frame.

        Nodes stay where meshes are those of before: a change is then a few messages.
        """
        for index, subject in enumerate(scene.subjects):
            for layer in subject.layers:
                before = self._nodes.pop((index, layer.name), [])
                drawn = _drawn(layer) if before else []
                if len(before) == len(drawn) and all(map(_fits, drawn, (old for _, old in before))):
                    if before:
                        nodes = [node for node, _ in before]
                        self._nodes[index, layer.name] = list(zip(nodes, drawn, strict=True))
                else:
                    for node, _ in before:
                        node.remove()
        self._scene = scene
        shown, self._frames = self._frames, [-1] * len(scene.subjects)
        self.show(max(shown))

    def show_layer(self, name: str, visible: bool) -> None:
        """Show or hide a layer of all subjects that have one of this name."""
        for index, subject in enumerate(self._scene.subjects):
            for layer in subject.layers:
                if layer.name == name:
                    self._layers[index, name].visible = visible
                    self._place_layer(index, layer, self._frames[index])

    def see_through(self, names: Collection[str], opacity: float | None) -> None:
        """Draw the meshes of some layers with an opacity, or with that of their layer."""
        self._seen_through = dict.fromkeys(names, opacity) if opacity is not None else {}
        for (index, name), nodes in self._nodes.items():
            if name in names:
                for node, _ in nodes:
                    if isinstance(node, MeshHandle):
                        node.opacity = self._opacity(index, name)

    def _opacity(self, index: int, name: str) -> float | None:
        own = next(layer.opacity for layer in self._scene.subjects[index].layers if layer.name == name)
        return self._seen_through.get(name, None if own == 1.0 else own)

    def show_subject(self, subject: int, visible: bool) -> None:
        """Show or hide a subject."""
        self._subjects[subject].visible = visible

    def _place_layer(self, index: int, layer: Layer, frame: int) -> None:
        parent, key = self._layers[index, layer.name], (index, layer.name)
        if not parent.visible:
            return
        if key not in self._nodes:
            opacity = self._opacity(index, layer.name)
            self._nodes[key] = [
                (_add(self._api, f"{parent.name}/{number}", drawn, opacity), drawn)
                for number, drawn in enumerate(_drawn(layer))
            ]
        for node, drawn in self._nodes[key]:
            _place(node, drawn, frame)


def _drawn(layer: Layer) -> list[_Drawn]:
    """Return what a layer is drawn as."""
    found: list[_Drawn] = []
    for part in layer.parts:
        match part:
            case Shapes():
                found.extend(bodies_of(part))
            case Solid():
                found.append(body_of(part))
            case Lines():
                found.append(part)
    return found


def _add(api: SceneApi, name: str, drawn: _Drawn, opacity: float | None) -> _Node:
    match drawn:
        case RigidBody():
            return api.add_mesh_simple(
                name,
                drawn.vertices,
                drawn.faces,
                color=drawn.colour,
                opacity=opacity,
                flat_shading=drawn.faceted,
                side="front" if drawn.closed else "double",
                cast_shadow=opacity is None or not drawn.closed,
            )
        case Lines():
            return api.add_line_segments(name, _points(drawn, 0), _colours(drawn, 0), thickness=_LINE_THICKNESS)


def _fits(new: _Drawn, old: _Drawn) -> bool:
    """Return whether the node of an old part can show a new one."""
    match new, old:
        case RigidBody(), RigidBody():
            return new.fits(old)
        case Lines(), Lines():
            return new.count == old.count
    return False


def _place(node: _Node, drawn: _Drawn, frame: int) -> None:
    match node, drawn:
        case MeshHandle(), RigidBody():
            visible = drawn.visible is None or bool(drawn.visible[frame])
            if visible:
                node.position, node.wxyz = drawn.positions[frame], drawn.quats[frame]
            if visible != node.visible:
                node.visible = visible
        case LineSegmentsHandle(), Lines():
            node.points, node.colors = _points(drawn, frame), _colours(drawn, frame)


def _points(lines: Lines, frame: int) -> np.ndarray:
    starts = lines.starts[frame]
    # A line of no length is not drawn; their number has to stay the same.
    ends = np.where(lines.visible[frame, :, None], lines.ends[frame], starts)
    return np.stack([starts, ends], axis=1).astype(np.float32)


def _colours(lines: Lines, frame: int) -> np.ndarray:
    return np.repeat(lines.colours[frame, :, None], 2, axis=1)
