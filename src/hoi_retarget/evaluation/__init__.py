"""Figures of merit of a robot's motion: its likeness to the human's, and its violations."""

from hoi_retarget.evaluation.comparison import Comparison, Figure
from hoi_retarget.evaluation.figure_table import (
    COLUMNS,
    Score,
    mean_values,
    table_rows,
    to_csv,
    to_json,
    worst_values,
)
from hoi_retarget.evaluation.figures import FIGURES, evaluate, figures_of
from hoi_retarget.evaluation.multi_robot import inter_robot_hand_errors, inter_robot_penetrations, robot_depths
from hoi_retarget.evaluation.penetration import sunk_links
from hoi_retarget.evaluation.soundness import SOUNDNESS, soundness
from hoi_retarget.evaluation.unreached_contacts import (
    contact_residuals,
    surface_residuals,
    thin_air_contacts,
    unreached_contacts,
)

__all__ = [
    "COLUMNS",
    "FIGURES",
    "SOUNDNESS",
    "Comparison",
    "Figure",
    "Score",
    "contact_residuals",
    "evaluate",
    "figures_of",
    "inter_robot_hand_errors",
    "inter_robot_penetrations",
    "mean_values",
    "robot_depths",
    "soundness",
    "sunk_links",
    "surface_residuals",
    "table_rows",
    "thin_air_contacts",
    "to_csv",
    "to_json",
    "unreached_contacts",
    "worst_values",
]
