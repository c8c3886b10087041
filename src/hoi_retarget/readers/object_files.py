"""Object geometry from a folder of meshes: `DIR/<name>/<name>.obj` or a mesh of another kind, and surface points.

The layout is that of InterMimic's and InterAct's object folders. Wavefront OBJ is read here by
hand, vertices only: trimesh takes 170 to 200 ms of CPU for the 2.5 to 4 MB meshes of OMOMO, mostly
for faces and normals that no computation uses; one pass over the bytes and the hull together
take 8 to 16 ms. Viewers load the whole mesh from `ObjectGeometry.mesh_path`.

Meshes of other sources are read by trimesh, triangles included, and moved to the centre that their poses are of.
Poses that sources store as matrices become positions and quaternions.
"""

import difflib
import functools
import io
import re
import tokenize
import warnings
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float

from hoi_retarget.errors import ClipError, GeometryError, MeshError, ReadError
from hoi_retarget.files.reading import check_file, read_bytes
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import describe_frames, runs
from hoi_retarget.objects.track import ObjectGeometry

SAMPLE_POINTS, _HULL = "sample_points.npy", "_hull.obj"
MESH_SUFFIXES = (".obj", ".stl", ".ply", ".glb", ".off")
"""Of the files that meshes are read from; trimesh reads all of them from their bytes alone."""
_SHOWN_FILES = 5
MAX_OBJECT_SIZE = 100.0  # [m]; coordinates beyond it are another unit or damage.

NUMPY_ERRORS = (OSError, ValueError, EOFError, TypeError, SyntaxError, OverflowError, MemoryError, tokenize.TokenError)
"""Errors of numpy for damaged headers of `.npy` files; warnings about them are silenced."""


def load_geometry(folder: Path, name: str) -> ObjectGeometry:
    """Return the geometry of the object `name` in `folder`.

    The first that exists of `<name>/<name>.obj` (or `.stl`, ...), `<name>.obj` (...), other meshes in `<name>`, which
    are parts of it, `<name>/<name>_hull.obj` and `<name>/sample_points.npy` is taken: a mesh is exact, the others are
    up to some centimetres small. The file's origin is trusted to be that of the poses. Raises `GeometryError` where
    there is no such object, or its files hold no usable geometry.
    """
    _check_name(folder, name)
    try:
        for path in _own_files(folder, name):
            if path.is_file():
                return load_mesh(path)
        if parts := _parts(folder, name):
            return _joined(parts)
        for path in _reduced_files(folder, name):
            if path.is_file():
                status = path.stat()
                return _load(path, status.st_mtime_ns, status.st_size)
        known = known_objects(folder)
    except OSError as error:
        raise GeometryError(f"{folder}: cannot be read ({error}). Check --objects and its permissions.") from error
    raise GeometryError(_describe_absence(folder, name, known))


def load_mesh(path: Path) -> ObjectGeometry:
    """Return the geometry in a mesh file; raises `GeometryError`."""
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise MeshError(f"{path}: meshes are read from {', '.join(MESH_SUFFIXES)} files. Export it as one of them.")
    try:
        status = path.stat()
    except OSError as error:
        raise MeshError(f"{path}: the mesh cannot be read ({error.strerror or error}). Check the path.") from error
    if path.suffix.lower() == ".obj":
        return _load(path, status.st_mtime_ns, status.st_size)
    return _load_triangles(path, False, 1.0, status.st_mtime_ns, status.st_size)


def _joined(parts: Sequence[Path]) -> ObjectGeometry:
    """Return the geometry of several meshes in one frame; raises `GeometryError`."""
    loaded = [_load_triangles(path, False, 1.0, path.stat().st_mtime_ns, path.stat().st_size) for path in parts]
    starts = np.cumsum([0, *(len(part.points) for part in loaded)])
    faces = [part.faces + start for part, start in zip(loaded, starts, strict=False) if part.faces is not None]
    return ObjectGeometry(np.concatenate([part.points for part in loaded]), faces=np.concatenate(faces), file=parts[0])


def known_objects(folder: Path) -> tuple[str, ...]:
    """Return the names of the objects in `folder` that have a file to load, sorted; raises `OSError`."""
    if not folder.is_dir():
        return ()
    entries = {entry.name if entry.is_dir() else entry.stem for entry in folder.iterdir()}
    names = sorted(entries)
    return tuple(name for name in names if any(map(_is_readable_file, geometry_files(folder, name))))


def _is_readable_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:
        return False


def geometry_files(folder: Path, name: str) -> tuple[Path, ...]:
    """Return the files that an object's geometry can be in; the first that exists is read."""
    return *_own_files(folder, name), *_parts(folder, name), *_reduced_files(folder, name)


def _own_files(folder: Path, name: str) -> list[Path]:
    return [place / f"{name}{suffix}" for place in (folder / name, folder) for suffix in MESH_SUFFIXES]


def _reduced_files(folder: Path, name: str) -> tuple[Path, Path]:
    return folder / name / f"{name}{_HULL}", folder / name / SAMPLE_POINTS


def _parts(folder: Path, name: str) -> list[Path]:
    """Return the meshes in an object's folder that are not called as it is, nor a hull; raises `OSError`."""
    if not (folder / name).is_dir():
        return []
    files = sorted(path for path in (folder / name).iterdir() if path.suffix.lower() in MESH_SUFFIXES)
    return [path for path in files if path.stem != name and not path.name.endswith(_HULL) and path.is_file()]


def _check_name(folder: Path, name: str) -> None:
    # Names come from files: none may lead out of the folder that the user named.
    if not name or name in (".", "..") or any(character in name for character in "/\\\0"):
        raise GeometryError(
            f"{folder}: {name[:80]!r} is not the name of an object: it must be a plain folder name without "
            "path separators. Pass --object NAME."
        )


def _describe_absence(folder: Path, name: str, known: tuple[str, ...]) -> str:
    own, *others = MESH_SUFFIXES
    looked_for = f"{name}/{name}{own} ({', '.join(others)}) or {name}/{name}{_HULL} or {name}/{SAMPLE_POINTS}"
    if not folder.is_dir():
        return f"{folder}: there is no such folder of objects. Pass --objects DIR with {looked_for} in it."
    if (folder / name).is_dir():
        there = sorted(str(path.relative_to(folder)) for path in (folder / name).rglob("*") if path.is_file())
        found = f" It holds {', '.join(there[:_SHOWN_FILES])}." if there else ""
        return f"{folder / name}: the folder has no geometry; expected {looked_for}.{found} Add one of them."
    close = difflib.get_close_matches(name, known, n=1)
    below = sorted(path.parent for path in folder.glob(f"*/{name}") if path.is_dir())
    suggestion = f" Did you mean {close[0]!r}?" if close else f" Try --objects {below[0]}." if below else ""
    exist = f"Objects there: {', '.join(known)}." if known else "There are no objects in it."
    return f"{folder}: no object {name!r} (looked for {looked_for}).{suggestion} {exist}"


@functools.lru_cache(maxsize=128)
def _load(path: Path, _modified: int, _size: int) -> ObjectGeometry:
    """Read and reduce one file; the time and the size only tell a changed file from a known one."""
    is_mesh = path.suffix.lower() == ".obj"
    points = mesh_vertices(path) if is_mesh else _read_points(path)
    if not np.isfinite(points).all():
        raise MeshError(f"{path}: {(~np.isfinite(points).all(axis=1)).sum()} of its points are not finite numbers.")
    if np.abs(points).max() > MAX_OBJECT_SIZE:
        raise MeshError(
            f"{path}: coordinates reach {np.abs(points).max():.4g}, expected metres up to {MAX_OBJECT_SIZE:g}. "
            "Scale the mesh if it is in millimetres."
        )
    return ObjectGeometry(points=extreme_points(points), mesh_path=path if is_mesh else None, file=path)


def extreme_points(points: Float[np.ndarray, "P 3"]) -> Float[np.ndarray, "E 3"]:
    """Return the points that include an extreme one in every direction: their convex hull's vertices [m]."""
    if len(points) < 3:
        return np.unique(points, axis=0)
    try:
        return points[scipy.spatial.ConvexHull(points).vertices]
    except scipy.spatial.QhullError:
        pass  # A flat or straight shape has no hull in space, but has one in its own plane or line.
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    along = points @ axes.T
    try:
        return points[scipy.spatial.ConvexHull(along[:, :2]).vertices]
    except scipy.spatial.QhullError:
        return np.unique(points[[along[:, 0].argmin(), along[:, 0].argmax()]], axis=0)


def _read_points(path: Path) -> Float[np.ndarray, "P 3"]:
    """Read surface points; a pickled array is refused, not executed."""
    try:
        check_file(path)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            # Mapped, the array cannot claim more bytes than the file has.
            values = np.array(np.load(path, mmap_mode="r", allow_pickle=False))
    except ReadError as error:
        raise MeshError(str(error)) from error
    except NUMPY_ERRORS as error:
        raise MeshError(f"{path}: not a readable .npy array of points ({error}). Write it again.") from error
    if values.ndim != 2 or values.shape[1] != 3 or len(values) == 0 or values.dtype.kind not in "fiu":
        raise MeshError(
            f"{path}: an array of {values.dtype} with shape {values.shape}, expected points (P, 3) in metres."
        )
    return values.astype(float)


def mesh_vertices(path: Path) -> Float[np.ndarray, "V 3"]:
    """Return the vertices [m] that a Wavefront OBJ mesh lists; raises `MeshError`, also where it has no faces."""
    try:
        content = read_bytes(path)
    except ReadError as error:
        raise MeshError(str(error)) from error
    characters = np.frombuffer(b"\n" + content + b"\n\n\n", dtype=np.uint8)
    starts = np.flatnonzero(characters[:-3] == ord("\n")) + 1
    first, second = characters[starts], characters[starts + 1]
    separated = (second == ord(" ")) | (second == ord("\t"))
    is_vertex = separated & (first == ord("v"))
    if not is_vertex.any():
        raise MeshError(f"{path}: the mesh has no vertices (lines `v x y z`). Export it again as Wavefront OBJ.")
    is_face = separated & (first == ord("f"))
    if not is_face.any():
        raise MeshError(f"{path}: the mesh has no faces (lines `f ...`). Export it again as Wavefront OBJ.")
    # Vertices and faces nearly always stand in one block each: cut runs of lines, not lines.
    bounds = np.append(starts, len(characters) - 2) - 1
    kinds = (is_vertex, is_face)
    vertices, faces = (b" ".join(content[bounds[a] : bounds[b]] for a, b in runs(lines)) for lines in kinds)
    count = int(is_vertex.sum())
    _check_faces(path, faces, count)
    return _parse_vertices(path, vertices, count)


def _check_faces(path: Path, text: bytes, count: int) -> None:
    """Raise `MeshError` where a face names a vertex that there is not; nobody here needs more of faces.

    A face's corner begins with its vertex, counted from 1, or from -1 backwards.
    """
    if b"#" in text:
        text = re.sub(rb"#[^\n]*", b"", text)
    characters = np.frombuffer(text + b" ", dtype=np.uint8)
    begins = np.flatnonzero((characters[:-1] <= ord(" ")) & (characters[1:] > ord(" "))) + 1
    begins = begins + (characters[begins] == ord("-"))
    begins = begins[characters[begins] - ord("0") <= 9]  # All else wraps around beyond 9.
    numbers, digits, place = np.zeros(len(begins)), np.ones(len(begins), dtype=bool), begins
    while digits.any():
        digit = characters[place] - ord("0")
        digits &= digit <= 9
        numbers = np.where(digits, 10.0 * numbers + digit, numbers)
        place = np.minimum(place + 1, len(characters) - 1)
    absent = numbers[(numbers < 1) | (numbers > count)]
    if len(absent):
        raise MeshError(
            f"{path}: a face names vertex {absent[0]:.0f}; they are counted from 1 to {count}. Export the mesh again."
        )


def _parse_vertices(path: Path, text: bytes, count: int) -> Float[np.ndarray, "V 3"]:
    words = text.split()
    width = len(words) // count
    # `v x y z`, perhaps with a weight or a colour behind; all lines alike.
    if width < 4 or len(words) != count * width or set(words[::width]) != {b"v"}:
        raise MeshError(
            f"{path}: its {count} vertex lines hold {len(words)} words, expected `v x y z` in each. "
            "Export the mesh again."
        )
    try:
        return np.array([words[axis::width] for axis in (1, 2, 3)], dtype=float).T
    except ValueError as error:
        raise MeshError(f"{path}: a vertex is not three numbers ({error}). Export the mesh again.") from error


MAX_DEVIATION = 0.01
"""Of a rotation times its transpose from the identity: rounding and smoothing stay below, sizes and shears do not."""
_LAST_ROW = np.array([0.0, 0.0, 0.0, 1.0])


def quats_of(path: Path, name: str, matrices: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T 4"]:
    """Return unit quaternions, wxyz, from rotation matrices that turn columns; `path` and `name` are for errors.

    Raises `ClipError` where they are no rotations, but mirror, scale or shear.
    """
    deviation = np.abs(np.einsum("tji,tjk->tik", matrices, matrices) - np.eye(3)).max(axis=(1, 2))
    bad = deviation > MAX_DEVIATION
    if bad.any():
        raise ClipError(
            f"{path}: {name} is no rotation in {describe_frames(np.flatnonzero(bad))}: its columns are not of unit "
            f"length or not at right angles, by up to {deviation.max():.3g}. Download the recording again."
        )
    mirrored = np.linalg.det(matrices) < 0
    if mirrored.any():
        raise ClipError(
            f"{path}: {name} mirrors in {describe_frames(np.flatnonzero(mirrored))}, which no rotation does. "
            "Download the recording again."
        )
    return se3.matrix_to_quat(matrices)


def poses_of(
    path: Path, name: str, matrices: Float[np.ndarray, "T 4 4"]
) -> tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 4"]]:
    """Return positions [m] and rotations, wxyz, from matrices that move columns; otherwise as `quats_of`."""
    if (np.abs(matrices[:, 3] - _LAST_ROW) > MAX_DEVIATION).any():
        raise ClipError(
            f"{path}: {name} holds matrices whose last row is not 0, 0, 0, 1. Transposed ones have the position there: "
            "save them so that they move columns."
        )
    return matrices[:, :3, 3], quats_of(path, name, matrices[:, :3, :3])


def first_mesh(name: str, candidates: Sequence[Path], *, centred: bool, scale: float = 1.0) -> ObjectGeometry:
    """Return the geometry of the first mesh file that exists, triangles included.

    Raises `GeometryError` where no file exists, or the first that does holds no usable mesh.

    `name`: the object's, for errors; `candidates`: where its mesh may be; `centred`: whether poses are of the mesh less
    the mean of its vertices; `scale`: a factor of its coordinates before that.
    """
    for path in candidates:
        if path.is_file():
            status = path.stat()
            return _load_triangles(path, centred, scale, status.st_mtime_ns, status.st_size)
    listing = " or ".join(map(str, candidates))
    raise GeometryError(f"object {name!r}: there is no mesh, looked for {listing}. Add it, or pass --objects DIR.")


@lru_cache(maxsize=64)
def _load_triangles(path: Path, centred: bool, scale: float, *_changed: int) -> ObjectGeometry:
    import trimesh  # noqa: PLC0415  # takes a third of a second, and not every source has meshes

    try:
        # From bytes: a path would be followed to materials and pictures that the file names, which no shape needs.
        mesh = trimesh.load_mesh(io.BytesIO(read_bytes(path)), file_type=path.suffix[1:], process=False)
        vertices, faces = np.array(mesh.vertices, dtype=float) * scale, np.array(mesh.faces)
    except ReadError as error:
        raise MeshError(str(error)) from error
    except Exception as error:  # trimesh and what it calls raise anything on damaged files
        raise MeshError(f"{path}: not a readable mesh ({error}). Export it again.") from error
    if vertices.shape[1:] != (3,) or len(vertices) == 0 or len(faces) == 0:
        raise MeshError(f"{path}: the mesh has no triangles. Export it again.")
    if not (np.abs(vertices) <= MAX_OBJECT_SIZE).all():
        raise MeshError(
            f"{path}: its coordinates are not finite, or reach beyond {MAX_OBJECT_SIZE:g} m: another unit, or damage."
        )
    try:
        return ObjectGeometry(vertices - vertices.mean(axis=0) if centred else vertices, faces=faces, file=path)
    except ClipError as error:
        raise MeshError(f"{path}: {error} Export it again.") from error
