"""Whether a motion is one of a robot's: its joints, its contact links, and how far it turns them."""

import numpy as np

from hoi_retarget.errors import RobotError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.robots.model import RobotModel

BEYOND_RANGE = np.pi
"""A joint this much beyond its range [rad] is damage: no program makes it, and no figure of it means anything."""


def check_robot(motion: Motion, model: RobotModel) -> None:
    """Raise `RobotError` unless the motion's joints are the model's, in its order, and its contact links are there."""
    if motion.joint_names != model.joint_names:
        strange = sorted(set(motion.joint_names) ^ set(model.joint_names)) or ["the same ones in another order"]
        raise RobotError(
            f"motion of {motion.robot!r}: its joints are not the model's (differing: {', '.join(strange[:10])}"
            f"{', ...' if len(strange) > 10 else ''}). Use the robot it was made for."
        )
    absent = [link for link in motion.contact_links if link not in model.sites.index]
    if absent:
        raise RobotError(f"motion of {motion.robot!r}: {', '.join(absent[:10])} are no contact links of the robot.")


def check_turns(motion: Motion, model: RobotModel) -> None:
    """Raise `RobotError` where a joint is turned so far beyond its range that only damage does it."""
    for stage in motion.stages:
        joints = stage.qpos[:, 7:]
        beyond = np.maximum(joints - model.upper, model.lower - joints)
        if (beyond > BEYOND_RANGE).any():
            frame, joint = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
            raise RobotError(
                f"{stage.name} qpos turns {model.joint_names[joint]} to {joints[frame, joint]:.4g} rad in frame "
                f"{frame}; its range is {model.lower[joint]:.2f} to {model.upper[joint]:.2f}."
            )
