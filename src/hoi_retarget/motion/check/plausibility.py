"""The plausibility of a motion, and findings about its continuity, the floor and the joints' ranges.

Plausibility is that of a robot that stands and walks on the floor z = 0, for files with nothing but a root's path and
joint angles. Each figure is small for correctly read motions of any kind, and at least one is large for most wrong
readings: a standing foot is flat and still at one height, joints inside their ranges, elbows outside the trunk.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.motion.check.finding import Change, FormatFinding, contradiction
from hoi_retarget.motion.check.object_checks import CheckContext, ObjectPath
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import describe_frames, evenly_spaced, repeated, runs
from hoi_retarget.robots.model import Kinematics, RobotModel

_MAX_PAIRS = 80  # Of neighbouring frames, evenly over the clip.
_RANGE_TOLERANCE_RAD = 0.02
_MIN_PELVIS_SPEED_MPS, _MIN_MOVING_PAIRS = 0.1, 6
"""Slides count where the pelvis moves at this speed in as many pairs of frames."""


@dataclass(frozen=True)
class Plausibility:
    """Figures against a motion; 0 is a perfect one."""

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
        """The sum of all figures, from 0 to 8 [unitless].

        Each figure counts from 0 to 1, and the slide once more where the slower foot outruns the pelvis: that of a
        correct motion does not, and a robot that was turned about a wrong axis may be level otherwise.
        """
        return sum(_count(abs(getattr(self, name)) / half) for name, half in _HALF.items()) + _count(self.slide**4)


# Values that count one half: correct motions rarely reach them.
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


_MIN_STEP = 1e-6  # Shorter steps are rests.
_NEIGHBOUR_STEPS = 4  # Before and after a step, to compare with.
_JUMP_RATIO = 8.0  # Of a jump to the steps around it.
_MIN_JOINT_JUMP_RAD, _MIN_ROOT_JUMP_M, _MIN_TURN_JUMP_RAD = 0.15, 0.06, 0.15
_MIN_WRONG_JOINT_JUMP_RAD = 0.25
"""Smaller joint steps are remarks: a wrist of a published file makes one of 0.22 rad."""
_ABRUPT_SHARE, _MIN_LAST_STEP = 0.3, 1e-3
"""A movement that comes to rest slows down first: its last step is a smaller part of those around, or tiny."""
_MAX_DROPPED_FRAMES, _CATCH_UP_RATIO = 3, 1.5
"""A longer stop that goes on at the speed from before is a stop; dropped frames make a step of this many usual ones."""


def check_continuity(context: CheckContext) -> Iterator[FormatFinding]:
    """Yield findings about the steps from frame to frame."""
    model, qpos = context.model, context.qpos
    root = np.linalg.norm(np.diff(qpos[:, :3], axis=0), axis=1)
    turn = se3.angle_between(qpos[:-1, 3:7], qpos[1:, 3:7])
    joints = np.abs(np.diff(qpos[:, 7:], axis=0))
    whole = root + turn + joints.max(axis=1, initial=0.0)
    steps = np.column_stack([root, turn, joints])
    findings = [_repeated(repeated(qpos), whole), _jumps(model, steps), _speeds(model, joints * context.fps)]
    if not any(findings):
        yield FormatFinding("ok", "continuity", "one movement", "no repeated frames, no jumps")
    yield from filter(None, findings)


def _repeated(still: Bool[np.ndarray, "steps"], step: Float[np.ndarray, "steps"]) -> FormatFinding | None:
    """Return frames that repeat the one before: some of a movement, or rests of a robot that stands still."""
    if not still.any():
        return None
    dropped = [run for run in runs(still) if _is_dropped(*run, step)]
    share = f"{100 * still.mean():.1f} %"
    if not dropped:
        rests = ", ".join(f"{first + 1} to {stop}" for first, stop in runs(still)[:5])
        numbers = (
            f"{describe_frames(np.flatnonzero(still) + 1)} repeat the one before ({share}): rests in frames {rests}"
        )
        return FormatFinding("note", "repeated frames", "one movement", numbers, "Cut them off where they are padding.")
    frames = np.concatenate([np.arange(first + 1, stop + 1) for first, stop in dropped])
    numbers = f"{describe_frames(frames)} repeat the one before, in the middle of a movement; {share} in all"
    advice = "Interpolate them; was the motion resampled by repeating frames?"
    fix = (Change("interpolate frames", "", tuple(frames.tolist())),)
    return contradiction("repeated frames", "one movement", numbers, advice, fix=fix, spoils="rate")


def _is_dropped(first: int, stop: int, step: Float[np.ndarray, "steps"]) -> bool:
    """Return whether frames of a movement were dropped, and the one before them was put in their place."""
    before, after = step[max(0, first - _NEIGHBOUR_STEPS) : first], step[stop : stop + _NEIGHBOUR_STEPS]
    if len(before) == 0 or len(after) == 0 or min(before[-1], after[0]) <= _MIN_LAST_STEP:
        return False  # Held at the beginning or the end, or come to rest.
    around = np.concatenate([before, after])
    abrupt = min(before[-1], after[0]) > _ABRUPT_SHARE * np.median(around[around > _MIN_STEP])
    others = np.concatenate([before, after[1:]])
    caught_up = after[0] > _CATCH_UP_RATIO * np.median(others[others > _MIN_STEP])
    return bool(abrupt and (stop - first <= _MAX_DROPPED_FRAMES or caught_up))


def _jumps(model: RobotModel, steps: Float[np.ndarray, "steps k"]) -> FormatFinding | None:
    """Return jumps of the root, its rotation, and the joints, a column each."""
    moving = ("the root", "the root's rotation", *model.joint_names)
    smallest = (_MIN_ROOT_JUMP_M, _MIN_TURN_JUMP_RAD, *(_MIN_JOINT_JUMP_RAD,) * model.n)
    found = [
        (frame, name, step)
        for name, step, limit in zip(moving, steps.T, smallest, strict=True)
        for frame in np.flatnonzero(_outliers(step, limit))
    ]
    if not found:
        return None
    frames = np.unique([frame + 1 for frame, _, _ in found])
    names = list(dict.fromkeys(name for _, name, _ in sorted(found, key=lambda item: item[:2])))
    shown = ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")
    numbers = f"jumps into {describe_frames(frames)}: {shown}; {_JUMP_RATIO:g} times the steps around"
    first, stop = max(pairwise([0, *frames.tolist(), len(steps) + 1]), key=lambda part: part[1] - part[0])
    advice = f"Cut the clip there (frames {first} to {stop - 1} are whole), or make it anew: a consumer would see "
    advice += "enormous velocities."
    if not any(name not in model.joint_names or step[frame] > _MIN_WRONG_JOINT_JUMP_RAD for frame, name, step in found):
        return FormatFinding("note", "jump", "one movement", numbers, "A small one: look at it, or smooth it.")
    fix = (Change("keep frames", "", (first, stop)),)
    return contradiction("jump", "one movement", numbers, advice, fix=fix)


def _outliers(step: Float[np.ndarray, "steps"], min_step: float) -> Bool[np.ndarray, "steps"]:
    """Return the mask of steps far longer than all but the longest around them."""
    if len(step) < 2 * _NEIGHBOUR_STEPS + 1:
        return np.zeros(len(step), dtype=bool)
    padded = np.pad(step, _NEIGHBOUR_STEPS, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * _NEIGHBOUR_STEPS + 1).copy()
    windows[:, _NEIGHBOUR_STEPS] = 0.0
    # The second longest: a single wrong frame makes two long steps.
    around = np.partition(windows, -2, axis=1)[:, -2]
    return (step > min_step) & (step > _JUMP_RATIO * around)


def _speeds(model: RobotModel, speeds: Float[np.ndarray, "steps n"]) -> FormatFinding | None:
    ratio = speeds / model.speed_limits
    worst = np.unravel_index(int(ratio.argmax()), ratio.shape) if ratio.size else (0, 0)
    if not ratio.size or ratio[worst] <= 1.0:
        return None
    name = model.joint_names[int(worst[1])]
    numbers = f"{name} at {speeds[worst]:.1f} rad/s into frame {worst[0] + 1}"
    claim = f"its limit is {model.speed_limits[worst[1]]:.1f} rad/s"
    return FormatFinding("note", "joint speed", claim, numbers, "Is the rate right? A robot cannot follow.")


_MAX_SOLE_HEIGHT_M, _MIN_SOLE_HEIGHT_M = 0.06, -0.05
"""The soles of real retargets are at most 5 cm above the floor, and 2 cm below it."""
_MAX_CARRIER_SPREAD_M, _MAX_CARRIER_DISTANCE_M, _MIN_CARRIER_HEIGHT_SHARE, _MAX_CARRIER_EXCESS_M = 0.01, 1.0, 0.5, 0.1
"""A carrier moves less, a foot comes that near, and its origin is between this share of the soles' height and so much
above it."""
FLOOR, _AT_ZERO = "floor", "the floor is at z = 0"
_MAX_FRAMES = 300
_MAX_EXCESS_RAD, _MAX_EXCESS_SHARE = 0.1, 0.1
"""Joints farther outside in a larger share of the frames are contradictions."""


def check_floor(context: CheckContext, objects: Sequence[ObjectPath]) -> Iterator[FormatFinding]:
    """Yield whether the robot stands on z = 0, or on an object that never moves."""
    frames = evenly_spaced(len(context.qpos), _MAX_FRAMES)
    heights = context.model.forward(context.qpos[frames]).soles()[..., 2].min(axis=(1, 2))
    low, middle = (float(value) for value in np.quantile(heights, [0.05, 0.5]))
    numbers = (
        f"the lowest sole corner is at {1000 * low:.0f} mm (5 % of frames are lower), median {1000 * middle:.0f} mm"
    )
    if low > _MAX_SOLE_HEIGHT_M and (below := [item for item in objects if _may_carry(item, low, context.qpos)]):
        carriers = ", ".join(f"{item.name} at {item.pos[0, 2]:.2f} m" for item in below)
        numbers += f"; it may stand on {carriers}, whose shapes are not in the file: cannot be told"
        yield FormatFinding("unknown", FLOOR, _AT_ZERO, numbers)
    elif low > _MAX_SOLE_HEIGHT_M:
        yield _moved(numbers, f"Lower everything by {low:.3f} m, or say where the floor is.", -low)
    elif middle < _MIN_SOLE_HEIGHT_M:
        yield _moved(numbers, f"Raise everything by {-middle:.3f} m, or say where the floor is.", -middle)
    else:
        yield FormatFinding("ok", FLOOR, _AT_ZERO, numbers)


def _moved(numbers: str, advice: str, by: float) -> FormatFinding:
    return contradiction(FLOOR, _AT_ZERO, numbers, advice, fix=(Change("move", "", (0.0, 0.0, by)),))


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
