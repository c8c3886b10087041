"""Writes objects' meshes as Wavefront OBJ, for sources that keep them beside their recordings."""

from pathlib import Path

from hoi_retarget.objects.track import ObjectGeometry


def write_mesh(path: Path, geometry: ObjectGeometry) -> Path:
    """Write the triangles of a geometry."""
    assert geometry.faces is not None
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in geometry.points.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in geometry.faces.tolist()]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return path
