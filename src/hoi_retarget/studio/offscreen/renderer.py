"""Frames of a `Scene` as pictures, drawn by MuJoCo without a screen.

The model that MuJoCo compiles holds the stage and the meshes; all else is added to each frame as
unit shapes. Nothing is simulated.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from hoi_retarget.numerics import se3
from hoi_retarget.studio.offscreen import stage
from hoi_retarget.studio.offscreen.stage import Quality
from hoi_retarget.studio.scene.camera import Camera
from hoi_retarget.studio.scene.drawing import DrawnScene, Kind, Lines, Shapes, Solid

Picture = UInt8[np.ndarray, "H W 3"]

_LINE_RADIUS = 0.005  # [m]
_LEAST_AREA = 1e-8  # Of a mesh that is drawn: MuJoCo refuses those without any [m^2].
_TYPES = {
    Kind.SPHERE: mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    Kind.CYLINDER: mujoco.mjtGeom.mjGEOM_CYLINDER,
    Kind.BOX: mujoco.mjtGeom.mjGEOM_BOX,
}


@contextmanager
def offscreen_renderer(
    scene: DrawnScene, width: int, height: int, quality: Quality = stage.FINE
) -> Iterator[Callable[[int, Camera], Picture]]:
    """Open a function that draws a frame of a scene's shown layers.

    Raises `DrawingError` where this machine has no way to draw without a screen.

    `scene`: the scene; `width`: of a picture [px]; `height`: of a picture [px]; `quality`: smoothness of edges and
    round shapes.
    """
    with filled_renderer(scene, width, height, quality) as (renderer, fill):

        def draw(frame: int, camera: Camera) -> Picture:
            stage.cast_shadows(renderer.scene, fill(frame, camera))
            return renderer.render().copy()

        yield draw


@contextmanager
def filled_renderer(
    scene: DrawnScene, width: int, height: int, quality: Quality = stage.FINE
) -> Iterator[tuple[mujoco.Renderer, Callable[[int, Camera], Float[np.ndarray, "3"]]]]:
    """Open a renderer, and a function that fills it with a lit frame and returns the unit vector of the sun's light.

    Arguments and errors are those of `offscreen_renderer`.
    """
    stage.check_can_draw()
    layers = [
        (number, layer) for number, subject in enumerate(scene.subjects) for layer in subject.layers if layer.shown
    ]
    items = [(number, part, layer.opacity) for number, layer in layers for part in layer.parts]
    solids = [
        (number, part, opacity)
        for number, part, opacity in items
        if isinstance(part, Solid) and _area(part) >= _LEAST_AREA
    ]
    spec = mujoco.MjSpec()
    stage.add_floor_and_lights(spec, width, height, quality)
    for index, (_, solid, opacity) in enumerate(solids):
        _add_mesh(spec, f"solid_{index}", solid, opacity)
    compiled = spec.compile()
    data, options = mujoco.MjData(compiled), mujoco.MjvOption()
    options.geomgroup[:] = 1
    seen_from = mujoco.MjvCamera()
    room = 100 + 2 * sum(part.count for _, part, _ in items)
    with mujoco.Renderer(compiled, height, width, max_geom=room) as renderer:

        def fill(frame: int, camera: Camera) -> Float[np.ndarray, "3"]:
            frames = [scene.frame_of(subject, frame) for subject in scene.subjects]
            for index, (number, solid, _) in enumerate(solids):
                data.mocap_pos[index] = solid.positions[frames[number]]
                data.mocap_quat[index] = solid.quats[frames[number]]
            mujoco.mj_kinematics(compiled, data)
            mujoco.mj_camlight(compiled, data)
            seen_from.lookat[:], seen_from.distance = camera.point, camera.distance
            seen_from.azimuth, seen_from.elevation = camera.azimuth, camera.elevation
            renderer.update_scene(data, seen_from, options)
            for number, part, opacity in items:
                match part:
                    case Shapes():
                        _add_shapes(renderer.scene, part, frames[number], opacity)
                    case Lines():
                        _add_lines(renderer.scene, part, frames[number], opacity)
            return stage.illuminate(renderer.scene, camera.azimuth)

        yield renderer, fill


def _add_mesh(spec: mujoco.MjSpec, name: str, solid: Solid, opacity: float) -> None:
    """Add a mesh on a body that is put where the frame has it."""
    # A single triangle has fewer vertices than MuJoCo wants.
    vertices = np.concatenate([solid.vertices, solid.vertices[-1:].repeat(max(0, 4 - len(solid.vertices)), axis=0)])
    mesh = spec.add_mesh(name=name, uservert=np.ravel(vertices), userface=np.ravel(solid.faces))
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # Objects are not all closed.
    body = spec.worldbody.add_body(name=name, mocap=True)
    rgba = [*(share / 255 for share in solid.colour), opacity]
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
