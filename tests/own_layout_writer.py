"""Writes clips in the layout of our own with people as parameters of a body model, for tests."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np

from body_writer import write_npz
from hand_components import add_components
from hoi_retarget.clip.clip import Clip
from hoi_retarget.human.body_model import Family
from hoi_retarget.human.person import Person
from hoi_retarget.readers import own_layout
from source_people import betas_of, body_values, parameters_of

GENDERS = ("female", "male")
BETAS = 10
SHAPES = 30
"""Of SMPL-X's files with 20, only ten are of shape."""
JOINT_ARRAYS = ("joint_names", "joint_pos", "joint_quat")


def joint_arrays(clip: Clip) -> dict[str, np.ndarray]:
    """The arrays of a clip with people as joints."""
    with np.load(io.BytesIO(own_layout.encode(clip, Path()))) as arrays:
        return dict(arrays)


def parameter_arrays(
    clip: Clip, family: Family, folder: Path, *, flat: bool = True, components: int = 0
) -> dict[str, np.ndarray]:
    """Return the arrays of a clip with people as parameters, and write the models that they are of.

    Args:
        clip: of one or two people; the first has the female model, the second the male one.
        family: of the models.
        folder: for the models.
        flat: whether hands are counted from flat ones, or from the model's mean hand.
        components: how many principal components hands are given as; none for rotation vectors.
    """
    people = []
    for person, gender in zip(clip.people, GENDERS, strict=False):
        values, parameters = _person(person, family, flat, components)
        write_npz(folder / f"{family.upper()}_{gender.upper()}.npz", values)
        people.append(parameters)
    joined = {name: np.stack([person[name] for person in people], axis=1) for name in people[0]}
    arrays = {name: values for name, values in joint_arrays(clip).items() if name not in JOINT_ARRAYS}
    return arrays | {
        "body_family": np.array(family),
        "body_gender": np.array(GENDERS[: len(people)]),
        "betas": np.stack([betas_of(1, BETAS)] * len(people)),
        "body_pose": joined["body"],
        "body_translation": joined["translation"],
        "left_hand_pose": joined["left_hand"],
        "right_hand_pose": joined["right_hand"],
        "flat_hands": np.array(flat),
    }


def _person(person: Person, family: Family, flat: bool, components: int) -> tuple[dict, dict[str, np.ndarray]]:
    """A model that is another body, which the first beta makes the person's, and the person's pose."""
    taller = replace(person, joint_positions=1.1 * person.joint_positions)
    values = body_values([taller, person], family, shapes=SHAPES)
    parameters = parameters_of(person, family, None if flat else values)
    frames = len(parameters["root"])
    hands: dict[str, np.ndarray] = {name: parameters[name] for name in ("left_hand", "right_hand")}
    if components:
        hands = add_components(values, hands, components)
    else:
        hands = {name: pose.reshape(frames, 15, 3) for name, pose in hands.items()}
    body = np.concatenate([parameters["root"], parameters["body"]], axis=1).reshape(frames, 22, 3)
    return values, {"body": body, "translation": parameters["translation"], **hands}
