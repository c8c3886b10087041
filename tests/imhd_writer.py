"""Writes clips as IMHD2's pickles, in the data set's tree, with the model that reads them."""

import pickle
from pathlib import Path

import numpy as np

from hoi_retarget.clip.clip import Clip
from hoi_retarget.numerics import se3
from source_people import betas_of, parameters_of, write_taller_model

NAME = Path("20230910", "20230910_af_suitcase", "freestyle1", "gt_0_338_2309.pkl")


def write_recording(root: Path, clip: Clip, name: Path = NAME) -> tuple[Path, Path]:
    """Write a clip of one person in the world that it is in; return its file and the folder of models."""
    path = root / "ground_truth" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    person, track = clip.people[0], clip.objects[0]
    centre = write_template(root / "object_templates", track.name, track.geometry)
    numbers = parameters_of(person, "smplh")
    values = {
        "objectRot": se3.log(track.quats),
        "objectTrans": track.positions + se3.rotate(track.quats, centre),
        "smplPose": np.concatenate([numbers["root"], numbers["body"], np.full((clip.frames, 6), 9.0)], axis=1),
        "smplHandPose": np.concatenate([numbers["left_hand"], numbers["right_hand"]], axis=1),
        "smplShape": np.repeat(betas_of(1, 16)[None], clip.frames, axis=0),
        "smplTrans": numbers["translation"],
    }
    path.write_bytes(pickle.dumps(values))
    return path, write_taller_model(root / "models", person, "smplh", "neutral")


def write_template(folder: Path, name: str, geometry) -> np.ndarray:
    """Write a mesh away from its middle, its texture with seams at one end; return the mean of its vertices."""
    points, faces = geometry.points + np.array([1.0, 2.0, -3.0]), geometry.faces + 1
    lines = [f"v {x:.12f} {y:.12f} {z:.12f}" for x, y, z in points]
    lines += [f"vt {index / 1000} 0.5" for index in range(len(points) + 12)]
    for index, face in enumerate(faces.tolist()):
        seams = [len(points) + 3 * index + corner + 1 for corner in range(3)] if index < 4 else face
        lines.append(" ".join(["f", *(f"{vertex}/{place}" for vertex, place in zip(face, seams, strict=True))]))
    (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / name / f"{name}_simplified_transformed.obj").write_text("\n".join(lines))
    return geometry.points.mean(axis=0)
