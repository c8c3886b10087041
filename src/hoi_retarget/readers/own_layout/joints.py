"""People given as joints: world positions and rotations, with fingers or without."""

import difflib
from pathlib import Path

import numpy as np

from hoi_retarget.errors import ClipError
from hoi_retarget.human import fingers, rest_pose
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, LEFT_FINGERS, RIGHT_FINGERS
from hoi_retarget.readers.own_layout.arrays import Arrays, check_unit
from hoi_retarget.readers.own_layout.layout import DOCUMENT, NUMBERS, TEXT

ARRAYS = ("joint_names", "joint_pos", "joint_quat")
BODY_JOINTS = tuple(joint for joint in JOINTS if joint not in (*LEFT_FINGERS, *RIGHT_FINGERS))
"""The joints that every clip has."""


def people_of(arrays: Arrays) -> tuple[tuple[Person, ...], tuple[str, ...]]:
    """Return the people, and notes of what was derived; raises `ClipError`."""
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
        fingers.add_straight_fingers(all_positions, all_quats)
        notes = (fingers.NOTE,)
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
    fit = rest_pose.agreement(person.joint_positions, person.joint_quats)
    if fit < rest_pose.LEAST_AGREEMENT:
        raise ClipError(
            f"{path}: person {person.name!r}: joint_quat does not fit joint_pos: in its parent's frame a knee or an "
            f"elbow lies {np.rad2deg(np.arccos(np.clip(fit, -1, 1))):.0f} deg from where the T-pose has it. Rotations "
            "are of the world, wxyz, and identity in the T-pose that stands along +y and looks along +z. "
            f"{DOCUMENT}"
        )
