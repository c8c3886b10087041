"""Reads OmniContact's captures: an actor's BVH, and the track of each object beside it as CSV, as HiPHI has them, too.

`raw_mocap/<task>/<case>/<capture>/motion_actor.bvh` has y up, in centimetres, at 90 frames a second; beside it are
`capture_meta.json` and `prop_<object>.csv`. A row of a track is one frame of the BVH, in the same world: `px`, `py`,
`pz` [m] and the rotation `qx`, `qy`, `qz`, `qw` from the object's frame. Meshes are `assets/objects/<object>.obj` at
the root of the release, in centimetres. Contacts are not recorded.

Cites: readers of others (UMR's `convert_omnicontact`), as the makers describe no layout; no file of it was at hand.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.motion.formats.containers import HEADER, TABLE, parse_csv
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers import bvh
from hoi_retarget.readers.bvh import ACTOR_FACTS, is_actor
from hoi_retarget.readers.fields import Fields, check_frames, folder_above
from hoi_retarget.readers.object_files import first_mesh
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks

FORMAT = "omnicontact"
LICENCE = "OmniContact: CC BY-NC-SA 4.0"
TRACK, MESHES = "prop_", "assets/objects"
CENTIMETRE = 0.01
POSITION, ROTATION = ("px", "py", "pz"), ("qx", "qy", "qz", "qw")


def holds(file: SourceFile) -> bool:
    """Return whether a file is the actor's of a capture."""
    return is_actor(file, ACTOR_FACTS[1])


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a folder."""
    files = sorted(file.path.parent.glob(f"{TRACK}*.csv"))
    names = {path.stem.removeprefix(TRACK): path for path in files}
    recording = recording_with_objects(file, options, {name: (path, name) for name, path in names.items()}, MESHES)
    return replace(recording, description="OmniContact capture of one person and objects", licence=LICENCE)


def recording_with_objects(
    file: SourceFile, options: ReadOptions, tracks: Mapping[str, tuple[Path, str]], meshes: str
) -> SourceRecording:
    """Return the recording of a BVH and its objects; raises `ReadError` or `ClipError`.

    `file`: the BVH; `options`: of reading; `tracks`: name of an object -> its track and the name of its mesh; `meshes`:
    the folder of meshes, above the recording where `options` do not name another.
    """
    actor = bvh.record(file, options)

    def read_tracks() -> Tracks:
        geometry = partial(_geometry, file, options, meshes)
        objects = [_track(file, path, name, geometry(name, mesh)) for name, (path, mesh) in tracks.items()]
        check_frames(file.path, {"person": actor.frames} | {track.name: len(track.positions) for track in objects})
        return replace(actor.read_tracks(), objects=tuple(objects))

    return replace(
        actor,
        name=file.path.resolve().parent.name,
        objects=tuple(tracks),
        contacts="none stored" if tracks else actor.contacts,
        up="y",
        up_axis="",
        read_tracks=read_tracks,
    )


def _track(file: SourceFile, path: Path, name: str, geometry: ObjectGeometry) -> ObjectTrack:
    table = parse_csv(file.read(path), path)
    values = dict(zip(table.get(HEADER, ()), table[TABLE].T, strict=False))
    fields, kinds = Fields(path, values), {"position": POSITION, "rotation": ROTATION}
    position, (*vector, scalar) = (
        [fields.array(column, ("T",), f"a column of the object's {kind}") for column in columns]
        for kind, columns in kinds.items()
    )
    return ObjectTrack(name, np.stack(position, axis=1), np.stack([scalar, *vector], axis=1), geometry)


def _geometry(file: SourceFile, options: ReadOptions, meshes: str, name: str, mesh: str) -> ObjectGeometry:
    folder = options.objects or folder_above(file.path, *meshes.split("/")) or file.path.parent / meshes
    # `beside` refuses names that lead out of the folder.
    return first_mesh(name, [folder / file.beside(f"{mesh}.obj").name], centred=False, scale=CENTIMETRE)


READER = Reader(FORMAT, record, holds=holds, floor_at_zero=True)  # As optical systems are calibrated.
