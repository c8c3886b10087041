"""Findings about the steps of robot, bodies and objects from frame to frame: repeats, jumps, single wrong frames."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.motion.check.finding import Change, FormatFinding, contradiction
from hoi_retarget.motion.check.object_checks import CheckContext, ObjectPath
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import describe_frames, repeated, runs
from hoi_retarget.robots.model import RobotModel

_MIN_STEP = 1e-6  # Shorter steps are rests.
_NEIGHBOUR_STEPS = 4  # Before and after a step, to compare with.
_JUMP_RATIO = 8.0  # Of a jump to the steps around it.
_MIN_JOINT_JUMP_RAD, _MIN_ROOT_JUMP_M, _MIN_TURN_JUMP_RAD = 0.15, 0.06, 0.15
_MIN_WRONG_JOINT_JUMP_RAD = 0.25  # Smaller joint steps are remarks: a wrist of a published file makes one of 0.22 rad.
_ABRUPT_SHARE, _MIN_LAST_STEP = 0.3, 1e-3
"""A movement that comes to rest slows down first: its last step is a smaller part of those around, or tiny."""
_MAX_DROPPED_FRAMES, _CATCH_UP_RATIO = 3, 1.5
"""A longer stop that goes on at the speed from before is a stop; dropped frames make a step of this many usual ones."""


def check_continuity(
    context: CheckContext, objects: Sequence[ObjectPath], bodies: Mapping[str, Float[np.ndarray, "T 3"]]
) -> Iterator[FormatFinding]:
    """Yield findings about the steps from frame to frame."""
    model, qpos = context.model, context.qpos
    root = np.linalg.norm(np.diff(qpos[:, :3], axis=0), axis=1)
    turn = se3.angle_between(qpos[:-1, 3:7], qpos[1:, 3:7])
    joints = np.abs(np.diff(qpos[:, 7:], axis=0))
    whole = root + turn + joints.max(axis=1, initial=0.0)
    wrong = _wrong_frames(context, objects, bodies)
    near_wrong = np.isin(np.arange(1, len(qpos)), [frame + step for frame, _ in wrong for step in (0, 1)])
    steps = np.column_stack([root, turn, joints])
    jumps = _jumps(model, np.where(near_wrong[:, None], 0.0, steps))
    findings = [_repeated(repeated(qpos), whole), _wrong(wrong), jumps, _speeds(model, joints * context.fps)]
    if not any(findings):
        yield FormatFinding("ok", "continuity", "one movement", "no repeated frames, no jumps")
    yield from filter(None, findings)


_STENCIL_REACH, _AROUND = 2, 6  # Frames on either side: of the path through the neighbours, and of those compared.
_STENCIL = np.array([1, -4, 6, -4, 1]) / 6.0
"""A frame's distance from the cubic through the four frames around it, of the five frames."""
_WRONG_RATIO = 4.0
"""Of a wrong frame's distance from the path of its neighbours to what is left around when it is put there."""
_MIN_WRONG_M, _MIN_WRONG_TURN_RAD, _MIN_WRONG_JOINT_RAD = 0.05, 0.15, 0.2


def _wrong_frames(
    context: CheckContext, objects: Sequence[ObjectPath], bodies: Mapping[str, Float[np.ndarray, "T 3"]]
) -> list[tuple[int, str]]:
    """Return single frames off the path of the frames around them, and what is; bodies where nothing else is."""
    qpos, model = context.qpos, context.model
    turning = {"the root's rotation": qpos[:, 3:7], **{f"the rotation of {item.name}": item.quat for item in objects}}
    places = {"the root": qpos[:, :3], **{item.name: item.pos for item in objects}}
    moving = [(name, path, _MIN_WRONG_M) for name, path in places.items()]
    # The angle of a small rotation is twice as large as the change of its quaternion.
    moving += [(name, 2.0 * se3.quat_continuous(quat), _MIN_WRONG_TURN_RAD) for name, quat in turning.items()]
    moving += [(name, qpos[:, 7 + column, None], _MIN_WRONG_JOINT_RAD) for column, name in enumerate(model.joint_names)]
    found = [(int(frame), name) for name, path, limit in moving for frame in _off_path(path, limit)]
    explained = {frame for frame, _ in found}
    others = [(int(frame), name) for name, path in bodies.items() for frame in _off_path(path, _MIN_WRONG_M)]
    return found + [(frame, name) for frame, name in others if frame not in explained]


def _off_path(path: Float[np.ndarray, "T k"], limit: float) -> Int[np.ndarray, "K"]:
    """Return the single frames that are farther than a limit off the path of the frames around them."""
    frames = len(path)
    if frames <= 2 * _STENCIL_REACH:
        return np.zeros(0, dtype=int)
    off = np.full((frames + 2 * _AROUND, path.shape[1]), np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(path, len(_STENCIL), axis=0)
    off[_AROUND + _STENCIL_REACH : -_AROUND - _STENCIL_REACH] = windows @ _STENCIL
    here = off[_AROUND:-_AROUND]
    left = np.zeros_like(here)
    for shift in range(-_AROUND, _AROUND + 1):
        reach = _STENCIL_REACH + shift
        share = _STENCIL[reach] / _STENCIL[_STENCIL_REACH] if 0 <= reach < len(_STENCIL) else 0.0
        left = np.fmax(left, np.abs(off[_AROUND + shift : _AROUND + shift + frames] - share * here))
    alone = np.where(np.abs(here) > _WRONG_RATIO * left, here, 0.0)
    return np.flatnonzero(np.linalg.norm(alone, axis=1) > limit)


def _wrong(found: Sequence[tuple[int, str]]) -> FormatFinding | None:
    if not found:
        return None
    frames = np.unique([frame for frame, _ in found])
    names = list(dict.fromkeys(name for _, name in sorted(found, key=lambda item: item[0])))
    shown = ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")
    numbers = f"{describe_frames(frames)} off the path of the frames before and after: {shown}"
    fix = (Change("interpolate frames", "", tuple(frames.tolist())),)
    return contradiction("jump", "one movement", numbers, "Interpolate: what is there is no movement.", fix=fix)


def _repeated(still: Bool[np.ndarray, "steps"], step: Float[np.ndarray, "steps"]) -> FormatFinding | None:
    """Return frames that repeat the one before: some of a movement, or rests of a robot that stands still."""
    if not still.any():
        return None
    dropped = [run for run in runs(still) if _is_dropped(*run, step)]
    share = f"{100 * still.mean():.1f} %"
    if not dropped:
        rests = ", ".join(f"{first + 1} to {stop}" for first, stop in runs(still)[:5])
        frames = describe_frames(np.flatnonzero(still) + 1)
        numbers = f"{frames} repeat the one before ({share}): rests in frames {rests}"
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
