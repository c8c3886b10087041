"""Figures of merit: how well a robot's motion keeps what the human did, and what it violates."""

from hoi_retarget.evaluate.figures import Figures, evaluate, evaluate_kinematics
from hoi_retarget.evaluate.multi_robot import HandToHand, hand_to_hand
from hoi_retarget.evaluate.soundness import Soundness, soundness
from hoi_retarget.evaluate.table import COLUMNS, Column, Score, mean_values, table_rows, to_csv, to_json, worst_values
from hoi_retarget.evaluate.unreached_contacts import (
    UNREACHED_M,
    UnreachedSegment,
    contact_residuals,
    unreached_contacts,
)

__all__ = [
    "COLUMNS",
    "UNREACHED_M",
    "Column",
    "Figures",
    "HandToHand",
    "Score",
    "Soundness",
    "UnreachedSegment",
    "contact_residuals",
    "evaluate",
    "evaluate_kinematics",
    "hand_to_hand",
    "mean_values",
    "soundness",
    "table_rows",
    "to_csv",
    "to_json",
    "unreached_contacts",
    "worst_values",
]
