"""From a reconstruction with errors of known size to a robot: what fixing contacts recovers, and what it does not."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import cari4d_writer as writer
from hoi_retarget.cli import main
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits import ContactEdits, FixAll, Move, SnapAll, apply, load, segments_of
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, PARENT
from hoi_retarget.motion.result_file import load as load_motion
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.readers.open import open_clip
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from source_people import write_models
from synthetic import make
from trajectories import MODELS
from video_noise import Noise, reconstructed

BOX, TABLE = make("carry_box"), make("push_table")
G1 = MODELS["unitree_g1"]
CENTIMETRE = 0.01
DRIFT = 0.10
"""[m]"""


@pytest.fixture(scope="module")
def models(tmp_path_factory) -> Path:
    return write_models(tmp_path_factory.mktemp("models"), BOX.people, "smplh", ["male"])


@pytest.fixture(scope="module")
def meshes(tmp_path_factory) -> Path:
    return writer.write_mesh(tmp_path_factory.mktemp("meshes"), BOX)


def edited(clip: Clip, *edits) -> Clip:
    asked = ContactEdits.of(clip)
    for edit in edits:
        asked = asked.adding(edit)
    return apply(clip, asked)


def errors(clip: Clip, truth: Clip) -> np.ndarray:
    """How far the contact points of all frames are from the true ones [m]."""
    pairs = zip(segments_of(clip), segments_of(truth), strict=True)
    return np.concatenate([np.linalg.norm(own.points - true.points, axis=1) for own, true in pairs])


def place_errors(clip: Clip, truth: Clip) -> np.ndarray:
    """The same on the surface: between the points of it that are nearest [m]."""
    found = []
    for own, true in zip(segments_of(clip), segments_of(truth), strict=True):
        surface = surface_of(truth.objects[own.object].geometry)
        found.append(np.linalg.norm(surface.closest_points(own.points) - surface.closest_points(true.points), axis=1))
    return np.concatenate(found)


# What is planted


def bones_of(clip: Clip) -> np.ndarray:
    person = clip.people[0]
    children = [JOINT_INDEX[joint] for joint in JOINTS if PARENT[joint] is not None]
    parents = [JOINT_INDEX[str(PARENT[joint])] for joint in JOINTS if PARENT[joint] is not None]
    bones = person.joint_positions[:, children] - person.joint_positions[:, parents]
    return se3.rotate_inverse(person.joint_quats[:, parents], bones)


def test_without_errors_the_clip_is_the_same_and_every_seed_is_another_one():
    same = reconstructed(BOX, Noise())
    np.testing.assert_allclose(same.people[0].joint_positions, BOX.people[0].joint_positions, atol=1e-12)
    assert errors(same, BOX).max() < 1e-9
    noise = Noise(jitter=0.01, alternation=0.03, drift=(0.0, DRIFT, 0.0))
    one, again, other = (reconstructed(BOX, noise, seed=seed).people[0].joint_positions for seed in (1, 1, 2))
    assert np.array_equal(one, again)
    assert not np.allclose(one, other)


def test_errors_have_their_sizes_and_bones_stay_rigid():
    clip = reconstructed(BOX, Noise(jitter=0.01, alternation=0.03, drift=(0.0, DRIFT, 0.0)))
    np.testing.assert_allclose(bones_of(clip), bones_of(BOX), atol=1e-9)
    assert all(np.array_equal(own.active, true.active) for own, true in zip(clip.contacts, BOX.contacts, strict=True))
    trembling = reconstructed(BOX, Noise(jitter=0.01))
    for own, true in (
        (trembling.people[0].position("left_wrist"), BOX.people[0].position("left_wrist")),
        (trembling.people[0].position("right_wrist"), BOX.people[0].position("right_wrist")),
    ):
        assert (own - true).std(axis=0) == pytest.approx(np.full(3, 0.01), rel=0.35)
    wandering = reconstructed(BOX, Noise(drift=(0.0, DRIFT, 0.0)))
    moved = wandering.people[0].joint_positions - BOX.people[0].joint_positions
    np.testing.assert_allclose(moved[[0, -1], 0], [[0.0, 0.0, 0.0], [0.0, DRIFT, 0.0]], atol=1e-12)
    assert np.ptp(moved, axis=1).max() < 1e-12


def test_hands_alternate_between_sinking_in_and_coming_off():
    clip = reconstructed(BOX, Noise(alternation=0.03))
    for own, true in zip(segments_of(clip), segments_of(BOX), strict=True):
        outward = true.points / np.linalg.norm(true.points, axis=1, keepdims=True)
        out = np.einsum("ni,ni->n", own.points - true.points, outward)
        assert (np.sign(out[1:]) == -np.sign(out[:-1])).all()
        assert np.abs(out).min() > 0.025
        surface = surface_of(BOX.objects[0].geometry)
        # The palm's middle is 25 mm off in truth: now it is inside, now well off.
        inside = np.abs(own.points[:, 1]) < np.abs(surface.vertices[:, 1]).max()
        assert inside.mean() == pytest.approx(0.5, abs=0.01)
        assert surface.distances(own.points[~inside]).min() > 0.045


# From CARI4D's file to the true places


RECOVERED = {
    "jitter": Noise(jitter=0.01),
    "alternation": Noise(alternation=0.03),
    "both": Noise(jitter=0.01, alternation=0.03),
}


@pytest.mark.parametrize("name", RECOVERED)
def test_fixed_segments_are_within_a_centimetre_of_the_true_places(tmp_path, models, meshes, name):
    noisy = reconstructed(BOX, RECOVERED[name], seed=5)
    path = writer.write(tmp_path / f"{writer.VIDEO}.pth", writer.prediction(noisy))
    clip = open_clip(path, ReadOptions(objects=meshes, body_models=models))
    # Read as written, errors included.
    assert np.abs(errors(clip, BOX) - errors(noisy, BOX)).max() < 1e-6
    assert errors(clip, BOX).mean() > 1.5 * CENTIMETRE
    where = ["--objects", str(meshes), "--body-models", str(models)]
    words = ["contacts", str(path), *where, "--fix-segments", "all", "--out", str(tmp_path / "edits.toml")]
    assert main(words) == 0
    fixed = apply(clip, load(tmp_path / "edits.toml"))
    assert errors(fixed, BOX).max() < CENTIMETRE
    assert max(segment.spread for segment in segments_of(fixed)) < 1e-12


def test_the_command_line_goes_from_the_file_to_the_motion(tmp_path, models, meshes, capsys):
    noisy = reconstructed(BOX, Noise(jitter=0.01, alternation=0.03), seed=2)
    path = writer.write(tmp_path / f"{writer.VIDEO}.pth", writer.prediction(noisy))
    where = ["--objects", str(meshes), "--body-models", str(models)]
    edits, out = tmp_path / "edits.toml", tmp_path / "out"
    assert main(["contacts", str(path), *where, "--fix-segments", "all", "--out", str(edits)]) == 0
    assert main(["run", str(path), *where, "--contact", "landmark", "--edits", str(edits), "--out", str(out)]) == 0
    assert "1 solved" in capsys.readouterr().out
    report = load_motion(out / f"{writer.VIDEO}.npz").report
    assert report.source.format == "cari4d"
    assert report.unreached_contacts == ()
    assert report.figures["contact_gap_m"] < CENTIMETRE


# What drift leaves


def drifting(clip: Clip, drift: tuple[float, float, float]) -> Clip:
    return reconstructed(clip, Noise(drift=drift))


@pytest.mark.parametrize("drift", [(0.0, 0.0, DRIFT), (0.0, DRIFT, 0.0)])
def test_the_mean_keeps_half_of_a_drift(drift):
    """Segments are in the middle of the clip: the body has gone half of its way."""
    fixed = edited(drifting(TABLE, drift), FixAll())
    assert errors(fixed, TABLE) == pytest.approx(np.full(len(errors(fixed, TABLE)), 0.5 * DRIFT), rel=0.05)


def test_snapping_recovers_what_is_off_the_surface_and_nothing_along_it():
    """The table's hands lie on its top."""
    off = edited(drifting(TABLE, (0.0, 0.0, DRIFT)), FixAll(), SnapAll())
    assert place_errors(off, TABLE).max() < 1e-6
    along = edited(drifting(TABLE, (0.0, DRIFT, 0.0)), FixAll(), SnapAll())
    assert place_errors(along, TABLE).min() > 0.04
    # A thin plate: what sank in farther than its middle comes out below.
    into = edited(drifting(TABLE, (0.0, 0.0, -DRIFT)), FixAll(), SnapAll())
    assert place_errors(into, TABLE).min() > 0.02


def test_moving_by_what_is_seen_recovers_the_rest():
    """A segment moved back by hand, as exactly as a centimetre in the picture."""
    clip = drifting(TABLE, (0.0, DRIFT, 0.0))
    fixed = edited(clip, FixAll())
    seen = (0.01, -0.045, 0.0)  # Half of the drift, a centimetre wrong along the table's length.
    moves = [Move(segment.part, segment.start, offset=seen) for segment in segments_of(fixed)]
    assert errors(edited(clip, FixAll(), *moves), TABLE).max() < 1.3 * CENTIMETRE


def test_a_drift_shows_as_the_spread_of_a_contact():
    for clip, expected in ((drifting(TABLE, (0.0, DRIFT, 0.0)), 0.03), (TABLE, 0.0)):
        for segment in segments_of(clip):
            assert segment.spread == pytest.approx(expected, abs=0.003)


# What the robot does with it


def hand_motion(clip: Clip) -> dict[str, float]:
    """Mean speed of the palms on what they touch [m/s], and figures of the report."""
    motion = retarget(clip, G1, Config(contact="landmark"))
    kinematics, speeds = G1.forward(motion.qpos), []
    for segment in segments_of(clip):
        frames = slice(segment.start, segment.stop)
        palm = kinematics.site_position(G1.spec.part_sites[segment.part])[frames]
        points = se3.rotate_inverse(motion.object_quat[frames, 0], palm - motion.object_pos[frames, 0])
        speeds.append(np.linalg.norm(np.diff(points, axis=0), axis=1) * clip.fps)
    figures = motion.report.figures
    return {
        "slip": float(np.concatenate(speeds).mean()),
        "gap": figures["contact_gap_m"],
        "jerk": figures["body_jerk_mps3"],
        "unreached": float(len(motion.report.unreached_contacts)),
    }


@pytest.mark.slow
def test_alternating_contacts_are_not_reached_and_fixed_ones_are_as_without_errors():
    noisy = reconstructed(BOX, Noise(alternation=0.03))
    clean, before, after = hand_motion(BOX), hand_motion(noisy), hand_motion(edited(noisy, FixAll()))
    assert before["gap"] > 0.02
    assert before["unreached"] > 0
    assert before["slip"] > 2.0 * clean["slip"]
    assert after["unreached"] == 0
    for key in ("slip", "gap", "jerk"):
        assert after[key] == pytest.approx(clean[key], rel=0.05)


@pytest.mark.slow
def test_trembling_contacts_shake_the_robot_and_fixed_ones_do_so_less():
    noisy = reconstructed(BOX, Noise(jitter=0.01, alternation=0.03, drift=(0.0, DRIFT, 0.0)))
    before, after = hand_motion(noisy), hand_motion(edited(noisy, FixAll()))
    assert before["unreached"] > 0
    assert after["unreached"] == 0
    assert after["jerk"] < 0.5 * before["jerk"]
    assert after["gap"] < 0.3 * before["gap"]
    assert after["slip"] < 0.8 * before["slip"]


@pytest.mark.slow
def test_the_benchmark_runs():
    script = Path(__file__).parents[1] / "benchmarks" / "video.py"
    words = [sys.executable, str(script), "--seeds", "1"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert "drift, along the surface" in done.stdout
