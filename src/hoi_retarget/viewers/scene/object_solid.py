"""An object as a mesh that moves: its surface, with no more triangles than drawing needs."""

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.viewers.scene.axes import axes
from hoi_retarget.viewers.scene.drawing import Colour, Shapes, Solid

MOST_FACES = 20_000
COLOURS: tuple[Colour, ...] = ((190, 144, 92), (112, 148, 176), (150, 160, 110), (176, 122, 138))
"""Of a clip's objects, in their order and again from the start."""
AXIS_LENGTH, _AXIS_RADIUS = 0.15, 0.006  # [m]

Vertices = Float[np.ndarray, "_ 3"]
Faces = Int[np.ndarray, "_ 3"]


def object_solid(
    geometry: ObjectGeometry,
    scale: float,
    positions: Float[np.ndarray, "T 3"],
    quats: Float[np.ndarray, "T 4"],
    colour: Colour,
) -> Solid:
    """Return an object's mesh, scaled about its origin, at its poses.

    Raises:
        GeometryError: its mesh file cannot be read.
    """
    surface = surface_of(geometry)
    vertices, faces = thinned(surface.vertices, surface.faces)
    return Solid(scale * vertices, faces, colour, positions.astype(np.float32), quats.astype(np.float32))


def object_axes(positions: Float[np.ndarray, "T 3"], quats: Float[np.ndarray, "T 4"]) -> Shapes:
    """Return the axes of an object of unknown shape."""
    return axes(positions[:, None], quats[:, None], AXIS_LENGTH, _AXIS_RADIUS)


def thinned(vertices: Vertices, faces: Faces, most: int = MOST_FACES) -> tuple[Vertices, Faces]:
    """Return a mesh of at most `most` triangles: vertices in one cell of a grid become their mean.

    A mesh that is small enough is returned as it is.
    """
    if len(faces) <= most:
        return vertices, faces
    corners = vertices[faces]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    cell = np.sqrt(2.0 * area / most)  # A cell that a surface passes keeps about two triangles.
    size = float(np.ptp(vertices, axis=0).max())
    cell = max(float(cell), 1e-4 * size)
    while True:
        fewer = _clustered(vertices, faces, cell)
        if len(fewer[1]) == 0:
            return _box_of(vertices)  # So thin that all corners of every triangle are in one cell.
        if len(fewer[1]) <= most:
            return fewer
        cell *= 1.1


def _box_of(vertices: Vertices) -> tuple[Vertices, Faces]:
    import trimesh  # noqa: PLC0415  # takes a third of a second, and hardly anything is so thin

    box = trimesh.creation.box(bounds=[vertices.min(axis=0), vertices.max(axis=0)])
    return np.asarray(box.vertices), np.asarray(box.faces)


def _clustered(vertices: Vertices, faces: Faces, cell: float) -> tuple[Vertices, Faces]:
    cells = np.floor((vertices - vertices.min(axis=0)) / cell).astype(int)
    _, cluster, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    means = np.stack([np.bincount(cluster, weights=axis) for axis in vertices.T], axis=1) / counts[:, None]
    joined = cluster[faces]
    whole = (joined[:, 0] != joined[:, 1]) & (joined[:, 1] != joined[:, 2]) & (joined[:, 2] != joined[:, 0])
    joined = joined[whole]
    # Triangles of the same three clusters are one, whichever they begin with.
    _, first = np.unique(np.sort(joined, axis=1), axis=0, return_index=True)
    return means, joined[np.sort(first)]
