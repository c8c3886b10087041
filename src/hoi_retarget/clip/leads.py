"""Leads: the person stands upright at rest, steps to where the recording begins, and back from where it ends.

They make of a recording that begins in the middle of a stride one that a robot can begin from standing. Feet that
stand in the recording's first frame stand there all the time; another one steps from beside them. The pelvis, the trunk
and the arms go to their first pose, and reach it as fast as they move there. Nothing is touched, no object moves.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.supports import supports
from hoi_retarget.errors import ClipError
from hoi_retarget.human.leg_reach import ANKLES, PARENTS, bend_leg, knee_side, leg_lengths, lower_to_reach
from hoi_retarget.human.person import Person, stance
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import least_jerk_step

HANGING = np.radians(75.0)  # Of the arms, from the T-pose.
STRAIGHT = 0.985  # Of a leg's length from hip to ankle, while the person stands.
LIFT = 0.06  # [m]; of a foot that steps.
AHEAD = 0.04  # [m] of the pelvis before the ankles: the middle of the soles.
STEPPING = 0.4  # Part of the lead after which a foot steps.
MATCHING_S = 0.4  # Time in which the recording's first velocity is reached.
LARGEST_SPEED = 0.05  # [m/s]; of an object that is said to rest.
HELD_HEIGHT = 0.05  # [m] of the lowest point of an object that is held where it is touched.


def with_leads(clip: Clip, before: float, after: float) -> Clip:
    """Return a clip with a lead before it and one after it, of so many seconds each.

    Raises `ClipError` where an object moves, or is held in the air, in the frame where a lead would meet it.
    """
    for seconds, option, where in ((before, "--lead-in", "first"), (after, "--lead-out", "last")):
        if frames := round(seconds * clip.fps):
            _check_rest(clip if where == "first" else _reversed(clip), f"{option} {seconds:g}", where)
            clip = _led_in(clip, frames) if where == "first" else _reversed(_led_in(_reversed(clip), frames))
            clip = clip.with_note(f"The {where} {frames} frames are made up ({option}): between standing and the clip.")
    return clip


def _check_rest(clip: Clip, option: str, frame: str) -> None:
    # What lies on another object, or hangs on one, is not held.
    carried = supports(clip.objects, clip.fps).carriers[0] >= 0 if clip.objects else ()
    held = {track.object for track in clip.contacts if track.active[0] and not carried[track.object]}
    for index, track in enumerate(clip.objects):
        speed = float(np.linalg.norm(track.positions[1] - track.positions[0]) * clip.fps)
        if speed > LARGEST_SPEED or (index in held and not track.joint and track.lowest[0] > HELD_HEIGHT):
            how = f"moves at {speed:.2f} m/s" if speed > LARGEST_SPEED else "is held in the air"
            raise ClipError(
                f"clip {clip.name!r}: the {track.name} {how} in its {frame} frame, so nobody can stand at rest beside "
                f"it. Leave {option} out, or cut the recording where the object rests."
            )


def _reversed(clip: Clip) -> Clip:
    """Return a clip with its frames from the last to the first."""
    people = [
        replace(one, joint_positions=one.joint_positions[::-1], joint_quats=one.joint_quats[::-1])
        for one in clip.people
    ]
    objects = [replace(one, positions=one.positions[::-1], quats=one.quats[::-1]) for one in clip.objects]
    contacts = [replace(one, active=one.active[::-1], contact_points=one.contact_points[::-1]) for one in clip.contacts]
    return replace(clip, people=tuple(people), objects=tuple(objects), contacts=tuple(contacts))


def _led_in(clip: Clip, frames: int) -> Clip:
    """Return a clip with frames before its first one."""
    before = ((frames, 0), (0, 0))
    objects = [
        replace(one, positions=np.pad(one.positions, before, "edge"), quats=np.pad(one.quats, before, "edge"))
        for one in clip.objects
    ]
    contacts = [
        replace(
            one,
            active=np.pad(one.active, (frames, 0)),
            contact_points=np.pad(one.contact_points, before, constant_values=np.nan),
        )
        for one in clip.contacts
    ]
    people = tuple(_person_led_in(person, clip.fps, frames) for person in clip.people)
    return replace(clip, people=people, objects=tuple(objects), contacts=tuple(contacts))


def _person_led_in(person: Person, fps: float, frames: int) -> Person:
    """Return a person with frames before its first one."""
    course = _Course.of(person, fps, frames)
    positions, quats, local = np.empty((frames, len(JOINTS), 3)), np.empty((frames, len(JOINTS), 4)), _local(person)
    first = person.joint_positions[0]
    offsets = se3.rotate_inverse(person.joint_quats[0, PARENTS], first - first[PARENTS])
    upright = _upright(person.joint_quats[0, 0])
    forward = se3.rotate(upright, np.array([0.0, 0.0, 1.0]))
    feet = _standing_feet(person, fps, upright, offsets)
    ankles = {joint: course.ankle(joint, foot) for joint, foot in feet.items()}
    turning = se3.log(se3.quat_multiply(se3.quat_conjugate(local[0]), local[1])) * fps
    goal = se3.quat_multiply(local[0], se3.exp(course.ahead[:, None, None] * turning))
    turned = se3.slerp(_standing(upright, feet, local), goal, course.eased[:, None])
    quats[:, 0] = turned[:, 0]
    positions[:, 0] = course.led(0, _pelvis_over(feet, upright, offsets), course.eased)
    lower_to_reach(positions[:, 0], quats[:, 0], ankles, offsets)
    for joint in range(1, len(JOINTS)):
        above = PARENTS[joint]
        quats[:, joint] = se3.quat_multiply(quats[:, above], turned[:, joint])
        positions[:, joint] = positions[:, above] + se3.rotate(quats[:, above], offsets[joint])
        if joint in ankles:
            pole = forward + course.eased[:, None] * (knee_side(first, joint, forward) - forward)
            bend_leg(joint, positions, quats, turned=turned, offsets=offsets, goal=ankles[joint][0], pole=pole)
            quats[:, joint] = ankles[joint][1]
    return replace(
        person,
        joint_positions=np.concatenate([positions, person.joint_positions]),
        joint_quats=np.concatenate([quats, person.joint_quats]),
        stature=person.height,
    )


@dataclass(frozen=True, eq=False)
class _Course:
    """The shares of a lead that are done in its frames, towards a person's first pose and velocity."""

    person: Person
    fps: float
    share: Float[np.ndarray, "T"]
    eased: Float[np.ndarray, "T"]
    ahead: Float[np.ndarray, "T"]  # [s]; the goal is where the first velocity would have been then.

    @staticmethod
    def of(person: Person, fps: float, frames: int) -> "_Course":
        """Return the course of a lead of so many frames."""
        share = np.arange(frames) / frames
        seconds = (share - 1.0) * frames / fps
        return _Course(
            person, fps, share, least_jerk_step(share), least_jerk_step(1.0 + seconds / MATCHING_S) * seconds
        )

    def led(self, joint: int, start: Float[np.ndarray, "3"], step: Float[np.ndarray, "T"]) -> Float[np.ndarray, "T 3"]:
        """Return a joint's places, from a start on, by a step from 0 to 1."""
        place, then = self.person.joint_positions[:2, joint]
        return start + step[:, None] * (place + self.ahead[:, None] * (then - place) * self.fps - start)

    def ankle(self, joint: int, foot: "_StandingFoot") -> tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 4"]]:
        """Return an ankle's places and rotations."""
        swing = np.clip((self.share - STEPPING) / (1.0 - STEPPING), 0.0, 1.0)
        step = least_jerk_step(swing)
        path = self.led(joint, foot.position, step) if foot.steps else np.tile(foot.position, (len(swing), 1))
        far = float(np.linalg.norm(self.person.joint_positions[0, joint] - foot.position))
        path[:, 2] = np.maximum(path[:, 2], foot.position[2]) + foot.steps * min(LIFT, far) * np.sin(np.pi * swing) ** 2
        return path, se3.slerp(foot.quat, self.person.joint_quats[0, joint], step)


@dataclass(frozen=True, eq=False)
class _StandingFoot:
    """Where a foot stands at the begin of a lead."""

    position: Float[np.ndarray, "3"]  # Of the ankle.
    quat: Float[np.ndarray, "4"]
    steps: bool  # Whether it is elsewhere in the recording's first frame.
    frame: int  # A frame in which it stands in the recording.


def _local(person: Person) -> Float[np.ndarray, "T 52 4"]:
    """Return the joints' rotations in their parents; the pelvis's own."""
    above = person.joint_quats[:, PARENTS]
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
    planted = [joint for joint, flags in zip(ANKLES, stands.T, strict=True) if flags[0]]
    around = person.joint_positions[0, planted or [0]].mean(axis=0)
    hips = {ankle: se3.rotate(upright, offsets[PARENTS[PARENTS[ankle]]]) for ankle in ANKLES}
    feet: dict[int, _StandingFoot] = {}
    for ankle, flags in zip(ANKLES, stands.T, strict=True):
        frame = int(flags.argmax()) if flags.any() else int(person.joint_positions[:, ankle, 2].argmin())
        place, quat = person.joint_positions[frame, ankle].copy(), person.joint_quats[frame, ankle]
        if not flags.any():  # It never stands: as in the T-pose, as high as the lowest ankle.
            place[2], quat = person.joint_positions[:, ANKLES, 2].min(), upright
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
        standing[toe] = local[feet[PARENTS[toe]].frame, toe]
    return standing


def _pelvis_over(
    feet: dict[int, _StandingFoot], upright: Float[np.ndarray, "4"], offsets: Float[np.ndarray, "52 3"]
) -> Float[np.ndarray, "3"]:
    """Return the place of a pelvis over both feet, as high as legs that are almost straight allow."""
    hips = {ankle: se3.rotate(upright, offsets[PARENTS[PARENTS[ankle]]]) for ankle in feet}
    place = np.mean([foot.position - hips[ankle] for ankle, foot in feet.items()], axis=0)
    place += AHEAD * se3.rotate(upright, np.array([0.0, 0.0, 1.0]))
    heights = []
    for ankle, foot in feet.items():
        reach = STRAIGHT * sum(leg_lengths(ankle, offsets))
        across = float(np.linalg.norm((place + hips[ankle] - foot.position)[:2]))
        heights.append(foot.position[2] - hips[ankle][2] + np.sqrt(max(reach**2 - across**2, 0.0)))
    return np.array([place[0], place[1], min(heights)])
