"""Files of skins: points, normals and distance grids of a robot's links, in whole numbers of small steps."""

from collections.abc import Mapping
from io import BytesIO
from pathlib import Path

import numpy as np

from hoi_retarget.errors import RobotError
from hoi_retarget.files import npz
from hoi_retarget.numerics.distance_grid import DistanceGrid
from hoi_retarget.robots.outer_skin import OuterSkin

_PLACE = 2e-5  # [m]
_NORMAL = 1.0 / 127.0
_DISTANCE = 1e-4  # [m]
_MIRROR = np.array([1.0, -1.0, 1.0])


def mirrored_skin(skin: OuterSkin) -> OuterSkin:
    """Return the skin of the link on the other side: y turned around."""
    solid = skin.solid
    _, width, _ = solid.values.shape
    last = solid.origin[1] + (width - 1) * solid.step
    origin = np.array([solid.origin[0], -last, solid.origin[2]])
    return OuterSkin(
        skin.points * _MIRROR, skin.normals * _MIRROR, DistanceGrid(origin, solid.step, solid.values[:, ::-1])
    )


def write_skins(path: Path | BytesIO, skins: Mapping[str, OuterSkin], mirrored: Mapping[str, str]) -> None:
    """Write skins by link, and the names of links whose skins are others' mirror images."""
    own = list(skins.values())
    grids = [skin.solid for skin in own]
    np.savez_compressed(
        path,
        links=np.array(list(skins)),
        mirrored=np.array(list(mirrored.items())).reshape(-1, 2),
        counts=np.array([len(skin.points) for skin in own], np.int32),
        points=np.concatenate([_whole(skin.points, _PLACE, np.int16) for skin in own]),
        normals=np.concatenate([_whole(skin.normals, _NORMAL, np.int8) for skin in own]),
        origins=np.array([grid.origin for grid in grids]),
        steps=np.array([grid.step for grid in grids]),
        shapes=np.array([grid.values.shape for grid in grids], np.int32),
        # Neighbours differ little, so their differences pack well.
        values=np.concatenate(
            [np.diff(_whole(grid.values, _DISTANCE, np.int16), axis=2, prepend=np.int16(0)).ravel() for grid in grids]
        ),
    )


def read_skins(path: Path) -> dict[str, OuterSkin]:
    """Return the skins in a file by link; raises `RobotError` when it is missing or damaged."""
    try:
        arrays = {name: npz.array(name, entry, "fiU") for name, entry in npz.members(path.read_bytes()).items()}
        counts, shapes = arrays["counts"], arrays["shapes"]
        points = np.split(arrays["points"] * _PLACE, np.cumsum(counts)[:-1])
        normals = np.split(arrays["normals"].astype(float), np.cumsum(counts)[:-1])
        values = np.split(arrays["values"], np.cumsum(shapes.prod(axis=1))[:-1])
        skins = {
            str(link): OuterSkin(
                places,
                along / np.linalg.norm(along, axis=1, keepdims=True),
                DistanceGrid(
                    origin,
                    float(step),
                    (np.cumsum(steps.reshape(shape), axis=2, dtype=np.int32) * _DISTANCE).astype(np.float32),
                ),
            )
            for link, places, along, origin, step, shape, steps in zip(
                arrays["links"], points, normals, arrays["origins"], arrays["steps"], shapes, values, strict=True
            )
        }
        return {**skins, **{str(link): mirrored_skin(skins[str(other)]) for link, other in arrays["mirrored"]}}
    except (OSError, ValueError, KeyError) as error:
        raise RobotError(f"{path}: no skin can be read from it ({error}). Make it with tools/make_skins.py.") from error


def _whole(values: np.ndarray, unit: float, dtype: type[np.integer]) -> np.ndarray:
    numbers = np.rint(values / unit)
    if np.abs(numbers).max() > np.iinfo(dtype).max:
        raise ValueError(f"numbers up to {np.abs(values).max():g} do not fit into steps of {unit:g}")
    return numbers.astype(dtype)
