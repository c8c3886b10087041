"""Writes a clip as CARI4D writes what it reconstructs from a video, for tests: the `.pth` and the object's mesh."""

import sys
import types
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from hoi_retarget.clip.clip import Clip
from hoi_retarget.numerics import se3
from source_people import betas_of, in_world, parameters_of
from torch_writer import torch_bytes

VIDEO = "Date03_Sub01_box_wild002"
BEHAVE = "Date03_Sub03_box_lift"
BETAS = 10


@dataclass
class TrainState:
    """What CARI4D keeps of how far its optimization has come."""

    epoch: int = 0
    step: int = 3000
    best_val: float | None = None


TrainState.__module__ = "learning.training.training_utils"


def index_names(sequence: str, frames: int) -> list[str]:
    """How CARI4D calls the frames of a video."""
    return [f"{sequence}/{index:06d}" for index in range(frames)]


def time_names(sequence: str, frames: int, fps: float) -> list[str]:
    """How CARI4D calls the frames of a sequence of BEHAVE."""
    return [f"{sequence}/t{3.0 + index / fps:08.3f}" for index in range(frames)]


def prediction(
    clip: Clip, sequence: str = VIDEO, *, centre: np.ndarray | None = None, hands: dict | None = None
) -> dict[str, Any]:
    """The prediction of the first person and the first object, with scores from the clip's contacts.

    Args:
        clip: z up.
        sequence: what the video is called.
        centre: of the mesh's vertices in the object's frame, where poses are of the mesh less this mean.
        hands: a body model's arrays, where fingers are its mean hand's and not stored.
    """
    camera = in_world(clip, "-y")
    person, track = camera.people[0], camera.objects[0]
    values = parameters_of(person, "smplh")
    frames = clip.frames
    pose = np.zeros((frames, 4, 4))
    pose[:, :3, :3], pose[:, 3, 3] = se3.quat_to_matrix(track.quats), 1.0
    pose[:, :3, 3] = track.positions
    if centre is not None:
        pose[:, :3, 3] += se3.rotate(track.quats, centre[None])
    fingers = [values["left_hand"], values["right_hand"]] if hands is None else [np.zeros((frames, 6))]
    return {
        "frames": index_names(sequence, frames),
        "pose_abs": pose,
        "smpl_pose": np.concatenate([values["root"], values["body"], *fingers], axis=1),
        "smpl_t": values["translation"],
        "betas": np.tile(betas_of(0, BETAS), (frames, 1)),
        "contact_logits": np.stack([_scores(clip, part) for part in ("left_hand", "right_hand")], axis=1),
        "optimizer": None,
        "scheduler": None,
        "pth_file": f"output/coconet/{sequence}.pth",
        "train_state": TrainState(),
    }


def _scores(clip: Clip, part: str) -> np.ndarray:
    active = np.any([track.active for track in clip.contacts if track.part == part], axis=0)
    return np.where(active, 2.5, -1.5)


def write(path: Path, values: dict[str, Any]) -> Path:
    """Write predictions as CARI4D saves them, beside what went into them."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(encoded(values))
    return path


def encoded(values: dict[str, Any]) -> bytes:
    """The bytes of a file with these predictions."""
    modules = {name: types.ModuleType(name) for name in ("learning", "learning.training", TrainState.__module__)}
    vars(modules[TrainState.__module__])["TrainState"] = TrainState
    inputs = {key: value for key, value in values.items() if key in ("frames", "smpl_pose", "smpl_t")}
    with mock.patch.dict(sys.modules, modules):
        return torch_bytes({"gt": {"frames": [], "pose_abs": []}, "pr": values, "in": inputs})


def write_mesh(
    folder: Path, clip: Clip, sequence: str = VIDEO, *, offset: tuple[float, float, float] = (0, 0, 0)
) -> Path:
    """Write the mesh of the first object, shifted, into a folder of the sequence's; the folder around is returned."""
    geometry = clip.objects[0].geometry
    assert geometry.faces is not None
    path = folder / f"{sequence}.0.color.mp4_000_rgba" / f"{sequence}.0.color.mp4_000_align.obj"
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in (geometry.points + np.asarray(offset)).tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (geometry.faces + 1).tolist()]
    path.write_text("\n".join(lines))
    return folder
