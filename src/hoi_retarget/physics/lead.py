"""Leads to a reference that begins or ends off balance: from a stance at rest to its first frame, and back to one.

In a lead the centre of mass gains its speed steadily, from a place over two feet on the floor. A foot that is in the
air at the end of it stood where that place is between the feet. Inverse kinematics does the rest, near the posture of
the first frame. Objects rest where they are. A lead-out is the lead-in of the motion played backwards.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.physics.mass_centre import mass_centres, mass_jacobian
from hoi_retarget.physics.movement import Movement
from hoi_retarget.physics.needs import GRAVITY, robot_needs
from hoi_retarget.physics.reference import TICK, Reference
from hoi_retarget.physics.scene import SOLES, Scene
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.spec import SIDES

LENGTH = 50
"""Of a lead, in ticks."""
_INSIDE = 0.01  # So far within the soles a balanced capture point is [m].
_LIFTED = 0.01  # A foot with all of its sole so far off the floor is in the air [m].
_LOW = 0.015  # A sole's corner up to here carries weight [m].
_STRIDE, _APART = 0.3, 0.18  # Feet of a stance are no further from each other ahead, and no nearer aside [m].
_BETWEEN = 0.25  # Share of the way between the feet that a balanced centre of mass is off each of them.
_ROUNDS = 20
_FEET, _CENTRE, _BASE, _POSTURE = 100.0, 60.0, 3.0, 0.3  # Of deviations, in inverse kinematics.
_SWING, _SHORT = 0.5, 0.2  # How long a foot is in the air, and at least [s].
_MOMENT, _TINY = 1e-4, 1e-6


@dataclass(frozen=True, eq=False)
class Led:
    """A reference with its leads."""

    reference: Reference
    before: int
    """Ticks of the lead-in; 0 where there is none."""
    after: int
    """Ticks of the lead-out."""


def led(scene: Scene, reference: Reference) -> Led:
    """Return a reference with a lead where it begins or ends off balance, and no hand is at an object then."""
    before = LENGTH if _wants_lead(scene, reference, 0) else 0
    after = LENGTH if _wants_lead(scene, reference, -1) else 0
    found = reference
    if before:
        found = _joined(lead_in(scene, reference.qpos[0], reference.qvel[0]), found)
    if after:
        back = lead_in(scene, reference.qpos[-1], -reference.qvel[-1])
        out = _Lead(back.qpos[::-1], -back.qvel[::-1], back.torques[::-1])
        found = _joined(found, out)
    return Led(found, before, after)


@dataclass(frozen=True, eq=False)
class _Lead:
    qpos: Float[np.ndarray, "L nq"]
    qvel: Float[np.ndarray, "L nv"]
    torques: Float[np.ndarray, "L n"]


def capture_margin(scene: Scene, qpos: Float[np.ndarray, "nq"], qvel: Float[np.ndarray, "nv"]) -> float:
    """Return how far within the soles on the floor a state's capture point is [m]; minus infinity without soles there.

    The capture point is the centre of mass on the floor, ahead by its velocity over the frequency of a pendulum.
    """
    n = scene.model.n
    here = scene.model.forward(qpos[None, : 7 + n])
    centre, speed = _centre_and_speed(scene.model, qpos[None, : 7 + n], qvel[None, : 6 + n])
    capture = centre[:2] + speed[:2] * np.sqrt(centre[2] / GRAVITY)
    corners = np.concatenate([here.site_position(name) for name in sorted(SOLES)])
    low = corners[corners[:, 2] < _LOW, :2]
    if len(low) < 3:
        return -np.inf
    sides = ConvexHull(low).equations
    return float(-(sides[:, :2] @ capture + sides[:, 2]).max())


def lead_in(scene: Scene, qpos: Float[np.ndarray, "nq"], qvel: Float[np.ndarray, "nv"]) -> _Lead:
    """Return the ticks before a state, from a stance at rest on."""
    model, n = scene.model, scene.model.n
    goal, speed = qpos[None, : 7 + n], qvel[None, : 6 + n]
    here, later = model.forward(goal), model.forward(model.integrate(goal, _MOMENT * speed))
    centre, moving = _centre_and_speed(model, goal, speed)
    place, feet = _stance(here, centre[:2], moving[:2])
    share = np.arange(LENGTH + 1) / LENGTH
    wanted = {name: _foot(here, later, name, start, share) for name, start in feet.items()}
    centres = _blend(share, place, centre[:2], moving[:2], LENGTH * TICK)
    near = np.repeat(goal, len(share), axis=0)
    near[:, 7:] = _blend(share, goal[0, 7:], goal[0, 7:], speed[0, 6:], LENGTH * TICK)
    path = _placed(model, near, wanted, centres)
    path[-1] = goal[0]
    movement = _movement(path, speed[0])
    torques = _torques(model, movement)
    objects = np.tile(qpos[7 + n :], (LENGTH, 1)), np.zeros((LENGTH, len(qvel) - 6 - n))
    return _Lead(
        np.concatenate([movement.qpos[:-1], objects[0]], axis=1),
        np.concatenate([movement.qvel[:-1], objects[1]], axis=1),
        torques[:-1],
    )


def _wants_lead(scene: Scene, reference: Reference, tick: int) -> bool:
    if (reference.touched[tick] >= 0).any():
        return False
    qpos, qvel = reference.qpos[tick], reference.qvel[tick]
    here = scene.model.forward(qpos[None, : 7 + scene.model.n])
    return capture_margin(scene, qpos, qvel) < _INSIDE or len(_standing(here)) < len(SIDES)


def _standing(kinematics: Kinematics) -> list[str]:
    """Return the sides of the feet on the floor, or that of the lower one."""
    heights = {
        side: min(kinematics.site_position(name)[0, 2] for name in SOLES if name.startswith(side)) for side in SIDES
    }
    return [side for side in SIDES if heights[side] < max(_LIFTED, min(heights.values()) + 1e-6)]


def _stance(
    kinematics: Kinematics, centre: np.ndarray, moving: np.ndarray
) -> tuple[Float[np.ndarray, "2"], dict[str, Float[np.ndarray, "3"]]]:
    """Return where the centre of mass, and the feet, are at rest."""
    place = centre - 0.5 * moving * LENGTH * TICK  # From where it gains its speed steadily.
    feet = {f"{side}_foot": kinematics.site_position(f"{side}_foot")[0] for side in SIDES}
    standing = _standing(kinematics)
    if len(standing) == 1:
        held, (raised,) = f"{standing[0]}_foot", (side for side in SIDES if side not in standing)
        yaw = kinematics.site_rotation(held)[0][:2, 0]
        ahead = yaw / np.linalg.norm(yaw)
        aside = np.array([-ahead[1], ahead[0]]) * (1.0 if raised == "left" else -1.0)
        step = 2.0 * (place - feet[held][:2])
        step = ahead * np.clip(step @ ahead, -_STRIDE, _STRIDE) + aside * np.clip(step @ aside, _APART, _STRIDE)
        feet[f"{raised}_foot"] = np.array([*(feet[held][:2] + step), feet[held][2]])
    first, second = (feet[f"{side}_foot"][:2] for side in SIDES)
    way = second - first
    along = np.clip((place - first) @ way / max(way @ way, 1e-9), _BETWEEN, 1.0 - _BETWEEN)
    return first + along * way, feet


def _foot(
    here: Kinematics, later: Kinematics, name: str, start: Float[np.ndarray, "3"], share: Float[np.ndarray, "L"]
) -> tuple[Float[np.ndarray, "L 3"], Float[np.ndarray, "L 3 3"]]:
    """Return a foot's way from flat on the floor at a place, which it leaves when it has to: it does not slide."""
    end, rotation, after = here.site_position(name)[0], here.site_rotation(name)[0], later.site_rotation(name)[0]
    flat = _flat(rotation)
    height = -(_corners(here, name) @ rotation)[:, 2].min()
    speed = (later.site_position(name)[0] - end) / _MOMENT
    turned, turned_after = (se3.log(se3.matrix_to_quat(flat.T @ item)) for item in (rotation, after))
    raised = max(end[2] - height, 0.0)
    seconds = 3.0 * raised / speed[2] if speed[2] > _TINY else _SWING  # With more it would be under the floor first.
    if np.linalg.norm(start[:2] - end[:2]) < _TINY and raised < _LIFTED:
        seconds = LENGTH * TICK  # It stands.
    seconds = float(np.clip(seconds, _SHORT, LENGTH * TICK))
    left = np.clip(1.0 - (1.0 - share) * LENGTH * TICK / seconds, 0.0, 1.0)
    places = _blend(left, np.array([*start[:2], height]), end, speed, seconds)
    turns = _blend(left, np.zeros(3), turned, (turned_after - turned) / _MOMENT, seconds)
    return places, flat @ se3.quat_to_matrix(se3.exp(turns))


def _flat(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """Return a rotation about the vertical that points where another one does."""
    ahead = np.array([*rotation[:2, 0], 0.0]) / np.linalg.norm(rotation[:2, 0])
    up = np.array([0.0, 0.0, 1.0])
    return np.stack([ahead, np.cross(up, ahead), up], axis=1)


def _corners(kinematics: Kinematics, foot: str) -> Float[np.ndarray, "K 3"]:
    """Return a foot's sole corners from the foot's site [m]."""
    side = foot.removesuffix("_foot")
    names = [name for name in sorted(SOLES) if name.startswith(f"{side}_")]
    return np.stack([kinematics.site_position(name)[0] for name in names]) - kinematics.site_position(foot)[0]


def _blend(
    share: Float[np.ndarray, "L"], start: np.ndarray, end: np.ndarray, speed: np.ndarray, seconds: float
) -> Float[np.ndarray, "L d"]:
    """Return a cubic from rest at a start to a speed at the end."""
    risen = (3.0 - 2.0 * share) * share**2
    return start + risen[:, None] * (end - start) + ((share - 1.0) * share**2 * seconds)[:, None] * speed


def _placed(
    model: RobotModel,
    qpos: Float[np.ndarray, "L nq"],
    feet: dict[str, tuple[Float[np.ndarray, "L 3"], Float[np.ndarray, "L 3 3"]]],
    centres: Float[np.ndarray, "L 2"],
) -> Float[np.ndarray, "L nq"]:
    """Return configurations near others with feet in poses, and centres of mass above places."""
    start = qpos
    stiff = np.concatenate([[0.0, 0.0, _BASE], [_BASE] * 3, [_POSTURE] * model.n])
    for _ in range(_ROUNDS):
        now = model.forward(qpos)
        rows = [_CENTRE * mass_jacobian(now)[:, :2], np.broadcast_to(np.diag(stiff), (len(qpos), model.nv, model.nv))]
        back = se3.log(se3.quat_multiply(se3.quat_conjugate(qpos[:, 3:7]), start[:, 3:7]))
        near = np.concatenate([start[:, :3] - qpos[:, :3], back, start[:, 7:] - qpos[:, 7:]], axis=1)
        errors = [_CENTRE * (centres - mass_centres(now)[:, :2]), stiff * near]
        for name, (places, rotations) in feet.items():
            turn = se3.matrix_to_quat(rotations @ now.site_rotation(name).transpose(0, 2, 1))
            rows.append(_FEET * now.jacobian(name))
            errors.append(_FEET * np.concatenate([places - now.site_position(name), se3.log(turn)], axis=1))
        jacobian, error = np.concatenate(rows, axis=1), np.concatenate(errors, axis=1)
        normal = np.einsum("tri,trj->tij", jacobian, jacobian) + 1e-6 * np.eye(model.nv)
        step = np.linalg.solve(normal, np.einsum("tri,tr->ti", jacobian, error)[..., None])[..., 0]
        qpos = model.integrate(qpos, step)
        qpos[:, 7:] = np.clip(qpos[:, 7:], model.lower, model.upper)
    return qpos


def _movement(qpos: Float[np.ndarray, "L nq"], last: Float[np.ndarray, "nv"]) -> Movement:
    """Return the movement along configurations from rest to a velocity."""
    turns = se3.log(se3.quat_multiply(se3.quat_conjugate(qpos[:-1, 3:7]), qpos[1:, 3:7]))
    steps = np.concatenate([np.diff(qpos[:, :3], axis=0), turns, np.diff(qpos[:, 7:], axis=0)], axis=1) / TICK
    qvel = np.concatenate([np.zeros((1, len(last))), 0.5 * (steps[1:] + steps[:-1]), last[None]])
    return Movement(qpos, qvel, np.gradient(qvel, TICK, axis=0))


def _torques(model: RobotModel, movement: Movement) -> Float[np.ndarray, "L n"]:
    """Return the joints' torques with the least forces at the soles on the floor."""
    needs, kinematics = robot_needs(model, movement), model.forward(movement.qpos)
    names = sorted(SOLES)
    corners = np.stack([kinematics.site_position(name) for name in names], axis=1)
    jacobians = np.stack([kinematics.jacobian(name)[:, :3, 6:] for name in names], axis=1)
    low = corners[:, :, 2] < np.maximum(_LOW, corners[:, :, 2].min(axis=1, keepdims=True) + 1e-3)
    found = needs.torques.copy()
    for tick, on in enumerate(low):
        arms = se3.skew(corners[tick, on] - needs.centre[tick])
        given = np.concatenate([np.tile(np.eye(3), (1, on.sum())), np.concatenate(list(arms), axis=1)])
        forces = np.linalg.lstsq(given, needs.wrench[tick], rcond=1e-6)[0].reshape(-1, 3)
        found[tick] -= np.einsum("kin,ki->n", jacobians[tick, on], forces)
    return found


def _joined(first: "Reference | _Lead", second: "Reference | _Lead") -> Reference:
    """Return a reference with a lead before or after it, in which nothing is touched."""
    base = first if isinstance(first, Reference) else second
    assert isinstance(base, Reference)
    touched = [
        part.touched if isinstance(part, Reference) else np.full((len(part.qpos), base.touched.shape[1]), -1)
        for part in (first, second)
    ]
    names = ("qpos", "qvel", "torques")
    values = {name: frozen(np.concatenate([getattr(first, name), getattr(second, name)])) for name in names}
    return replace(base, touched=frozen(np.concatenate(touched), int), **values)


def _centre_and_speed(
    model: RobotModel, qpos: Float[np.ndarray, "1 nq"], qvel: Float[np.ndarray, "1 nv"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    here = model.forward(qpos)
    return mass_centres(here)[0], mass_jacobian(here)[0] @ qvel[0]
