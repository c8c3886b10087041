"""Writes ParaHome's recordings in their makers' layout: their own skeleton, the fit of SMPL-X, and parts of objects."""

import io
import json
import pickle
import sys
import types
from collections import OrderedDict
from pathlib import Path
from unittest import mock

import numpy as np

from hoi_retarget.clip.clip import Clip
from hoi_retarget.human.person import Person
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectTrack
from mesh_writer import write_mesh
from source_people import betas_of, parameters_of, write_models
from torch_writer import REBUILD, Storage, legacy_bytes

BODY = (
    "pelvis",
    *("spine1", "spine2", "spine3", "neck", "head"),
    *(f"{side}_{joint}" for side in ("right", "left") for joint in ("collar", "shoulder", "elbow", "wrist")),
    *(f"{side}_{joint}" for side in ("right", "left") for joint in ("hip", "knee", "ankle", "foot")),
)
"""What is at ParaHome's joints of the body, the root between the hips left out."""
HAND = {
    1: "thumb1",
    6: "pinky1",
    7: "pinky2",
    8: "pinky3",
    10: "ring1",
    11: "ring2",
    12: "ring3",
    14: "middle1",
    15: "middle2",
    16: "middle3",
    18: "index1",
    19: "index2",
    20: "index3",
    22: "thumb2",
    23: "thumb3",
}
"""What is at the joints of a hand that have a counterpart."""
T_POSE = se3.matrix_to_quat(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
"""From our T-pose to ParaHome's, which has x forward, y to the left and z up."""


def joints_of(person: Person) -> np.ndarray:
    """The 73 joints of a person, (T, 73, 3) [m]."""
    root = 0.5 * (person.position("left_hip") + person.position("right_hip"))
    joints = [root, *(person.position(joint) for joint in BODY)]
    for side in ("left", "right"):
        wrist = person.position(f"{side}_wrist")
        joints += [person.position(f"{side}_{HAND[index]}") if index in HAND else wrist for index in range(25)]
    return np.stack(joints, axis=1)


def skeleton_of(person: Person, t_pose: np.ndarray = T_POSE) -> dict[str, np.ndarray]:
    """What the files of the own skeleton hold, by their names."""
    # The root and the lowest joint of the spine both turn as the pelvis does.
    quats = np.stack([person.quat(joint) for joint in ("pelvis", *BODY)], axis=1)
    world = se3.quat_multiply(quats, se3.quat_conjugate(t_pose))
    frame = se3.quat_multiply(se3.exp(np.array([0.1, 0.2, 0.9])), person.quat("pelvis"))
    transforms = np.tile(np.eye(4), (len(frame), 1, 1))
    transforms[:, :3, :3], transforms[:, :3, 3] = se3.quat_to_matrix(frame), person.position("pelvis")
    local = se3.quat_to_matrix(se3.quat_multiply(se3.quat_conjugate(frame)[:, None], world))
    return {
        "joint_positions.pkl": joints_of(person),
        "body_global_transform.pkl": transforms,
        "body_joint_orientations.pkl": local[:, :, :2].reshape(len(frame), 23, 6),
    }


def poses_of(tracks: list[ObjectTrack]) -> dict[int, dict[str, np.ndarray]]:
    """A matrix for each part in each frame."""
    matrices = {}
    for track in tracks:
        poses = np.tile(np.eye(4), (len(track.positions), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = se3.quat_to_matrix(track.quats), track.positions
        matrices[track.name] = poses
    return {
        frame: {name: poses[frame] for name, poses in matrices.items()} for frame in range(len(tracks[0].positions))
    }


def write_pickle(path: Path, value: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(pickle.dumps(value, protocol=4))


def write_recording(folder: Path, clip: Clip, intervals: dict[str, str]) -> Path:
    """Write a recording of one person; return its folder."""
    sequence, person = folder / "data" / "seq" / "s10", clip.people[0]
    for name, array in skeleton_of(person).items():
        write_pickle(sequence / name, array)
    write_pickle(sequence / "object_transformations.pkl", poses_of(list(clip.objects)))
    (sequence / "text_annotation.json").write_text(json.dumps(intervals))
    scene = {track.name.rpartition("_")[0]: True for track in clip.objects} | {"pan": False}
    (sequence / "object_in_scene.json").write_text(json.dumps(scene))
    for track in clip.objects:
        thing, _, part = track.name.rpartition("_")
        write_mesh(folder / "data" / "scan" / thing / "simplified" / f"{part}.obj", track.geometry)
    write_fit(folder / "data" / "smplx_seq" / "s10", person)
    return sequence


def write_fit(folder: Path, person: Person) -> None:
    """Write the fit of SMPL-X as tensors in plain pickles; the person is the second body of the model."""
    parameters = parameters_of(person, "smplx")
    pose = {
        "body_pose": parameters["body"],
        "global_orient": parameters["root"],
        "transl": parameters["translation"],
        "hand_pose": np.concatenate([parameters["left_hand"], parameters["right_hand"]], axis=1),
    }
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "smplx_pose.pkl").write_bytes(tensor_pickle(pose))
    (folder / "smplx_params.pkl").write_bytes(tensor_pickle({"beta": betas_of(1, 20)[None], "gender": "female"}))


def write_model(folder: Path, other: Person, person: Person) -> Path:
    """Write a body model whose second body is the person."""
    return write_models(folder, [other, person], "smplx", ["female"], shapes=400)


_STORAGE = types.ModuleType("torch.storage")
_LOAD = type("_load_from_bytes", (), {"__module__": _STORAGE.__name__, "__qualname__": "_load_from_bytes"})
vars(_STORAGE)["_load_from_bytes"] = _LOAD
_UTILS = types.ModuleType("torch._utils")
vars(_UTILS)["_rebuild_tensor_v2"] = REBUILD


class _Pickler(pickle.Pickler):
    """Writes arrays as tensors, as `pickle.dump` writes these."""

    def reducer_override(self, obj):
        if isinstance(obj, np.ndarray):
            flat = np.array(obj, order="C")
            steps = tuple(step // flat.itemsize for step in flat.strides)
            return REBUILD, (Storage(flat.reshape(-1)), 0, obj.shape, steps, False, OrderedDict())
        if isinstance(obj, Storage):
            return _LOAD, (legacy_bytes(obj),)
        return NotImplemented


def tensor_pickle(value: object, protocol: int = 4) -> bytes:
    """What `pickle.dumps` writes of a value whose arrays are tensors."""
    file = io.BytesIO()
    modules = {"torch": types.ModuleType("torch"), "torch._utils": _UTILS, "torch.storage": _STORAGE}
    with mock.patch.dict(sys.modules, modules):
        _Pickler(file, protocol=protocol).dump(value)
    return file.getvalue()
