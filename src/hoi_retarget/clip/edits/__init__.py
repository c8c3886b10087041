"""Contact edits: who touches what, where and when is changed by a small text file, never in the recording.

    edits = ContactEdits.of(clip).adding(Fix("left_hand", frame=50)).adding(Retime("right_hand", 80, 70, 120))
    save(edits, Path("edits.toml"))
    motion = retarget(apply(clip, edits), model, config)

`apply` is deterministic and always starts from the clip as recorded, so the same file gives the same
result to the bit, whoever made it.
"""

from dataclasses import replace

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits.edits import ContactEdits, MadeFor
from hoi_retarget.clip.edits.file import from_text, load, save, to_text
from hoi_retarget.clip.edits.operation import Point
from hoi_retarget.clip.edits.operations import (
    OPERATIONS,
    Add,
    Delete,
    Edit,
    Fix,
    FixAll,
    Merge,
    Move,
    Retime,
    Snap,
    SnapAll,
    Split,
    describe,
    operation_name,
)
from hoi_retarget.clip.edits.pins import Pin, PinOperation, Unpin
from hoi_retarget.clip.edits.segments import Segment, Segments, part_text, segments_of, span_text, tracks_of
from hoi_retarget.errors import ClipError

__all__ = [
    "OPERATIONS",
    "Add",
    "ContactEdits",
    "Delete",
    "Edit",
    "Fix",
    "FixAll",
    "MadeFor",
    "Merge",
    "Move",
    "Pin",
    "Point",
    "Retime",
    "Segment",
    "Segments",
    "Snap",
    "SnapAll",
    "Split",
    "Unpin",
    "apply",
    "describe",
    "from_text",
    "load",
    "operation_name",
    "part_text",
    "save",
    "segments_of",
    "span_text",
    "to_text",
]


def apply(clip: Clip, edits: ContactEdits) -> Clip:
    """Return the clip with edited contacts, one track per segment, and pins; without edits, the clip itself.

    Its source's `contact_edits` holds the edits' text.

    Raises:
        ClipError: the edits were made for another clip, the clip's contacts are edited already, or an
            edit cannot be done; the message has the edit's number.
        GeometryError: an object's surface is needed and cannot be had.
    """
    edits.made_for.check(clip)
    if not edits.edits:
        return clip
    segments, pins = segments_of(clip), clip.pins
    for number, edit in enumerate(edits.edits, start=1):
        try:
            if isinstance(edit, PinOperation):
                pins = edit.on_pins(clip, pins)
            else:
                segments = edit.on(clip, segments)
        except ClipError as error:
            raise ClipError(f"contact edit {number} ({describe(edit)}): {error}") from error
    source = replace(clip.source, contact_edits=to_text(edits))
    return replace(clip, contacts=tracks_of(segments, clip.frames), pins=pins, source=source)
