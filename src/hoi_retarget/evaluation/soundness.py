"""Figures of a robot's motion by itself, without the clip that it was made from, over every frame."""

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.evaluation.comparison import Figure, max_or_none, mean_or_none, norms
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import repeated
from hoi_retarget.robots.model import Kinematics

_MIN_STANDING_HEIGHT = 0.05  # [m]

SOUNDNESS = (
    Figure("sole_tilt_deg", "sole tilt", "deg", "Median angle between soles and floor in stance", needs_floor=True),
    Figure("frozen_share", "frozen frames", "%", "Share of the frames that repeat the one before them"),
    Figure("base_speed_max_mps", "base speed", "m/s", "Largest speed of the base"),
    Figure("base_turn_max_radps", "base turn", "rad/s", "Largest turning speed of the base"),
    Figure(
        "base_height_min_share",
        "base height, lowest",
        "%",
        "Lowest height of the base, over that of standing",
        digits=0,
        better="higher",
        needs_floor=True,
    ),
    Figure(
        "base_height_max_share",
        "base height, highest",
        "%",
        "Greatest height of the base, over that of standing",
        digits=0,
        needs_floor=True,
    ),
)


def soundness(
    qpos: Float[np.ndarray, "T nq"],
    fps: float,
    kinematics: Kinematics,
    stance: Bool[np.ndarray, "T 2"],
    standing_height: float,
) -> dict[str, float | None]:
    """Return the values of `SOUNDNESS` by name; None where undefined.

    Args: `qpos`: root position [m], root rotation wxyz, joints [rad]; `fps`: frames a second; `kinematics`: the model's
    `forward(qpos)`; `stance`: left and right foot on the floor; `standing_height`: of the base, in the robot's home
    pose [m].
    """
    tilts = sole_tilts_deg(kinematics)[stance]
    # A root link on wheels may be on the floor, and has no height to speak of.
    heights = qpos[:, 2] / standing_height if standing_height > _MIN_STANDING_HEIGHT else np.zeros(0)
    return {
        "sole_tilt_deg": float(np.median(tilts)) if tilts.size else None,
        "frozen_share": mean_or_none(repeated(qpos).astype(float)),
        "base_speed_max_mps": max_or_none(norms(np.diff(qpos[:, :3], axis=0)) * fps),
        "base_turn_max_radps": max_or_none(se3.angle_between(qpos[1:, 3:7], qpos[:-1, 3:7]) * fps),
        "base_height_min_share": float(heights.min()) if heights.size else None,
        "base_height_max_share": max_or_none(heights),
    }


def sole_tilts_deg(kinematics: Kinematics) -> Float[np.ndarray, "T 2"]:
    """Return the angle between the vertical and the normal of each foot's sole [deg]; 180 is upside down."""
    heel_inner, heel_outer, toe_inner, toe_outer = np.moveaxis(kinematics.soles(), 2, 0)
    normals = np.cross(toe_inner - heel_outer, toe_outer - heel_inner)
    up = normals[..., 2] * [1.0, -1.0]  # Inner and outer corners of the right foot are mirrored.
    return np.degrees(np.arctan2(norms(normals[..., :2]), up))
