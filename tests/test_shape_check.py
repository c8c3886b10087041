"""Shapes of objects that contradict their contacts are told, with what is wrong and what mends it."""

from dataclasses import replace

import numpy as np
import pytest

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.shape_check import with_shape_warnings
from hoi_retarget.errors import ClipError
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.track import ObjectGeometry
from synthetic import make

CLIP = make("carry_box")


def with_shape(vertices: np.ndarray, faces: np.ndarray) -> Clip:
    (track,) = CLIP.objects
    return replace(CLIP, objects=(replace(track, geometry=ObjectGeometry(vertices, faces=faces)),))


def shape() -> tuple[np.ndarray, np.ndarray]:
    surface = surface_of(CLIP.objects[0].geometry)
    return np.array(surface.vertices), np.array(surface.faces)


def told(clip: Clip) -> list[str]:
    return [str(warning) for warning in clip.source.warnings if warning.code == "object_shape"]


def test_a_shape_that_fits_is_not_told():
    checked = with_shape_warnings(CLIP, "refuse")
    assert (told(checked), checked.source.notes) == ([], CLIP.source.notes)


@pytest.mark.parametrize(("factor", "name"), [(100.0, "centimetres"), (1000.0, "millimetres"), (1 / 0.0254, "inches")])
def test_another_unit_is_refused_with_the_factor_that_mends_it(factor, name):
    vertices, faces = shape()
    clip = with_shape(factor * vertices, faces)
    with pytest.raises(ClipError, match=rf"it is in {name}. Multiply its vertices by {1 / factor:g}\."):
        with_shape_warnings(clip, "refuse")
    assert name in told(with_shape_warnings(clip, "warn"))[0]


def test_another_axis_is_told_with_the_turn_that_mends_it():
    """A tall box with its sides at the hands, which lies on its side."""
    vertices, faces = shape()
    tall = vertices * [1.0, 1.0, 3.0]
    assert not told(with_shape_warnings(with_shape(tall + np.array([0.0, 0.0, 0.3]), faces), "refuse"))
    lying = se3.rotate(se3.exp(np.array([0.5 * np.pi, 0.0, 0.0])), tall)
    (text,) = told(with_shape_warnings(with_shape(lying, faces), "refuse"))
    assert "y axis for z. Turn its vertices by" in text
    assert "90 degrees about x" in text


def test_another_origin_is_told_with_the_move_that_mends_it():
    vertices, faces = shape()
    (text,) = told(with_shape_warnings(with_shape(vertices + np.array([0.9, 0.0, 0.0]), faces), "refuse"))
    assert "its origin is not that of the poses" in text


def test_layouts_of_centred_shapes_tell_another_origin_by_the_shape_alone():
    vertices, faces = shape()
    clip = with_shape(vertices - vertices.mean(axis=0) + [0.0, 0.0, 0.2], faces)
    clip = replace(clip, source=replace(clip.source, format="intermimic-591"))
    assert ", -0.200) m." in told(with_shape_warnings(clip, "refuse"))[0]


def test_open_and_inverted_shapes_are_noted():
    vertices, faces = shape()
    inverted = with_shape_warnings(with_shape(vertices, faces[:, ::-1]), "refuse")
    assert any("face inwards" in note for note in inverted.source.notes)
    corners = vertices[faces].mean(axis=1)
    top = corners[:, 2] > corners[:, 2].max() - 1e-6
    opened = with_shape_warnings(with_shape(vertices, faces[~top]), "refuse")
    assert any("surface is open" in note for note in opened.source.notes)
