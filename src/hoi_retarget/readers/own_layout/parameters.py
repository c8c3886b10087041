"""People given as parameters of a body model, SMPL-X or SMPL-H, which the user has from its makers."""

from pathlib import Path
from typing import cast, get_args

import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import ClipError
from hoi_retarget.human.body_model import Family, Gender
from hoi_retarget.human.person import Person
from hoi_retarget.readers.body_parameters import BodyParameters, person_of
from hoi_retarget.readers.own_layout.arrays import Arrays
from hoi_retarget.readers.own_layout.layout import DOCUMENT, FLAGS, NUMBERS, TEXT

HANDS = ("left_hand_pose", "right_hand_pose")
ARRAYS = ("body_family", "body_gender", "betas", "body_pose", "body_translation", *HANDS, "flat_hands")

_BODY_JOINTS, _HAND_JOINTS = 22, 15
_FLAT = "The clip has no hand poses; the hands are flat."


def people_of(arrays: Arrays, body_models: Path | None) -> tuple[tuple[Person, ...], tuple[str, ...]]:
    """Return the people, and notes of what was decided.

    Raises:
        ClipError: arrays are missing, disagree, or are not of the model.
        BodyModelError: there is no folder of models.
        ReadError: the model is not there, damaged, or of another family.
    """
    family, genders, betas, pose = bodies_and_poses(arrays)
    frames, people = pose.shape[:2]
    called = arrays.person_names(people)
    translation = arrays.array("body_translation", NUMBERS, (frames, people, 3), "where the bodies are [m]")
    left, right, flat = _hands(arrays, frames, people)
    made = tuple(
        person_of(
            arrays.path,
            name,
            BodyParameters(
                family=family,
                gender=genders[index],
                betas=betas[index].astype(float),
                translation=translation[:, index].astype(float),
                body=pose[:, index].reshape(frames, -1).astype(float),
                left_hand=left[:, index].astype(float),
                right_hand=right[:, index].astype(float),
                flat_hands=flat,
            ),
            body_models,
        )
        for index, name in enumerate(called)
    )
    return made, () if HANDS[0] in arrays else (_FLAT,)


def bodies_and_poses(arrays: Arrays) -> tuple[Family, list[Gender], np.ndarray, np.ndarray]:
    """Return the family of the model, each person's gender and betas, and the body poses; raises `ClipError`."""
    family = cast(Family, _one_of(arrays, arrays.text("body_family", "whose body model"), "body_family", Family))
    pose = arrays.people("body_pose", (_BODY_JOINTS, 3), "rotation vectors of the body, pelvis first [rad]")
    people = pose.shape[1]
    genders = arrays.array("body_gender", TEXT, (people,), "the gender of each person's model").tolist()
    for gender in genders:
        _one_of(arrays, gender, "body_gender", Gender)
    return family, genders, arrays.array("betas", NUMBERS, (people, "b"), "the shape of each person"), pose


def _one_of(arrays: Arrays, value: str, name: str, kinds: object) -> str:
    known = get_args(kinds)
    if value not in known:
        raise ClipError(f"{arrays.path}: {name} has {value[:40]!r}, expected one of {', '.join(known)}. {DOCUMENT}")
    return value


def _hands(
    arrays: Arrays, frames: int, people: int
) -> tuple[Float[np.ndarray, "T P L"], Float[np.ndarray, "T P L"], bool]:
    """Return both hands' poses, as `bodies.BodyModel.pose` takes them, and whether they are counted from flat ones."""
    given = [name for name in HANDS if name in arrays]
    if len(given) == 1:
        (absent,) = set(HANDS) - set(given)
        raise ClipError(f"{arrays.path}: the clip has {given[0]}, but no {absent}. Give both hands or none. {DOCUMENT}")
    if not given:
        if "flat_hands" in arrays and not _flag(arrays):
            raise ClipError(
                f"{arrays.path}: flat_hands is false, but there are no hand poses that could be counted from mean "
                f"hands. Give {' and '.join(HANDS)}, or leave flat_hands out: hands are then flat."
            )
        flat = np.zeros((frames, people, 3 * _HAND_JOINTS))
        return flat, flat, True
    left, right = (_hand(arrays, name, frames, people) for name in HANDS)
    if left.shape != right.shape:
        raise ClipError(
            f"{arrays.path}: {HANDS[0]} has {left.shape[2]} numbers for each person and frame, {HANDS[1]} "
            f"{right.shape[2]}. Give both hands as rotation vectors, or both as equally many principal components."
        )
    return left, right, _flag(arrays)


def _flag(arrays: Arrays) -> bool:
    return bool(arrays.array("flat_hands", FLAGS, (), "whether hands are counted from flat ones, or from mean ones"))


def _hand(arrays: Arrays, name: str, frames: int, people: int) -> Float[np.ndarray, "T P L"]:
    if arrays.dimensions(name) != 3:
        meaning = "rotation vectors of a hand's joints [rad]"
        rotations = arrays.array(name, NUMBERS, (frames, people, _HAND_JOINTS, 3), meaning)
        return rotations.reshape(frames, people, -1)
    components = arrays.array(name, NUMBERS, (frames, people, "c"), "principal components of a hand's pose")
    count = components.shape[2]
    if count == 3 * _HAND_JOINTS:  # Whether they are rotations or all components that there are, nobody can tell.
        raise ClipError(
            f"{arrays.path}: {name} has {count} numbers for each person and frame. Rotation vectors have the shape "
            f"(T, P, {_HAND_JOINTS}, 3); of principal components give fewer."
        )
    return components
