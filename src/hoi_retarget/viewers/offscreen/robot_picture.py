"""A still picture of a robot in a pose, drawn off-screen: from the front and from the side."""

import io
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from hoi_retarget.errors import ArgumentError, HoiRetargetError
from hoi_retarget.robots.model import load_model
from hoi_retarget.robots.spec import RobotSpec
from hoi_retarget.viewers.offscreen.renderer import offscreen_renderer
from hoi_retarget.viewers.scene.camera import CameraSettings, cameras
from hoi_retarget.viewers.scene.drawing import Layer, Scene, Subject
from hoi_retarget.viewers.scene.robot_shapes import robot_parts

FRONT_AND_SIDE = (CameraSettings(155.0, -8.0), CameraSettings(90.0, -4.0))
_ASPECT = 0.62  # Of a panel.


def picture(
    spec: RobotSpec,
    qpos: Float[np.ndarray, "nq"] | None = None,
    *,
    meshes: Path | None = None,
    views: tuple[CameraSettings, ...] = FRONT_AND_SIDE,
    height: int = 800,
) -> UInt8[np.ndarray, "H W 3"]:
    """Draw a robot on a floor, one panel per view, side by side.

    Args:
        spec: The robot.
        qpos: Its configuration, root first; the home pose where none is given.
        meshes: Folder with the vendor's mesh files (`spec.meshes`), or with folders that hold them;
            without it those that were fetched, or the primitives of the MJCF.
        views: One panel each, from left to right.
        height: Of the picture [px]; a panel is 0.62 times as wide.

    Returns:
        The picture as red, green, blue.

    Raises:
        ReadError: A mesh file is missing, or MuJoCo cannot read it.
        DrawingError: This machine has no way to draw without a screen.
    """
    model = load_model(spec)
    pose = model.home_qpos if qpos is None else qpos
    if pose.shape != model.home_qpos.shape:
        raise ArgumentError(f"{spec.name}: a configuration has {len(model.home_qpos)} numbers, not {pose.shape}.")
    robot = Layer("robot", robot_parts(model, model.forward(pose[None]), meshes))
    scene = Scene((Subject(spec.title, 1.0, (robot,), pose[None, :3]),))
    width = round(_ASPECT * height)
    with offscreen_renderer(scene, width, height) as draw:
        panels = [draw(0, cameras([scene], view, _ASPECT)[0](0)) for view in views]
    return np.concatenate(panels, axis=1)


def png(pixels: UInt8[np.ndarray, "H W 3"]) -> bytes:
    """Return a picture as the bytes of a PNG file.

    Raises:
        HoiRetargetError: Pillow, which writes it, is not installed.
    """
    return _encoded(pixels, format="PNG", optimize=True)


def jpeg(pixels: UInt8[np.ndarray, "H W 3"]) -> bytes:
    """Return a picture as the bytes of a JPEG file, smaller and made faster than a PNG; raises as `png`."""
    return _encoded(pixels, format="JPEG", quality=90, subsampling=0)


def _encoded(pixels: UInt8[np.ndarray, "H W 3"], **options: Any) -> bytes:
    try:
        from PIL import Image  # noqa: PLC0415 # pyright: ignore[reportMissingImports] - optional
    except ImportError as error:
        raise HoiRetargetError("Writing a picture needs Pillow: pip install pillow.") from error
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, **options)
    return buffer.getvalue()
