"""The contact editor for one browser: a row and a point for each contact, and the motion that follows them.

All work is done by one thread per browser, in the order in which it was asked for; of a point that is
being dragged only the latest place counts.
"""

import os
import time
from collections.abc import Callable, Sequence
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
    describe,
    load,
    save,
)
from hoi_retarget.clip.edits.versions import EditsFiles
from hoi_retarget.errors import ArgumentError, HoiRetargetError
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import frames_in
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.retargeting.config import Config
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.viewers.browser.client_sessions import serve_sessions
from hoi_retarget.viewers.browser.editing import Edited, Editing
from hoi_retarget.viewers.browser.editor_panel import PANEL_WIDTH_PX, EditorPanel, Keeping, changes_text
from hoi_retarget.viewers.browser.editor_pins import EditorPins, Work, pin_text
from hoi_retarget.viewers.browser.editor_points import EditorPoints
from hoi_retarget.viewers.browser.page_content import PageContent, page_content
from hoi_retarget.viewers.browser.player import Player
from hoi_retarget.viewers.browser.segment_strip import (
    SegmentEnds,
    Span,
    dragged,
    dragged_text,
    strip_height_px,
    strip_html,
)
from hoi_retarget.viewers.browser.server import PageServer
from hoi_retarget.viewers.browser.surface_gaps import SurfaceGaps
from hoi_retarget.viewers.browser.worker import Worker
from hoi_retarget.viewers.scene.scene import Shown

_TYPING_SECONDS = 0.6  # Of quiet, after which a number counts as typed.
_DIGITS = 4  # Of what is dragged [m]: tenths of a millimetre.
_NEW_SECONDS = 0.5  # Length of a contact that is added.


@dataclass(frozen=True)
class Places:
    """Destinations of the editor's work; a browser chooses none of them."""

    files: EditsFiles
    """Of the edits."""
    save_result: Callable[[Edited], tuple[Path, ...]]
    """Writes the motions and says where; raises `WriteError`."""


def serve_editor(  # noqa: PLR0913, PLR0917 - what an editor needs
    server: PageServer, recorded: Clip, model: RobotModel, config: Config, start: Edited, places: Places
) -> None:
    """Let every browser edit the contacts of a clip on its own, from what was saved last."""
    latest = start

    def keep(saved: Edited) -> None:
        nonlocal latest
        latest = saved

    serve_sessions(server, lambda client: Editor(client, Editing(recorded, model, config, latest), model, places, keep))


class Editor:
    """Shows a clip's contacts to one browser, and changes them as it asks, until `stop`."""

    def __init__(
        self,
        client: viser.ClientHandle,
        editing: Editing,
        model: RobotModel,
        places: Places,
        saved: Callable[[Edited], None],
    ) -> None:
        """Begin; `saved` is told what was written to the edits' file."""
        self._editing, self._model, self._places, self._saved = editing, model, places, saved
        self._kept = editing.now
        self._offered = os.path.lexists(places.files.unsaved)
        self._first, self._gaps = editing.now, SurfaceGaps(editing.recorded)
        self._chosen: tuple[int, str, int] | None = None
        self._compared = False
        self._version: str | None = None
        self._worker = Worker("editor")
        self._player = Player(client, self._content(editing.now), left_px=PANEL_WIDTH_PX)
        self._ends = SegmentEnds(self._player.timeline, client.gui, editing.recorded.frames)
        self._points = EditorPoints(client.scene, editing.now.motions[0], choose=self.choose, drag=self.drag)
        self._panel = EditorPanel(
            client.gui,
            editing.now,
            model,
            frame=lambda: self.frame,
            choose=self.choose,
            change=self.change,
            typed=self.typed,
            add=self.add,
            undo_to=self.undo_to,
            keeping=Keeping(
                self.compare,
                self.load,
                self.save_as,
                self._asked(self._take_up) if self._offered else None,
            ),
            commands=(
                {
                    "One point each": self._asked(lambda: self._commit(FixAll())),
                    "All to surface": self._asked(lambda: self._commit(SnapAll())),
                },
                {
                    "Undo": self._asked(lambda: self._go(editing.undo, "Taken back.")),
                    "Redo": self._asked(lambda: self._go(editing.redo, "Done again.")),
                },
                {"Solve whole clip": self._asked(lambda: self._go(editing.solve_all, "The whole clip is solved."))},
                {"Save edits": self._asked(self._save_edits), "Save result": self._asked(self._save_result)},
            ),
        )
        work = Work(self._do, self._do_latest, self._commit, self._preview, self._show)
        self._pins = EditorPins(client, editing, model, self._player, self._panel, work)
        self._player.attach(self._points.show_frame)
        self._worker.do(lambda: self._show(f"{len(editing.now.segments)} contacts. Choose a row or a point."))
        if self._offered:
            self._do(self._offer)

    def stop(self) -> None:
        """End the editor's work."""
        self._worker.stop()
        self._player.stop()

    @property
    def edited(self) -> Edited:
        """The current state of the work."""
        return self._editing.now

    @property
    def frame(self) -> int:
        """The current frame."""
        return self._player.frame

    @property
    def chosen(self) -> Segment | None:
        """The chosen segment; None where there is none."""
        return self._chosen_of(self._editing.now.segments)

    # What the browser asks for.

    def choose(self, index: int) -> None:
        """Choose a segment, and show a frame in which it is touched."""

        def task() -> None:
            segments = self._editing.now.segments
            if index < len(segments):
                segment = segments[index]
                self._chosen = (segment.person, segment.part, segment.start)
                if not segment.holds(self.frame):
                    self._player.seek((segment.start + segment.stop) // 2)
                self._show()

        self._do(task)

    def change(self, edit_of: Callable[[Segment], Edit]) -> None:
        """Change the chosen segment."""
        self._do(lambda: self._change(edit_of))

    def typed(self, kind: str, edit_of: Callable[[Segment], Edit]) -> None:
        """Change the chosen segment once nothing of a kind has been typed for a moment."""
        self._worker.do_later(lambda: self._guarded(lambda: self._change(edit_of)), _TYPING_SECONDS, kind)

    def drag_end(self, number: int, end: int, frame: int) -> None:
        """Show the frame to which an end of a contact's bar is dragged; retime the contact once it lies still."""
        segments = self._editing.now.segments
        if number >= len(segments):
            return
        span = dragged(segments, number, end, frame)
        self._player.seek(span[end] - end)
        self._show_strip(number, (number, span))
        self._panel.say(dragged_text(segments[number], span))

        def task() -> None:
            segments = self._editing.now.segments
            if number < len(segments):
                segment, (start, stop) = segments[number], dragged(segments, number, end, frame)
                self._chosen = (segment.person, segment.part, segment.start)
                self._commit(Retime(segment.part, segment.start, start, stop, person=segment.person))

        self._worker.do_later(lambda: self._guarded(task), _TYPING_SECONDS, f"end {end} of {number}")

    def add(self, person: int, part: str, item: int) -> None:
        """Add a contact with an object from this frame on, where the robot's part is nearest to its surface."""

        def task() -> None:
            clip, frame = self._editing.now.clip, self.frame
            free = [seg for seg in self._editing.now.segments if (seg.person, seg.part) == (person, part)]
            later = [segment.start for segment in free if segment.start > frame]
            stop = min([frame + frames_in(_NEW_SECONDS, clip.fps), clip.frames, *later])
            point = tuple(self._nearest_point(person, part, item, frame).tolist())
            self._commit(Add(part, frame, stop, point, person=person, object=clip.objects[item].name))
            self._chosen = (person, part, frame)
            self._show()

        self._do(task)

    def drag(self, point: Float[np.ndarray, "3"], *, released: bool) -> None:
        """Move the chosen segment's point, in its object's frame at captured size [m]."""
        if released:
            self._do(lambda: self._drag(point, released=True))
        else:
            self._do_latest(lambda: self._drag(point, released=False))

    def undo_to(self, count: int) -> None:
        """Take edits back until so many are left."""
        if count < len(self._editing.now.edits.edits):
            self._do(lambda: self._go(lambda: self._editing.undo_to(count), f"Back to {count} edits."))

    def compare(self, compared: bool) -> None:
        """Show the motion as it was when the edits were last saved, too, in scene and curves."""

        def task() -> None:
            self._compared = compared
            self._player.show_before(compared)
            self._draw(self._editing.now)

        self._do(task)

    def save_as(self, name: str) -> None:
        """Save the edits as a version."""

        def task() -> None:
            path = self._places.files.version(name)
            if os.path.lexists(path) and name != self._version:
                raise ArgumentError(f"there is a version {name} already. Choose another name, or load it first.")
            save(self._editing.now.edits, path)
            self._keep(name)
            self._show(f"Saved as {path}.")

        self._do(task)

    def load(self, name: str) -> None:
        """Go on from a version."""

        def task() -> None:
            files, before = self._places.files, self._editing.now
            self._load(files.version(name))
            told = f"Loaded {name}."
            if before.edits.edits != self._kept.edits.edits and os.path.lexists(files.unsaved):
                told += f" What was not saved is version {files.set_aside()} now."
                self._offered = False
                self._panel.offer(False)
            self._keep(name)
            self._show(told)

        self._do(task)

    # What is done about it, in the worker's thread.

    def _do(self, task: Callable[[], None]) -> None:
        self._worker.do(lambda: self._guarded(task))

    def _do_latest(self, task: Callable[[], None]) -> None:
        self._worker.do_latest(lambda: self._guarded(task))

    def _asked(self, task: Callable[[], None]) -> Callable[[], None]:
        return lambda: self._do(task)

    def _save_edits(self) -> None:
        save(self._editing.now.edits, self._places.files.saved)
        self._saved(self._editing.now)
        self._keep(None)
        self._show(f"Saved {_count(self._editing.now.edits)} to {self._places.files.saved}.")

    def _load(self, path: Path) -> None:
        edits = load(path)
        edits.made_for.check(self._editing.recorded)
        self._editing.take(self._editing.loaded(edits))

    def _keep(self, version: str | None) -> None:
        """Begin anew from what was saved or loaded: nothing is unsaved, and what comes is compared with this."""
        self._kept, self._version = self._editing.now, version
        if not self._offered:
            self._places.files.forget()

    def _offer(self) -> None:
        count = _count(load(self._places.files.unsaved))
        self._panel.say(f"{count} of last time not saved. Take them up, under Versions, or go on without.")

    def _take_up(self) -> None:
        """Go on from what nobody saved."""
        self._load(self._places.files.unsaved)
        self._offered = False
        self._panel.offer(False)
        self._show("Taken up again. They are not saved yet.")

    def _protect(self) -> str:
        """Keep what is not saved for the case that the connection or the server is lost; say what became of others."""
        files, told = self._places.files, ""
        if self._offered:
            self._offered = False
            self._panel.offer(False)
            told = f" What was not saved last time is version {files.set_aside()} now."
        if self._editing.now.edits.edits == self._kept.edits.edits:
            files.forget()
        else:
            files.keep(self._editing.now.edits)
        return told

    def _save_result(self) -> None:
        """Solve the whole clip and write its motions."""
        if not self._editing.now.complete:
            self._editing.solve_all()
        paths = self._places.save_result(self._editing.now)
        self._show(f"Saved {', '.join(map(str, paths))}.")

    def _change(self, edit_of: Callable[[Segment], Edit]) -> None:
        segment = self.chosen
        if segment is None:
            self._panel.say("No contact is chosen. Choose a row or a point first.", wrong=True)
        else:
            self._commit(edit_of(segment))

    def _commit(self, edit: Edit) -> None:
        start = time.perf_counter()
        tried = self._editing.tried(edit)
        solved = time.perf_counter()
        self._editing.take(tried)
        aside = self._protect()
        if isinstance(edit, Retime) and self._chosen is not None:
            person, part, frame = self._chosen
            # A frame that it still has: otherwise it would not be the chosen one any more.
            self._chosen = (person, part, min(max(frame, edit.start), edit.stop - 1))
        self._show()
        drawn = time.perf_counter() - solved
        changes = changes_text(self._editing.before or self._first, tried)
        where = pin_text(tried, edit) if isinstance(edit, Pin) else self._gap_text(tried)
        told = f"{describe(tried.edits.edits[-1])}: {changes}. {where}"
        self._panel.say(f"{told} (solved in {1e3 * (solved - start):.0f} ms, drawn in {1e3 * drawn:.0f} ms){aside}")

    def _chosen_of(self, segments: Sequence[Segment]) -> Segment | None:
        if self._chosen is None:
            return None
        person, part, frame = self._chosen
        own = (item for item in segments if (item.person, item.part) == (person, part))
        return next((item for item in own if item.holds(frame)), None)

    def _nearest_point(self, person: int, part: str, item: int, frame: int) -> np.ndarray:
        """Return the point of an object's surface next to a robot's part, at captured size [m]."""
        motion = self._editing.now.motions[person]
        kinematics = self._model.forward(motion.qpos[frame : frame + 1])
        place = kinematics.site_position(self._model.spec.part_sites[part])[0] - motion.object_pos[frame, item]
        inside = se3.rotate_inverse(motion.object_quat[frame, item], place) / motion.object_scale[item]
        return surface_of(self._editing.now.clip.objects[item].geometry).closest_points(inside[None])[0]

    def _drag(self, point: np.ndarray, *, released: bool) -> None:
        segment = self.chosen
        if segment is None:
            return
        if self._panel.holds_on_surface:
            geometry = self._editing.now.clip.objects[segment.object].geometry
            point = surface_of(geometry).closest_points(point[None])[0]
        offset = point - segment.points.mean(axis=0)
        offset = np.round(offset, _DIGITS) + 0.0  # No minus before a zero.
        edit = Move(segment.part, segment.start, tuple(offset.tolist()), person=segment.person)
        if released:
            self._commit(edit)
        else:
            tried = self._preview(edit)
            gaps = self._gaps.of(tried.segments)
            self._player.do(lambda: self._points.warn(gaps))
            self._panel.say(self._gap_text(tried))

    def _go(self, step: Callable[[], None], told: str) -> None:
        start = time.perf_counter()
        step()
        aside = self._protect()
        self._show(f"{told} ({1e3 * (time.perf_counter() - start):.0f} ms){aside}")

    def _guarded(self, task: Callable[[], None]) -> None:
        try:
            task()
        except HoiRetargetError as error:
            self._show()
            self._panel.say(str(error), wrong=True)

    # What is shown then.

    def _show(self, told: str | None = None) -> None:
        now, chosen = self._editing.now, self.chosen
        self._draw(now)
        gaps = self._gaps.of(now.segments)
        self._player.do(lambda: self._points.show(now.segments, chosen, gaps))
        self._pins.show()
        self._ends.show(now.segments, self.drag_end)
        self._show_strip(None if chosen is None else now.segments.index(chosen))
        self._panel.show(now, chosen, gaps, recorded=self._first, before=self._editing.before)
        self._panel.show_versions(self._places.files.versions)
        if told is not None:
            self._panel.say(told)

    def _gap_text(self, edited: Edited) -> str:
        """Return how far the chosen contact's point is off its surface; empty where none is chosen."""
        chosen = self._chosen_of(edited.segments)
        return "" if chosen is None else self._gaps.of([chosen])[0].text

    def _preview(self, edit: Edit) -> Edited:
        tried = self._editing.tried(edit, quickly=True)
        self._draw(tried)
        return tried

    def _draw(self, edited: Edited) -> None:
        self._player.redraw(self._content(edited))

    def _content(self, edited: Edited) -> PageContent:
        people = edited.clip.people
        titles = [person.name if len(people) > 1 else edited.clip.name for person in people]
        plain = page_content(
            [
                Shown(title, motion, self._model, edited.clip, person, before=before)
                for person, (title, motion, before) in enumerate(
                    zip(titles, edited.motions, self._kept.motions, strict=True)
                )
            ],
            compared=self._compared,
        )
        return replace(plain, strip_height_px=strip_height_px(edited.segments, edited.clip.pins))

    def _show_strip(self, chosen: int | None, moved: tuple[int, Span] | None = None) -> None:
        now = self._editing.now
        self._player.show_strip(
            strip_html(now.segments, now.clip.frames, chosen, pins=now.clip.pins, moved=moved, ends=self._ends.ids)
        )


def _count(edits: ContactEdits) -> str:
    """Return how many edits there are."""
    count = len(edits.edits)
    return f"{count} edit{'s' if count != 1 else ''}"
