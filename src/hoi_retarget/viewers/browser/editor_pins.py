"""The editor's pins: the handle that makes them, their part of the panel, and what they come to be in words."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser
from jaxtyping import Float

from hoi_retarget.clip.edits import Edit, Pin, Unpin, part_text
from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.targets import pinned_sites, recorded_rotation
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.viewers.browser.editing import Edited, Editing
from hoi_retarget.viewers.browser.editor_panel import EditorPanel
from hoi_retarget.viewers.browser.pin_handle import PinHandle
from hoi_retarget.viewers.browser.player import Player

_NOTHING: str = "nothing"
_NO_PINS: str = "none"
_DIGITS, _TURN_DIGITS = 4, 1  # Of what is dragged [m], [degrees]: tenths of a millimetre and of a degree.


@dataclass(frozen=True)
class Work:
    """What the editor does for pins."""

    do: Callable[[Callable[[], None]], None]
    """Does a task after what was asked for before."""
    do_latest: Callable[[Callable[[], None]], None]
    """Does a task unless something else is asked for until then."""
    commit: Callable[[Edit], None]
    preview: Callable[[Edit], Edited]
    """Draws what an edit would make, and returns it."""
    show: Callable[[], None]


class EditorPins:
    """Pins the part that has the handle, where the handle is dragged to."""

    def __init__(  # noqa: PLR0913, PLR0917 - what pins need of the editor
        self,
        client: viser.ClientHandle,
        editing: Editing,
        model: RobotModel,
        player: Player,
        panel: EditorPanel,
        work: Work,
    ) -> None:
        self._editing, self._model, self._player, self._panel, self._work = editing, model, player, panel, work
        self._part: tuple[int, str] | None = None
        self._handle = PinHandle(client.scene, self.drag)
        player.attach(self._handle.show_frame)
        with panel.pose:
            self._add_widgets(client.gui)

    def _add_widgets(self, gui: viser.GuiApi) -> None:
        people = len(self._editing.now.clip.people)
        self._parts: dict[str, tuple[int, str] | None] = {_NOTHING: None} | {
            (part_text(person, part) if people > 1 else part).replace("_", " "): (person, part)
            for person in range(people)
            for part in pinned_sites(self._model)
        }
        hint = "Gets a handle; drag it to pin the part at this frame"
        self._chosen = gui.add_dropdown("Pin", tuple(self._parts), initial_value=_NOTHING, hint=hint)
        self._turns = gui.add_checkbox("Turn too", False, hint="Pin the rotation as well")
        for widget in (self._chosen, self._turns):
            widget.on_update(lambda event: self._work.do(self._choose) if event.client else None)
        self._pins = gui.add_dropdown("Pins", (_NO_PINS,), hint="All pins; choose one to go there")
        self._pins.on_update(self._on_pins)
        unpin = gui.add_button_group("", ("Unpin here",))
        unpin.on_click(lambda _: self._work.do(self._unpin))

    def show(self) -> None:
        """Show the pins and the handle as they are now."""
        options = _pins_of(self._editing.now)
        if self._pins.options != options:
            self._pins.options = options
        self._pins.value = options[0]
        if self._part is None:
            self._player.do(self._handle.hide)
            return
        (person, part), now = self._part, self._editing.now
        draft, own = now.drafts[person], [pin for pin in now.clip.pins if (pin.person, pin.part) == self._part]
        kinematics, site = self._model.forward(draft.motion.qpos), pinned_sites(self._model)[part]
        path = kinematics.site_position(site).copy()
        for pin in own:
            path[pin.frame] = draft.targets.root_scale * np.array(pin.position)
        quats, turns = se3.matrix_to_quat(kinematics.site_rotation(site)), self._turns.value
        self._player.do(lambda: self._handle.show(path, quats, turns=turns))

    def drag(self, frame: int, position: Float[np.ndarray, "3"], quat: Float[np.ndarray, "4"], released: bool) -> None:
        """Pin the part that has the handle, at a place of the robot's world [m]."""

        def task() -> None:
            if self._part is None:
                return
            pin = self._pin_at(*self._part, frame, position, quat)
            if released:
                self._work.commit(pin)
            else:
                self._panel.say(pin_text(self._work.preview(pin), pin))

        (self._work.do if released else self._work.do_latest)(task)

    def _choose(self) -> None:
        self._part = self._parts[self._chosen.value]
        self._work.show()

    def _on_pins(self, event: viser.GuiEvent[Any]) -> None:
        number = event.target.options.index(event.target.value) - 1
        if event.client is not None and number >= 0:
            self._work.do(lambda: self._go_to(number))

    def _go_to(self, number: int) -> None:
        """Show a pin, and give its part the handle."""
        if number < len(self._editing.now.clip.pins):
            pin = self._editing.now.clip.pins[number]
            self._part = (pin.person, pin.part)
            self._chosen.value = next(name for name, each in self._parts.items() if each == self._part)
            self._player.seek(pin.frame)
            self._work.show()

    def _unpin(self) -> None:
        if self._part is None:
            self._panel.say("No part is chosen. Choose one beside Pin first.", wrong=True)
        else:
            person, part = self._part
            self._work.commit(Unpin(part, self._player.frame, person=person))

    def _pin_at(self, person: int, part: str, frame: int, position: np.ndarray, quat: np.ndarray) -> Pin:
        """Return the pin at a place of the robot's world; without a turn of its own it keeps an earlier one's."""
        draft, now = self._editing.now.drafts[person], self._editing.now.clip
        place = np.round(position / draft.targets.root_scale, _DIGITS) + 0.0  # No minus before a zero.
        own = [pin for pin in now.pins if (pin.person, pin.part, pin.frame) == (person, part, frame)]
        turn = own[0].turn if own else None
        if self._turns.value:
            recorded = recorded_rotation(draft.targets, self._model.forward(draft.motion.stages[0].qpos), part)[frame]
            vector = np.degrees(se3.log(se3.quat_multiply(quat, se3.quat_conjugate(recorded))))
            x, y, z = (np.round(vector, _TURN_DIGITS) + 0.0).tolist()
            turn = (x, y, z)
        return Pin(part, frame, tuple(place.tolist()), turn, person=person)


def pin_text(edited: Edited, pin: Pin) -> str:
    """Return how far off a pin its part came to be."""
    parts = edited.motions[pin.person].report.pins
    own = next(item for item in parts if (item.part, item.frame) == (pin.part, pin.frame))
    return f"The {own}{': out of reach, or in the way of something' if own.missed else ''}."


def _pins_of(edited: Edited) -> tuple[str, ...]:
    """Return all pins in words, behind a line that says how many there are."""
    off = {
        (person, item.part, item.frame): item
        for person, motion in enumerate(edited.motions)
        for item in motion.report.pins
    }
    texts = [
        f"{part_text(pin.person, pin.part).replace('_', ' ')} {pin.frame} "
        f"({1e3 * off[pin.person, pin.part, pin.frame].off_m:.0f} mm off)"
        for pin in edited.clip.pins
    ]
    return (f"{len(texts)} pinned" if texts else _NO_PINS, *texts)
