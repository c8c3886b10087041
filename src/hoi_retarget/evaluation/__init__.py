"""Figures of merit: how well a robot's motion keeps what the human did, and what it violates."""

from hoi_retarget.evaluation.figure import Figure
from hoi_retarget.evaluation.figures import FIGURES, evaluate, evaluate_kinematics, figures_of
from hoi_retarget.evaluation.multi_robot import inter_robot_hand_errors, inter_robot_penetrations, robot_depths
from hoi_retarget.evaluation.soundness import Soundness, soundness
from hoi_retarget.evaluation.sunk_links import sunk_links
from hoi_retarget.evaluation.table import (
    COLUMNS,
    Score,
    mean_values,
    shown_columns,
    table_rows,
    to_csv,
    to_json,
    worst_values,
)
from hoi_retarget.evaluation.unreached_contacts import contact_residuals, surface_residuals, unreached_contacts
from hoi_retarget.evaluation.view import Comparison

__all__ = [
    "COLUMNS",
    "FIGURES",
    "Comparison",
    "Figure",
    "Score",
    "Soundness",
    "contact_residuals",
    "evaluate",
    "evaluate_kinematics",
    "figures_of",
    "inter_robot_hand_errors",
    "inter_robot_penetrations",
    "mean_values",
    "robot_depths",
    "shown_columns",
    "soundness",
    "sunk_links",
    "surface_residuals",
    "table_rows",
    "to_csv",
    "to_json",
    "unreached_contacts",
    "worst_values",
]
