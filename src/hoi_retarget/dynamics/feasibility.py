"""Infeasible stretches of a motion, found without simulation and put in words."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.clip import Clip
from hoi_retarget.dynamics.contact_forces import Forces, forces_of
from hoi_retarget.dynamics.contact_points import ContactPoint
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.files.tables import decode
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.numerics.filters import closed_and_opened, seconds_to_frames
from hoi_retarget.objects.object_joint import parents_of
from hoi_retarget.robots.model import RobotModel

MAX_MISSING_SHARE = 0.10
"""Of a body's weight: with less missing, a controller that leans or gives way a little may still do it."""
_NEGLIGIBLE_SHARE = 0.02  # Of a weight or a limit: rounding, and imperceptible excess.
_MIN_STRETCH_S = 0.1  # Shorter breaks are closed, then shorter stretches dropped.


@dataclass(frozen=True)
class Infeasibility:
    """A stretch of frames that cannot be performed as they are."""

    kind: str  # balance, object, one hand, or torque.
    first_frame: int
    last_frame: int  # Included.
    largest_share: float  # What is missing over the weight, or the torque over its limit, where it is largest.
    text: str

    def __str__(self) -> str:
        return f"frames {self.first_frame} to {self.last_frame}: {self.text}"


def forces_on_clip(motion: Motion, clip: Clip | None, model: RobotModel, physics: Physics | None = None) -> Forces:
    """Return the forces that a motion needs with the objects of the clip that it was made from, if it has any.

    Masses and frictions are by default those of its own configuration.

    Raises `RobotError`: a base carries the robot, or a joint's torque has no limit; `GeometryError`: an object's mesh
    cannot be read.
    """
    physics = physics_of_motion(motion) if physics is None else physics
    if clip is None:
        return forces_of(motion, model, (), physics)
    geometries = [track.geometry for track in clip.objects]
    return forces_of(motion, model, geometries, physics, held_by_others=not_free(clip, motion.person))


def physics_of_motion(motion: Motion) -> Physics:
    """Return the settings of physics that a motion was made with; raises `ReadError` when they are damaged."""
    return decode(Physics, motion.report.config.get("physics", {}), "result: physics")


def held_by_others(clip: Clip, person: int) -> Bool[np.ndarray, "T O"]:
    """Return whether anybody but a person touches each object of a clip in each frame."""
    held = np.zeros((clip.frames, len(clip.objects)), dtype=bool)
    for contact in clip.contacts:
        if contact.person != person:
            held[:, contact.object] |= contact.active
    return held


def not_free(clip: Clip, person: int) -> Bool[np.ndarray, "T O"]:
    """Return whether anybody but a person, or a joint, holds each object of a clip in each frame."""
    parents = parents_of(clip.objects)
    jointed = [track.joint is not None or index in parents for index, track in enumerate(clip.objects)]
    return held_by_others(clip, person) | np.array(jointed, dtype=bool)


def unheld_by_one(forces: Forces, motion: Motion) -> Bool[np.ndarray, "T"]:
    """Return where one link alone is labelled to touch an object off the floor, and cannot hold it."""
    found = np.zeros(motion.frames, dtype=bool)
    for index in range(len(forces.bodies)):
        found |= _one_hand(forces, motion, index) & _unheld(forces, index)
    return found


def over_torque(forces: Forces) -> Bool[np.ndarray, "T n"]:
    """Return where a joint would need more than its limit, and to stay within it costs something.

    It costs nothing where other forces do it as well: then hardly anything is missing, and no torque is over.
    """
    missing = np.concatenate([forces.missing_share[:, None], forces.missing_share_at_objects], axis=1)
    lacking = np.nanmax(missing, axis=1) > _NEGLIGIBLE_SHARE
    still_over = (np.abs(forces.torques) > (1.0 + _NEGLIGIBLE_SHARE) * forces.limits).any(axis=1)
    return (forces.torque_shares > 1.0) & (lacking | still_over)[:, None]


def infeasibilities(forces: Forces, motion: Motion) -> tuple[Infeasibility, ...]:
    """Return the infeasible stretches, the worst of each kind first: balance, objects, torques."""
    found = (_balance(forces, motion), _at_objects(forces, motion), _torques(forces, motion))
    return tuple(item for kind in found for item in sorted(kind, key=lambda item: -item.largest_share))


def _balance(forces: Forces, motion: Motion) -> Iterator[Infeasibility]:
    share = forces.missing_share
    standing = _any_active(forces, [point for point in forces.points if point.link and point.object is None])
    for first, last in _stretches(share > MAX_MISSING_SHARE, motion.fps):
        frame = first + int(share[first : last + 1].argmax())
        where = "its soles and hands cannot give them" if standing[frame] else "nothing of it is on the floor"
        text = f"the robot lacks {_wrench(forces.missing[frame])}, {100 * share[frame]:.0f} % of its weight: {where}"
        yield Infeasibility("balance", first, last, float(share[frame]), f"{text} (worst in frame {frame})")


def _at_objects(forces: Forces, motion: Motion) -> Iterator[Infeasibility]:
    for index in range(len(forces.bodies)):
        share = forces.missing_share_at_objects[:, index]
        one_hand = _one_hand(forces, motion, index)
        touching = _any_active(forces, [point for point in forces.points if point.link and point.object == index])
        for first, last in _stretches(_unheld(forces, index), motion.fps):
            frame = first + int(np.nanargmax(share[first : last + 1]))
            names = [motion.contact_links[column] for column in np.flatnonzero(motion.labelled(index)[frame])]
            who = f"{' and '.join(names)}{' alone' if one_hand[frame] else ''} cannot move"
            if not touching[frame]:
                who = f"{' and '.join(names)} {'is' if len(names) == 1 else 'are'} too far off to hold"
            text = f"{who} {_name(forces, index)} so: {_wrench(forces.missing_at_objects[frame, index])} are missing"
            kind = "one hand" if one_hand[frame] else "object"
            yield Infeasibility(kind, first, last, float(share[frame]), f"{text} (worst in frame {frame})")


def _torques(forces: Forces, motion: Motion) -> Iterator[Infeasibility]:
    over = over_torque(forces)
    for joint, name in enumerate(motion.joint_names):
        shares = forces.torque_shares[:, joint]
        for first, last in _stretches(over[:, joint], motion.fps):
            frame = first + int(shares[first : last + 1].argmax())
            needed, limit = abs(float(forces.unlimited_torques[frame, joint])), float(forces.limits[joint])
            judged = np.flatnonzero(np.isfinite(forces.missing_at_objects[frame, :, 0]))
            why = f" with {', '.join(_name(forces, index) for index in judged)}" if len(judged) else ""
            text = f"{name} would need {needed:.1f} N m{why}, {needed - limit:.1f} more than it has"
            yield Infeasibility("torque", first, last, float(shares[frame]), f"{text} (worst in frame {frame})")


def _one_hand(forces: Forces, motion: Motion, index: int) -> Bool[np.ndarray, "T"]:
    """Return where one link alone is labelled to touch an object that is off the floor."""
    on_floor = _any_active(forces, [point for point in forces.points if not point.link and point.object == index])
    return (motion.labelled(index).sum(axis=1) == 1) & ~on_floor


def _any_active(forces: Forces, points: Sequence[ContactPoint]) -> Bool[np.ndarray, "T"]:
    return np.logical_or.reduce([np.zeros(len(forces.missing), dtype=bool), *(point.active for point in points)])


def _unheld(forces: Forces, index: int) -> Bool[np.ndarray, "T"]:
    """Return whether a judged object lacks too much; comparisons with NaN are false."""
    return forces.missing_share_at_objects[:, index] > MAX_MISSING_SHARE


def _stretches(active: Bool[np.ndarray, "T"], fps: float) -> list[tuple[int, int]]:
    """Return the stretches of active frames that last, as first and last frame."""
    frames = seconds_to_frames(_MIN_STRETCH_S, fps)
    return [(first, stop - 1) for first, stop in runs(closed_and_opened(active, gap=frames, shortest=frames), frames)]


def _name(forces: Forces, index: int | np.intp) -> str:
    body = forces.bodies[index]
    return f"the {body.name} of {body.mass:.1f} kg"


def _wrench(wrench: Float[np.ndarray, "6"]) -> str:
    return f"{np.linalg.norm(wrench[:3]):.0f} N and {np.linalg.norm(wrench[3:]):.1f} N m"
