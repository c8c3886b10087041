"""Rotations and poses that sources store as matrices."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import ClipError
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import describe_frames

LARGEST_DEVIATION = 0.01
"""Of a rotation times its transpose from the identity: rounding and smoothing stay below, sizes and shears do not."""
_LAST_ROW = np.array([0.0, 0.0, 0.0, 1.0])


def quats_of(path: Path, name: str, matrices: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T 4"]:
    """Return rotations, wxyz, from matrices that turn columns.

    Args:
        path: the recording, for errors.
        name: what the matrices are called, for errors.
        matrices: the rotations.

    Raises:
        ClipError: they are no rotations, but mirror, scale or shear.
    """
    deviation = np.abs(np.einsum("tji,tjk->tik", matrices, matrices) - np.eye(3)).max(axis=(1, 2))
    bad = deviation > LARGEST_DEVIATION
    if bad.any():
        raise ClipError(
            f"{path}: {name} is no rotation in {describe_frames(np.flatnonzero(bad))}: its columns are not of unit "
            f"length or not at right angles, by up to {deviation.max():.3g}. Download the recording again."
        )
    mirrored = np.linalg.det(matrices) < 0
    if mirrored.any():
        raise ClipError(
            f"{path}: {name} mirrors in {describe_frames(np.flatnonzero(mirrored))}, which no rotation does. "
            "Download the recording again."
        )
    return se3.matrix_to_quat(matrices)


def poses_of(
    path: Path, name: str, matrices: Float[np.ndarray, "T 4 4"]
) -> tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 4"]]:
    """Return positions [m] and rotations, wxyz, from matrices that move columns; otherwise as `quats_of`."""
    if (np.abs(matrices[:, 3] - _LAST_ROW) > LARGEST_DEVIATION).any():
        raise ClipError(
            f"{path}: {name} holds matrices whose last row is not 0, 0, 0, 1. Transposed ones have the position there: "
            "save them so that they move columns."
        )
    return matrices[:, :3, 3], quats_of(path, name, matrices[:, :3, :3])
