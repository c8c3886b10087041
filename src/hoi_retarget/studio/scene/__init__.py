"""The scene of clips and results that every viewer draws: shapes, meshes, lines, cameras, curves."""
