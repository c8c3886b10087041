"""The points of the contacts in the scene, on the robots' objects, and the handle that moves the chosen one."""

from collections.abc import Callable, Sequence

import numpy as np
import viser

from hoi_retarget.clip.edits import Segment
from hoi_retarget.motion.motion import Motion
from hoi_retarget.viewers.browser.player import WORLD
from hoi_retarget.viewers.browser.surface_gaps import SurfaceGap

_RADIUS, _HANDLE_SIZE = 0.03, 0.22  # [m]
_IDLE, _TOUCHED, _CHOSEN = (140, 150, 160), (40, 120, 220), (255, 140, 0)
_IN_AIR = (255, 225, 0)


class EditorPoints:
    """A ball for each contact, at the mean of its points; a click chooses it."""

    def __init__(
        self, api: viser.SceneApi, motion: Motion, *, choose: Callable[[int], None], drag: Callable[..., None]
    ) -> None:
        self._api, self._motion, self._choose, self._drag = api, motion, choose, drag
        self._holders = [
            api.add_frame(f"{WORLD}/held/{index}", show_axes=False) for index in range(len(motion.object_names))
        ]
        self._segments: Sequence[Segment] = ()
        self._chosen: Segment | None = None
        self._gaps: Sequence[SurfaceGap] = ()
        self._balls: list[viser.IcosphereHandle] = []
        self._handle: viser.TransformControlsHandle | None = None
        self._frame = 0
        self.show_frame(0)

    def show(self, segments: Sequence[Segment], chosen: Segment | None, gaps: Sequence[SurfaceGap]) -> None:
        """Show these contacts; the chosen one has the handle, and those in thin air are yellow."""
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
        """Show which contacts are in thin air while one is dragged."""
        self._gaps = gaps
        self.show_frame(self._frame)

    def show_frame(self, frame: int) -> None:
        """Move the points with their objects, and colour those that are touched now."""
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
        ball.on_click(lambda _: self._choose(index))
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

    def _add_handle(self, chosen: Segment) -> viser.TransformControlsHandle:
        handle = self._api.add_transform_controls(
            f"{WORLD}/held/{chosen.object}/handle", _HANDLE_SIZE, disable_rotations=True, depth_test=False
        )
        scale = self._motion.object_scale[chosen.object]

        # Asynchronous, so that Viser calls it in the order of what happened.
        @handle.on_update
        async def _(event: viser.TransformControlsEvent) -> None:
            if event.phase != "start":
                self._drag(np.array(event.target.position) / scale, released=event.phase == "end")

        return handle
