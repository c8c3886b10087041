"""Writes clips in GRAB's own layout, for tests."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from body_writer import write_npz
from hand_components import add_components
from hoi_retarget.clip.clip import Clip
from hoi_retarget.human.skeleton import JOINTS
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectTrack
from mesh_writer import export_mesh
from source_people import body_values, parameters_of
from synthetic import make

SUBJECT, GENDER, OBJECT = "s1", "male", "stool"
COMPONENTS = 24
TEMPLATE = f"tools/subject_meshes/{GENDER}/{SUBJECT}.ply"
MESHES = "tools/object_meshes/contact_meshes"
PALMS = {"left_hand": 21, "right_hand": 22}
FINGERS = {"left_hand": 31, "right_hand": 46}
"""Labels of the middle fingers' tips."""
VERTICES = 7  # Labelled ones of the object.


def clip_on_table(seconds: float = 2.5) -> Clip:
    """A clip of a person, an object and a table that stands there."""
    clip = make("move_chair", seconds=seconds, fps=120.0)
    geometry = make("push_table", seconds=1.0).objects[0].geometry
    quats = np.tile(se3.exp(np.array([0.0, 0.0, 0.4])), (clip.frames, 1))
    table = ObjectTrack("table", np.tile([1.5, 0.5, 0.4], (clip.frames, 1)), quats, geometry)
    return replace(clip, objects=(replace(clip.objects[0], name=OBJECT), table))


def members_of(clip: Clip, *, inverted: bool = True) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What the file holds, and the arrays of the body model, whose template is somebody else."""
    model = body_values(clip.people[:1], "smplx")
    person = parameters_of(clip.people[0], "smplx", model)
    hands = add_components(model, person, COMPONENTS)
    labels = np.zeros((clip.frames, VERTICES), dtype=np.int8)
    for track in clip.contacts:
        labels[track.active, 1 + list(FINGERS).index(track.part)] = FINGERS[track.part]
    tables = [
        {
            "params": {
                "global_orient": se3.log(se3.quat_conjugate(track.quats) if inverted else track.quats),
                "transl": track.positions,
            }
        }
        for track in clip.objects
    ]
    members = {
        "gender": GENDER,
        "sbj_id": SUBJECT,
        "obj_name": OBJECT,
        "motion_intent": "lift",
        "framerate": clip.fps,
        "n_frames": clip.frames,
        "n_comps": COMPONENTS,
        "body": {
            "params": {
                "global_orient": person["root"],
                "body_pose": person["body"],
                "transl": person["translation"],
                "left_hand_pose": hands["left_hand"],
                "right_hand_pose": hands["right_hand"],
                "fullpose": np.zeros((clip.frames, 165)),
            },
            "vtemp": TEMPLATE,
        },
        "lhand": {"vtemp": "tools/subject_meshes/male/s1_lhand.ply"},
        "rhand": {"vtemp": "tools/subject_meshes/male/s1_rhand.ply"},
        "object": tables[0] | {"object_mesh": f"{MESHES}/{OBJECT}.ply"},
        "table": tables[1] | {"table_mesh": f"{MESHES}/table.ply"},
        "contact": {"body": np.zeros((clip.frames, len(JOINTS)), dtype=np.int8), "object": labels},
    }
    return members, model


def write_members(root: Path, members: dict[str, Any]) -> Path:
    """Write the file into its tree."""
    path = root / "grab" / SUBJECT / "stool_lift.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **members)
    return path


def write_tools(root: Path, clip: Clip, model: dict[str, np.ndarray]) -> None:
    """Write the subject's body and the meshes of the objects."""
    for track in clip.objects:
        export_mesh(root / MESHES / f"{track.name}.ply", track.geometry.points, track.geometry.faces)
    export_mesh(root / TEMPLATE, model["v_template"], model["f"])


def write_model(folder: Path, model: dict[str, np.ndarray]) -> Path:
    """Write the body model, whose own template is another body than the subject's."""
    another = model | {"v_template": np.random.default_rng(1).normal(size=model["v_template"].shape)}
    write_npz(folder / f"SMPLX_{GENDER.upper()}.npz", another)
    return folder
