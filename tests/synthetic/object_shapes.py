"""Geometry of our own for the synthetic scenes: everything is made of boxes.

An object's origin is the middle of its bounding box; x is its depth, y its width, z is up.
The sizes vary a little with the seed, the order of the vertices does not: the faces of a
shape's mesh fit the `ObjectGeometry.points` of any synthetic clip.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.errors import ArgumentError
from hoi_retarget.objects.track import ObjectGeometry

Vertices = Float[np.ndarray, "V 3"]
Faces = Int[np.ndarray, "F 3"]

REFERENCE_HEIGHT = 1.75  # [m]
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
# Two triangles a side, counter-clockwise seen from outside.
_BOX_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


@dataclass(frozen=True)
class Block:
    """One box of an object: two opposite corners [m]."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]


@dataclass(frozen=True)
class Shape:
    """An object made of blocks; `low` and `high` of all blocks are symmetric about the origin."""

    name: str
    size: tuple[float, float, float]
    """Depth, width, height of the bounding box [m]."""
    blocks: tuple[Block, ...]

    @property
    def half(self) -> Float[np.ndarray, "3"]:
        """Half the size [m]: the origin rests `half[2]` above the floor."""
        return 0.5 * np.array(self.size)

    @property
    def geometry(self) -> ObjectGeometry:
        """The geometry as clips carry it."""
        vertices, faces = self.mesh
        return ObjectGeometry(vertices, faces=faces)

    @property
    def mesh(self) -> tuple[Vertices, Faces]:
        """Vertices [m] and triangles."""
        vertices, faces = [], []
        for index, block in enumerate(self.blocks):
            low, high = np.array(block.low), np.array(block.high)
            vertices.append(0.5 * (low + high) + 0.5 * (high - low) * _CORNERS)
            faces.append(_BOX_FACES + 8 * index)
        # Blocks are given from the floor up; the mesh is centred.
        return np.concatenate(vertices) - np.array([0.0, 0.0, self.half[2]]), np.concatenate(faces)

    def scaled(self, factor: float) -> "Shape":
        """Return the same shape, `factor` times as large."""
        blocks = tuple(Block(_times(block.low, factor), _times(block.high, factor)) for block in self.blocks)
        return Shape(self.name, _times(self.size, factor), blocks)


def _times(values: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    x, y, z = values
    return (factor * x, factor * y, factor * z)


def _vary(generator: np.random.Generator, value: float, part: float = 0.08) -> float:
    return value * (1.0 + part * float(generator.uniform(-1.0, 1.0)))


def _box(generator: np.random.Generator) -> Shape:
    depth, width, height = _vary(generator, 0.34), _vary(generator, 0.42), _vary(generator, 0.32)
    return Shape("box", (depth, width, height), (Block((-depth / 2, -width / 2, 0.0), (depth / 2, width / 2, height)),))


def _table(generator: np.random.Generator) -> Shape:
    depth, width, height = _vary(generator, 1.10), _vary(generator, 0.70), _vary(generator, 0.74, 0.04)
    x, y, slab, leg = depth / 2, width / 2, 0.035, 0.05
    legs = [
        Block((fx * x + min(-fx, 0) * leg, fy * y + min(-fy, 0) * leg, 0.0),
              (fx * x + max(-fx, 0) * leg, fy * y + max(-fy, 0) * leg, height - slab))
        for fx in (-1, 1) for fy in (-1, 1)
    ]  # fmt: skip
    return Shape("table", (depth, width, height), (Block((-x, -y, height - slab), (x, y, height)), *legs))


def _chair(generator: np.random.Generator) -> Shape:
    depth, width, height = _vary(generator, 0.44), _vary(generator, 0.44), _vary(generator, 0.86, 0.04)
    x, y, seat, slab, leg = depth / 2, width / 2, 0.45, 0.035, 0.04
    blocks = [Block((-x, -y, seat - slab), (x, y, seat))]
    for fy in (-1, 1):
        y0, y1 = sorted((fy * y, fy * (y - leg)))
        blocks.append(Block((x - leg, y0, 0.0), (x, y1, seat - slab)))
        blocks.append(Block((-x, y0, 0.0), (-x + leg, y1, seat - slab)))
        blocks.append(Block((-x, y0, seat), (-x + 0.03, y1, height - 0.09)))
    blocks.append(Block((-x, -y, height - 0.09), (-x + 0.03, y, height)))
    blocks.append(Block((-x, -y + leg, seat + 0.12), (-x + 0.02, y - leg, seat + 0.19)))
    return Shape("chair", (depth, width, height), tuple(blocks))


def _suitcase(generator: np.random.Generator) -> Shape:
    depth, width, body, height = _vary(generator, 0.25), _vary(generator, 0.40), 0.56, _vary(generator, 0.93, 0.03)
    x, y, wheel, bar = depth / 2, width / 2, 0.04, 0.022
    blocks = [Block((-x, -y, wheel), (x, y, body))]
    for fy in (-1, 1):
        y0, y1 = sorted((fy * y, fy * (y - 0.03)))
        blocks.append(Block((x - 0.05, y0, 0.0), (x, y1, wheel)))
        blocks.append(Block((-x, y0, 0.0), (-x + 0.05, y1, wheel)))
        h0, h1 = sorted((fy * 0.09, fy * (0.09 - bar)))
        blocks.append(Block((x - bar, h0, body), (x, h1, height - bar)))
    blocks.append(Block((x - bar, -0.09, height - bar), (x, 0.09, height)))
    return Shape("suitcase", (depth, width, height), tuple(blocks))


_SHAPES: Mapping[str, Callable[[np.random.Generator], Shape]] = MappingProxyType(
    {"box": _box, "table": _table, "suitcase": _suitcase, "chair": _chair}
)
OBJECTS: tuple[str, ...] = tuple(_SHAPES)


def shape(name: str, *, height: float = REFERENCE_HEIGHT, seed: int = 0) -> Shape:
    """Return one of our objects; raises `ArgumentError` where there is none of that name.

    Sizes are proportional to the height [m] of the person who uses the object, so that everybody
    can do the same things with them; the seed varies them by a few percent.
    """
    if name not in _SHAPES:
        raise ArgumentError(f"There is no object {name!r}. Objects: {', '.join(OBJECTS)}.")
    made = _SHAPES[name](np.random.default_rng([seed, OBJECTS.index(name)]))
    return made.scaled(height / REFERENCE_HEIGHT)
