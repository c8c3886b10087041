"""A still picture of a robot in a pose, drawn off-screen: from the front and from the side."""

import io
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from hoi_retarget.errors import ArgumentError, HoiRetargetError, ReadError
from hoi_retarget.robots.mjcf import read_mjcf
from hoi_retarget.robots.spec import RobotSpec
from hoi_retarget.viewers.offscreen import stage
from hoi_retarget.viewers.scene.vendor_meshes import MESH_GROUP, attach_visual_meshes

_OWN_GROUP = 0


@dataclass(frozen=True)
class ViewAngles:
    """Where the camera stands, around the robot."""

    azimuth: float
    """[deg]; 180 looks the robot in the face."""
    elevation: float
    """[deg]; negative looks down."""


FRONT_AND_SIDE = (ViewAngles(155.0, -8.0), ViewAngles(90.0, -4.0))


def picture(
    spec: RobotSpec,
    qpos: Float[np.ndarray, "nq"] | None = None,
    *,
    meshes: Path | None = None,
    views: tuple[ViewAngles, ...] = FRONT_AND_SIDE,
    height: int = 800,
) -> UInt8[np.ndarray, "H W 3"]:
    """Draw a robot on a floor, one panel per view, side by side.

    Args:
        spec: The robot.
        qpos: Its configuration, root first; the home pose where none is given.
        meshes: Folder with the vendor's mesh files (`spec.meshes`), or with folders that hold them;
            without it the robot is drawn from the primitives of its MJCF.
        views: One panel each, from left to right.
        height: Of the picture [px]; a panel is 0.62 times as wide.

    Returns:
        The picture as red, green, blue.

    Raises:
        ReadError: A mesh file is missing, or MuJoCo cannot read it.
        HoiRetargetError: This machine has no way to draw without a screen.
    """
    width = round(0.62 * height)
    description = read_mjcf(spec.mjcf, spec.sites)
    stage.add_floor_and_lights(description, width, height)
    if meshes is not None:
        attach_visual_meshes(description, spec, meshes)
    try:
        compiled = description.compile()
    except ValueError as error:
        raise ReadError(f"{meshes or spec.mjcf}: MuJoCo cannot compile the robot for a picture: {error}") from error
    data = mujoco.MjData(compiled)
    _pose(compiled, data, spec, qpos)
    option = mujoco.MjvOption()
    option.geomgroup[:] = 0
    option.geomgroup[[stage.GROUP, _OWN_GROUP if meshes is None else MESH_GROUP]] = 1
    option.sitegroup[:] = 0
    with stage.renderer(compiled, width, height) as renderer:
        panels = []
        for view in views:
            renderer.update_scene(data, _camera(compiled, data, view), option)
            stage.illuminate(renderer.scene, view.azimuth)
            panels.append(renderer.render().copy())
    return np.concatenate(panels, axis=1)


def png(pixels: UInt8[np.ndarray, "H W 3"]) -> bytes:
    """Return a picture as the bytes of a PNG file.

    Raises:
        HoiRetargetError: Pillow, which writes it, is not installed.
    """
    try:
        from PIL import Image  # noqa: PLC0415 # pyright: ignore[reportMissingImports] - optional
    except ImportError as error:
        raise HoiRetargetError("Writing a picture needs Pillow: pip install pillow.") from error
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


def _pose(compiled: mujoco.MjModel, data: mujoco.MjData, spec: RobotSpec, qpos: Float[np.ndarray, "nq"] | None) -> None:
    if qpos is None:
        for joint, angle in spec.home.items():
            data.joint(joint).qpos = angle
    elif qpos.shape == (compiled.nq,):
        data.qpos[:] = qpos
    else:
        raise ArgumentError(f"{spec.name}: a configuration has {compiled.nq} numbers, not {qpos.shape}.")
    mujoco.mj_forward(compiled, data)


def _camera(compiled: mujoco.MjModel, data: mujoco.MjData, view: ViewAngles) -> mujoco.MjvCamera:
    """Place the camera so that the robot fills the panel, whatever its pose."""
    geoms = [geom for geom in range(compiled.ngeom) if compiled.geom_group[geom] == _OWN_GROUP]
    reach = compiled.geom_rbound[geoms][:, None]
    low = (data.geom_xpos[geoms] - reach).min(axis=0)
    high = (data.geom_xpos[geoms] + reach).max(axis=0)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = 0.5 * (low + high)
    # MuJoCo's field of view is 45 degrees high, and a panel 0.62 times as wide.
    tall, wide = high[2] - low[2], float(np.linalg.norm((high - low)[:2]))
    camera.distance = 1.05 * max(tall, wide / 0.62) / (2 * np.tan(np.radians(22.5))) + 0.25 * wide
    camera.azimuth, camera.elevation = view.azimuth, view.elevation
    return camera
