"""Marks in the scene: contacts of robot and human, the robot's distance from each, and standing feet."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from hoi_retarget.clip.clip import ContactTrack
from hoi_retarget.evaluation.object_distances import distances_of_motion
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.report import ELSEWHERE_M
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.spec import SIDES, SOLE_CORNERS
from hoi_retarget.viewers.scene.drawing import Colour, Kind, Lines, Shapes

SMALL_GAP, LARGE_GAP = 0.01, 0.05  # [m]
_GREEN, _YELLOW, _RED = (46, 178, 82), (245, 196, 40), (222, 52, 44)
_LEVELS = 9  # Shapes keep their colour: a ball that changes its own is one of so many.
_TARGET_RADIUS, _SITE_RADIUS = 0.035, 0.012  # [m]
_PATCH = np.array([0.035, 0.035, 0.003])  # Half extents of a round one [m].
_DOWN = -1.0 + 1e-9
_STANCE: Colour = (60, 150, 200)
_STANCE_MARGIN, _STANCE_HALF_HEIGHT = 0.012, 0.006  # [m]


def gap_colour(gap: Float[np.ndarray, "*batch"]) -> UInt8[np.ndarray, "*batch 3"]:
    """Return the colour of a distance [m]: green up to 1 cm, through yellow, to red from 5 cm on."""
    share = (gap - SMALL_GAP) / (LARGE_GAP - SMALL_GAP)
    mixed = [np.interp(share, (0.0, 0.5, 1.0), stops) for stops in zip(_GREEN, _YELLOW, _RED, strict=True)]
    return np.round(np.stack(mixed, axis=-1)).astype(np.uint8)


def contact_marks(
    motion: Motion, kinematics: Kinematics, geometries: Sequence[ObjectGeometry] | None
) -> tuple[Shapes, Shapes, Lines] | tuple[()]:
    """Return, for each active contact, a patch on the object's surface, a ball at the robot's site, and a line.

    The patch is where the surface is nearest to the target, which the line leads to from the site. Where shapes are not
    known, a ball is at the target itself. Where nothing is ever touched, there is nothing.
    """
    active = motion.contact_flags & (motion.contact_object >= 0)
    links = np.flatnonzero(active.any(axis=0))
    if len(links) == 0:
        return ()
    active, touched = active[:, links], np.where(active, motion.contact_object, 0)[:, links]
    frames = np.arange(motion.frames)[:, None]
    points = np.where(active[..., None], motion.contact_points[:, links], 0.0)
    place, turn = motion.object_pos[frames, touched], motion.object_quat[frames, touched]
    sites = np.stack([kinematics.site_position(motion.contact_links[link]) for link in links], axis=1)
    targets = np.where(active[..., None], place + se3.rotate(turn, points), sites)
    gaps = np.linalg.norm(targets - sites, axis=-1)
    if motion.report.touches_with_surfaces and geometries is not None:
        gaps = _skin_gaps(motion, kinematics, geometries, gaps, links)
    if geometries is None:
        aims = _coloured(
            Kind.SPHERE,
            np.full(3, _TARGET_RADIUS),
            targets,
            np.broadcast_to(se3.IDENTITY_QUAT, turn.shape),
            gaps,
            active,
        )
    else:
        scales = motion.object_scale[touched][..., None]
        on_surface, tilts = _patches(points / scales, touched, active, geometries)
        patches = place + se3.rotate(turn, scales * on_surface)
        aims = _coloured(Kind.CYLINDER, _PATCH, patches, se3.quat_multiply(turn, tilts), gaps, active)
    radius = _TARGET_RADIUS if geometries is None else _SITE_RADIUS
    balls = _coloured(
        Kind.SPHERE, np.full(3, radius), sites, np.broadcast_to(se3.IDENTITY_QUAT, turn.shape), gaps, active
    )
    return aims, balls, Lines(targets.astype(np.float32), sites.astype(np.float32), gap_colour(gaps), active)


def _skin_gaps(
    motion: Motion,
    kinematics: Kinematics,
    geometries: Sequence[ObjectGeometry],
    gaps: Float[np.ndarray, "T C"],
    links: Int[np.ndarray, "C"],
) -> Float[np.ndarray, "T C"]:
    """Return how far skins are off surfaces or in them [m]: sites lie under the skin. Elsewhere on an object is far."""
    _, signed = distances_of_motion(motion, kinematics.model, tuple(geometries))
    skin = np.abs(signed[:, links])
    return np.where(np.isfinite(skin) & (gaps <= ELSEWHERE_M), skin, gaps)


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
    """Return a patch on the surface next to each contact of a person; none where nothing is touched."""
    touching = [track for track in contacts if track.active.any()]
    if not touching:
        return ()
    active = np.stack([track.active for track in touching], axis=1)
    points = np.where(active[..., None], np.stack([track.contact_points for track in touching], axis=1), 0.0)
    touched = np.broadcast_to([track.object for track in touching], active.shape)
    on_surface, tilts = _patches(points, touched, active, [track.geometry for track in objects])
    place = np.stack([objects[track.object].positions for track in touching], axis=1)
    turn = np.stack([objects[track.object].quats for track in touching], axis=1)
    patches = place + se3.rotate(turn, on_surface)
    return (_coloured(Kind.CYLINDER, _PATCH, patches, se3.quat_multiply(turn, tilts), np.zeros(active.shape), active),)


def _patches(
    points: Float[np.ndarray, "T C 3"],
    touched: Int[np.ndarray, "T C"],
    active: Bool[np.ndarray, "T C"],
    geometries: Sequence[ObjectGeometry],
) -> tuple[Float[np.ndarray, "T C 3"], Float[np.ndarray, "T C 4"]]:
    """Return the place next to points on the surfaces of the objects they belong to [m], and rotations that lie on it.

    Everything in the objects' frames at captured size; a rotation takes z to the surface's normal.
    """
    places, normals = np.zeros(points.shape), np.tile([0.0, 0.0, 1.0], (*active.shape, 1))
    for index, geometry in enumerate(geometries):
        own = active & (touched == index)
        if own.any():
            surface = surface_of(geometry)
            places[own], normals[own] = surface.closest_points(points[own]), surface.normals(points[own])
    return places, rotations_to(normals)


def rotations_to(normals: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 4"]:
    """Return the shortest rotation that takes z to each unit vector."""
    x, y, z = np.moveaxis(normals, -1, 0)
    # Straight down, half a turn about x.
    down = z < _DOWN
    quats = np.stack([1.0 + z, -y, x, np.zeros_like(z)], axis=-1)
    return se3.quat_normalize(np.where(down[..., None], [0.0, 1.0, 0.0, 0.0], quats))


def _coloured(  # noqa: PLR0913, PLR0917 - what a mark is made of
    kind: Kind,
    size: Float[np.ndarray, "3"],
    places: Float[np.ndarray, "T C 3"],
    quats: Float[np.ndarray, "T C 4"],
    gaps: Float[np.ndarray, "T C"],
    active: Bool[np.ndarray, "T C"],
) -> Shapes:
    """Return a mark for each contact, one of every colour, of which the one of the gap's colour is there."""
    levels = np.linspace(SMALL_GAP, LARGE_GAP, _LEVELS)
    level = np.abs(gaps[..., None] - levels).argmin(axis=-1)
    there = active[..., None] & (level[..., None] == np.arange(_LEVELS))
    used = np.flatnonzero(there.any(axis=(0, 1)))
    count, contacts = len(used), active.shape[1]
    return Shapes(
        kind=kind,
        sizes=np.tile(size.astype(np.float32), (contacts * count, 1)),
        colours=np.tile(gap_colour(levels[used]), (contacts, 1)),
        positions=np.repeat(places, count, axis=1).astype(np.float32),
        quats=np.repeat(quats, count, axis=1).astype(np.float32),
        visible=there[..., used].reshape(len(active), contacts * count),
    )
