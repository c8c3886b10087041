"""The contact editor's work: requests of its page change a clip's contacts, and answers tell the motion that follows.

All windows show the same work, so that a page that is reloaded goes on where it was.
"""

import os
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from hoi_retarget.clip.edits import Add, ContactEdits, Edit, Move, Pin, Retime, Segment, TurnHand, describe, load, save
from hoi_retarget.clip.edits.edits_file import EditsFiles, edit_of
from hoi_retarget.clip.edits.operations import Point
from hoi_retarget.errors import ArgumentError, HoiRetargetError
from hoi_retarget.files.tables import decode
from hoi_retarget.human.skeleton import HANDS
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import seconds_to_frames
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.retargeting.targets import pinned_sites, recorded_rotation
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.studio.editor.edit_session import EditSession, EditState
from hoi_retarget.studio.editor.editor_page import EditorScene, editor_page
from hoi_retarget.studio.editor.editor_state import SurfaceGaps, changes_text, state_of

_DIGITS, _TURN_DIGITS = 4, 1  # Of what is dragged [m], [degrees]: tenths of a millimetre and of a degree.
_TURNED_DEG = 0.5  # A handle that is turned by more turns the hand.
_NEW_CONTACT_S = 0.5


@dataclass(frozen=True)
class SaveTargets:
    """Destinations of the editor's work; a page chooses none of them."""

    files: EditsFiles  # Of the edits.
    save_result: Callable[[EditState], tuple[Path, ...]]
    """Writes the motions and returns their files; raises `WriteError`."""


@dataclass(frozen=True)
class Request:
    """A request of the page: an action, its values, and the state of the page."""

    action: str
    revision: int  # Of the work that the page shows.
    chosen: int | None = None  # Number of the chosen contact.
    pinned: tuple[int, str] | None = None  # Person and part that have the handle.
    compared: bool = False  # Whether the curves of the last saved motion are shown, too.
    edit: Mapping[str, Any] = field(default_factory=dict)  # As in a file of edits.
    point: Point = (0.0, 0.0, 0.0)
    """A contact's, in its object's frame at captured size [m]; a pin's, in the world of the robot [m]."""
    turn: Point | None = None  # Rotation vector of a hand in its object's axes [degrees].
    quat: tuple[float, float, float, float] | None = None  # Rotation of a pinned part.
    on_surface: bool = False
    frame: int = 0
    part: tuple[int, str] = (0, "")
    object: int = 0
    count: int = 0
    name: str = ""


class Editor:
    """Changes a clip's contacts at a page's requests, one after the other."""

    def __init__(self, session: EditSession, model: RobotModel, targets: SaveTargets) -> None:
        self.session, self.model, self._targets = session, model, targets
        self.first = self.saved = session.now
        """The states at the beginning, and as last saved."""
        self._gaps, self._scene = SurfaceGaps(session.recorded), EditorScene(model, session.now)
        self._revision = 0
        self._chosen: tuple[int, str, int] | None = None
        self._version: str | None = None
        self._recoverable = os.path.lexists(targets.files.unsaved)
        self._actions: Mapping[str, Callable[[Request], str]] = {
            "show": lambda _: "",
            "edit": lambda asked: self._commit(edit_of(asked.edit, "edit")),
            "move": lambda asked: self._commit(self._moved(asked)),
            "pin": lambda asked: self._commit(self._pin(asked)),
            "add": lambda asked: self._commit(self._added(asked)),
            "undo": lambda _: self._step(session.undo, "Taken back."),
            "redo": lambda _: self._step(session.redo, "Done again."),
            "back": lambda asked: self._step(
                lambda: session.undo_to(max(asked.count, 0)), f"Back to {_count(asked.count, 'edit')}."
            ),
            "solve": lambda _: self._step(session.solve_all, "The whole clip is solved."),
            "save": lambda _: self._save_edits(),
            "save_result": lambda _: self._save_result(),
            "save_as": lambda asked: self._save_as(asked.name),
            "load": lambda asked: self._load_version(asked.name),
            "recover": lambda _: self._recover(),
        }

    def page(self, copy: str = "") -> str:
        """Return the page as it is now; `copy` is the answer of a page without a server to everything it is asked."""
        count = len(self.session.now.segments)
        message = f"{_count(count, 'contact')}. Choose a row or a point."
        if self._recoverable:
            message = self._recovery_text()
        asked = Request("show", self._revision)
        state = {**self._state(asked, message), "copy": copy}
        return editor_page(self.session.now, self.model, **self._drawn(asked), state=state)

    def _recovery_text(self) -> str:
        try:
            left = _count(len(load(self._targets.files.unsaved).edits), "edit")
        except HoiRetargetError as error:
            return f"Unsaved edits of last time cannot be read. {error}"
        return f"{left} of last time not saved. Take them up, under Versions, or go on without."

    def answer(self, request: Any) -> dict[str, Any]:
        """Return the answer to a request: state, scene and curves, or an error's message."""
        asked, before = None, self._revision
        try:
            asked = decode(Request, request, "request")
            return self._answer(asked)
        except HoiRetargetError as error:
            wrong = {"message": str(error), "wrong": True}
            # Where the work was done and a file could not be written, the page shows the work.
            return wrong if asked is None or self._revision == before else {**self._shown(asked, ""), **wrong}

    def _answer(self, asked: Request) -> dict[str, Any]:
        segments = self.session.now.segments
        if asked.revision != self._revision:
            return self._shown(asked, "Another window changed this work. Here it is now; nothing else was done.")
        if asked.pinned is not None:
            self._check(replace(asked, part=asked.pinned), pinned_sites(self.model))
        if asked.chosen is not None and 0 <= asked.chosen < len(segments):
            chosen = segments[asked.chosen]
            self._chosen = (chosen.person, chosen.part, chosen.start)
        else:
            self._chosen = None
        if asked.action in ("preview_move", "preview_pin"):
            return self._previewed(self._moved(asked) if asked.action == "preview_move" else self._pin(asked))
        if asked.action not in self._actions:
            raise ArgumentError(f"there is no action {asked.action!r}: {', '.join(self._actions)}.")
        return self._shown(asked, self._actions[asked.action](asked))

    def _shown(self, asked: Request, message: str) -> dict[str, Any]:
        return {**self._drawn(asked), **self._state(asked, message)}

    def _drawn(self, asked: Request) -> dict[str, str]:
        now, saved = self.session.now, self.saved
        chart = self._scene.chart(now, saved, compared=asked.compared)
        return {"scene": self._scene.packed(now, saved), "chart": chart}

    def _state(self, asked: Request, message: str) -> dict[str, Any]:
        now = self.session.now
        return {
            "message": message,
            "revision": self._revision,
            "chosen": self._number(now),
            "versions": self._targets.files.versions,
            "recoverable": self._recoverable,
            "unsaved": now.edits.edits != self.saved.edits.edits,
            "handle": None if asked.pinned is None else self._handle(*asked.pinned),
            **state_of(now, self.model, self._gaps.of(now.segments), self.first, self.session.previous),
        }

    def _previewed(self, edit: Edit) -> dict[str, Any]:
        """Return a quick solution of an edit that is not done yet."""
        solution = self.session.preview(edit, quickly=True)
        gaps = self._gaps.of(solution.segments)
        message = _pin_text(solution, edit) if isinstance(edit, Pin) else self._gap_text(solution)
        return {
            "scene": self._scene.packed(solution, self.saved, shown_alone=True),
            "message": message,
            "air": [gap.in_thin_air for gap in gaps],
        }

    def _commit(self, edit: Edit) -> str:
        """Solve an edit, go on from it, and tell its changes."""
        solution = self.session.preview(edit)
        if isinstance(edit, Retime) and self._chosen is not None:
            person, part, frame = self._chosen
            # A frame that it still has: otherwise it would not be the chosen one any more.
            self._chosen = (person, part, min(max(frame, edit.start), edit.stop - 1))
        elif isinstance(edit, Add):
            self._chosen = (edit.person, edit.part, edit.start)
        before = self.session.now
        self.session.commit(solution)
        aside = self._autosave()
        where = _pin_text(solution, edit) if isinstance(edit, Pin) else self._gap_text(solution)
        return f"{describe(solution.edits.edits[-1])}: {changes_text(before, solution)}. {where}{aside}"

    def _step(self, step: Callable[[], None], message: str) -> str:
        step()
        return message + self._autosave()

    # Edits that only the work can make of what the page asks for.

    def _moved(self, asked: Request) -> Edit:
        """Return the edit that moves the chosen contact to a point, or turns its hand."""
        segment = self._segment()
        point = np.array(asked.point)
        if asked.on_surface:
            point = surface_of(self.session.now.clip.objects[segment.object].geometry).closest_points(point[None])[0]
        turned = None if asked.turn is None else np.round(asked.turn, _TURN_DIGITS) + 0.0  # No minus before a zero.
        if turned is not None and segment.part in HANDS and np.abs(turned - segment.turn).max() > _TURNED_DEG:
            return TurnHand(segment.part, segment.start, tuple(turned.tolist()), person=segment.person)
        offset = np.round(point - segment.points.mean(axis=0), _DIGITS) + 0.0
        return Move(segment.part, segment.start, tuple(offset.tolist()), person=segment.person)

    def _pin(self, asked: Request) -> Pin:
        """Return the pin at a place of the robot's world; without a turn of its own it keeps an earlier one's."""
        self._check(asked, pinned_sites(self.model))
        (person, part), now = asked.part, self.session.now
        draft = now.drafts[person]
        place = np.round(np.array(asked.point) / draft.targets.root_scale, _DIGITS) + 0.0
        own = [pin for pin in now.clip.pins if (pin.person, pin.part, pin.frame) == (person, part, asked.frame)]
        turn = own[0].turn if own else None
        if asked.quat is not None:
            stage = draft.motion.stages[0].qpos
            recorded = recorded_rotation(draft.targets, self.model.forward(stage), part)[asked.frame]
            vector = np.degrees(se3.log(se3.quat_multiply(np.array(asked.quat), se3.quat_conjugate(recorded))))
            x, y, z = (np.round(vector, _TURN_DIGITS) + 0.0).tolist()
            turn = (x, y, z)
        return Pin(part, asked.frame, tuple(place.tolist()), turn, person=person)

    def _added(self, asked: Request) -> Add:
        """Return a contact from this frame on, where the robot's part is nearest to an object's surface."""
        self._check(asked, self.model.spec.contact_sites)
        (person, part), clip, frame = asked.part, self.session.now.clip, asked.frame
        own = [item for item in self.session.now.segments if (item.person, item.part) == (person, part)]
        later = [segment.start for segment in own if segment.start > frame]
        stop = min([frame + seconds_to_frames(_NEW_CONTACT_S, clip.fps), clip.frames, *later])
        motion = self.session.now.motions[person]
        kinematics, item = self.model.forward(motion.qpos[frame : frame + 1]), asked.object
        away = kinematics.site_position(self.model.spec.contact_sites[part])[0] - motion.object_pos[frame, item]
        inside = se3.rotate_inverse(motion.object_quat[frame, item], away) / motion.object_scale[item]
        (point,) = surface_of(clip.objects[item].geometry).closest_points(inside[None])
        return Add(part, frame, stop, tuple(point.tolist()), person=person, object=clip.objects[item].name)

    def _check(self, asked: Request, parts: Collection[str]) -> None:
        """Raise `ArgumentError` unless the part, frame and object that are named exist."""
        (person, part), clip = asked.part, self.session.now.clip
        if not 0 <= person < len(clip.people):
            raise ArgumentError(f"there is no person {person}; there are 0 to {len(clip.people) - 1}.")
        if part not in parts:
            raise ArgumentError(f"part is {part!r}; there are {', '.join(parts)}.")
        if not 0 <= asked.frame < clip.frames:
            raise ArgumentError(f"there is no frame {asked.frame}; there are 0 to {clip.frames - 1}.")
        if asked.action == "add" and not 0 <= asked.object < len(clip.objects):
            raise ArgumentError(f"there is no object {asked.object}; there are {len(clip.objects)}.")

    def _handle(self, person: int, part: str) -> dict[str, Any]:
        """Return the path of a pinned part's handle: at its pins where it is pinned."""
        draft = self.session.now.drafts[person]
        kinematics, site = self.model.forward(draft.motion.qpos), pinned_sites(self.model)[part]
        path = kinematics.site_position(site).copy()
        for pin in self.session.now.clip.pins:
            if (pin.person, pin.part) == (person, part):
                path[pin.frame] = draft.targets.root_scale * np.array(pin.position)
        quats = se3.matrix_to_quat(kinematics.site_rotation(site))
        return {"positions": np.round(path, 5).tolist(), "quats": np.round(quats, 6).tolist()}

    # Files.

    def _save_edits(self) -> str:
        save(self.session.now.edits, self._targets.files.saved)
        self._begin_from(None)
        return f"Saved {_count(len(self.session.now.edits.edits), 'edit')} to {self._targets.files.saved}."

    def _save_result(self) -> str:
        """Solve the whole clip and write its motions."""
        if not self.session.now.complete:
            self.session.solve_all()
            self._revision += 1
        paths = self._targets.save_result(self.session.now)
        return f"Saved {', '.join(map(str, paths))}."

    def _save_as(self, name: str) -> str:
        path = self._targets.files.version(name)
        if os.path.lexists(path) and name != self._version:
            raise ArgumentError(f"there is a version {name} already. Choose another name, or load it first.")
        save(self.session.now.edits, path)
        self._begin_from(name)
        return f"Saved as {path}."

    def _load_version(self, name: str) -> str:
        files, earlier = self._targets.files, self.session.now
        self._load(files.version(name))
        message = f"Loaded {name}."
        if earlier.edits.edits != self.saved.edits.edits and os.path.lexists(files.unsaved):
            message += f" What was not saved is version {files.set_aside()} now."
            self._recoverable = False
        self._begin_from(name)
        return message

    def _recover(self) -> str:
        """Go on from the unsaved edits of an earlier time."""
        self._load(self._targets.files.unsaved)
        self._recoverable = False
        return "Taken up again. They are not saved yet."

    def _load(self, path: Path) -> None:
        edits: ContactEdits = load(path)
        edits.made_for.check(self.session.recorded)
        self.session.commit(self.session.preview_all(edits))
        self._revision += 1

    def _begin_from(self, version: str | None) -> None:
        """Make the current state the saved one: nothing is unsaved, and later states are compared with it."""
        self.saved, self._version = self.session.now, version
        self._revision += 1
        if not self._recoverable:
            self._targets.files.forget()

    def _autosave(self) -> str:
        """Write unsaved edits, in case the server is lost; return a sentence on earlier ones."""
        self._revision += 1
        files, message = self._targets.files, ""
        if self._recoverable:
            self._recoverable = False
            message = f" What was not saved last time is version {files.set_aside()} now."
        if self.session.now.edits.edits == self.saved.edits.edits:
            files.forget()
        else:
            files.keep(self.session.now.edits)
        return message

    # The chosen contact.

    def _segment(self) -> Segment:
        number = self._number(self.session.now)
        if number is None:
            raise ArgumentError("no contact is chosen. Choose a row or a point first.")
        return self.session.now.segments[number]

    def _number(self, edited: EditState) -> int | None:
        """Return the number of the chosen contact in a state."""
        if self._chosen is None:
            return None
        person, part, frame = self._chosen
        found = [
            number
            for number, item in enumerate(edited.segments)
            if (item.person, item.part) == (person, part) and item.holds(frame)
        ]
        return found[0] if found else None

    def _gap_text(self, edited: EditState) -> str:
        """Return the chosen contact's distance from its surface and its holds in words; empty where none is chosen."""
        number = self._number(edited)
        if number is None:
            return ""
        chosen = edited.segments[number]
        holds = [
            f"Hold: {hold}."
            for hold in edited.motions[chosen.person].report.holds
            if hold.part == chosen.part and hold.first_frame < chosen.stop and hold.last_frame >= chosen.start
        ]
        return " ".join([self._gaps.of([chosen])[0].text, *holds])


def _pin_text(edited: EditState, pin: Pin) -> str:
    """Return the distance of a part from its pin in words."""
    parts = edited.motions[pin.person].report.pins
    own = next(item for item in parts if (item.part, item.frame) == (pin.part, pin.frame))
    return f"The {own}{': out of reach, or in the way of something' if own.missed else ''}."


def _count(count: int, what: str) -> str:
    return f"{count} {what}{'s' if count != 1 else ''}"
