"""Writes people without objects as AMASS's and GVHMR's files, with the models that read them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hoi_retarget.clip.clip import Clip
from hoi_retarget.human.body_model import Family
from source_people import betas_of, in_world, joined, parameters_of, write_taller_model
from synthetic import make
from torch_writer import torch_bytes

GENDER = "female"
SHAPES = 30  # Of SMPL-X's files with 20, only ten are of shape.


def alone(scene: str = "carry_box", **settings: Any) -> Clip:
    """A synthetic clip's first person, with nothing around."""
    clip = make(scene, **settings)
    return replace(clip, people=clip.people[:1], objects=(), contacts=())


def write_model(folder: Path, clip: Clip, family: Family, gender: str) -> Path:
    """Write the model of a taller body, which the first beta makes the clip's person; its folder is returned."""
    return write_taller_model(folder, clip.people[0], family, gender, shapes=SHAPES)


def amass_arrays(clip: Clip, family: Family) -> dict[str, Any]:
    """The arrays of AMASS's release for a family of models."""
    numbers = parameters_of(clip.people[0], family)
    hands = np.concatenate([numbers["left_hand"], numbers["right_hand"]], axis=1)
    face = np.zeros((clip.frames, 9))
    body = np.concatenate([numbers["root"], numbers["body"]], axis=1)
    common = {"trans": numbers["translation"], "gender": np.array(GENDER), "betas": betas_of(1, 16)}
    if family == "smplh":
        return common | {
            "mocap_framerate": np.array(clip.fps),
            "dmpls": np.zeros((clip.frames, 8)),
            "poses": joined(numbers),
        }
    return common | {
        "mocap_frame_rate": np.array(clip.fps),
        "mocap_time_length": np.array(clip.frames / clip.fps),
        "surface_model_type": np.array("smplx"),
        "num_betas": np.array(16),
        "poses": np.concatenate([body, face, hands], axis=1),
        "root_orient": numbers["root"],
        "pose_body": numbers["body"],
        "pose_hand": hands,
        "pose_jaw": face[:, :3],
        "pose_eye": face[:, 3:],
        "markers_latent": np.zeros((41, 3)),
        "latent_labels": np.array(["C7", "CLAV"]),
    }


def write_amass(root: Path, clip: Clip, family: Family) -> tuple[Path, Path]:
    """Write a recording; return its file and the folder of models."""
    path = root / "ACCAD" / "Walk_stageii.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **amass_arrays(clip, family))
    return path, write_model(root / "models", clip, family, GENDER)


def gvhmr_arrays(clip: Clip, up: str = "y") -> dict[str, np.ndarray]:
    """What GVHMR tells of the person in the world, in single precision, perhaps turned afterwards."""
    numbers = parameters_of(in_world(clip, up).people[0], "smplx")
    arrays = {
        "global_orient": numbers["root"],
        "body_pose": numbers["body"],
        "transl": numbers["translation"],
        "betas": np.repeat(betas_of(1, 10)[None], clip.frames, axis=0),
    }
    return {name: values.astype(np.float32) for name, values in arrays.items()}


def write_gvhmr(root: Path, clip: Clip, **changes: Any) -> tuple[Path, Path]:
    """Write what GVHMR makes of a video called `walk`, with other arrays; return its file and the folder of models."""
    path = root / "walk" / "hmr4d_results.pt"
    path.parent.mkdir(parents=True, exist_ok=True)
    person = gvhmr_arrays(clip) | changes
    camera = np.tile(np.eye(3, dtype=np.float32), (clip.frames, 1, 1))
    incam = {**person, "transl": np.zeros((clip.frames, 3), dtype=np.float32)}
    others = {"smpl_params_incam": incam, "K_fullimg": camera, "net_outputs": {"model_output": {"pred": camera}}}
    path.write_bytes(torch_bytes({"smpl_params_global": person, **others}))
    return path, write_model(root / "models", clip, "smplx", "neutral")
