"""The joints of a robot as its maker has them: those that move, and those that are held still or follow others."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.resample import ResampledMotion
from hoi_retarget.robots.model import RobotModel


@dataclass(frozen=True, eq=False)
class MakersJoints:
    """All joints of a robot over time, in its maker's order."""

    names: tuple[str, ...]
    pos: Float[np.ndarray, "T m"]
    """[rad], of a slide [m]."""
    vel: Float[np.ndarray, "T m"]
    """[rad/s], of a slide [m/s]."""


def makers_joint_names(model: RobotModel) -> tuple[str, ...]:
    """Return the names of all joints of a robot in its maker's order."""
    return model.spec.joint_order or model.joint_names


def makers_joints(motion: ResampledMotion) -> MakersJoints:
    """Return all joints of a motion: held ones are constant, coupled ones follow as their maker says."""
    model = motion.model
    pos = dict(zip(model.joint_names, motion.qpos[:, 7:].T, strict=True))
    vel = dict(zip(model.joint_names, motion.joint_vel.T, strict=True))
    waiting = list(model.spec.held)
    still = np.zeros(motion.frames)
    while waiting:
        ready = [one for one in waiting if not one.other or one.other in pos]
        # Joints that are coupled in a circle move with none that is known: they stay at their offset.
        for one in ready or waiting:
            ratio = one.ratio if one.other in pos else 0.0
            pos[one.joint] = one.offset + ratio * pos.get(one.other, still)
            vel[one.joint] = ratio * vel.get(one.other, still)
        waiting = [one for one in waiting if one.joint not in pos]
    names = makers_joint_names(model)
    return MakersJoints(names, *(np.stack([of[name] for name in names], axis=1) for of in (pos, vel)))


def held_joints(model: RobotModel, names: tuple[str, ...]) -> list[dict[str, Any]]:
    """Return how those of some joints that do not move on their own get their values, as plain values."""
    return [
        {"name": one.joint, "value": one.offset}
        | ({"follows": one.other, "ratio": one.ratio} if one.other and one.ratio else {})
        for one in model.spec.held
        if one.joint in names
    ]
