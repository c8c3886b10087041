"""Editing of one clip's contacts: every change is solved at once, and can be taken back."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits import ChooseHold, ContactEdits, Edit, Pin, Retime, Segment, TurnHand, apply, segments_of
from hoi_retarget.clip.label_contacts import with_finger_contacts
from hoi_retarget.errors import ArgumentError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.local_resolve import resolve_locally
from hoi_retarget.retargeting.retarget import judge_team, solve_people
from hoi_retarget.retargeting.robot_separation import separate_robots
from hoi_retarget.retargeting.solve import Solution
from hoi_retarget.robots.model import RobotModel


@dataclass(frozen=True, eq=False)
class EditState:
    """A clip with edited contacts and the motion of each person's robot."""

    edits: ContactEdits
    clip: Clip
    drafts: tuple[Solution, ...]  # One for each person.
    complete: bool  # Whether the whole clip was solved: the motions are then those of the command line, to the bit.
    replaces_last: bool = False  # Whether the last edit stands for that of the state before, too.

    @property
    def motions(self) -> tuple[Motion, ...]:
        """The motion of each person's robot."""
        return tuple(item.motion for item in self.drafts)

    @cached_property
    def segments(self) -> tuple[Segment, ...]:
        """The contacts one by one, with those of fingers where robots have some."""
        clip = self.clip
        for draft in self.drafts:
            clip = with_finger_contacts(clip, draft.person) if draft.model.spec.fingers else clip
        return segments_of(clip)


class EditSession:
    """One user's work: its current state, the earlier ones, and the undone ones."""

    def __init__(self, recorded: Clip, model: RobotModel, config: Config, start: EditState) -> None:
        self.recorded, self._model, self._config = recorded, model, config
        self._past: list[EditState] = []
        self._undone: list[EditState] = []
        self.now = start
        """The current state of the work."""

    @property
    def previous(self) -> EditState | None:
        """The state before the last change; None where nothing was changed."""
        return self._past[-1] if self._past else None

    def preview(self, edit: Edit, *, quickly: bool = False) -> EditState:
        """Return the state after an edit, solved around the changed frames alone; quickly during a drag.

        A contact that is retimed again right away was retimed once, and a part that is pinned again was pinned once.
        Raises `ClipError` when the edit cannot be done, `SolveError` when its frames end without a usable trajectory.
        """
        edits, last = self.now.edits, self.now.edits.edits[-1:]
        again = _again(edit, last[0]) if last else None
        if again is None:
            return self._revised(edits.adding(edit), quickly)
        return replace(self._revised(edits.without_last().adding(again), quickly), replaces_last=True)

    def preview_all(self, edits: ContactEdits) -> EditState:
        """Return the state with other edits of the same recording; raises as `preview`."""
        return self._revised(edits)

    def commit(self, edited: EditState) -> None:
        """Go on from a previewed state; one step back takes an edit and those that it replaces away."""
        if not edited.replaces_last:
            self._past.append(self.now)
        self._undone.clear()
        self.now = edited

    def undo(self) -> None:
        """Take the last edit back; raises `ArgumentError` when there is none."""
        if not self._past and not self.now.edits.edits:
            raise ArgumentError("there is no contact edit to take back.")
        # Edits that were made before, and read from a file, were never solved one by one.
        before = self._past.pop() if self._past else self._revised(self.now.edits.without_last())
        self._undone.append(self.now)
        self.now = before

    def undo_to(self, count: int) -> None:
        """Take edits back until so many are left."""
        while len(self.now.edits.edits) > count:
            self.undo()

    def redo(self) -> None:
        """Apply the last undone edit again; raises `ArgumentError` when there is none."""
        if not self._undone:
            raise ArgumentError("there is nothing to do again.")
        self._past.append(self.now)
        self.now = self._undone.pop()

    def solve_all(self) -> None:
        """Solve the whole clip, as the command line does with the same edits."""
        self.now = solved(self.recorded, self._model, self._config, self.now.edits)

    def _revised(self, edits: ContactEdits, quickly: bool = False) -> EditState:
        clip = apply(self.recorded, edits)
        drafts = [resolve_locally(item, clip, self._config, quickly=quickly) for item in self.now.drafts]
        if quickly:
            return EditState(edits, clip, tuple(drafts), complete=False)
        return EditState(edits, clip, _judged(separate_robots(drafts, self._config)), complete=False)


def _again(edit: Edit, before: Edit) -> Edit | None:
    """Return one edit for two where the second replaces the first; else None."""
    match edit, before:
        case Retime(), Retime():
            same = before.start <= edit.frame < before.stop and (edit.person, edit.part) == (before.person, before.part)
            return replace(edit, frame=before.frame) if same else None
        case (ChooseHold(), ChooseHold()) | (TurnHand(), TurnHand()):
            same = (edit.person, edit.part, edit.frame) == (before.person, before.part, before.frame)
            return edit if same else None
        case Pin(), Pin():
            same = (edit.person, edit.part, edit.frame) == (before.person, before.part, before.frame)
            return edit if same else None
    return None


def solved(recorded: Clip, model: RobotModel, config: Config, edits: ContactEdits) -> EditState:
    """Return a clip with edits, solved whole; raises as `apply` and `retarget`.

    `recorded`: the clip without edits; `model`: the robot; `config`: of the solve; `edits`: the edits.
    """
    clip = apply(recorded, edits)
    return EditState(edits, clip, _judged(solve_people(clip, [model], config)), complete=True)


def _judged(solutions: Sequence[Solution]) -> tuple[Solution, ...]:
    """Return solutions with the figures of their motions."""
    return tuple(
        replace(solution, motion=motion) for solution, motion in zip(solutions, judge_team(solutions), strict=True)
    )
