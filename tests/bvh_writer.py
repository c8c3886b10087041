"""Writes BVH files: of any tree of joints, and of a clip's person on rigs whose bones have axes of their own."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from hoi_retarget.clip.clip import Clip
from hoi_retarget.human.skeleton import JOINTS, PARENT
from hoi_retarget.numerics import se3
from source_people import in_world, rest_joints

POSITIONS = ("Xposition", "Yposition", "Zposition")
_LIMBS = ("hip", "knee", "ankle", "foot", "collar", "shoulder", "elbow", "wrist")
_SIDES = ("left", "right")
_LONGER = 1.02
LOWEST = "lowest_spine"
"""Stands for a bone at the pelvis where the root is between the hips."""


def _names(trunk: str, limbs: str, sides: tuple[str, str] = ("Left", "Right")) -> dict[str, str]:
    """Joint of the body -> its bone's name."""
    own = zip(("pelvis", "spine1", "spine2", "spine3", "neck", "head"), trunk.split(), strict=True)
    both = {
        f"{side}_{joint}": f"{prefix}{bone}"
        for side, prefix in zip(_SIDES, sides, strict=True)
        for joint, bone in zip(_LIMBS, limbs.split(), strict=True)
    }
    return dict(own) | both


MIXAMO = _names("Hips Spine Spine1 Spine2 Neck Head", "UpLeg Leg Foot ToeBase Shoulder Arm ForeArm Hand")
XSENS = _names("Hips Chest Chest2 Chest3 Neck Head", "Hip Knee Ankle Toe Collar Shoulder Elbow Wrist")
SMPL = _names("Pelvis Spine1 Spine2 Spine3 Neck Head", "Hip Knee Ankle Foot Collar Shoulder Elbow Wrist", ("L_", "R_"))
SOMA = _names("Hips Spine1 Spine2 Chest Neck1 Head", "Leg Shin Foot ToeBase Shoulder Arm ForeArm Hand")
MIXAMO_FINGERS = {
    joint: f"{joint.partition('_')[0].title()}Hand{joint.partition('_')[2].title()}" for joint in JOINTS[22:]
}
SOMA_FINGERS = {
    joint: bone if "Thumb" in bone else f"{bone[:-1]}{int(bone[-1]) + 1}" for joint, bone in MIXAMO_FINGERS.items()
}
"""Four joints a finger: the first is in the palm, and none of a person's."""


@dataclass(frozen=True, eq=False)
class Bone:
    """A joint of the file."""

    name: str
    parent: int
    offset: np.ndarray
    order: str = "ZYX"
    """Of the rotation channels."""
    moves: bool = False
    """Whether it has position channels."""
    end: np.ndarray | None = None


def bvh_text(
    bones: Sequence[Bone],
    positions: Mapping[int, np.ndarray],
    angles: np.ndarray,
    *,
    frame_time: str = "0.033333",
    digits: int = 9,
) -> str:
    """The file of a tree; `positions` (T, 3) of bones that move, `angles` (T, J, 3) in the channels' order [deg]."""
    lines = ["HIERARCHY"]

    def write(index: int, indent: str) -> None:
        bone = bones[index]
        channels = [f"{axis}rotation" for axis in bone.order]
        if bone.moves:
            channels = [*POSITIONS, *channels]
        lines.append(f"{indent}{'JOINT' if bone.parent >= 0 else 'ROOT'} {bone.name}")
        lines.append(f"{indent}{{")
        lines.append(f"{indent}\tOFFSET {' '.join(f'{value:.{digits}f}' for value in bone.offset)}")
        lines.append(f"{indent}\tCHANNELS {len(channels)} {' '.join(channels)} ")
        for child, other in enumerate(bones):
            if other.parent == index:
                write(child, f"{indent}\t")
        if bone.end is not None:
            end = " ".join(f"{value:.{digits}f}" for value in bone.end)
            lines.extend([f"{indent}\tEnd Site", f"{indent}\t{{", f"{indent}\t\tOFFSET {end}", f"{indent}\t}}"])
        lines.append(f"{indent}}}")

    write(0, "")
    columns = []
    for index in depth_first(bones):
        columns += list(positions[index].T) if bones[index].moves else []
        columns += list(angles[:, index].T)
    lines += ["MOTION", f"Frames: {len(angles)}", f"Frame Time: {frame_time}"]
    lines += [" ".join(f"{value:.{digits}f}" for value in row) for row in np.stack(columns, axis=1)]
    return "\n".join(lines) + "\n"


def depth_first(bones: Sequence[Bone], root: int = 0) -> list[int]:
    """Bones in the order in which the file has them."""
    below = [depth_first(bones, child) for child, bone in enumerate(bones) if bone.parent == root]
    return [root, *(index for branch in below for index in branch)]


@dataclass(frozen=True)
class Rig:
    """How a person is written."""

    names: Mapping[str, str]
    """Joint -> bone, with or without fingers."""
    prefix: str = ""
    axes: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Joint -> rotation of its bone in the T-pose, wxyz; none for those that nothing turns there."""
    order: str = "ZXY"
    unit: float = 0.01  # [m]
    up: str = "y"
    top: float = 0.0
    """How far the head ends above its joint [m]."""
    moves: bool = False
    """Whether all joints have positions; their offsets are then those of a longer body, which does not count."""
    root_between_hips: bool = False
    """Whether the root is there; `names` then have a bone for `LOWEST`, too."""


def write_person(path: Path, clip: Clip, rig: Rig, **settings: str) -> Path:
    """Write a clip's first person."""
    person = in_world(clip, rig.up).people[0]
    places = dict(zip(JOINTS, rest_joints(person, "smplh"), strict=True))
    quats = {joint: person.quat(joint) for joint in JOINTS}
    parents = {joint: str(PARENT[joint]) for joint in JOINTS[1:]}
    names = dict(rig.names)
    root = person.position("pelvis")
    if rig.root_between_hips:
        middle = 0.5 * (places["left_hip"] + places["right_hip"])
        root = root + se3.rotate(person.quat("pelvis"), middle - places["pelvis"])
        places |= {LOWEST: places["pelvis"], "pelvis": middle}
        quats[LOWEST] = quats["pelvis"]
        parents |= {"spine1": LOWEST, LOWEST: "pelvis"}
    joints = [joint for joint in (JOINTS[0], LOWEST, *JOINTS[1:]) if joint in names]
    axes = {joint: rig.axes.get(joint, se3.IDENTITY_QUAT) for joint in joints}
    world = {joint: se3.quat_multiply(quats[joint], axes[joint]) for joint in joints}
    bones, turns = (
        [Bone(rig.prefix + names["pelvis"], -1, root[0] / rig.unit, rig.order, moves=True)],
        [world["pelvis"]],
    )
    for joint in joints[1:]:
        above = parents[joint]
        while above not in names:
            above = parents[above]
        offset = se3.rotate_inverse(axes[above], places[joint] - places[above]) / rig.unit
        end = np.array([0.0, rig.top / rig.unit, 0.0]) if joint == "head" else None
        bones.append(Bone(rig.prefix + names[joint], joints.index(above), offset, rig.order, rig.moves, end))
        turns.append(se3.quat_multiply(se3.quat_conjugate(world[above]), world[joint]))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Gimbal lock")  # One of the two angles is then as good as the other.
        angles = [Rotation.from_quat(turn, scalar_first=True).as_euler(rig.order, degrees=True) for turn in turns]
    positions = {0: root / rig.unit}
    if rig.moves:
        positions |= {index: np.tile(bone.offset, (len(root), 1)) for index, bone in enumerate(bones) if index}
        bones = [replace(bone, offset=_LONGER * bone.offset) for bone in bones]
    path.write_text(bvh_text(bones, positions, np.stack(angles, axis=1), **settings))
    return path


def hanging_arms(degrees: float = 90.0) -> dict[str, np.ndarray]:
    """The axes of a rig whose rest pose has arms that hang down by so much, with straight hands."""
    turned = {
        f"{side}_{joint}": se3.exp(np.deg2rad([0.0, 0.0, sign * degrees]))
        for side, sign in (("left", 1.0), ("right", -1.0))
        for joint in ("shoulder", "elbow", "wrist", *(name.removeprefix("left_") for name in JOINTS[22:37]))
    }
    return turned


LAFAN1 = {joint: bone.replace("ToeBase", "Toe") for joint, bone in MIXAMO.items() if joint != "spine2"} | {
    **{LOWEST: "Spine", "spine1": "Spine1", "spine3": "Spine2"}
}


def lafan1_axes() -> dict[str, np.ndarray]:
    """Its bones in the T-pose: x along them; y forwards in trunk and legs, upwards in toes, backwards in arms."""
    left, up, ahead = np.eye(3)
    directions = {"Hips": (up, ahead), "Leg": (-up, ahead), "Toe": (ahead, up)}
    kinds = {"hip": "Leg", "knee": "Leg", "foot": "Toe"}
    axes = {}
    for joint in LAFAN1:
        side, _, limb = joint.partition("_")
        if side in _SIDES and limb not in (*kinds, "ankle"):
            first, second = left if side == "left" else -left, -ahead
        else:
            first, second = directions[kinds.get(limb, "Toe" if limb == "ankle" else "Hips")]
        axes[joint] = se3.matrix_to_quat(np.stack([first, second, np.cross(first, second)], axis=1))
        if limb == "ankle":  # Its toes are turned up against it by so much while they are level.
            axes[joint] = se3.quat_multiply(axes[joint], se3.exp(np.deg2rad([0.0, 0.0, -21.454555])))
    return axes
