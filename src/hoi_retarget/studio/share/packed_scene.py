"""A `Scene` as text that a web page carries and `page/player` plays, small enough to be sent by mail.

Numbers over time become steps of 0.2 mm or so, and these their second differences, which are small
where something moves smoothly. Low and high bytes apart and compressed, 200 frames take some 200 kB.
"""

import base64
import gzip
import json
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.numerics import se3
from hoi_retarget.studio.scene.camera import CLOSE_REACH, FittedCamera
from hoi_retarget.studio.scene.drawing import DrawnScene, Kind, Layer, Lines, Part, Shapes, Solid, Subject
from hoi_retarget.studio.scene.legend_texts import LAYERS
from hoi_retarget.studio.scene.scene import OBJECT_LAYERS, SEE_THROUGH

MAX_FRAMES = 2000  # Frames of one subject that a page holds; of a longer one every second, third, ... frame is kept.
POSITION_STEP = 2e-4  # [m]
_TURN_STEP = 2.5e-4  # Of a quaternion's numbers: 0.03 degrees.
_VERTEX_STEP = 1e-4  # Of a mesh's size.
_MAX_LEVEL = 65535


def pack(subplots: DrawnScene, floor: FittedCamera, each: FittedCamera, *, max_frames: int = MAX_FRAMES) -> str:
    """Return a scene as JSON text: its description, and all its numbers in base64 of gzip.

    `subplots`: of `make_subplots`; `floor`: sees all subjects beside each other; `each`: sees each subject alone, from
    the same direction; `max_frames`: frames of one subject that are kept at most.
    """
    numbers = _Numbers()
    subjects = [_subject(numbers, subject, -(-subject.frames // max_frames)) for subject in subplots.subjects]
    content = base64.b64encode(gzip.compress(bytes(numbers.content), compresslevel=6, mtime=0)).decode("ascii")
    description = {
        "fps": subplots.fps,
        "close": CLOSE_REACH,
        "seconds": max(subplots.frames - 1, 1) / subplots.fps,
        "camera": {
            **{"azimuth": floor.azimuth, "elevation": floor.elevation, "front": floor.front},
            **{
                name: {"shift": place.shift.tolist(), "reaches": place.reaches.tolist()}
                for name, place in {"floor": floor, "each": each}.items()
            },
        },
        "subjects": subjects,
        "numbers": content,
    }
    # Inside a <script>, only this character could end it.
    return json.dumps(description, allow_nan=False).replace("<", "\\u003c")


class _Numbers:
    """All arrays one after the other, each once; a page finds it by where it begins."""

    def __init__(self) -> None:
        self.content = bytearray()
        self._begins: dict[bytes, int] = {}

    def add(self, values: np.ndarray, step: float) -> dict[str, Any]:
        """Add numbers over time, frames first, in steps as small as `step` if their range allows it."""
        frames = values.reshape(len(values), -1).astype(float)
        if (frames == frames[:1]).all():
            frames = frames[:1]
        low = float(frames.min())
        step = max(step, (float(frames.max()) - low) / _MAX_LEVEL)
        levels = np.round((frames - low) / step).astype(np.uint16)
        # Unsigned differences wrap around, and back when they are added up.
        changes = np.diff(levels, n=2, axis=0, prepend=np.zeros((2, frames.shape[1]), dtype=np.uint16))
        pairs = changes.T.ravel().astype("<u2").view(np.uint8)
        content = pairs[::2].tobytes() + pairs[1::2].tobytes()
        at = self._begins.setdefault(content, len(self.content))
        if at == len(self.content):
            self.content += content
        return {"at": at, "frames": len(frames), "width": frames.shape[1], "low": low, "step": step}

    def add_turns(self, quats: Float[np.ndarray, "T N 4"]) -> dict[str, Any]:
        """Add rotations, without the jumps of sign that mean nothing."""
        return self.add(se3.quat_continuous(quats), _TURN_STEP)


def _subject(numbers: _Numbers, subject: Subject, stride: int) -> dict[str, Any]:
    return {
        "title": subject.title,
        "shift": subject.shift.tolist(),
        "scale": subject.scale,
        "fps": subject.fps / stride,
        "centre": numbers.add(subject.centre[::stride], POSITION_STEP),
        "looks": {name: numbers.add(path[::stride], POSITION_STEP) for name, path in subject.look_at_targets.items()},
        "layers": [_layer(numbers, layer, stride) for layer in subject.layers],
    }


def _layer(numbers: _Numbers, layer: Layer, stride: int) -> dict[str, Any]:
    parts = [_part(numbers, part, stride) for part in layer.parts if part.count]
    through = {"through": SEE_THROUGH} if layer.name in OBJECT_LAYERS else {}
    meaning = LAYERS.get(layer.name, "")
    return {
        "name": layer.name,
        "meaning": meaning,
        "opacity": layer.opacity,
        **through,
        "shown": layer.shown,
        "parts": parts,
    }


def _part(numbers: _Numbers, part: Part, stride: int) -> dict[str, Any]:
    match part:
        case Shapes():
            visible = part.visible
            kind: dict[str, Any] = {
                "kind": part.kind.value,
                "sizes": numbers.add(part.sizes[None], 1e-5),
                "colours": numbers.add(part.colours[None], 1.0),
                "positions": numbers.add(part.positions[::stride], POSITION_STEP),
                "quats": numbers.add_turns(_seen_turns(part)[::stride]),
            }
        case Solid():
            visible = None
            # Robot and human move one object in two sizes: as unit meshes they are the same.
            size = float(np.abs(part.vertices).max())
            kind = {
                "kind": "solid",
                "vertices": numbers.add(part.vertices[None] / size, _VERTEX_STEP),
                "faces": numbers.add(_ordered(part.faces), 1.0),
                "sizes": numbers.add(np.full((1, 3), size), 1e-5),
                "colours": numbers.add(np.array([part.colour]), 1.0),
                "positions": numbers.add(part.positions[::stride], POSITION_STEP),
                "quats": numbers.add_turns(part.quats[::stride, None]),
            }
        case Lines():
            visible = part.visible
            kind = {
                "kind": "lines",
                "starts": numbers.add(part.starts[::stride], POSITION_STEP),
                "ends": numbers.add(part.ends[::stride], POSITION_STEP),
                "colours": numbers.add(part.colours[::stride], 1.0),
            }
    if visible is not None and not visible.all():
        kind["visible"] = numbers.add(visible[::stride], 1.0)
    return {"count": part.count, **kind}


def _ordered(faces: Int[np.ndarray, "F 3"]) -> Int[np.ndarray, "F 3"]:
    """Return the triangles in order of their first corner, each beginning with its lowest: neighbours are alike."""
    lowest = faces.argmin(axis=1)[:, None]
    turned = np.take_along_axis(faces, (lowest + np.arange(3)) % 3, axis=1)
    return turned[np.lexsort(turned.T[::-1])]


def _seen_turns(shapes: Shapes) -> Float[np.ndarray, "T N 4"]:
    """Return the rotations, those of balls left out: nobody sees them turn."""
    balls = (shapes.kind is Kind.SPHERE) & (np.ptp(shapes.sizes, axis=1) == 0)
    return np.where(balls[:, None], np.array([1.0, 0.0, 0.0, 0.0]), shapes.quats)
