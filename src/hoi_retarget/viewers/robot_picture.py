"""A still picture of a robot in a pose, drawn off-screen: from the front and from the side."""

import io
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from hoi_retarget.errors import ArgumentError, HoiRetargetError, ReadError, RobotError
from hoi_retarget.robots.spec import RobotSpec
from hoi_retarget.viewers import stage

_OWN_GROUP, _MESH_GROUP = 0, 2
_LIGHT, _DARK = (0.78, 0.79, 0.8, 1.0), (0.16, 0.16, 0.18, 1.0)


@dataclass(frozen=True)
class View:
    """Where the camera stands, around the robot."""

    azimuth: float
    """[deg]; 180 looks the robot in the face."""
    elevation: float
    """[deg]; negative looks down."""


FRONT_AND_SIDE = (View(155.0, -8.0), View(90.0, -4.0))


def picture(
    spec: RobotSpec,
    qpos: Float[np.ndarray, "nq"] | None = None,
    *,
    meshes: Path | None = None,
    views: tuple[View, ...] = FRONT_AND_SIDE,
    height: int = 800,
) -> UInt8[np.ndarray, "H W 3"]:
    """Draw a robot on a floor, one panel per view, side by side.

    Args:
        spec: The robot.
        qpos: Its configuration, root first; the home pose where none is given.
        meshes: Folder with the maker's mesh files (`spec.meshes`), or with folders that hold them;
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
    description = mujoco.MjSpec.from_file(str(spec.mjcf))
    stage.furnish(description, width, height)
    if meshes is not None:
        _dress(description, spec, meshes)
    try:
        compiled = description.compile()
    except ValueError as error:
        raise ReadError(f"{meshes or spec.mjcf}: MuJoCo cannot compile the robot for a picture: {error}") from error
    data = mujoco.MjData(compiled)
    _pose(compiled, data, spec, qpos)
    option = mujoco.MjvOption()
    option.geomgroup[:] = 0
    option.geomgroup[[stage.GROUP, _OWN_GROUP if meshes is None else _MESH_GROUP]] = 1
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


def menagerie_meshes(spec: RobotSpec) -> Path:
    """Return the folder of a robot's meshes from MuJoCo Menagerie, for `picture(meshes=...)`.

    The optional package `mujoco-menagerie` downloads them on first use and keeps them in its cache.

    Raises:
        ArgumentError: Menagerie does not have this robot.
        HoiRetargetError: The package is not installed, or the download failed.
    """
    try:
        import mujoco_menagerie  # noqa: PLC0415 # pyright: ignore[reportMissingImports] - optional
    except ImportError as error:
        raise HoiRetargetError(
            "The meshes of MuJoCo Menagerie need its package: pip install '.[menagerie]' in a clone."
        ) from error
    try:
        return mujoco_menagerie.get(spec.name).path(progress=None)
    except mujoco_menagerie.UnknownRobotError as error:
        raise ArgumentError(
            f"MuJoCo Menagerie has no {spec.name}. Give the folder of the maker's meshes, or draw the primitives."
        ) from error
    except mujoco_menagerie.MenagerieError as error:
        raise HoiRetargetError(f"MuJoCo Menagerie could not provide {spec.name}: {error}") from error


def _dress(description: mujoco.MjSpec, spec: RobotSpec, folder: Path) -> None:
    """Add the maker's meshes to the bodies.

    A mesh lies in its body's frame, or where the MJCF has a site `mesh_FILE`. It looks like the first
    primitive of its body; what is put on (head, logo, hands: what has such a site) is drawn dark.
    """
    if not spec.meshes:
        raise RobotError(f"{spec.name}: its specification names no mesh files, so only its primitives can be drawn.")
    found = {path.name: path for path in sorted(folder.rglob("*")) if path.is_file()}
    missing = [file for files in spec.meshes.values() for file in files if file not in found]
    if missing:
        shown = ", ".join(missing[:4]) + (", ..." if len(missing) > 4 else "")
        raise ReadError(f"{folder}: {len(missing)} mesh files of {spec.title} are not there: {shown}.")
    places = {site.name: site for site in description.sites}
    for body, files in spec.meshes.items():
        own = description.body(body).first_geom()
        for file in files:
            stem = Path(file).stem
            description.add_mesh(name=f"maker_{stem}", file=str(found[file].resolve()))
            place = places.get(f"mesh_{stem}")
            description.body(body).add_geom(
                type=mujoco.mjtGeom.mjGEOM_MESH,
                meshname=f"maker_{stem}",
                pos=place.pos if place is not None else [0, 0, 0],
                quat=place.quat if place is not None else [1, 0, 0, 0],
                rgba=_DARK if place is not None or (own is not None and own.material == "dark") else _LIGHT,
                group=_MESH_GROUP,
                contype=0,
                conaffinity=0,
                density=0,
            )


def _pose(compiled: mujoco.MjModel, data: mujoco.MjData, spec: RobotSpec, qpos: Float[np.ndarray, "nq"] | None) -> None:
    if qpos is None:
        for joint, angle in spec.home.items():
            data.joint(joint).qpos = angle
    elif qpos.shape == (compiled.nq,):
        data.qpos[:] = qpos
    else:
        raise ArgumentError(f"{spec.name}: a configuration has {compiled.nq} numbers, not {qpos.shape}.")
    mujoco.mj_forward(compiled, data)


def _camera(compiled: mujoco.MjModel, data: mujoco.MjData, view: View) -> mujoco.MjvCamera:
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
