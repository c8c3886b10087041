"""Writes clips in OMOMO's own layout: one file, and scans neither centred nor of the object's size."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from hoi_retarget.clip.clip import Clip
from hoi_retarget.human.skeleton import BODY_PARENTS
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectTrack
from joblib_writer import write_joblib
from mesh_writer import write_mesh
from source_people import PELVIS, betas_of, parameters_of, rest_joints

SCALE = 0.4
FILE = "train_diffusion_manip_seq_joints24.p"


def clip_values(clip: Clip, name: str, *, body: int = 0) -> dict:
    """What the file has of a clip; `body` tells which of the model's people it is; a second object is a lower part."""
    person = clip.people[0]
    parameters = parameters_of(person, "smplx")
    rest = rest_joints(person, "smplx")
    offsets = np.zeros((24, 3))
    for joint, parent in enumerate(BODY_PARENTS):
        offsets[joint] = rest[joint] - rest[parent] if parent >= 0 else rest[joint]
    offsets[22:] = [[0.1, 0.0, 0.02], [-0.1, 0.0, 0.02]]
    values = {
        "seq_name": name,
        "betas": betas_of(body, 16)[None],
        "gender": np.array("male"),
        "trans": parameters["translation"],
        "root_orient": parameters["root"].astype(np.float32),
        "pose_body": parameters["body"],
        "rest_offsets": offsets,
        "trans2joint": -PELVIS,
        "obj_com_pos": clip.objects[0].positions,
        **_object_values("obj", clip.objects[0]),
    }
    if len(clip.objects) > 1:
        values |= _object_values("obj_bottom", clip.objects[1])
    return values


def _object_values(key: str, track: ObjectTrack) -> dict:
    return {
        f"{key}_trans": track.positions[..., None],
        f"{key}_rot": se3.quat_to_matrix(track.quats),
        f"{key}_scale": np.full(len(track.positions), SCALE),
    }


def write_scan(folder: Path, name: str, track: ObjectTrack) -> Path:
    """Write an object's scan, of another size than the object."""
    geometry = replace(track.geometry, points=track.geometry.points / SCALE)
    return write_mesh(folder / "captured_objects" / f"{name}.obj", geometry)


def write_clips(folder: Path, clips: list[dict], **settings) -> Path:
    return write_joblib(folder / FILE, dict(enumerate(clips)), **settings)
