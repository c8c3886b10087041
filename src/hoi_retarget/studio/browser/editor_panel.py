"""The editor's panel: a row for each contact, actions on the chosen one and on all, and the figures."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import viser

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits import (
    ChooseHold,
    Delete,
    Edit,
    Fix,
    Merge,
    Move,
    Retime,
    Segment,
    Snap,
    Split,
    TurnHand,
    describe,
    part_text,
)
from hoi_retarget.evaluation import COLUMNS
from hoi_retarget.evaluation.surface_distances import distances_of_motion
from hoi_retarget.studio.browser.edit_session import EditState
from hoi_retarget.studio.browser.player import MESSAGE, on_change_by_user
from hoi_retarget.studio.browser.strip import SurfaceGap
from hoi_retarget.studio.html import render, with_exponents

if TYPE_CHECKING:
    from hoi_retarget.studio.browser.editor import Editor

PANEL_WIDTH_PX = 340
_FIGURES = (
    "contact_gap_m",
    "contact_gap_max_m",
    "relative_hand_rotation_deg",
    "body_jerk_mps3",
    "body_jerk_max_mps3",
    "stance_slide_mps",
)
_HOTKEYS: Mapping[str, Literal["Z", "Y", "S"]] = {"Undo": "Z", "Redo": "Y", "Save edits": "S"}
_RECORDED: str = "0: as recorded"
_NO_VERSION: str = "-"
TYPING_DELAY_S = 0.6
"""Without a change, after which a number counts as typed [s]."""
_DIGITS = 4  # Of a point's coordinates [m], as they are shown.


class EditorPanel:
    """The widgets of one browser."""

    def __init__(self, gui: viser.GuiApi, editor: "Editor") -> None:
        self._gui, self._editor, self._model, self._do = gui, editor, editor.model, editor.worker.do
        self._rows: list[viser.GuiButtonHandle] = []
        clip = editor.edited.clip
        panel = gui.add_panel()
        with panel.add_tab("Contacts", viser.Icon.HAND_GRAB):
            self._message = gui.add_html("")
            self._rows_folder = gui.add_folder("Contacts")
            with gui.add_folder("Chosen contact"):
                self._add_chosen(clip.frames)
            if clip.objects:
                with gui.add_folder("New contact", expand_by_default=False):
                    self._add_new(clip)
            self.pose = gui.add_folder("Pose")
            """Folder of the pins' widgets."""
            with gui.add_folder("All"):
                self._add_commands(editor.commands)
                hint = "All that was done; choose one to go back to it"
                self._edits = gui.add_dropdown("Edits", (_RECORDED,), hint=hint)
                on_change_by_user(self._edits, self._undo_to)
            with gui.add_folder("Figures"):
                self._figures = gui.add_html("")
            with gui.add_folder("Versions"):
                self._add_versions()
        panel.expand()  # In a narrow window it would begin closed.
        panel.dock_left()
        panel.set_width(PANEL_WIDTH_PX)

    @property
    def holds_on_surface(self) -> bool:
        """Whether a dragged point is put onto the object's surface."""
        return self._surface.value

    def hide_autosave(self) -> None:
        """Hide the button that takes up unsaved edits."""
        if self._restore is not None:
            self._restore.visible = False

    def show_versions(self, names: Sequence[str]) -> None:
        """Show the names of the versions."""
        options = (_NO_VERSION, *names)
        if self._versions.options != options:
            self._versions.options = options
        self._versions.value = _NO_VERSION

    def say(self, text: str, *, wrong: bool = False) -> None:
        """Show a message on the last action, or on its failure."""
        self._message.content = render(MESSAGE, kind="wrong" if wrong else "done", text=text)

    def show(
        self,
        edited: EditState,
        chosen: Segment | None,
        off: Sequence[SurfaceGap],
        *,
        recorded: EditState,
        previous: EditState | None,
    ) -> None:
        """Show the contacts, their distances from surfaces, and the current figures.

        Args:
            edited: The current state.
            chosen: The chosen contact, if any.
            off: Distance of each contact's point from its surface.
            recorded: The state at the beginning.
            previous: The state before the last change, if any.
        """
        self._show_rows(edited, chosen, off)
        if chosen is not None:
            point = chosen.points.mean(axis=0)
            self._frames.value = (chosen.start, chosen.stop - 1)
            self._point.value = tuple(np.round(point, _DIGITS).tolist())
            self._turn.value = tuple(np.round(chosen.turn, 1).tolist())
        self._figures.content = _figures_html(recorded, previous or recorded, edited)
        options = (_RECORDED, *(f"{number}: {describe(edit)}" for number, edit in enumerate(edited.edits.edits, 1)))
        if self._edits.options != options:
            self._edits.options = options
        self._edits.value = options[-1]

    def _show_rows(self, edited: EditState, chosen: Segment | None, off: Sequence[SurfaceGap]) -> None:
        geometries = tuple(track.geometry for track in edited.clip.objects)
        gaps = [distances_of_motion(motion, self._model, geometries)[1] for motion in edited.motions]
        several = len(edited.clip.people) > 1
        labels = []
        for segment, place in zip(edited.segments, off, strict=True):
            links = edited.motions[segment.person].contact_links
            site = self._model.spec.contact_sites.get(segment.part)
            own = (
                gaps[segment.person][segment.start : segment.stop, links.index(site)] if site in links else np.zeros(0)
            )
            mean = 1e3 * np.nanmean(own) if np.isfinite(own).any() else None
            gap = "not followed" if mean is None else f"{abs(mean):.1f} mm {'off' if mean > 0 else 'inside'}"
            name = part_text(segment.person, segment.part) if several else segment.part
            if place.in_thin_air:
                gap = f"point {1e3 * place.distance:.0f} mm off"
            labels.append(f"{name.replace('_', ' ')}  {segment.start} - {segment.stop - 1}  ({gap})")
        while len(self._rows) > len(labels):
            self._rows.pop().remove()
        with self._rows_folder:
            for index in range(len(self._rows), len(labels)):
                self._rows.append(self._add_row(index))
        for row, label, segment, place in zip(self._rows, labels, edited.segments, off, strict=True):
            row.label = label
            row.color = "yellow" if place.in_thin_air else "orange" if segment is chosen else "gray"

    def _add_row(self, index: int) -> viser.GuiButtonHandle:
        row = self._gui.add_button("", color="gray")
        row.on_click(lambda _: self._do(partial(self._editor.choose, index)))
        return row

    def _add_chosen(self, frames: int) -> None:
        gui = self._gui
        self._frames = gui.add_multi_slider("Frames", 0, frames - 1, 1, (0, frames - 1), hint="First and last frame")
        on_change_by_user(self._frames, self._retime)
        self._point = gui.add_vector3("Point [m]", (0.0, 0.0, 0.0), step=0.001, hint="In the object's frame")
        on_change_by_user(self._point, self._move)
        hint = "Rotation of the hand about the object's axes, from the recorded one"
        self._turn = gui.add_vector3("Turn [deg]", (0.0, 0.0, 0.0), step=1.0, hint=hint)
        on_change_by_user(self._turn, self._rotate)
        self._surface = gui.add_checkbox("On surface", False, hint="A dragged point stays on the object's surface")
        for edits in (
            {
                "Start here": lambda s: Retime(s.part, s.start, self._editor.frame, s.stop, person=s.person),
                "End here": lambda s: Retime(s.part, s.start, s.start, self._editor.frame + 1, person=s.person),
            },
            {
                "Split here": lambda s: Split(s.part, s.start, self._editor.frame, person=s.person),
                "Merge with next": lambda s: Merge(s.part, s.start, person=s.person),
            },
            {
                "Next hold": lambda s: ChooseHold(s.part, s.start, s.hold + 2, person=s.person),
                "Hold before": lambda s: ChooseHold(s.part, s.start, max(s.hold, 1), person=s.person),
            },
            {
                "One point": lambda s: Fix(s.part, s.start, person=s.person),
                "To surface": lambda s: Snap(s.part, s.start, person=s.person),
                "Delete": lambda s: Delete(s.part, s.start, person=s.person),
            },
        ):
            self._add_choices(edits, lambda edit_of: self._do(partial(self._editor.change, edit_of)))

    def _add_new(self, clip: Clip) -> None:
        gui = self._gui
        several = len(clip.people) > 1
        parts = {
            part_text(person, part) if several else part: (person, part)
            for person in range(len(clip.people))
            for part in self._model.spec.contact_sites
        }
        part = gui.add_dropdown("Part", tuple(parts), initial_value=next(iter(parts)))
        names = tuple(track.name for track in clip.objects)
        target = gui.add_dropdown("Object", names, initial_value=names[0])
        button = gui.add_button("Add at this frame", hint="Where the part is nearest to the object's surface")
        button.on_click(lambda _: self._do(partial(self._editor.add, *parts[part.value], names.index(target.value))))

    def _add_versions(self) -> None:
        gui, editor = self._gui, self._editor
        self._restore: viser.GuiButtonHandle | None = None
        if editor.has_autosave:
            self._restore = gui.add_button("Take up unsaved edits", color="yellow")
            self._restore.on_click(lambda _: self._do(editor.restore_autosave))
        compared = gui.add_checkbox("Before", False, hint="Scene and curves as they were when last saved, too")
        compared.on_update(lambda event: self._do(partial(editor.compare, event.target.value)))
        self._versions = gui.add_dropdown("Load", (_NO_VERSION,), hint="Versions by name; choose one to go on from it")
        on_change_by_user(self._versions, self._load)
        name = gui.add_text("Name", "", hint="Of a version")
        self._add_choices({"Save as": editor.save_as}, lambda save: self._do(partial(save, name.value.strip())))

    def _load(self, name: str) -> None:
        if name != _NO_VERSION:
            self._do(partial(self._editor.load, name))

    def _add_commands(self, commands: Sequence[Mapping[str, Callable[[], None]]]) -> None:
        for row in commands:
            self._add_choices(row, self._do)
        by_name = {name: command for row in commands for name, command in row.items()}
        for name, key in _HOTKEYS.items():
            handle = self._gui.add_command(name, hotkey=key, modifier="cmd/ctrl")
            handle.on_trigger(lambda _, name=name: self._do(by_name[name]))

    def _add_choices(self, choices: Mapping[str, Any], do: Callable[[Any], None]) -> None:
        group = self._gui.add_button_group("", tuple(choices))
        group.on_click(lambda event: do(choices[event.target.value]))

    def _undo_to(self, text: str) -> None:
        if text in self._edits.options:
            self._do(partial(self._editor.undo_to, self._edits.options.index(text)))

    def _retime(self, span: tuple[int, int]) -> None:
        first, last = map(int, span)
        self._change_when_typed("frames", lambda s: Retime(s.part, s.start, first, last + 1, person=s.person))

    def _move(self, place: tuple[float, float, float]) -> None:
        point = np.array(place)

        def moved(segment: Segment) -> Edit:
            middle = segment.points.mean(axis=0)
            # Coordinates that were shown rounded, and not typed over, stay.
            offset = np.where(point == np.round(middle, _DIGITS), 0.0, np.round(point - middle, _DIGITS + 2))
            return Move(segment.part, segment.start, tuple(offset.tolist()), person=segment.person)

        self._change_when_typed("point", moved)

    def _rotate(self, turn: tuple[float, float, float]) -> None:
        self._change_when_typed("turn", lambda s: TurnHand(s.part, s.start, turn, person=s.person))

    def _change_when_typed(self, kind: str, edit_of: Callable[[Segment], Edit]) -> None:
        """Change the chosen contact once nothing of a kind has been typed for a moment."""
        self._editor.worker.do_later(partial(self._editor.change, edit_of), TYPING_DELAY_S, kind)


def changes_text(before: EditState, now: EditState) -> str:
    """Return the changed figures, such as `contact gap 1.5 -> 2.9 mm`; the first person's of several."""
    sides = [edited.motions[0].report.figures for edited in (before, now)]
    changes = []
    for column in (column for column in COLUMNS if column.name in _FIGURES):
        texts = [column.text(side.get(column.name)) for side in sides]
        if texts[0] != texts[1]:
            changes.append(f"{column.title} {texts[0]} -> {texts[1]} {with_exponents(column.unit)}")
    return ", ".join(changes) or "no figure changed"


def _figures_html(recorded: EditState, before: EditState, now: EditState) -> str:
    """Return the figures as recorded, before the last change, and now, for each person."""
    rows: list[tuple[str, list[str]]] = []
    for person, name in enumerate(track.name for track in now.clip.people):
        sides = [edited.motions[person].report.figures for edited in (recorded, before, now)]
        if len(now.clip.people) > 1:
            rows.append((name, []))
        for column in (column for column in COLUMNS if column.name in _FIGURES):
            rows.append((column.header, [column.text(side[column.name]) for side in sides]))
    heads = ("start", "before", "now")
    return render("studio/browser/page/figures.html.j2", kind="before-after", heads=heads, rows=rows)
