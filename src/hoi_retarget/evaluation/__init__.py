"""Figures of merit: how well a robot's motion keeps what the human did, and what it violates."""

from hoi_retarget.evaluation.figure import Figure
from hoi_retarget.evaluation.figures import FIGURES, evaluate, evaluate_kinematics
from hoi_retarget.evaluation.multi_robot import inter_robot_hand_errors
from hoi_retarget.evaluation.soundness import Soundness, soundness
from hoi_retarget.evaluation.table import COLUMNS, Score, mean_values, table_rows, to_csv, to_json, worst_values
from hoi_retarget.evaluation.unreached_contacts import (
    contact_residuals,
    unreached_contacts,
)

__all__ = [
    "COLUMNS",
    "FIGURES",
    "Figure",
    "Score",
    "Soundness",
    "contact_residuals",
    "evaluate",
    "evaluate_kinematics",
    "inter_robot_hand_errors",
    "mean_values",
    "soundness",
    "table_rows",
    "to_csv",
    "to_json",
    "unreached_contacts",
    "worst_values",
]
