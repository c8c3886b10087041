"""The people of a clip: given as joints or as parameters of a body model, and upright by what they are."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from hoi_retarget.errors import ClipError
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINTS
from hoi_retarget.readers.body_parameters import TITLES
from hoi_retarget.readers.own_layout import joints, parameters
from hoi_retarget.readers.own_layout.arrays import Arrays
from hoi_retarget.readers.own_layout.layout import DOCUMENT, HEIGHTS, NUMBERS
from hoi_retarget.readers.upright import LEAST_ON_FLOOR, SHORTEST, TALLEST, share_on_floor, standing_axis


def people_of(arrays: Arrays, body_models: Path | None) -> tuple[tuple[Person, ...], tuple[str, ...]]:
    """Return the people, and notes of what was derived.

    Raises:
        ClipError: arrays are missing, disagree, or contradict what the layout says.
        BodyModelError: they are parameters, and there is no folder of models.
        ReadError: the model is not there, damaged, or of another family.
    """
    made, notes = parameters.people_of(arrays, body_models) if are_parameters(arrays) else joints.people_of(arrays)
    if HEIGHTS in arrays:
        heights = arrays.array(HEIGHTS, NUMBERS, (len(made),), "standing heights [m]").tolist()
        made = tuple(replace(person, stature=height) for person, height in zip(made, heights, strict=True))
    for person in made:
        _check(arrays.path, person)
    return made, notes


def summary_of(arrays: Arrays) -> tuple[int, int, str]:
    """Return the numbers of frames and of people, and what these are given as; raises `ClipError`."""
    if are_parameters(arrays):
        family, genders, betas, poses = parameters.bodies_and_poses(arrays)
        genders = " and ".join(dict.fromkeys(genders))
        given = f"from parameters of {TITLES[family]} {genders}, {betas.shape[1]} betas"
    else:
        _, poses = joints.names_and_positions(arrays)
        given = "positions and rotations"
    frames, people = poses.shape[:2]
    return frames, people, f"{len(JOINTS)} joints{'' if people == 1 else f' of {people} people'}, {given}"


def are_parameters(arrays: Arrays) -> bool:
    """Return whether people are given as parameters, not as joints; raises `ClipError` for both and for neither."""
    as_joints, as_parameters = ([name for name in way if name in arrays] for way in (joints.ARRAYS, parameters.ARRAYS))
    if as_joints and as_parameters:
        raise ClipError(
            f"{arrays.path}: people are given twice, as joints ({', '.join(as_joints)}) and as parameters of a body "
            f"model ({', '.join(as_parameters)}). Give them in one way. {DOCUMENT}"
        )
    if not as_joints and not as_parameters:
        raise ClipError(
            f"{arrays.path}: there is nobody in the clip: it has neither joints ({', '.join(joints.ARRAYS)}) nor "
            f"parameters of a body model (body_family, body_pose and others). {DOCUMENT}"
        )
    return bool(as_parameters)


def _check(path: Path, person: Person) -> None:
    """Raise `ClipError` when a person is in another unit, of another body, or has another up axis."""
    height = person.height
    if not SHORTEST <= height <= TALLEST:
        advice = (
            "Lengths are in metres: divide by 1000 if these are millimetres, by 100 if centimetres."
            if person.shape is None
            else "Check the betas, and that the body model is the one that they were fitted with."
        )
        raise ClipError(f"{path}: person {person.name!r} would be {height:.4g} m tall. {advice} {DOCUMENT}")
    axis = standing_axis(person.joint_positions)
    on_floor = share_on_floor(person)
    if axis != "z" and on_floor < LEAST_ON_FLOOR:
        lowest = person.joint_positions[..., 2].min(axis=1)
        raise ClipError(
            f"{path}: person {person.name!r} stands along {axis}, the lowest joint mostly at z = "
            f"{np.median(lowest):.2f} m and near 0 in {on_floor:.0%} of the frames, but z is up and the floor at 0. "
            f"Turn and shift the recording. {DOCUMENT}"
        )
