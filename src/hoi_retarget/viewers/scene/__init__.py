"""What is drawn in every frame, whoever draws it: shapes, meshes, lines, cameras, curves."""
