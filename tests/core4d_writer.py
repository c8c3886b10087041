"""Writes CORE4D's recordings in their makers' layout: a clip of two people, turned y up, as parameters and joints."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from hoi_retarget.clip.clip import Clip
from hoi_retarget.human.person import Person
from hoi_retarget.numerics import se3
from hoi_retarget.readers.body_parameters import load_body_model
from mesh_writer import write_mesh
from source_people import betas_of, in_world, parameters_of, write_models

COMPONENTS = 12


def write_world(folder: Path, clip: Clip) -> tuple[Path, Path, Clip]:
    """Write the body model and the recording; return their folders, and the clip as its hands' components leave it."""
    models = write_models(folder / "models", clip.people, "smplx", ["neutral"], shapes=12)
    model = load_body_model(models, "neutral", "smplx")
    turned = in_world(clip, "y")
    sequence = folder / "CORE4D_Real" / "human_object_motions" / "20231002" / "004"
    people = []
    for index, person in enumerate(turned.people):
        values = _person_values(model, person, betas_of(index, 10))
        save_person(sequence / f"person{index + 1}_poses.npz", values)
        people.append(_written_person(model, clip.people[index], values))
    track = turned.objects[0]
    poses = np.tile(np.eye(4), (clip.frames, 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = se3.quat_to_matrix(track.quats), track.positions
    np.save(sequence / "smooth_objposes.npy", poses)
    (sequence / "object_metadata.json").write_text(json.dumps({"obj_name": "Table021"}))
    write_mesh(folder / "CORE4D_Real" / "object_models" / "table" / "table021_m.obj", track.geometry)
    expected = replace(clip, people=tuple(people), objects=(replace(clip.objects[0], name="table021"),))
    return sequence, models, expected


def save_person(path: Path, values: dict) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, np.array(values, dtype=object))


def load_person(path: Path) -> dict:
    with np.load(path, allow_pickle=True) as archive:
        return archive["arr_0"].item()


def _person_values(model, person: Person, betas: np.ndarray) -> dict:
    parameters = parameters_of(person, "smplx")
    frames = len(parameters["root"])
    # The components are at right angles to each other.
    left = parameters["left_hand"] @ model.left_components[:COMPONENTS].T
    right = parameters["right_hand"] @ model.right_components[:COMPONENTS].T
    body = np.concatenate([parameters["root"], parameters["body"]], axis=1)
    pose = model.pose(body, left, right, flat_hands=True)
    joints, _ = model.joints(betas, pose, parameters["translation"])
    rest = np.random.default_rng(0).normal(size=(frames, 127 - joints.shape[1], 3))
    return {
        "betas": np.tile(betas, (frames, 1)),
        "global_orient": parameters["root"],
        "transl": parameters["translation"],
        "body_pose": parameters["body"].reshape(frames, 21, 3),
        "left_hand_pose": left,
        "right_hand_pose": right,
        "joints": np.concatenate([joints, rest], axis=1),
        "vertices": np.zeros((frames, 9, 3), dtype=np.float32),
        "expression": np.zeros((frames, 10)),
    }


def _written_person(model, person: Person, values: dict) -> Person:
    """The person in a world with z up, with the hands that the components can say."""
    frames = len(values["joints"])
    parameters = parameters_of(person, "smplx")
    body = np.concatenate([parameters["root"], parameters["body"]], axis=1)
    pose = model.pose(body, values["left_hand_pose"], values["right_hand_pose"], flat_hands=True)
    positions, quats = model.joints(values["betas"][0], pose, parameters["translation"])
    kept = model.skeleton_joints
    assert frames == len(positions)
    return Person(person.name, positions[:, kept], quats[:, kept])
