"""What is marked: where robot and human touch, how far off the robot is, and which feet stand."""

import numpy as np
from jaxtyping import Bool, Float, UInt8

from hoi_retarget.clip.clip import ContactTrack
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectTrack
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.spec import SIDES, SOLE_CORNERS
from hoi_retarget.viewers.scene.drawing import Colour, Kind, Lines, Shapes

SMALL_GAP, LARGE_GAP = 0.01, 0.05  # [m]
_GREEN, _YELLOW, _RED = (46, 178, 82), (245, 196, 40), (222, 52, 44)
_LEVELS = 9  # Shapes keep their colour: a ball that changes its own is one of so many.
_TARGET_RADIUS, _SITE_RADIUS = 0.045, 0.035  # [m]
_STANCE: Colour = (60, 150, 200)
_STANCE_MARGIN, _STANCE_HALF_HEIGHT = 0.012, 0.006  # [m]


def gap_colour(gap: Float[np.ndarray, "*batch"]) -> UInt8[np.ndarray, "*batch 3"]:
    """Return the colour of a distance [m]: green up to 1 cm, through yellow, to red from 5 cm on."""
    share = (gap - SMALL_GAP) / (LARGE_GAP - SMALL_GAP)
    mixed = [np.interp(share, (0.0, 0.5, 1.0), stops) for stops in zip(_GREEN, _YELLOW, _RED, strict=True)]
    return np.round(np.stack(mixed, axis=-1)).astype(np.uint8)


def contact_marks(motion: Motion, kinematics: Kinematics) -> tuple[Shapes, Lines] | tuple[()]:
    """Return, for each active contact, balls at the target and at the robot's site, and the line between them.

    Where nothing is ever touched, there is nothing.
    """
    active = motion.contact_flags & (motion.contact_object >= 0)
    links = np.flatnonzero(active.any(axis=0))
    if len(links) == 0:
        return ()
    active = active[:, links]
    sites = np.stack([kinematics.site_position(motion.contact_links[link]) for link in links], axis=1)
    targets = np.where(active[..., None], _world_targets(motion)[:, links], sites)
    gaps = np.linalg.norm(targets - sites, axis=-1)
    lines = Lines(targets.astype(np.float32), sites.astype(np.float32), gap_colour(gaps), active)
    return _balls(targets, sites, gaps, active), lines


def stance_marks(motion: Motion, kinematics: Kinematics) -> Shapes:
    """Return a plate around the sole of each foot, there while the foot is to stand."""
    middles, quats, sizes = [], [], []
    for side in SIDES:
        corners = np.stack([kinematics.site_position(f"{side}_sole_{corner}") for corner in SOLE_CORNERS], axis=1)
        turn = kinematics.site_rotation(f"{side}_foot")
        within = corners @ turn  # In the foot's axes: the same in every frame.
        low, high = within.min(axis=1), within.max(axis=1)
        middle = 0.5 * (low + high)
        middle[:, 2] += _STANCE_HALF_HEIGHT
        middles.append(np.einsum("tij,tj->ti", turn, middle))
        quats.append(se3.matrix_to_quat(turn))
        half = 0.5 * (high - low)[0] + _STANCE_MARGIN
        sizes.append([half[0], half[1], _STANCE_HALF_HEIGHT])
    return Shapes(
        kind=Kind.BOX,
        sizes=np.array(sizes, dtype=np.float32),
        colours=np.array([_STANCE, _STANCE], dtype=np.uint8),
        positions=np.stack(middles, axis=1).astype(np.float32),
        quats=np.stack(quats, axis=1).astype(np.float32),
        visible=motion.stance_flags,
    )


def human_contact_marks(contacts: tuple[ContactTrack, ...], objects: tuple[ObjectTrack, ...]) -> tuple[Shapes, ...]:
    """Return a ball where a person touches an object, for each contact; none where nothing is touched."""
    touching = [track for track in contacts if track.active.any()]
    if not touching:
        return ()
    places = []
    for track in touching:
        place = objects[track.object]
        point = np.where(track.active[:, None], track.contact_points, 0.0)
        places.append(place.positions + se3.rotate(place.quats, point))
    active = np.stack([track.active for track in touching], axis=1)
    green = np.tile(np.array(_GREEN, dtype=np.uint8), (len(touching), 1))
    return (_spheres(np.stack(places, axis=1), _TARGET_RADIUS * np.ones(len(touching)), green, active),)


def _world_targets(motion: Motion) -> Float[np.ndarray, "T C 3"]:
    """Return the points to touch [m], NaN where there is none."""
    frames, which = np.arange(motion.frames)[:, None], np.maximum(motion.contact_object, 0)
    if not motion.object_names:
        return np.full(motion.contact_points.shape, np.nan)
    turned = se3.rotate(motion.object_quat[frames, which], motion.contact_points)
    return motion.object_pos[frames, which] + turned


def _balls(
    targets: Float[np.ndarray, "T C 3"],
    sites: Float[np.ndarray, "T C 3"],
    gaps: Float[np.ndarray, "T C"],
    active: Bool[np.ndarray, "T C"],
) -> Shapes:
    """Return the balls at both ends, one of every colour, of which the one of the gap's colour is there."""
    levels = np.linspace(SMALL_GAP, LARGE_GAP, _LEVELS)
    level = np.abs(gaps[..., None] - levels).argmin(axis=-1)
    there = active[..., None] & (level[..., None] == np.arange(_LEVELS))
    used = np.flatnonzero(there.any(axis=(0, 1)))
    contacts, count = targets.shape[1], len(used)
    there = there[..., used].reshape(len(targets), contacts * count)
    colours = np.tile(gap_colour(levels[used]), (contacts, 1))
    ends = [np.repeat(end, count, axis=1) for end in (targets, sites)]
    return _spheres(
        np.concatenate(ends, axis=1),
        np.repeat([_TARGET_RADIUS, _SITE_RADIUS], contacts * count),
        np.concatenate([colours, colours]),
        np.concatenate([there, there], axis=1),
    )


def _spheres(
    places: Float[np.ndarray, "T N 3"],
    radii: Float[np.ndarray, "N"],
    colours: UInt8[np.ndarray, "N 3"],
    visible: Bool[np.ndarray, "T N"],
) -> Shapes:
    upright = np.broadcast_to(se3.IDENTITY_QUAT.astype(np.float32), (*places.shape[:2], 4))
    sizes = np.repeat(radii[:, None], 3, axis=1).astype(np.float32)
    return Shapes(Kind.SPHERE, sizes, colours, places.astype(np.float32), upright, visible)
