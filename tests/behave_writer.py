"""Writes clips in BEHAVE's own layout, for tests."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from hoi_retarget.clip.clip import Clip
from hoi_retarget.numerics import se3
from mesh_writer import export_mesh
from source_people import in_world, joined, parameters_of

SEQUENCE = "Date03_Sub04_chairwood_sit"
CATEGORY, GENDER = "chairwood", "male"
MESH = f"objects/{CATEGORY}/{CATEGORY}_f2500.ply"
FIRST_FRAME = 90
ELSEWHERE = np.array([0.4, -0.2, 0.1])  # Where the mesh's own origin is: poses are of the mean of its vertices.

Files = dict[str, dict[str, np.ndarray]]


def times_of(numbers) -> np.ndarray:
    """Times as BEHAVE writes them, cut off to milliseconds."""
    return np.array([f"t{int(number * 1000 / 30) / 1000:08.3f}" for number in numbers])


def files_of(clip: Clip, up: str = "-y") -> Files:
    """The arrays of the two files."""
    world = in_world(clip, up)
    person, track = parameters_of(world.people[0], "smplh"), world.objects[0]
    times = times_of(FIRST_FRAME + np.arange(clip.frames))
    return {
        "smpl_fit_all": {
            "poses": joined(person),
            "betas": np.zeros((clip.frames, 10)),
            "trans": person["translation"],
            "frame_times": times,
        },
        "object_fit_all": {
            "angles": se3.log(track.quats),
            "trans": track.positions + se3.rotate(track.quats, track.geometry.points.mean(axis=0)),
            "save_name": np.array("fit01"),
            "frame_times": times,
        },
    }


def write_files(root: Path, files: Files, sequence: str = SEQUENCE) -> Path:
    """Write the two files into their folder, which is returned."""
    folder = root / "sequences" / sequence
    folder.mkdir(parents=True, exist_ok=True)
    for name, arrays in files.items():
        np.savez(folder / f"{name}.npz", **arrays)
    return folder


def write_mesh(root: Path, clip: Clip) -> Path:
    """Write the object's simplified mesh, away from its origin."""
    geometry = clip.objects[0].geometry
    return export_mesh(root / MESH, geometry.points + ELSEWHERE, geometry.faces)


def renamed(clip: Clip, name: str) -> Clip:
    """The clip with its first object called as the source calls it."""
    return replace(clip, objects=(replace(clip.objects[0], name=name), *clip.objects[1:]))
