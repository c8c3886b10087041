"""Names of a table's columns, which tell the root's path, the joints and the times of frames."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

_ROOT = {"", "root", "base", "pelvis", "floating", "free", "joint", "body", "global", "world", "xyz", "wxyz", "xyzw"}
_POSITION = {"p", "t", "pos", "position", "trans", "translate", "translation"}
_ROTATION = {"q", "r", "quat", "quaternion", "rot", "rotate", "rotation", "ori", "orn", "orientation"}
_COUNTERS = {"frame", "frame_id", "frame_index", "index", "idx", "step"}
_SECONDS = {"time", "timestamp", "time_s", "seconds"}
_LAST = re.compile(r"([a-z]*?)([wxyz])")
_NUMBERED = re.compile(r"(?:joint|dof|joint_pos|dof_pos|joint_vel|dof_vel|q|dq)_?(\d+)")
_ANGLE = re.compile(r"_(dof|pos|position|angle|rad)$", re.IGNORECASE)
Columns = tuple[int, ...]


@dataclass(frozen=True)
class NamedColumns:
    """Where in a table is what."""

    positions: tuple[Columns, ...]
    """Of x, y, z; more than one where several may be the root's."""
    quaternions: tuple[Columns, ...]
    """Of w, x, y, z."""
    angles: tuple[Columns, ...]
    """Of rotations by three angles, about x, y, z."""
    joints: Columns
    joint_names: tuple[str, ...] | None
    """Of columns that are nothing else; None where they are numbered."""
    times: int | None
    """Of the frames [s]."""

    @property
    def has_root(self) -> bool:
        """Whether the root's path is there, and only one."""
        return len(self.positions) == len(self.quaternions) == 1


def named_columns(header: Sequence[str]) -> NamedColumns:
    """Return where in a table with this header is what; no robot is known here."""
    words = [
        re.sub(r"[^a-z0-9]+", "_", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()).strip("_") for name in header
    ]
    groups: dict[str, dict[str, int]] = {}
    rest: list[int] = []
    for index, word in enumerate(words):
        component = _component(word)
        if component is not None:
            groups.setdefault(component[0], {})[component[1]] = index
        elif word not in _COUNTERS | _SECONDS:
            rest.append(index)
    quaternions = [_columns(group, "wxyz") for group in groups.values() if "w" in group]
    turned = [_columns(group, "xyz") for stem, group in groups.items() if "w" not in group and _turns(stem)]
    moved = [_columns(group, "xyz") for stem, group in groups.items() if "w" not in group and not _turns(stem)]
    joints, names = _joints(header, words, rest)
    return NamedColumns(
        positions=tuple(filter(None, moved)),
        quaternions=tuple(filter(None, quaternions)),
        angles=tuple(filter(None, turned)),
        joints=joints,
        joint_names=names,
        times=next((index for index, word in enumerate(words) if word in _SECONDS), None),
    )


def _component(word: str) -> tuple[str, str] | None:
    """Return the vector of the root and the axis that a word names, such as ('root_t', 'x') for 'root_tx'."""
    *before, last = word.split("_")
    match = _LAST.fullmatch(last)
    if match is None:
        return None
    stem = [*before, match[1]]
    return ("_".join(stem), match[2]) if all(part in _ROOT | _POSITION | _ROTATION for part in stem) else None


def _turns(stem: str) -> bool:
    return not _ROTATION.isdisjoint(stem.split("_"))


def _columns(group: dict[str, int], axes: str) -> Columns:
    """Return the columns of a vector; none where one of its axes is not there."""
    return tuple(group[axis] for axis in axes) if set(axes) <= set(group) else ()


def _joints(header: Sequence[str], words: list[str], rest: list[int]) -> tuple[Columns, tuple[str, ...] | None]:
    numbers = {index: int(match[1]) for index in rest if (match := _NUMBERED.fullmatch(words[index]))}
    if numbers:
        return tuple(sorted(numbers, key=numbers.__getitem__)), None
    return tuple(rest), tuple(_ANGLE.sub("", header[index]) for index in rest)
