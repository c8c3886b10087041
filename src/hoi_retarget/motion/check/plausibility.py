"""How much a motion looks like one of the robot that stands and walks on the floor z = 0.

Used where nothing but a root's path and joint angles is there. Each figure is small for motions of any kind that
were read correctly, and at least one is large for most ways to read them wrongly: a foot that stands is flat and
does not move, its sole is at one height, joints stay inside their ranges, elbows outside the trunk.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics.arrays import evenly_spaced
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.spec import SIDES, SOLE_CORNERS

_PAIRS = 80  # Neighbouring frames that are looked at, evenly over the clip.
_RANGE_TOLERANCE = 0.02  # [rad]
_MOVES, _ENOUGH = 0.1, 6
"""A pelvis that moves [m/s], and in how many pairs of frames it has to, for slides to tell anything."""


@dataclass(frozen=True)
class Plausibility:
    """What speaks against a motion; 0 is a perfect one."""

    upside_down: float
    """Fraction of frames in which the pelvis points down or lies."""
    tilt: float
    """Of the lower foot, median [deg]."""
    slide: float
    """Speed of the slower foot over that of the pelvis, median while the pelvis moves."""
    unevenness: float
    """Spread of the height of the lowest sole corner, 5th to 95th percentile [m]."""
    height: float
    """Of the lowest sole corner, median [m]; negative is below the floor."""
    outside: float
    """Fraction of joints and frames outside the range."""
    elbows_inside: float
    """Fraction of elbows and frames inside the trunk."""

    @property
    def penalty(self) -> float:
        """Return what speaks against the motion in one number, from 0 to 8.

        Each figure counts from 0 to 1, and the slide once more where the slower foot outruns the pelvis: that of a
        correct motion does not, and a robot that was turned about a wrong axis may be level otherwise.
        """
        return sum(_count(abs(getattr(self, name)) / half) for name, half in _HALF.items()) + _count(self.slide**4)


# Figures that count one half: correct motions rarely reach them.
_HALF = {
    "upside_down": 0.2,
    "tilt": 20.0,
    "slide": 0.7,
    "unevenness": 0.12,
    "height": 0.3,
    "outside": 0.02,
    "elbows_inside": 0.1,
}
_TRUNK = 0.05
"""An elbow nearer than this to the trunk's middle plane, or beyond it, is inside [of the robot's stature]."""


def _count(halves: float) -> float:
    """Return what a figure counts, from 0 to 1, that is so many times the one that counts one half."""
    return halves / (1.0 + halves)


def sampled(frames: int) -> np.ndarray:
    """Return pairs of neighbouring frames, evenly over a clip: the first ones, then those after them."""
    first = evenly_spaced(frames - 1, _PAIRS)
    return np.concatenate([first, first + 1])


def plausibility(model: RobotModel, qpos: Float[np.ndarray, "P nq"], fps: float) -> Plausibility:
    """Return what speaks against a motion, of frames that `sampled` chose."""
    kinematics = model.forward(qpos)
    corners = soles(kinematics)
    lowest = corners[..., 2].min(axis=2)
    heights = lowest.min(axis=1)
    half = len(qpos) // 2
    steps = np.linalg.norm(corners[half:] - corners[:half], axis=-1).mean(axis=-1) * fps
    low, middle, high = np.quantile(heights, [0.05, 0.5, 0.95])
    up = kinematics.orientation("pelvis")[2, 2]
    theta = qpos[:, 7:]
    outside = np.maximum(model.lower - theta, theta - model.upper) > _RANGE_TOLERANCE
    return Plausibility(
        upside_down=float(np.mean(up < 0.1)),
        tilt=float(np.median(_tilts(corners)[np.arange(len(qpos)), lowest.argmin(axis=1)])),
        slide=_slide(steps.min(axis=1), np.linalg.norm(qpos[half:, :3] - qpos[:half, :3], axis=1) * fps),
        unevenness=float(high - low),
        height=float(middle),
        outside=float(outside.mean()),
        elbows_inside=float(np.mean(_elbows_aside(kinematics) < _TRUNK * model.spec.stature)),
    )


def soles(kinematics: Kinematics) -> Float[np.ndarray, "T 2 4 3"]:
    """Return the corners of both soles [m]."""
    feet = [[kinematics.site_position(f"{side}_sole_{corner}") for corner in SOLE_CORNERS] for side in SIDES]
    return np.moveaxis(np.array(feet), 2, 0)


def _slide(slower: Float[np.ndarray, "pairs"], pelvis: Float[np.ndarray, "pairs"]) -> float:
    moves = pelvis > _MOVES
    return float(np.median(slower[moves] / pelvis[moves])) if moves.sum() >= _ENOUGH else 0.0


def _tilts(soles: Float[np.ndarray, "P 2 4 3"]) -> Float[np.ndarray, "P 2"]:
    """Return the angle of each sole to the floor [deg]."""
    heel_inner, heel_outer, toe_inner, _ = np.moveaxis(soles, 2, 0)
    normal = np.cross(toe_inner - heel_inner, heel_outer - heel_inner)
    length = np.linalg.norm(normal, axis=-1)
    return np.degrees(np.arccos(np.clip(np.abs(normal[..., 2]) / length, 0.0, 1.0)))


def _elbows_aside(kinematics: Kinematics) -> Float[np.ndarray, "P 2"]:
    """Return how far each elbow is on its own side of the trunk's middle plane [m]."""
    torso, left_axis = kinematics.site_position("torso"), kinematics.site_rotation("torso")[:, :, 1]
    aside = [
        sign * np.sum((kinematics.site_position(f"{side}_elbow") - torso) * left_axis, axis=1)
        for side, sign in (("left", 1.0), ("right", -1.0))
    ]
    return np.stack(aside, axis=1)
