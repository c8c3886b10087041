"""Frames of a `Scene` as pictures, drawn by MuJoCo without a screen.

The model that MuJoCo compiles holds the stage and the meshes; all else is added to each frame as
unit shapes. Nothing is simulated.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from hoi_retarget.numerics import se3
from hoi_retarget.viewers.offscreen import stage
from hoi_retarget.viewers.scene.camera import Camera
from hoi_retarget.viewers.scene.drawing import Kind, Lines, Part, Scene, Shapes, Solid

Picture = UInt8[np.ndarray, "H W 3"]

_LINE_RADIUS = 0.005  # [m]
_LEAST_AREA = 1e-8  # Of a mesh that is drawn: MuJoCo refuses those without any [m^2].
_TYPES = {
    Kind.SPHERE: mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    Kind.CYLINDER: mujoco.mjtGeom.mjGEOM_CYLINDER,
    Kind.BOX: mujoco.mjtGeom.mjGEOM_BOX,
}


@contextmanager
def offscreen_renderer(scene: Scene, width: int, height: int) -> Iterator["OffscreenRenderer"]:
    """Open what draws the shown layers of a scene in pictures of a size [px], and close it again.

    Raises:
        HoiRetargetError: This machine has no way to draw without a screen.
    """
    items = [
        _Item(number, part, layer.opacity)
        for number, subject in enumerate(scene.subjects)
        for layer in subject.layers
        if layer.shown
        for part in layer.parts
        if not (isinstance(part, Solid) and _area(part) < _LEAST_AREA)
    ]
    spec = mujoco.MjSpec()
    stage.add_floor_and_lights(spec, width, height)
    solids = [item for item in items if isinstance(item.part, Solid)]
    for number, item in enumerate(solids):
        _add_mesh(spec, f"solid_{number}", item)
    compiled = spec.compile()
    room = 100 + 2 * sum(item.most_geoms for item in items)
    with stage.renderer(compiled, width, height, most_geoms=room) as renderer:
        yield OffscreenRenderer(scene, items, compiled, renderer)


@dataclass(frozen=True, eq=False)
class _Item:
    """One part of a scene, of which subject, and how it is drawn."""

    subject: int
    part: Part
    opacity: float

    @property
    def most_geoms(self) -> int:
        match self.part:
            case Shapes():
                return len(self.part.sizes)
            case Lines():
                return self.part.starts.shape[1]
            case Solid():
                return 1


class OffscreenRenderer:
    """Draws frames of one scene; made by `offscreen_renderer`."""

    def __init__(self, scene: Scene, items: list[_Item], compiled: mujoco.MjModel, renderer: mujoco.Renderer) -> None:
        self._scene, self._items, self._compiled, self._renderer = scene, items, compiled, renderer
        self._data = mujoco.MjData(compiled)
        self._options = mujoco.MjvOption()
        self._options.geomgroup[:] = 1

    def draw(self, frame: int, camera: Camera) -> Picture:
        """Draw a frame of the scene."""
        frames = [self._scene.frame_of(subject, frame) for subject in self._scene.subjects]
        mocap = 0
        for item in self._items:
            if isinstance(item.part, Solid):
                self._data.mocap_pos[mocap] = item.part.positions[frames[item.subject]]
                self._data.mocap_quat[mocap] = item.part.quats[frames[item.subject]]
                mocap += 1
        mujoco.mj_kinematics(self._compiled, self._data)
        mujoco.mj_camlight(self._compiled, self._data)
        self._renderer.update_scene(self._data, _mujoco_camera(camera), self._options)
        drawn = self._renderer.scene
        for item in self._items:
            match item.part:
                case Shapes():
                    _add_shapes(drawn, item.part, frames[item.subject], item.opacity)
                case Lines():
                    _add_lines(drawn, item.part, frames[item.subject], item.opacity)
        stage.illuminate(drawn, camera.azimuth)
        return self._renderer.render().copy()


def _mujoco_camera(camera: Camera) -> mujoco.MjvCamera:
    placed = mujoco.MjvCamera()
    placed.lookat[:] = camera.point
    placed.distance, placed.azimuth, placed.elevation = camera.distance, camera.azimuth, camera.elevation
    return placed


def _add_mesh(spec: mujoco.MjSpec, name: str, item: _Item) -> None:
    """Add a mesh on a body that is put where the frame has it."""
    part = item.part
    assert isinstance(part, Solid)
    # A single triangle has fewer vertices than MuJoCo wants.
    vertices = np.concatenate([part.vertices, part.vertices[-1:].repeat(max(0, 4 - len(part.vertices)), axis=0)])
    mesh = spec.add_mesh(name=name, uservert=np.ravel(vertices), userface=np.ravel(part.faces))
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # Objects are not all closed.
    body = spec.worldbody.add_body(name=name, mocap=True)
    rgba = [*(share / 255 for share in part.colour), item.opacity]
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, rgba=rgba, contype=0, conaffinity=0, group=0)


def _area(solid: Solid) -> float:
    a, b, c = solid.vertices[solid.faces].transpose(1, 0, 2)
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _add_shapes(drawn: mujoco.MjvScene, shapes: Shapes, frame: int, opacity: float) -> None:
    there = np.arange(len(shapes.sizes)) if shapes.visible is None else np.flatnonzero(shapes.visible[frame])
    rotations = se3.quat_to_matrix(shapes.quats[frame, there].astype(float)).reshape(-1, 9)
    places, sizes = shapes.positions[frame, there].astype(float), shapes.sizes[there]
    colours = _rgba(shapes.colours[there], opacity)
    for place, rotation, size, colour in zip(places, rotations, sizes, colours, strict=True):
        geom = drawn.geoms[drawn.ngeom]
        mujoco.mjv_initGeom(geom, _TYPES[shapes.kind], np.ones(3), place, rotation, colour)
        geom.size[:] = size
        drawn.ngeom += 1


def _add_lines(drawn: mujoco.MjvScene, lines: Lines, frame: int, opacity: float) -> None:
    capsule = mujoco.mjtGeom.mjGEOM_CAPSULE
    colours = _rgba(lines.colours[frame], opacity)
    for line in np.flatnonzero(lines.visible[frame]):
        geom = drawn.geoms[drawn.ngeom]
        mujoco.mjv_initGeom(geom, capsule, np.zeros(3), np.zeros(3), np.eye(3).ravel(), colours[line])
        start, end = lines.starts[frame, line].astype(float), lines.ends[frame, line].astype(float)
        mujoco.mjv_connector(geom, capsule, _LINE_RADIUS, start, end)
        drawn.ngeom += 1


def _rgba(colours: UInt8[np.ndarray, "N 3"], opacity: float) -> Float[np.ndarray, "N 4"]:
    return np.column_stack([colours / 255, np.full(len(colours), opacity)]).astype(np.float32)
