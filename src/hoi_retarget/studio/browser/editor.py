"""The contact editor for one browser: a row and a point for each contact, and the motion that follows them.

One thread per browser does all work in the order of the requests; of a dragged point only the latest place counts.
"""

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import viser
from jaxtyping import Float

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits import (
    Add,
    ContactEdits,
    Edit,
    FixAll,
    Move,
    Pin,
    Retime,
    Segment,
    SnapAll,
    TurnHand,
    describe,
    load,
    save,
)
from hoi_retarget.clip.edits.edits_file import EditsFiles
from hoi_retarget.errors import ArgumentError, HoiRetargetError
from hoi_retarget.human.skeleton import HANDS
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import seconds_to_frames
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.retargeting.config import Config
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.studio.browser.browser_server import PageContent, PageServer, page_content, serve_sessions
from hoi_retarget.studio.browser.edit_session import EditSession, EditState
from hoi_retarget.studio.browser.editor_panel import PANEL_WIDTH_PX, TYPING_DELAY_S, EditorPanel, changes_text
from hoi_retarget.studio.browser.handles import EditorPins, EditorPoints, pin_text
from hoi_retarget.studio.browser.player import Player
from hoi_retarget.studio.browser.strip import (
    SegmentEnds,
    Span,
    SurfaceGaps,
    dragged,
    dragged_text,
    strip_height_px,
    strip_html,
)
from hoi_retarget.studio.browser.worker import Worker
from hoi_retarget.studio.scene.scene import SceneItem

_DRAG_DECIMALS = 4  # Of a dragged point [m]: tenths of a millimetre.
_TURNED_DEG, _TURN_DECIMALS = 0.5, 1  # A handle that is turned by more turns the hand, to tenths of a degree.
_NEW_CONTACT_S = 0.5


@dataclass(frozen=True)
class SaveTargets:
    """Destinations of the editor's work; a browser chooses none of them."""

    files: EditsFiles
    """Of the edits."""
    save_result: Callable[[EditState], tuple[Path, ...]]
    """Writes the motions and returns their files; raises `WriteError`."""


def serve_editor(  # noqa: PLR0913, PLR0917 - one session's inputs and the server
    server: PageServer, recorded: Clip, model: RobotModel, config: Config, start: EditState, targets: SaveTargets
) -> None:
    """Let every browser edit the contacts of a clip on its own, from the latest saved edits.

    Args:
        server: Of the pages.
        recorded: The clip without edits.
        model: The robot.
        config: Of the solves.
        start: The solved clip with the edits of the file.
        targets: Destinations of edits and results.
    """
    latest = start

    def on_save(saved: EditState) -> None:
        nonlocal latest
        latest = saved

    def create_session(client: viser.ClientHandle) -> Editor:
        return Editor(client, EditSession(recorded, model, config, latest), model, targets, on_save)

    serve_sessions(server, create_session)


class Editor:
    """Shows a clip's contacts to one browser and changes them at its requests, until `stop`.

    Its actions are tasks of its worker: widgets queue them, and errors of theirs are shown.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        session: EditSession,
        model: RobotModel,
        targets: SaveTargets,
        on_save: Callable[[EditState], None],
    ) -> None:
        """Begin; `on_save` receives each state that is written to the edits' file."""
        self.session, self.model, self._targets, self._on_save = session, model, targets, on_save
        self._first = self._saved = session.now
        self.has_autosave = os.path.lexists(targets.files.unsaved)
        """Whether there are unsaved edits of an earlier session."""
        self._gaps = SurfaceGaps(session.recorded)
        self._chosen: tuple[int, str, int] | None = None
        self._compared = False
        self._version: str | None = None
        self.worker = Worker("editor", self._show_error)
        self.player = Player(client, self._content(session.now), left_px=PANEL_WIDTH_PX)
        self._ends = SegmentEnds(self.player.timeline, client.gui, session.recorded.frames)
        self._points = EditorPoints(client.scene, self)
        self.panel = EditorPanel(client.gui, self)
        self._pins = EditorPins(client, self)
        self.player.attach(self._points.show_frame)
        self.worker.do(lambda: self.show(f"{len(session.now.segments)} contacts. Choose a row or a point."))
        if self.has_autosave:
            unsaved = "{} of last time not saved. Take them up, under Versions, or go on without."
            self.worker.do(lambda: self.panel.say(unsaved.format(_count(load(targets.files.unsaved)))))

    def stop(self) -> None:
        """End the editor's work."""
        self.worker.stop()
        self.player.stop()

    @property
    def edited(self) -> EditState:
        """The current state of the work."""
        return self.session.now

    @property
    def frame(self) -> int:
        """The current frame."""
        return self.player.frame

    @property
    def chosen(self) -> Segment | None:
        """The chosen segment; None where there is none."""
        return self._chosen_in(self.edited)

    @property
    def commands(self) -> Sequence[Mapping[str, Callable[[], None]]]:
        """Actions on the whole clip by their names, in rows of buttons."""
        session, step = self.session, self._step
        return (
            {"One point each": lambda: self.commit(FixAll()), "All to surface": lambda: self.commit(SnapAll())},
            {"Undo": lambda: step(session.undo, "Taken back."), "Redo": lambda: step(session.redo, "Done again.")},
            {"Solve whole clip": lambda: step(session.solve_all, "The whole clip is solved.")},
            {"Save edits": self._save_edits, "Save result": self._save_result},
        )

    def choose(self, index: int) -> None:
        """Choose a segment, and show a frame in which it is touched."""
        segments = self.edited.segments
        if index < len(segments):
            segment = segments[index]
            self._chosen = (segment.person, segment.part, segment.start)
            if not segment.holds(self.frame):
                self.player.seek((segment.start + segment.stop) // 2)
            self.show()

    def change(self, edit_of: Callable[[Segment], Edit]) -> None:
        """Change the chosen segment."""
        segment = self.chosen
        if segment is None:
            self.panel.say("No contact is chosen. Choose a row or a point first.", wrong=True)
        else:
            self.commit(edit_of(segment))

    def drag_end(self, number: int, end: int, frame: int) -> None:
        """Show the frame to which an end of a contact's bar is dragged, and retime the contact once it lies still.

        Unlike the other actions it is done at once, in the caller's thread.
        """
        segments = self.edited.segments
        if number >= len(segments):
            return
        span = dragged(segments, number, end, frame)
        self.player.seek(span[end] - end)
        self._show_strip(number, (number, span))
        self.panel.say(dragged_text(segments[number], span))

        def task() -> None:
            segments = self.edited.segments
            if number < len(segments):
                segment, (start, stop) = segments[number], dragged(segments, number, end, frame)
                self._chosen = (segment.person, segment.part, segment.start)
                self.commit(Retime(segment.part, segment.start, start, stop, person=segment.person))

        self.worker.do_later(task, TYPING_DELAY_S, f"end {end} of {number}")

    def add(self, person: int, part: str, item: int) -> None:
        """Add a contact with an object from this frame on, where the robot's part is nearest to its surface."""
        clip, frame = self.edited.clip, self.frame
        own = [seg for seg in self.edited.segments if (seg.person, seg.part) == (person, part)]
        later = [segment.start for segment in own if segment.start > frame]
        stop = min([frame + seconds_to_frames(_NEW_CONTACT_S, clip.fps), clip.frames, *later])
        point = tuple(self._nearest_point(person, part, item, frame).tolist())
        self.commit(Add(part, frame, stop, point, person=person, object=clip.objects[item].name))
        self._chosen = (person, part, frame)
        self.show()

    def drag(self, point: Float[np.ndarray, "3"], turn: Float[np.ndarray, "3"], *, released: bool) -> None:
        """Move the chosen segment's point, in its object's frame at captured size [m], or turn its hand [degrees]."""
        segment = self.chosen
        if segment is None:
            return
        if self.panel.holds_on_surface:
            geometry = self.edited.clip.objects[segment.object].geometry
            point = surface_of(geometry).closest_points(point[None])[0]
        offset = point - segment.points.mean(axis=0)
        offset = np.round(offset, _DRAG_DECIMALS) + 0.0  # No minus before a zero.
        edit: Edit = Move(segment.part, segment.start, tuple(offset.tolist()), person=segment.person)
        if np.abs(turn - segment.turn).max() > _TURNED_DEG and segment.part in HANDS:
            turned = np.round(turn, _TURN_DECIMALS) + 0.0
            edit = TurnHand(segment.part, segment.start, tuple(turned.tolist()), person=segment.person)
        if released:
            self.commit(edit)
        else:
            solution = self.preview(edit)
            gaps = self._gaps.of(solution.segments)
            self.player.do(lambda: self._points.warn(gaps))
            self.panel.say(self._gap_text(solution))

    def undo_to(self, count: int) -> None:
        """Take edits back until so many are left."""
        if count < len(self.edited.edits.edits):
            self._step(lambda: self.session.undo_to(count), f"Back to {count} edits.")

    def compare(self, compared: bool) -> None:
        """Show or hide the last saved motion, in scene and curves."""
        self._compared = compared
        self.player.show_baseline(compared)
        self._draw(self.edited)

    def save_as(self, name: str) -> None:
        """Save the edits as a version."""
        path = self._targets.files.version(name)
        if os.path.lexists(path) and name != self._version:
            raise ArgumentError(f"there is a version {name} already. Choose another name, or load it first.")
        save(self.edited.edits, path)
        self._begin_from(name)
        self.show(f"Saved as {path}.")

    def load(self, name: str) -> None:
        """Go on from a version."""
        files, earlier = self._targets.files, self.edited
        self._load(files.version(name))
        message = f"Loaded {name}."
        if earlier.edits.edits != self._saved.edits.edits and os.path.lexists(files.unsaved):
            message += f" What was not saved is version {files.set_aside()} now."
            self._end_offer()
        self._begin_from(name)
        self.show(message)

    def restore_autosave(self) -> None:
        """Go on from the unsaved edits of an earlier session."""
        self._load(self._targets.files.unsaved)
        self._end_offer()
        self.show("Taken up again. They are not saved yet.")

    def _save_edits(self) -> None:
        save(self.edited.edits, self._targets.files.saved)
        self._on_save(self.edited)
        self._begin_from(None)
        self.show(f"Saved {_count(self.edited.edits)} to {self._targets.files.saved}.")

    def _save_result(self) -> None:
        """Solve the whole clip and write its motions."""
        if not self.edited.complete:
            self.session.solve_all()
        paths = self._targets.save_result(self.edited)
        self.show(f"Saved {', '.join(map(str, paths))}.")

    def _load(self, path: Path) -> None:
        edits = load(path)
        edits.made_for.check(self.session.recorded)
        self.session.commit(self.session.preview_all(edits))

    def _begin_from(self, version: str | None) -> None:
        """Make the current state the saved one: nothing is unsaved, and later states are compared with it."""
        self._saved, self._version = self.edited, version
        if not self.has_autosave:
            self._targets.files.forget()

    def _end_offer(self) -> None:
        self.has_autosave = False
        self.panel.hide_autosave()

    def _autosave(self) -> str:
        """Write unsaved edits, in case the connection or the server is lost; return a sentence on earlier ones."""
        files, message = self._targets.files, ""
        if self.has_autosave:
            self._end_offer()
            message = f" What was not saved last time is version {files.set_aside()} now."
        if self.edited.edits.edits == self._saved.edits.edits:
            files.forget()
        else:
            files.keep(self.edited.edits)
        return message

    def commit(self, edit: Edit) -> None:
        """Solve an edit, go on from it, and show it."""
        start = time.perf_counter()
        solution = self.session.preview(edit)
        solved = time.perf_counter()
        if isinstance(edit, Retime) and self._chosen is not None:
            person, part, frame = self._chosen
            # A frame that it still has: otherwise it would not be the chosen one any more.
            self._chosen = (person, part, min(max(frame, edit.start), edit.stop - 1))
        self.session.commit(solution)
        aside = self._autosave()
        self.show()
        drawn = time.perf_counter() - solved
        changes = changes_text(self.session.previous or self._first, solution)
        where = pin_text(solution, edit) if isinstance(edit, Pin) else self._gap_text(solution)
        message = f"{describe(solution.edits.edits[-1])}: {changes}. {where}"
        self.panel.say(f"{message} (solved in {1e3 * (solved - start):.0f} ms, drawn in {1e3 * drawn:.0f} ms){aside}")

    def _chosen_in(self, edited: EditState) -> Segment | None:
        if self._chosen is None:
            return None
        person, part, frame = self._chosen
        own = (item for item in edited.segments if (item.person, item.part) == (person, part))
        return next((item for item in own if item.holds(frame)), None)

    def _nearest_point(self, person: int, part: str, item: int, frame: int) -> np.ndarray:
        """Return the point of an object's surface next to a robot's part, at captured size [m]."""
        motion = self.edited.motions[person]
        kinematics = self.model.forward(motion.qpos[frame : frame + 1])
        place = kinematics.site_position(self.model.spec.contact_sites[part])[0] - motion.object_pos[frame, item]
        inside = se3.rotate_inverse(motion.object_quat[frame, item], place) / motion.object_scale[item]
        return surface_of(self.edited.clip.objects[item].geometry).closest_points(inside[None])[0]

    def _step(self, step: Callable[[], None], message: str) -> None:
        start = time.perf_counter()
        step()
        aside = self._autosave()
        self.show(f"{message} ({1e3 * (time.perf_counter() - start):.0f} ms){aside}")

    def _show_error(self, error: HoiRetargetError) -> None:
        self.show()
        self.panel.say(str(error), wrong=True)

    def show(self, message: str | None = None) -> None:
        """Show the current state, and a message where one is given."""
        now, chosen = self.edited, self.chosen
        self._draw(now)
        gaps = self._gaps.of(now.segments)
        self.player.do(lambda: self._points.show(now.segments, chosen, gaps))
        self._pins.show()
        self._ends.show(now.segments, self.drag_end)
        self._show_strip(None if chosen is None else now.segments.index(chosen))
        self.panel.show(now, chosen, gaps, recorded=self._first, previous=self.session.previous)
        self.panel.show_versions(self._targets.files.versions)
        if message is not None:
            self.panel.say(message)

    def _gap_text(self, edited: EditState) -> str:
        """Return the chosen contact's distance from its surface and its holds in words; empty where none is chosen."""
        chosen = self._chosen_in(edited)
        if chosen is None:
            return ""
        holds = [
            f"Hold: {hold}."
            for hold in edited.motions[chosen.person].report.holds
            if hold.part == chosen.part and hold.first_frame < chosen.stop and hold.last_frame >= chosen.start
        ]
        return " ".join([self._gaps.of([chosen])[0].text, *holds])

    def preview(self, edit: Edit) -> EditState:
        """Draw a quick solution of an edit, and return it."""
        solution = self.session.preview(edit, quickly=True)
        self._draw(solution)
        return solution

    def _draw(self, edited: EditState) -> None:
        self.player.redraw(self._content(edited))

    def _content(self, edited: EditState) -> PageContent:
        people = edited.clip.people
        titles = [person.name if len(people) > 1 else edited.clip.name for person in people]
        plain = page_content(
            [
                SceneItem(title, motion, self.model, edited.clip, person, baseline=baseline)
                for person, (title, motion, baseline) in enumerate(
                    zip(titles, edited.motions, self._saved.motions, strict=True)
                )
            ],
            compared=self._compared,
        )
        return replace(plain, strip_height_px=strip_height_px(edited.segments, edited.clip.pins))

    def _show_strip(self, chosen: int | None, moved: tuple[int, Span] | None = None) -> None:
        now = self.edited
        self.player.show_strip(
            strip_html(now.segments, now.clip.frames, chosen, pins=now.clip.pins, moved=moved, ends=self._ends.ids)
        )


def _count(edits: ContactEdits) -> str:
    """Return the number of edits in words."""
    count = len(edits.edits)
    return f"{count} edit{'s' if count != 1 else ''}"
