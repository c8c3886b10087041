"""Points spread over an object's surface, the same ones every time."""

import numpy as np
from jaxtyping import Float

from hoi_retarget.objects.mesh import Surface

# Multiples of these two numbers, without their whole parts, fill a square evenly (Roberts, 2018).
_EVEN = np.array([0.7548776662466927, 0.5698402909980532])


def surface_samples(surface: Surface, spacing: float) -> Float[np.ndarray, "K 3"]:
    """Return points of the surface [m], one for each square of that side [m], as dense on every triangle."""
    corners = surface.triangles
    along = corners[:, 1:] - corners[:, :1]
    areas = np.cumsum(0.5 * np.linalg.norm(np.cross(along[:, 0], along[:, 1]), axis=1))
    count = max(1, round(float(areas[-1]) / spacing**2))
    steps = np.arange(count)
    triangles = np.searchsorted(areas, (steps + 0.5) / count * areas[-1])
    square = (0.5 + steps[:, None] * _EVEN) % 1.0
    # The half of the square beyond its diagonal is folded back onto the triangle.
    weights = np.where(square.sum(axis=1, keepdims=True) > 1.0, 1.0 - square, square)
    return corners[triangles, 0] + np.einsum("kc,kci->ki", weights, along[triangles])
