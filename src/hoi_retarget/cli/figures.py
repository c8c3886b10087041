"""How figures of merit are shown in a terminal."""

from collections.abc import Sequence

from hoi_retarget.cli.terminal import say, show_table
from hoi_retarget.evaluation import COLUMNS, Score, mean_values, shown_columns, table_rows, worst_values

FEW = 4  # Results that stand side by side, one a column.
_SHORT = (
    "contact_gap_m",
    "body_pose_deviation_deg",
    "link_velocity_direction_deg",
    "relative_hand_rotation_deg",
    "body_jerk_mps3",
    "object_path_error_m",
    "compute_s",
)


def show_figures(scores: Sequence[Score]) -> None:
    """Print all figures of a few results, or the paper's of each of many and the mean and worst of all."""
    if len(scores) <= FEW:
        show_table(_turned(table_rows(scores, shown_columns(scores))))
        return
    short = [column for column in COLUMNS if column.name in _SHORT]
    clips = table_rows(scores, short)[: len(scores) + 1]
    show_table(clips)
    say()
    mean, worst = mean_values(scores), worst_values(scores)
    summary = [
        (column.header, column.text(mean[column.name]), column.text(worst[column.name]))
        for column in shown_columns(scores)
    ]
    show_table([("all clips", "mean", "worst"), *summary])


def _turned(rows: Sequence[Sequence[str]]) -> list[tuple[str, ...]]:
    turned = list(zip(*rows, strict=True))
    return [("figure", *turned[0][1:]), *turned[1:]]
