"""Handles of the editor in the scene: a part of the robot is pinned by one, the chosen contact's point moved by one."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import viser
from jaxtyping import Float

from hoi_retarget.clip.edits import Pin, Segment, Unpin, part_text
from hoi_retarget.human.skeleton import HANDS
from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.targets import pinned_sites, recorded_rotation
from hoi_retarget.studio.browser.edit_session import EditState
from hoi_retarget.studio.browser.player import WORLD, on_change_by_user
from hoi_retarget.studio.browser.strip import SurfaceGap

if TYPE_CHECKING:
    from hoi_retarget.studio.browser.editor import Editor

_SIZE = 0.25  # [m]

_NOTHING: str = "nothing"
_NO_PINS: str = "none"
_DIGITS, _TURN_DIGITS = 4, 1  # Of what is dragged [m], [degrees]: tenths of a millimetre and of a degree.


class EditorPins:
    """Pins the part that has the handle to the place to which the handle is dragged.

    The handle follows its part from frame to frame; where the part is pinned, it is at the pin.
    """

    def __init__(self, client: viser.ClientHandle, editor: "Editor") -> None:
        self._api, self._editor, self._session, self._model = client.scene, editor, editor.session, editor.model
        self._part: tuple[int, str] | None = None
        self._handle: viser.TransformControlsHandle | None = None
        self._positions, self._quats = np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]])
        self._frame = 0
        self._held: int | None = None  # The frame at which the handle was taken.
        editor.player.attach(self._show_frame)
        with editor.panel.pose:
            self._add_widgets(client.gui)

    def _add_widgets(self, gui: viser.GuiApi) -> None:
        editor = self._editor
        people = len(self._session.now.clip.people)
        self._parts: dict[str, tuple[int, str] | None] = {_NOTHING: None} | {
            (part_text(person, part) if people > 1 else part).replace("_", " "): (person, part)
            for person in range(people)
            for part in pinned_sites(self._model)
        }
        hint = "Gets a handle; drag it to pin the part at this frame"
        self._chosen = gui.add_dropdown("Pin", tuple(self._parts), initial_value=_NOTHING, hint=hint)
        self._turns = gui.add_checkbox("Turn too", False, hint="Pin the rotation as well")
        for widget in (self._chosen, self._turns):
            on_change_by_user(widget, lambda _: editor.worker.do(self._choose))
        self._pins = gui.add_dropdown("Pins", (_NO_PINS,), hint="All pins; choose one to go there")
        on_change_by_user(self._pins, self._go_to)
        unpin = gui.add_button_group("", ("Unpin here",))
        unpin.on_click(lambda _: editor.worker.do(self._unpin))

    def show(self) -> None:
        """Show the pins and the handle as they are now."""
        options = _pins_of(self._session.now)
        if self._pins.options != options:
            self._pins.options = options
        self._pins.value = options[0]
        if self._part is None:
            self._editor.player.do(self._hide_handle)
            return
        (person, part), now = self._part, self._session.now
        draft, own = now.drafts[person], [pin for pin in now.clip.pins if (pin.person, pin.part) == self._part]
        kinematics, site = self._model.forward(draft.motion.qpos), pinned_sites(self._model)[part]
        path = kinematics.site_position(site).copy()
        for pin in own:
            path[pin.frame] = draft.targets.root_scale * np.array(pin.position)
        quats, turns = se3.matrix_to_quat(kinematics.site_rotation(site)), self._turns.value
        self._editor.player.do(lambda: self._show_handle(path, quats, turns=turns))

    # The handle, between two frames in the thread that draws them.

    def _show_handle(self, path: Float[np.ndarray, "T 3"], quats: Float[np.ndarray, "T 4"], *, turns: bool) -> None:
        """Show the handle on a path, by which the part can be turned, too."""
        self._positions, self._quats = path, quats
        if self._handle is None:
            self._handle = self._add_handle()
        self._handle.disable_rotations = not turns
        self._show_frame(self._frame)

    def _hide_handle(self) -> None:
        if self._handle is not None:
            self._handle.remove()
            self._handle = None

    def _show_frame(self, frame: int) -> None:
        """Move the handle with its part, unless it is held."""
        self._frame = frame
        if self._handle is not None and self._held is None:
            at = min(frame, len(self._positions) - 1)
            self._handle.position, self._handle.wxyz = self._positions[at], self._quats[at]

    def _add_handle(self) -> viser.TransformControlsHandle:
        handle = self._api.add_transform_controls(f"{WORLD}/pin", _SIZE, disable_rotations=True, depth_test=False)

        # Asynchronous, so that Viser calls it in the order of what happened.
        @handle.on_update
        async def _(event: viser.TransformControlsEvent) -> None:
            if self._held is None:
                self._held = self._frame
            frame, released = self._held, event.phase == "end"
            if released:
                self._held = None
            if event.phase != "start":
                place, turn = np.array(event.target.position), np.array(event.target.wxyz)
                self._editor.worker.do_drag(lambda: self._pin(frame, place, turn, released), released=released)

        return handle

    def _pin(self, frame: int, position: Float[np.ndarray, "3"], quat: Float[np.ndarray, "4"], released: bool) -> None:
        """Pin the part to a place of the robot's world [m] and a rotation wxyz; until released, preview it."""
        if self._part is None:
            return
        pin = self._pin_at(*self._part, frame, position, quat)
        if released:
            self._editor.commit(pin)
        else:
            self._editor.panel.say(pin_text(self._editor.preview(pin), pin))

    def _choose(self) -> None:
        self._part = self._parts[self._chosen.value]
        self._editor.show()

    def _go_to(self, text: str) -> None:
        """Show the pin of a line of the list, and give its part the handle."""
        number = self._pins.options.index(text) - 1

        def go() -> None:
            if 0 <= number < len(self._session.now.clip.pins):
                pin = self._session.now.clip.pins[number]
                self._part = (pin.person, pin.part)
                self._chosen.value = next(name for name, each in self._parts.items() if each == self._part)
                self._editor.player.seek(pin.frame)
                self._editor.show()

        self._editor.worker.do(go)

    def _unpin(self) -> None:
        if self._part is None:
            self._editor.panel.say("No part is chosen. Choose one beside Pin first.", wrong=True)
        else:
            person, part = self._part
            self._editor.commit(Unpin(part, self._editor.frame, person=person))

    def _pin_at(self, person: int, part: str, frame: int, position: np.ndarray, quat: np.ndarray) -> Pin:
        """Return the pin at a place of the robot's world; without a turn of its own it keeps an earlier one's."""
        draft, now = self._session.now.drafts[person], self._session.now.clip
        place = np.round(position / draft.targets.root_scale, _DIGITS) + 0.0  # No minus before a zero.
        own = [pin for pin in now.pins if (pin.person, pin.part, pin.frame) == (person, part, frame)]
        turn = own[0].turn if own else None
        if self._turns.value:
            recorded = recorded_rotation(draft.targets, self._model.forward(draft.motion.stages[0].qpos), part)[frame]
            vector = np.degrees(se3.log(se3.quat_multiply(quat, se3.quat_conjugate(recorded))))
            x, y, z = (np.round(vector, _TURN_DIGITS) + 0.0).tolist()
            turn = (x, y, z)
        return Pin(part, frame, tuple(place.tolist()), turn, person=person)


def pin_text(edited: EditState, pin: Pin) -> str:
    """Return the distance of a part from its pin in words."""
    parts = edited.motions[pin.person].report.pins
    own = next(item for item in parts if (item.part, item.frame) == (pin.part, pin.frame))
    return f"The {own}{': out of reach, or in the way of something' if own.missed else ''}."


def _pins_of(edited: EditState) -> tuple[str, ...]:
    """Return all pins in words, after a line with their number."""
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


_RADIUS, _HANDLE_SIZE = 0.03, 0.22  # [m]
_IDLE, _TOUCHED, _CHOSEN = (140, 150, 160), (40, 120, 220), (255, 140, 0)
_IN_AIR = (255, 225, 0)


class EditorPoints:
    """A ball for each contact, at the mean of its points; a click chooses it."""

    def __init__(self, api: viser.SceneApi, editor: "Editor") -> None:
        self._api, self._editor, self._motion = api, editor, editor.edited.motions[0]
        objects = range(len(self._motion.object_names))
        self._holders = [api.add_frame(f"{WORLD}/held/{index}", show_axes=False) for index in objects]
        self._segments: Sequence[Segment] = ()
        self._chosen: Segment | None = None
        self._gaps: Sequence[SurfaceGap] = ()
        self._balls: list[viser.IcosphereHandle] = []
        self._handle: viser.TransformControlsHandle | None = None
        self._frame = 0
        self.show_frame(0)

    def show(self, segments: Sequence[Segment], chosen: Segment | None, gaps: Sequence[SurfaceGap]) -> None:
        """Show these contacts; the chosen one has the handle, and points in thin air are yellow."""
        if [segment.object for segment in segments] != [segment.object for segment in self._segments]:
            for ball in self._balls:
                ball.remove()
            self._balls = [self._add_ball(index, segment) for index, segment in enumerate(segments)]
        for ball, segment in zip(self._balls, segments, strict=True):
            ball.position = self._place(segment)
        self._show_handle(chosen)
        self._segments, self._chosen, self._gaps = segments, chosen, gaps
        self.show_frame(self._frame)

    def warn(self, gaps: Sequence[SurfaceGap]) -> None:
        """Show the contacts in thin air during a drag."""
        self._gaps = gaps
        self.show_frame(self._frame)

    def show_frame(self, frame: int) -> None:
        """Move the points with their objects, and colour the touched ones."""
        self._frame = min(frame, self._motion.frames - 1)
        for index, holder in enumerate(self._holders):
            holder.position = self._motion.object_pos[self._frame, index]
            holder.wxyz = self._motion.object_quat[self._frame, index]
        for ball, segment, gap in zip(self._balls, self._segments, self._gaps, strict=False):
            held = _TOUCHED if segment.holds(self._frame) else _IDLE
            colour = _IN_AIR if gap.in_thin_air else _CHOSEN if segment is self._chosen else held
            if tuple(ball.color) != colour:
                ball.color = colour

    def _place(self, segment: Segment) -> np.ndarray:
        return self._motion.object_scale[segment.object] * segment.points.mean(axis=0)

    def _add_ball(self, index: int, segment: Segment) -> viser.IcosphereHandle:
        ball = self._api.add_icosphere(f"{WORLD}/held/{segment.object}/point{index}", _RADIUS, _IDLE, opacity=0.9)
        ball.on_click(lambda _: self._editor.worker.do(lambda: self._editor.choose(index)))
        return ball

    def _show_handle(self, chosen: Segment | None) -> None:
        if self._handle is not None and (
            chosen is None or self._chosen is None or chosen.object != self._chosen.object
        ):
            self._handle.remove()
            self._handle = None
        if chosen is None:
            return
        if self._handle is None:
            self._handle = self._add_handle(chosen)
        self._handle.position = self._place(chosen)
        self._handle.disable_rotations = chosen.part not in HANDS
        self._handle.wxyz = se3.exp(np.radians(chosen.turn))

    def _add_handle(self, chosen: Segment) -> viser.TransformControlsHandle:
        handle = self._api.add_transform_controls(
            f"{WORLD}/held/{chosen.object}/handle", _HANDLE_SIZE, disable_rotations=True, depth_test=False
        )
        scale = self._motion.object_scale[chosen.object]

        # Asynchronous, so that Viser calls it in the order of what happened.
        @handle.on_update
        async def _(event: viser.TransformControlsEvent) -> None:
            if event.phase != "start":
                point, released = np.array(event.target.position) / scale, event.phase == "end"
                turn = np.degrees(se3.log(np.array(event.target.wxyz)))
                self._editor.worker.do_drag(
                    lambda: self._editor.drag(point, turn, released=released), released=released
                )

        return handle
