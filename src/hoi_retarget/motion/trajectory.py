"""A motion at the rate in which it is exported, with the velocities that belong to it."""

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.numerics.arrays import frozen


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One robot and its objects over time; T frames, O objects, C contact links, n joints.

    Velocities are derivatives of the paths that positions and rotations are taken from, all in the
    world's axes.
    """

    fps: float
    qpos: Float[np.ndarray, "T nq"]
    """Root position [m], root rotation wxyz, joints [rad]."""
    root_lin_vel: Float[np.ndarray, "T 3"]
    """Of the root's origin [m/s]."""
    root_ang_vel: Float[np.ndarray, "T 3"]
    """[rad/s]"""
    joint_vel: Float[np.ndarray, "T n"]
    """[rad/s]"""
    object_pos: Float[np.ndarray, "T O 3"]
    object_quat: Float[np.ndarray, "T O 4"]
    object_lin_vel: Float[np.ndarray, "T O 3"]
    """Of the objects' origins [m/s]."""
    object_ang_vel: Float[np.ndarray, "T O 3"]
    contact_flags: Bool[np.ndarray, "T C"]
    contact_object: Int[np.ndarray, "T C"]
    """Index of the touched object, -1 for none."""
    contact_points: Float[np.ndarray, "T C 3"]
    """In the frame of the scaled object [m]; NaN where nothing is touched."""
    stance_flags: Bool[np.ndarray, "T 2"]

    def __post_init__(self) -> None:
        kinds = {"contact_flags": bool, "stance_flags": bool, "contact_object": int}
        for field in fields(self):
            if field.name != "fps":
                array = frozen(getattr(self, field.name), kinds.get(field.name, float))
                object.__setattr__(self, field.name, array)

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.qpos)
