"""Interpretations of a file's numbers: the claimed one, and the known deviations of files from it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.motion.check.finding import JOINTS, Change
from hoi_retarget.motion.links import breadth_first
from hoi_retarget.numerics import se3
from hoi_retarget.robots.model import RobotModel

Subject = Literal[
    "quaternion order",
    "quaternion inverse",
    "up axis",
    "length unit",
    "angle unit",
    "joint order",
    "left and right",
    "shifted columns",
    "joint sign",
]

# The world of a file whose y axis points up, turned so that its z axis does.
_Y_UP = se3.exp(np.array([0.5 * np.pi, 0.0, 0.0]))
IN_BREADTH_FIRST, IN_DEPTH_FIRST = "in Isaac Lab's breadth-first order", "in MuJoCo's depth-first order"
_BEYOND = 0.5  # Angles this far out of the widest range [rad] are no radians of this robot; degrees are, in any motion.
_SHIFTS = (-3, -2, -1, 1, 2, 3)
_PARTS = {"legs": ("hip", "knee", "ankle"), "arms": ("shoulder", "elbow", "wrist"), "sides": ("",)}
"""Parts of joint names, by parts of a robot."""
_SIDEWAYS = ("roll", "yaw")  # Joints that a mirrored motion turns the other way round: not pitch, knee and elbow.


@dataclass(frozen=True)
class Interpretation:
    """The conversion of a root's pose and columns of angles to a robot's configuration."""

    columns: tuple[int, ...]  # The column of each joint of the robot; -1 where there is none.
    signs: tuple[float, ...]
    offsets: tuple[float, ...] = ()  # Added to each joint's angle [rad]; empty for nothing.
    quat_order: Literal["wxyz", "xyzw"] = "wxyz"
    inverted: bool = False
    y_up: bool = False
    metres: float = 1.0  # One unit of length [m].
    radians: float = 1.0  # One unit of angle [rad].

    @property
    def of_poses(self) -> "Interpretation":
        """The same for poses, without joints."""
        return replace(self, columns=(), signs=(), offsets=())

    def rotation(self, quat: Float[np.ndarray, "*batch 4"]) -> Float[np.ndarray, "*batch 4"]:
        """Return unit quaternions, wxyz, in the z-up world."""
        turned = se3.quat_normalize(quat if self.quat_order == "wxyz" else se3.quat_from_xyzw(quat))
        turned = se3.quat_conjugate(turned) if self.inverted else turned
        return se3.quat_multiply(_Y_UP, turned) if self.y_up else turned

    def vector(self, vector: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """Return a vector, its unit unchanged, in the axes of the z-up world."""
        return se3.rotate(_Y_UP, vector) if self.y_up else vector

    def position(self, pos: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """Return positions [m] in the z-up world."""
        return self.metres * self.vector(pos)

    def angles(self, joint_pos: Float[np.ndarray, "T c"]) -> Float[np.ndarray, "T n"]:
        """Return joint angles [rad] in the robot's order; zero for joints without a column."""
        columns = np.array(self.columns)
        angles = joint_pos[:, columns] * (self.radians * np.array(self.signs)) + np.array(self.offsets or 0.0)
        angles[:, columns < 0] = 0.0
        return angles

    def qpos(
        self, pos: Float[np.ndarray, "T 3"], quat: Float[np.ndarray, "T 4"], joint_pos: Float[np.ndarray, "T c"]
    ) -> Float[np.ndarray, "T nq"]:
        """Return configurations [m, rad, quaternions] as this package has them."""
        return np.concatenate([self.position(pos), self.rotation(quat), self.angles(joint_pos)], axis=1)


def changes(claim: Interpretation, found: Interpretation, of: str, width: int) -> tuple[Change, ...]:
    """Return the changes by which arrays that read as `found` read as claimed.

    They are poses `of` an owner; `width` is the number of columns of angles.
    """
    made = []
    xyzw = claim.quat_order == "xyzw"
    if found.quat_order != claim.quat_order:
        made.append(Change("take quaternion components", of, (1, 2, 3, 0) if xyzw else (3, 0, 1, 2)))
    if found.inverted != claim.inverted:
        made.append(Change("multiply quaternion components", of, (-1, -1, -1, 1) if xyzw else (1, -1, -1, -1)))
    if found.metres != claim.metres:
        made.append(Change("multiply positions", of, (found.metres / claim.metres,)))
    if found.y_up and not claim.y_up:
        made.append(Change("turn", "", tuple(_Y_UP.tolist())))
    return (*made, *_column_changes(claim, found, width))


def _column_changes(claim: Interpretation, found: Interpretation, width: int) -> Iterator[Change]:
    columns, factors, added = np.arange(width), np.ones(width), np.zeros(width)
    signs = np.array(found.signs) * np.array(claim.signs)
    offsets = np.array(found.offsets or 0.0) - np.array(claim.offsets or 0.0) + np.zeros(len(signs))
    for joint, (place, source) in enumerate(zip(claim.columns, found.columns, strict=True)):
        if place >= 0 and source >= 0:
            columns[place], factors[place] = source, signs[joint] * found.radians / claim.radians
            added[place] = offsets[joint]
    if (columns != np.arange(width)).any():
        yield Change("take columns", JOINTS, tuple(columns.tolist()))
    if (factors != 1.0).any():
        yield Change("multiply columns", JOINTS, tuple(factors.tolist()))
    if added.any():
        yield Change("add to columns", JOINTS, tuple(added.tolist()))


@dataclass(frozen=True)
class Deviation:
    """One difference of a file from its claim."""

    subject: Subject
    is_: str  # The finding, in words that follow 'the numbers are'.
    advice: str
    reading: Interpretation


def world_deviations(claim: Interpretation) -> Iterator[Deviation]:
    """Yield possible faults of the world: its up axis and its unit."""
    if not claim.y_up:
        advice = "Turn the world by 90 degrees about x before it is used: (x, y, z) to (x, -z, y)."
        yield Deviation("up axis", "y up", advice, replace(claim, y_up=True))
    if claim.metres == 1.0:
        for name, metres in (("centimetres", 0.01), ("millimetres", 0.001)):
            advice = f"Multiply positions by {metres:g}."
            yield Deviation("length unit", name, advice, replace(claim, metres=metres))


def rotation_deviations(claim: Interpretation) -> Iterator[Deviation]:
    """Yield possible faults of quaternions."""
    other: Literal["wxyz", "xyzw"] = "xyzw" if claim.quat_order == "wxyz" else "wxyz"
    yield Deviation(
        "quaternion order", other, f"Reorder the quaternions to {claim.quat_order}.", replace(claim, quat_order=other)
    )
    if not claim.inverted:
        advice = "Negate the three imaginary components: the rotations are those from the world to the body."
        yield Deviation("quaternion inverse", "inverted", advice, replace(claim, inverted=True))


def isaac_lab_columns(model: RobotModel, columns: Sequence[int] | None = None) -> tuple[int, ...]:
    """Return the column of each joint of the robot where columns are in Isaac Lab's breadth-first order.

    Joints that have none (-1) in `columns`, of which the file has all by default, have none.
    """
    there = np.ones(model.n, dtype=bool) if columns is None else np.array(columns) >= 0
    order = [joint for joint in breadth_first(model)[1] if there[joint]]
    places = np.full(model.n, -1)
    places[order] = np.arange(len(order))
    return tuple(places.tolist())


def angle_deviations(
    claim: Interpretation, model: RobotModel, joint_pos: Float[np.ndarray, "T c"]
) -> Iterator[Deviation]:
    """Yield degrees, where angles are too large for radians."""
    reach = max(float(np.abs(model.lower).max()), float(np.abs(model.upper).max())) + _BEYOND
    if claim.radians == 1.0 and np.quantile(np.abs(joint_pos), 0.95, axis=0).max(initial=0.0) > reach:
        yield Deviation(
            "angle unit", "degrees", "Multiply the angles by pi / 180.", replace(claim, radians=np.pi / 180)
        )


def joint_deviations(
    claim: Interpretation, model: RobotModel, joint_pos: Float[np.ndarray, "T c"]
) -> Iterator[Deviation]:
    """Yield possible faults of columns of angles as a whole."""
    yield from angle_deviations(claim, model, joint_pos)
    columns, signs = np.array(claim.columns), np.array(claim.signs)
    if (columns >= 0).all():
        _, breadth = breadth_first(model)
        place = np.argsort(breadth)
        yield reordered(claim, "joint order", IN_BREADTH_FIRST, columns[place])
        if not np.array_equal(columns, np.arange(len(columns))):
            yield reordered(claim, "joint order", IN_DEPTH_FIRST, columns[breadth])
        for shift in _SHIFTS:
            side = "right" if shift > 0 else "left"
            words = f"shifted by {abs(shift)} column{'s' if abs(shift) > 1 else ''} to the {side}"
            yield reordered(claim, "shifted columns", words, np.roll(columns, -shift))
    elif (np.diff(columns[columns >= 0]) == 1).all():
        yield reordered(claim, "joint order", IN_BREADTH_FIRST, np.array(isaac_lab_columns(model, claim.columns)))
    for words, parts in _PARTS.items():
        swapped = mirrored(model.joint_names, parts)
        yield reordered(claim, "left and right", f"with left and right {words} exchanged", columns[swapped])
        sideways = np.array([_contains(name, _SIDEWAYS) and _contains(name, parts) for name in model.joint_names])
        flipped = tuple(np.where(sideways, -signs, signs))
        mirror = reordered(claim, "left and right", f"with left and right {words} mirrored", columns[swapped])
        yield replace(mirror, reading=replace(mirror.reading, signs=flipped))


def sign_deviations(claim: Interpretation, model: RobotModel, moving: Bool[np.ndarray, "c"]) -> Iterator[Deviation]:
    """Yield possible negations of single joints with moving columns."""
    for index, name in enumerate(model.joint_names):
        if claim.columns[index] >= 0 and moving[claim.columns[index]]:
            signs = list(claim.signs)
            signs[index] = -signs[index]
            yield Deviation("joint sign", f"negated for {name}", f"Negate {name}.", replace(claim, signs=tuple(signs)))


def reordered(claim: Interpretation, subject: Subject, words: str, columns: np.ndarray) -> Deviation:
    """Return a claim with other columns, which says so in `words` about a subject."""
    reading = replace(claim, columns=tuple(int(column) for column in columns))
    return Deviation(subject, words, "Put the columns into the order that the format demands.", reading)


def mirrored(names: tuple[str, ...], parts: tuple[str, ...] = ("",)) -> Int[np.ndarray, "n"]:
    """Return the index of each name's counterpart on the other side; only names with one of `parts` change."""
    index = {name: place for place, name in enumerate(names)}
    others = {"left": "right", "right": "left"}
    places = []
    for name in names:
        side, _, rest = name.partition("_")
        other = f"{others.get(side, side)}_{rest}"
        places.append(index[other] if other in index and _contains(name, parts) else index[name])
    return np.array(places)


def _contains(name: str, parts: tuple[str, ...]) -> bool:
    return any(part in name for part in parts)
