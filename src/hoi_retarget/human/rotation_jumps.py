"""Joints that a recording turns faster than any person can: a hand read palm up in one frame and palm down in the next.

Fits of body models do so where they cannot tell. For a moment, the way before and after is carried on; where it stays,
the jump becomes a quick turn.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import BODY_PARENTS, JOINTS, PARENT
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import seconds_to_frames

LARGEST_STEP = np.radians(60.0)
FASTEST = 30.0  # [rad/s]; forearms turn at 20 at most.
OVER_USUAL = 4.0  # How many times the median of the steps around a jump is.
USUAL_SECONDS = 0.5
MOMENT_SECONDS = 1.0
TURN_SECONDS = 0.1  # On either side of a jump that stays.


@dataclass(frozen=True)
class RotationJump:
    """A rotation of a joint that jumps, in the recording."""

    joint: str
    first_frame: int  # First frame after the jump.
    last_frame: int | None  # Last frame before the jump back; None where it stays.
    degrees: float

    def __str__(self) -> str:
        jump = f"the recording's {self.joint} jumps by {self.degrees:.0f} degrees at frame {self.first_frame}"
        if self.last_frame is None:
            return f"{jump} and stays so: it is turned over {2 * TURN_SECONDS:g} s"
        return f"{jump} and back after frame {self.last_frame}: it is kept as it is before and after"


def without_rotation_jumps(person: Person, fps: float) -> tuple[Person, tuple[RotationJump, ...]]:
    """Return the person without jumps of joints, itself where there are none, and the jumps.

    Rotations to the parents are looked at: of the two ways around, a forearm takes the one that its bones allow.
    """
    quats, jumps = person.joint_quats, []
    local = quats[:, : len(BODY_PARENTS)].copy()  # The root's stay those in the world.
    local[:, 1:] = se3.quat_multiply(se3.quat_conjugate(quats[:, BODY_PARENTS[1:]]), local[:, 1:])
    for index in np.flatnonzero(_large_steps(local, fps).any(axis=0)).tolist():
        found = _jumps(JOINTS[index], local[:, index], fps)
        for jump in found:
            local[:, index] = _smoothed(local[:, index], jump, fps)
        if found:
            parent = BODY_PARENTS[index]
            world = local[:, index] if parent < 0 else se3.quat_multiply(quats[:, parent], local[:, index])
            turns = se3.quat_multiply(world, se3.quat_conjugate(quats[:, index]))
            below = [joint for joint, name in enumerate(JOINTS) if _hangs_from(name, JOINTS[index])]
            quats = quats.copy()
            quats[:, below] = se3.quat_multiply(turns[:, None], quats[:, below])
            jumps += found
    return (replace(person, joint_quats=quats) if jumps else person), tuple(jumps)


def _large_steps(quats: Float[np.ndarray, "T *joints 4"], fps: float) -> Bool[np.ndarray, "steps *joints"]:
    """Return whether each step between two frames is larger and faster than any a person takes."""
    largest = min(max(LARGEST_STEP, FASTEST / fps), np.pi)  # At low rates it cannot be told.
    return np.abs(np.einsum("...i,...i", quats[1:], quats[:-1])) < np.cos(0.5 * largest)


def _hangs_from(joint: str | None, above: str) -> bool:
    return joint is not None and (joint == above or _hangs_from(PARENT[joint], above))


def _jumps(joint: str, quats: Float[np.ndarray, "T 4"], fps: float) -> list[RotationJump]:
    """Return the jumps of one joint in the order in which they are taken out: those of a moment first."""
    steps = se3.angle_between(quats[1:], quats[:-1])
    around = seconds_to_frames(USUAL_SECONDS, fps)
    last = [
        step
        for step in np.flatnonzero(_large_steps(quats, fps)).tolist()
        if steps[step] > OVER_USUAL * np.median(steps[max(step - around, 0) : step + around + 1])
    ]
    momentary, staying = [], []
    while last:
        before = last.pop(0)
        degrees = float(np.degrees(steps[before]))
        back = last[0] if last else None
        if (
            back is not None
            and back - before < seconds_to_frames(MOMENT_SECONDS, fps)
            and _returns(quats, before, back)
        ):
            momentary.append(RotationJump(joint, before + 1, last.pop(0), degrees))
        else:
            staying.append(RotationJump(joint, before + 1, None, degrees))
    return [*momentary, *staying]


def _returns(quats: Float[np.ndarray, "T 4"], before: int, back: int) -> bool:
    """Return whether a joint is nearer to its rotation before a jump after the second one than between them."""
    after, between = se3.angle_between(quats[[back + 1, before + 1]], quats[before])
    return bool(after < 0.5 * between)


def _smoothed(quats: Float[np.ndarray, "T 4"], jump: RotationJump, fps: float) -> Float[np.ndarray, "T 4"]:
    """Return the rotations without one jump."""
    smooth, first = quats.copy(), jump.first_frame
    if jump.last_frame is not None:
        # The joint goes on moving as recorded, turned by what makes both ends fit.
        stop = jump.last_frame + 1
        begin, end = (
            se3.quat_multiply(se3.quat_conjugate(quats[inside]), quats[outside])
            for inside, outside in ((first, first - 1), (stop - 1, stop))
        )
        turns = se3.slerp(begin[None], end[None], np.linspace(0.0, 1.0, stop - first))
        smooth[first:stop] = se3.quat_multiply(quats[first:stop], turns)
        return smooth
    ramp = seconds_to_frames(TURN_SECONDS, fps)
    frames = np.arange(max(first - ramp, 0), min(first + ramp, len(quats)))
    share = (frames - first + ramp + 0.5) / (2 * ramp)
    share = share**2 * (3.0 - 2.0 * share) - (frames >= first)
    jumped = se3.log(se3.quat_multiply(se3.quat_conjugate(quats[first - 1]), quats[first]))
    smooth[frames] = se3.quat_multiply(quats[frames], se3.exp(share[:, None] * jumped))
    return smooth
