"""Writes clips of one person in InterMimic's layouts and those like them, as tensors or dictionaries, for tests."""

from pathlib import Path

import numpy as np

from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, PARENT, PARTS
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers import physhoi, theia
from hoi_retarget.readers.intermimic import FIELDS
from hoi_retarget.readers.intermimic_layouts import BODIES, UPRIGHT_QUAT
from torch_writer import torch_bytes

BODY_ORDER = [JOINT_INDEX[name] for name in BODIES]


def columns_of(clip: Clip, late_fingers: bool = False) -> np.ndarray:
    """Return the (T, 591) tensor of a clip in single precision.

    With `late_fingers`, positions are in the older order: jaw and eyes before the fingers.
    """
    person, track = clip.people[0], clip.objects[0]
    quats = se3.quat_multiply(person.joint_quats, se3.quat_conjugate(UPRIGHT_QUAT))
    positions = person.joint_positions
    if late_fingers:
        face = np.repeat(person.position("head")[:, None], 3, axis=1) + 0.05
        positions = np.concatenate([positions[:, :22], face, positions[:, 22:49]], axis=1)
    labels = np.zeros((clip.frames, len(JOINTS)))
    for contact in clip.contacts:
        for joint in PARTS[contact.part].label_joints:
            labels[contact.active, JOINT_INDEX[joint]] = 1.0
    local = se3.quat_multiply(
        se3.quat_conjugate(quats[:, [JOINT_INDEX[PARENT[name] or "pelvis"] for name in BODIES]]), quats[:, BODY_ORDER]
    )
    matrix = np.zeros((clip.frames, 591), dtype=np.float32)
    values = {
        "root position": person.position("pelvis"),
        "root rotation": se3.quat_to_xyzw(quats[:, 0]),
        "joint angles": se3.log(local[:, 1:]),
        "body positions": positions[:, BODY_ORDER],
        "object position": track.positions,
        "object rotation": se3.quat_to_xyzw(track.quats),
        "object contact label": (labels == 1).any(axis=1),
        "body contact labels": labels[:, BODY_ORDER],
        "body rotations": se3.quat_to_xyzw(quats[:, BODY_ORDER]),
    }
    for name, value in values.items():
        matrix[:, FIELDS[name]] = np.asarray(value).reshape(clip.frames, -1)
    return matrix


def dictionary_of(clip: Clip, turned: bool = True) -> dict:
    """Return what a file of several objects holds, with the bodies' rotations turned or as SMPL-X has them."""
    single = columns_of(clip)
    data = np.zeros((clip.frames, 526 + 65 * len(clip.objects)), dtype=np.float32)
    data[:, :318], data[:, 318:526] = single[:, :318], single[:, 383:591]
    if not turned:
        quats = clip.people[0].joint_quats[:, BODY_ORDER]
        data[:, 318:526] = se3.quat_to_xyzw(quats).reshape(clip.frames, -1)
        data[:, 3:7] = data[:, 318:322]
    for index, track in enumerate(clip.objects):
        block = data[:, 526 + 65 * index : 526 + 65 * (index + 1)]
        block[:, :3], block[:, 3:7] = track.positions, se3.quat_to_xyzw(track.quats)
        labels = np.zeros((clip.frames, 52))
        for contact in clip.contacts:
            if contact.object == index:
                for joint in PARTS[contact.part].label_joints:
                    labels[contact.active, JOINT_INDEX[joint]] = 1.0
        block[:, 12], block[:, 13:65] = (labels == 1).any(axis=1), labels[:, BODY_ORDER]
    return {"data": data, "objects": [track.name for track in clip.objects], "joints": {}}


def theia_columns_of(clip: Clip) -> np.ndarray:
    """Return the (T, 594) tensor of a clip whose left hand holds the first of two objects, its right hand the other."""
    single = columns_of(clip)
    matrix = np.zeros((clip.frames, 594), dtype=np.float32)
    matrix[:, :318], matrix[:, theia.FIELDS["body rotations"]] = single[:, :318], single[:, FIELDS["body rotations"]]
    labels = np.zeros((clip.frames, len(JOINTS)))
    for k, (track, side) in enumerate(zip(clip.objects, theia.SIDES, strict=True), 1):
        matrix[:, theia.FIELDS[f"object {k} position"]] = track.positions
        matrix[:, theia.FIELDS[f"object {k} rotation"]] = se3.quat_to_xyzw(track.quats)
        for contact in clip.contacts:
            if contact.part == f"{side}_hand" and contact.object == k - 1:
                labels[:, [JOINT_INDEX[joint] for joint in PARTS[contact.part].label_joints]] = contact.active[:, None]
                matrix[:, theia.FIELDS[f"object {k} contact label"]] = contact.active[:, None]
    matrix[:, theia.FIELDS["body contact labels"]] = labels[:, BODY_ORDER]
    return matrix


def physhoi_columns_of(clip: Clip) -> np.ndarray:
    """Return the (T, 331) tensor of a clip of one object, which any hand touches where one of the contacts is."""
    person, track = clip.people[0], clip.objects[0]
    parents = [JOINT_INDEX[PARENT[name]] for name in BODIES[1:]]
    local = se3.quat_multiply(se3.quat_conjugate(person.joint_quats[:, parents]), person.joint_quats[:, BODY_ORDER[1:]])
    values = {
        "root position": person.position("pelvis"),
        "root angles": se3.log(person.quat("pelvis")),
        "root angles again": se3.log(person.quat("pelvis")),
        "joint angles": se3.log(local),
        "body positions": person.joint_positions[:, BODY_ORDER],
        "ball position": track.positions,
        "ball angles": -se3.log(track.quats),
        "contact label": np.any([contact.active for contact in clip.contacts], axis=0),
    }
    matrix = np.zeros((clip.frames, 331), dtype=np.float32)
    for name, value in values.items():
        matrix[:, physhoi.FIELDS[name]] = np.asarray(value).reshape(clip.frames, -1)
    return matrix


def write_clip(clip: Clip, path: Path, late_fingers: bool = False) -> None:
    """Write a clip as a torch file."""
    path.write_bytes(torch_bytes(columns_of(clip, late_fingers)))


def write_box(folder: Path, name: str, half_size: float = 0.2) -> None:
    """Write a cube as `folder/name/name.obj`."""
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    lines = [f"v {x} {y} {z}" for x, y, z in half_size * signs]
    lines += [f"f {a} {b} {c}" for a, b, c in ((1, 2, 3), (2, 3, 4), (5, 6, 7), (6, 7, 8))]
    (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / name / f"{name}.obj").write_text("\n".join(lines) + "\n")


_BONES = {
    "hip": (0.06, -0.1, 0.0),
    "knee": (0.02, -0.4, 0.0),
    "ankle": (0.0, -0.42, -0.04),
    "foot": (0.02, -0.06, 0.14),
}
_BONES |= {"collar": (0.05, 0.08, 0.0), "shoulder": (0.13, 0.05, 0.0), "elbow": (0.26, 0.0, 0.0), "wrist": (0.26, 0, 0)}


def rest_offset(joint: str) -> np.ndarray:
    """Return a joint's place in its parent's frame in a made-up but plausible body [m]."""
    side, _, name = joint.partition("_")
    if side not in ("left", "right"):
        return np.array([0.0, 0.15, 0.0])
    spread = 0.02 * ("index", "middle", "pinky", "ring", "thumb").index(name[:-1]) if name[-1].isdigit() else 0.0
    offset = np.array(_BONES.get(name, (0.09 if name.endswith("1") else 0.03, 0.0, 0.03 - spread)))
    return offset * [-1.0 if side == "right" else 1.0, 1.0, 1.0]


def random_clip(seed: int = 0, frames: int = 12) -> Clip:
    """Return a clip of rigid bones in random poses that carries something in random contact."""
    rng = np.random.default_rng(seed)
    quats = se3.exp(rng.normal(scale=0.5, size=(frames, 52, 3)))
    positions = np.zeros((frames, 52, 3))
    positions[:, 0] = rng.normal([0.0, 0.0, 0.9], 0.2, size=(frames, 3))
    for joint in sorted(JOINTS[1:], key=_depth):
        index, parent = JOINT_INDEX[joint], JOINT_INDEX[str(PARENT[joint])]
        positions[:, index] = positions[:, parent] + se3.rotate(quats[:, parent], rest_offset(joint))
    person = Person("person", positions, quats)
    geometry = ObjectGeometry(np.zeros((1, 3)))
    track = ObjectTrack("box", rng.normal(size=(frames, 3)), se3.exp(rng.normal(size=(frames, 3))), geometry)
    contacts = tuple(
        ContactTrack(0, 0, part, rng.random(frames) < 0.5, track.to_object(person.part_position(part)))
        for part in PARTS
    )
    return Clip("sub1_box_000", 30.0, (person,), (track,), contacts)


def _depth(joint: str) -> int:
    parent = PARENT[joint]
    return 0 if parent is None else 1 + _depth(parent)
