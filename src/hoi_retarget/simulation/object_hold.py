"""The hold on objects in a simulated motion: how near these stay to their paths, and when one is lost.

An object is near its path within 10 cm and 20 degrees. It is held if it is so near on average, over the whole motion
(10 cm and 25 degrees, the rule by which others count successes), and at the end. A stricter rule counts the share of
the touched time in which it is near.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.simulation.rollout import TICK, Reference, Rollout, object_poses

NEAR_M, NEAR_DEG = 0.1, 20.0  # Of its path.
MEAN_M, MEAN_DEG = 0.1, 25.0  # On average, of a held object.
LOST_SECONDS = 0.25  # An object that is away from its path for longer is lost there, if it is lost at all.


@dataclass(frozen=True)
class ObjectHold:
    """The hold on one object."""

    index: int
    kept_share: float  # Of the touched time, in which it is near its path.
    mean_m: float  # Distance from its path, a mean [m].
    mean_deg: float  # Angle from it [deg].
    lost_after: float | None  # [s]; None where it is held.


def object_holds(reference: Reference, rollout: Rollout, joints: int) -> tuple[ObjectHold, ...]:
    """Return the holds on the objects that are labelled to touch, in a simulated motion of as many ticks or fewer."""
    ticks, found = len(rollout.qpos), []
    off, turned = off_path(rollout.qpos, reference.qpos[:ticks], joints)
    for index in range(off.shape[1]):
        touched = (reference.touched[:ticks] == index).any(axis=1)
        if touched.any():
            near = (off[:, index] <= NEAR_M) & (turned[:, index] <= NEAR_DEG)
            means = float(off[:, index].mean()), float(turned[:, index].mean())
            held = means[0] <= MEAN_M and means[1] <= MEAN_DEG and bool(near[-1])
            lost_after = None if held else _lost_after(near)
            found.append(ObjectHold(index, float(near[touched].mean()), *means, lost_after))
    return tuple(found)


def off_path(
    qpos: Float[np.ndarray, "K nq"], wanted: Float[np.ndarray, "K nq"], joints: int
) -> tuple[Float[np.ndarray, "K O"], Float[np.ndarray, "K O"]]:
    """Return the distances [m] and the angles [deg] of a scene's objects from where they should be."""
    poses, goals = object_poses(qpos, joints), object_poses(wanted, joints)
    turned = np.degrees(se3.angle_between(poses[:, :, 3:], goals[:, :, 3:]))
    return np.linalg.norm(poses[:, :, :3] - goals[:, :, :3], axis=2), turned


def up_to(rollout: Rollout, seconds: float) -> Rollout:
    """Return the beginning of a simulated motion, of two ticks at least."""
    stop = max(2, round(seconds / TICK) + 1)
    return Rollout(rollout.qpos[:stop], rollout.qvel[:stop], rollout.targets[:stop], None)


def _lost_after(near: Bool[np.ndarray, "K"]) -> float:
    """Return when an object goes away for long, or for the first time [s]."""
    away = runs(~near)
    long = [first for first, stop in away if (stop - first) * TICK > LOST_SECONDS or stop == len(near)]
    return TICK * (long[0] if long else away[0][0] if away else len(near) - 1)
