"""Files of the OmniRetarget data set: holosoma's table of configurations, rotations before positions."""

from collections.abc import Mapping
from typing import Any

from hoi_retarget.motion.formats import qpos_table
from hoi_retarget.motion.formats.format import Format
from hoi_retarget.motion.formats.motion_file import Convention


def holds(values: Mapping[str, Any]) -> bool:
    """Return whether a table has rotations first and no cost, which holosoma's retargeter stores."""
    return "cost" not in values and qpos_table.is_rotation_first(values)


FORMAT = Format(
    name="omniretarget",
    convention=Convention("omniretarget", root_order="quat_pos", usual_fps=30.0),
    holds=holds,
    read=qpos_table.read,
)
