"""Mesh files of a description: found by their names below one folder, read and made coarser."""

import io
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from hoi_retarget.robots.adding.collada import Collada, Colour, Surface, read_collada

SUFFIXES = (".stl", ".obj", ".dae")
"""Of mesh files that can be read; of one that is not there, a file of the same stem is taken, the first of these."""
MESH_FOLDERS = ("meshes", "assets", "visuals", "mesh")
_LEVELS_UP = 2
_MOST_FILES = 20_000
_MOST_BYTES = 256 << 20
_MOST_FACES = 2500
_STL_HEAD = 84
_STL_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
_FINEST = 256
"""Parts of a mesh's extent at first, when vertices that are near to each other become one."""


@dataclass(frozen=True)
class MeshFolder:
    """All mesh files below some folders; nothing outside of them is ever opened."""

    folders: tuple[Path, ...]
    files: tuple[Path, ...]

    def find(self, name: str) -> Path | None:
        """Return the file that a description means by a path, of which only the last parts count."""
        wanted = name.replace("\\", "/").lower().split("/")
        stem = os.path.splitext(wanted[-1])[0]  # noqa: PTH122 - no path of this machine
        for names in ((wanted[-1],), tuple(stem + suffix for suffix in SUFFIXES)):
            hits = [file for file in self.files if file.name.lower() in names]
            if hits:
                return max(
                    hits, key=lambda file: (_common_end(wanted, file), -len(file.parts), file.suffix.lower() != ".dae")
                )
        return None


def mesh_folder(description: Path, meshes: Path | None) -> MeshFolder:
    """Return the mesh files of a description: in its own folder, or in its package's, and in `meshes`.

    The folder of the package is one above with a folder of meshes in it: `robot/urdf/robot.urdf`, `robot/meshes`.
    """
    own = description.resolve().parent
    above = (own, *own.parents)[: _LEVELS_UP + 1]
    package = next((top for top in above if any((top / name).is_dir() for name in MESH_FOLDERS)), own)
    folders = (*((meshes.resolve(),) if meshes is not None else ()), package)
    return MeshFolder(folders, tuple(file for folder in folders for file in _below(folder)))


def _below(folder: Path) -> Iterator[Path]:
    seen = 0
    for top, _, names in os.walk(folder):
        for name in sorted(names):
            seen += 1
            if seen > _MOST_FILES:
                return
            file = Path(top) / name
            # A link may lead out of the folder.
            if name.lower().endswith(SUFFIXES) and file.resolve().is_relative_to(folder):
                yield file


def _common_end(wanted: Sequence[str], file: Path) -> int:
    parts = [part.lower() for part in file.parts]
    same = 0
    for one, other in zip(reversed(wanted[:-1]), reversed(parts[:-1]), strict=False):
        if one != other:
            break
        same += 1
    return same


@dataclass(frozen=True)
class Mesh:
    """A mesh file, made coarser."""

    parts: tuple[tuple[bytes, Colour | None], ...]
    """Binary STLs with the colours that the file says."""
    other_up: bool
    """Whether it says that another axis than z is up."""


def read_mesh(file: Path, *, upright: bool = False) -> Mesh:
    """Return a mesh file, turned such that z is up where that is wanted.

    Raises:
        ValueError: It is too large, damaged, or has no surface.
    """
    if file.stat().st_size > _MOST_BYTES:
        raise ValueError(f"it is larger than {_MOST_BYTES >> 20} MiB.")
    content, kind = file.read_bytes(), file.suffix.lower().removeprefix(".")
    if kind == "dae":
        read = read_collada(content, upright=upright)
    else:
        read = Collada((_surface(content, kind),), other_up=False)
    total = sum(len(surface.faces) for surface in read.surfaces)
    parts = ((_coarse(surface, _MOST_FACES * len(surface.faces) // total), surface.colour) for surface in read.surfaces)
    shown = tuple((stl, colour) for stl, colour in parts if stl is not None)
    if not shown:
        raise ValueError("it has no surface.")
    return Mesh(shown, read.other_up)


def coarse_stl(content: bytes, kind: str) -> bytes | None:
    """Return a mesh of a kind, `stl` or `obj`, made coarser, as a binary STL; None where there is no surface."""
    try:
        return _coarse(_surface(content, kind), _MOST_FACES)
    except ValueError:
        return None


def joined_stl(parts: Sequence[bytes]) -> bytes:
    """Return the triangles of several binary STLs as one."""
    records = b"".join(part[_STL_HEAD:] for part in parts)
    return b"\0" * 80 + np.uint32(len(records) // _STL_RECORD.itemsize).tobytes() + records


def _surface(content: bytes, kind: str) -> Surface:
    """Return an STL or an OBJ; raises `ValueError`."""
    try:
        mesh = trimesh.load(io.BytesIO(content), file_type=kind, force="mesh", process=False, skip_materials=True)
        if not isinstance(mesh, trimesh.Trimesh):
            raise ValueError("no triangles")
        return Surface(np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=int), None)
    except Exception as error:  # Whatever a damaged mesh does to its reader.
        raise ValueError(f"it is damaged ({type(error).__name__}: {error}).") from error


def _coarse(surface: Surface, most: int) -> bytes | None:
    if not len(surface.faces) or not np.isfinite(surface.vertices).all():
        return None
    vertices, faces = coarser(surface.vertices, surface.faces, most)
    return _stl(vertices[faces]) if len(faces) else None


def coarser(vertices: np.ndarray, faces: np.ndarray, most: int = _MOST_FACES) -> tuple[np.ndarray, np.ndarray]:
    """Return a mesh of few triangles, `most` where it can: vertices in one cell of a grid become one, at their mean."""
    low, extent = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max())
    parts = _FINEST
    while len(faces) > most and parts > 8:
        cells = np.floor((vertices - low) / (extent / parts)).astype(np.int64)
        _, cell = np.unique(cells @ [1, 4 * _FINEST, 16 * _FINEST**2], return_inverse=True)
        cell = cell.ravel()
        count = np.bincount(cell)
        vertices = np.stack([np.bincount(cell, axis) / count for axis in vertices.T], axis=1)
        faces = cell[faces]
        faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
        # Of walls that became one, both sides stay: viewers draw only the side that a triangle is wound for.
        turns = (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3
        one, two, three = np.take_along_axis(faces, turns, axis=1).T
        # One number a triangle: sorting rows takes ten times as long.
        _, edge = np.unique(one * len(count) + two, return_inverse=True)
        _, first = np.unique(edge * len(count) + three, return_index=True)
        faces = faces[np.sort(first)]
        parts = int(parts * 0.75)
    return vertices, faces


def _stl(triangles: np.ndarray) -> bytes:
    records = np.zeros(len(triangles), dtype=_STL_RECORD)
    records["corners"] = triangles
    return b"\0" * 80 + np.uint32(len(triangles)).tobytes() + records.tobytes()
