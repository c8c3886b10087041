"""People of a clip: joints of the world, with fingers or without, or parameters of SMPL-X or SMPL-H; all upright."""

import difflib
from dataclasses import replace
from pathlib import Path
from typing import cast, get_args

import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import ClipError
from hoi_retarget.human import skeleton, t_pose
from hoi_retarget.human.body_model import Family, Gender
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, LEFT_FINGERS, RIGHT_FINGERS
from hoi_retarget.readers.body_parameters import TITLES, BodyParameters, person_of
from hoi_retarget.readers.own_layout.own_arrays import DOCUMENT, FLAGS, HEIGHTS, NUMBERS, TEXT, Arrays, check_unit
from hoi_retarget.readers.worlds import MAX_HEIGHT, MIN_HEIGHT, MIN_SHARE_ON_FLOOR, share_on_floor, standing_axis

JOINT_ARRAYS = ("joint_names", "joint_pos", "joint_quat")
BODY_JOINTS = tuple(joint for joint in JOINTS if joint not in (*LEFT_FINGERS, *RIGHT_FINGERS))
"""The joints that every clip has."""


def people_of_joints(arrays: Arrays) -> tuple[tuple[Person, ...], tuple[str, ...]]:
    """Return the people, and notes of derived parts; raises `ClipError`."""
    names, positions = names_and_positions(arrays)
    frames, people = positions.shape[:2]
    quats = arrays.array("joint_quat", NUMBERS, (frames, people, len(names), 4), "joint rotations, wxyz")
    check_unit(arrays.path, "joint_quat", quats)
    called = arrays.person_names(people)
    present = [JOINT_INDEX[name] for name in names]
    all_positions, all_quats = np.zeros((frames, people, len(JOINTS), 3)), np.zeros((frames, people, len(JOINTS), 4))
    all_positions[:, :, present], all_quats[:, :, present] = positions, quats
    notes = ()
    recorded = len(names) == len(JOINTS)
    if not recorded:
        skeleton.add_straight_fingers(all_positions, all_quats)
        notes = (skeleton.STRAIGHT_FINGERS,)
    made = tuple(
        Person(name, all_positions[:, i], all_quats[:, i], fingers_recorded=recorded) for i, name in enumerate(called)
    )
    for person in made:
        _check_rotations(arrays.path, person)
    return made, notes


def names_and_positions(arrays: Arrays) -> tuple[list[str], np.ndarray]:
    """Return the joints' names and positions [m], as they are given; raises `ClipError`."""
    names = arrays.array("joint_names", TEXT, ("J",), "the joints, in the order of the arrays").tolist()
    _check_names(arrays.path, names)
    return names, arrays.people("joint_pos", (len(names), 3), "joint positions [m]")


def _check_names(path: Path, names: list[str]) -> None:
    unknown = [name for name in names if name not in JOINT_INDEX]
    if unknown:
        close = difflib.get_close_matches(unknown[0], JOINTS, n=1)
        hint = f"Did you mean {close[0]!r}? " if close else ""
        raise ClipError(
            f"{path}: joint_names has {unknown[0][:40]!r}, which is no joint. {hint}Joints: {', '.join(JOINTS)}."
        )
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ClipError(f"{path}: joint_names has {twice!r} twice. Name every joint once.")
    absent = [joint for joint in BODY_JOINTS if joint not in names]
    if absent:
        raise ClipError(
            f"{path}: joint_names lacks {', '.join(absent)}. All {len(BODY_JOINTS)} joints of the body are needed; "
            "only the fingers can be left out."
        )
    fingers = [joint for joint in JOINTS if joint not in BODY_JOINTS]
    absent = [joint for joint in fingers if joint not in names]
    if absent and len(absent) < len(fingers):
        raise ClipError(
            f"{path}: joint_names has some fingers but lacks {', '.join(absent)}. Give all {len(fingers)} finger "
            "joints or none."
        )


def _check_rotations(path: Path, person: Person) -> None:
    """Raise `ClipError` when rotations are in another order, or counted from another pose than the T-pose."""
    fit = t_pose.agreement(person.joint_positions, person.joint_quats)
    if fit < t_pose.MIN_T_POSE_AGREEMENT:
        raise ClipError(
            f"{path}: person {person.name!r}: joint_quat does not fit joint_pos: in its parent's frame a knee or an "
            f"elbow lies {np.rad2deg(np.arccos(np.clip(fit, -1, 1))):.0f} deg from where the T-pose has it. Rotations "
            "are of the world, wxyz, and identity in the T-pose that stands along +y and looks along +z. "
            f"{DOCUMENT}"
        )


HANDS = ("left_hand_pose", "right_hand_pose")
PARAMETER_ARRAYS = ("body_family", "body_gender", "betas", "body_pose", "body_translation", *HANDS, "flat_hands")

_BODY_JOINTS, _HAND_JOINTS = 22, 15
_FLAT = "The clip has no hand poses; the hands are flat."


def people_of_parameters(arrays: Arrays, body_models: Path | None) -> tuple[tuple[Person, ...], tuple[str, ...]]:
    """Return the people, and notes of decisions; raises as `people_of`."""
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


def people_of(arrays: Arrays, body_models: Path | None) -> tuple[tuple[Person, ...], tuple[str, ...]]:
    """Return the people, and notes of derived parts.

    Raises `ClipError`: arrays are missing, disagree, contradict the layout, or are not of the body model;
    `BodyModelError`: they are parameters, and there is no folder of models; `ReadError`: the model is not there,
    damaged, or of another family.
    """
    made, notes = people_of_parameters(arrays, body_models) if are_parameters(arrays) else people_of_joints(arrays)
    if HEIGHTS in arrays:
        heights = arrays.array(HEIGHTS, NUMBERS, (len(made),), "standing heights [m]").tolist()
        made = tuple(replace(person, stature=height) for person, height in zip(made, heights, strict=True))
    for person in made:
        _check(arrays.path, person)
    return made, notes


def summary_of(arrays: Arrays) -> tuple[int, int, str]:
    """Return the numbers of frames and of people, and the kind of their data; raises `ClipError`."""
    if are_parameters(arrays):
        family, genders, betas, poses = bodies_and_poses(arrays)
        genders = " and ".join(dict.fromkeys(genders))
        given = f"from parameters of {TITLES[family]} {genders}, {betas.shape[1]} betas"
    else:
        _, poses = names_and_positions(arrays)
        given = "positions and rotations"
    frames, people = poses.shape[:2]
    return frames, people, f"{len(JOINTS)} joints{'' if people == 1 else f' of {people} people'}, {given}"


def are_parameters(arrays: Arrays) -> bool:
    """Return whether people are given as parameters, not as joints; raises `ClipError` for both and for neither."""
    as_joints, as_parameters = ([name for name in way if name in arrays] for way in (JOINT_ARRAYS, PARAMETER_ARRAYS))
    if as_joints and as_parameters:
        raise ClipError(
            f"{arrays.path}: people are given twice, as joints ({', '.join(as_joints)}) and as parameters of a body "
            f"model ({', '.join(as_parameters)}). Give them in one way. {DOCUMENT}"
        )
    if not as_joints and not as_parameters:
        raise ClipError(
            f"{arrays.path}: there is nobody in the clip: it has neither joints ({', '.join(JOINT_ARRAYS)}) nor "
            f"parameters of a body model (body_family, body_pose and others). {DOCUMENT}"
        )
    return bool(as_parameters)


def _check(path: Path, person: Person) -> None:
    """Raise `ClipError` when a person is in another unit, of another body, or has another up axis."""
    height = person.height
    if not MIN_HEIGHT <= height <= MAX_HEIGHT:
        advice = (
            "Lengths are in metres: divide by 1000 if these are millimetres, by 100 if centimetres."
            if person.shape is None
            else "Check the betas, and that the body model is the one that they were fitted with."
        )
        raise ClipError(f"{path}: person {person.name!r} would be {height:.4g} m tall. {advice} {DOCUMENT}")
    axis = standing_axis(person.joint_positions)
    on_floor = share_on_floor(person)
    if axis != "z" and on_floor < MIN_SHARE_ON_FLOOR:
        lowest = person.joint_positions[..., 2].min(axis=1)
        raise ClipError(
            f"{path}: person {person.name!r} stands along {axis}, the lowest joint mostly at z = "
            f"{np.median(lowest):.2f} m and near 0 in {on_floor:.0%} of the frames, but z is up and the floor at 0. "
            f"Turn and shift the recording. {DOCUMENT}"
        )
