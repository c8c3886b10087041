"""Writes clips as HODome's pairs of files, in the data set's tree, with the model that reads them."""

from pathlib import Path

import numpy as np

from hoi_retarget.clip.clip import Clip
from hoi_retarget.numerics import se3
from mesh_writer import export_mesh
from source_people import betas_of, in_world, parameters_of, write_taller_model


def write_sequence(root: Path, clip: Clip, name: str) -> tuple[Path, Path]:
    """Write a clip of one person; return the person's file and the folder of models."""
    for folder in ("smplx", "object"):
        (root / folder).mkdir(parents=True, exist_ok=True)
    recorded = in_world(clip, "y")
    person, track = recorded.people[0], recorded.objects[0]
    centre = write_mesh(root / "scaned_object" / track.name / f"{track.name}_face1000.obj", track.geometry)
    numbers = parameters_of(person, "smplx")
    frames = clip.frames
    np.savez(
        root / "smplx" / f"{name}.npz",
        frame_ids=np.arange(frames, dtype=np.int32),
        betas=np.repeat(betas_of(1, 10)[None], frames, axis=0).astype(np.float32),
        expression=np.zeros((frames, 10), dtype=np.float32),
        global_orient=numbers["root"],
        body_pose=numbers["body"],
        transl=numbers["translation"],
        left_hand_pose=numbers["left_hand"],
        right_hand_pose=numbers["right_hand"],
        **{f"{part}_pose": np.zeros((frames, 3)) for part in ("jaw", "leye", "reye")},
    )
    np.savez(
        root / "object" / f"{name}.npz",
        object_R=se3.quat_to_matrix(track.quats),
        object_T=track.positions + se3.rotate(track.quats, centre),
    )
    return root / "smplx" / f"{name}.npz", write_taller_model(root / "models", person, "smplx", "neutral")


def write_mesh(path: Path, geometry) -> np.ndarray:
    """Write a mesh away from its middle; return the mean of its vertices where poses expect them."""
    export_mesh(path, geometry.points + np.array([1.0, 2.0, -3.0]), geometry.faces)
    return geometry.points.mean(axis=0)
