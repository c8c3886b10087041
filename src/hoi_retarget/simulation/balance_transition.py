"""Lead-ins and lead-outs of a reference that begins or ends off balance: from a stance at rest, and back to one.

In a lead-in the centre of mass gains its speed steadily, from a place over two feet on the floor. A foot that is in the
air at its end stood where that place is between the feet. Inverse kinematics does the rest, near the posture of the
first frame. Objects rest in their places. A lead-out is the lead-in of the motion played backwards.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from hoi_retarget.dynamics.inverse_dynamics import GRAVITY, Movement, mass_centres, mass_jacobian, required_robot_wrench
from hoi_retarget.dynamics.physics_scene import SOLES, PhysicsScene
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.spec import SIDES
from hoi_retarget.simulation.rollout import TICK, Reference

LENGTH = 50  # Of a lead-in or a lead-out, in ticks.
_MIN_CAPTURE_MARGIN = 0.01  # Of a balanced capture point within the soles [m].
_MIN_LIFT = 0.01  # A foot is in the air with all of its sole this high [m].
_MAX_SUPPORT_HEIGHT = 0.015  # Of a sole's corner that carries weight [m].
_MAX_STRIDE, _MIN_WIDTH = 0.3, 0.18  # Between the feet of a stance, ahead and aside [m].
_MIN_FOOT_SHARE = 0.25  # Of the way between the feet, from a balanced centre of mass to either foot.
_IK_ITERATIONS = 20
_FEET, _CENTRE, _BASE, _POSTURE = 100.0, 60.0, 3.0, 0.3  # Weights of inverse kinematics.
_SWING_S, _MIN_SWING_S = 0.5, 0.2  # Of a foot in the air.
_DIFFERENCE_S, _NO_MOTION = 1e-4, 1e-6


def with_lead_in_and_out(scene: PhysicsScene, reference: Reference) -> tuple[Reference, int, int]:
    """Return a reference with a lead-in or a lead-out where it is off balance, and their ticks.

    A reference with a hand at an object in that tick gets none there.
    """
    parts, before, after = [reference], 0, 0
    if _is_off_balance(scene, reference, 0):
        parts, before = [lead_in(scene, reference.qpos[0], reference.qvel[0]), reference], LENGTH
    if _is_off_balance(scene, reference, -1):
        back, after = lead_in(scene, reference.qpos[-1], -reference.qvel[-1]), LENGTH
        parts.append(replace(back, qpos=back.qpos[::-1], qvel=-back.qvel[::-1], torques=back.torques[::-1]))
    if len(parts) == 1:
        return reference, 0, 0
    touched = np.full((before + len(reference.qpos) + after, reference.touched.shape[1]), -1)
    touched[before : before + len(reference.qpos)] = reference.touched
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in ("qpos", "qvel", "torques")}
    found = replace(reference, touched=frozen(touched, int), **{name: frozen(item) for name, item in arrays.items()})
    return found, before, after


def capture_margin(scene: PhysicsScene, qpos: Float[np.ndarray, "nq"], qvel: Float[np.ndarray, "nv"]) -> float:
    """Return the margin of a state's capture point within the soles on the floor [m]; minus infinity without soles.

    The capture point is the centre of mass on the floor, ahead by its velocity over the frequency of a pendulum.
    """
    n = scene.model.n
    here = scene.model.forward(qpos[None, : 7 + n])
    centre, speed = _centre_and_speed(scene.model, qpos[None, : 7 + n], qvel[None, : 6 + n])
    capture = centre[:2] + speed[:2] * np.sqrt(centre[2] / GRAVITY)
    corners = np.concatenate([here.site_position(name) for name in sorted(SOLES)])
    low = corners[corners[:, 2] < _MAX_SUPPORT_HEIGHT, :2]
    if len(low) < 3:
        return -np.inf
    sides = ConvexHull(low).equations
    return float(-(sides[:, :2] @ capture + sides[:, 2]).max())


def lead_in(scene: PhysicsScene, qpos: Float[np.ndarray, "nq"], qvel: Float[np.ndarray, "nv"]) -> Reference:
    """Return the ticks before a state, from a stance at rest on, in which nothing is touched."""
    model, n = scene.model, scene.model.n
    goal, speed = qpos[None, : 7 + n], qvel[None, : 6 + n]
    here, later = model.forward(goal), model.forward(model.integrate(goal, _DIFFERENCE_S * speed))
    centre, moving = _centre_and_speed(model, goal, speed)
    place, feet = _stance(here, centre[:2], moving[:2])
    share = np.arange(LENGTH + 1) / LENGTH
    foot_poses = {name: _foot(here, later, name, start, share) for name, start in feet.items()}
    centres = _blend(share, place, centre[:2], moving[:2], LENGTH * TICK)
    near = np.repeat(goal, len(share), axis=0)
    near[:, 7:] = _blend(share, goal[0, 7:], goal[0, 7:], speed[0, 6:], LENGTH * TICK)
    path = _solve_postures(model, near, foot_poses, centres)
    path[-1] = goal[0]
    movement = _movement(path, speed[0])
    torques = _torques(model, movement)
    objects = np.tile(qpos[7 + n :], (LENGTH, 1)), np.zeros((LENGTH, len(qvel) - 6 - n))
    return Reference(
        np.concatenate([movement.qpos[:-1], objects[0]], axis=1),
        np.concatenate([movement.qvel[:-1], objects[1]], axis=1),
        torques[:-1],
        (),
        np.zeros((LENGTH, 0), dtype=int),
    )


def _is_off_balance(scene: PhysicsScene, reference: Reference, tick: int) -> bool:
    if (reference.touched[tick] >= 0).any():
        return False
    qpos, qvel = reference.qpos[tick], reference.qvel[tick]
    here = scene.model.forward(qpos[None, : 7 + scene.model.n])
    return capture_margin(scene, qpos, qvel) < _MIN_CAPTURE_MARGIN or len(_standing(here)) < len(SIDES)


def _standing(kinematics: Kinematics) -> list[str]:
    """Return the sides of the feet on the floor, or that of the lower one."""
    heights = {
        side: min(kinematics.site_position(name)[0, 2] for name in SOLES if name.startswith(side)) for side in SIDES
    }
    return [side for side in SIDES if heights[side] < max(_MIN_LIFT, min(heights.values()) + 1e-6)]


def _stance(
    kinematics: Kinematics, centre: np.ndarray, moving: np.ndarray
) -> tuple[Float[np.ndarray, "2"], dict[str, Float[np.ndarray, "3"]]]:
    """Return the places of the centre of mass and of the feet at rest [m]."""
    place = centre - 0.5 * moving * LENGTH * TICK  # From where it gains its speed steadily.
    feet = {f"{side}_foot": kinematics.site_position(f"{side}_foot")[0] for side in SIDES}
    standing = _standing(kinematics)
    if len(standing) == 1:
        held, (raised,) = f"{standing[0]}_foot", (side for side in SIDES if side not in standing)
        yaw = kinematics.site_rotation(held)[0][:2, 0]
        ahead = yaw / np.linalg.norm(yaw)
        aside = np.array([-ahead[1], ahead[0]]) * (1.0 if raised == "left" else -1.0)
        axes = np.stack([ahead, aside])
        step = np.clip(2.0 * axes @ (place - feet[held][:2]), (-_MAX_STRIDE, _MIN_WIDTH), _MAX_STRIDE) @ axes
        feet[f"{raised}_foot"] = np.array([*(feet[held][:2] + step), feet[held][2]])
    first, second = (feet[f"{side}_foot"][:2] for side in SIDES)
    way = second - first
    along = np.clip((place - first) @ way / max(way @ way, 1e-9), _MIN_FOOT_SHARE, 1.0 - _MIN_FOOT_SHARE)
    return first + along * way, feet


def _foot(
    here: Kinematics, later: Kinematics, name: str, start: Float[np.ndarray, "3"], share: Float[np.ndarray, "L"]
) -> tuple[Float[np.ndarray, "L 3"], Float[np.ndarray, "L 3 3"]]:
    """Return a foot's poses from flat on the floor, which it leaves as late as it can: it does not slide."""
    end, rotation, after = here.site_position(name)[0], here.site_rotation(name)[0], later.site_rotation(name)[0]
    flat = _flat(rotation)
    height = -(_corners(here, name) @ rotation)[:, 2].min()
    speed = (later.site_position(name)[0] - end) / _DIFFERENCE_S
    turned, turned_after = (se3.log(se3.matrix_to_quat(flat.T @ item)) for item in (rotation, after))
    raised = max(end[2] - height, 0.0)
    # With more it would be under the floor first.
    seconds = 3.0 * raised / speed[2] if speed[2] > _NO_MOTION else _SWING_S
    if np.linalg.norm(start[:2] - end[:2]) < _NO_MOTION and raised < _MIN_LIFT:
        seconds = LENGTH * TICK  # It stands.
    seconds = float(np.clip(seconds, _MIN_SWING_S, LENGTH * TICK))
    left = np.clip(1.0 - (1.0 - share) * LENGTH * TICK / seconds, 0.0, 1.0)
    places = _blend(left, np.array([*start[:2], height]), end, speed, seconds)
    turns = _blend(left, np.zeros(3), turned, (turned_after - turned) / _DIFFERENCE_S, seconds)
    return places, flat @ se3.quat_to_matrix(se3.exp(turns))


def _flat(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """Return the rotation about the vertical with the heading of another one."""
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


def _solve_postures(
    model: RobotModel,
    qpos: Float[np.ndarray, "L nq"],
    feet: dict[str, tuple[Float[np.ndarray, "L 3"], Float[np.ndarray, "L 3 3"]]],
    centres: Float[np.ndarray, "L 2"],
) -> Float[np.ndarray, "L nq"]:
    """Return configurations near others with feet in poses, and centres of mass above places.

    Damped least squares over all ticks at once, with the centre of mass's Jacobian, which the retargeting has not.
    """
    start = qpos
    stiff = np.concatenate([[0.0, 0.0, _BASE], [_BASE] * 3, [_POSTURE] * model.n])
    for _ in range(_IK_ITERATIONS):
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
    needs, kinematics = required_robot_wrench(model, movement), model.forward(movement.qpos)
    names = sorted(SOLES)
    corners = np.stack([kinematics.site_position(name) for name in names], axis=1)
    jacobians = np.stack([kinematics.jacobian(name)[:, :3, 6:] for name in names], axis=1)
    low = corners[:, :, 2] < np.maximum(_MAX_SUPPORT_HEIGHT, corners[:, :, 2].min(axis=1, keepdims=True) + 1e-3)
    found = needs.torques.copy()
    for tick, on in enumerate(low):
        arms = se3.skew(corners[tick, on] - needs.centre[tick])
        given = np.concatenate([np.tile(np.eye(3), (1, on.sum())), np.concatenate(list(arms), axis=1)])
        forces = np.linalg.lstsq(given, needs.wrench[tick], rcond=1e-6)[0].reshape(-1, 3)
        found[tick] -= np.einsum("kin,ki->n", jacobians[tick, on], forces)
    return found


def _centre_and_speed(
    model: RobotModel, qpos: Float[np.ndarray, "1 nq"], qvel: Float[np.ndarray, "1 nv"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    here = model.forward(qpos)
    return mass_centres(here)[0], mass_jacobian(here)[0] @ qvel[0]
