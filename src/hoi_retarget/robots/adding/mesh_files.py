"""Mesh files of a description: found by their names below one folder, read and made coarser."""

import io
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

SUFFIXES = (".stl", ".obj")
"""Of mesh files that can be read; of one that has another ending, a file of the same stem is taken."""
MESH_FOLDERS = ("meshes", "assets", "visuals", "mesh")
_LEVELS_UP = 2
_MOST_FILES = 20_000
_MOST_BYTES = 256 << 20
_MOST_FACES = 2500
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
                return max(hits, key=lambda file: (_common_end(wanted, file), -len(file.parts)))
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


def read_mesh(file: Path) -> bytes | None:
    """Return a mesh, made coarser, as a binary STL; None where it cannot be read or has no surface."""
    if file.stat().st_size > _MOST_BYTES:
        return None
    return coarse_stl(file.read_bytes(), file.suffix.lower().removeprefix("."))


def coarse_stl(content: bytes, kind: str) -> bytes | None:
    """Return a mesh of a kind, `stl` or `obj`, made coarser, as a binary STL; None where there is no surface."""
    try:
        mesh = trimesh.load(io.BytesIO(content), file_type=kind, force="mesh", process=False, skip_materials=True)
        if not isinstance(mesh, trimesh.Trimesh):
            return None
        vertices, faces = np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=int)
    except Exception:  # noqa: BLE001 - whatever a damaged mesh does to its reader
        return None
    if not len(faces) or not np.isfinite(vertices).all():
        return None
    vertices, faces = coarser(vertices, faces)
    return _stl(vertices[faces]) if len(faces) else None


def coarser(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a mesh of few triangles: vertices in one cell of a grid become one, at their mean."""
    low, extent = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max())
    parts = _FINEST
    while len(faces) > _MOST_FACES and parts > 8:
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
    record = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    record["corners"] = triangles
    return b"\0" * 80 + np.uint32(len(triangles)).tobytes() + record.tobytes()
