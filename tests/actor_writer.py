"""Writes clips as HiPHI's and OmniContact's folders: an actor's BVH, objects' tracks as CSV, meshes in centimetres."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from bvh_writer import MIXAMO, MIXAMO_FINGERS, Rig, write_person
from hoi_retarget.clip.augment import mirrored
from hoi_retarget.clip.clip import Clip
from hoi_retarget.objects.track import ObjectTrack
from mesh_writer import write_mesh
from source_people import in_world, moved

RIG = Rig(MIXAMO | MIXAMO_FINGERS, order="ZXY", top=0.18, moves=True)
COLUMNS = ("frame", "time_sec", "px", "py", "pz", "qx", "qy", "qz", "qw")
HALF_TURN = np.array([0.0, 0.0, 0.0, 1.0])


def write_hiphi(root: Path, clip: Clip, motion: str, **changes: object) -> Path:
    """Write a recording into a release; return the actor's file."""
    frame, rest = motion.split("-")
    folder = root / "data" / frame / rest.partition("_")[0] / motion
    path = write_actor(folder, clip)
    listed = []
    for track in clip.objects:
        write_track(folder / "object_tracks" / f"{track.name}.csv", clip, track)
        mesh = f"{track.name}{'__mirror' * motion.endswith('__mirror')}"
        write_mesh(root / "object_meshes_preview" / f"{mesh}.obj", in_centimetres(track))
        listed.append({"object_id": track.name, "object_category": "box", "mesh_id": mesh})
    facts = {"motion_id": motion, "duration_sec": clip.frames / clip.fps, "objects": listed}
    facts |= {"dataset": "HiPHI", "text_annotation": "A person moves things."}
    (folder / "metadata.json").write_text(json.dumps(facts | changes))
    return path


def write_omnicontact(root: Path, clip: Clip, capture: str) -> Path:
    """Write a capture into a release; return the actor's file."""
    folder = root / "raw_mocap" / "box" / "case1" / capture
    path = write_actor(folder, clip)
    for track in clip.objects:
        write_track(folder / f"prop_{track.name}.csv", clip, track)
        write_mesh(root / "assets" / "objects" / f"{track.name}.obj", in_centimetres(track))
    (folder / "capture_meta.json").write_text(json.dumps({"frame_count": clip.frames}))
    return path


def write_actor(folder: Path, clip: Clip) -> Path:
    folder.mkdir(parents=True)
    return write_person(folder / "motion_actor.bvh", clip, RIG, frame_time=f"{1.0 / clip.fps:.8f}")


def write_track(path: Path, clip: Clip, track: ObjectTrack) -> None:
    (recorded,) = in_world(replace(clip, objects=(track,), contacts=()), "y").objects
    path.parent.mkdir(exist_ok=True)
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        for index, (place, (w, x, y, z)) in enumerate(zip(recorded.positions, recorded.quats, strict=True)):
            table.writerow([index, index / clip.fps, *place.tolist(), x, y, z, w])


def in_centimetres(track: ObjectTrack):
    return replace(track.geometry, points=100.0 * track.geometry.points)


def mirror_of(clip: Clip) -> Clip:
    """The clip as the release mirrors it: at x = 0, left for right."""
    return moved(mirrored(clip), HALF_TURN, np.zeros(3))
