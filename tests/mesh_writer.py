"""Writes objects' meshes, for sources that have them beside their recordings."""

from pathlib import Path

import trimesh

from hoi_retarget.objects.track import ObjectGeometry


def write_mesh(path: Path, geometry: ObjectGeometry) -> Path:
    """Write the triangles of a geometry."""
    assert geometry.faces is not None
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in geometry.points.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in geometry.faces.tolist()]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return path


def export_mesh(path: Path, points, faces) -> Path:
    """Write a mesh by trimesh, of the kind that the path's ending names; the path is returned."""
    path.parent.mkdir(parents=True, exist_ok=True)
    mesh = trimesh.Trimesh(points, faces, process=False)
    mesh.export(path, **({"digits": 12} if path.suffix == ".obj" else {}))
    return path
