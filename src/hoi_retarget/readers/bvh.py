"""Reads BVH: one person, captured or animated, without objects; LAFAN1, and skeletons with the names of a known rig.

Joints are found by their names. BVH states neither which axis is up, nor a unit, nor a T-pose, so these are found:

- up is the axis along which the person stands, y or z, y if neither;
- the unit is the one of `UNITS` in which the person has a grown person's height;
- rotations are counted from the pose in which nothing is turned, where that is about a T-pose or has arms that hang
  down. LAFAN1's has all bones in one line along x; which way its bones lie in a T-pose was measured: knees and elbows
  bend about z, and standing toes are level.

The stature is the rest pose's, where its head has a top. Where the root is between the hips, the pelvis is put at the
lowest joint of the spine, as SMPL-X's is above them. Whatever comes out must bend its knees backwards and its elbows
forwards.

Cites: ubisoft/ubisoft-laforge-animation-dataset (names, 30 frames a second, centimetres, CC BY-NC-ND 4.0); GMR
`ik_configs/bvh_lafan1_to_g1.json` (the same axes).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError
from hoi_retarget.files.bvh_file import END, Bvh, is_bvh, parse_bvh
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import (
    JOINT_INDEX,
    JOINTS,
    LEFT_FINGERS,
    RIGHT_FINGERS,
    STRAIGHT_FINGERS,
    add_straight_fingers,
)
from hoi_retarget.human.t_pose import LIMBS, body_axes, turns_from_t_pose
from hoi_retarget.numerics import se3
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks
from hoi_retarget.readers.worlds import World, standing_axis

FORMAT = "bvh"
LICENCE = "that of the data, which BVH does not state; LAFAN1: CC BY-NC-ND 4.0"
UNITS: Mapping[str, float] = {
    "a metre": 1.0,
    "0.05644 m, as in CMU's": 0.0254 / 0.45,
    "an inch": 0.0254,
    "a centimetre": 0.01,
    "a millimetre": 1e-3,
}
"""What a unit of length may be [m]; no person is a grown one in two of them."""
MIN_HEIGHT, MAX_HEIGHT = 1.2, 2.3  # [m]
MAX_ANGLE_TO_T_POSE = 100.0  # [deg]; arms that hang down are about 90 away.
MIN_PELVIS_HEIGHT = 0.04  # Of a leg's length; a root that is less above the hips is between them.

MIN_HEAD_HEIGHT = 0.08  # Of the height; less above the head's joint is no top of it.

ACTOR, ACTOR_FACTS = "motion_actor.bvh", ("metadata.json", "capture_meta.json")
"""Name of the BVH in each recording's folder of HiPHI and OmniContact, and those of the facts beside it."""

_BODY = 22
_STRAIGHT = 0.85  # A cosine; limbs that are bent less are no evidence.
_FLAT_FOOT = np.deg2rad(21.454555)
"""By which LAFAN1's toes are turned against its feet; they are level while it stands."""
_TRUNK = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
_LEG = np.array([[0, 0, -1], [-1, 0, 0], [0, 1, 0]])
_TOE = np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]])
_ARMS = {"left": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]), "right": np.array([[-1, 0, 0], [0, 0, -1], [0, -1, 0]])}
"""The axes of LAFAN1's bones in the T-pose, one a column."""


@dataclass(frozen=True)
class _Rig:
    """Names of bones, without a prefix that a file gives to all of them."""

    title: str
    pelvis: str
    sides: tuple[str, str]  # Beginnings of the names of a left and of a right limb.
    limbs: dict[str, tuple[str, ...]]  # Joint without its side -> its possible names.
    toe_height: float = 0.0  # Of the toe joints over the soles [m]; most rigs have them on the soles, for a hinge.

    def bones(self) -> dict[str, tuple[str, ...]]:
        """Return joint -> its possible names, without spine and fingers."""
        # A foot without toes may have an end.
        limbs = self.limbs | {"foot": (*self.limbs["foot"], f"{self.limbs['ankle'][0]}{END}")}
        sided = {
            f"{side}_{joint}": tuple(f"{prefix}{name}" for name in names)
            for side, prefix in zip(("left", "right"), self.sides, strict=True)
            for joint, names in limbs.items()
        }
        return {"pelvis": (self.pelvis,), "neck": ("Neck", "Neck1"), "head": ("Head",), **sided}


_LIMBS = ("hip", "knee", "ankle", "foot", "collar", "shoulder", "elbow", "wrist")


def _rig(title: str, pelvis: str, sides: tuple[str, str], bones: str, toe_height: float = 0.0) -> _Rig:
    names = (tuple(bone.split("|")) for bone in bones.split())
    return _Rig(title, pelvis, sides, dict(zip(_LIMBS, names, strict=True)), toe_height)


_RIGS = (
    _rig("LAFAN1 and Mixamo", "Hips", ("Left", "Right"), "UpLeg Leg Foot ToeBase|Toe Shoulder Arm ForeArm Hand"),
    _rig("Xsens MVN", "Hips", ("Left", "Right"), "Hip Knee Ankle Toe Collar Shoulder Elbow Wrist"),
    _rig("SOMA", "Hips", ("Left", "Right"), "Leg Shin Foot ToeBase Shoulder Arm ForeArm Hand", 0.02),
    _rig("SMPL", "Pelvis", ("L_", "R_"), "Hip Knee Ankle Foot|Toe Collar Shoulder Elbow Wrist", 0.025),
)


@dataclass(frozen=True)
class _RiggedSkeleton:
    """A file's joints by the names of `skeleton.JOINTS`."""

    rig: _Rig
    joints: Mapping[str, int]  # Of the body without the spine, and of all fingers where they are there.
    spine: tuple[int, ...]  # From above the pelvis to below the neck.


def holds(file: SourceFile) -> bool:
    """Return whether a file begins as BVH does, and no data set's facts stand beside it."""
    return is_bvh(file.beginning) and not any(is_actor(file, facts) for facts in ACTOR_FACTS)


def is_actor(file: SourceFile, facts: str) -> bool:
    """Return whether a file is the actor's of a data set, with the file of its facts beside it."""
    return file.path.name == ACTOR and file.beside(facts).is_file() and is_bvh(file.beginning)


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a file."""
    return recording_of(file.path, parse_bvh(file.content, file.path))


def recording_of(path: Path, motion: Bvh) -> SourceRecording:
    """Return the recording of a skeleton that a file holds; raises `ClipError` where its names are not known."""
    try:
        skeleton = _skeleton_of(motion.names, motion.parents)
    except ClipError as error:
        raise ClipError(f"{path}: {error}.") from error

    def read_tracks() -> Tracks:
        person, notes = _person(path, motion, skeleton)
        return Tracks(people=(person,), objects=(), notes=notes)

    return SourceRecording(
        name=path.stem,
        description="BVH motion of one person",
        frames=len(motion.values),
        fps=motion.rate,
        fps_stated=True,
        skeleton=f"{len(motion.names)} joints with the names of {skeleton.rig.title}",
        up_axis="measured from the person when it is read",
        objects=(),
        contacts="none, as there are no objects",
        licence=LICENCE,
        up=_world,
        read_tracks=read_tracks,
        may_lie=True,
    )


def _world(person: Person) -> World:
    """Return the world in which the person stands upright, y up where it does not stand."""
    for up in ("y", "z"):
        world = World.of_axis(up)
        if standing_axis(world.turned_person(person).joint_positions) == "z":
            return World(up, world.turns, f"{up} is up: the person stands along it; the file does not state it.")
    world = World.of_axis("y")
    return World("y", world.turns, "y is taken as up, as in most BVH files; the person does not stand along it.")


def _person(path: Path, motion: Bvh, skeleton: _RiggedSkeleton) -> tuple[Person, tuple[str, ...]]:
    """Return the person in the file's world, in metres, and notes; raises `ClipError`."""
    rest = motion.rest_positions()
    joints = _joints(skeleton, skeleton.spine)
    turns, how = _turns(path, rest[joints])
    stature = _stature(rest, motion.parents, joints, turns[0])
    places, notes = joints, (how,)
    if _root_between_hips(rest[joints], turns[0]):
        joints = _joints(skeleton, skeleton.spine[1:] or skeleton.spine)
        places = np.array([skeleton.spine[0], *joints[1:]])
        notes += ("The root is between the hips; the pelvis is put at the lowest joint of the spine.",)
    all_positions, all_quats = motion.poses()
    positions, quats = all_positions[:, places], se3.quat_multiply(all_quats[:, joints], turns)
    if len(joints) == _BODY:
        positions, quats = _with_fingers(positions, quats)
        notes += (STRAIGHT_FINGERS,)
    unit, unit_note = _unit(path, Person("person", positions, quats, stature=stature).height)
    person = Person(
        "person",
        unit * positions,
        quats,
        fingers_recorded=len(joints) > _BODY,
        stature=None if stature is None else unit * stature,
        toe_height=skeleton.rig.toe_height,
    )
    _check_bending(path, person)
    return person, (*notes, unit_note)


def _joints(skeleton: _RiggedSkeleton, spine: Sequence[int]) -> Int[np.ndarray, "J"]:
    """Return the file's joints in the order of `skeleton.JOINTS`, without fingers where it has none."""
    chosen = np.linspace(0, len(spine) - 1, 3).round().astype(int)
    found = {**skeleton.joints, **{f"spine{number}": spine[place] for number, place in enumerate(chosen, 1)}}
    return np.array([found[joint] for joint in JOINTS if joint in found])


def _turns(path: Path, rest: Float[np.ndarray, "J 3"]) -> tuple[Float[np.ndarray, "J 4"], str]:
    """Return turns of each bone's rotation into one that is counted from the T-pose, wxyz, and a note of them."""
    if _is_along_x(rest):
        return _lafan1_turns(), "All bones lie along x while nothing is turned, as LAFAN1's: rotations are as there."
    unturned = np.tile(se3.IDENTITY_QUAT, (len(rest), 1))
    try:
        turns, largest = turns_from_t_pose(rest, unturned, body_axes(rest), MAX_ANGLE_TO_T_POSE)
    except ClipError as error:
        raise ClipError(
            f"{path}: {error}, while nothing is turned. Export it with a T-pose as the rest pose; of other rest poses "
            "only LAFAN1's is known."
        ) from error
    return turns, f"Limbs of the rest pose are up to {largest:.0f} deg from those of a T-pose, which is accounted for."


def _stature(
    rest: np.ndarray, parents: Sequence[int], joints: Int[np.ndarray, "J"], turn: Float[np.ndarray, "4"]
) -> float | None:
    """Return the height of the rest pose; None where its head has no top."""
    head = joints[JOINT_INDEX["head"]]
    of_head = np.arange(len(rest)) == head
    for joint, parent in enumerate(parents):
        of_head[joint] |= parent >= 0 and of_head[parent]
    heights = se3.rotate_inverse(turn, rest)[:, 1]
    top, lowest = float(heights[of_head].max()), float(heights.min())
    return top - lowest if top - heights[head] > MIN_HEAD_HEIGHT * (top - lowest) else None


def _is_along_x(rest: Float[np.ndarray, "J 3"]) -> bool:
    ends = [JOINT_INDEX[end] for end, _ in LIMBS.values()]
    bones = rest[ends] - rest[[JOINT_INDEX[joint] for joint in LIMBS]]
    return bool((bones[:, 0] > 0.99 * np.linalg.norm(bones, axis=1)).all()) and len(rest) == _BODY


def _lafan1_turns() -> Float[np.ndarray, "22 4"]:
    """Return the turns of LAFAN1's bones."""
    tilt = se3.quat_to_matrix(se3.exp(np.array([0.0, 0.0, -_FLAT_FOOT])))
    axes = np.empty((_BODY, 3, 3))
    for joint, index in list(JOINT_INDEX.items())[:_BODY]:
        side, _, limb = joint.partition("_")
        if limb in ("hip", "knee"):
            axes[index] = _LEG
        elif limb in ("ankle", "foot"):
            axes[index] = _TOE @ tilt if limb == "ankle" else _TOE
        else:
            axes[index] = _ARMS.get(side, _TRUNK)
    return se3.quat_conjugate(se3.matrix_to_quat(axes))


def _root_between_hips(rest: Float[np.ndarray, "J 3"], turn: Float[np.ndarray, "4"]) -> bool:
    """Return whether the root is no higher than the hips."""
    pelvis, left, right, knee, ankle = (
        rest[JOINT_INDEX[joint]] for joint in ("pelvis", "left_hip", "right_hip", "left_knee", "left_ankle")
    )
    upwards = se3.rotate_inverse(turn, pelvis - 0.5 * (left + right))[1]
    return bool(upwards < MIN_PELVIS_HEIGHT * (np.linalg.norm(knee - left) + np.linalg.norm(ankle - knee)))


def _with_fingers(
    positions: Float[np.ndarray, "T 22 3"], quats: Float[np.ndarray, "T 22 4"]
) -> tuple[Float[np.ndarray, "T 52 3"], Float[np.ndarray, "T 52 4"]]:
    frames = len(positions)
    full_positions, full_quats = np.zeros((frames, 1, len(JOINTS), 3)), np.zeros((frames, 1, len(JOINTS), 4))
    full_positions[:, 0, :_BODY], full_quats[:, 0, :_BODY] = positions, quats
    add_straight_fingers(full_positions, full_quats)
    return full_positions[:, 0], full_quats[:, 0]


def _unit(path: Path, height: float) -> tuple[float, str]:
    """Return the file's unit [m], from the person's height in it, and a note of it; raises `ClipError`."""
    for name, unit in UNITS.items():
        if MIN_HEIGHT <= unit * height <= MAX_HEIGHT:
            return (
                unit,
                f"A unit of length is {name}: the person is then {unit * height:.2f} m tall; the file states none.",
            )
    raise ClipError(
        f"{path}: the person is {height:.4g} units tall, which is {MIN_HEIGHT:g} to {MAX_HEIGHT:g} m in none of "
        f"{', '.join(UNITS)}. Scale offsets and positions to centimetres."
    )


def _check_bending(path: Path, person: Person) -> None:
    """Raise `ClipError` unless knees bend backwards and elbows forwards, mostly: bones' axes are then other ones."""
    for side in ("left", "right"):
        for joint, end, forwards in (("hip", "knee", -1.0), ("shoulder", "elbow", 1.0)):
            far = {"knee": "ankle", "elbow": "wrist"}[end]
            first = person.position(f"{side}_{end}") - person.position(f"{side}_{joint}")
            second = person.position(f"{side}_{far}") - person.position(f"{side}_{end}")
            lengths = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
            bent = np.sum(first * second, axis=1) < _STRAIGHT * lengths
            bends = se3.rotate_inverse(person.quat(f"{side}_{joint}"), second)[bent, 2] * forwards
            if bent.any() and (bends > 0.0).mean() < 0.5:
                raise ClipError(
                    f"{path}: the {side} {end} bends the wrong way in most frames: the bones have other axes than "
                    "the rest pose tells. Export it with a T-pose as the rest pose."
                )


def _skeleton_of(names: Sequence[str], parents: Sequence[int]) -> _RiggedSkeleton:
    """Return the skeleton of a known rig, from the names and parents of all joints, root first; raises `ClipError`."""
    lacking: list[tuple[_Rig, list[str]]] = []
    for rig in _RIGS:
        prefix = names[0].removesuffix(rig.pelvis) if names[0].endswith(rig.pelvis) else ""
        # The first of a name counts: ends of limbs may repeat one.
        places = {name.removeprefix(prefix): index for index, name in reversed(list(enumerate(names)))}
        bones = rig.bones()
        found = {
            joint: next((places[name] for name in called if name in places), -1) for joint, called in bones.items()
        }
        spine = _between(found["pelvis"], found["neck"], parents)
        if spine and min(found.values()) >= 0:
            return _RiggedSkeleton(rig, found | _fingers(rig, places), spine)
        lacking.append((rig, [bones[joint][0] for joint, index in found.items() if index < 0]))
    nearest, missing = min(lacking, key=lambda item: len(item[1]))
    raise ClipError(
        f"the skeleton is none that is known ({', '.join(rig.title for rig in _RIGS)}): of the names of "
        f"{nearest.title} it lacks {', '.join(missing[:4]) or 'a spine'}{', ...' if len(missing) > 4 else ''}, and has "
        f"{', '.join(names[:6])}, .... Rename its bones, or convert it to the layout in docs/sources.md"
    )


def _between(pelvis: int, neck: int, parents: Sequence[int]) -> tuple[int, ...]:
    """Return the joints from above the pelvis to below the neck, none where the neck is not above it."""
    chain: list[int] = []
    joint = parents[neck] if neck >= 0 else -1
    while joint >= 0 and joint != pelvis:
        chain.append(joint)
        joint = parents[joint]
    return tuple(reversed(chain)) if joint == pelvis else ()


def _fingers(rig: _Rig, places: Mapping[str, int]) -> dict[str, int]:
    """Return all finger joints, such as `LeftHandIndex1` for that of `LeftHand`; none where some are missing.

    Fingers of four joints begin in the palm: the first is none of a person's three.
    """
    found: dict[str, int] = {}
    for side, prefix, fingers in zip(("left", "right"), rig.sides, (LEFT_FINGERS, RIGHT_FINGERS), strict=True):
        for joint in fingers:
            name = f"{prefix}{rig.limbs['wrist'][0]}{joint.removeprefix(f'{side}_').title()}"
            name = f"{name[:-1]}{int(name[-1]) + (f'{name[:-1]}4' in places)}"
            if name not in places:
                return {}
            found[joint] = places[name]
    return found


READER = Reader(FORMAT, record, holds=holds)
