"""The editor's panel: a row for each contact, what can be done to the chosen one and to all, and the figures."""

from collections.abc import Callable
from html import escape
from typing import Any, Protocol, runtime_checkable

import numpy as np
import viser
from jaxtyping import Float

from hoi_retarget.clip.edits import (
    Delete,
    Edit,
    Fix,
    FixAll,
    Merge,
    Move,
    Retime,
    Segment,
    Snap,
    SnapAll,
    Split,
    part_text,
)
from hoi_retarget.evaluate import COLUMNS, contact_residuals
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.viewers.browser.editing import Edited

PANEL_WIDTH_PX = 340
_FIGURES = (
    "contact_gap_m",
    "contact_gap_max_m",
    "relative_hand_rotation_deg",
    "body_jerk_mps3",
    "body_jerk_max_mps3",
    "stance_slide_mps",
)
_DIGITS = 4  # Of a point's coordinates [m], as they are shown.
_TABLE_STYLE = "font-size:12px;width:100%;text-align:right;border-spacing:0 1px"


@runtime_checkable
class Asked(Protocol):
    """Who does what the panel asks for: `editor.Editor`."""

    @property
    def frame(self) -> int:
        """The frame that is shown now."""
        ...

    def choose(self, index: int) -> None:
        """Choose a segment."""

    def change(self, edit_of: Callable[[Segment], Edit]) -> None:
        """Change the chosen segment."""

    def typed(self, edit_of: Callable[[Segment], Edit]) -> None:
        """Change it once nothing has been typed for a moment."""

    def commit(self, edit: Edit) -> None:
        """Make an edit that names its contacts itself."""

    def add(self, person: int, part: str, item: int) -> None:
        """Add a contact of a part with an object."""

    def undo(self) -> None:
        """Take the last edit back."""

    def redo(self) -> None:
        """Do again what was taken back."""

    def solve_all(self) -> None:
        """Solve the whole clip."""

    def save_edits(self) -> None:
        """Write the edits' file."""

    def save_result(self) -> None:
        """Write the motions."""


class EditorPanel:
    """The widgets of one browser."""

    def __init__(self, gui: viser.GuiApi, edited: Edited, model: RobotModel, asked: Asked) -> None:
        self._gui, self._model, self._asked = gui, model, asked
        self._rows: list[viser.GuiButtonHandle] = []
        panel = gui.add_panel()
        with panel.add_tab("Contacts", viser.Icon.HAND_GRAB):
            self._told = gui.add_html("")
            self._rows_folder = gui.add_folder("Contacts")
            with gui.add_folder("Chosen contact"):
                self._add_chosen(edited.clip.frames)
            if edited.clip.objects:
                with gui.add_folder("New contact", expand_by_default=False):
                    self._add_new(edited)
            with gui.add_folder("All"):
                self._add_all()
            with gui.add_folder("Figures"):
                self._figures = gui.add_html("")
        panel.dock_left()
        panel.set_width(PANEL_WIDTH_PX)

    @property
    def holds_on_surface(self) -> bool:
        """Whether a dragged point is put onto the object's surface."""
        return self._surface.value

    def say(self, text: str, *, wrong: bool = False) -> None:
        """Show what was done, or why it could not be."""
        colours = "#fdecea;color:#611a15" if wrong else "#eef5fb;color:#1d3c55"
        style = f"margin:0.5em;padding:0.4em 0.6em;font-size:12px;border-radius:4px;background:{colours}"
        self._told.content = f'<div class="told" style="{style}">{escape(text)}</div>'

    def show(self, edited: Edited, chosen: Segment | None, *, recorded: Edited, before: Edited | None) -> None:
        """Show the contacts and figures as they are now."""
        self._show_rows(edited, chosen)
        if chosen is not None:
            point = chosen.points.mean(axis=0)
            self._frames.value = (chosen.start, chosen.stop - 1)
            self._point.value = tuple(np.round(point, _DIGITS).tolist())
        self._figures.content = _figures_html(recorded, before or recorded, edited)

    def _show_rows(self, edited: Edited, chosen: Segment | None) -> None:
        gaps = [contact_residuals(motion, self._model.forward(motion.qpos)) for motion in edited.motions]
        several = len(edited.clip.people) > 1
        labels = []
        for segment in edited.segments:
            links = edited.motions[segment.person].contact_links
            site = self._model.spec.part_sites.get(segment.part)
            own = (
                gaps[segment.person][segment.start : segment.stop, links.index(site)] if site in links else np.zeros(0)
            )
            gap = f"{1e3 * np.nanmean(own):.1f} mm" if np.isfinite(own).any() else "not followed"
            name = part_text(segment.person, segment.part) if several else segment.part
            labels.append(f"{name.replace('_', ' ')}  {segment.start} - {segment.stop - 1}  ({gap})")
        while len(self._rows) > len(labels):
            self._rows.pop().remove()
        with self._rows_folder:
            for index in range(len(self._rows), len(labels)):
                self._rows.append(self._add_row(index))
        for row, label, segment in zip(self._rows, labels, edited.segments, strict=True):
            row.label, row.color = label, "orange" if segment is chosen else "gray"

    def _add_row(self, index: int) -> viser.GuiButtonHandle:
        row = self._gui.add_button("", color="gray")
        row.on_click(lambda _: self._asked.choose(index))
        return row

    def _add_chosen(self, frames: int) -> None:
        gui, change = self._gui, self._asked.change
        self._frames = gui.add_multi_slider("Frames", 0, frames - 1, 1, (0, frames - 1), hint="First and last frame")
        self._frames.on_update(self._on_frames)
        self._point = gui.add_vector3("Point [m]", (0.0, 0.0, 0.0), step=0.001, hint="In the object's frame")
        self._point.on_update(self._on_point)
        self._surface = gui.add_checkbox("On surface", False, hint="A dragged point stays on the object's surface")
        self._add_choices(
            {
                "Start here": lambda s: Retime(s.part, s.start, self._asked.frame, s.stop, s.person),
                "End here": lambda s: Retime(s.part, s.start, s.start, self._asked.frame + 1, s.person),
            },
            change,
        )
        self._add_choices(
            {
                "Split here": lambda s: Split(s.part, s.start, self._asked.frame, s.person),
                "Merge with next": lambda s: Merge(s.part, s.start, s.person),
            },
            change,
        )
        self._add_choices(
            {
                "One point": lambda s: Fix(s.part, s.start, person=s.person),
                "To surface": lambda s: Snap(s.part, s.start, s.person),
                "Delete": lambda s: Delete(s.part, s.start, s.person),
            },
            change,
        )

    def _add_new(self, edited: Edited) -> None:
        gui, clip = self._gui, edited.clip
        several = len(clip.people) > 1
        parts = {
            part_text(person, part) if several else part: (person, part)
            for person in range(len(clip.people))
            for part in self._model.spec.part_sites
        }
        part = gui.add_dropdown("Part", tuple(parts), initial_value=next(iter(parts)))
        names = tuple(track.name for track in clip.objects)
        target = gui.add_dropdown("Object", names, initial_value=names[0])
        button = gui.add_button("Add at this frame", hint="Where the part is nearest to the object's surface")
        button.on_click(lambda _: self._asked.add(*parts[part.value], names.index(target.value)))

    def _add_all(self) -> None:
        asked = self._asked
        self._add_choices({"One point each": FixAll(), "All to surface": SnapAll()}, asked.commit)
        self._add_choices({"Undo": asked.undo, "Redo": asked.redo}, lambda ask: ask())
        self._add_choices({"Solve whole clip": asked.solve_all}, lambda ask: ask())
        self._add_choices({"Save edits": asked.save_edits, "Save result": asked.save_result}, lambda ask: ask())
        self._gui.add_command("Undo", hotkey="Z", modifier="cmd/ctrl").on_trigger(lambda _: asked.undo())
        self._gui.add_command("Redo", hotkey="Y", modifier="cmd/ctrl").on_trigger(lambda _: asked.redo())
        self._gui.add_command("Save edits", hotkey="S", modifier="cmd/ctrl").on_trigger(lambda _: asked.save_edits())

    def _add_choices(self, choices: dict[str, Any], ask: Callable[[Any], None]) -> None:
        group = self._gui.add_button_group("", tuple(choices))
        group.on_click(lambda event: ask(choices[event.target.value]))

    def _on_frames(self, event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:
            first, last = event.target.value
            self._asked.typed(lambda s: Retime(s.part, s.start, int(first), int(last) + 1, s.person))

    def _on_point(self, event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:
            point = np.array(event.target.value)
            self._asked.typed(lambda s: _moved_to(s, point))


def _moved_to(segment: Segment, point: Float[np.ndarray, "3"]) -> Edit:
    middle = segment.points.mean(axis=0)
    # What was shown rounded, and not typed over, stays.
    offset = np.where(point == np.round(middle, _DIGITS), 0.0, np.round(point - middle, _DIGITS + 2))
    return Move(segment.part, segment.start, tuple(offset.tolist()), segment.person)


def _figures_html(recorded: Edited, before: Edited, now: Edited) -> str:
    """Return the figures as recorded, before the last change, and now, for each person."""
    rows = []
    for person, name in enumerate(track.name for track in now.clip.people):
        sides = [edited.motions[person].report.figures for edited in (recorded, before, now)]
        if len(now.clip.people) > 1:
            rows.append(f'<tr><th colspan="4" style="text-align:left">{escape(name)}</th></tr>')
        for column in (column for column in COLUMNS if column.name in _FIGURES):
            cells = "".join(f"<td>{column.text(side[column.name])}</td>" for side in sides)
            rows.append(f'<tr><td style="text-align:left">{escape(column.header)}</td>{cells}</tr>')
    head = "<tr><th></th><th>start</th><th>before</th><th>now</th></tr>"
    return f'<table class="before-after" style="{_TABLE_STYLE}">{head}{"".join(rows)}</table>'
