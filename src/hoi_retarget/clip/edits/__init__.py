"""Contact edits: contacts are changed by a small text file, never in the recording.

    edits = ContactEdits.of(clip).adding(Fix("left_hand", frame=50)).adding(Retime("right_hand", 80, 70, 120))
    save(edits, Path("edits.toml"))
    motion = retarget(apply(clip, edits), model, config)

`apply` is deterministic and always starts from the clip as recorded, so the same file gives the same
result to the bit, whoever made it.
"""

from dataclasses import replace

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits.edits import ContactEdits as ContactEdits
from hoi_retarget.clip.edits.edits import MadeFor as MadeFor
from hoi_retarget.clip.edits.edits_file import from_text as from_text
from hoi_retarget.clip.edits.edits_file import load as load
from hoi_retarget.clip.edits.edits_file import save as save
from hoi_retarget.clip.edits.edits_file import to_text as to_text
from hoi_retarget.clip.edits.operations import OPERATIONS as OPERATIONS
from hoi_retarget.clip.edits.operations import Add as Add
from hoi_retarget.clip.edits.operations import ChooseHold as ChooseHold
from hoi_retarget.clip.edits.operations import Delete as Delete
from hoi_retarget.clip.edits.operations import Edit as Edit
from hoi_retarget.clip.edits.operations import Fix as Fix
from hoi_retarget.clip.edits.operations import FixAll as FixAll
from hoi_retarget.clip.edits.operations import Merge as Merge
from hoi_retarget.clip.edits.operations import Move as Move
from hoi_retarget.clip.edits.operations import Pin as Pin
from hoi_retarget.clip.edits.operations import PinOperation
from hoi_retarget.clip.edits.operations import Point as Point
from hoi_retarget.clip.edits.operations import Retime as Retime
from hoi_retarget.clip.edits.operations import Snap as Snap
from hoi_retarget.clip.edits.operations import SnapAll as SnapAll
from hoi_retarget.clip.edits.operations import Split as Split
from hoi_retarget.clip.edits.operations import TurnHand as TurnHand
from hoi_retarget.clip.edits.operations import Unpin as Unpin
from hoi_retarget.clip.edits.operations import describe as describe
from hoi_retarget.clip.edits.segments import Segment as Segment
from hoi_retarget.clip.edits.segments import Segments as Segments
from hoi_retarget.clip.edits.segments import part_text as part_text
from hoi_retarget.clip.edits.segments import segments_of as segments_of
from hoi_retarget.clip.edits.segments import span_text as span_text
from hoi_retarget.clip.edits.segments import tracks_of
from hoi_retarget.clip.label_contacts import with_finger_contacts
from hoi_retarget.errors import ClipError
from hoi_retarget.human.skeleton import FINGER_PARTS


def apply(clip: Clip, edits: ContactEdits) -> Clip:
    """Return the clip with edited contacts, one track per segment, and pins; without edits, the clip itself.

    Where a finger's contact is edited, the ones found by geometry are contacts of the recording, too. Its source's
    `contact_edits` holds the edits' text. Raises `ClipError` for edits of another clip, contacts that are edited
    already, and an edit that cannot be done, with its number; `GeometryError` where a surface cannot be had.
    """
    edits.made_for.check(clip)
    if not edits.edits:
        return clip
    labelled = {track.person for track in clip.contacts if track.part in FINGER_PARTS}
    for person in {getattr(edit, "person", 0) for edit in edits.edits if getattr(edit, "part", "") in FINGER_PARTS}:
        if person < len(clip.people) and person not in labelled:
            clip = with_finger_contacts(clip, person)
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
    contacts = tracks_of(segments, clip.frames)
    return replace(clip, contacts=contacts, pins=pins, source=source, recorded_contacts=clip.contacts)
