"""Findings about time: frames that are repeated, and jumps between neighbours."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.motion.check.change import Change
from hoi_retarget.motion.check.finding import Finding
from hoi_retarget.motion.check.surroundings import Surroundings
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import describe_frames, repeated, runs
from hoi_retarget.robots.model import RobotModel

_STILL = 1e-6  # Shorter steps are none.
_NEAR = 4  # Steps before and after, to compare with.
_JUMP = 8.0  # Times the steps around it.
_LEAST_JOINT, _LEAST_ROOT, _LEAST_TURN = 0.15, 0.06, 0.15
"""Smaller steps are no jumps [rad, m, rad]."""
_CLEAR_JOINT = 0.25
"""Joint steps below this are remarks: a wrist of a published file makes one of 0.22 [rad]."""
_ABRUPT, _LEAST_STEP = 0.3, 1e-3
"""A movement that comes to rest slows down first: its last step is a smaller part of those around, or tiny."""
_DROPPED, _CAUGHT_UP = 3, 1.5
"""Frames: a longer stop that goes on at the speed from before is a stop. What moved on meanwhile makes a step of this
many times the usual one."""


def check_continuity(around: Surroundings) -> Iterator[Finding]:
    """Yield what is wrong with the steps from frame to frame."""
    model, qpos = around.model, around.qpos
    root = np.linalg.norm(np.diff(qpos[:, :3], axis=0), axis=1)
    turn = se3.angle_between(qpos[:-1, 3:7], qpos[1:, 3:7])
    joints = np.abs(np.diff(qpos[:, 7:], axis=0))
    whole = root + turn + joints.max(axis=1, initial=0.0)
    steps = np.column_stack([root, turn, joints])
    findings = [_repeated(repeated(qpos), whole), _jumps(model, steps), _speeds(model, joints * around.fps)]
    if not any(findings):
        yield Finding("ok", "continuity", "one movement", "no repeated frames, no jumps")
    yield from filter(None, findings)


def _repeated(still: Bool[np.ndarray, "steps"], step: Float[np.ndarray, "steps"]) -> Finding | None:
    """Return frames that repeat the one before: some of a movement, or rests of a robot that stands still."""
    if not still.any():
        return None
    dropped = [run for run in runs(still) if _is_dropped(*run, step)]
    share = f"{100 * still.mean():.1f} %"
    if not dropped:
        rests = ", ".join(f"{first + 1} to {stop}" for first, stop in runs(still)[:5])
        says = f"{describe_frames(np.flatnonzero(still) + 1)} repeat the one before ({share}): rests in frames {rests}"
        return Finding("note", "repeated frames", "one movement", says, "Cut them off where they are padding.")
    frames = np.concatenate([np.arange(first + 1, stop + 1) for first, stop in dropped])
    says = f"{describe_frames(frames)} repeat the one before, in the middle of a movement; {share} in all"
    advice = "Interpolate them; was the motion resampled by repeating frames?"
    mend = (Change("interpolate frames", "", tuple(frames.tolist())),)
    return Finding("contradiction", "repeated frames", "one movement", says, advice, "rate", mend)


def _is_dropped(first: int, stop: int, step: Float[np.ndarray, "steps"]) -> bool:
    """Return whether frames of a movement were dropped, and the one before them was put in their place."""
    before, after = step[max(0, first - _NEAR) : first], step[stop : stop + _NEAR]
    if len(before) == 0 or len(after) == 0 or min(before[-1], after[0]) <= _LEAST_STEP:
        return False  # Held at the beginning or the end, or come to rest.
    around = np.concatenate([before, after])
    abrupt = min(before[-1], after[0]) > _ABRUPT * np.median(around[around > _STILL])
    others = np.concatenate([before, after[1:]])
    return bool(abrupt and (stop - first <= _DROPPED or after[0] > _CAUGHT_UP * np.median(others[others > _STILL])))


def _jumps(model: RobotModel, steps: Float[np.ndarray, "steps k"]) -> Finding | None:
    """Return jumps of the root, its rotation, and the joints, a column each."""
    moving = ("the root", "the root's rotation", *model.joint_names)
    least = (_LEAST_ROOT, _LEAST_TURN, *(_LEAST_JOINT,) * model.n)
    found = [
        (frame, name, step)
        for name, step, limit in zip(moving, steps.T, least, strict=True)
        for frame in np.flatnonzero(_outliers(step, limit))
    ]
    if not found:
        return None
    frames = np.unique([frame + 1 for frame, _, _ in found])
    names = list(dict.fromkeys(name for _, name, _ in sorted(found, key=lambda item: item[:2])))
    shown = ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")
    says = f"jumps into {describe_frames(frames)}: {shown}; {_JUMP:g} times the steps around"
    first, stop = max(pairwise([0, *frames.tolist(), len(steps) + 1]), key=lambda part: part[1] - part[0])
    advice = f"Cut the clip there (frames {first} to {stop - 1} are whole), or make it anew: a consumer would see "
    advice += "enormous velocities."
    if not any(name not in model.joint_names or step[frame] > _CLEAR_JOINT for frame, name, step in found):
        return Finding("note", "jump", "one movement", says, "A small one: look at it, or smooth it.")
    mend = (Change("keep frames", "", (first, stop)),)
    return Finding("contradiction", "jump", "one movement", says, advice, "poses", mend)


def _outliers(step: Float[np.ndarray, "steps"], least: float) -> Bool[np.ndarray, "steps"]:
    """Return which steps are far longer than all but the longest of those around them."""
    if len(step) < 2 * _NEAR + 1:
        return np.zeros(len(step), dtype=bool)
    padded = np.pad(step, _NEAR, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * _NEAR + 1).copy()
    windows[:, _NEAR] = 0.0
    # The second longest: a single wrong frame makes two long steps.
    around = np.partition(windows, -2, axis=1)[:, -2]
    return (step > least) & (step > _JUMP * around)


def _speeds(model: RobotModel, speeds: Float[np.ndarray, "steps n"]) -> Finding | None:
    ratio = speeds / model.speed_limits
    worst = np.unravel_index(int(ratio.argmax()), ratio.shape) if ratio.size else (0, 0)
    if not ratio.size or ratio[worst] <= 1.0:
        return None
    name = model.joint_names[int(worst[1])]
    says = f"{name} at {speeds[worst]:.1f} rad/s into frame {worst[0] + 1}"
    claim = f"its limit is {model.speed_limits[worst[1]]:.1f} rad/s"
    return Finding("note", "joint speed", claim, says, "Is the rate right? A robot cannot follow.")
