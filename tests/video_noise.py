"""Errors of people and objects reconstructed from one camera, planted into a clip whose truth is known.

A camera sees depth badly and hands behind objects not at all: joints and objects tremble, a hand that holds sinks into
the object in one frame and is off it in the next, and the body wanders against the object over the clip. Bones stay
rigid, as they do in reconstructions, and labels of contact stay right.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import HANDS, JOINT_INDEX, JOINTS, LEFT_FINGERS, PARENT, RIGHT_FINGERS
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectTrack

ARM_LEVER, OBJECT_LEVER = 1.3, 0.3
"""[m]; how far a hand moves for a radian of jitter in each joint it hangs from, and a grasp for one of its object."""
_STEPS = 3  # Of an arm towards where its hand should be; each leaves a hundredth of the way.


@dataclass(frozen=True)
class Noise:
    """How wrong a reconstruction is."""

    jitter: float = 0.0
    """Of hands and of what they hold, anew in every frame; standard deviation along each axis [m].

    Half of its square is of the whole body's place or the object's, half of rotations of joints or of the object."""
    alternation: float = 0.0
    """How far hands that touch are moved to and from the object's middle, in turn from frame to frame [m]."""
    drift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """How far the body has wandered by the end, evenly, in the world [m]."""


def reconstructed(clip: Clip, noise: Noise, *, seed: int = 0) -> Clip:
    """Return a clip with the errors of a reconstruction; contact points are where the wrong parts are."""
    rng = np.random.default_rng(seed)
    people = tuple(_person(clip, index, noise, rng) for index in range(len(clip.people)))
    objects = tuple(_trembling(track, noise.jitter, rng) for track in clip.objects)
    contacts = tuple(_measured(track, people, objects) for track in clip.contacts)
    note = f"Errors of a reconstruction were planted: {noise}, seed {seed}."
    source = replace(clip.source, path="", notes=(*clip.source.notes, note))
    return replace(clip, people=people, objects=objects, contacts=contacts, source=source)


def _person(clip: Clip, index: int, noise: Noise, rng: np.random.Generator) -> Person:
    person = clip.people[index]
    positions, quats = person.joint_positions.copy(), person.joint_quats.copy()
    for track in clip.contacts:
        if track.person == index and track.part in HANDS and noise.alternation:
            outward = person.part_position(track.part) - clip.objects[track.object].positions
            outward /= np.linalg.norm(outward, axis=1, keepdims=True)
            turns = noise.alternation * np.where(np.arange(clip.frames) % 2, 1.0, -1.0) * track.active
            _move_hand(positions, quats, track.part, turns[:, None] * outward)
    for joint in JOINTS:
        if noise.jitter and joint not in (*LEFT_FINGERS, *RIGHT_FINGERS):
            tremble = rng.normal(scale=np.sqrt(0.5) * noise.jitter / ARM_LEVER, size=(clip.frames, 3))
            _turn(positions, quats, joint, se3.exp(tremble))
    shift = rng.normal(scale=np.sqrt(0.5) * noise.jitter, size=(clip.frames, 3))
    shift += np.linspace(0.0, 1.0, clip.frames)[:, None] * noise.drift
    return replace(person, joint_positions=positions + shift[:, None], joint_quats=se3.quat_normalize(quats))


def _trembling(track: ObjectTrack, jitter: float, rng: np.random.Generator) -> ObjectTrack:
    share = np.sqrt(0.5) * jitter
    turns = se3.exp(rng.normal(scale=share / OBJECT_LEVER, size=track.positions.shape))
    shift = rng.normal(scale=share, size=track.positions.shape)
    return replace(track, positions=track.positions + shift, quats=se3.quat_multiply(turns, track.quats))


def _measured(track: ContactTrack, people: tuple[Person, ...], objects: tuple[ObjectTrack, ...]) -> ContactTrack:
    place = people[track.person].part_position(track.part)
    return replace(track, contact_points=objects[track.object].to_object(place))


def _move_hand(
    positions: Float[np.ndarray, "T 52 3"],
    quats: Float[np.ndarray, "T 52 4"],
    part: str,
    offsets: Float[np.ndarray, "T 3"],
) -> None:
    """Turn an arm in shoulder and elbow so that its wrist moves by an offset."""
    side = part.removesuffix("_hand")
    shoulder, elbow, wrist = (JOINT_INDEX[f"{side}_{joint}"] for joint in ("shoulder", "elbow", "wrist"))
    goal = positions[:, wrist] + offsets
    for _ in range(_STEPS):
        levers = [positions[:, wrist] - positions[:, joint] for joint in (shoulder, elbow)]
        # Moves of the wrist for turns of both joints, (T, 3, 6); the shortest turns that make the move.
        moves = np.concatenate([-se3.skew(lever) for lever in levers], axis=2)
        squares = moves @ moves.transpose(0, 2, 1) + 1e-4 * np.eye(3)
        force = np.linalg.solve(squares, (goal - positions[:, wrist])[..., None])
        turns = (moves.transpose(0, 2, 1) @ force)[..., 0]
        _turn(positions, quats, f"{side}_shoulder", se3.exp(turns[:, :3]))
        _turn(positions, quats, f"{side}_elbow", se3.exp(turns[:, 3:]))


def _turn(
    positions: Float[np.ndarray, "T 52 3"],
    quats: Float[np.ndarray, "T 52 4"],
    joint: str,
    turns: Float[np.ndarray, "T 4"],
) -> None:
    """Turn a joint, and what hangs from it, in the world's axes."""
    index = JOINT_INDEX[joint]
    below = [JOINT_INDEX[name] for name in JOINTS if joint in _line(name)]
    centre = positions[:, index, None]
    positions[:, below] = centre + se3.rotate(turns[:, None], positions[:, below] - centre)
    quats[:, below] = se3.quat_multiply(turns[:, None], quats[:, below])


def _line(joint: str | None) -> tuple[str, ...]:
    """Return a joint and all that it hangs from."""
    return () if joint is None else (joint, *_line(PARENT[joint]))
