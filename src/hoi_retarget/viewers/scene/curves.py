"""Curves of a result's figures over time, from the result alone, and of distances from objects where shapes are known.

Every number of the former comes from the functions behind the figures (`metrics`): the mean or the extreme of a
curve is the figure. What lies between two frames is plotted at the later one.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.evaluation import contact_residuals, ground, limits, movement
from hoi_retarget.evaluation.object_distances import distances_of_motion
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.of_robot import check_robot
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.spec import SIDES

SURFACE_GROUPS = ("surface gap", "inside object")
"""Groups that are there where the objects' shapes are known."""


@dataclass(frozen=True, eq=False)
class Curve:
    """One quantity over T frames."""

    name: str
    """Its name within the group, such as `left_palm`."""
    unit: str
    values: Float[np.ndarray, "T"]
    """NaN where undefined."""
    group: str
    """The quantity; curves of one group are drawn in one chart."""
    fps: float
    counted: Bool[np.ndarray, "T"] | None = None
    """Frames that the figure counts, such as stance; None where all of them count."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", frozen(self.values))
        if self.counted is not None:
            object.__setattr__(self, "counted", frozen(self.counted, bool))


def curves_of(
    motion: Motion, model: RobotModel, geometries: tuple[ObjectGeometry, ...] | None = None
) -> tuple[Curve, ...]:
    """Return the curves of a result.

    - `surface gap` [mm]: of the skin of each link that is to touch, negative inside the object.
    - `inside object` [mm]: of the deepest point of the robot.
    - `contact gap` [mm]: of each link that ever touches, its distance on the object from its target.
    - `sole height` [mm]: of each foot's lowest sole corner; stance counts.
    - `slide` [cm/s]: horizontal speed of each ankle over pairs of stance frames.
    - `jerk` [m/s^3]: mean and largest over the links.
    - `joint margin` [deg] and `speed margin` [rad/s]: smallest over the joints.

    Raises:
        RobotError: The motion's joints are not the model's.
    """
    check_robot(motion, model)
    kinematics = model.forward(motion.qpos)

    def curve(group: str, unit: str, name: str, values: np.ndarray, counted: np.ndarray | None = None) -> Curve:
        return Curve(name, unit, values, group, motion.fps, counted)

    stance = motion.stance_flags
    residuals = contact_residuals(motion, kinematics)
    heights = ground.sole_heights(kinematics)
    speeds = _from_frame(1, ground.foot_speeds(kinematics, motion.fps))
    steps = _from_frame(1, stance[1:] & stance[:-1]) == 1.0
    jerks = movement.body_jerks(kinematics, motion.fps)
    range_margins = _finite(limits.joint_range_margins(motion, model).min(axis=1))
    speed_margins = _from_frame(1, _finite(limits.joint_speed_margins(motion, model).min(axis=1)))
    return (
        *_surface_curves(motion, model, geometries),
        *(
            curve("contact gap", "mm", link, 1e3 * residuals[:, column])
            for column, link in enumerate(motion.contact_links)
            if np.isfinite(residuals[:, column]).any()
        ),
        *(
            curve("sole height", "mm", f"{side}_foot", 1e3 * heights[:, column], stance[:, column])
            for column, side in enumerate(SIDES)
        ),
        *(
            curve("slide", "cm/s", f"{side}_foot", np.where(steps[:, column], 1e2 * speeds[:, column], np.nan))
            for column, side in enumerate(SIDES)
        ),
        curve("jerk", "m/s^3", "mean link", _from_frame(3, jerks.mean(axis=1))[: motion.frames]),
        curve("jerk", "m/s^3", "largest", _from_frame(3, jerks.max(axis=1))[: motion.frames]),
        curve("joint margin", "deg", "smallest", np.degrees(range_margins)),
        curve("speed margin", "rad/s", "smallest", speed_margins),
    )


def _surface_curves(
    motion: Motion, model: RobotModel, geometries: tuple[ObjectGeometry, ...] | None
) -> Iterator[Curve]:
    if not geometries:
        return
    distances, gaps = distances_of_motion(motion, model, geometries)
    for column, link in enumerate(motion.contact_links):
        if np.isfinite(gaps[:, column]).any():
            yield Curve(link, "mm", 1e3 * gaps[:, column], SURFACE_GROUPS[0], motion.fps)
    deepest = distances.depth.max(axis=(0, 1), initial=0.0)
    yield Curve("deepest", "mm", 1e3 * deepest, SURFACE_GROUPS[1], motion.fps)


def _from_frame(first: int, values: np.ndarray) -> Float[np.ndarray, "..."]:
    """Return values that begin at a frame, with NaN before it."""
    return np.concatenate([np.full((first, *values.shape[1:]), np.nan), values])


def _finite(values: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Return the values with NaN in the place of infinities: a joint without a limit has no margin."""
    return np.where(np.isfinite(values), values, np.nan)
