"""The rigid-grasp test: true clips pass, planted faults do not."""

import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glb_writer import humoto
from hoi_retarget.cli import main
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.grasp_check import ONLY_INVERSE, fatal_fault, grasp_faults, grasp_figures, with_grasp_warnings
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectTrack
from hoi_retarget.readers import own_layout, read_clip
from hoi_retarget.readers.describe import inspect
from hoi_retarget.readers.open import open_clip
from synthetic import SCENES, make

SHARED = Path(__file__).resolve().parents[1].parent / "shared" / "data"
REAL = [(path, SHARED / "objects") for path in sorted((SHARED / "omomo").glob("*.pt"))]
REAL += [(path, SHARED / "parahome" / "objects") for path in sorted((SHARED / "parahome").glob("*.pt"))]
LANDMARK = ("--contact", "landmark")
TURNING = ("carry_box", "drag_suitcase")  # In the others the object keeps its heading.


def moved(clip: Clip, change: Callable[[ObjectTrack], ObjectTrack]) -> Clip:
    return replace(clip, objects=tuple(map(change, clip.objects)))


def shifted(clip: Clip, frames: int) -> Clip:
    points = np.zeros((clip.frames, 3))
    tracks = (replace(it, active=np.roll(it.active, frames), contact_points=points) for it in clip.contacts)
    return replace(clip, contacts=tuple(tracks))


ROTATIONS = {
    "inverse": lambda item: replace(item, quats=se3.quat_conjugate(item.quats)),
    "scalar first": lambda item: replace(item, quats=np.roll(item.quats, 1, axis=-1)),
    "scalar last": lambda item: replace(item, quats=np.roll(item.quats, -1, axis=-1)),
}
UNITS = {
    "centimetres": lambda item: replace(item, positions=1e2 * item.positions),
    "millimetres": lambda item: replace(item, positions=1e3 * item.positions),
}


def inverse_pose(item: ObjectTrack) -> ObjectTrack:
    positions = -se3.rotate_inverse(item.quats, item.positions)
    return replace(item, positions=positions, quats=se3.quat_conjugate(item.quats))


@settings(derandomize=True, deadline=None, max_examples=6, database=None)
@given(scene=st.sampled_from(tuple(SCENES)), height=st.floats(1.3, 2.1), seed=st.integers(0, 50))
def test_synthetic_clips_pass(scene, height, seed):
    clip = make(scene, height=height, seed=seed)
    figures = grasp_figures(clip)
    assert figures.frames > 0
    assert figures.spread < 1e-6
    assert figures.reach < 0.1
    assert with_grasp_warnings(clip) is clip


@settings(derandomize=True, deadline=None, max_examples=4, database=None)
@given(vector=st.tuples(*[st.floats(-3, 3)] * 3), shift=st.tuples(*[st.floats(-5, 5)] * 3))
def test_figures_do_not_depend_on_where_the_world_is(vector, shift):
    clip, quat = make("carry_box", seconds=2.0), se3.exp(np.array(vector))
    person = clip.people[0]
    there = moved(
        replace(
            clip,
            people=(
                replace(
                    person,
                    joint_positions=se3.rotate(quat, person.joint_positions) + shift,
                    joint_quats=se3.quat_multiply(quat, person.joint_quats),
                ),
            ),
        ),
        lambda it: replace(
            it, positions=se3.rotate(quat, it.positions) + shift, quats=se3.quat_multiply(quat, it.quats)
        ),
    )
    assert grasp_figures(there).spread < 1e-6
    assert grasp_figures(there).reach == pytest.approx(grasp_figures(clip).reach, abs=1e-9)


@pytest.mark.parametrize("scene", TURNING)
@pytest.mark.parametrize("fault", ROTATIONS)
def test_rotations_read_wrongly_are_refused(scene, fault, tmp_path):
    clip = moved(make(scene), ROTATIONS[fault])
    with pytest.raises(ClipError, match="rotations are read wrongly"):
        with_grasp_warnings(clip)
    own_layout.write(clip, tmp_path / "clip.npz")
    with pytest.raises(ClipError, match="rotations are read wrongly"):
        read_clip(tmp_path / "clip.npz")


@pytest.mark.parametrize("fault", ROTATIONS | UNITS)
def test_who_knows_better_keeps_a_clip_with_a_warning(fault, tmp_path):
    own_layout.write(moved(make("carry_box"), (ROTATIONS | UNITS)[fault]), tmp_path / "clip.npz")
    with pytest.raises(ClipError, match="--grasps warn"):
        read_clip(tmp_path / "clip.npz")
    kept = open_clip(tmp_path / "clip.npz", ReadOptions(grasps="warn"))
    assert any("read wrongly" in str(it) or "another unit" in str(it) for it in kept.source.warnings)


@pytest.mark.parametrize("fault", ROTATIONS)
def test_no_other_reading_is_tried_than_the_format_leaves_open(fault):
    """The scalar's place means nothing where rotations are stored as matrices, and nothing is open in glTF."""
    clip = moved(make("carry_box"), ROTATIONS[fault])
    texts = [str(it) for it in with_grasp_warnings(clip, ()).source.warnings]
    assert not any("rotations are read wrongly" in text for text in texts)
    if fault == "inverse":
        with pytest.raises(ClipError, match="with inverse rotations"):
            with_grasp_warnings(clip, ONLY_INVERSE)


def turned_in_the_hand(clip: Clip) -> Clip:
    """A held thing that turns about its own middle, as fruit that is peeled does: its contact point wanders on it."""
    turn = se3.exp(np.linspace(0.0, 2 * np.pi, clip.frames)[:, None] * [1.0, 0.0, 0.0])
    return moved(clip, lambda item: replace(item, quats=se3.quat_multiply(item.quats, turn)))


def test_what_is_turned_in_the_hand_is_read_from_a_format_with_one_order(tmp_path, capsys):
    clip = turned_in_the_hand(make("carry_box"))
    with pytest.raises(ClipError, match="read wrongly"):
        with_grasp_warnings(clip)
    own_layout.write(clip, tmp_path / "clip.npz")
    assert main(["run", str(tmp_path / "clip.npz"), "--out", str(tmp_path / "out")]) == 1
    assert main(["run", str(tmp_path / "clip.npz"), "--grasps", "warn", *LANDMARK, "--out", str(tmp_path / "out")]) == 0
    path = humoto(clip).write(tmp_path / "turned.glb")
    assert not any("read wrongly" in str(it) for it in open_clip(path).source.warnings)
    capsys.readouterr()
    assert main(["convert", str(path), "--out", str(tmp_path / "converted.npz")]) == 0
    command = shlex.split(capsys.readouterr().out.splitlines()[-1].split(" run ")[1])
    assert open_clip(command[0], ReadOptions(grasps=command[command.index("--grasps") + 1])).frames == clip.frames


def test_contacts_found_in_these_frames_belong_to_no_others():
    """Only contacts that a source labels can be late."""
    late = shifted(make("carry_box"), 30)
    assert any("fit better" in str(it) for it in with_grasp_warnings(late).source.warnings)
    assert not any("fit better" in str(it) for it in with_grasp_warnings(late, shifts=()).source.warnings)


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("fault", UNITS)
def test_objects_in_other_units_are_refused(scene, fault):
    with pytest.raises(ClipError, match="another unit"):
        with_grasp_warnings(moved(make(scene), UNITS[fault]))


@pytest.mark.parametrize("scene", SCENES)
def test_inverse_poses_are_found(scene):
    assert grasp_faults(grasp_figures(moved(make(scene), inverse_pose)))


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("frames", [-30, 30])
def test_contacts_of_other_frames_are_noted(scene, frames):
    warnings = [str(warning) for warning in with_grasp_warnings(shifted(make(scene), frames)).source.warnings]
    assert any(words in warning for warning in warnings for words in ("fit better", "slips")), warnings


@pytest.mark.parametrize("frames", [4, 12, 31])
def test_clips_that_are_shorter_than_the_shifts_pass(frames):
    clip = make("carry_box", seconds=(frames - 1) / 30)
    always = tuple(
        replace(it, active=np.ones(frames, dtype=bool), contact_points=np.zeros((frames, 3))) for it in clip.contacts
    )
    figures = grasp_figures(replace(clip, contacts=always))
    assert figures.frames == (2 * frames if frames >= 10 else 0)
    assert not fatal_fault(figures)


def test_warnings_are_shown_where_clips_are_looked_at(tmp_path, capsys):
    own_layout.write(shifted(make("carry_box"), 30), tmp_path / "late.npz")
    own_layout.write(moved(make("carry_box"), ROTATIONS["inverse"]), tmp_path / "inverse.npz")
    assert any("earlier" in doubt for doubt in inspect(tmp_path / "late.npz").warnings)
    facts = inspect(tmp_path / "inverse.npz")
    assert "rotations are read wrongly" in facts.problems[0]
    assert not facts.command
    main(["run", str(tmp_path / "late.npz"), *LANDMARK, "--out", str(tmp_path / "out")])  # Its motion may be a bad one.
    assert "warning: late.npz: Contacts fit better" in capsys.readouterr().err


def test_clips_without_contacts_pass():
    clip = replace(make("carry_box"), contacts=())
    assert grasp_figures(clip).frames == 0
    assert with_grasp_warnings(clip) is clip


@pytest.mark.slow
@pytest.mark.skipif(not REAL, reason="no real recordings here")
def test_all_recordings_pass_and_planted_faults_do_not():
    found = dict.fromkeys((*ROTATIONS, *UNITS, "inverse pose", "late", "early"), 0)
    clips = [read_clip(path, ReadOptions(objects=objects)) for path, objects in REAL]
    for clip in clips:
        assert grasp_faults(grasp_figures(clip)) == (), clip.name
        for name, change in (ROTATIONS | UNITS).items():
            found[name] += bool(fatal_fault(grasp_figures(moved(clip, change))))
        found["inverse pose"] += bool(grasp_faults(grasp_figures(moved(clip, inverse_pose))))
        found["late"] += bool(grasp_faults(grasp_figures(shifted(clip, 30))))
        found["early"] += bool(grasp_faults(grasp_figures(shifted(clip, -30))))
    shares = {name: count / len(clips) for name, count in found.items()}
    # Where the object hardly turns, its rotations cannot be judged.
    least = {"inverse": 0.75, "scalar first": 0.9, "scalar last": 0.9, "late": 0.9, "early": 0.9}
    for name, share in shares.items():
        assert share >= least.get(name, 1.0), shares
