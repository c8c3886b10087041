"""Leads: the person stands upright at rest, steps to where the recording begins, and back from where it ends.

They make of a recording that begins in the middle of a stride one that a robot can begin from standing. Feet that
stand in the recording's first frame stand there all the time; another one steps from beside them. The pelvis, the trunk
and the arms go to their first pose, and reach it as fast as they move there. Nothing is touched, no object moves.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.errors import ClipError
from hoi_retarget.human.person import Person, stance
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, PARENT
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectTrack

HANGING = np.radians(75.0)  # Of the arms, from the T-pose.
STRAIGHT = 0.985  # Of a leg's length from hip to ankle, while the person stands.
LIFT = 0.06  # [m]; of a foot that steps.
AHEAD = 0.04  # [m] of the pelvis before the ankles: the middle of the soles.
STEPPING = 0.4  # Part of the lead after which a foot steps.
MATCHING_S = 0.4  # Time in which the recording's first velocity is reached.
LARGEST_SPEED = 0.05  # [m/s]; of an object that is said to rest.
HELD_HEIGHT = 0.05  # [m] of the lowest point of an object that is held where it is touched.

_PARENTS = [JOINT_INDEX[PARENT[joint] or joint] for joint in JOINTS]  # The pelvis has itself.
_ANKLES = tuple(JOINT_INDEX[f"{side}_ankle"] for side in ("left", "right"))


def with_leads(clip: Clip, before: float, after: float) -> Clip:
    """Return a clip with a lead before it and one after it, of so many seconds each.

    Raises `ClipError` where an object moves, or is held in the air, in the frame where a lead would meet it.
    """
    for seconds, name in ((before, "--lead-in"), (after, "--lead-out")):
        frames = round(seconds * clip.fps)
        if frames:
            backwards = name == "--lead-out"
            turned = _reversed(clip) if backwards else clip
            _check_rest(turned, f"{name} {seconds:g}", "last" if backwards else "first")
            led = _led_in(turned, frames)
            clip = _reversed(led) if backwards else led
            where = "last" if backwards else "first"
            clip = clip.with_note(
                f"The {where} {frames} frames are made up ({name}): from standing at rest, untouched."
            )
    return clip


def _check_rest(clip: Clip, option: str, frame: str) -> None:
    touched = {track.object for track in clip.contacts if track.active[0]}
    for index, track in enumerate(clip.objects):
        speed = float(np.linalg.norm(track.positions[1] - track.positions[0]) * clip.fps)
        if speed > LARGEST_SPEED or (index in touched and track.lowest[0] > HELD_HEIGHT):
            how = f"moves at {speed:.2f} m/s" if speed > LARGEST_SPEED else "is held in the air"
            raise ClipError(
                f"clip {clip.name!r}: the {track.name} {how} in its {frame} frame, so nobody can stand at rest beside "
                f"it. Leave {option} out, or cut the recording where the object rests."
            )


def _reversed(clip: Clip) -> Clip:
    """Return a clip with its frames from the last to the first."""

    def contact(track: ContactTrack) -> ContactTrack:
        return replace(track, active=track.active[::-1], contact_points=track.contact_points[::-1])

    return replace(
        clip,
        people=tuple(
            replace(one, joint_positions=one.joint_positions[::-1], joint_quats=one.joint_quats[::-1])
            for one in clip.people
        ),
        objects=tuple(replace(one, positions=one.positions[::-1], quats=one.quats[::-1]) for one in clip.objects),
        contacts=tuple(map(contact, clip.contacts)),
        pins=tuple(replace(pin, frame=clip.frames - 1 - pin.frame) for pin in clip.pins),
    )


def _led_in(clip: Clip, frames: int) -> Clip:
    """Return a clip with frames before its first one."""

    def resting(track: ObjectTrack) -> ObjectTrack:
        positions, quats = (
            np.concatenate([values[:1].repeat(frames, axis=0), values]) for values in (track.positions, track.quats)
        )
        return replace(track, positions=positions, quats=quats)

    def later(track: ContactTrack) -> ContactTrack:
        active = np.concatenate([np.zeros(frames, dtype=bool), track.active])
        points = np.concatenate([np.full((frames, 3), np.nan), track.contact_points])
        return replace(track, active=active, contact_points=points)

    return replace(
        clip,
        people=tuple(_person_led_in(person, clip.fps, frames) for person in clip.people),
        objects=tuple(map(resting, clip.objects)),
        contacts=tuple(map(later, clip.contacts)),
        pins=tuple(replace(pin, frame=pin.frame + frames) for pin in clip.pins),
    )


def _smooth(share: Float[np.ndarray, "T"]) -> Float[np.ndarray, "T"]:
    """Return a step from 0 to 1 with least jerk."""
    share = np.clip(share, 0.0, 1.0)
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def _person_led_in(person: Person, fps: float, frames: int) -> Person:
    """Return a person with frames before its first one."""
    share = np.arange(frames) / frames
    eased, seconds = _smooth(share), (share - 1.0) * frames / fps
    ahead = _smooth(1.0 + seconds / MATCHING_S) * seconds  # The goal is where the first velocity would have been then.
    positions, quats, local = np.empty((frames, len(JOINTS), 3)), np.empty((frames, len(JOINTS), 4)), _local(person)
    offsets = se3.rotate_inverse(person.joint_quats[0, _PARENTS], person.joint_positions[0] - _parents_of(person)[0])
    upright = _upright(person.joint_quats[0, 0])
    feet = _standing_feet(person, fps, upright, offsets)
    turning = se3.log(se3.quat_multiply(se3.quat_conjugate(local[0]), local[1])) * fps
    goal = se3.quat_multiply(local[0], se3.exp(ahead[:, None, None] * turning))
    turned = se3.slerp(_standing(upright, feet, local), goal, eased[:, None])

    def led(joint: int, start: np.ndarray, step: np.ndarray) -> Float[np.ndarray, "T 3"]:
        place, then = person.joint_positions[:2, joint]
        return start + step[:, None] * (place + ahead[:, None] * (then - place) * fps - start)

    ankles: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    for joint, foot in feet.items():
        swing = np.clip((share - STEPPING) / (1.0 - STEPPING), 0.0, 1.0)
        path = led(joint, foot.position, _smooth(swing)) if foot.steps else np.tile(foot.position, (frames, 1))
        far = float(np.linalg.norm(person.joint_positions[0, joint] - foot.position))
        path[:, 2] = np.maximum(path[:, 2], foot.position[2]) + foot.steps * min(LIFT, far) * np.sin(np.pi * swing) ** 2
        ankles[joint] = path, se3.slerp(foot.quat, person.joint_quats[0, joint], _smooth(swing))
    quats[:, 0], positions[:, 0] = turned[:, 0], led(0, _pelvis_over(feet, upright, offsets), eased)
    _lower_to_reach(positions[:, 0], quats[:, 0], ankles, offsets)
    for joint in range(1, len(JOINTS)):
        above = _PARENTS[joint]
        quats[:, joint] = se3.quat_multiply(quats[:, above], turned[:, joint])
        positions[:, joint] = positions[:, above] + se3.rotate(quats[:, above], offsets[joint])
        if joint in ankles:
            forward = se3.rotate(upright, np.array([0.0, 0.0, 1.0]))
            pole = forward + eased[:, None] * (_knee_side(person.joint_positions[0], joint, forward) - forward)
            _bend_leg(joint, positions, quats, turned=turned, offsets=offsets, goal=ankles[joint][0], pole=pole)
            quats[:, joint] = ankles[joint][1]
    return replace(
        person,
        joint_positions=np.concatenate([positions, person.joint_positions]),
        joint_quats=np.concatenate([quats, person.joint_quats]),
        stature=person.height,
    )


@dataclass(frozen=True, eq=False)
class _StandingFoot:
    """Where a foot stands at the begin of a lead."""

    position: Float[np.ndarray, "3"]  # Of the ankle.
    quat: Float[np.ndarray, "4"]
    steps: bool  # Whether it is elsewhere in the recording's first frame.
    frame: int  # A frame in which it stands in the recording.


def _parents_of(person: Person) -> Float[np.ndarray, "T 52 3"]:
    places = person.joint_positions[:, _PARENTS]
    places[:, 0] = 0.0
    return places


def _local(person: Person) -> Float[np.ndarray, "T 52 4"]:
    """Return the joints' rotations in their parents; the pelvis's own."""
    above = person.joint_quats[:, _PARENTS]
    above[:, 0] = se3.IDENTITY_QUAT
    return se3.quat_multiply(se3.quat_conjugate(above), person.joint_quats)


def _upright(pelvis: Float[np.ndarray, "4"]) -> Float[np.ndarray, "4"]:
    """Return the rotation of a pelvis that stands upright and looks where another one does."""
    forward, left = se3.rotate(pelvis, np.array([0.0, 0.0, 1.0])), se3.rotate(pelvis, np.array([1.0, 0.0, 0.0]))
    # Who bends down far looks at the floor: the way to the left tells then.
    forward = forward + np.cross(left, [0.0, 0.0, 1.0])
    yaw = np.arctan2(forward[1], forward[0])
    return se3.matrix_to_quat(
        np.array([[-np.sin(yaw), 0.0, np.cos(yaw)], [np.cos(yaw), 0.0, np.sin(yaw)], [0.0, 1.0, 0.0]])
    )


def _standing_feet(
    person: Person, fps: float, upright: Float[np.ndarray, "4"], offsets: Float[np.ndarray, "52 3"]
) -> dict[int, _StandingFoot]:
    """Return both feet by the index of their ankles."""
    stands = stance(person, fps)
    planted = [joint for joint, flags in zip(_ANKLES, stands.T, strict=True) if flags[0]]
    around = person.joint_positions[0, planted or [0]].mean(axis=0)
    hips = {ankle: se3.rotate(upright, offsets[_PARENTS[_PARENTS[ankle]]]) for ankle in _ANKLES}
    feet: dict[int, _StandingFoot] = {}
    for ankle, flags in zip(_ANKLES, stands.T, strict=True):
        frame = int(flags.argmax()) if flags.any() else int(person.joint_positions[:, ankle, 2].argmin())
        place, quat = person.joint_positions[frame, ankle].copy(), person.joint_quats[frame, ankle]
        if not flags.any():  # It never stands: as in the T-pose, as high as the lowest ankle.
            place[2], quat = person.joint_positions[:, _ANKLES, 2].min(), upright
        if ankle not in planted:
            # Beside the foot that stands, or where the pelvis is, as far apart as the hips are.
            beside = hips[ankle] - (hips[planted[0]] if planted else 0.0)
            place[:2] = around[:2] + beside[:2]
            quat = se3.quat_multiply(se3.quat_multiply(upright, se3.quat_conjugate(_upright(quat))), quat)
        feet[ankle] = _StandingFoot(place, quat, ankle not in planted, frame)
    return feet


def _standing(
    upright: Float[np.ndarray, "4"], feet: dict[int, _StandingFoot], local: Float[np.ndarray, "T 52 4"]
) -> Float[np.ndarray, "52 4"]:
    """Return the joints' rotations in their parents while the person stands, arms hanging."""
    standing = np.tile(se3.IDENTITY_QUAT, (len(JOINTS), 1))
    standing[0] = upright
    for side, sign in (("left", -1.0), ("right", 1.0)):
        standing[JOINT_INDEX[f"{side}_shoulder"]] = se3.exp(np.array([0.0, 0.0, sign * HANGING]))
        toe = JOINT_INDEX[f"{side}_foot"]
        standing[toe] = local[feet[_PARENTS[toe]].frame, toe]
    return standing


def _leg(ankle: int, offsets: Float[np.ndarray, "52 3"]) -> tuple[float, float]:
    """Return the lengths of thigh and shin [m]."""
    return float(np.linalg.norm(offsets[_PARENTS[ankle]])), float(np.linalg.norm(offsets[ankle]))


def _pelvis_over(
    feet: dict[int, _StandingFoot], upright: Float[np.ndarray, "4"], offsets: Float[np.ndarray, "52 3"]
) -> Float[np.ndarray, "3"]:
    """Return the place of a pelvis over both feet, as high as legs that are almost straight allow."""
    hips = {ankle: se3.rotate(upright, offsets[_PARENTS[_PARENTS[ankle]]]) for ankle in feet}
    place = np.mean([foot.position - hips[ankle] for ankle, foot in feet.items()], axis=0)
    place += AHEAD * se3.rotate(upright, np.array([0.0, 0.0, 1.0]))
    heights = []
    for ankle, foot in feet.items():
        reach = STRAIGHT * sum(_leg(ankle, offsets))
        across = float(np.linalg.norm((place + hips[ankle] - foot.position)[:2]))
        heights.append(foot.position[2] - hips[ankle][2] + np.sqrt(max(reach**2 - across**2, 0.0)))
    return np.array([place[0], place[1], min(heights)])


def _lower_to_reach(
    pelvis: Float[np.ndarray, "T 3"],
    quats: Float[np.ndarray, "T 4"],
    ankles: dict[int, tuple[np.ndarray, np.ndarray]],
    offsets: Float[np.ndarray, "52 3"],
) -> None:
    """Lower a pelvis in place where a leg would not reach its ankle."""
    for ankle, (place, _) in ankles.items():
        hip = se3.rotate(quats, offsets[_PARENTS[_PARENTS[ankle]]])
        across = np.linalg.norm((pelvis + hip - place)[:, :2], axis=1)
        reach = np.sqrt(np.maximum(sum(_leg(ankle, offsets)) ** 2 - across**2, 0.0))
        pelvis[:, 2] = np.minimum(pelvis[:, 2], place[:, 2] - hip[:, 2] + reach)


def _knee_side(
    places: Float[np.ndarray, "52 3"], ankle: int, forward: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"]:
    """Return the way in which a knee is off the line from hip to ankle; forwards where it is straight."""
    knee = _PARENTS[ankle]
    hip = _PARENTS[knee]
    line = (places[ankle] - places[hip]) / np.linalg.norm(places[ankle] - places[hip])
    off = places[knee] - places[hip]
    off = off - (off @ line) * line
    return off / np.linalg.norm(off) if np.linalg.norm(off) > 0.01 else forward


def _bend_leg(  # noqa: PLR0913 - the arrays of one pose, changed in place
    ankle: int,
    positions: Float[np.ndarray, "T 52 3"],
    quats: Float[np.ndarray, "T 52 4"],
    *,
    turned: Float[np.ndarray, "T 52 4"],
    offsets: Float[np.ndarray, "52 3"],
    goal: Float[np.ndarray, "T 3"],
    pole: Float[np.ndarray, "T 3"],
) -> None:
    """Put an ankle at its goal in place, the knee bent towards a pole.

    Args:
        ankle: index of the joint.
        positions: of all joints in the world [m]; those of the leg change.
        quats: likewise, rotations.
        turned: rotations in the parents.
        offsets: of the joints in their parents [m].
        goal: the ankle's places.
        pole: directions.
    """
    knee = _PARENTS[ankle]
    hip = _PARENTS[knee]
    thigh, shin = _leg(ankle, offsets)
    line = goal - positions[:, hip]
    length = np.clip(np.linalg.norm(line, axis=1), abs(thigh - shin) + 1e-9, thigh + shin)[:, None]
    line /= np.linalg.norm(line, axis=1)[:, None]
    along = (thigh**2 - shin**2 + length**2) / (2.0 * length)
    pole = pole - (pole * line).sum(axis=1)[:, None] * line
    pole /= np.maximum(np.linalg.norm(pole, axis=1)[:, None], 1e-9)
    positions[:, knee] = positions[:, hip] + along * line + np.sqrt(np.maximum(thigh**2 - along**2, 0.0)) * pole
    positions[:, ankle] = positions[:, hip] + length * line
    for joint, end in ((hip, knee), (knee, ankle)):
        if joint == knee:
            quats[:, knee] = se3.quat_multiply(quats[:, hip], turned[:, knee])
        quats[:, joint] = _pointing(quats[:, joint], offsets[end], positions[:, end] - positions[:, joint])


def _pointing(
    quats: Float[np.ndarray, "T 4"], offset: Float[np.ndarray, "3"], way: Float[np.ndarray, "T 3"]
) -> Float[np.ndarray, "T 4"]:
    """Return rotations turned no more than needed for a bone to go a given way."""
    bone = se3.rotate(quats, offset)
    axis = np.cross(bone, way)
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.arctan2(sine, (bone * way).sum(axis=1, keepdims=True))
    return se3.quat_multiply(se3.exp(axis / np.maximum(sine, 1e-12) * angle), quats)
