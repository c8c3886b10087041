"""Builds a `DrawnScene` of clips and results: each in its own place on one floor, beside the others.

A result stands where it was computed, its human one place further, the next result one more. Robots that move the same
objects of one clip share a place and the objects.
"""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import ArgumentError
from hoi_retarget.human.skeleton import PARTS
from hoi_retarget.motion.motion import SIMULATED, STAGE_TITLES, Motion, Stage, check_robot
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.spec import SIDES
from hoi_retarget.studio.scene import robot_shapes as drawn_robots
from hoi_retarget.studio.scene.drawing import Colour, DrawnScene, Layer, Lines, Part, Shapes, Solid, Subject
from hoi_retarget.studio.scene.human_shapes import has_pieces, human_shapes, human_skin
from hoi_retarget.studio.scene.marks import contact_marks, force_arrows, human_contact_marks, inside_marks, stance_marks


def shared_objects(motion: Motion) -> str:
    """Return a digest of a motion's clip and of the paths and sizes of its objects; empty without objects."""
    if not motion.object_names:
        return ""
    origin = f"{motion.report.clip}\0{motion.report.source.sha256}\0".encode(errors="replace")
    arrays = (motion.object_pos, motion.object_quat, motion.object_scale)
    return sha256(origin + b"".join(array.tobytes() for array in arrays)).hexdigest()


def group_people(objects: Sequence[Hashable], people: Sequence[int]) -> tuple[int, ...]:
    """Return, for each motion, the index of the first one that it is shown with: its own where it is alone.

    `objects` are identities, empty for a motion without objects; of one person's motions, a second one stands apart.
    """
    hosts: list[int] = []
    groups: dict[Hashable, dict[int, set[int]]] = {}
    for index, (own, person) in enumerate(zip(objects, people, strict=True)):
        fitting = groups.setdefault(own, {}) if own else {}
        host = next((host for host, members in fitting.items() if person not in members), index)
        fitting.setdefault(host, set()).add(person)
        hosts.append(host)
    return tuple(hosts)


FREE_SPACE = 0.3  # Between what neighbours reach [m].
_ARM_REACH = 0.8  # Of a body, around its pelvis [m].
OBJECT_LAYERS = ("object", "human's object")
BASELINE = "before"  # Layer of an earlier motion.
REFERENCE, FORCES = "reference", "forces"
"""Layers of a motion that was performed in simulation: the stage that it follows, and arrows."""
SEE_THROUGH = 0.35  # Opacity of objects through which hands are seen.
_IK_TINT: Colour = (60, 120, 225)
_EARLIER_OPACITY = 0.35
_SMOOTHING_S = 0.5  # Of a following camera's path.
_MAX_CAMERA_PULL_M = 1.0  # Distance from the pelvis beyond which an object draws the camera no farther.


@dataclass(frozen=True, eq=False)
class SceneItem:
    """An item to show: a motion with its robot, the clip it was made from, or both.

    Raises `ArgumentError` when there is neither, a motion without its robot, a person whom the clip
    does not have, or a clip that the motion was not made from; `RobotError` for another robot's motion.
    """

    title: str
    motion: Motion | None = None
    model: RobotModel | None = None
    clip: Clip | None = None
    person: int = 0  # Index among the clip's people.
    meshes: Path | None = None
    """Folder with the files of the robot's vendor meshes; None for those that were fetched, or the primitives."""
    baseline: Motion | None = None  # An earlier motion of the robot for the same clip, shown as a ghost.

    def __post_init__(self) -> None:
        motion, clip = self.motion, self.clip
        if motion is None and clip is None:
            raise ArgumentError(f"{self.title}: neither a result nor a clip is given; one is needed.")
        if motion is not None and self.model is None:
            raise ArgumentError(f"{self.title}: a result is drawn with its robot, which is not given.")
        if motion is not None and self.model is not None:
            check_robot(motion, self.model)
        if clip is not None and not 0 <= self.person < len(clip.people):
            raise ArgumentError(f"{self.title}: no person {self.person}; there are 0 to {len(clip.people) - 1}.")
        if motion is not None and clip is not None:
            result, recorded = (motion.frames, len(motion.object_names)), (clip.frames, len(clip.objects))
            if result != recorded:
                raise ArgumentError(
                    f"{self.title}: the result has {result[0]} frames and {result[1]} objects, the clip {clip.name!r} "
                    f"{recorded[0]} and {recorded[1]}. Name the clip that the result was made from."
                )

    @property
    def geometries(self) -> tuple[ObjectGeometry, ...] | None:
        """Shapes of the objects; None where they are not known."""
        return None if self.clip is None else tuple(track.geometry for track in self.clip.objects)

    @property
    def ahead(self) -> Float[np.ndarray, "2"]:
        """Mean horizontal direction [unitless] that the robot faces, or the person without one; of any length."""
        if self.motion is not None and self.model is not None:
            return self.model.forward(self.motion.qpos).orientation("pelvis")[:2, 0].mean(axis=1)
        assert self.clip is not None, "one of the two is there"
        return se3.rotate(self.clip.people[self.person].quat("pelvis"), np.array([0.0, 0.0, 1.0])).mean(axis=0)[:2]


def make_scene(shown: Sequence[SceneItem]) -> DrawnScene:
    """Return the scene of results and clips, one subject for each, in the order of the places.

    Raises `ArgumentError` when there is nothing to show, `GeometryError` when an object's mesh file cannot be read, and
    for a robot's vendor meshes `RobotError` when it names none, `ReadError` when one is missing or damaged.
    """
    if not shown:
        raise ArgumentError("there is nothing to show. Name a result or a clip.")
    hosts, sides = group_by_shared_objects(shown), [robot_and_human(item) for item in shown]
    places: dict[tuple[int, str], list[RobotOrHuman]] = {}
    for host, own in zip(hosts, sides, strict=True):
        for side in own:
            places.setdefault((host, side.name), []).append(side)
    shifts = dict(zip(places, shifts_of([reach_of(members) for members in places.values()]), strict=True))
    subjects = []
    for index, (item, host, own) in enumerate(zip(shown, hosts, sides, strict=True)):
        layers = [moved(layer, shifts[host, side.name]) for side in own for layer in side.layers]
        if index != host:
            layers = [layer for layer in layers if layer.name not in OBJECT_LAYERS]
        centre = centre_of(own[0]) + shifts[host, own[0].name]
        looks = {name: path + shifts[host, own[0].name] for name, path in own[0].look_at_targets.items()}
        subjects.append(Subject(item.title, own[0].fps, tuple(layers), centre, looks))
    return DrawnScene(tuple(subjects))


def seen_through(scene: DrawnScene) -> DrawnScene:
    """Return a scene with see-through objects."""
    return scene.with_layers(
        lambda layer: replace(layer, opacity=SEE_THROUGH) if layer.name in OBJECT_LAYERS else layer
    )


def without_marks(scene: DrawnScene) -> DrawnScene:
    """Return a scene with hidden marks of contact, stance and depth."""
    marks = ("contacts", "human's contacts", "inside something", "stance")
    return scene.with_layers(lambda layer: replace(layer, shown=layer.shown and layer.name not in marks))


def group_by_shared_objects(shown: Sequence[SceneItem]) -> tuple[int, ...]:
    """Return, for each item, the index of the first one with its place and objects: its own where it is alone."""
    people = [item.person if item.motion is None else item.motion.person for item in shown]
    return group_people([_objects_of(item) for item in shown], people)


def _objects_of(item: SceneItem) -> tuple[object, ...]:
    """Return the identity of the objects of people in one place; nothing where there are no objects."""
    if item.motion is None:
        return (id(item.clip),)
    objects = shared_objects(item.motion)
    return (objects, item.clip is None) if objects else ()


@dataclass(frozen=True, eq=False)
class RobotOrHuman:
    """A robot or a human with its objects, in one place of the scene."""

    name: str
    fps: float
    pelvis: Float[np.ndarray, "T 3"]
    objects: Float[np.ndarray, "T O 3"]
    layers: tuple[Layer, ...]
    look_at_targets: Mapping[str, Float[np.ndarray, "T 3"]]


def robot_and_human(item: SceneItem) -> tuple[RobotOrHuman, ...]:
    """Return the robot of an item and its human, where it has them."""
    robots = [] if item.motion is None or item.model is None else [_robot(item, item.motion, item.model)]
    return (*robots, *([] if item.clip is None else [_human(item.clip, item.person)]))


def _robot(item: SceneItem, motion: Motion, model: RobotModel) -> RobotOrHuman:
    kinematics = model.forward(motion.qpos)
    hands = {part: site for part, site in model.spec.part_sites.items() if part.endswith("hand")}
    looks = {part.replace("_", " "): kinematics.site_position(site) for part, site in hands.items()}
    looks["feet"] = np.mean([kinematics.site_position(f"{side}_foot") for side in SIDES], axis=0)
    layers = (
        Layer("robot", drawn_robots.robot_parts(model, kinematics, item.meshes)),
        *(_earlier_stage(motion, model, stage, item.clip) for stage in motion.stages[:-1]),
        Layer("object", _robot_objects(motion, item.clip)),
        Layer("contacts", contact_marks(motion, kinematics, item.geometries)),
        Layer("inside something", inside_marks(motion, model, item.geometries)),
        Layer("stance", (stance_marks(motion, kinematics),)),
    )
    forces = motion.stages[-1].forces
    if item.baseline is not None:
        ghost = drawn_robots.robot_shapes(model, model.forward(item.baseline.qpos))
        layers += (Layer(BASELINE, tuple(map(_tinted, ghost)), opacity=_EARLIER_OPACITY, shown=False),)
    if forces is not None:
        layers += (Layer(FORCES, force_arrows(forces)),)
    return RobotOrHuman("robot", motion.fps, motion.qpos[:, :3], motion.object_pos, layers, looks)


def _earlier_stage(motion: Motion, model: RobotModel, stage: Stage, clip: Clip | None) -> Layer:
    """Return a stage as a ghost, with its objects where a simulation has moved them since."""
    parts: list[Part] = list(map(_tinted, drawn_robots.robot_shapes(model, model.forward(stage.qpos))))
    if stage.objects is not None:
        parts += _robot_objects(motion.at_stage(stage.name), clip)
    followed = motion.stages[-1].name == SIMULATED and stage is motion.stages[-2]
    title = REFERENCE if followed else STAGE_TITLES.get(stage.name, stage.name)
    return Layer(title, tuple(parts), opacity=_EARLIER_OPACITY, shown=False)


def _robot_objects(motion: Motion, clip: Clip | None) -> tuple[Part, ...]:
    """Return the objects that the robot moves: as axes where their shape is not known."""
    parts: list[Part] = []
    for index, scale in enumerate(motion.object_scale):
        positions, quats = motion.object_pos[:, index], motion.object_quat[:, index]
        if clip is None:
            parts.append(drawn_robots.object_axes(positions, quats))
        else:
            geometry, colour = clip.objects[index].geometry, drawn_robots.COLOURS[index % len(drawn_robots.COLOURS)]
            parts.append(drawn_robots.object_solid(geometry, float(scale), positions, quats, colour))
    return tuple(parts)


def _human(clip: Clip, person: int) -> RobotOrHuman:
    human = clip.people[person]
    contacts = tuple(track for track in clip.contacts if track.person == person)
    solids = (
        drawn_robots.object_solid(
            track.geometry, 1.0, track.positions, track.quats, drawn_robots.COLOURS[index % len(drawn_robots.COLOURS)]
        )
        for index, track in enumerate(clip.objects)
    )
    layers = (
        Layer("human", human_skin(human) if has_pieces(human) else human_shapes(human)),
        Layer("human's object", tuple(solids)),
        Layer("human's contacts", human_contact_marks(contacts, clip.objects)),
    )
    objects = [track.positions for track in clip.objects]
    places = np.stack(objects, axis=1) if objects else np.zeros((clip.frames, 0, 3))
    looks = {part.replace("_", " "): human.part_position(part) for part in PARTS if part.endswith("hand")}
    looks["feet"] = np.mean([human.part_position(f"{side}_foot") for side in SIDES], axis=0)
    return RobotOrHuman("human", clip.fps, human.position("pelvis"), places, layers, looks)


def _tinted(shapes: Shapes) -> Shapes:
    return replace(shapes, colours=(0.3 * shapes.colours + 0.7 * np.array(_IK_TINT)).astype(np.uint8))


def reach_of(sides: Sequence[RobotOrHuman]) -> Float[np.ndarray, "2 2"]:
    """Return the lowest and highest x and y that bodies and objects of one place reach [m]."""
    paths = [(side.pelvis, _ARM_REACH) for side in sides]
    for side in sides:
        parts = [part for layer in side.layers if layer.name in OBJECT_LAYERS for part in layer.parts]
        paths += [(side.objects[:, index], _radius(part)) for index, part in enumerate(parts)]
    low = np.min([path[:, :2].min(axis=0) - reach for path, reach in paths], axis=0)
    high = np.max([path[:, :2].max(axis=0) + reach for path, reach in paths], axis=0)
    return np.stack([low, high])


def _radius(part: Part) -> float:
    return float(np.linalg.norm(part.vertices, axis=1).max()) if isinstance(part, Solid) else drawn_robots.AXIS_LENGTH


def shifts_of(reaches: Sequence[Float[np.ndarray, "2 2"]]) -> list[Float[np.ndarray, "3"]]:
    """Return the shift of each place [m]: beside the others along the axis in which the paths extend least."""
    lateral = int(np.argmin(np.max([high - low for low, high in reaches], axis=0)))
    middles = np.mean(reaches, axis=1)
    shifts, edge = [], float(reaches[0][0, lateral]) - FREE_SPACE
    for number, (low, high) in enumerate(reaches):
        shift = np.zeros(3)
        shift[:2] = middles[0] - middles[number]
        shift[lateral] = edge + FREE_SPACE - low[lateral]
        edge = float(high[lateral] + shift[lateral])
        shifts.append(shift)
    return shifts


def moved(layer: Layer, shift: Float[np.ndarray, "3"]) -> Layer:
    """Return a layer moved by so much [m]."""
    return replace(layer, parts=tuple(_moved_part(part, shift.astype(np.float32)) for part in layer.parts))


def _moved_part(part: Part, shift: Float[np.ndarray, "3"]) -> Part:
    if not shift.any():
        return part
    if isinstance(part, Lines):
        return replace(part, starts=part.starts + shift, ends=part.ends + shift)
    return replace(part, positions=part.positions + shift)


def centre_of(side: RobotOrHuman) -> Float[np.ndarray, "T 3"]:
    """Return a smooth path between the pelvis and the object nearest on average [m]."""
    centre = side.pelvis
    if side.objects.shape[1]:
        away = side.objects[..., :2] - side.pelvis[:, None, :2]
        distance = np.linalg.norm(away, axis=-1)
        nearest = int(distance.mean(axis=0).argmin())
        share = 0.5 * np.minimum(1.0, _MAX_CAMERA_PULL_M / np.maximum(distance[:, nearest], _MAX_CAMERA_PULL_M))
        centre = centre + np.column_stack([share[:, None] * away[:, nearest], np.zeros(len(centre))])
    return gaussian_filter1d(centre, _SMOOTHING_S * side.fps, axis=0, mode="nearest")
