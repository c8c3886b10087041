"""Whether world poses of bodies fit the robot's tree: two neighbouring bodies can only turn about their hinge.

That needs no joint angles, so it tells the order of the bodies, the order of quaternion components and the unit of
length on its own; the angles that the poses imply then say what the columns of joint angles are.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.check.interpretation import Interpretation, mirrored
from hoi_retarget.motion.links import breadth_first
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import evenly_spaced
from hoi_retarget.robots.model import RobotModel

_FRAMES = 200  # That are looked at, evenly over the clip.
_SAME_MAGNITUDE = 0.1  # In powers of ten.
Places = dict[str, int]
"""Where in the file each of the robot's bodies is."""


@dataclass(frozen=True)
class TreeFit:
    """How well poses fit the tree under one reading."""

    turned: float
    """Median angle between two neighbours' rotation and the nearest that their hinge allows [deg]."""
    moved: float
    """Median distance between a body's place in its parent and where its hinge is [m]."""

    @property
    def penalty(self) -> float:
        """Return one number to compare readings by: 1 is 10 degrees or 10 cm off."""
        return self.turned / 10.0 + self.moved / 0.1

    def __str__(self) -> str:
        return f"neighbours {self.turned:.2g} deg and {1000 * self.moved:.2g} mm off their hinges"


@dataclass(frozen=True)
class BodyReading:
    """One way to read a file's bodies."""

    order: str
    """In words that follow 'are'; empty as claimed."""
    places: Places
    reading: Interpretation


def claimed_places(model: RobotModel, names: tuple[str, ...] | None, count: int) -> Places:
    """Return where the file's names, or the MJCF's order where it has none, put the robot's bodies."""
    if names is not None:
        return {name: names.index(name) for name in model.body_names if name in names}
    return {name: index for index, name in enumerate(model.body_names)} if count == len(model.body_names) else {}


def body_readings(
    model: RobotModel, places: Places, claim: Interpretation, pos: Float[np.ndarray, "T B 3"]
) -> Iterator[BodyReading]:
    """Yield the claimed reading first, then every other one: orders of bodies times orders of components.

    Each has the unit of length that the distances of neighbours have in its order.
    """
    orders = [("", places), *_other_orders(model, places)]
    units = [_unit_of_length(model, there, pos) for _, there in orders]
    other = "xyzw" if claim.quat_order == "wxyz" else "wxyz"
    rotations = [
        claim,
        replace(claim, quat_order=other),
        replace(claim, inverted=True),
        replace(claim, quat_order=other, inverted=True),
    ]
    for reading in rotations:
        for (order, there), metres in zip(orders, units, strict=True):
            yield BodyReading(order, there, replace(reading, metres=metres))


def _other_orders(model: RobotModel, places: Places) -> Iterator[tuple[str, Places]]:
    columns = sorted(places.values())
    present = [name for name in model.body_names if name in places]
    breadth = [model.body_names[index] for index in breadth_first(model)[0] if model.body_names[index] in places]
    sides = mirrored(model.body_names)
    swapped = {model.body_names[index]: model.body_names[other] for index, other in enumerate(sides)}
    candidates = [
        ("in Isaac Lab's breadth-first order", dict(zip(breadth, columns, strict=True))),
        ("in MuJoCo's depth-first order", dict(zip(present, columns, strict=True))),
        ("with left and right exchanged", {name: places[swapped[name]] for name in present if swapped[name] in places}),
    ]
    for words, candidate in candidates:
        if candidate != places:
            yield words, candidate


def _unit_of_length(model: RobotModel, places: Places, pos: Float[np.ndarray, "T B 3"]) -> float:
    """Return one unit of the file's lengths [m]: 0.01 or 0.001 where distances are that much too long, else 1."""
    pairs = [pair for pair in _neighbours(model, places) if np.linalg.norm(model.offsets[:, pair.hinge]) > 0.02]
    if not pairs:
        return 1.0
    frames = evenly_spaced(len(pos), _FRAMES)
    stored = np.array([np.median(np.linalg.norm(pos[frames, p.child] - pos[frames, p.parent], axis=-1)) for p in pairs])
    known = np.array([np.linalg.norm(model.offsets[:, pair.hinge]) for pair in pairs])
    magnitude = float(np.log10(max(float(np.median(stored / known)), 1e-9)))
    return next((unit for unit in (0.01, 0.001) if abs(magnitude + np.log10(unit)) < _SAME_MAGNITUDE), 1.0)


@dataclass(frozen=True)
class _Neighbours:
    hinge: int
    parent: int
    """Columns in the file."""
    child: int
    parent_body: int
    child_body: int


def _neighbours(model: RobotModel, places: Places) -> Iterator[_Neighbours]:
    """Yield hinges both of whose bodies are in the file."""
    body_of_node = {int(node): body for body, node in reversed(list(enumerate(model.bodies.nodes)))}
    for hinge, parent in enumerate(model.parents):
        parent_body, child_body = body_of_node.get(int(parent)), body_of_node.get(hinge + 1)
        if parent_body is None or child_body is None:
            continue
        parent_place = places.get(model.body_names[parent_body])
        child_place = places.get(model.body_names[child_body])
        if parent_place is not None and child_place is not None:
            yield _Neighbours(hinge, parent_place, child_place, parent_body, child_body)


def fit_tree(
    model: RobotModel, there: BodyReading, pos: Float[np.ndarray, "T B 3"], quat: Float[np.ndarray, "T B 4"]
) -> TreeFit:
    """Return how well the poses fit the tree under one reading."""
    frames = evenly_spaced(len(pos), _FRAMES)
    turned, moved = [], []
    for pair in _neighbours(model, there.places):
        rotation, position = _relative(model, there, pair, pos[frames], quat[frames])
        nearest = _hinge_rotation(model, pair.hinge, _hinge_angle(model, pair.hinge, rotation))
        turned.append(np.median(se3.matrix_angle_between(rotation, nearest)))
        moved.append(np.median(np.linalg.norm(position - model.offsets[:, pair.hinge], axis=-1)))
    if not turned:
        return TreeFit(0.0, 0.0)
    return TreeFit(float(np.degrees(np.mean(turned))), float(np.mean(moved)))


def implied_angles(
    model: RobotModel, there: BodyReading, pos: Float[np.ndarray, "T B 3"], quat: Float[np.ndarray, "T B 4"]
) -> Float[np.ndarray, "T n"]:
    """Return the joint angles [rad] that the poses imply; NaN for joints whose bodies are not all there."""
    angles = np.full((len(pos), model.n), np.nan)
    for pair in _neighbours(model, there.places):
        rotation, _ = _relative(model, there, pair, pos, quat)
        angles[:, pair.hinge] = _hinge_angle(model, pair.hinge, rotation)
    return angles


def _relative(
    model: RobotModel, there: BodyReading, pair: _Neighbours, pos: np.ndarray, quat: np.ndarray
) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3"]]:
    """Return a node's pose in its parent node, of the two bodies that are fixed to them."""
    poses = []
    for place, body in ((pair.parent, pair.parent_body), (pair.child, pair.child_body)):
        fixed_rotation, fixed_position = model.bodies.rotations[:, :, body], model.bodies.positions[:, body]
        rotation = se3.quat_to_matrix(there.reading.rotation(quat[:, place])) @ fixed_rotation.T
        position = there.reading.position(pos[:, place]) - rotation @ fixed_position
        poses.append((rotation, position))
    (parent_rotation, parent_position), (child_rotation, child_position) = poses
    inverse = parent_rotation.transpose(0, 2, 1)
    return inverse @ child_rotation, np.einsum("tij,tj->ti", inverse, child_position - parent_position)


def _hinge_angle(model: RobotModel, hinge: int, rotation: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T"]:
    """Return the angle of the hinge that comes nearest to a rotation [rad]."""
    _, cosine, sine = model.hinge_rotations[..., hinge]
    return np.arctan2(np.einsum("ij,tij->t", sine, rotation), np.einsum("ij,tij->t", cosine, rotation))


def _hinge_rotation(model: RobotModel, hinge: int, angle: Float[np.ndarray, "T"]) -> Float[np.ndarray, "T 3 3"]:
    constant, cosine, sine = model.hinge_rotations[..., hinge]
    return constant + cosine * np.cos(angle)[:, None, None] + sine * np.sin(angle)[:, None, None]
