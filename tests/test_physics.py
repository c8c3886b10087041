"""`hoi-retarget refine`: what is written, what is told, and what is refused."""

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hoi_retarget.cli import main
from hoi_retarget.dynamics.physics_settings import Physics, Refinement
from hoi_retarget.motion import result_file
from hoi_retarget.motion.motion import ARRAYS, Stage
from hoi_retarget.readers.open import clip_of
from hoi_retarget.simulation import physics_stage
from hoi_retarget.simulation.object_hold import ObjectHold
from hoi_retarget.simulation.refine import refine
from hoi_retarget.simulation.rollout import TICK, Rollout
from plain_motions import plain_motion, standing_qpos
from synthetic import make
from trajectories import MODELS

G1 = MODELS["unitree_g1"]
QUICK = ("--refinement.samples", "8", "--refinement.most-samples", "8", "--refinement.iterations", "1")
QUICK += ("--refinement.horizon", "0.4", "--refinement.attempts", "1")


def alone(frames, glide=0.0):
    """A robot without objects that stands, or glides away on feet that stand."""
    qpos = standing_qpos(G1, frames)
    qpos[:, 0] += glide * np.linspace(0.0, 1.0, frames) ** 2
    return plain_motion(G1, qpos, object_names=())


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_what_is_performed_goes_out_beside_what_a_controller_needs(folder, capsys):
    motion = alone(31)
    result_file.save(motion, folder / "stands.npz")
    assert main(["refine", "stands.npz", "--out", "out", "--seed", "3", *QUICK]) == 0
    said = capsys.readouterr().out
    assert (
        "1 performed whole, 0 lost, 0 fell, 0 failed." in said
        and "certificate: 5 of 5 replays keep to the motion" in said
    )
    performed = result_file.load(folder / "out" / "stands.npz")
    assert [stage.name for stage in performed.stages] == ["trajectory", "physics"]
    assert performed.stages[0].qpos.tobytes() == motion.qpos.tobytes()
    assert 0.0 < np.abs(performed.qpos - motion.qpos).max() < 0.05
    assert "physics" in performed.report.cpu_seconds
    with np.load(folder / "out" / "physics" / "stands.npz") as held:
        facts = json.loads(str(held["facts"]))
        ticks = len(held["qpos"])
        assert (facts["seed"], facts["fell_after"], facts["certificate"]["repeats"]) == (3, None, True)
        assert held["gains"].shape == (ticks, G1.n, 2 * (6 + G1.n)) and len(held["targets"]) == ticks
        weight = 9.81 * G1.inertias.masses.sum()
        standing = held["contact_forces"].sum(axis=1)[ticks // 2 :].mean(axis=0)
        np.testing.assert_allclose(standing, [0.0, 0.0, weight], atol=0.02 * weight)
        # Frames of the motion that are at ticks are the ticks.
        np.testing.assert_allclose(performed.qpos[::3], held["qpos"][::5], atol=1e-9)


@pytest.mark.parametrize(
    ("falls", "seeds", "kept"), [((), [3], 3), ((3,), [3, 4], 4), ((3, 4, 5), [3, 4, 5], 4)], ids=["1", "2", "3"]
)
def test_it_is_tried_again_until_nothing_falls_and_the_longest_is_kept(falls, seeds, kept, folder, monkeypatch):
    """The second of three attempts stands for longest here where all fall."""
    tried = []

    def falling(scene, reference, settings, *, seed, on_progress):
        found = refine(scene, reference, settings, seed=seed, on_progress=on_progress)
        tried.append(seed)
        ticks = 30 if seed == 4 else 20
        cut = Rollout(*(part[:ticks] for part in (found.rollout.qpos, found.rollout.qvel, found.rollout.targets)), 0.0)
        ended = replace(cut, fell_after=TICK * ticks)
        return replace(found, rollout=ended, gains=found.gains[:ticks], lead_out=None) if seed in falls else found

    monkeypatch.setattr(physics_stage, "refine", falling)
    settings = Refinement(horizon=0.4, samples=8, most_samples=8, iterations=1, attempts=3)
    simulated = physics_stage.add_physics_stage(alone(31), None, Physics(), settings, seed=3)
    assert tried == seeds and simulated.performance.whole == (kept not in falls)
    with np.load(io.BytesIO(simulated.for_controllers)) as held:
        assert json.loads(str(held["facts"]))["seed"] == kept


@pytest.mark.parametrize(
    ("shares", "seeds", "kept"), [((0.99,), [3], 3), ((0.8, 0.97), [3, 4], 4), ((0.9, 0.8, 0.7), [3, 4, 5], 3)]
)
def test_it_is_tried_again_until_objects_are_held_strictly(shares, seeds, kept, folder, monkeypatch):
    tried = []

    def standing(scene, reference, settings, *, seed, on_progress):
        tried.append(seed)
        return refine(scene, reference, settings, seed=seed, on_progress=on_progress)

    def holds(*_):
        return (ObjectHold(0, shares[len(tried) - 1], 0.01, 1.0, None),)

    monkeypatch.setattr(physics_stage, "refine", standing)
    monkeypatch.setattr(physics_stage, "object_holds", holds)
    settings = Refinement(horizon=0.4, samples=8, most_samples=8, iterations=1, attempts=3)
    simulated = physics_stage.add_physics_stage(alone(31), None, Physics(), settings, seed=3)
    assert tried == seeds
    with np.load(io.BytesIO(simulated.for_controllers)) as held:
        assert json.loads(str(held["facts"]))["seed"] == kept


@pytest.mark.slow
def test_the_same_seed_has_the_same_files(folder):
    result_file.save(alone(31, glide=0.3), folder / "glides.npz")
    for out in ("one", "two"):
        assert main(["refine", "glides.npz", "--out", out, *QUICK]) in (0, 1)
    one, two = (
        {path.relative_to(folder / out): path for path in sorted((folder / out).rglob("*.npz*"))}
        for out in ("one", "two")
    )
    assert one.keys() == two.keys() and len(one) == 2
    for name in one:
        with np.load(one[name]) as first, np.load(two[name]) as second:
            assert all(first[key].tobytes() == second[key].tobytes() for key in first.files if key != "report")


def test_what_falls_is_kept_to_the_fall_in_place_of_what_stood(folder, capsys):
    motion = alone(46, glide=5.0)
    result_file.save(motion, folder / "glides.npz")
    (folder / "refined").mkdir()
    (folder / "refined" / "glides.npz").write_bytes(b"of an earlier refinement")
    assert main(["refine", "glides.npz", *QUICK]) == 1
    said = capsys.readouterr()
    assert "0 performed whole, 0 lost, 1 fell, 0 failed." in said.out and "certificate: none, as" in said.out
    assert "of 46: " in said.err
    assert not (folder / "refined" / "glides.npz").exists()
    performed = result_file.load(folder / "refined" / "glides.npz.failed")
    assert 1 < performed.frames < motion.frames
    names = {"reference_root_m", "reference_root_deg", "reference_joint_rad", "stood_s"}
    assert set(performed.report.figures) == names  # What needs a whole motion is not there.
    assert performed.report.figures["stood_s"] == performed.report.performance.seconds
    for name in set(ARRAYS) - {"object_scale"}:
        assert len(getattr(performed, name)) == performed.frames
    with np.load(folder / "refined" / "physics" / "glides.npz") as held:
        facts = json.loads(str(held["facts"]))
        assert 0.0 < facts["fell_after"] < 1.5 and facts["certificate"] is None and "the robot lacks" in facts["cause"]


@pytest.mark.slow
def test_a_fall_is_looked_at_beside_its_clip(folder, capsys):
    clip = make("carry_box")
    motion = plain_motion(
        G1,
        alone(clip.frames, glide=60.0).qpos,
        object_pos=np.stack([track.positions for track in clip.objects], axis=1),
        object_quat=np.stack([track.quats for track in clip.objects], axis=1),
    )
    result_file.save(motion, folder / "glides.npz")
    assert main(["refine", "glides.npz", "--clip", "builtin:carry_box", "--out", "out", *QUICK]) == 1
    fallen = result_file.load(folder / "out" / "glides.npz.failed")
    there = clip_of(fallen, name=Path("builtin:carry_box"))
    assert there.frames == fallen.frames < clip.frames
    for short, whole in zip(there.objects, clip.objects, strict=True):
        np.testing.assert_allclose(short.positions, whole.positions[: there.frames], atol=1e-12)
    assert clip_of(motion, name=Path("builtin:carry_box")).frames == clip.frames


def test_what_cannot_be_refined_is_refused_and_nothing_is_written(folder, capsys):
    motion = alone(10)
    refined = replace(motion, stages=(*motion.stages, Stage("physics", motion.qpos)))
    result_file.save(refined, folder / "refined.npz")
    result_file.save(alone(1), folder / "one.npz")
    assert main(["refine", "refined.npz", "one.npz", "none.npz", "--out", "out", *QUICK]) == 1
    said = capsys.readouterr().err
    assert "it is refined already" in said and "no motion" in said and "none.npz" in said
    assert not (folder / "out").exists()
    result_file.save(motion, folder / "plain.npz")
    assert main(["refine", "plain.npz", "--out", ".", *QUICK]) == 2
    assert "which was read" in capsys.readouterr().err
    assert main(["refine", "plain.npz", "--refinement.samples", "2"]) == 2
    assert "samples must be 8 or more" in " ".join(capsys.readouterr().err.split())
