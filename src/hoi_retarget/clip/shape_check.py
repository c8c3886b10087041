"""A check of objects' shapes by the contacts of their source: hands that touch are at the surface.

Where they are not, another unit, another axis or another origin of the shape may bring them there: most mistakes with
shapes from elsewhere. In 38 recordings labelled hands are at most 7 cm off the surface, half of the time.
"""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.clip import Clip, Severity
from hoi_retarget.clip.read_options import Grasps
from hoi_retarget.errors import ClipError, GeometryError
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import evenly_spaced
from hoi_retarget.objects.mesh import Surface, surface_of
from hoi_retarget.objects.track import ObjectTrack

_HANDS = ("left_hand", "right_hand")
_MAX_FRAMES = 60  # Of a contact, evenly over it.
_MAX_OFF_M = 0.12
"""Of a hand that touches from the surface, median: the joint of a hand is 2 to 7 cm from the touched surface."""
_MAX_BETTER_M = 0.08  # Another reading of the shape that leaves no more is believed.
_UNITS = {"millimetres": 0.001, "centimetres": 0.01, "inches": 0.0254}
_QUARTER_TURNS = {
    "its y axis for z": (90.0, 0.0, 0.0),
    "its negative y axis for z": (-90.0, 0.0, 0.0),
    "its x axis for z": (0.0, -90.0, 0.0),
    "its negative x axis for z": (0.0, 90.0, 0.0),
}
"""By the axis of the shape that is up where z should be [degrees]."""
_OF_MEANS, _MAX_OFF_CENTRE_M = ("intermimic-591",), 0.08
"""Formats whose objects have their vertices' mean as origin; in simplified meshes it moves by some centimetres."""
_MAX_DEPTH_M = 0.06  # Of an object in the floor; of 60 recorded ones 17 mm.
_ROUNDS = 20  # Of moving the shape to the hands.
_MIN_WINDING, _MIN_OPEN_WINDING = 0.95, 0.1
"""Behind a closed surface it winds around once; behind one sheet of a double one not at all."""
_SAMPLES, _BESIDE_M = 300, 1e-3  # Points, just before and behind the surface.


def with_shape_warnings(clip: Clip, grasps: Grasps) -> Clip:
    """Return a clip with warnings of shapes that its contacts contradict, and notes of open and inverted ones.

    Raises `ClipError` where a shape is in another unit, and `grasps` is `refuse`.
    """
    for index, track in enumerate(clip.objects):
        if not track.geometry.has_surface:
            continue
        try:
            surface = surface_of(track.geometry)
        except GeometryError:  # It is told where the surface is needed.
            continue
        for text in _openness(track.name, surface):
            clip = clip.with_note(text)
        hands = list(_touching_hands(clip, index, track))
        fault, is_unit = _fault(track.name, surface, hands) if hands else ("", False)
        if is_unit and grasps == "refuse":
            raise ClipError(f"{fault} If it is right nonetheless, pass --grasps warn.")
        elsewhere = "" if is_unit or clip.source.format not in _OF_MEANS else _off_centre(track.name, surface)
        if fault := elsewhere or fault:
            severity = Severity.ERROR if grasps == "refuse" else Severity.WARNING
            clip = clip.with_warnings("object_shape", (fault,), severity)
        elif (lowest := float(track.lowest.min())) < -_MAX_DEPTH_M:
            text = f"{track.name} is up to {-lowest:.2f} m in the floor: are its axes and origin those of the poses?"
            clip = clip.with_warnings("object_shape", (text,))
    return clip


def _off_centre(name: str, surface: Surface) -> str:
    """Return the distance of the mean of a shape's vertices from its origin, in words with advice; empty where none."""
    mean = _mean_vertex(surface)
    if np.linalg.norm(mean) < _MAX_OFF_CENTRE_M:
        return ""
    by = ", ".join(f"{-value:.3f}" for value in mean)
    off = f"{np.linalg.norm(mean):.2f} m from the origin, and the poses are of that mean"
    return f"{name}: the mean of its vertices is {off}: the origin is wrong. Move its vertices by ({by}) m."


@lru_cache(maxsize=6)
def _mean_vertex(surface: Surface) -> Float[np.ndarray, "3"]:
    """Return the mean of different vertices [m]."""
    return np.unique(surface.vertices, axis=0).mean(axis=0)


def _touching_hands(clip: Clip, index: int, track: ObjectTrack) -> Iterator[Float[np.ndarray, "K 3"]]:
    """Yield the places of each hand in the object's frame while it touches [m]."""
    for contact in clip.contacts:
        frames = np.flatnonzero(contact.active)
        if contact.object != index or contact.part not in _HANDS or not len(frames):
            continue
        chosen = frames[evenly_spaced(len(frames), _MAX_FRAMES)]
        places = clip.people[contact.person].part_position(contact.part)[chosen]
        yield se3.rotate_inverse(track.quats[chosen], places - track.positions[chosen])


def _off(surface: Surface, hands: list[np.ndarray]) -> float:
    """Return the median distance from the surface of the hand that is farther from it [m]."""
    return max(float(np.median(surface.distances(places))) for places in hands)


def _fault(name: str, surface: Surface, hands: list[np.ndarray]) -> tuple[str, bool]:
    """Return the fault of a shape with advice, a sentence or two, and whether it is its unit."""
    off, size = _off(surface, hands), surface.size
    if off <= _MAX_OFF_M:
        return "", False
    start = f"{name}: hands that touch it are {off:.2f} m from all of its surface, and it is {size:.3g} m large"
    for words, unit, turn in _other_shapes():
        # Hands are moved the other way in place of the shape.
        back = se3.quat_conjugate(se3.exp(np.radians(turn)))
        if unit * _off(surface, [se3.rotate(back, places) / unit for places in hands]) < _MAX_BETTER_M:
            turns = [f"{angle:g} degrees about {axis}" for axis, angle in zip("xyz", turn, strict=True) if angle]
            advice = f"Turn its vertices by {turns[0]}." if turns else f"Multiply its vertices by {unit:g}."
            return f"{start}: {words}. {advice}", not turns
    moved = _offset(surface, hands)
    if _off(surface, [places - moved for places in hands]) < _MAX_BETTER_M:
        by = ", ".join(f"{value:.2f}" for value in moved)
        return f"{start}: its origin is not that of the poses. Moving its vertices by about ({by}) m would fit.", False
    return f"{start}: its unit, its axes or its origin are not those of the poses. Is it the right shape?", False


def _other_shapes() -> Iterator[tuple[str, float, tuple[float, float, float]]]:
    """Yield other readings of a shape in words, with the factor and the turn [degrees] of its vertices that mend it."""
    for name, metres in _UNITS.items():
        yield f"it is in {name}", metres, (0.0, 0.0, 0.0)
        yield f"it was divided as if it had been in {name}", 1 / metres, (0.0, 0.0, 0.0)
    for words, turn in _QUARTER_TURNS.items():
        yield f"it has {words}", 1.0, turn


def _offset(surface: Surface, hands: list[np.ndarray]) -> Float[np.ndarray, "3"]:
    """Return a move of the surface that brings it to the hands [m], the nearest one that steps of their means find."""
    places, moved = np.concatenate(hands), np.zeros(3)
    for _ in range(_ROUNDS):
        moved = moved + (places - moved - surface.closest_points(places - moved)).mean(axis=0)
    return moved


@lru_cache(maxsize=6)
def _winding_beside(surface: Surface) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K"]]:
    """Return the winding numbers of places just behind a surface and just before it."""
    points, normals = surface.random_points(_SAMPLES)
    distances = np.full(len(points), _BESIDE_M)
    behind, ahead = (surface.winding_numbers(points + side * _BESIDE_M * normals, distances) for side in (-1.0, 1.0))
    return behind, ahead


def _openness(name: str, surface: Surface) -> Iterator[str]:
    """Yield the consequences for touch of a surface with holes, or inside out."""
    if not surface.exact:
        return
    behind, ahead = _winding_beside(surface)
    if not len(behind):
        return
    if np.median(ahead) < -0.5:
        yield f"{name}: its triangles face inwards. Touch is measured alike; programs that shade it show it dark."
    elif np.median(behind) < _MIN_WINDING and np.quantile(behind, 0.95) > _MIN_OPEN_WINDING:
        yield (
            f"{name}: its surface is open. Touch is measured to what is there; hands in the opening count as outside "
            "where less than half of their view is closed."
        )
