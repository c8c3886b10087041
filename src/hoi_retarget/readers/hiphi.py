"""Reads HiPHI: one person and tracked objects, a folder for each recording; recordings without objects, too.

`data/<frame>/<lexical unit>/<recording>/` holds `motion_actor.bvh`, `metadata.json` and, where objects are tracked,
`object_tracks/<object>.csv`; meshes are `object_meshes_preview/<mesh>.obj` at the root of the release. The BVH has 55
joints with positions and Z-X-Y angles of their own, y up, centimetres, 90 frames a second; mirrored recordings end in
`__mirror` and name mirrored meshes, reflected in their own x, so that they are read as any other. A performer's bones
are the positions, which change from frame to frame; the rest pose tells only which way they lie. Contacts are not
recorded.

Cites: HiPHI's "Data Format Specification", sections 1 to 7 and 10.
"""

from dataclasses import replace

from hoi_retarget.clip.clip import TOLD
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.readers.bvh import ACTOR_FACTS, is_actor
from hoi_retarget.readers.fields import Fields, json_values
from hoi_retarget.readers.omnicontact import recording_with_objects
from hoi_retarget.readers.reader import Headline, Reader, SourceRecording

FORMAT = "hiphi"
LICENCE = "HiPHI: gated; its card on Hugging Face tells the terms"
METADATA, TRACKS, MESHES = ACTOR_FACTS[0], "object_tracks", "object_meshes_preview"
MIRRORED = "__mirror"


def holds(file: SourceFile) -> bool:
    """Return whether a file is the actor's of a recording; a release has 41,000 of them."""
    return is_actor(file, METADATA)


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a folder."""
    facts, listed = _facts(file)
    tracks = {}
    for item in listed:
        name = item.text("object_id", "the object's name")
        tracks[name] = file.beside(TRACKS, f"{name}.csv"), item.text("mesh_id", "the name of its mesh")
    recording = recording_with_objects(file, options, tracks, MESHES)
    told = facts.get("text_annotation")
    return replace(
        recording,
        description=f"HiPHI recording of one person and {len(tracks) or 'no'} object{'s'[: len(tracks) != 1]}",
        licence=LICENCE,
        notes=(*recording.notes, *([f"{TOLD}{told}"] if isinstance(told, str) and told else [])),
    )


def headline(file: SourceFile) -> Headline:
    """Return the facts to select a recording by, from its metadata alone."""
    facts, listed = _facts(file)
    meshes = tuple(item.text("mesh_id", "the name of its mesh").removesuffix(MIRRORED) for item in listed)
    told = [item.get("object_category") for item in listed] + [facts.get("text_annotation")]
    words = " ".join((*meshes, *(text for text in told if isinstance(text, str))))
    return Headline(words, meshes, float(facts.array("duration_sec", (), "the recording's length")))


def _facts(file: SourceFile) -> tuple[Fields, list[Fields]]:
    """Return the metadata beside a file, and those of each object."""
    facts = Fields(file.beside(METADATA), json_values(file, file.beside(METADATA)))
    listed = facts.get("objects") or []
    if not isinstance(listed, list) or not all(isinstance(item, dict) for item in listed):
        raise ClipError(f"{facts.path}: objects is no list of tables. Download the recording again.")
    return facts, [Fields(facts.path, entry, within="objects/") for entry in listed]


# The floor is at zero, as optical systems are calibrated.
READER = Reader(FORMAT, record, holds=holds, floor_at_zero=True, headline_of=headline)
