"""Clips by what they are called: built-in ones, files, and the one a result was made from."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from hoi_retarget.clip.augment import augment
from hoi_retarget.clip.clip import Augmentation, Clip, Source
from hoi_retarget.clip.edits import ContactEdits, FixAll, Move, apply, from_text
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, ReadError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.result_file import load, save
from hoi_retarget.readers import own_layout
from hoi_retarget.readers.builtin_clips import FOLDER
from hoi_retarget.readers.open import clip_of, open_clip, recording_of, result_stem
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.robots import robot
from hoi_retarget.robots.model import load_model
from intermimic_writer import columns_of, write_box
from synthetic import SCENES, make
from torch_writer import torch_bytes

SETTINGS = {"objects": "objects", "object_name": None}


def same(a: Clip, b: Clip) -> bool:
    """Whether two clips agree in every number and in where they are from."""
    return (
        a.source == b.source
        and (a.name, a.fps, a.first_source_frame) == (b.name, b.fps, b.first_source_frame)
        and all(np.array_equal(x.joint_positions, y.joint_positions) for x, y in zip(a.people, b.people, strict=True))
        and all(np.array_equal(x.positions, y.positions) for x, y in zip(a.objects, b.objects, strict=True))
        and all(
            np.array_equal(x.contact_points, y.contact_points, equal_nan=True)
            for x, y in zip(a.contacts, b.contacts, strict=True)
        )
    )


def result_of(clip: Clip, **report) -> Motion:
    """Return a motion whose report tells of the clip, as a run's does."""
    motion = any_motion()
    return replace(motion, report=replace(motion.report, **{"source": clip.source, **report}))


@cache
def any_motion() -> Motion:
    return retarget(make("carry_box", seconds=0.5), load_model(robot("unitree_g1")), Config())


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """The current folder, with one recording and its object."""
    write_box(tmp_path / "objects", "box")
    (tmp_path / "sub1_box_000.pt").write_bytes(torch_bytes(columns_of(make("carry_box", seconds=3.0))))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("scene", list(SCENES))
def test_every_scene_is_a_built_in_clip(scene, tmp_path):
    clip = open_clip(f"builtin:{scene}")
    assert clip.source.path == f"builtin:{scene}"
    own_layout.write(make(scene), tmp_path / "made.npz")
    with np.load(tmp_path / "made.npz") as made, np.load(FOLDER / f"{scene}.npz") as stored:
        assert set(made) == set(stored)
        for name in made:
            of = np.testing.assert_allclose if made[name].dtype == float else np.testing.assert_array_equal
            of(stored[name], made[name], **({"atol": 1e-6} if made[name].dtype == float else {}))
    assert same(clip_of(result_of(clip)), clip)
    assert result_stem(Path(f"builtin:{scene}")) == scene


def test_clips_made_with_other_options_are_not_the_built_in_one():
    for options in ({"height": 1.6}, {"seed": 1}, {"fps": 60.0}, {"seconds": 2.0}, {"repetitions": 1}):
        assert not make("carry_box", **options).source.path


def test_an_unknown_built_in_clip_names_those_there_are():
    with pytest.raises(ArgumentError) as caught:
        open_clip(Path("builtin:juggle"))
    assert all(f"builtin:{scene}" in str(caught.value) for scene in SCENES)


def test_a_file_is_read_as_readers_do(folder):
    clip = open_clip("sub1_box_000.pt", ReadOptions(objects=Path("objects")))
    assert clip.objects[0].name == "box"
    assert result_stem("elsewhere/sub1_box_000.pt") == "sub1_box_000"
    with pytest.raises(ReadError):
        open_clip("gone.pt")


def test_the_clip_of_a_result_is_the_clip_it_was_made_from(folder, monkeypatch):
    clip = open_clip("sub1_box_000.pt", ReadOptions(objects=Path("objects")))
    motion = result_of(clip, command=SETTINGS)
    save(motion, folder / "result.npz")
    assert same(clip_of(load(folder / "result.npz")), clip)
    monkeypatch.chdir("/")
    with pytest.raises(ReadError, match=r"sub1_box_000\.pt.* Pass --clip"):
        clip_of(motion)


def test_the_edits_of_a_result_are_applied_again(folder):
    clip = open_clip("sub1_box_000.pt", ReadOptions(objects=Path("objects")))
    edits = ContactEdits.of(clip).adding(FixAll()).adding(Move("left_hand", clip.frames - 1, (0.01, 0.0, 1 / 3)))
    motion = result_of(apply(clip, edits), command=SETTINGS)
    assert same(clip_of(motion), apply(clip, edits))
    recording, found = recording_of(motion)
    assert same(recording, clip) and found == edits
    assert recording_of(result_of(clip, command=SETTINGS))[1] == ContactEdits.of(clip)


def test_a_result_of_an_augmented_clip_leads_to_that_clip(folder):
    clip = open_clip("sub1_box_000.pt", ReadOptions(objects=Path("objects")))
    edited = apply(clip, ContactEdits.of(clip).adding(FixAll()))
    augmented = augment(edited, Augmentation(mirrored=True, speed=1.25))
    save(result_of(augmented, command=SETTINGS), folder / "result.npz")
    assert same(clip_of(load(folder / "result.npz")), augmented)
    assert same(recording_of(result_of(augmented, command=SETTINGS))[0], clip)


def test_a_recording_that_changed_is_refused(folder):
    clip = open_clip("sub1_box_000.pt", ReadOptions(objects=Path("objects")))
    (folder / "sub1_box_000.pt").write_bytes(torch_bytes(columns_of(make("carry_box", seconds=2.0))))
    with pytest.raises(ReadError, match=r"sub1_box_000\.pt: the file has changed .* Pass --clip"):
        clip_of(result_of(clip, command=SETTINGS))


@pytest.mark.parametrize(
    "report",
    [
        {"source": Source()},
        {"source": Source("builtin:juggle")},
        {"source": Source("builtin:carry_box", "0")},
        {"source": Source("gone.pt"), "command": {"objects": 3}},
    ],
)
def test_reports_that_do_not_lead_to_a_clip(report):
    with pytest.raises(ReadError, match="Pass --clip"):
        clip_of(result_of(make("carry_box"), **report))


def test_a_result_whose_edits_are_damaged():
    clip = make("carry_box")
    with pytest.raises(ReadError, match="the result's contact edits"):
        clip_of(result_of(replace(clip, source=replace(clip.source, contact_edits="schema = 1"))))
    text = apply(clip, ContactEdits.of(clip).adding(FixAll())).source.contact_edits.replace("268", "269")
    assert from_text(text, "text").made_for.frames == 269
    with pytest.raises(ReadError, match="another clip"):
        clip_of(result_of(replace(clip, source=replace(clip.source, contact_edits=text))))
