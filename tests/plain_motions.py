"""Motions that are made without a solve: a robot's configurations beside an object."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hoi_retarget.clip.clip import Source
from hoi_retarget.motion.motion import Motion, Stage
from hoi_retarget.motion.motion_report import Report
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.robots.model import RobotModel

FPS = 30.0
LINKS = ("left_palm", "right_palm")


def plain_motion(model: RobotModel, qpos: np.ndarray, **changes: Any) -> Motion:
    """Return a motion with both feet on the floor; one object, if any, is named `box`, and lies at the origin."""
    frames = len(qpos)
    objects = len(changes.get("object_names", ("box",)))
    values: dict[str, Any] = {
        "object_names": ("box",),
        "object_pos": np.zeros((frames, objects, 3)),
        "object_quat": np.tile(se3.IDENTITY_QUAT, (frames, objects, 1)),
        "object_scale": np.ones(objects),
        "contact_flags": np.zeros((frames, len(LINKS)), dtype=bool),
        "contact_object": np.full((frames, len(LINKS)), -1),
        "contact_points": np.full((frames, len(LINKS), 3), np.nan),
        "stance_flags": np.ones((frames, 2), dtype=bool),
    }
    return Motion(
        robot=model.spec.name,
        fps=FPS,
        joint_names=model.joint_names,
        stages=(Stage("trajectory", qpos),),
        contact_links=LINKS,
        first_source_frame=0,
        human_height=1.7,
        report=Report(source=Source(path="builtin:carry_box", format="builtin")),
        **{**values, **changes},
    )


def tracks_of(motion: Motion, geometries: Sequence[ObjectGeometry]) -> tuple[ObjectTrack, ...]:
    """Return a motion's objects as tracks, with these shapes."""
    return tuple(
        ObjectTrack(name, motion.object_pos[:, index], motion.object_quat[:, index], geometry)
        for index, (name, geometry) in enumerate(zip(motion.object_names, geometries, strict=True))
    )


def standing_qpos(model: RobotModel, frames: int = 30) -> np.ndarray:
    """Return the home pose with its soles on the floor, in all frames."""
    qpos = np.tile(model.home_qpos, (frames, 1))
    kinematics = model.forward(qpos)
    qpos[:, 2] -= min(kinematics.site_position(name)[0, 2] for name in model.site_names if "_sole_" in name)
    return qpos
