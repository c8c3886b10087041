"""All figures of one robot on its clip, by module as they stand there, and of a motion by itself, without a clip."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.clip import Clip
from hoi_retarget.dynamics.physics_settings import FigureSet
from hoi_retarget.evaluation import contact_figures, hand_slip, motion_figures, penetration, physics_figures
from hoi_retarget.evaluation.comparison import Comparison, Figure, max_or_none, mean_or_none, norms
from hoi_retarget.evaluation.physics_figures import performed_figures
from hoi_retarget.motion.motion import Motion, check_robot
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import repeated
from hoi_retarget.robots.model import Kinematics, RobotModel

_MODULES = (contact_figures, hand_slip, penetration, motion_figures)
FIGURES: tuple[Figure, ...] = (
    *(value for module in _MODULES for value in vars(module).values() if isinstance(value, Figure)),
    *physics_figures.FEASIBILITY,
    *physics_figures.GRIP,
)


def evaluate(
    motion: Motion, clip: Clip, model: RobotModel, *, person: int = 0, figures: FigureSet = "all"
) -> Mapping[str, float | None]:
    """Return the figures of a motion against the clip it was made from, by names that end in their units.

    Args: `motion`: the robot's motion; its frames are exactly the clip's; `clip`: the human side; `model`: the robot of
    the motion; `person`: index of the person that the robot follows; `figures`: which figures are computed. Raises
    `ClipError`: the motion does not cover the clip's frames, rate and objects; `RobotError`: the motion's joints are
    not the model's; `ArgumentError`: there is no such person.
    """
    check_robot(motion, model)
    return figures_of(Comparison(motion, clip, person, model.forward(motion.qpos)), figures)


def figures_of(view: Comparison, chosen: FigureSet = "all") -> Mapping[str, float | None]:
    """Return the figures of a comparison by names that end in their units, those of simulated motions too."""
    if chosen == "none":
        return {}
    measured = {
        figure.name: figure.measure(view)
        for figure in FIGURES
        if figure.measure is not None and (chosen == "all" or not figure.slow)
    }
    return measured | performed_figures(view.motion)


_MIN_STANDING_HEIGHT = 0.05  # [m]
_OVER = "height of the base, over that of standing"

SOUNDNESS = (
    Figure("sole_tilt_deg", "sole tilt", "deg", "Median angle between soles and floor in stance", needs_floor=True),
    Figure("frozen_share", "frozen frames", "%", "Share of the frames that repeat the one before them"),
    Figure("base_speed_max_mps", "base speed", "m/s", "Largest speed of the base"),
    Figure("base_turn_max_radps", "base turn", "rad/s", "Largest turning speed of the base"),
    Figure("base_height_min_share", "base height, lowest", "%", f"Lowest {_OVER}", None, 0, "higher", needs_floor=True),
    Figure("base_height_max_share", "base height, highest", "%", f"Greatest {_OVER}", digits=0, needs_floor=True),
)
"""Figures of every frame of a motion, that need no clip."""


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
