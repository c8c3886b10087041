"""The layout of a file's columns: the root's pose and the robot's joints."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.check.finding import ROOT, Change, Check, FormatFinding, contradiction
from hoi_retarget.motion.check.interpretation import isaac_lab_columns
from hoi_retarget.motion.formats import WITHOUT_WRISTS, MotionFile
from hoi_retarget.motion.links import source_joint_names
from hoi_retarget.robots.model import RobotModel

UNIT_TOLERANCE, _SHORT_TOLERANCE = 0.01, 0.05
"""Lengths of quaternions that differ from 1 by less are right, and by less than the second a remark: interpolated ones
of GMT and TWIST2 are up to 4 % short."""
NO_ROTATION = 0.9  # Quaternions whose lengths are that far from 1 have no direction to rely on.
NORMALIZE = "Divide the quaternions by their lengths."
"""Advice for quaternions that are not of unit length; later checks normalize them."""
HELD = "Joints that the file lacks are held still at 0 rad."
_SMALLER_SETS = {
    WITHOUT_WRISTS: ("wrist",),
    "those of Unitree's 23-joint G1": ("waist_roll", "waist_pitch", "wrist_pitch", "wrist_yaw"),
    "all but the head": ("head", "neck"),
    "all but head and wrists": ("head", "neck", "wrist"),
    "all but head and waist": ("head", "neck", "waist", "torso"),
    "all but head, waist and wrists": ("head", "neck", "waist", "torso", "wrist"),
    "the legs": ("head", "neck", "waist", "torso", "shoulder", "elbow", "wrist", "arm", "hand"),
}
"""Sets of joints of files without names, in the robot's order, by parts of the names that they leave out."""
_MAX_SHARE_OUTSIDE = 0.01  # Of angles out of range: right readings of published files have 0, wrong ones 3 % and more.


@dataclass(frozen=True, eq=False)
class Layout:
    """A file's columns by their meanings, in its own order and units."""

    joint_pos: Float[np.ndarray, "T c"]
    columns: tuple[int, ...] | None
    """The column of each joint of the robot, -1 where there is none; None where that cannot be known."""
    pos: Float[np.ndarray, "T 3"] | None = None
    """Of the root; None where it is a body's, or where no rotation could be found."""
    quat: Float[np.ndarray, "T 4"] | None = None


def lay_out(file: MotionFile, model: RobotModel) -> Check[Layout]:
    """Return the columns of the root and the joints."""
    layout = yield from _root(file)
    columns = yield from _columns(file, model, layout.joint_pos.shape[1])
    return replace(layout, columns=columns)


def off_unit(quat: np.ndarray) -> float:
    """Return the largest difference of a quaternion's length from 1."""
    with np.errstate(over="ignore"):
        return float(np.abs(np.linalg.norm(quat, axis=-1) - 1.0).max())


def _root(file: MotionFile) -> Check[Layout]:
    if file.root is None:
        return Layout(file.joint_pos, None)
    start = 0 if file.convention.root_order == "quat_pos" else 3
    flat = np.concatenate([file.root, file.joint_pos], axis=1)
    claim = f"{file.format} has the rotation in columns {start} to {start + 3} of the root"
    off = off_unit(flat[:, start : start + 4])
    if off < UNIT_TOLERANCE:
        numbers = f"these are unit quaternions within {off:.1g} in every frame"
        yield FormatFinding("ok", "root layout", claim, numbers)
        return _split(flat, start)
    unit = [column for column in range(flat.shape[1] - 3) if off_unit(flat[:, column : column + 4]) < UNIT_TOLERANCE]
    numbers = f"their lengths differ from 1 by up to {off:.2g}"
    if off < _SHORT_TOLERANCE:
        yield FormatFinding("note", "root layout", claim, f"{numbers}, as interpolated ones are", NORMALIZE)
        return _split(flat, start)
    if not unit:
        numbers += ", and no other four neighbouring columns are unit quaternions"
        fix = (Change("normalize quaternions", ROOT),)
        yield contradiction("root layout", claim, numbers, NORMALIZE, fix=fix)
        # Without a direction, there is nothing to normalize.
        return _split(flat, start) if off < NO_ROTATION else Layout(file.joint_pos, None)
    found = unit[0]
    numbers += f"; columns {found} to {found + 3} are unit quaternions"
    if found in (0, 3):
        order = "rotation before position" if found == 0 else "position before rotation"
        advice = f"The root is {order}: exchange the two."
        fix = (Change("exchange position and rotation", ROOT),)
        yield contradiction("root order", claim, numbers, advice, fix=fix)
        return _split(flat, found)
    shift = found - start
    advice = f"All columns are shifted by {shift:+d}: remove or add what stands before them."
    fix = (Change("drop first columns", "", (shift,)),) if shift > 0 else ()
    yield contradiction("shifted columns", claim, numbers, advice, fix=fix)
    return Layout(file.joint_pos, None) if shift < 0 or start == 0 else _split(flat[:, shift:], start)


def _split(flat: np.ndarray, start: int) -> Layout:
    """Return a layout with the root in the first seven columns, its rotation from `start` on."""
    pos = flat[:, 4:7] if start == 0 else flat[:, :3]
    return Layout(flat[:, 7:], None, pos, flat[:, start : start + 4])


def _columns(file: MotionFile, model: RobotModel, count: int) -> Check[tuple[int, ...] | None]:
    robot = f"{model.spec.name} has {model.n} joints"
    if file.joint_names is not None:
        missing = [name for name in model.joint_names if name not in file.joint_names]
        foreign = [name for name in file.joint_names if name not in source_joint_names(model)]
        if len(missing) == model.n:
            numbers = f"none of the file's joint names is one of them: {', '.join(foreign[:4])}, ..."
            yield contradiction("joint count", robot, numbers, "Name another --robot.")
            return None
        yield from _missing(robot, missing, foreign)
        return _places(model, file.joint_names)
    if count == model.n:
        numbers = f"the file has {count} columns of angles"
        yield FormatFinding("ok", "joint count", robot, numbers)
        return isaac_lab_columns(model) if file.convention.order == "breadth_first" else tuple(range(count))
    if count == len(source_joint_names(model)):
        numbers = f"the file has {count} columns of angles: all joints of its description, some of them held still"
        yield FormatFinding("ok", "joint count", robot, numbers)
        return _places(model, source_joint_names(model))
    known = _known_set(file, model, count)
    if known is not None:
        words, names = known
        numbers = f"the file has {count} and no names: they are taken for {words}"
        yield FormatFinding("note", "joint count", robot, numbers, HELD)
        columns = _places(model, names)
        return isaac_lab_columns(model, columns) if file.convention.order == "breadth_first" else columns
    numbers = f"the file has {count} columns of angles, and no names that tell which"
    advice = "Name another --robot, or write all joints or their names: a consumer would drive the wrong ones."
    yield contradiction("joint count", robot, numbers, advice)
    return None


def _known_set(file: MotionFile, model: RobotModel, count: int) -> tuple[str, tuple[str, ...]] | None:
    """Return the one well-known set of so many joints that the angles fit, in words and by name; None without one."""
    sets = {
        words: tuple(name for name in model.joint_names if not any(part in name for part in absent))
        for words, absent in _SMALLER_SETS.items()
    }
    # Sets that are the same on this robot count once, by their first name.
    sets = {names: words for words, names in reversed(sets.items()) if len(names) == count}
    fitting = [names for names in sets if _outside(file, names, model) < _MAX_SHARE_OUTSIDE]
    usual = [names for names, words in sets.items() if words == file.convention.usual_joints]
    return next(((sets[names], names) for names in (fitting if len(fitting) == 1 else usual)), None)


def _outside(file: MotionFile, names: tuple[str, ...], model: RobotModel) -> float:
    """Return the fraction of angles that are out of these joints' ranges, in the better order allowed."""
    depth_first = _places(model, names)
    orders = {"depth_first": depth_first, "breadth_first": isaac_lab_columns(model, depth_first)}
    outside = []
    for columns in (np.array(columns) for order, columns in orders.items() if file.convention.order in (order, None)):
        angles, there = file.joint_pos[:, columns[columns >= 0]], columns >= 0
        outside.append(float(((angles < model.lower[there]) | (angles > model.upper[there])).mean()))
    return min(outside, default=1.0)


def _places(model: RobotModel, names: tuple[str, ...]) -> tuple[int, ...]:
    """Return where each joint of the robot is among names; -1 for none."""
    return tuple(names.index(name) if name in names else -1 for name in model.joint_names)


def _missing(robot: str, missing: list[str], foreign: list[str]) -> Iterator[FormatFinding]:
    if missing:
        numbers = f"the file lacks {', '.join(missing)}"
        yield FormatFinding("note", "joint count", robot, numbers, HELD)
    if foreign:
        numbers = f"the file has others, too: {', '.join(foreign)}"
        yield FormatFinding("note", "joint count", robot, numbers, "They are left out.")
    if not missing and not foreign:
        yield FormatFinding("ok", "joint count", robot, "the file names all of them")
