"""More clips of one recording: its mirror image, and the same at another speed.

Contacts keep their points on the object and their parts, or get the other side's in a mirror. The changes stand in the
clip's source, so that results name their parent and `readers.open.clip_of` finds their clip again. Other sizes of the
object need no other clip: `targets.Scaling.size_multiplier` makes them.
"""

from dataclasses import replace

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float

from hoi_retarget.clip.clip import MINIMUM_FRAMES, Augmentation, Clip, ContactTrack, PosePin
from hoi_retarget.errors import ClipError
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.object_joint import mirrored_joint
from hoi_retarget.objects.track import ObjectGeometry

_MIRROR = np.array([1.0, -1.0, 1.0])  # The plane y = 0, of the world and of an object's frame.
# A joint's left is its x axis: its frame is mirrored at x = 0 where the world is at y = 0, which leaves half a turn.
_HALF_TURN = np.array([0.0, 0.0, 0.0, 1.0])
_END = 1e-6  # Of a frame: the last one counts, rounded.
_SIDES = {"left": "right", "right": "left"}


def augment(clip: Clip, augmentation: Augmentation) -> Clip:
    """Return the clip at another speed, mirrored, or both; raises the errors of `at_speed` and `mirrored`."""
    clip = at_speed(clip, augmentation.speed)
    return mirrored(clip) if augmentation.mirrored else clip


def mirrored(clip: Clip) -> Clip:
    """Return the clip as seen in a mirror at the world's plane y = 0: left parts move as right ones did.

    Objects are mirrored at the plane y = 0 of their own frames, too, so that their poses are rotations. Where an
    object's mesh is known, its mirror image is in `points` and `faces`, with no file; else its points are mirrored.
    Raises `GeometryError` where a mesh file is missing or damaged.
    """
    augmentation = replace(clip.source.augmentation, mirrored=not clip.source.augmentation.mirrored)
    seen = replace(
        clip,
        people=tuple(map(_mirrored_person, clip.people)),
        objects=tuple(
            replace(
                track,
                positions=track.positions * _MIRROR,
                quats=se3.quat_mirrored(track.quats),
                geometry=_mirrored_geometry(track.geometry),
                joint=None if track.joint is None else mirrored_joint(track.joint),
            )
            for track in clip.objects
        ),
        contacts=tuple(map(_mirrored_contact, clip.contacts)),
        recorded_contacts=tuple(map(_mirrored_contact, clip.recorded_contacts)),
        pins=tuple(map(_mirrored_pin, clip.pins)),
        source=replace(clip.source, augmentation=augmentation),
    )
    return seen.with_note("Mirrored at the plane y = 0, left for right; objects are mirror images of those recorded.")


def at_speed(clip: Clip, speed: float) -> Clip:
    """Return the clip at a multiple of its speed and the same rate; a speed of 1 is the clip itself.

    The first and the last frame stay, so the speed is met up to half a frame in the whole clip. Positions and
    rotations follow splines of third degree; a contact holds in the frames nearest to those in which it did. Raises
    `ArgumentError` unless the speed is positive, and `ClipError` where fewer than four frames are left.
    """
    done = Augmentation(clip.source.augmentation.mirrored, clip.source.augmentation.speed * speed)
    if speed == 1.0:
        return clip
    frames = round((clip.frames - 1) / speed) + 1
    if frames < MINIMUM_FRAMES:
        raise ClipError(
            f"clip {clip.name!r}: at {speed:g} times its speed, {frames} of {clip.frames} frames are left; at least "
            f"{MINIMUM_FRAMES} are needed. Use a lower speed."
        )
    times = np.linspace(0.0, clip.frames - 1, frames)
    faster = replace(resampled(clip, times, clip.fps), source=replace(clip.source, augmentation=done))
    return faster.with_note(f"Played at {speed:g} times the speed.")


def at_rate(clip: Clip, fps: float | None) -> Clip:
    """Return the clip at a rate of frames [Hz], from its first frame on; None keeps its own.

    Raises `ClipError` where fewer than four frames are left.
    """
    if fps is None or fps == clip.fps:
        return clip
    times = np.arange(0.0, clip.frames - 1 + _END, clip.fps / fps)
    if len(times) < MINIMUM_FRAMES:
        raise ClipError(
            f"clip {clip.name!r}: at {fps:g} frames a second, {len(times)} of {clip.frames} frames are left; at least "
            f"{MINIMUM_FRAMES} are needed. Use a higher rate."
        )
    note = f"Resampled from {clip.fps:.4g} to {fps:.4g} frames a second."
    return resampled(clip, np.minimum(times, clip.frames - 1), fps).with_note(note)


def resampled(clip: Clip, times: Float[np.ndarray, "T"], fps: float) -> Clip:
    """Return the clip at other times, counted in its frames, as frames of this rate; pins go to the nearest frames."""
    people, objects = [], []
    for person in clip.people:
        positions, quats = _resampled(person.joint_positions, times), _resampled_quats(person.joint_quats, times)
        people.append(replace(person, joint_positions=positions, joint_quats=quats))
    for track in clip.objects:
        positions, quats = _resampled(track.positions, times), _resampled_quats(track.quats, times)
        objects.append(replace(track, positions=positions, quats=quats))
    pins = [replace(pin, frame=int(np.abs(times - pin.frame).argmin())) for pin in clip.pins]
    return replace(
        clip,
        fps=fps,
        people=tuple(people),
        objects=tuple(objects),
        contacts=tuple(_resampled_contact(track, times) for track in clip.contacts),
        recorded_contacts=tuple(_resampled_contact(track, times) for track in clip.recorded_contacts),
        pins=tuple({pin.key: pin for pin in pins}.values()),  # Of several in one frame, the last.
    )


def describe(augmentation: Augmentation) -> tuple[str, ...]:
    """Return the changes of a recording, a few words for each."""
    speed = () if augmentation.speed == 1.0 else (f"speed {augmentation.speed:g}",)
    return (*speed, "mirrored") if augmentation.mirrored else speed


def _other_side(name: str) -> str:
    side, _, rest = name.partition("_")
    return f"{_SIDES[side]}_{rest}" if side in _SIDES else name


_OTHER_SIDE = [JOINT_INDEX[_other_side(joint)] for joint in JOINTS]


def _mirrored_person(person: Person) -> Person:
    quats = se3.quat_multiply(se3.quat_mirrored(person.joint_quats), _HALF_TURN)
    return replace(
        person,
        joint_positions=person.joint_positions[:, _OTHER_SIDE] * _MIRROR,
        joint_quats=quats[:, _OTHER_SIDE],
        shape=None,  # No body model has the mirror image of its betas; contacts were found before.
    )


def _mirrored_geometry(geometry: ObjectGeometry) -> ObjectGeometry:
    if not geometry.has_surface:
        return ObjectGeometry(geometry.points * _MIRROR)
    surface = surface_of(geometry)
    # Corners the other way round, so that triangles still face outwards.
    return ObjectGeometry(surface.vertices * _MIRROR, faces=surface.faces[:, ::-1])


def _mirrored_contact(track: ContactTrack) -> ContactTrack:
    turn = (-track.turn[0], track.turn[1], -track.turn[2])
    return replace(track, part=_other_side(track.part), contact_points=track.contact_points * _MIRROR, turn=turn)


def _mirrored_pin(pin: PosePin) -> PosePin:
    x, y, z = pin.position
    turn = None if pin.turn is None else (-pin.turn[0], pin.turn[1], -pin.turn[2])
    return replace(pin, part=_other_side(pin.part), position=(x, -y, z), turn=turn)


def _resampled_contact(track: ContactTrack, times: Float[np.ndarray, "T"]) -> ContactTrack:
    active, points = np.zeros(len(times), dtype=bool), np.full((len(times), 3), np.nan)
    for first, stop in track.segments:
        frames = np.flatnonzero((times >= first - 0.5) & (times < stop - 0.5))
        if not len(frames):  # No contact is lost, however short it gets.
            frames = np.array([np.argmin(np.abs(times - 0.5 * (first + stop - 1)))])
        inside = np.clip(times[frames], first, stop - 1) - first
        active[frames], points[frames] = True, _resampled(track.contact_points[first:stop], inside)
    return replace(track, active=active, contact_points=points)


def _resampled(values: Float[np.ndarray, "F *rest"], times: Float[np.ndarray, "T"]) -> Float[np.ndarray, "T *rest"]:
    """Return values at fractional frames: on a spline of third degree, or less where they are few."""
    return np.asarray(
        scipy.interpolate.make_interp_spline(np.arange(len(values)), values, k=min(3, len(values) - 1))(times)
    )


def _resampled_quats(
    quats: Float[np.ndarray, "F *rest 4"], times: Float[np.ndarray, "T"]
) -> Float[np.ndarray, "T *rest 4"]:
    # From frame to frame rotations are small: their components' spline stays near the sphere.
    return se3.quat_normalize(_resampled(se3.quat_continuous(quats), times))
