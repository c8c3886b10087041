"""Contacts as a simulated robot needs them: hands come to objects with room, and labels do not break for a moment.

Without room, hands skim edges and land on the wrong side of them; where one of two labels breaks, an object falls.

A recorded hand comes within millimetres of what it will hold. A simulated one is some centimetres off its path in the
air, hits an edge, and stays on it. Before and after each contact the arms are bent such that the hand's skin keeps some
centimetres from the surface, up to the last moment, in which it comes along the surface's normal.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Bool, Float

from hoi_retarget.dynamics.free_hands import palm_skin
from hoi_retarget.dynamics.physics_scene import PhysicsScene
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen, runs
from hoi_retarget.numerics.filters import nearest_active
from hoi_retarget.objects.distance_field import DistanceField, distance_field
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.spec import PALMS
from hoi_retarget.simulation.rollout import TICK, Reference

CLEAR = 0.045  # Distance of a hand that comes or leaves from the surface [m],
LANDING_SECONDS = 0.16  # which it covers in this time,
NEAR_SECONDS, FADING_SECONDS = 0.8, 0.3  # and keeps for so long before and after a contact [s]; its last part fades.
BROKEN_SECONDS = 0.3  # A contact that breaks for less goes on.
_ITERATIONS, _LARGEST_STEP, _DAMPING = 6, 0.02, 1e-3  # Of inverse kinematics [m].
_SMOOTHING = 2.0  # Of the arms' changes, in ticks.
_LEAST = 1e-3  # [m]


def with_steady_contacts(motion: Motion) -> Motion:
    """Return a motion in which contacts with one object that break for less than 0.3 s go on."""
    arrays = motion.contact_flags, motion.contact_object, motion.contact_points
    flags, objects, points = (array.copy() for array in arrays)
    for column, active in enumerate(motion.contact_flags.T):
        for first, stop in runs(~active):
            short = first > 0 and stop < motion.frames and (stop - first) / motion.fps < BROKEN_SECONDS
            if short and objects[first - 1, column] == objects[stop, column]:
                for values in (flags, objects, points):
                    values[first:stop, column] = values[first - 1, column]
    return replace(motion, contact_flags=flags, contact_object=objects, contact_points=points)


def with_approaches(scene: PhysicsScene, reference: Reference, geometries: Sequence[ObjectGeometry]) -> Reference:
    """Return a reference in which hands keep off objects until they touch; raises `GeometryError` without a mesh."""
    model, n = scene.model, scene.model.n
    fields = [distance_field(item).scaled(own.scale) for item, own in zip(geometries, scene.objects, strict=True)]
    changes = np.zeros((len(reference.qpos), n))
    for palm in (name for name in PALMS if name in reference.links):
        touched = reference.touched[:, reference.links.index(palm)]
        if (touched >= 0).any():
            changes += _changes(scene, reference.qpos, palm, touched, fields)
    qpos, qvel = reference.qpos.copy(), reference.qvel.copy()
    qpos[:, 7 : 7 + n] = np.clip(qpos[:, 7 : 7 + n] + changes, model.lower, model.upper)
    qvel[:, 6 : 6 + n] += np.gradient(qpos[:, 7 : 7 + n] - reference.qpos[:, 7 : 7 + n], TICK, axis=0)
    return replace(reference, qpos=frozen(qpos), qvel=frozen(qvel))


def wanted_room(active: Bool[np.ndarray, "K"]) -> Float[np.ndarray, "K"]:
    """Return the least distance of a hand from the object that it touches in the active ticks [m]; zero in these."""
    away = TICK * np.abs(np.arange(len(active)) - nearest_active(active))
    return CLEAR * _risen(away / LANDING_SECONDS) * _risen((NEAR_SECONDS - away) / FADING_SECONDS)


def _changes(
    scene: PhysicsScene, qpos: np.ndarray, palm: str, touched: np.ndarray, fields: Sequence[DistanceField]
) -> Float[np.ndarray, "K n"]:
    """Return the changes of the joints [rad] for one hand."""
    model, active = scene.model, touched >= 0
    room = wanted_room(active)
    ticks = np.flatnonzero(room > _LEAST)
    found, arm = np.zeros((len(qpos), model.n)), arm_joints(model, palm)
    if not len(ticks):
        return found
    near, (skin, _) = touched[nearest_active(active)][ticks], palm_skin(model, palm)
    bent = qpos[ticks, : 7 + model.n]
    poses = qpos[ticks[:, None], 7 + model.n + 7 * near[:, None] + np.arange(7)]
    for _ in range(_ITERATIONS):
        now = model.forward(bent)
        points = np.einsum("tij,pj->tpi", now.site_rotation(palm), skin) + now.site_position(palm)[:, None]
        step = np.zeros((len(ticks), 6))
        for index, (pose, seen) in enumerate(zip(poses, points, strict=True)):
            local = se3.rotate_inverse(pose[3:], seen - pose[:3])
            distances, normals = fields[near[index]].distances_and_normals(local)
            first = int(distances.argmin())
            missing = np.clip(room[ticks[index]] - distances[first], 0.0, _LARGEST_STEP)
            step[index, :3] = missing * se3.rotate(pose[3:], normals[first])
        jacobian = now.jacobian(palm)[:, :, 6 + arm]
        square = jacobian @ jacobian.transpose(0, 2, 1) + _DAMPING * np.eye(6)
        bent[:, 7 + arm] += np.einsum("tij,ti->tj", jacobian, np.linalg.solve(square, step[..., None])[..., 0])
        bent[:, 7 + arm] = np.clip(bent[:, 7 + arm], model.lower[arm], model.upper[arm])
    found[ticks] = bent[:, 7:] - qpos[ticks, 7 : 7 + model.n]
    found = scipy.ndimage.gaussian_filter1d(found, _SMOOTHING, axis=0)
    return found * (room > 0.0)[:, None]


def arm_joints(model: RobotModel, palm: str) -> np.ndarray:
    """Return the indices of the joints that move one palm and not the other."""
    (other,) = set(PALMS) - {palm}
    own, others = (model.supports[1:, model.sites.frames[name].node] > 0.0 for name in (palm, other))
    return np.flatnonzero(own & ~others)


def _risen(share: np.ndarray) -> np.ndarray:
    share = np.clip(share, 0.0, 1.0)
    return (3.0 - 2.0 * share) * share**2
