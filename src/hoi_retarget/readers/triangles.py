"""Objects' meshes as sources give them: any kind of file that trimesh reads, with the centring that poses are of."""

import io
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from hoi_retarget.errors import ClipError, GeometryError, MeshError
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.readers.object_files import LARGEST_OBJECT


def first_mesh(name: str, candidates: Sequence[Path], *, centred: bool, scale: float = 1.0) -> ObjectGeometry:
    """Return the geometry of the first mesh file that exists, triangles included.

    Args:
        name: the object's, for errors.
        candidates: where its mesh may be.
        centred: whether poses are of the mesh less the mean of its vertices.
        scale: what its coordinates are multiplied with before that.

    Raises:
        GeometryError: no file exists, or the first that does holds no usable mesh.
    """
    for path in candidates:
        if path.is_file():
            status = path.stat()
            return _load(path, centred, scale, status.st_mtime_ns, status.st_size)
    listing = " or ".join(map(str, candidates))
    raise GeometryError(f"object {name!r}: there is no mesh, looked for {listing}. Add it, or pass --objects DIR.")


@lru_cache(maxsize=64)
def _load(path: Path, centred: bool, scale: float, *_changed: int) -> ObjectGeometry:
    import trimesh  # noqa: PLC0415  # takes a third of a second, and not every source has meshes

    try:
        # From bytes: a path would be followed to materials and pictures that the file names, which no shape needs.
        mesh = trimesh.load_mesh(io.BytesIO(path.read_bytes()), file_type=path.suffix[1:], process=False)
        vertices, faces = np.array(mesh.vertices, dtype=float) * scale, np.array(mesh.faces)
    except Exception as error:  # trimesh and what it calls raise anything on damaged files
        raise MeshError(f"{path}: not a readable mesh ({error}). Export it again.") from error
    if vertices.shape[1:] != (3,) or len(vertices) == 0 or len(faces) == 0:
        raise MeshError(f"{path}: the mesh has no triangles. Export it again.")
    if not (np.abs(vertices) <= LARGEST_OBJECT).all():
        raise MeshError(
            f"{path}: its coordinates are not finite, or reach beyond {LARGEST_OBJECT:g} m: another unit, or damage."
        )
    try:
        return ObjectGeometry(vertices - vertices.mean(axis=0) if centred else vertices, faces=faces, file=path)
    except ClipError as error:
        raise MeshError(f"{path}: {error} Export it again.") from error
