"""One browser's player: its own scene, controls, clock and camera, so that two browsers do not disturb each other.

Callbacks set the clock and the contents alone; one thread per browser does all drawing, and ends when the browser goes.
The camera stays the user's: to follow something, the world is moved under it.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from threading import Condition, Thread
from typing import Any, Literal

import numpy as np
import viser
from jaxtyping import Float

from hoi_retarget.studio.browser.browser_server import PageContent
from hoi_retarget.studio.browser.viser_scene import ViserScene
from hoi_retarget.studio.html import render
from hoi_retarget.studio.scene.camera import CLOSE_REACH, camera_axes, distance_to_see, extents, fit_window
from hoi_retarget.studio.scene.curves import LEFT_INSET_PX, RIGHT_INSET_PX
from hoi_retarget.studio.scene.drawing import DrawnScene, Subject
from hoi_retarget.studio.scene.scene import BASELINE, OBJECT_LAYERS, SEE_THROUGH


@dataclass(frozen=True)
class Clock:
    """A player's state; times are those of any clock that runs evenly [s]."""

    frames: int
    fps: float
    speed: float = 1.0
    playing: bool = False
    place: float = 0.0
    """Frame at time `since`, with its fraction."""
    since: float = 0.0

    def frame(self, now: float) -> int:
        """Return the frame to show."""
        return int(self._place(now))

    def play(self, now: float) -> "Clock":
        """Return the clock going on from its frame."""
        return replace(self, place=self._place(now), since=now, playing=True)

    def pause(self, now: float) -> "Clock":
        """Return the clock standing still at its frame."""
        return replace(self, place=float(self.frame(now)), since=now, playing=False)

    def seek(self, frame: int, now: float) -> "Clock":
        """Return the clock at another frame, limited to the existing ones."""
        return replace(self, place=float(min(max(frame, 0), self.frames - 1)), since=now)

    def at_speed(self, speed: float, now: float) -> "Clock":
        """Return the clock at another speed from now on."""
        return replace(self, place=self._place(now), since=now, speed=speed)

    def seconds_to_next(self, now: float) -> float:
        """Return the time until the next frame [s]; an hour where there is none."""
        if not self.playing:
            return 3600.0
        return (1.0 - self._place(now) % 1.0) / (self.fps * self.speed)

    def _place(self, now: float) -> float:
        if not self.playing:
            return self.place
        return (self.place + (now - self.since) * self.fps * self.speed) % self.frames


BODY = "body"
"""Name of the view of the whole scene."""
_AZIMUTH, _ELEVATION = np.radians(-55.5), np.radians(13.9)
_MARGIN = 1.08  # Around the scene.
_SAMPLES = 12  # Frames that the camera is placed by.


class PlayerCamera:
    """A browser's camera, aimed in the part of its window that panels leave free."""

    def __init__(self, camera: viser.CameraHandle, beside_px: int, below_px: int) -> None:
        """Begin; panels cover so much of the window at its sides and at the bottom."""
        self._camera, self._beside_px, self._below_px = camera, beside_px, below_px
        self._name = BODY
        self._anchor = np.zeros(3)

    def see_all(self, scene: DrawnScene) -> None:
        """Look at the whole motion, so that it fills the free part of the window."""
        frames = np.linspace(0, scene.frames - 1, _SAMPLES).astype(int).tolist()
        start = scene.centre(0)
        axes = camera_axes(_AZIMUTH, _ELEVATION)
        shift, reaches = fit_window(
            extents(scene, frames, np.stack([start + _way(scene, frame) for frame in frames])), axes
        )
        distance = self._distance(_MARGIN * reaches)
        look_at = start + shift - self._lift(distance) * axes[1]
        self._camera.position = look_at + distance * axes[2]
        self._camera.look_at = look_at

    def look_at(self, scene: DrawnScene, name: str) -> None:
        """Go near to one of `look_at_targets_of` a scene from where the camera is, or see all of it again."""
        self._name = name
        if name == BODY:
            self.see_all(scene)
            return
        window = self._camera
        back = window.position - window.look_at
        axes = camera_axes(np.arctan2(back[1], back[0]), np.arctan2(back[2], np.hypot(back[0], back[1])))
        place, distance = np.array(window.look_at), self._distance(np.array([[CLOSE_REACH, CLOSE_REACH, 0.0]]))
        window.position = place + distance * axes[2]
        window.look_at = place  # Which moved along with the position.
        self._anchor = place + self._lift(distance) * axes[1]

    def world_position(self, scene: DrawnScene, frame: int, *, follow: bool) -> Float[np.ndarray, "3"]:
        """Return the world's position while this frame is shown [m]."""
        if self._name != BODY:
            subject, path = look_at_targets_of(scene)[self._name]
            return self._anchor - path[scene.frame_of(subject, frame)]
        return -_way(scene, frame) if follow else np.zeros(3)

    def _distance(self, reaches: Float[np.ndarray, "K 3"]) -> float:
        """Return the distance from which the free part of the window shows everything [m]."""
        window = self._camera
        width, height = max(100, window.image_width - self._beside_px), max(100, window.image_height - self._below_px)
        # The free part has its share of the whole window's field of view.
        return distance_to_see(reaches, width / height, np.tan(0.5 * window.fov) * height / window.image_height)

    def _lift(self, distance: float) -> float:
        """Return the height of the free part's middle over the window's middle, at a distance [m]."""
        return self._below_px / self._camera.image_height * np.tan(0.5 * self._camera.fov) * distance


def look_at_targets_of(scene: DrawnScene) -> dict[str, tuple[Subject, Float[np.ndarray, "T 3"]]]:
    """Return the targets of close views by name: a subject, and a path [m] in its frames."""
    several = sum(bool(subject.look_at_targets) for subject in scene.subjects) > 1
    return {
        f"{name}, {subject.title}" if several else name: (subject, path)
        for subject in scene.subjects
        for name, path in subject.look_at_targets.items()
    }


def _way(scene: DrawnScene, frame: int) -> Float[np.ndarray, "3"]:
    """Return the mean way of the subjects over the floor since the first frame [m]."""
    return (scene.centre(frame) - scene.centre(0)) * [1.0, 1.0, 0.0]


WORLD = "/world"
MESSAGE = "studio/browser/page/message.html.j2"
SPEEDS = {"0.1x": 0.1, "0.25x": 0.25, "0.5x": 0.5, "1x": 1.0, "2x": 2.0, "4x": 4.0}
CURVES_HEIGHT_PX = 161
_CONTROLS_WIDTH_PX, _PANEL_MARGIN_PX = 320, 15
_PANEL_HEAD_PX = 60  # Of the curves' panel, with its margin.
_SHEET_BELOW_PX, _SHEET_SHARE = 576, 0.5  # Viser lays all panels into a sheet at the bottom of so narrow a window.
_LookKey = Literal["1", "2", "3", "4", "5", "6", "7", "8", "9"]
_GREY = (205, 210, 216)
_LOOK_KEYS: tuple[_LookKey, ...] = ("1", "2", "3", "4", "5", "6", "7", "8", "9")
_Key = Literal["arrowright", "arrowleft", "home", "end"]


class Player:
    """Draws a scene for one browser and follows its controls until `stop`."""

    def __init__(self, client: viser.ClientHandle, content: PageContent, *, left_px: int = 0) -> None:
        """Draw content; `left_px` is the width of a panel at the left of the window [px]."""
        scene = content.scene
        self._client, self._scene = client, scene
        height_px = CURVES_HEIGHT_PX + content.extra_height_px + content.strip_height_px
        covered_px = height_px + _PANEL_HEAD_PX if content.chart else 0
        self._narrow = client.camera.image_width < _SHEET_BELOW_PX
        beside_px = left_px + _CONTROLS_WIDTH_PX
        if self._narrow:
            beside_px, covered_px = 0, int(_SHEET_SHARE * client.camera.image_height)
        self._camera = PlayerCamera(client.camera, beside_px, covered_px)
        self._changed = Condition()
        self._clock = Clock(scene.frames, scene.fps)
        self._stopped = False
        self._tasks: list[Callable[[], None]] = []
        self._attached: list[Callable[[int], None]] = []
        self._world = client.scene.add_frame(WORLD, show_axes=False)
        _add_floor(client.scene)
        self._drawn = ViserScene(client.scene, scene, root=WORLD)
        self._add_titles()
        self._add_controls(content)
        if content.chart:
            self._chart, self._cursor = self._add_curves(content, left_px)
        self._camera.see_all(scene)
        self._thread = Thread(target=self._run, name="player", daemon=True)
        self._thread.start()

    @property
    def frame(self) -> int:
        """The current frame."""
        return self._clock.frame(time.monotonic())

    def stop(self) -> None:
        """End the player's work; nothing is drawn any more."""
        with self._changed:
            self._stopped = True
            self._changed.notify()
        self._thread.join()

    def seek(self, frame: int) -> None:
        """Show another frame."""
        self._set(lambda clock, now: clock.seek(frame, now))

    def redraw(self, content: PageContent) -> None:
        """Draw another scene of the same subjects and layers, and its curves, at the same frame."""
        scene = content.scene

        def draw() -> None:
            self._scene = scene
            self._drawn.redraw(scene)
            if self._chart is not None:
                self._chart.content = _chart_html(content)

        self.do(draw)

    def show_strip(self, strip: str) -> None:
        """Show HTML above the curves, on their time axis."""
        self.do(lambda: setattr(self._strip, "content", strip))

    def show_baseline(self, visible: bool) -> None:
        """Show or hide the ghosts of earlier motions."""
        self.do(lambda: self._drawn.show_layer(BASELINE, visible))

    def attach(self, show: Callable[[int], None]) -> None:
        """Call this too with every frame that is shown."""
        self.do(lambda: self._attached.append(show))

    def do(self, task: Callable[[], None]) -> None:
        """Do something between two frames, in the thread that draws them."""
        with self._changed:
            self._tasks.append(task)
            self._changed.notify()

    def _run(self) -> None:
        shown = -1
        while True:
            with self._changed:
                now = time.monotonic()
                if not self._tasks and not self._stopped and self._clock.frame(now) == shown:
                    self._changed.wait(self._clock.seconds_to_next(now))
                if self._stopped:
                    return
                tasks, self._tasks = self._tasks, []
                frame = self._clock.frame(time.monotonic())
            with self._client.atomic():
                for task in tasks:
                    task()
                if frame != shown:
                    self._show(frame)
            shown = frame

    def _show(self, frame: int) -> None:
        self._drawn.show(frame)
        self._slider.value = frame
        if self._chart is not None:
            self._cursor.value = frame
        self._follow_centre(frame)
        for show in self._attached:
            show(frame)

    def _follow_centre(self, frame: int) -> None:
        """Move the world under the camera, which stays the user's."""
        self._world.position = self._camera.world_position(self._scene, frame, follow=self._follow.value)

    def _look_at(self) -> None:
        """Stay near a hand, or see everything again."""
        self._camera.look_at(self._scene, self._look.value)
        self._follow_centre(self.frame)

    def _set(self, change: Callable[[Clock, float], Clock]) -> None:
        with self._changed:
            self._clock = change(self._clock, time.monotonic())
            self._changed.notify()

    def _add_titles(self) -> None:
        if len(self._scene.subjects) > 1:
            for index, subject in enumerate(self._scene.subjects):
                place = (*subject.centre[0, :2], 0.02)
                self._client.scene.add_label(f"{WORLD}/{index}/title", subject.title, position=place)

    def _add_controls(self, content: PageContent) -> None:
        gui = self._client.gui
        if self._narrow:
            gui.add_html(render("studio/browser/page/sheet.html.j2", share=_SHEET_SHARE))
        gui.main_panel.dock_right()
        gui.main_panel.set_width(_CONTROLS_WIDTH_PX)
        with gui.add_folder("Playback"):
            self._button = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY, hint="Space")
            self._slider = gui.add_slider("Frame", 0, max(1, self._scene.frames - 1), 1, 0, hint="Arrows, Home, End")
            speed = gui.add_dropdown("Speed", tuple(SPEEDS), initial_value="1x")
            self._follow = gui.add_checkbox("Follow", True, hint="F: the camera stays with the robot")
            looks = (BODY, *look_at_targets_of(self._scene))
            self._look = gui.add_dropdown("Look at", looks, initial_value=BODY, hint="1, 2, ...: from near")
        with gui.add_folder("Show", expand_by_default=not self._narrow):
            self._add_layer_boxes()
            self._see_through = gui.add_checkbox("see-through objects", False, hint="X")
        self._chart: viser.GuiHtmlHandle | None = None
        self._button.on_click(lambda _: self._toggle())
        speed.on_update(lambda event: self._set(lambda clock, now: clock.at_speed(SPEEDS[event.target.value], now)))
        on_change_by_user(self._slider, self.seek)
        self._follow.on_update(lambda _: self.do(lambda: self._follow_centre(self.frame)))
        self._look.on_update(lambda _: self.do(self._look_at))
        self._see_through.on_update(lambda _: self.do(self._show_through))
        self._add_keys()

    def _add_layer_boxes(self) -> None:
        gui, subjects = self._client.gui, self._scene.subjects
        layers = {layer.name: layer.shown for subject in subjects for layer in subject.layers if layer.name != BASELINE}
        for name, shown in layers.items():
            box = gui.add_checkbox(name, shown)
            box.on_update(lambda event, name=name: self.do(lambda: self._drawn.show_layer(name, event.target.value)))
        for index, subject in enumerate(subjects) if len(subjects) > 1 else ():
            box = gui.add_checkbox(subject.title, True)
            box.on_update(lambda event, index=index: self._drawn.show_subject(index, event.target.value))

    def _add_keys(self) -> None:
        gui, last = self._client.gui, self._scene.frames - 1
        steps: dict[str, tuple[_Key, Callable[[int], int]]] = {
            "Next frame": ("arrowright", lambda frame: frame + 1),
            "Previous frame": ("arrowleft", lambda frame: frame - 1),
            "First frame": ("home", lambda _: 0),
            "Last frame": ("end", lambda _: last),
        }
        for label, (key, step) in steps.items():
            command = gui.add_command(label, hotkey=key)
            command.on_trigger(
                lambda _, step=step: self._set(lambda clock, now: clock.seek(step(clock.frame(now)), now))
            )
        gui.add_command("Play or pause", hotkey="space").on_trigger(lambda _: self._toggle())
        gui.add_command("Follow", hotkey="F").on_trigger(lambda _: _toggle(self._follow))
        gui.add_command("See through objects", hotkey="X").on_trigger(lambda _: _toggle(self._see_through))
        for name, look_key in zip(self._look.options, _LOOK_KEYS, strict=False):
            command = gui.add_command(f"Look at {name}", hotkey=look_key)
            command.on_trigger(lambda _, name=name: setattr(self._look, "value", name))

    def _toggle(self) -> None:
        self._set(lambda clock, now: clock.pause(now) if clock.playing else clock.play(now))
        playing = self._clock.playing
        self._button.label = "Pause" if playing else "Play"
        self._button.icon = viser.Icon.PLAYER_PAUSE if playing else viser.Icon.PLAYER_PLAY

    def _show_through(self) -> None:
        self._drawn.see_through(OBJECT_LAYERS, SEE_THROUGH if self._see_through.value else None)

    def _add_curves(self, content: PageContent, left_px: int) -> tuple[viser.GuiHtmlHandle, viser.GuiSliderHandle[int]]:
        """Add the curves below the scene, and over them a slider that looks like a cursor."""
        gui = self._client.gui
        panel = gui.add_panel()
        self.timeline = panel.add_tab("Curves", viser.Icon.CHART_LINE)
        """What lies above the curves goes here, with an order from 1 to 9."""
        with self.timeline:
            self._strip = gui.add_html("", order=0)
            html = gui.add_html(_chart_html(content))
            cursor = gui.add_slider("Cursor", 0, max(1, self._scene.frames - 1), 1, 0)
        on_change_by_user(cursor, self.seek)
        width = max(300, self._client.camera.image_width - left_px - _CONTROLS_WIDTH_PX - 2 * _PANEL_MARGIN_PX)
        panel.float(x=_PANEL_MARGIN_PX, y=-_PANEL_MARGIN_PX, width=width)
        return html, cursor


def on_change_by_user(widget: Any, act: Callable[[Any], None]) -> None:
    """Call `act` with a widget's value whenever the user changes it, but not when the program itself does."""
    widget.on_update(lambda event: None if event.client is None else act(event.target.value))


def _toggle(box: viser.GuiCheckboxHandle) -> None:
    box.value = not box.value


def _chart_html(content: PageContent) -> str:
    """Return the curves, over which the slider that comes next lies as their cursor."""
    return render(
        "studio/browser/page/curves.html.j2",
        **{"left_px": LEFT_INSET_PX, "right_px": RIGHT_INSET_PX},
        height_px=CURVES_HEIGHT_PX + content.extra_height_px,
        strip_height_px=content.strip_height_px,
        chart=content.chart,
    )


def _add_floor(api: viser.SceneApi) -> None:
    api.add_grid(
        f"{WORLD}/floor",
        width=60.0,
        height=60.0,
        cell_color=_GREY,
        section_color=_GREY,
        cell_size=0.5,
        section_size=2.5,
        fade_distance=30.0,
        plane_color=(246, 247, 249),
        plane_opacity=1.0,
        shadow_opacity=0.25,
    )
