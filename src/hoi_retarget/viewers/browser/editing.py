"""The contacts of one clip while they are edited: every change is solved at once, and can be taken back."""

from dataclasses import dataclass, replace
from functools import cached_property

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits import ContactEdits, Edit, Pin, Retime, Segment, apply, segments_of
from hoi_retarget.errors import ArgumentError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.local_resolve import Draft, draft, revise
from hoi_retarget.retargeting.robots_apart import kept_apart
from hoi_retarget.robots.model import RobotModel


@dataclass(frozen=True, eq=False)
class Edited:
    """A clip with edited contacts and the motion of each person's robot."""

    edits: ContactEdits
    clip: Clip
    drafts: tuple[Draft, ...]
    """One for each person."""
    complete: bool
    """Whether the whole clip was solved: the motions are then those of the command line, to the bit."""

    @property
    def motions(self) -> tuple[Motion, ...]:
        """The motion of each person's robot."""
        return tuple(item.motion for item in self.drafts)

    @cached_property
    def segments(self) -> tuple[Segment, ...]:
        """The contacts one by one."""
        return segments_of(self.clip)


class Editing:
    """One person's work: where it stands, what was before, and what was taken back."""

    def __init__(self, recorded: Clip, model: RobotModel, config: Config, start: Edited) -> None:
        self.recorded, self._model, self._config = recorded, model, config
        self._past: list[Edited] = []
        self._taken_back: list[Edited] = []
        self.now = start
        """The current state of the work."""

    @property
    def before(self) -> Edited | None:
        """The state before the last change; None where nothing was changed."""
        return self._past[-1] if self._past else None

    def tried(self, edit: Edit, *, quickly: bool = False) -> Edited:
        """Return what an edit would make of it, solved around the frames that it changes; quickly while it is dragged.

        A contact that is retimed again right away was retimed once, and a part that is pinned again was pinned once.

        Raises:
            ClipError: The edit cannot be done.
            SolveError: The frames around it end without a usable trajectory.
        """
        edits, last = self.now.edits, self.now.edits.edits[-1:]
        again = _again(edit, last[0]) if last else None
        return self._revised(edits.adding(edit) if again is None else edits.without_last().adding(again), quickly)

    def loaded(self, edits: ContactEdits) -> Edited:
        """Return what other edits of the same recording make of it; raises what `tried` raises."""
        return self._revised(edits)

    def take(self, edited: Edited) -> None:
        """Go on from what was tried."""
        self._past.append(self.now)
        self._taken_back.clear()
        self.now = edited

    def undo(self) -> None:
        """Take the last edit back; raises `ArgumentError` when there is none."""
        if not self._past and not self.now.edits.edits:
            raise ArgumentError("there is no contact edit to take back.")
        # Edits that were made before, and read from a file, were never solved one by one.
        before = self._past.pop() if self._past else self._revised(self.now.edits.without_last())
        self._taken_back.append(self.now)
        self.now = before

    def undo_to(self, count: int) -> None:
        """Take edits back until so many are left."""
        while len(self.now.edits.edits) > count:
            self.undo()

    def redo(self) -> None:
        """Do again what was taken back; raises `ArgumentError` when there is nothing."""
        if not self._taken_back:
            raise ArgumentError("there is nothing to do again.")
        self._past.append(self.now)
        self.now = self._taken_back.pop()

    def solve_all(self) -> None:
        """Solve the whole clip, as the command line does with the same edits."""
        self.now = solved(self.recorded, self._model, self._config, self.now.edits)

    def _revised(self, edits: ContactEdits, quickly: bool = False) -> Edited:
        clip = apply(self.recorded, edits)
        drafts = [revise(item, clip, self._model, self._config, quickly=quickly) for item in self.now.drafts]
        return Edited(edits, clip, kept_apart(drafts, [self._model] * len(drafts), self._config), complete=False)


def _again(edit: Edit, before: Edit) -> Edit | None:
    """Return what stands for both of two edits where the second does anew what the first has done; else None."""
    match edit, before:
        case Retime(), Retime():
            same = before.start <= edit.frame < before.stop and (edit.person, edit.part) == (before.person, before.part)
            return replace(edit, frame=before.frame) if same else None
        case Pin(), Pin():
            same = (edit.person, edit.part, edit.frame) == (before.person, before.part, before.frame)
            return edit if same else None
    return None


def solved(recorded: Clip, model: RobotModel, config: Config, edits: ContactEdits) -> Edited:
    """Return a clip with edits, solved whole; raises what `apply` and `retarget` raise."""
    clip = apply(recorded, edits)
    drafts = [draft(clip, model, config, person=person) for person in range(len(clip.people))]
    return Edited(edits, clip, kept_apart(drafts, [model] * len(drafts), config), complete=True)
