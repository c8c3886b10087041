"""The handle in the scene that pins a part of the robot in the current frame."""

from collections.abc import Callable

import numpy as np
import viser
from jaxtyping import Float

from hoi_retarget.viewers.browser.player import WORLD

_SIZE = 0.25  # [m]

Dragged = Callable[[int, Float[np.ndarray, "3"], Float[np.ndarray, "4"], bool], None]
"""Is told the frame, the place [m], the rotation, and whether the handle was let go."""


class PinHandle:
    """Follows a part of the robot from frame to frame; where the part is pinned, it is at the pin."""

    def __init__(self, api: viser.SceneApi, drag: Dragged) -> None:
        self._api, self._drag = api, drag
        self._handle: viser.TransformControlsHandle | None = None
        self._positions, self._quats = np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]])
        self._frame = 0
        self._held: int | None = None

    def show(self, positions: Float[np.ndarray, "T 3"], quats: Float[np.ndarray, "T 4"], *, turns: bool) -> None:
        """Show the handle on a path, by which it can be turned, too."""
        self._positions, self._quats = positions, quats
        if self._handle is None:
            self._handle = self._add()
        self._handle.disable_rotations = not turns
        self.show_frame(self._frame)

    def hide(self) -> None:
        """Show no handle."""
        if self._handle is not None:
            self._handle.remove()
            self._handle = None

    def show_frame(self, frame: int) -> None:
        """Move the handle with its part, unless it is held."""
        self._frame = frame
        if self._handle is not None and self._held is None:
            at = min(frame, len(self._positions) - 1)
            self._handle.position, self._handle.wxyz = self._positions[at], self._quats[at]

    def _add(self) -> viser.TransformControlsHandle:
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
                self._drag(frame, np.array(event.target.position), np.array(event.target.wxyz), released)

        return handle
