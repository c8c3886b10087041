"""A list of edits and the facts of their clip: values, never changed."""

import hashlib
from dataclasses import dataclass, replace

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits.operations import Edit
from hoi_retarget.clip.edits.segments import segments_of
from hoi_retarget.errors import ArgumentError, ClipError


@dataclass(frozen=True)
class MadeFor:
    """The facts of a clip that edits depend on: on a clip with the same ones they have the same meaning."""

    name: str  # Of the clip, for people: a renamed recording is the same one.
    frames: int
    fps: float
    people: int
    objects: tuple[str, ...]
    contacts: str  # Digest of which parts touch which objects in which frames, before any edit.

    @staticmethod
    def of(clip: Clip) -> "MadeFor":
        """Return the facts of this clip; raises `ClipError` when its contacts are edited ones."""
        if clip.source.contact_edits:
            raise ClipError(
                f"clip {clip.name!r}: its contacts are edited already. Start from the clip as recorded; the edits "
                "made so far are in its source's contact_edits."
            )
        lines = [f"{item.person} {item.part} {item.object} {item.start} {item.stop}" for item in segments_of(clip)]
        return MadeFor(
            name=_writable(clip.name),
            frames=clip.frames,
            fps=float(clip.fps),
            people=len(clip.people),
            objects=tuple(_writable(track.name) for track in clip.objects),
            contacts=hashlib.sha256("\n".join(lines).encode()).hexdigest(),
        )

    def check(self, clip: Clip) -> None:
        """Raise `ClipError` with the differences, unless the clip has these facts."""
        there = MadeFor.of(clip)
        differences = (
            ("frames", self.frames, there.frames),
            ("frames a second", self.fps, there.fps),
            ("people", self.people, there.people),
            ("objects", ", ".join(self.objects) or "none", ", ".join(there.objects) or "none"),
        )
        found = [f"{what}: {here} there, {now} here" for what, here, now in differences if here != now]
        if not found and self.contacts != there.contacts:
            found = ["other contacts in the recording"]
        if found:
            raise ClipError(
                f"clip {clip.name!r}: the contact edits were made for another clip, {self.name!r} "
                f"({'; '.join(found)}). Use them with that clip, or make new ones."
            )


@dataclass(frozen=True)
class ContactEdits:
    """Edits in the order of their application, and the facts of their clip."""

    made_for: MadeFor
    edits: tuple[Edit, ...] = ()

    @staticmethod
    def of(clip: Clip) -> "ContactEdits":
        """Return no edits yet, for this clip; raises `ClipError` when its contacts are edited ones."""
        return ContactEdits(MadeFor.of(clip))

    def adding(self, edit: Edit) -> "ContactEdits":
        """Return these edits and one more."""
        return replace(self, edits=(*self.edits, edit))

    def without_last(self) -> "ContactEdits":
        """Return these edits without the last one; raises `ArgumentError` when there is none."""
        if not self.edits:
            raise ArgumentError("there is no contact edit to take back.")
        return replace(self, edits=self.edits[:-1])


def _writable(name: str) -> str:
    """Return a name that any file can hold: those of files may contain bytes that are no characters."""
    return name.encode("utf-8", "backslashreplace").decode()
