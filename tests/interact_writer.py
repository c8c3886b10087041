"""Writes clips as InterAct's canonical sequences, in their data set's tree, with the models that read them."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from body_writer import write_npz
from hoi_retarget.clip.clip import Clip
from hoi_retarget.numerics import se3
from hoi_retarget.readers.interact import SUBSETS, Subset
from mesh_writer import export_mesh
from source_people import betas_of, body_values, in_world, parameters_of

GENDER = "male"
_SHAPES = 30
"""Of SMPL-X's files with 20, only ten are of shape."""


def write_sequence(
    root: Path, clip: Clip, folder: str, *, subset: Subset | None = None, parts: dict[str, str] | None = None
) -> tuple[Path, Path]:
    """Write a clip of one person; return the sequence's folder and that of the models.

    Args:
        root: where the data sets' folders are.
        clip: z is up; what is read again.
        folder: of the data set.
        subset: what its bodies are, where the folder's name does not tell.
        parts: object -> what it is called instead, as `drawer_part1`; all objects then have a file each.
    """
    subset = subset or SUBSETS.get(folder) or SUBSETS[folder.split("_", maxsplit=1)[0]]
    place = root / folder / "sequences_canonical" / "s1_clip"
    place.mkdir(parents=True, exist_ok=True)
    recorded = in_world(clip, "y")
    models = _write_person(root, place, recorded, subset)
    for track in recorded.objects:
        name = (parts or {}).get(track.name, track.name)
        file = place / (f"object_{name}.npz" if parts else "object.npz")
        centre = write_mesh(root / folder / "objects", name, track.geometry)
        trans = track.positions + se3.rotate(track.quats, centre)
        np.savez(file, angles=se3.log(track.quats), trans=trans, name=name)
    return place, models


def renamed(clip: Clip, names: dict[str, str]) -> Clip:
    """The clip with other names of its objects."""
    return replace(
        clip, objects=tuple(replace(track, name=names.get(track.name, track.name)) for track in clip.objects)
    )


def write_mesh(folder: Path, name: str, geometry) -> np.ndarray:
    """Write a mesh less the mean of its vertices, which is returned; that of a part lies in its object's folder."""
    centre = geometry.points.mean(axis=0)
    whole, _, part = name.rpartition("_")
    file = folder / whole / f"{part}.obj" if whole else folder / name / f"{name}.obj"
    export_mesh(file, geometry.points - centre, geometry.faces)
    return centre


def _write_person(root: Path, place: Path, clip: Clip, subset: Subset) -> Path:
    person = clip.people[0]
    own = subset.betas == 0
    # The model is a taller body, which the first beta, or the template, makes the person's.
    taller = replace(person, joint_positions=1.1 * person.joint_positions)
    values = body_values([taller] if own else [taller, person], subset.family, shapes=_SHAPES)
    numbers = parameters_of(person, subset.family, None if subset.flat_hands else values)
    hands = []
    for side in ("left", "right"):
        hand = numbers[f"{side}_hand"]
        if subset.hand < hand.shape[1]:
            # Components such that the first ones are enough for this clip.
            components = np.linalg.svd(hand)[2]
            values[f"hands_components{side[0]}"] = components
            hand = (hand @ components.T)[:, : subset.hand]
        hands.append(hand)
    write_npz(root / "models" / f"{subset.family.upper()}_{GENDER.upper()}.npz", values)
    body = (
        {"vtemp": body_values([person], subset.family, shapes=_SHAPES)["v_template"]}
        if own
        else {"betas": betas_of(1, subset.betas)}
    )
    poses = np.concatenate([numbers["root"], numbers["body"], *hands], axis=1)
    np.savez(place / "human.npz", poses=poses, trans=numbers["translation"], gender=GENDER, **body)
    return root / "models"
