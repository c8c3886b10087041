"""Arrows of the contact forces of a motion that was simulated."""

import numpy as np

from hoi_retarget.motion.contact_forces import ContactForces
from hoi_retarget.viewers.scene.drawing import Colour, Lines

LENGTH = 0.002
"""Of an arrow [m/N]: the weight of a robot of 33 kg is 65 cm long."""
_LEAST = 2.0  # [N]; less is not drawn.
_COLOUR: Colour = (196, 40, 170)
_HEAD, _LONGEST_HEAD = 0.25, 0.05  # Of an arrow, and [m].
_TINY = 1e-9


def force_arrows(forces: ContactForces) -> tuple[Lines, ...]:
    """Return an arrow for each body, from where its force acts; none where nothing is touched.

    An arrow is a shaft and two strokes of a head.
    """
    sizes = np.linalg.norm(forces.forces, axis=2)
    there = sizes >= _LEAST
    if not there.any():
        return ()
    ends = forces.points + LENGTH * forces.forces
    along = forces.forces / np.maximum(sizes, _TINY)[..., None]
    # Across the arrow and level, or along y where the arrow is upright.
    across = np.stack([-along[..., 1], along[..., 0], np.zeros_like(sizes)], axis=2)
    level = np.linalg.norm(across, axis=2, keepdims=True)
    across = np.where(level > 0.1, across / np.maximum(level, _TINY), [0.0, 1.0, 0.0])
    head = np.minimum(_HEAD * LENGTH * sizes, _LONGEST_HEAD)[..., None]
    strokes = [ends - head * (along + side * 0.5 * across) for side in (1.0, -1.0)]
    starts = np.concatenate([forces.points, ends, ends], axis=1)
    stops = np.concatenate([ends, *strokes], axis=1)
    colours = np.broadcast_to(np.array(_COLOUR, dtype=np.uint8), starts.shape)
    return (Lines(starts.astype(np.float32), stops.astype(np.float32), colours, np.tile(there, (1, 3))),)
