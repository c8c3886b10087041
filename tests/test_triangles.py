"""Objects' meshes as sources give them."""

import trimesh

from hoi_retarget.readers.triangles import first_mesh


def test_nothing_is_opened_but_the_mesh(tmp_path, monkeypatch):
    """Not the materials and pictures that it names, wherever they are."""
    opened = []
    monkeypatch.setattr(trimesh.resolvers.FilePathResolver, "get", lambda _, name: opened.append(name) or b"")
    mesh = tmp_path / "mesh.obj"
    mesh.write_text("mtllib ../materials.mtl\nusemtl wood\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n")
    trimesh.load_mesh(mesh)
    assert opened == ["../materials.mtl"]
    assert first_mesh("mesh", [mesh], centred=False).points.shape == (3, 3)
    assert opened == ["../materials.mtl"]
