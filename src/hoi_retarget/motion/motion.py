"""The robot side of a clip: what a retarget produced, and its file.

The file is `<name>.npz` without pickled objects; body poses are derived from `qpos` by forward
kinematics and never stored.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.errors import ClipError
from hoi_retarget.numerics.arrays import check_shape, frozen

UNIT_TOLERANCE = 1e-3  # Of a quaternion's length: more is damage, not rounding.


@dataclass(frozen=True, eq=False)
class Motion:
    """One robot's motion with the objects it moves; T frames, O objects, C contact links, n joints.

    Raises `ClipError` when shapes disagree, a number that must be finite is not, or a rotation is
    no unit quaternion.
    """

    robot: str
    fps: float
    joint_names: tuple[str, ...]
    qpos: Float[np.ndarray, "T nq"]
    """Root position [m], root rotation wxyz, joints [rad] in `joint_names` order."""
    ik_qpos: Float[np.ndarray, "T nq"]
    """The same after inverse kinematics alone."""
    object_names: tuple[str, ...]
    object_pos: Float[np.ndarray, "T O 3"]
    object_quat: Float[np.ndarray, "T O 4"]
    object_scale: Float[np.ndarray, "O"]
    """Geometry scale: vertices times this about the object's origin."""
    contact_links: tuple[str, ...]
    contact_flags: Bool[np.ndarray, "T C"]
    contact_object: Int[np.ndarray, "T C"]
    """Index of the touched object, -1 for none."""
    contact_points: Float[np.ndarray, "T C 3"]
    """Point to touch, in the frame of the scaled object [m]; NaN where inactive."""
    stance_flags: Bool[np.ndarray, "T 2"]
    """Left and right foot on the floor."""
    first_source_frame: int
    """How many leading frames of the source were dropped."""
    human_height: float
    """[m]"""
    report: Mapping[str, Any]
    """Statuses, costs, figures, seconds, configuration, versions, source; plain JSON values."""

    def __post_init__(self) -> None:
        kinds = {"contact_flags": bool, "stance_flags": bool, "contact_object": int}
        for name in ARRAYS:
            object.__setattr__(self, name, frozen(getattr(self, name), kinds.get(name, float)))
        for name in ("joint_names", "object_names", "contact_links"):
            object.__setattr__(self, name, tuple(str(item) for item in getattr(self, name)))
        if not (np.isfinite(self.fps) and self.fps > 0):
            raise ClipError(f"motion: the rate is {self.fps} frames a second; it must be positive.")
        self._check_shapes()
        self._check_values()

    def _check_shapes(self) -> None:
        frames, n = len(self.qpos), len(self.joint_names)
        objects, links = len(self.object_names), len(self.contact_links)
        expected = {
            "qpos": (frames, 7 + n),
            "ik_qpos": (frames, 7 + n),
            "object_pos": (frames, objects, 3),
            "object_quat": (frames, objects, 4),
            "object_scale": (objects,),
            "contact_flags": (frames, links),
            "contact_object": (frames, links),
            "contact_points": (frames, links, 3),
            "stance_flags": (frames, 2),
        }
        for name, shape in expected.items():
            check_shape("motion", name, getattr(self, name), shape)
        if frames == 0:
            raise ClipError("motion: there are no frames in it.")

    def _check_values(self) -> None:
        for name in ("qpos", "ik_qpos", "object_pos", "object_quat", "object_scale"):
            if not np.isfinite(getattr(self, name)).all():
                raise ClipError(f"motion: {name} holds numbers that are not finite.")
        rotations = {"qpos": self.qpos[:, 3:7], "ik_qpos": self.ik_qpos[:, 3:7], "object_quat": self.object_quat}
        for name, quats in rotations.items():
            lengths = np.linalg.norm(np.clip(quats, -2.0, 2.0), axis=-1)  # Damage may hold any number.
            if (np.abs(lengths - 1.0) > UNIT_TOLERANCE).any():
                raise ClipError(f"motion: {name} holds rotations that are not unit quaternions.")
        if ((self.contact_object < -1) | (self.contact_object >= len(self.object_names))).any():
            raise ClipError(f"motion: contact_object names an object beyond its {len(self.object_names)}.")

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.qpos)

    @property
    def person(self) -> int:
        """Which of the clip's people it follows, by its report: the first, where that does not say."""
        person = self.report.get("person")
        return person if isinstance(person, int) else 0


ARRAYS = (
    "qpos",
    "ik_qpos",
    "object_pos",
    "object_quat",
    "object_scale",
    "contact_flags",
    "contact_object",
    "contact_points",
    "stance_flags",
)
