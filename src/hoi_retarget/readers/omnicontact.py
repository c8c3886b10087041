"""Reads OmniContact's captures: one person and the objects beside the file, each as `prop_<object>.csv`.

`raw_mocap/<task>/<case>/<capture>/motion_actor.bvh` is a BVH such as HiPHI's, with y up in centimetres at 90 frames a
second, and `capture_meta.json` is beside it; meshes are `assets/objects/<object>.obj` at the root of the release.
Contacts are not recorded.

Cites: readers of others (UMR's `convert_omnicontact`), as the makers describe no layout; no file of it was at hand.
"""

from dataclasses import replace

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.readers.actor_files import recording_with_objects
from hoi_retarget.readers.bvh import ACTOR_FACTS, is_actor
from hoi_retarget.readers.reader import Reader, SourceRecording

FORMAT = "omnicontact"
LICENCE = "OmniContact: CC BY-NC-SA 4.0"
TRACK, MESHES = "prop_", "assets/objects"


def holds(file: SourceFile) -> bool:
    """Return whether a file is the actor's of a capture."""
    return is_actor(file, ACTOR_FACTS[1])


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a folder."""
    files = sorted(file.path.parent.glob(f"{TRACK}*.csv"))
    names = {path.stem.removeprefix(TRACK): path for path in files}
    recording = recording_with_objects(file, options, {name: (path, name) for name, path in names.items()}, MESHES)
    return replace(recording, description="OmniContact capture of one person and objects", licence=LICENCE)


READER = Reader(FORMAT, record, holds=holds, floor_at_zero=True)  # As optical systems are calibrated.
