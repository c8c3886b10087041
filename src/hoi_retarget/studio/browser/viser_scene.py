"""Draws a `DrawnScene` with Viser, in rigid meshes with one pose a frame.

A browser applies poses and visibilities of nodes in the very frame that it draws next, and anything else, such as
poses within a batch of copies, in a later one. So every moving part is a node of its own, or hands and objects are seen
in different frames; and parts that move alike are one node, or there are hundreds.
"""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cache

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int
from viser import FrameHandle, LineSegmentsHandle, MeshHandle, SceneApi

from hoi_retarget.numerics import se3
from hoi_retarget.studio.scene.drawing import DrawnScene, Kind, Layer, Lines, Shapes, Solid

_SAMPLES = 16  # Frames that tell at first what moves alike.
_ALIKE = 1e-5  # Most that poses of one body differ by, in [m] and in parts of quaternions.


@dataclass(frozen=True, eq=False)
class RigidBody(Solid):
    """A mesh that moves over T frames as one, as a browser draws it."""

    faceted: bool = True
    """Whether edges are seen."""
    closed: bool = False
    """Whether its inside is never seen."""
    visible: Bool[np.ndarray, "T"] | None = None
    """None for always."""

    def fits(self, other: "RigidBody") -> bool:
        """Return whether another body has the same mesh."""
        return (
            (self.colour, self.faceted, self.closed) == (other.colour, other.faceted, other.closed)
            and self.vertices.shape == other.vertices.shape
            and np.allclose(self.vertices, other.vertices, rtol=0.0, atol=10 * _ALIKE)
        )


def bodies_of(shapes: Shapes) -> tuple[RigidBody, ...]:
    """Return copies of a shape as bodies: those of one colour that move alike are one."""
    return tuple(_merged(shapes, members) for members in _groups(shapes))


def _groups(shapes: Shapes) -> list[Int[np.ndarray, "_"]]:
    """Return the copies of each body, its pose's first."""
    frames = np.unique(np.linspace(0, len(shapes.positions) - 1, _SAMPLES).astype(int))
    left, groups = np.arange(shapes.count), []
    while len(left):
        alike = left[_move_alike(shapes, left, frames)]
        members = alike[_move_alike(shapes, alike, slice(None))]
        groups.append(members)
        left = np.setdiff1d(left, members)
    return groups


def _move_alike(shapes: Shapes, copies: Int[np.ndarray, "N"], frames: np.ndarray | slice) -> Bool[np.ndarray, "N"]:
    """Return which copies keep their place beside the first, have its colour and are there when it is."""
    places, turns = _beside(shapes, copies, frames)
    alike = (np.abs(places - places[:1]).max(axis=(0, 2)) < _ALIKE) & (
        np.abs(turns - turns[:1] * np.sign((turns * turns[:1]).sum(axis=2, keepdims=True))).max(axis=(0, 2)) < _ALIKE
    )
    alike &= (shapes.colours[copies] == shapes.colours[copies[0]]).all(axis=1)
    if shapes.visible is not None:
        seen = shapes.visible[frames][:, copies]
        alike &= (seen == seen[:, :1]).all(axis=0)
    alike[0] = True
    return alike


def _beside(
    shapes: Shapes, copies: Int[np.ndarray, "N"], frames: np.ndarray | slice
) -> tuple[Float[np.ndarray, "K N 3"], Float[np.ndarray, "K N 4"]]:
    """Return the poses of copies as the first of them sees them."""
    positions = shapes.positions[frames][:, copies].astype(float)
    quats = shapes.quats[frames][:, copies].astype(float)
    back = se3.quat_conjugate(quats[:, :1])
    return se3.rotate(back, positions - positions[:, :1]), se3.quat_multiply(back, quats)


def _merged(shapes: Shapes, members: Int[np.ndarray, "N"]) -> RigidBody:
    unit, faces = _unit_mesh(shapes.kind)
    places, turns = _beside(shapes, members, np.array([0]))
    vertices = places[0][:, None] + se3.rotate(turns[0][:, None], shapes.sizes[members][:, None].astype(float) * unit)
    first, (red, green, blue) = members[0], shapes.colours[members[0]].tolist()
    return RigidBody(
        vertices.reshape(-1, 3),
        np.concatenate([faces + number * len(unit) for number in range(len(members))]),
        (red, green, blue),
        shapes.positions[:, first],
        shapes.quats[:, first],
        shapes.kind is Kind.BOX,
        True,
        None if shapes.visible is None else shapes.visible[:, first],
    )


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
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


_LINE_THICKNESS = 0.006  # [m]

_Drawn = RigidBody | Lines
_Node = MeshHandle | LineSegmentsHandle


class ViserScene:
    """The nodes of a scene in one Viser scene tree, and their poses frame by frame.

    Layers that nobody has looked at yet have no nodes, and hidden ones are sent nothing.
    """

    def __init__(self, api: SceneApi, scene: DrawnScene, *, root: str = "") -> None:
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
        """Move everything to its place in a frame of the scene; resting parts send nothing."""
        frames = [self._scene.frame_of(subject, frame) for subject in self._scene.subjects]
        for index, subject in enumerate(self._scene.subjects):
            if frames[index] != self._frames[index]:
                for layer in subject.layers:
                    self._place_layer(index, layer, frames[index])
        self._frames = frames

    def redraw(self, scene: DrawnScene) -> None:
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
    """Return the bodies and lines of a layer."""
    found: list[_Drawn] = []
    for part in layer.parts:
        match part:
            case Shapes():
                found.extend(bodies_of(part))
            case Solid():
                found.append(RigidBody(part.vertices, part.faces, part.colour, part.positions, part.quats))
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
