"""Copies of shapes as rigid meshes: where their vertices are is where the copies' are, whatever moves alike."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.numerics import se3
from hoi_retarget.studio.browser.viser_scene import bodies_of
from hoi_retarget.studio.scene.drawing import Kind, Shapes

FRAMES = 40


def shapes_on(links: np.ndarray, seed: int, visible: np.ndarray | None = None) -> Shapes:
    """Return boxes of two colours on links that move at random."""
    random, count = np.random.default_rng(seed), len(links)
    places = random.normal(size=(FRAMES, links.max() + 1, 3)).cumsum(axis=0)[:, links]
    turns = se3.exp(random.normal(size=(FRAMES, links.max() + 1, 3)))[:, links]
    within, turned = random.normal(size=(count, 3)), se3.exp(random.normal(size=(count, 3)))
    positions = places + se3.rotate(turns, np.broadcast_to(within, (FRAMES, count, 3)))
    return Shapes(
        Kind.BOX,
        random.uniform(0.1, 1.0, (count, 3)).astype(np.float32),
        random.integers(0, 2, (count, 1)).repeat(3, axis=1).astype(np.uint8),
        positions,
        se3.quat_multiply(turns, np.broadcast_to(turned, (FRAMES, count, 4))),
        visible,
    )


def corners(shapes: Shapes, frame: int, copies: np.ndarray) -> np.ndarray:
    unit = np.stack(np.meshgrid(*3 * [[-1.0, 1.0]], indexing="ij"), axis=-1).reshape(-1, 3)
    turned = se3.rotate(shapes.quats[frame, copies][:, None], shapes.sizes[copies][:, None] * unit)
    return sorted_rows((shapes.positions[frame, copies][:, None] + turned).reshape(-1, 3))


def sorted_rows(points: np.ndarray) -> np.ndarray:
    return points[np.lexsort(np.round(points, 6).T)]


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(0, 3), min_size=1, max_size=8), st.integers(0, 999))
def test_bodies_are_where_the_copies_are(links, seed):
    shapes = shapes_on(np.array(links), seed)
    bodies = bodies_of(shapes)
    assert len(bodies) == len({(link, int(colour)) for link, colour in zip(links, shapes.colours[:, 0], strict=True)})
    for frame in (0, 7, FRAMES - 1):
        found = [body.positions[frame] + se3.rotate(body.quats[frame], body.vertices) for body in bodies]
        expected = corners(shapes, frame, np.arange(shapes.count))
        np.testing.assert_allclose(sorted_rows(np.concatenate(found)), expected, atol=1e-6)


def test_what_moves_apart_in_one_frame_only_is_two_bodies():
    shapes = shapes_on(np.zeros(2, dtype=int), 0)
    shapes.colours[:] = 0
    assert len(bodies_of(shapes)) == 1
    shapes.positions[11, 1] += [0.0, 0.0, 0.001]
    assert len(bodies_of(shapes)) == 2


def test_what_is_there_in_other_frames_is_another_body():
    visible = np.ones((FRAMES, 3), dtype=bool)
    visible[5, 1] = False
    shapes = shapes_on(np.zeros(3, dtype=int), 0, visible)
    shapes.colours[:] = 0
    one, other = bodies_of(shapes)
    assert one.visible is not None and one.visible.all()
    assert other.visible is not None and np.flatnonzero(~other.visible).tolist() == [5]
