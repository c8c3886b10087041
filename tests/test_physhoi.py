"""PhysHOI's clips of a person with a ball: written and read back, the ball's shape, whose hand it is, damage."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, ClipError
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.readers import physhoi, read_clip
from hoi_retarget.readers.describe import inspect
from hoi_retarget.readers.worlds import World
from intermimic_writer import physhoi_columns_of, random_clip, write_box
from torch_writer import torch_bytes

REAL = Path(__file__).resolve().parents[2] / "shared/data/foreign/other/physhoi_pass.pt"


def written(folder: Path, matrix: np.ndarray) -> Path:
    (folder / "toss.pt").write_bytes(torch_bytes(matrix))
    return folder / "toss.pt"


def standing_clip(seed: int = 0) -> Clip:
    """Return a clip of a person in random poses who stands along z."""
    clip, world = random_clip(seed), World.of_axis("y")
    return replace(clip, people=(world.turned_person(clip.people[0]),))


def holding(clip: Clip, hand: str) -> Clip:
    """Return a clip whose object is at a hand's fingers in the first half of the frames, then far from everybody."""
    track, held = clip.objects[0], np.arange(clip.frames) < clip.frames // 2
    at_hand = clip.people[0].position(f"{hand}_middle3") + np.array([0.0, 0.0, 0.1])
    return replace(
        clip, objects=(replace(track, positions=np.where(held[:, None], at_hand, np.array([9.0, 9.0, 0.12]))),)
    )


@pytest.mark.parametrize("seed", range(3))
def test_what_is_written_is_read(tmp_path, seed):
    clip = standing_clip(seed)
    again = read_clip(written(tmp_path, physhoi_columns_of(clip)))
    assert (again.name, again.fps, again.frames) == ("toss", 25.0, clip.frames)
    assert np.allclose(again.people[0].joint_positions, clip.people[0].joint_positions, atol=1e-6)
    assert se3.angle_between(again.people[0].joint_quats, clip.people[0].joint_quats).max() < 1e-5
    assert np.allclose(again.objects[0].positions, clip.objects[0].positions, atol=1e-6)
    assert se3.angle_between(again.objects[0].quats, clip.objects[0].quats).max() < 1e-5


@pytest.mark.parametrize("hand", ["left", "right"])
def test_the_hand_at_the_ball_touches_it_in_labelled_frames(tmp_path, hand):
    clip = holding(standing_clip(), hand)
    matrix = physhoi_columns_of(clip)
    label = physhoi.FIELDS["contact label"]
    matrix[:, label] = 0.0
    matrix[1 : clip.frames - 2, label] = 1.0
    again = read_clip(written(tmp_path, matrix))
    held = np.arange(clip.frames) < clip.frames // 2
    active = {track.part: track.active for track in again.contacts}
    assert np.array_equal(active[f"{hand}_hand"], held & (np.arange(clip.frames) > 0))
    assert not active["left_foot"].any() and not active["right_foot"].any()
    assert f"{clip.frames - 2 - clip.frames // 2} frame(s) are labelled as touched" in " ".join(again.source.notes)


def test_the_ball_is_a_sphere_unless_the_user_has_one(tmp_path):
    path = written(tmp_path, physhoi_columns_of(standing_clip()))
    clip = read_clip(path, ReadOptions(objects=tmp_path))
    points = clip.objects[0].geometry.points
    assert np.allclose(np.linalg.norm(points, axis=1), physhoi.RADIUS)
    directions = np.random.default_rng(0).normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    inside = surface_of(clip.objects[0].geometry).signed_distances(0.05 * directions)
    assert np.allclose(inside, 0.05 - physhoi.RADIUS, atol=1e-3)
    assert (-clip.objects[0].geometry.lowest_along(directions) > physhoi.RADIUS - 1e-3).all()
    assert any("sphere of 12 cm" in note for note in clip.source.notes)
    write_box(tmp_path, "ball", 0.1)
    clip = read_clip(path, ReadOptions(objects=tmp_path))
    assert np.abs(clip.objects[0].geometry.points).max() == 0.1
    assert not any("sphere" in note for note in clip.source.notes)
    with pytest.raises(ArgumentError, match="names ball"):
        read_clip(path, ReadOptions(object_name="box"))


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        (200, np.nan, "body positions (columns 162:318) is not finite"),
        (330, 0.5, "contact label (columns 330:331)"),
        (0, 9.0, "the file contradicts itself"),
        (319, 1e9, "ball position (columns 318:321) exceeds"),
    ],
)
def test_damage_is_named(tmp_path, column, value, words):
    matrix = physhoi_columns_of(standing_clip())
    matrix[4, column] = value
    path = written(tmp_path, matrix)
    with pytest.raises(ClipError) as caught:
        read_clip(path)
    assert str(path) in str(caught.value)
    assert words in str(caught.value)
    assert words in inspect(path).problems[0]


def test_angles_that_do_not_fit_positions_are_refused(tmp_path):
    matrix = physhoi_columns_of(standing_clip())
    matrix[:, physhoi.FIELDS["root angles"]] += 1.5
    with pytest.raises(ClipError, match=r"joint angles \(columns 9:162\) do not fit"):
        read_clip(written(tmp_path, matrix))


def test_leading_zero_frames_are_dropped_and_counted(tmp_path):
    matrix = physhoi_columns_of(standing_clip())
    empty = np.zeros_like(matrix[:2])
    empty[:, physhoi.FIELDS["contact label"]] = 1.0  # Labels alone are no data.
    clip = read_clip(written(tmp_path, np.concatenate([empty, matrix])))
    assert (clip.frames, clip.first_source_frame) == (12, 2)


@pytest.mark.skipif(not REAL.exists(), reason="no real recording here")
def test_the_real_clip_is_read():
    clip = read_clip(REAL)
    assert (clip.frames, clip.fps) == (36, 25.0)
    frames = {track.part: int(track.active.sum()) for track in clip.contacts}
    assert frames == {"left_hand": 19, "right_hand": 18, "left_foot": 0, "right_foot": 0}
    assert 1.65 < clip.people[0].height < 1.75
    assert clip.objects[0].lowest.min() > 0.0
