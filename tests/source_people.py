"""A clip's people as the parameters of a body model, and that model: what sources' files are written from in tests."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from body_writer import CORNERS, names_of, tiny_model, write_npz
from hoi_retarget.clip.clip import Clip
from hoi_retarget.human.body_model import Family
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, PARENT
from hoi_retarget.numerics import se3
from hoi_retarget.readers.worlds import TURN

PELVIS = np.array([0.01, -0.35, 0.02])  # Where the model's pelvis is at rest: away from its origin, as in real ones.


def rest_joints(person: Person, family: Family) -> np.ndarray:
    """Where the model's joints are in the T-pose of a person with rigid bones, (J, 3)."""
    names = names_of(family)
    rest = np.zeros((len(names), 3))
    for index, name in enumerate(names):
        if name == "pelvis":
            rest[index] = PELVIS
        elif name in JOINT_INDEX:
            parent = str(PARENT[name])
            bone = se3.rotate_inverse(person.quat(parent), person.position(name) - person.position(parent))
            rest[index] = rest[names.index(parent)] + bone.mean(axis=0)
        else:
            rest[index] = rest[names.index("head")] + [0.0, 0.05, 0.05]
    return rest


def body_values(people: Sequence[Person], family: Family, **settings) -> dict[str, np.ndarray]:
    """The arrays of a model that is the first person's body; the k-th beta makes it that of the k+1-th person."""
    middles = [rest_joints(person, family) for person in people]
    values = tiny_model(family, middles=middles[0], **settings)
    for index, other in enumerate(middles[1:]):
        values["shapedirs"][..., index] = np.repeat(other - middles[0], CORNERS, axis=0)
    return values


def write_models(folder: Path, people: Sequence[Person], family: Family, genders: Sequence[str], **settings) -> Path:
    """Write the model's file for each gender into a folder, which is returned."""
    for gender in genders:
        write_npz(folder / f"{family.upper()}_{gender.upper()}.npz", body_values(people, family, **settings))
    return folder


def write_taller_model(folder: Path, person: Person, family: Family, gender: str, **settings) -> Path:
    """Write the model of a taller body, which the first beta makes the person's; its folder is returned."""
    taller = replace(person, joint_positions=1.1 * person.joint_positions)
    return write_models(folder, [taller, person], family, [gender], **settings)


def betas_of(index: int, count: int) -> np.ndarray:
    """The betas of the index-th person of `body_values`."""
    betas = np.zeros(count)
    if index:
        betas[index - 1] = 1.0
    return betas


def parameters_of(person: Person, family: Family, mean_hands: dict[str, np.ndarray] | None = None) -> dict:
    """Pose parameters of a person: `root` (T, 3), `body` (T, 63), hands (T, 45) [rad], `translation` (T, 3) [m].

    With `mean_hands`, a model's arrays, hands are counted from its mean hand.
    """
    local = np.stack(
        [
            person.quat(name)
            if PARENT[name] is None
            else se3.quat_multiply(se3.quat_conjugate(person.quat(str(PARENT[name]))), person.quat(name))
            for name in JOINTS
        ],
        axis=1,
    )
    pose = se3.log(local)
    frames = len(pose)
    hands = {"left_hand": pose[:, 22:37].reshape(frames, 45), "right_hand": pose[:, 37:].reshape(frames, 45)}
    if mean_hands is not None:
        hands["left_hand"] = hands["left_hand"] - mean_hands["hands_meanl"]
        hands["right_hand"] = hands["right_hand"] - mean_hands["hands_meanr"]
    return {
        "root": pose[:, 0],
        "body": pose[:, 1:22].reshape(frames, 63),
        "translation": person.position("pelvis") - PELVIS,
        **hands,
    }


def in_world(clip: Clip, up: str) -> Clip:
    """The clip in a world where another axis is up: what a reader turns back."""
    return moved(clip, se3.quat_conjugate(TURN[up]), np.zeros(3))


def moved(clip: Clip, turn: np.ndarray, shift: np.ndarray) -> Clip:
    """The clip turned, wxyz, then shifted [m]."""
    people = tuple(
        replace(
            person,
            joint_positions=se3.rotate(turn, person.joint_positions) + shift,
            joint_quats=se3.quat_multiply(turn, person.joint_quats),
        )
        for person in clip.people
    )
    tracks = tuple(
        replace(track, positions=se3.rotate(turn, track.positions) + shift, quats=se3.quat_multiply(turn, track.quats))
        for track in clip.objects
    )
    return replace(clip, people=people, objects=tracks)


def joined(numbers: dict[str, np.ndarray]) -> np.ndarray:
    """Pose parameters in one row for each frame: root, body, left hand, right hand."""
    return np.concatenate([numbers[name] for name in ("root", "body", "left_hand", "right_hand")], axis=1)


def assert_same_people(read: Clip, written: Clip, *, tolerance: float = 1e-6) -> None:
    """Positions [m] and rotations of all people agree."""
    assert len(read.people) == len(written.people)
    for ours, theirs in zip(read.people, written.people, strict=True):
        np.testing.assert_allclose(ours.joint_positions, theirs.joint_positions, atol=tolerance)
        turns = np.abs(np.sum(ours.joint_quats * theirs.joint_quats, axis=-1))
        np.testing.assert_allclose(turns, 1.0, atol=tolerance)


def assert_same_objects(read: Clip, written: Clip, *, tolerance: float = 1e-6) -> None:
    """Every point of every object is in the same place of the world, whatever the origin of its frame.

    Bodies are compared as the solids that their points span: extremes along many directions.
    """
    assert [track.name for track in read.objects] == [track.name for track in written.objects]
    directions = np.random.default_rng(0).normal(size=(20, 3))
    for ours, theirs in zip(read.objects, written.objects, strict=True):
        np.testing.assert_allclose(_extents(ours, directions), _extents(theirs, directions), atol=tolerance)


def _extents(track, directions: np.ndarray) -> np.ndarray:
    local = se3.rotate_inverse(track.quats[:, None], directions[None])
    along = (local @ track.geometry.points.T).max(axis=-1)
    return along + track.positions @ directions.T
