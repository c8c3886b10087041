"""The vendor meshes of a robot, for pictures: from a folder of the user's, or from MuJoCo Menagerie.

The package ships none of them. They are drawn in the place of the primitives, which stay what the
robot is computed with.
"""

from pathlib import Path

import mujoco

from hoi_retarget.errors import ArgumentError, HoiRetargetError, ReadError, RobotError
from hoi_retarget.robots.spec import RobotSpec

MESH_GROUP = 2
"""The geometry group of the meshes."""
_LIGHT, _DARK = (0.78, 0.79, 0.8, 1.0), (0.16, 0.16, 0.18, 1.0)


def attach_visual_meshes(description: mujoco.MjSpec, spec: RobotSpec, folder: Path) -> None:
    """Add the vendor meshes to the bodies.

    A mesh lies in its body's frame, or where the MJCF has a site `mesh_FILE`. It looks like the first
    primitive of its body; what is put on (head, logo, hands: what has such a site) is drawn dark.

    Raises:
        RobotError: The robot's specification names no meshes.
        ReadError: A mesh file is missing.
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
            description.add_mesh(name=f"vendor_{stem}", file=str(found[file].resolve()))
            place = places.get(f"mesh_{stem}")
            description.body(body).add_geom(
                type=mujoco.mjtGeom.mjGEOM_MESH,
                meshname=f"vendor_{stem}",
                pos=place.pos if place is not None else [0, 0, 0],
                quat=place.quat if place is not None else [1, 0, 0, 0],
                rgba=_DARK if place is not None or (own is not None and own.material == "dark") else _LIGHT,
                group=MESH_GROUP,
                contype=0,
                conaffinity=0,
                density=0,
            )


def menagerie_meshes(spec: RobotSpec) -> Path:
    """Return the folder of a robot's meshes from MuJoCo Menagerie, for those who have that package.

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
            f"MuJoCo Menagerie has no {spec.name}. Give the folder of the vendor meshes, or draw the primitives."
        ) from error
    except mujoco_menagerie.MenagerieError as error:
        raise HoiRetargetError(f"MuJoCo Menagerie could not provide {spec.name}: {error}") from error
