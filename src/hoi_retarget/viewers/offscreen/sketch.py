"""A frame of a `Scene` as a drawing of lines and ellipses (SVG): for machines that have no way to render."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError

from hoi_retarget.numerics import se3
from hoi_retarget.viewers.scene.drawing import Kind, Lines, Part, Scene, Shapes, Solid
from hoi_retarget.viewers.scene.object_solid import thinned

_WIDTH, _HEIGHT = 640, 360
_CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_MOST_TRIANGLES = 1500
_GRID = 8  # Lines of the floor to each side [m].


@dataclass(frozen=True, eq=False)
class Eye:
    """A pinhole camera."""

    place: Float[np.ndarray, "3"]
    """[m]"""
    axes: Float[np.ndarray, "3 3"]
    """Right, down and ahead, as rows."""
    focal: float
    """[px]"""

    @staticmethod
    def looking(
        target: Float[np.ndarray, "3"], azimuth: float, elevation: float, distance: float, field_of_view: float
    ) -> "Eye":
        """Return the eye that looks at a point from a direction [rad] and a distance [m]."""
        flat = np.cos(elevation)
        back = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        axes = np.stack([right, np.cross(right, back), -back])
        return Eye(target + distance * back, axes, _HEIGHT / (2 * np.tan(0.5 * field_of_view)))

    def see(self, points: Float[np.ndarray, "*batch 3"]) -> tuple[np.ndarray, np.ndarray]:
        """Return where points are in the picture [px], and how far away [m]."""
        seen = (points - self.place) @ self.axes.T
        depth = np.maximum(seen[..., 2], 1e-3)
        return self.focal * seen[..., :2] / depth[..., None] + [_WIDTH / 2, _HEIGHT / 2], seen[..., 2]


def sketch(scene: Scene, frame: int, eye: Eye) -> str:
    """Return the shown layers of a frame as an SVG picture, the farthest first."""
    drawn: list[tuple[float, str]] = []
    for subject in scene.subjects:
        own = scene.frame_of(subject, frame)
        for layer in subject.layers:
            if layer.shown:
                for part in layer.parts:
                    drawn += _draw(part, own, eye)
    # Drawn from the back to the front; what is behind the eye is left out.
    shapes = "".join(text for depth, text in sorted(drawn, key=lambda item: -item[0]) if depth > 0.05)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" width="{_WIDTH}" '
        f'height="{_HEIGHT}"><rect width="100%" height="100%" fill="#f1f3f5"/>{_floor(eye)}{shapes}</svg>'
    )


def _draw(part: Part, frame: int, eye: Eye) -> Iterator[tuple[float, str]]:
    match part:
        case Solid():
            yield _triangles(part, frame, eye)
        case Shapes():
            there = range(len(part.sizes)) if part.visible is None else np.flatnonzero(part.visible[frame])
            for index in there:
                axes = se3.quat_to_matrix(part.quats[frame, index].astype(float)) * part.sizes[index]
                yield from _shape(part.kind, part.positions[frame, index], axes, _hex(part.colours[index]), eye)
        case Lines():
            for index in np.flatnonzero(part.visible[frame]):
                ends = np.stack([part.starts[frame, index], part.ends[frame, index]])
                yield _line(ends, 0.004, _hex(part.colours[frame, index]), eye)


def _shape(kind: Kind, place: np.ndarray, axes: np.ndarray, colour: str, eye: Eye) -> Iterator[tuple[float, str]]:
    """Draw a unit shape with half extents along the columns of `axes`."""
    match kind:
        case Kind.BOX:
            yield from _hull(place + _CUBE @ axes.T, colour, eye)
        case Kind.CYLINDER:
            radius = float(np.linalg.norm(axes[:, 0]))
            yield _line(np.stack([place - axes[:, 2], place + axes[:, 2]]), radius, colour, eye)
        case Kind.SPHERE:
            (x, y), depth = eye.see(place)
            flat = eye.focal / max(float(depth), 0.05) * (eye.axes[:2] @ axes)
            lengths, turns = np.linalg.eigh(flat @ flat.T)
            tilt = np.degrees(np.arctan2(turns[1, 1], turns[0, 1]))
            small, large = np.sqrt(np.maximum(lengths, 0.0))
            ellipse = f'<ellipse rx="{large:.1f}" ry="{small:.1f}" fill="{colour}"'
            yield float(depth), f'{ellipse} transform="translate({x:.1f} {y:.1f}) rotate({tilt:.0f})"/>'


def _line(ends: np.ndarray, radius: float, colour: str, eye: Eye) -> tuple[float, str]:
    ((x, y), (u, v)), depths = eye.see(ends)
    depth = float(depths.mean())
    width = 2 * radius * eye.focal / max(depth, 0.05)
    return depth, (
        f'<line x1="{x:.1f}" y1="{y:.1f}" x2="{u:.1f}" y2="{v:.1f}" stroke="{colour}" stroke-width="{width:.1f}"/>'
    )


def _triangles(solid: Solid, frame: int, eye: Eye) -> tuple[float, str]:
    """Draw a mesh as what its triangles cover, in one colour."""
    vertices, faces = thinned(solid.vertices, solid.faces, _MOST_TRIANGLES)
    points, depths = eye.see(solid.positions[frame] + se3.rotate(solid.quats[frame], vertices))
    corners = np.round(points[faces], 1)
    (ux, uy), (vx, vy) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    # Front and back would cancel out: all are drawn the same way round.
    corners = np.where((ux * vy < uy * vx)[:, None, None], corners[:, ::-1], corners)
    path = "".join(f"M{a[0]:g} {a[1]:g}L{b[0]:g} {b[1]:g}L{c[0]:g} {c[1]:g}Z" for a, b, c in corners)
    colour = _hex(solid.colour)
    return float(depths.mean()), f'<path d="{path}" fill="{colour}" stroke="{colour}" stroke-width="0.8"/>'


def _hull(corners: np.ndarray, colour: str, eye: Eye) -> Iterator[tuple[float, str]]:
    points, depths = eye.see(corners)
    try:
        outline = points[ConvexHull(points).vertices]
    except QhullError:
        return  # Seen edge on, it has no area.
    text = " ".join(f"{x:.1f},{y:.1f}" for x, y in outline)
    yield float(depths.mean()), f'<polygon points="{text}" fill="{colour}"/>'


def _floor(eye: Eye) -> str:
    middle = np.round(eye.place + eye.axes[2] * eye.place[2] / max(-eye.axes[2, 2], 0.1))[:2]
    steps = np.arange(-_GRID, _GRID + 1)
    lines = []
    for step in steps:
        for ends in ([[step, -_GRID], [step, _GRID]], [[-_GRID, step], [_GRID, step]]):
            # In pieces: those behind the eye are left out.
            (start, stop), pieces = np.array(ends, dtype=float) + middle, np.linspace(0.0, 1.0, 17)
            path = start + pieces[:, None] * (stop - start)
            points, depths = eye.see(np.column_stack([path, np.zeros(len(path))]))
            shown = points[depths > 0.3]
            if len(shown) > 1:
                lines.append("M" + "L".join(f"{x:.0f} {y:.0f}" for x, y in shown[[0, -1]]))
    return f'<path d="{"".join(lines)}" stroke="#d9dde1" stroke-width="1" fill="none"/>'


def _hex(colour: tuple[int, int, int] | np.ndarray) -> str:
    return "#" + "".join(f"{int(share):02x}" for share in colour)
