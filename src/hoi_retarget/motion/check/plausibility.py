"""The plausibility of a motion, and findings about the floor and the joints' ranges.

Plausibility is that of a robot that stands and walks on the floor z = 0, for files with nothing but a root's path and
joint angles. Each figure is small for correctly read motions of any kind, and at least one is large for most wrong
readings: a standing foot is flat and still at one height, joints inside their ranges, elbows outside the trunk.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.check.finding import Change, FormatFinding, contradiction
from hoi_retarget.motion.check.object_checks import CheckContext, ObjectPath
from hoi_retarget.numerics.arrays import evenly_spaced
from hoi_retarget.robots.model import Kinematics, RobotModel

_MAX_PAIRS = 80  # Of neighbouring frames, evenly over the clip.
_RANGE_TOLERANCE_RAD = 0.02
_MIN_PELVIS_SPEED_MPS, _MIN_MOVING_PAIRS = 0.1, 6
"""Slides count where the pelvis moves at this speed in as many pairs of frames."""


@dataclass(frozen=True)
class Plausibility:
    """Figures against a motion; 0 is a perfect one."""

    upside_down: float  # Fraction of frames in which the pelvis points down or lies.
    tilt: float  # Of the lower foot, median [deg].
    slide: float  # Speed of the slower foot over that of the pelvis, median while the pelvis moves.
    unevenness: float  # Spread of the height of the lowest sole corner, 5th to 95th percentile [m].
    height: float  # Of the lowest sole corner, median [m]; negative is below the floor.
    outside: float  # Fraction of joints and frames outside the range.
    elbows_inside: float  # Fraction of elbows and frames inside the trunk.

    @property
    def penalty(self) -> float:
        """The sum of all figures, from 0 to 8 [unitless].

        Each figure counts from 0 to 1, and the slide once more where the slower foot outruns the pelvis: that of a
        correct motion does not, and a robot that was turned about a wrong axis may be level otherwise.
        """
        return sum(_count(abs(getattr(self, name)) / half) for name, half in _HALF.items()) + _count(self.slide**4)


# Values that count one half: correct motions rarely reach them.
_HALF = dict(upside_down=0.2, tilt=20.0, slide=0.7, unevenness=0.12, height=0.3, outside=0.02, elbows_inside=0.1)
_TRUNK = 0.05
"""An elbow nearer than this to the trunk's middle plane, or beyond it, is inside [of the robot's stature]."""


def _count(halves: float) -> float:
    """Return the penalty of a figure, from 0 to 1, by its multiple of the value that counts one half."""
    return halves / (1.0 + halves)


def sampled(frames: int) -> np.ndarray:
    """Return pairs of neighbouring frames, evenly over a clip: the first ones, then those after them."""
    first = evenly_spaced(frames - 1, _MAX_PAIRS)
    return np.concatenate([first, first + 1])


def plausibility(model: RobotModel, qpos: Float[np.ndarray, "P nq"], fps: float) -> Plausibility:
    """Return the figures against a motion, of frames chosen by `sampled`."""
    kinematics = model.forward(qpos)
    corners = kinematics.soles()
    lowest = corners[..., 2].min(axis=2)
    heights = lowest.min(axis=1)
    half = len(qpos) // 2
    slower = (np.linalg.norm(corners[half:] - corners[:half], axis=-1).mean(axis=-1) * fps).min(axis=1)
    pelvis = np.linalg.norm(qpos[half:, :3] - qpos[:half, :3], axis=1) * fps
    moves = pelvis > _MIN_PELVIS_SPEED_MPS
    low, middle, high = np.quantile(heights, [0.05, 0.5, 0.95])
    up = kinematics.orientation("pelvis")[2, 2]
    theta = qpos[:, 7:]
    outside = np.maximum(model.lower - theta, theta - model.upper) > _RANGE_TOLERANCE_RAD
    return Plausibility(
        upside_down=float(np.mean(up < 0.1)),
        tilt=float(np.median(_tilts(corners)[np.arange(len(qpos)), lowest.argmin(axis=1)])),
        slide=float(np.median(slower[moves] / pelvis[moves])) if moves.sum() >= _MIN_MOVING_PAIRS else 0.0,
        unevenness=float(high - low),
        height=float(middle),
        outside=float(outside.mean()),
        elbows_inside=float(np.mean(_elbows_aside(kinematics) < _TRUNK * model.spec.stature)),
    )


def _tilts(corners: Float[np.ndarray, "P 2 4 3"]) -> Float[np.ndarray, "P 2"]:
    """Return the angle of each sole to the floor [deg]."""
    heel_inner, heel_outer, toe_inner, _ = np.moveaxis(corners, 2, 0)
    normal = np.cross(toe_inner - heel_inner, heel_outer - heel_inner)
    length = np.linalg.norm(normal, axis=-1)
    return np.degrees(np.arccos(np.clip(np.abs(normal[..., 2]) / length, 0.0, 1.0)))


def _elbows_aside(kinematics: Kinematics) -> Float[np.ndarray, "P 2"]:
    """Return the distance of each elbow to its own side from the trunk's middle plane [m]."""
    torso, left_axis = kinematics.site_position("torso"), kinematics.site_rotation("torso")[:, :, 1]
    aside = [
        sign * np.sum((kinematics.site_position(f"{side}_elbow") - torso) * left_axis, axis=1)
        for side, sign in (("left", 1.0), ("right", -1.0))
    ]
    return np.stack(aside, axis=1)


FLOOR, _AT_ZERO = "floor", "the floor is at z = 0"
_MAX_OFF_M = 0.04
"""The floor may be so far from z = 0: motions in use have it within 4 cm, but for those that hover in part."""
_MAX_READABLE_M, _MIN_READABLE_M = 0.06, -0.05  # Farther off, the motion cannot be used as it is.
_MAX_LEVEL_SPREAD_M = 0.03
"""Standing feet at one height within this stand on one floor, at their median; else the floor is the lowest of them."""
_MAX_DRIFT_M, _MIN_DRIFT_PART = 0.06, 0.75
"""A floor that rises or sinks farther over the clip, of which it is so large a part of the heights' variance."""
_STANDING_MPS, _MIN_STANDING = 0.15, 8
"""The slowest corner of a standing sole, and the frames without which the slowest third stands."""
_MAX_CARRIER_SPREAD_M, _MAX_CARRIER_DISTANCE_M, _MIN_CARRIER_HEIGHT_SHARE, _MAX_CARRIER_EXCESS_M = 0.01, 1.0, 0.5, 0.1
"""A carrier moves less, a foot comes that near, and its origin is between this share of the soles' height and so much
above it."""
_MAX_FRAMES = 300
_MAX_EXCESS_RAD, _MAX_EXCESS_SHARE = 0.1, 0.1
"""Joints farther outside in a larger share of the frames are contradictions."""


def check_floor(context: CheckContext, objects: Sequence[ObjectPath]) -> Iterator[FormatFinding]:
    """Yield whether the robot stands on z = 0, or on an object that never moves."""
    first = evenly_spaced(len(context.qpos) - 1, _MAX_FRAMES)
    soles = context.model.forward(context.qpos[np.concatenate([first, first + 1])]).soles()
    lowest = soles[: len(first), ..., 2].min(axis=2)
    heights = lowest.min(axis=1)
    corners = np.linalg.norm(soles[len(first) :] - soles[: len(first)], axis=-1).min(axis=2) * context.fps
    speeds = corners[np.arange(len(first)), lowest.argmin(axis=1)]
    stands = speeds < _STANDING_MPS
    stands = stands if stands.sum() >= _MIN_STANDING else speeds <= np.quantile(speeds, 0.3)
    standing, low, middle = heights[stands], *(float(value) for value in np.quantile(heights, [0.05, 0.5]))
    level = np.subtract(*np.quantile(standing, [0.9, 0.1])) < _MAX_LEVEL_SPREAD_M
    off = float(np.median(standing)) if level else min(max(low, 0.0), float(np.median(standing)))
    drift, part = _drift(first[stands] / first[-1], standing)
    numbers = f"the lowest sole corner is at {1e3 * low:.0f} mm (5 % of frames are lower), median {1e3 * middle:.0f} mm"
    carriers = [item for item in objects if _may_carry(item, max(low, abs(drift)), context.qpos)]
    wrong = off > _MAX_OFF_M or (abs(drift) > _MAX_DRIFT_M and part > _MIN_DRIFT_PART)
    if wrong and carriers:
        names = ", ".join(f"{item.name} at {item.pos[0, 2]:.2f} m" for item in carriers)
        numbers += f"; it may stand on {names}, whose shapes are not in the file: cannot be told"
        yield FormatFinding("unknown", FLOOR, _AT_ZERO, numbers)
    elif abs(off) > _MAX_OFF_M:
        advice = f"{'Lower' if off > 0 else 'Raise'} everything by {abs(off):.3f} m, or say where the floor is."
        spoils = "nothing" if _MIN_READABLE_M < off < _MAX_READABLE_M else "poses"
        fix = (Change("move", "", (0.0, 0.0, -off)),)
        yield contradiction(FLOOR, _AT_ZERO, numbers, advice, spoils=spoils, fix=fix)
    elif wrong:
        numbers += f"; standing feet {'rise' if drift > 0 else 'sink'} by {1000 * abs(drift):.0f} mm over the clip"
        fix = (Change("lower evenly", "", (-0.5 * drift, 0.5 * drift)),)
        advice = "Take the rise out of all heights, evenly over the clip."
        yield contradiction(FLOOR, _AT_ZERO, numbers, advice, spoils="nothing", fix=fix)
    else:
        yield FormatFinding("ok", FLOOR, _AT_ZERO, numbers)


def _drift(times: Float[np.ndarray, "K"], heights: Float[np.ndarray, "K"]) -> tuple[float, float]:
    """Return the rise of the line through heights over the clip [m], and its part of the variance, from 0 to 1."""
    deviations, rises = times - times.mean(), heights - heights.mean()
    size = float(deviations @ deviations)
    rise = float(deviations @ rises) / size if size > 0 else 0.0
    return rise, rise**2 * size / max(float(rises @ rises), 1e-12)


def _may_carry(item: ObjectPath, soles_at: float, qpos: np.ndarray) -> bool:
    """Return whether an object that never moves has its origin at the height of the soles or not far below."""
    still = np.ptp(item.pos, axis=0).max() < _MAX_CARRIER_SPREAD_M
    near = np.linalg.norm(qpos[:, :2] - item.pos[0, :2], axis=1).min() < _MAX_CARRIER_DISTANCE_M
    lowest, highest = _MIN_CARRIER_HEIGHT_SHARE * soles_at, soles_at + _MAX_CARRIER_EXCESS_M
    return bool(still and near and lowest < item.pos[0, 2] < highest)


def check_ranges(context: CheckContext) -> Iterator[FormatFinding]:
    """Yield the finding of joints outside their ranges."""
    model, qpos = context.model, context.qpos
    outside = np.maximum(model.lower - qpos[:, 7:], qpos[:, 7:] - model.upper)
    worst, often = outside.max(axis=0), (outside > _MAX_EXCESS_RAD).mean(axis=0)
    claim = f"the ranges of {model.spec.name}"
    if (worst <= 0.01).all():
        yield FormatFinding("ok", "joint ranges", claim, "all angles are inside")
        return
    beyond = 100 * (outside > 0.01).mean(axis=0)
    names = [
        f"{model.joint_names[index]} by {np.degrees(worst[index]):.1f} deg in {beyond[index]:.0f} %"
        for index in np.flatnonzero(worst > 0.01)
    ]
    numbers = f"outside: {'; '.join(names[:6])}" + ("; ..." if len(names) > 6 else "")
    if (often > _MAX_EXCESS_SHARE).any():
        advice = "Is this the robot? Are order, sign and zero of these joints its own?"
        yield contradiction("joint ranges", claim, numbers, advice)
    else:
        yield FormatFinding("note", "joint ranges", claim, numbers, "A robot cannot follow; consumers clip.")
