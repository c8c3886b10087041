"""Curves of what a motion would need in physics: the wrench that is missing, and torques."""

from collections.abc import Iterator

import numpy as np

from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import RobotError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.physics.feasibility import forces_on_clip
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.viewers.scene.curves import Curve

FORCE_GROUPS = ("missing wrench", "torque")
"""Groups that are there where masses and torques are known."""


def force_curves(motion: Motion, model: RobotModel, clip: Clip | None) -> tuple[Curve, ...]:
    """Return the curves of forces; none where objects' shapes or the robot's torque limits are not known.

    - `missing wrench` [%]: of the robot over its weight, and of each object over its own.
    - `torque` [%]: of the joint that would need most of its limit.

    Raises `GeometryError` when an object's mesh cannot be read.
    """
    if clip is None and motion.object_names:
        return ()
    try:
        return tuple(_curves(motion, model, clip))
    except RobotError:
        return ()


def _curves(motion: Motion, model: RobotModel, clip: Clip | None) -> Iterator[Curve]:
    forces = forces_on_clip(motion, clip, model)
    missing, torque = FORCE_GROUPS
    yield Curve("robot", "%", 1e2 * forces.missing_share, missing, motion.fps)
    for name, share in zip(motion.object_names, forces.missing_share_at_objects.T, strict=True):
        if np.isfinite(share).any():
            yield Curve(name, "%", 1e2 * share, missing, motion.fps)
    yield Curve("largest", "%", 1e2 * forces.torque_shares.max(axis=1), torque, motion.fps)
