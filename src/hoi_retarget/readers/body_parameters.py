"""People from the parameters of a body model, as sources store them.

Fits to images store betas for every frame, which differ a little between frames.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.errors import ArgumentError, BodyModelError, ClipError
from hoi_retarget.human.body_model import BodyModel, BodyShape, Family
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, PARENT
from hoi_retarget.readers.body_model_files import load_body_model
from hoi_retarget.readers.fields import Fields

LARGEST_CHANGE = 1e-3
"""Of betas between frames that are meant to be one body's."""
LARGEST_GROWTH = 0.05
"""Part of their mean length by which all bones together may be longer or shorter in a frame of one person."""
_CHILDREN = [JOINT_INDEX[joint] for joint, parent in PARENT.items() if parent is not None]
_PARENTS = [JOINT_INDEX[parent] for parent in PARENT.values() if parent is not None]
_BODY = 66
"""Numbers of the pose of the body, before those of the hands."""
FLAT_HANDS = "The recording has no hand poses; the hands are flat."
TITLES: Mapping[Family, str] = MappingProxyType({"smplx": "SMPL-X", "smplh": "SMPL-H"})


@dataclass(frozen=True, eq=False)
class BodyParameters:
    """Shape and pose of one person over time; rotations are rotation vectors [rad]."""

    family: Family
    gender: str
    betas: Float[np.ndarray, "*T b"]
    """Of one body, or as they were fitted in each frame."""
    translation: Float[np.ndarray, "T 3"]
    """[m]"""
    body: Float[np.ndarray, "T 66"]
    """The 22 joints of the body, pelvis first."""
    left_hand: Float[np.ndarray, "T L"]
    """45 numbers of 15 joints, or weights of principal components."""
    right_hand: Float[np.ndarray, "T L"]
    flat_hands: bool
    """Whether hands are counted from flat ones; otherwise from the model's mean hand."""
    template: Float[np.ndarray, "V 3"] | None = None
    """The person's own body at rest [m], in the place of the model's."""

    @classmethod
    def of_rows(cls, pose: Float[np.ndarray, "T n"], **others: Any) -> "BodyParameters":
        """Return parameters whose pose is stored in one row for each frame: body, left hand, right hand."""
        hand = _BODY + (pose.shape[1] - _BODY) // 2
        return cls(body=pose[:, :_BODY], left_hand=pose[:, _BODY:hand], right_hand=pose[:, hand:], **others)

    @classmethod
    def of_fields(cls, fields: Fields, frames: int, *, hand: int, **others: Any) -> "BodyParameters":
        """Return parameters of SMPL-X whose pose is stored by SMPL-X's own names; raises `ClipError`.

        Args:
            fields: What is stored.
            frames: How many frames there must be.
            hand: Numbers of the pose of each hand.
            others: Gender, betas, how hands are counted, and the template.
        """
        root = fields.rows("global_orient", frames, 3, "the pelvis's rotation")
        body = fields.rows("body_pose", frames, _BODY - 3, "the body's pose")
        return cls(
            family="smplx",
            translation=fields.rows("transl", frames, 3, "the body's position"),
            body=np.concatenate([root, body], axis=1),
            left_hand=fields.rows("left_hand_pose", frames, hand, "the left hand's pose"),
            right_hand=fields.rows("right_hand_pose", frames, hand, "the right hand's pose"),
            **others,
        )

    def at(self, frames: slice | Int[np.ndarray, "F"]) -> "BodyParameters":
        """Return the parameters in some of the frames."""
        varying = ("translation", "body", "left_hand", "right_hand", *(("betas",) if self.betas.ndim > 1 else ()))
        return replace(self, **{name: getattr(self, name)[frames] for name in varying})


def person_of(path: Path, name: str, parameters: BodyParameters, body_models: Path | None) -> Person:
    """Return a person from a body's parameters.

    Args:
        path: the recording, for errors.
        name: what the person is called.
        parameters: the body's shape and pose.
        body_models: the user's folder of models.

    Raises:
        BodyModelError: there is no folder, or it lacks the model.
        ReadError: the model is damaged or of another family.
        ClipError: the parameters are not those of this model.
    """
    model = _model(path, parameters, body_models)
    try:
        pose = model.pose(
            parameters.body, parameters.left_hand, parameters.right_hand, flat_hands=parameters.flat_hands
        )
        positions, quats = model.joints(parameters.betas, pose, parameters.translation)
    except ArgumentError as error:
        raise ClipError(f"{path}: person {name!r}: {error}") from error
    shape = BodyShape(model, parameters.betas)
    return Person(name, positions[:, model.skeleton_joints], quats[:, model.skeleton_joints], shape=shape)


def person_of_rows(
    path: Path, name: str, parameters: BodyParameters, body_models: Path | None
) -> tuple[Person, tuple[str, ...]]:
    """Return a person whose body has the betas of one body or of each frame, and what is to be noted of them.

    Rotations do not depend on the shape, and positions depend on it linearly: one body for each component that
    changes is enough.

    Args:
        path: the recording, for errors.
        name: what the person is called.
        parameters: the body's shape and pose.
        body_models: the user's folder of models.

    Raises:
        BodyModelError: there is no folder, or it lacks the model.
        ReadError: the model is damaged or of another family.
        ClipError: the parameters are not those of this model, or of bodies of several sizes.
    """
    rows = np.atleast_2d(parameters.betas)
    change = np.ptp(rows, axis=0)
    if change.max(initial=0.0) <= LARGEST_CHANGE:
        return person_of(path, name, replace(parameters, betas=rows[0]), body_models), ()
    mean = rows.mean(axis=0)
    person = person_of(path, name, replace(parameters, betas=mean), body_models)
    positions = person.joint_positions.copy()
    for component in np.flatnonzero(change):
        unit = (np.arange(len(mean)) == component).astype(float)
        other = person_of(path, name, replace(parameters, betas=mean + unit), body_models)
        weights = (rows[:, component] - mean[component])[:, None, None]
        positions += weights * (other.joint_positions - person.joint_positions)
    lengths = np.linalg.norm(positions[:, _CHILDREN] - positions[:, _PARENTS], axis=-1).sum(axis=1)
    growth = float(np.abs(lengths / lengths.mean() - 1.0).max())
    if growth > LARGEST_GROWTH:
        raise ClipError(
            f"{path}: the betas change by {change.max():.3g} over the recording, which makes bones up to {growth:.0%} "
            "longer or shorter than they are on average. Are these frames of several people?"
        )
    note = (
        f"The betas change by up to {change.max():.2g} over the recording, as they were fitted frame by frame: bones "
        f"are up to {growth:.1%} longer or shorter than on average."
    )
    return replace(person, joint_positions=positions), (note,)


def constant_betas(path: Path, rows: Float[np.ndarray, "T b"]) -> Float[np.ndarray, "b"]:
    """Return the betas of a body that are stored for every frame; raises `ClipError` where they change."""
    change = float(np.ptp(rows, axis=0).max(initial=0.0))
    if change > LARGEST_CHANGE:
        raise ClipError(
            f"{path}: the betas change by {change:.3g} over the recording, expected those of one body. "
            "Are these frames of several people?"
        )
    return rows[0]


def _model(path: Path, parameters: BodyParameters, folder: Path | None) -> BodyModel:
    what = f"the {parameters.gender} {TITLES[parameters.family]} body model"
    if folder is None:
        raise BodyModelError(
            f"{path}: the recording holds parameters of {what}, not joints. Download it from its makers, whose terms "
            "forbid to ship it here, and pass --body-models DIR."
        )
    if not folder.exists():
        raise BodyModelError(f"--body-models {folder}: there is no such folder. {path} needs {what}.")
    try:
        model = _loaded(folder, parameters.gender, parameters.family)
    except ArgumentError as error:
        raise ClipError(f"{path}: {error}") from error
    if parameters.template is None:
        return model
    if parameters.template.shape != model.template.shape:
        raise ClipError(
            f"{path}: the person's own body has {len(parameters.template)} vertices, {what} {len(model.template)}. "
            "Use the model that it was made with."
        )
    return replace(model, template=parameters.template)


@lru_cache(maxsize=8)
def _loaded(folder: Path, gender: str, family: str) -> BodyModel:
    return load_body_model(folder, gender, family)
