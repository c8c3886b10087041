"""Writes clips: joints as they were read, whatever they were read from."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import WriteError
from hoi_retarget.files.atomic import write_atomically
from hoi_retarget.human.skeleton import JOINTS
from hoi_retarget.objects.track import ObjectTrack
from hoi_retarget.readers.own_layout.layout import HEIGHTS, SCHEMA, SCHEMA_KEY, UNIT, UP


def write(clip: Clip, path: Path) -> None:
    """Write a clip so that reading it gives the same people, objects, contacts, notes and licence.

    Raises:
        WriteError: the file cannot be written, the mesh of an object is not in the file's folder, or parts are pinned.
    """
    write_atomically(path, encode(clip, path.parent))


def encode(clip: Clip, folder: Path) -> bytes:
    """Return the content of a clip's file that will lie in `folder`; raises `WriteError` as `write`."""
    if clip.pins:
        raise WriteError(
            f"clip {clip.name!r}: its file has no place for pins. Write it as recorded, and keep the edits."
        )
    values: dict[str, Any] = {
        SCHEMA_KEY: np.int64(SCHEMA),
        "name": np.str_(clip.name),
        "fps": np.float64(clip.fps),
        "up": np.str_(UP),
        "unit": np.str_(UNIT),
        "licence": np.str_(clip.source.licence),
        "notes": np.array(clip.source.notes, dtype=np.str_),
        "first_source_frame": np.int64(clip.first_source_frame),
        "joint_names": np.array(JOINTS, dtype=np.str_),
        "person_names": np.array([person.name for person in clip.people], dtype=np.str_),
        "joint_pos": np.stack([person.joint_positions for person in clip.people], axis=1),
        "joint_quat": np.stack([person.joint_quats for person in clip.people], axis=1),
        "object_names": np.array([track.name for track in clip.objects], dtype=np.str_),
    }
    if any(person.stature is not None for person in clip.people):
        values[HEIGHTS] = np.array([person.height for person in clip.people])
    if clip.objects:
        values["object_pos"] = np.stack([track.positions for track in clip.objects], axis=1)
        values["object_quat"] = np.stack([track.quats for track in clip.objects], axis=1)
    for index, track in enumerate(clip.objects):
        values |= _shape_values(index, track, folder)
    if clip.contacts:
        values |= {
            "contact_part": np.array([track.part for track in clip.contacts], dtype=np.str_),
            "contact_person": np.array([track.person for track in clip.contacts], dtype=np.int64),
            "contact_object": np.array([track.object for track in clip.contacts], dtype=np.int64),
            "contact_flags": np.stack([track.active for track in clip.contacts], axis=1),
            "contact_points": np.stack([track.contact_points for track in clip.contacts], axis=1),
        }
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **values)
    return buffer.getvalue()


def _shape_values(index: int, track: ObjectTrack, folder: Path) -> dict[str, Any]:
    geometry = track.geometry
    values: dict[str, Any] = {f"object_{index}_points": geometry.points}
    if geometry.faces is not None:
        values[f"object_{index}_faces"] = geometry.faces
    elif geometry.mesh_path is not None:
        try:
            inside = geometry.mesh_path.resolve().relative_to(folder.resolve())
        except ValueError as error:
            raise WriteError(
                f"object {track.name!r}: its mesh {geometry.mesh_path} is not in the folder of the clip, {folder}. "
                "Put it there, or give the object faces."
            ) from error
        values[f"object_{index}_mesh"] = np.str_(inside.as_posix())
    return values
