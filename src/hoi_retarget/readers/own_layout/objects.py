"""The objects of a clip: their poses, and their shapes out of the clip, beside it, or from the user's folder."""

from pathlib import Path, PurePosixPath

import numpy as np

from hoi_retarget.errors import ClipError, GeometryError
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.object_files import LARGEST_OBJECT, load_geometry, load_mesh
from hoi_retarget.readers.own_layout.arrays import Arrays, check_unit
from hoi_retarget.readers.own_layout.layout import INTEGERS, NUMBERS, TEXT


def objects_of(arrays: Arrays, frames: int, folder: Path | None) -> tuple[ObjectTrack, ...]:
    """Return the objects.

    Args:
        arrays: the clip's.
        frames: how many there are.
        folder: the user's, with `<name>/<name>.obj`.

    Raises:
        ClipError: arrays are missing or disagree.
        GeometryError: the shape of an object cannot be had.
    """
    names = object_names(arrays)
    if not names:
        return ()
    positions = arrays.array("object_pos", NUMBERS, (frames, len(names), 3), "the objects' positions [m]")
    quats = arrays.array("object_quat", NUMBERS, (frames, len(names), 4), "the objects' rotations, wxyz").astype(float)
    check_unit(arrays.path, "object_quat", quats)
    return tuple(
        ObjectTrack(name, positions[:, index], quats[:, index], _geometry(arrays, index, name, folder))
        for index, name in enumerate(names)
    )


def mesh_files(arrays: Arrays) -> tuple[Path, ...]:
    """Return the files beside a clip that shapes may come from, whether there or not; raises `ClipError`."""
    files = []
    for index, name in enumerate(object_names(arrays)):
        named = _named_mesh(arrays, index)
        files.append(named if named is not None or _holds(arrays, index) else _mesh_called(arrays, name))
    return tuple(path for path in files if path is not None)


def object_names(arrays: Arrays) -> list[str]:
    """Return what the objects are called; raises `ClipError`."""
    names = arrays.array("object_names", TEXT, ("O",), "what the objects are called; none is allowed").tolist()
    if len(set(names)) < len(names):
        raise ClipError(f"{arrays.path}: object_names has a name twice ({', '.join(names)}). Name every object once.")
    return names


def _holds(arrays: Arrays, index: int) -> bool:
    """Return whether the clip itself has an object's shape."""
    return any(f"object_{index}_{what}" in arrays for what in ("points", "faces"))


def _geometry(arrays: Arrays, index: int, name: str, folder: Path | None) -> ObjectGeometry:
    points, faces, mesh = (f"object_{index}_{what}" for what in ("points", "faces", "mesh"))
    if faces in arrays and mesh in arrays:
        raise ClipError(f"{arrays.path}: there are {faces} and {mesh}. Give the triangles or the file, not both.")
    mesh_path = _named_mesh(arrays, index)
    if not _holds(arrays, index):
        return load_mesh(mesh_path) if mesh_path is not None else _geometry_elsewhere(arrays, index, name, folder)
    vertices = arrays.array(points, NUMBERS, ("V", 3), "points of the object's surface [m]").astype(float)
    if len(vertices) == 0 or np.abs(vertices).max() > LARGEST_OBJECT:
        raise ClipError(
            f"{arrays.path}: {points} has {len(vertices)} point(s) with coordinates up to "
            f"{np.abs(vertices).max(initial=0.0):.4g}, expected metres up to {LARGEST_OBJECT:g}."
        )
    triangles = None
    if faces in arrays:
        triangles = arrays.array(faces, INTEGERS, ("F", 3), "triangles over the points").astype(int)
        if ((triangles < 0) | (triangles >= len(vertices))).any():
            raise ClipError(f"{arrays.path}: {faces} names points beyond the {len(vertices)} of {points}.")
    return ObjectGeometry(vertices, mesh_path, triangles)


def _geometry_elsewhere(arrays: Arrays, index: int, name: str, folder: Path | None) -> ObjectGeometry:
    """Return the shape of an object of which the clip has nothing but the name."""
    beside = _mesh_called(arrays, name)
    try:
        if beside is not None and beside.is_file():
            return load_mesh(beside)
    except OSError as error:
        raise GeometryError(f"{beside}: cannot be read ({error}). Check its permissions.") from error
    if folder is None:
        raise GeometryError(
            f"{arrays.path}: the clip does not hold the shape of object {name!r} (object_{index}_points, or "
            f"object_{index}_mesh), and no {name}.obj is beside it. Put one there, or pass --objects DIR with "
            f"{name}/{name}.obj in it."
        )
    return load_geometry(folder, name)


def _named_mesh(arrays: Arrays, index: int) -> Path | None:
    """Return the mesh file that a clip names for an object; None where it names none."""
    mesh = f"object_{index}_mesh"
    return _inside(arrays, mesh, arrays.text(mesh, "a mesh file beside the clip")) if mesh in arrays else None


def _mesh_called(arrays: Arrays, name: str) -> Path | None:
    """Return the mesh file beside the clip that is called as the object; None where no file can be called so."""
    if not name or any(character in name for character in "/\\:\0"):
        return None
    return _inside(arrays, f"the mesh of {name!r}", f"{name}.obj")


def _inside(arrays: Arrays, owner: str, text: str) -> Path:
    """Return the path of a mesh; it lies in the clip's folder or below, links followed."""
    folder = arrays.path.parent
    parts = PurePosixPath(text).parts
    try:
        leaves = (
            not parts
            or text.startswith("/")
            or ".." in parts
            or any(character in text for character in "\\:\0")
            or not (folder / text).resolve().is_relative_to(folder.resolve())
        )
    except (OSError, RuntimeError, ValueError):
        leaves = True
    if leaves:
        raise ClipError(
            f"{arrays.path}: {owner} is {ascii(text)[:80]}, expected a file in the clip's folder, such as 'box.obj'. "
            "Put the mesh beside the clip."
        )
    return folder / text
