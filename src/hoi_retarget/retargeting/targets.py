"""The targets of one robot for one person of a clip: the only place that scales and grounds.

`make_targets` scales the human to the robot, the object by one of two rules (paper Sec. III-A),
carries the contact points along in the object's frame (Eq. 1), plants standing feet on the floor
by the robot's own soles, and smooths the object's path and rotation.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.clip.clip import PELVIS, Clip
from hoi_retarget.clip.label_contacts import with_finger_contacts
from hoi_retarget.clip.supports import ON_FLOOR, supports
from hoi_retarget.errors import RobotError
from hoi_retarget.human.person import LARGEST_DIFFERENCE, Person, stance
from hoi_retarget.human.rotation_jumps import RotationJump, without_rotation_jumps
from hoi_retarget.human.skeleton import LIMBS, trunk_rotations
from hoi_retarget.motion.motion_report import PinnedPart
from hoi_retarget.numerics import filters, se3
from hoi_retarget.numerics.arrays import frozen, runs
from hoi_retarget.objects.object_joint import depth_first, parents_of, path_of, root_of
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.retargeting.config import ContactKind, Scaling
from hoi_retarget.retargeting.feet import Foot, anchor, anchor_weights, plant, resting_height, resting_tilt
from hoi_retarget.retargeting.mobile_base_path import mobile_base_path
from hoi_retarget.retargeting.site_pins import SitePin, site_pin
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.spec import FINGER_SITES, PALMS, SIDES

# Contact labels switch from frame to frame; hands come and go, and turn, over these times.
CONTACT_RAMP_SECONDS, ROTATION_RAMP_SECONDS = 1 / 30, 2 / 30
MAXIMUM_SINK = 0.005  # [m] of a smoothed object under its own unsmoothed height
MAXIMUM_OFF_CARRIER = 0.001  # [m] of a carried object from its recorded height over the carrier, scaled.
SHARPER_SECONDS = 0.2  # Over which a height that smoothing blurred is left again.
UP = np.array([0.0, 0.0, 1.0])
FEET = tuple(f"{side}_foot" for side in SIDES)


@dataclass(frozen=True, eq=False)
class Targets:
    """Inputs of both optimization stages; T frames, K rows of the IK table, O objects, C contact links."""

    fps: float
    root_scale: float
    human_height: float  # [m]
    site_positions: Float[np.ndarray, "T K 3"]  # World positions for the rows of the robot's IK table [m].
    site_quats: Float[np.ndarray, "T K 4"]
    trunk_rotations: Float[np.ndarray, "T 3 3"]  # Of the person's trunk, as hips and shoulders lie.
    torso_quats: Float[np.ndarray, "T 4"]  # World rotations of the torso, as the person's chest turns, smoothed.
    foot_positions: Float[np.ndarray, "T 2 3"]
    """World positions of the left and right foot's contact site [m]: on the floor in stance."""
    foot_quats: Float[np.ndarray, "T 2 4"]
    anchor_weights: Float[np.ndarray, "T 2"]
    """How much each foot is to keep its place: 1 while it stands, in surface contact."""
    palm_quats: Float[np.ndarray, "T 2 4"]  # World rotations of the left and right palm, as the human's hands turn.
    contact_quats: Float[np.ndarray, "T 2 4"]
    """The palms' world rotations where they touch: with holds, another one than the human's."""
    object_names: tuple[str, ...]
    object_geometry: tuple[ObjectGeometry, ...]  # At captured size.
    object_scale: Float[np.ndarray, "O"]
    object_pos: Float[np.ndarray, "T O 3"]
    object_quat: Float[np.ndarray, "T O 4"]
    contact_links: tuple[str, ...]  # Sites that can touch.
    contact_flags: Bool[np.ndarray, "T C"]
    contact_object: Int[np.ndarray, "T C"]  # Index of the touched object, -1 for none.
    contact_points: Float[np.ndarray, "T C 3"]  # In the frame of the scaled object [m]; NaN where inactive.
    stance_flags: Bool[np.ndarray, "T 2"]
    carried_contact_object: Int[np.ndarray, "T C"]
    """Index of the object each link is at or nearest in time to; 0 where it never touches."""
    carried_contact_points: Float[np.ndarray, "T C 3"]
    """Contact targets, carried on before and after a contact [m]; finite everywhere."""
    part_points: Float[np.ndarray, "T C 3"]
    """The human's parts that the links stand for, in the frame of that object at its scaled size [m]."""
    contact_weights: Float[np.ndarray, "T C"]  # 1 in contact, fading to 0 around it.
    contact_rotation_weights: Float[np.ndarray, "T C"]  # The same for the links' rotations, which need longer.
    limbs: Float[np.ndarray, "T O L 2 3"]
    """The ends of the human's limbs (`LIMBS`) in the frames of the objects at their scaled size [m]."""
    rotation_jumps: tuple[RotationJump, ...] = ()  # Of the recording; the targets do without them.
    base_qpos: Float[np.ndarray, "T 7"] | None = None
    """Position [m] and rotation of the root of a robot whose upper body alone follows; None where legs carry it."""
    pins: tuple[SitePin, ...] = ()  # One for each site that is pinned by hand.
    unpinned: "Targets | None" = None  # The same of the whole clip without pins; None where there are none.
    contact: ContactKind = "landmark"
    """What contact asks for; with surfaces feet are anchored, and nothing is to be under the floor."""

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.site_positions)

    def window(self, start: int, stop: int) -> "Targets":
        """Return the targets of some consecutive frames."""
        return self._take(slice(start, stop))

    def every(self, stride: int) -> "Targets":
        """Return the targets of every `stride`-th frame, at the lower rate."""
        return replace(self._take(slice(None, None, stride)), fps=self.fps / stride)

    def _take(self, frames: slice) -> "Targets":
        over_time: dict[str, Any] = {
            field.name: getattr(self, field.name)[frames]
            for field in fields(self)
            if isinstance(getattr(self, field.name), np.ndarray) and field.name != "object_scale"
        }
        if self.pins:
            over_time["pins"] = tuple(pin.take(frames) for pin in self.pins)
        return replace(self, **over_time)


def make_targets(
    clip: Clip, model: RobotModel, scaling: Scaling, *, contact: ContactKind = "surface", person: int = 0
) -> Targets:
    """Return the targets of one robot for one person of a clip.

    Args: `clip`: the recording; `model`: the robot; `scaling`: sizes of human and objects on the robot's side;
    `contact`: with surfaces, feet keep one place for each stance run; otherwise they follow the person's; `person`:
    index of the person.
    """
    human, jumps = without_rotation_jumps(clip.people[person], clip.fps)
    root_scale = _root_scale(clip, model, scaling)
    geometry_scale = _geometry_scale(model, scaling, root_scale)
    stands = stance(human, clip.fps)
    feet = tuple(Foot.of(model, side) for side in SIDES)
    body_scale = root_scale if scaling.body_scale == "root" else scaling.body_scale
    goals = _site_targets(human, model, body_scale, feet, stands)
    # A body of its own size goes where the root scale puts everybody.
    goals.positions[..., :2] += (root_scale - body_scale) * human.position("pelvis")[:, None, :2]
    anchored = contact == "surface"
    goals, foot_positions, foot_quats = _with_planted_feet(goals, feet, stands, clip.fps, anchored=anchored)
    anchors = np.stack([anchored * anchor_weights(flags, clip.fps) for flags in stands.T], axis=1)
    tracks, turns = object_paths(clip, root_scale, geometry_scale, contact)
    contacts = _contact_fields(clip, model, person, geometry_scale, contact)
    base = None
    if model.spec.base != "legs":
        row = goals.row("pelvis")
        working = np.any(contacts["contact_flags"], axis=1)
        base = frozen(mobile_base_path(model, goals.positions[:, row], goals.quats[:, row], working, clip.fps))
        carried = model.forward(np.concatenate([base, np.tile(model.home_qpos[7:], (clip.frames, 1))], axis=1))
        goals.positions[:, row] = carried.site_position("pelvis")
        goals.quats[:, row] = se3.matrix_to_quat(carried.site_rotation("pelvis"))
        stands = np.zeros_like(stands)
        anchors = np.zeros_like(anchors)
    palms = frozen(_palm_quats(model, goals))
    return Targets(
        fps=clip.fps,
        root_scale=root_scale,
        human_height=human.height,
        site_positions=frozen(goals.positions),
        site_quats=frozen(goals.quats),
        trunk_rotations=frozen(trunk_rotations(human.position)),
        torso_quats=frozen(filters.smooth_quats(goals.quats[:, goals.row("torso")], clip.fps)),
        foot_positions=frozen(foot_positions),
        foot_quats=frozen(foot_quats),
        anchor_weights=frozen(anchors),
        palm_quats=palms,
        contact_quats=palms,
        object_names=tuple(track.name for track in clip.objects),
        object_geometry=tuple(track.geometry for track in clip.objects),
        object_scale=frozen(np.full(len(clip.objects), geometry_scale)),
        object_pos=frozen(np.stack(tracks, axis=1) if tracks else np.zeros((clip.frames, 0, 3))),
        object_quat=frozen(np.stack(turns, axis=1) if turns else np.zeros((clip.frames, 0, 4))),
        stance_flags=frozen(stands, bool),
        limbs=frozen(_limbs(human, clip.objects, geometry_scale)),
        rotation_jumps=jumps,
        contact=contact,
        base_qpos=base,
        **contacts,
    )


def with_contacts_of(targets: Targets, clip: Clip, model: RobotModel, *, person: int = 0) -> Targets:
    """Return targets with the contacts of another clip, which is equal to the first one but for its contacts."""
    scale = float(targets.object_scale[0]) if len(targets.object_scale) else 1.0
    contacts = _contact_fields(clip, model, person, scale, targets.contact)
    return replace(targets, contact_quats=targets.palm_quats, **contacts)


def with_pins(
    targets: Targets, clip: Clip, model: RobotModel, ik_qpos: Float[np.ndarray, "T nq"], *, person: int = 0
) -> Targets:
    """Return targets with the pins of the clip, on top of the IK trajectory; without pins, the same targets.

    A pinned foot moves its own targets, in all frames of the stance.
    Raises `RobotError` where the robot has no such part.

    Args: `targets`: without pins; `clip`: with the pins; `model`: the robot; `ik_qpos`: places of sites without targets
    [m, rad]; `person`: index of the person.
    """
    pinned = [pin for pin in clip.pins if pin.person == person]
    if not pinned:
        return targets
    kinematics = model.forward(ik_qpos)
    sites = pinned_sites(model)
    found: dict[str, SitePin] = {}
    for part in dict.fromkeys(pin.part for pin in pinned):
        if part not in sites:
            raise RobotError(f"{model.spec.name} has no {part}, which is pinned. It has {', '.join(sites)}.")
        site = sites[part]
        path, quats, stands = _followed(targets, kinematics, site)
        own = [pin for pin in pinned if pin.part == part]
        found[site] = site_pin(site, own, path, quats, scale=targets.root_scale, stands=stands, fps=targets.fps)
    feet, turns = targets.foot_positions.copy(), targets.foot_quats.copy()
    for side, site in enumerate(FEET):
        if site in found:
            feet[:, side], turns[:, side] = found[site].positions, found[site].quats
    return replace(
        targets, foot_positions=frozen(feet), foot_quats=frozen(turns), pins=tuple(found.values()), unpinned=targets
    )


def pinned_parts(kinematics: Kinematics, targets: Targets) -> tuple[PinnedPart, ...]:
    """Return the errors of a motion at its pins, in the order of parts and time."""
    parts = {site: part for part, site in pinned_sites(kinematics.model).items()}
    found = []
    for pin in targets.pins:
        off = np.linalg.norm(kinematics.site_position(pin.site) - pin.positions, axis=1)
        turned = se3.angle_between(se3.matrix_to_quat(kinematics.site_rotation(pin.site)), pin.quats)
        for frame in pin.frames:
            degrees = float(np.degrees(turned[frame])) if frame in pin.turned_frames else None
            found.append(PinnedPart(parts[pin.site], frame, float(off[frame]), degrees))
    return tuple(found)


def recorded_rotation(targets: Targets, ik_kinematics: Kinematics, part: str) -> Float[np.ndarray, "T 4"]:
    """Return the rotation on top of which pins turn a part."""
    return _followed(targets.unpinned or targets, ik_kinematics, pinned_sites(ik_kinematics.model)[part])[1]


def _followed(
    targets: Targets, ik_kinematics: Kinematics, site: str
) -> tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 4"], Bool[np.ndarray, "T"]]:
    """Return the path and the rotations that a site follows without pins, and when it is a foot that stands."""
    if site in FEET:
        side = FEET.index(site)
        return targets.foot_positions[:, side], targets.foot_quats[:, side], targets.stance_flags[:, side]
    quats = (
        targets.palm_quats[:, PALMS.index(site)]
        if site in PALMS
        else se3.matrix_to_quat(ik_kinematics.site_rotation(site))
    )
    return ik_kinematics.site_position(site), quats, np.zeros(targets.frames, dtype=bool)


def pinned_sites(model: RobotModel) -> dict[str, str]:
    """Return the sites that stand for the parts that can be pinned."""
    return {**model.spec.part_sites, PELVIS: PELVIS}


def shared_scalings(clip: Clip, models: Sequence[RobotModel], scaling: Scaling) -> tuple[Scaling, ...]:
    """Return the scaling of each robot of a clip, such that all move in one world and share its objects.

    Robots of one kind are scaled as each alone would be. Of different ones the mean stature makes the root scale, each
    keeps a body of its own size, and objects have the size that suits the one that needs them smallest.
    """
    if len({model.spec.name for model in models}) == 1:
        return (scaling,) * len(models)
    heights = float(np.mean([person.height for person in clip.people]))
    root = scaling.root_scale
    if root == "auto":
        root = float(np.mean([model.spec.stature for model in models])) / heights
    geometry = scaling.object_scale
    if geometry == "auto":
        geometry = min(_geometry_scale(model, replace(scaling, size_multiplier=1.0), root) for model in models)
    together = replace(scaling, root_scale=root, object_scale=geometry)
    return tuple(replace(together, body_scale=model.spec.stature / heights) for model in models)


def _root_scale(clip: Clip, model: RobotModel, scaling: Scaling) -> float:
    """Return the human's scale: one for all people of a clip, so that they share one object."""
    if scaling.root_scale != "auto":
        return scaling.root_scale
    return model.spec.stature / float(np.mean([person.height for person in clip.people]))


def _geometry_scale(model: RobotModel, scaling: Scaling, root_scale: float) -> float:
    if scaling.object_scale != "auto":
        return scaling.object_scale * scaling.size_multiplier
    return (root_scale if model.spec.object_size == "root" else 1.0) * scaling.size_multiplier


@dataclass(frozen=True, eq=False)
class _SiteTargets:
    """Goals of the IK table's rows, T x K."""

    sites: list[str]
    positions: np.ndarray
    quats: np.ndarray

    def row(self, site: str) -> int:
        return self.sites.index(site)


def _site_targets(
    human: Person, model: RobotModel, body_scale: float, feet: tuple[Foot, ...], stands: np.ndarray
) -> _SiteTargets:
    """Return positions and rotations for the IK table, with the body lowered to stand on the floor."""
    rows = model.spec.ik
    root = human.position("pelvis")
    positions = np.stack(
        [body_scale * (root + row.scale * (human.position(row.human_joint) - root)) for row in rows], axis=1
    )
    offsets = np.array([row.rotation_offset for row in rows])
    quats = se3.quat_multiply(np.stack([human.quat(row.human_joint) for row in rows], axis=1), offsets)
    goals = _SiteTargets([row.site for row in rows], positions, se3.quat_normalize(quats))
    toes = [goals.row(f"{side}_toe") for side in SIDES]
    rests = [resting_height(positions[:, toe, 2], stands[:, side]) for side, toe in enumerate(toes)]
    # A foot that never stands has no resting height of its own: it rides as the other one does.
    rests = [min(rest, min(rests) + body_scale * LARGEST_DIFFERENCE) for rest in rests]
    standing = [foot.toe_height for foot in feet]
    lowered = np.mean(standing) - np.mean(rests)
    positions[:, :, 2] += lowered
    # The two feet ride at different heights in many captures: each gets its own correction.
    positions[:, toes, 2] += np.subtract(standing, rests) - lowered
    return goals


def _with_planted_feet(
    goals: _SiteTargets, feet: tuple[Foot, ...], stands: np.ndarray, fps: float, *, anchored: bool
) -> tuple[_SiteTargets, np.ndarray, np.ndarray]:
    """Return the goals with the toes' rows replaced, and positions and rotations of the feet's contact sites."""
    positions, quats = goals.positions.copy(), goals.quats.copy()
    foot_positions, foot_quats = np.empty((len(positions), 2, 3)), np.empty((len(positions), 2, 4))
    for side, foot in enumerate(feet):
        toe, standing = goals.row(f"{SIDES[side]}_toe"), stands[:, side]
        turned = se3.quat_multiply(quats[:, toe], resting_tilt(quats[:, toe], standing))
        place, turn = plant(foot, positions[:, toe], turned, standing, fps)
        if anchored:
            place, turn = anchor(foot, place, turn, standing, fps)
        foot_positions[:, side], foot_quats[:, side] = place, turn
        positions[:, toe], quats[:, toe] = place + se3.rotate(turn, foot.toe), turn
    return _SiteTargets(goals.sites, positions, quats), foot_positions, foot_quats


def _palm_quats(model: RobotModel, goals: _SiteTargets) -> np.ndarray:
    """Return the palms' rotations when the wrists follow their IK targets exactly."""
    sites = model.sites
    palms = []
    for side in SIDES:
        wrist, palm = (sites.rotations[:, :, sites.index[f"{side}_{name}"]] for name in ("wrist", "palm"))
        palms.append(se3.quat_multiply(goals.quats[:, goals.row(f"{side}_wrist")], se3.matrix_to_quat(wrist.T @ palm)))
    return np.stack(palms, axis=1)


def object_paths(
    clip: Clip, root_scale: float, geometry_scale: float, contact: ContactKind
) -> tuple[list[Float[np.ndarray, "T 3"]], list[Float[np.ndarray, "T 4"]]]:
    """Return positions [m] and rotations (wxyz) of all objects on the robot's side.

    Each is scaled alone, but while another one carries it, its place over the carrier is the recording's, scaled as its
    geometry is. A part follows its parent, by its joint, with the recording's smoothed states.

    `clip`: the recording; `root_scale`: human size to robot size; `geometry_scale`: size of the objects; `contact`:
    with surfaces, nothing is to be under the floor.
    """
    paths = [track.positions for track in clip.objects]
    turns = [filters.smooth_quats(track.quats, clip.fps) for track in clip.objects]
    found, frames, parents = supports(clip.objects, clip.fps), np.arange(clip.frames), parents_of(clip.objects)
    # Of each object: its place less the recorded one, scaled; the second is after smoothing.
    shifts = np.zeros((2, clip.frames, len(clip.objects), 3))
    for root in dict.fromkeys(root_of(parents, index) for index in found.order):
        track, carriers, tree = clip.objects[root], found.carriers[:, root], depth_first(parents, root)
        lowest = np.min([clip.objects[index].lowest for index in tree], axis=0)
        path = _scale_track(track, lowest, root_scale, geometry_scale, clip.fps)
        recorded = geometry_scale * track.positions, geometry_scale * filters.smooth(track.positions, clip.fps)
        of_carrier, carried = shifts[:, frames, carriers], (carriers >= 0) & ~np.isin(carriers, tree)
        if carried.any():
            known = carried | (lowest < ON_FLOOR)
            path = recorded[1] + _with_carriers(path - recorded[1], carried, of_carrier[1], known, clip.fps)
        paths[root] = path
        for index in tree[1:]:  # A part goes where its parent goes.
            joint, parent = clip.objects[index].joint, parents[index]
            assert joint is not None
            way = path_of(joint, clip.objects[parent], clip.objects[index])
            way = replace(way, states=filters.smooth(way.states[:, None], clip.fps)[:, 0])
            paths[index], turns[index] = way.in_world(paths[parent], turns[parent], geometry_scale)
        raised = np.zeros(clip.frames)
        if contact == "surface":
            ends = [_lowest(clip.objects[index], paths[index], turns[index], geometry_scale) for index in tree]
            raised = filters.rate_limited_upper_envelope(np.maximum(-np.min(ends, axis=0), 0.0), clip.fps)
        if carried.any():
            off = (path - recorded[0] - of_carrier[0])[:, 2] + raised
            raised = raised + _sharper(off, carried, clip.fps)
        for index in tree:
            own = clip.objects[index].positions
            paths[index] = paths[index] + raised[:, None] * UP
            shifts[:, :, index] = paths[index] - np.multiply(geometry_scale, [own, filters.smooth(own, clip.fps)])
    return paths, turns


def _with_carriers(
    alone: Float[np.ndarray, "T 3"],
    carried: Bool[np.ndarray, "T"],
    of_carrier: Float[np.ndarray, "T 3"],
    known: Bool[np.ndarray, "T"],
    fps: float,
) -> Float[np.ndarray, "T 3"]:
    """Return how far an object is from its recorded, scaled place [m].

    As far as its carrier is. In between it moves as an object that is alone, over a ground that goes from one carrier,
    or from the floor, to the next.

    Args: `alone`: the way if nothing carried it [m]; `carried`: when another object carries it; `of_carrier`: the
    carrier's way [m]; `known`: when that or the floor does; `fps`: frames a second.
    """
    return alone + filters.between_known(np.where(carried[:, None], of_carrier - alone, 0.0), known, fps)


def _sharper(off: Float[np.ndarray, "T"], carried: Bool[np.ndarray, "T"], fps: float) -> Float[np.ndarray, "T"]:
    """Return the change of height that leaves a carried object at most `MAXIMUM_OFF_CARRIER` off its place [m].

    Smoothing lifts an object before it is picked up, and sets it down late; the change fades where nothing carries it.
    """
    excess = (np.clip(off, -MAXIMUM_OFF_CARRIER, MAXIMUM_OFF_CARRIER) - off)[filters.nearest_active(carried)]
    return excess * filters.smoothstep_around(carried, filters.seconds_to_frames(SHARPER_SECONDS, fps))


def _scale_track(
    track: ObjectTrack, lowest: Float[np.ndarray, "T"], root_scale: float, geometry_scale: float, fps: float
) -> Float[np.ndarray, "T 3"]:
    """Return the object's path: scaled about the world's origin, the height of its lowest point included [m].

    With geometry scaled by the root scale this is the paper's rule; with captured size it is
    `z' = s z + (1 - s) d`, where `d` is the origin's height over the lowest point, that of parts included.

    Args: `track`: the object; `lowest`: height of its lowest point [m]; `root_scale`: human size to robot size;
    `geometry_scale`: size of the objects; `fps`: frames a second.
    """
    height = np.maximum(root_scale * lowest, 0.0) + geometry_scale * (track.positions[:, 2] - lowest)
    path = np.column_stack([root_scale * track.positions[:, :2], height])
    path_smooth = filters.smooth(path, fps)
    path_smooth[:, 2] = np.maximum(path_smooth[:, 2], path[:, 2] - MAXIMUM_SINK)
    return path_smooth


def _lowest(
    track: ObjectTrack, path: Float[np.ndarray, "T 3"], quats: Float[np.ndarray, "T 4"], scale: float
) -> Float[np.ndarray, "T"]:
    """Return the height of an object's lowest point [m]: turns are smoothed alone, and tips then dip by millimetres."""
    return path[:, 2] + scale * track.geometry.lowest_along(se3.quat_to_matrix(quats)[:, 2])


def _limbs(human: Person, objects: Sequence[ObjectTrack], scale: float) -> Float[np.ndarray, "T O L 2 3"]:
    """Return the ends of the human's limbs in the objects' frames, at their scaled size [m]."""
    ends = [human.position(joint) for limb in LIMBS for joint in limb]
    seen = np.zeros((len(ends[0]), len(objects), len(ends), 3))
    for index, track in enumerate(objects):
        seen[:, index] = scale * np.stack([track.to_object(end) for end in ends], axis=1)
    return seen.reshape(len(seen), len(objects), len(LIMBS), 2, 3)


def _contact_fields(
    clip: Clip, model: RobotModel, person: int, geometry_scale: float, contact: ContactKind
) -> dict[str, Any]:
    """Return the fields of `Targets` that follow from the clip's contacts."""
    clip = with_finger_contacts(clip, person) if contact == "surface" and model.spec.fingers else clip
    parts = _contact_parts(clip, model, person) if contact == "surface" else dict(model.spec.part_sites)
    flags, touched, points = _contacts(clip, parts, person, geometry_scale)
    carried_object, carried_points = _carried(flags, touched, points)
    ramp, rotation_ramp = (
        filters.seconds_to_frames(CONTACT_RAMP_SECONDS, clip.fps),
        filters.seconds_to_frames(ROTATION_RAMP_SECONDS, clip.fps),
    )
    return {
        "contact_links": tuple(parts.values()),
        "contact_flags": frozen(flags, bool),
        "contact_object": frozen(touched, int),
        "contact_points": frozen(points),
        "carried_contact_object": frozen(carried_object, int),
        "carried_contact_points": frozen(carried_points),
        "part_points": frozen(_part_points(clip, parts, person, geometry_scale, carried_object)),
        "contact_weights": frozen(np.stack([filters.smoothstep_around(active, ramp) for active in flags.T], axis=1)),
        "contact_rotation_weights": frozen(
            np.stack([filters.smoothstep_around(active, rotation_ramp) for active in flags.T], axis=1)
        ),
    }


def finger_links(targets: Targets, palm: str) -> list[bool]:
    """Return which contact links are fingers of a palm's hand."""
    return [link in FINGER_SITES and link.startswith(palm.removesuffix("palm")) for link in targets.contact_links]


def finger_touch(targets: Targets, column: int) -> Bool[np.ndarray, "T"]:
    """Return the runs of a palm's contact in which fingers of its hand touch."""
    fingers = finger_links(targets, targets.contact_links[column])
    found = np.zeros(targets.frames, dtype=bool)
    for first, stop in runs(targets.contact_flags[:, column]):
        found[first:stop] = targets.contact_flags[first:stop, fingers].any()
    return found


def _contact_parts(clip: Clip, model: RobotModel, person: int) -> dict[str, str]:
    """Return the sites by part that can touch: hands, feet, and others of the person that do."""
    touching = {track.part for track in clip.contacts if track.person == person and track.active.any()}
    spec = model.spec
    return {part: site for part, site in spec.contact_sites.items() if part in spec.part_sites or part in touching}


def _contacts(
    clip: Clip, parts: Mapping[str, str], person: int, geometry_scale: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    links = list(parts)
    flags = np.zeros((clip.frames, len(links)), dtype=bool)
    touched = np.full((clip.frames, len(links)), -1)
    points = np.full((clip.frames, len(links), 3), np.nan)
    for track in clip.contacts:
        if track.person != person or track.part not in links:
            continue
        link = links.index(track.part)
        # One object a link and frame: the first that the clip names.
        new = track.active & ~flags[:, link]
        flags[new, link] = True
        touched[new, link] = track.object
        points[new, link] = geometry_scale * track.contact_points[new]
    return flags, touched, points


def _carried(flags: np.ndarray, touched: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the object and the point of the contact that is nearest in time, for every link and frame."""
    carried_object, carried_points = np.zeros_like(touched), np.zeros_like(points)
    for link, active in enumerate(flags.T):
        if active.any():
            nearest = filters.nearest_active(active)
            carried_object[:, link], carried_points[:, link] = touched[nearest, link], points[nearest, link]
    return carried_object, carried_points


def _part_points(
    clip: Clip, parts: Mapping[str, str], person: int, geometry_scale: float, carried_object: Int[np.ndarray, "T C"]
) -> Float[np.ndarray, "T C 3"]:
    """Return where the human's parts are in the frames of the objects that they are at or nearest in time to."""
    points = np.zeros((*carried_object.shape, 3))
    for link, part in enumerate(parts):
        place = clip.people[person].part_position(part)
        for index in np.unique(carried_object[:, link]) if clip.objects else ():
            frames = carried_object[:, link] == index
            points[frames, link] = geometry_scale * clip.objects[index].to_object(place)[frames]
    return points
