"""Theia's clips of an object in each hand: written and read back, and files that are damaged or called otherwise."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError, GeometryError
from hoi_retarget.objects.track import ObjectTrack
from hoi_retarget.readers import read_clip, theia
from hoi_retarget.readers.describe import inspect
from intermimic_writer import random_clip, theia_columns_of, write_box
from torch_writer import torch_bytes

REAL = sorted((Path(__file__).resolve().parents[2] / "shared/data/foreign/other").glob("*+*.pt"))
NAMES = ("cup", "kettle")


def clip_of_two(seed: int = 0) -> Clip:
    """Return a clip of one person whose left hand touches a cup now and then, and whose right hand a kettle."""
    clip, rng = random_clip(seed), np.random.default_rng(seed)
    person, first = clip.people[0], clip.objects[0]
    tracks = (replace(first, name="cup"), ObjectTrack("kettle", first.positions[::-1], first.quats, first.geometry))
    contacts = tuple(
        ContactTrack(
            0,
            k,
            f"{side}_hand",
            rng.random(clip.frames) < 0.5,
            tracks[k].to_object(person.part_position(f"{side}_hand")),
        )
        for k, side in enumerate(theia.SIDES)
    )
    return replace(clip, objects=tracks, contacts=contacts)


@pytest.fixture
def options(tmp_path):
    for name in NAMES:
        write_box(tmp_path / "objects", name)
    return ReadOptions(objects=tmp_path / "objects")


def written(folder: Path, matrix: np.ndarray, name: str = "sub1_cup+kettle_S1.pt") -> Path:
    (folder / name).write_bytes(torch_bytes(matrix))
    return folder / name


@pytest.mark.parametrize("seed", range(3))
def test_what_is_written_is_read(tmp_path, options, seed):
    clip = clip_of_two(seed)
    again = read_clip(written(tmp_path, theia_columns_of(clip)), options)
    assert (again.fps, again.frames) == (30.0, clip.frames)
    assert np.allclose(again.people[0].joint_positions, clip.people[0].joint_positions, atol=1e-6)
    assert np.allclose(again.people[0].joint_quats, clip.people[0].joint_quats, atol=1e-6)
    for new, old in zip(again.objects, clip.objects, strict=True):
        assert new.name == old.name
        assert np.allclose(new.positions, old.positions, atol=1e-6)
        assert np.allclose(new.quats, old.quats, atol=1e-6)
    active = {(track.object, track.part): track.active for track in again.contacts if track.active.any()}
    assert set(active) == {(0, "left_hand"), (1, "right_hand")}
    for track in clip.contacts:
        assert np.array_equal(active[track.object, track.part], track.active)


def test_labels_that_disagree_are_noted_and_the_hands_count(tmp_path, options):
    matrix = theia_columns_of(clip_of_two())
    own, bodies = theia.FIELDS["object 2 contact label"], theia.FIELDS["body contact labels"]
    matrix[3, own] = 1.0 - matrix[3, own]
    matrix[4, bodies.start] = 1.0  # the pelvis
    clip = read_clip(written(tmp_path, matrix), options)
    whole = read_clip(written(tmp_path, theia_columns_of(clip_of_two()), "sub1_cup+kettle_S2.pt"), options)
    assert all(np.array_equal(a.active, b.active) for a, b in zip(clip.contacts, whole.contacts, strict=True))
    assert "1 frame(s) label kettle otherwise than the right hand" in " ".join(clip.source.notes)
    assert "1 frame(s) label other bodies than hands" in " ".join(clip.source.notes)


def test_names_are_told_by_the_file_or_the_user(tmp_path, options):
    path = written(tmp_path, theia_columns_of(clip_of_two()), "clip.pt")
    with pytest.raises(GeometryError, match=r"Pass --object NAME\+NAME"):
        read_clip(path, options)
    clip = read_clip(path, replace(options, object_name="kettle+cup"))
    assert [track.name for track in clip.objects] == ["kettle", "cup"]
    for wrong in ("cup", "cup+cup", "cup+kettle+pan"):
        with pytest.raises(GeometryError, match="names of its two objects"):
            read_clip(path, replace(options, object_name=wrong))
    with pytest.raises(GeometryError, match="plain folder name"):
        read_clip(path, replace(options, object_name="../cup+kettle"))
    with pytest.raises(GeometryError, match=r"cup/cup.obj or .*, kettle/kettle.obj or"):
        read_clip(written(tmp_path, theia_columns_of(clip_of_two())))


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        (200, np.nan, "body positions (columns 162:318) is not finite"),
        (330, 3.0, "object 2 rotation (columns 328:332)"),
        (332, 2.0, "object 1 contact label"),
        (340, 0.5, "body contact labels"),
        (0, 9.0, "the file contradicts itself"),
    ],
)
def test_damage_is_named(tmp_path, options, column, value, words):
    matrix = theia_columns_of(clip_of_two())
    matrix[4, column] = value
    path = written(tmp_path, matrix)
    with pytest.raises(ClipError) as caught:
        read_clip(path, options)
    assert str(path) in str(caught.value)
    assert words in str(caught.value)
    assert words in inspect(path, options).problems[0]


@pytest.mark.skipif(not REAL, reason="no real recording here")
def test_the_real_clip_is_read(tmp_path):
    for name in ("CupBlue", "KettleGreen"):
        write_box(tmp_path, name, 0.05)
    clip = read_clip(REAL[0], ReadOptions(objects=tmp_path))
    assert (clip.frames, [track.name for track in clip.objects]) == (339, ["CupBlue", "KettleGreen"])
    assert {(track.object, track.part, track.active.sum()) for track in clip.contacts if track.active.any()} == {
        (0, "left_hand", 229),
        (1, "right_hand", 176),
    }
    assert 1.65 < clip.people[0].height < 1.75
