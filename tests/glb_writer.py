"""Writes a clip as HUMOTO's binary glTF files have it, for tests; by hand, without the library that reads it."""

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hoi_retarget.clip.clip import Clip
from hoi_retarget.human.skeleton import JOINTS, PARENT
from hoi_retarget.numerics import se3
from hoi_retarget.readers.humoto import BONES, PREFIX
from source_people import in_world, rest_joints

CENTIMETRE = 0.01
FLOAT, UINT = 5126, 5125
ENDS = ("HeadTop_End", "LeftToe_End", "RightToe_End", "LeftHandIndex4", "RightHandIndex4")


@dataclass
class Glb:
    """The tables of a file and its bytes, while they are put together; tests change the tables."""

    tables: dict[str, Any] = field(
        default_factory=lambda: {
            "asset": {"version": "2.0", "generator": "test"},
            "scene": 0,
            "scenes": [{"name": "Scene", "nodes": []}],
            **{name: [] for name in ("nodes", "meshes", "skins", "animations", "accessors", "bufferViews")},
        }
    )
    blob: bytearray = field(default_factory=bytearray)
    _known: dict[tuple[bytes, str], int] = field(default_factory=dict)

    def array(self, values: np.ndarray, kind: str) -> int:
        """Store an array, once, and return its accessor."""
        values = np.asarray(values)
        stored = values.astype("<u4" if values.dtype.kind in "iu" else "<f4")
        key = (stored.tobytes(), kind)
        if key in self._known:
            return self._known[key]
        self.tables["bufferViews"].append({"buffer": 0, "byteOffset": len(self.blob), "byteLength": stored.nbytes})
        self.blob += stored.tobytes()
        self.tables["accessors"].append(
            {
                "bufferView": len(self.tables["bufferViews"]) - 1,
                "componentType": UINT if stored.dtype.kind == "u" else FLOAT,
                "count": len(stored),
                "type": kind,
            }
        )
        self._known[key] = len(self.tables["accessors"]) - 1
        return self._known[key]

    def node(self, name: str, parent: int | None = None, **values: Any) -> int:
        """Add a node and return its index."""
        nodes = self.tables["nodes"]
        nodes.append({"name": name, **values})
        (self.tables["scenes"][0]["nodes"] if parent is None else nodes[parent].setdefault("children", [])).append(
            len(nodes) - 1
        )
        return len(nodes) - 1

    def animate(self, animation: dict[str, Any], node: int, path: str, times: np.ndarray, values: np.ndarray) -> None:
        """Add a channel; values that never change become two keys."""
        if (values == values[0]).all():
            times, values = times[[0, -1]], values[[0, -1]]
        if path == "rotation":
            values = se3.quat_to_xyzw(se3.quat_continuous(values))
        sampler = {
            "input": self.array(times[:, None], "SCALAR"),
            "output": self.array(values, "VEC4" if path == "rotation" else "VEC3"),
            "interpolation": "LINEAR",
        }
        animation["samplers"].append(sampler)
        animation["channels"].append(
            {"sampler": len(animation["samplers"]) - 1, "target": {"node": node, "path": path}}
        )

    def content(self) -> bytes:
        """Return the file's bytes."""
        self.tables["buffers"] = [{"byteLength": len(self.blob)}]
        text = json.dumps(self.tables).encode()
        text += b" " * (-len(text) % 4)
        blob = bytes(self.blob) + b"\0" * (-len(self.blob) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(blob), 0x004E4942) + blob
        return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks

    def write(self, path: Path) -> Path:
        """Write the file, which is returned."""
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(self.content())
        return path


def bind_quats(seed: int = 3) -> dict[str, np.ndarray]:
    """Rotations of the bones in the bind pose, each with axes of its own, as Mixamo's have."""
    rng = np.random.default_rng(seed)
    return {joint: se3.quat_normalize(rng.normal(size=4)) for joint in JOINTS}


def bound_arms_down(degrees: float) -> dict[str, np.ndarray]:
    """How the joints of a bind pose are turned from the T-pose: arms hang down by so much."""
    turns = {}
    for side, sign in (("left", -1.0), ("right", 1.0)):
        turn = se3.exp(np.array([0.0, 0.0, sign * np.deg2rad(degrees)]))
        for joint in JOINTS:
            chain = joint
            while chain is not None and chain != f"{side}_shoulder":
                chain = PARENT[chain]
            if chain is not None:
                turns[joint] = turn
    return turns


def humoto(
    clip: Clip,
    *,
    stamp: float = 24.0,
    first: int = 1,
    bound: Mapping[str, np.ndarray] | None = None,
    turned: np.ndarray = se3.IDENTITY_QUAT,
    height: float | None = None,
) -> Glb:
    """The first person and all objects of a clip in HUMOTO's layout.

    Args:
        clip: z up.
        stamp: keys a second that the file says.
        first: the frame that it begins with.
        bound: how joints are turned from the T-pose while the mesh is bound; not at all by default.
        turned: of the armature's node, under which the bones are turned back.
        height: from the toes to the top of the head while the mesh is bound [m]; by default the person's.
    """
    world, glb = in_world(clip, "y"), Glb()
    times = (first + np.arange(clip.frames)) / stamp
    _body(glb, world, times, bound or {}, turned=turned, height=height or clip.people[0].height)
    for track in world.objects:
        vertices, faces = track.geometry.points, track.geometry.faces
        assert faces is not None
        half = len(faces) // 2
        corners = glb.array(vertices, "VEC3")
        glb.tables["meshes"].append(
            {
                "name": track.name,
                "primitives": [
                    {"attributes": {"POSITION": corners}, "indices": glb.array(part.reshape(-1, 1), "SCALAR")}
                    for part in (faces[:half], faces[half:])
                ],
            }
        )
        node = glb.node(track.name, mesh=len(glb.tables["meshes"]) - 1)
        animation = {"name": f"{track.name}|Scene.001", "samplers": [], "channels": []}
        glb.animate(animation, node, "translation", times, track.positions)
        glb.animate(animation, node, "rotation", times, track.quats)
        glb.animate(animation, node, "scale", times, np.ones((clip.frames, 3)))
        glb.tables["animations"].append(animation)
    return glb


def _body(
    glb: Glb, world: Clip, times: np.ndarray, bound: Mapping[str, np.ndarray], *, turned: np.ndarray, height: float
) -> None:
    person, frames = world.people[0], world.frames
    own = bind_quats()
    rest = _bound_joints(rest_joints(person, "smplh"), bound)
    armature = glb.node("Armature", scale=[CENTIMETRE] * 3, rotation=se3.quat_to_xyzw(turned).tolist())
    # Bones in the armature's frame: centimetres, turned back.
    quats = {
        joint: se3.quat_multiply(
            se3.quat_conjugate(turned),
            se3.quat_multiply(
                person.quat(joint),
                se3.quat_multiply(se3.quat_conjugate(bound.get(joint, se3.IDENTITY_QUAT)), own[joint]),
            ),
        )
        for joint in JOINTS
    }
    places = {joint: se3.rotate_inverse(turned, person.position(joint)) / CENTIMETRE for joint in JOINTS}
    nodes: dict[str, int] = {}
    animation = {"name": "Armature|Scene", "samplers": [], "channels": []}
    for joint in JOINTS:
        parent = PARENT[joint]
        nodes[joint] = glb.node(f"{PREFIX}{BONES[joint]}", parent=armature if parent is None else nodes[parent])
        if parent is None:
            offsets, turns = places[joint], quats[joint]
        else:
            offsets = se3.rotate_inverse(quats[parent], places[joint] - places[parent])
            # The bones are rigid: what they measure is a constant, to the bit.
            offsets = np.tile(offsets.mean(axis=0), (frames, 1)) if np.ptp(offsets, axis=0).max() < 1e-6 else offsets
            turns = se3.quat_multiply(se3.quat_conjugate(quats[parent]), quats[joint])
        glb.animate(animation, nodes[joint], "translation", times, offsets)
        glb.animate(animation, nodes[joint], "rotation", times, turns)
        glb.animate(animation, nodes[joint], "scale", times, np.ones((frames, 3)))
    ends = [glb.node(f"{PREFIX}{name}", parent=nodes["head"], translation=[0.0, 10.0, 0.0]) for name in ENDS]
    glb.tables["animations"].append(animation)
    inverse = np.tile(np.eye(4), (len(JOINTS) + len(ENDS), 1, 1))
    lowest = min(place[1] for place in rest.values())
    head_top = np.array([rest["head"][0], lowest + height, rest["head"][2]])
    inverse[len(JOINTS), :3] *= 1 / CENTIMETRE
    inverse[len(JOINTS), :3, 3] = -se3.rotate_inverse(turned, head_top) / CENTIMETRE
    for index, joint in enumerate(JOINTS):
        turn = se3.quat_to_matrix(se3.quat_multiply(se3.quat_conjugate(turned), own[joint]))
        inverse[index, :3, :3] = turn.T / CENTIMETRE
        inverse[index, :3, 3] = -turn.T @ se3.rotate_inverse(turned, rest[joint]) / CENTIMETRE
    glb.tables["skins"].append(
        {
            "joints": [*nodes.values(), *ends],
            "inverseBindMatrices": glb.array(inverse.transpose(0, 2, 1).reshape(-1, 16), "MAT4"),
        }
    )
    _bind_skin(glb, rest, bound, turned, ends=len(ENDS))
    glb.node("body", parent=armature, mesh=len(glb.tables["meshes"]) - 1, skin=0)


SKIN_OFFSETS = 0.02 * np.eye(3)
"""[m]; of a joint's three vertices, in its axes."""


def _bind_skin(
    glb: Glb, rest: Mapping[str, np.ndarray], bound: Mapping[str, np.ndarray], turned: np.ndarray, *, ends: int
) -> None:
    """Add a triangle at each joint that it moves alone, and one on the head that the last of the bones moves half."""
    turns = {joint: bound.get(joint, se3.IDENTITY_QUAT) for joint in JOINTS}
    corners = np.stack([rest[joint] + se3.rotate(turns[joint][None], SKIN_OFFSETS) for joint in (*JOINTS, "head")])
    joints = np.zeros((len(corners), 3, 4), dtype=int)
    joints[:, :, 0] = np.array([*range(len(JOINTS)), JOINTS.index("head")])[:, None]
    joints[-1, :, 1] = len(JOINTS) + ends - 1
    weights = np.zeros(joints.shape)
    weights[:, :, 0] = 1.0
    weights[-1, :, :2] = 0.5
    attributes = {
        "POSITION": glb.array(se3.rotate_inverse(turned[None], corners.reshape(-1, 3)), "VEC3"),
        "JOINTS_0": glb.array(joints.reshape(-1, 4), "VEC4"),
        "WEIGHTS_0": glb.array(weights.reshape(-1, 4), "VEC4"),
    }
    glb.tables["meshes"].append({"name": "body", "primitives": [{"attributes": attributes}]})


def _bound_joints(rest: np.ndarray, bound: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Where the joints are while the mesh is bound, from where they are in the T-pose."""
    at = dict(zip(JOINTS, rest, strict=True))
    places: dict[str, np.ndarray] = {}
    for joint in JOINTS:
        parent = PARENT[joint]
        if parent is None:
            places[joint] = at[joint]
        else:
            turn = bound.get(parent, se3.IDENTITY_QUAT)
            places[joint] = places[parent] + se3.rotate(turn, at[joint] - at[parent])
    return places
