"""People whose betas are stored for every frame and differ a little between frames, as fits to images do."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from hoi_retarget.errors import ClipError
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, PARENT
from hoi_retarget.readers.body_parameters import LARGEST_CHANGE, BodyParameters, person_of

LARGEST_GROWTH = 0.05
"""Part of their mean length by which all bones together may be longer or shorter in a frame of one person."""
_CHILDREN = [JOINT_INDEX[joint] for joint, parent in PARENT.items() if parent is not None]
_PARENTS = [JOINT_INDEX[parent] for parent in PARENT.values() if parent is not None]


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
