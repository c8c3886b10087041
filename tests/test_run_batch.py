"""The second stage of batches: performed motions, falls with their reasons, and what an interruption leaves."""

import json
from dataclasses import replace

import numpy as np
import pytest

from controller_files import read_controller_file
from hoi_retarget.batch.manifest import read_manifest
from hoi_retarget.batch.pool import LocalPool
from hoi_retarget.batch.run_batch import run_batch
from hoi_retarget.batch.specification import of_folder, read_specification
from hoi_retarget.batch.work import run_job
from hoi_retarget.cli import main
from hoi_retarget.dynamics.physics_scene import compiled
from hoi_retarget.dynamics.physics_settings import Refinement
from hoi_retarget.motion.result_file import load
from hoi_retarget.simulation import physics_stage
from hoi_retarget.simulation.refine import Refined
from hoi_retarget.simulation.rollout import TICK, Rollout, drive_targets, track
from hoi_retarget.studio.report.discover import find
from intermimic_writer import columns_of, write_box
from synthetic import make
from torch_writer import torch_bytes

FEW = Refinement(horizon=0.2, samples=8, most_samples=8, iterations=1, attempts=1)
TICKS = 12  # Of the shorter clip.
NAMES = ["unitree_g1/sub1_box_000", "unitree_g1/sub1_box_001"]
REFINED = [f"refined/{name}" for name in NAMES]


class Inline(LocalPool):
    """A pool in this process, which stops after some tasks."""

    def __init__(self, tasks=100):
        super().__init__(run_job, 1, 60.0)
        self.left = tasks

    def run(self, tasks, stopped):
        for index, task in enumerate(tasks):
            if stopped():
                return
            self.left -= 1
            yield index, run_job(task)

    def stopped(self):
        return self.left == 0


@pytest.fixture(scope="module")
def clips(tmp_path_factory):
    """Two clips of a moment."""
    folder = tmp_path_factory.mktemp("clips")
    columns = columns_of(make("carry_box"))
    write_box(folder / "objects", "box")
    (folder / "sub1_box_000.pt").write_bytes(torch_bytes(columns[:8]))
    (folder / "sub1_box_001.pt").write_bytes(torch_bytes(columns[60:71]))
    return folder


@pytest.fixture(scope="module")
def specification(clips):
    return replace(of_folder(clips, refine=True), refinement=FEW)


def quickly(scene, reference, settings, *, seed, on_progress):
    """Perform the first clip without a plan, and fall in the second, which is longer."""
    targets, gains = drive_targets(scene, reference) + 1e-6 * seed, np.zeros((1, scene.model.n, 1))
    rollout = track(compiled(scene), reference, targets)
    if len(reference.qpos) > TICKS:
        rollout = Rollout(rollout.qpos[:5], rollout.qvel[:5], rollout.targets[:5], 5 * TICK)
    return Refined(rollout, np.repeat(gains, len(rollout.qpos), axis=0).repeat(2 * compiled(scene).nv, axis=2), 0)


@pytest.fixture(scope="module")
def done(specification, tmp_path_factory):
    """A batch in one go."""
    out = tmp_path_factory.mktemp("one")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(physics_stage, "refine", quickly)
        yield out, run_batch(specification, out, Inline())


@pytest.mark.slow
def test_a_robot_that_is_simulated_performs_them(specification, tmp_path):
    summary = run_batch(specification, tmp_path, Inline())
    stands = summary.entries[2]
    assert stands.succeeded and "of 7 replays" in stands.certificate
    assert load(tmp_path / stands.results[0].path).stages[-1].name == "physics"
    assert read_controller_file(tmp_path / next(iter(stands.results[0].companions)))[3]["fell_after"] is None


def files(out):
    return {path.relative_to(out).as_posix(): path for path in sorted(out.rglob("*.npz*"))}


def told(out):
    return {name: replace(entry, seconds=0.0) for name, entry in read_manifest(out).items()}


def test_every_result_is_refined_in_a_job_of_its_own(done):
    out, summary = done
    stands, falls = (summary.entries[names] for names in (2, 3))
    assert [entry.name for entry in summary.entries] == [*NAMES, *REFINED] and summary.jobs == 4
    assert all(entry.succeeded for entry in summary.entries[:2])
    assert stands.succeeded and stands.fell_after is None and "of 7 replays" in stands.certificate
    (result,) = stands.results
    assert list(result.companions) == ["refined/unitree_g1/physics/sub1_box_000.npz"]
    beside = ["refined/unitree_g1/physics/sub1_box_001.npz", f"{REFINED[1]}.npz.failed"]
    assert set(files(out)) == {result.path, *result.companions, *beside, *(f"{name}.npz" for name in NAMES)}
    assert result.figures["contact_gap_m"] == load(out / result.path).report.figures["contact_gap_m"]
    assert (falls.status, falls.error, falls.results) == ("failed", "Fall", ())
    assert falls.fell_after == 5 * TICK and falls.frame == load(out / f"{REFINED[1]}.npz.failed").frames
    assert f"falls after {falls.fell_after:.1f} s, in frame {falls.frame}: " in falls.reason


def test_nothing_is_done_twice_and_other_settings_refine_again(done, specification):
    out, _ = done
    told_before = told(out)
    assert run_batch(specification, out, Inline()).done_now == () and told(out) == told_before
    for name in ("refined/unitree_g1/physics/sub1_box_000.npz", f"{REFINED[0]}.npz"):
        content = (out / name).read_bytes()
        (out / name).unlink()
        assert [entry.name for entry in run_batch(specification, out, Inline()).done_now] == [REFINED[0]]
        if "physics/" in name:
            assert (out / name).read_bytes() == content
    again = run_batch(replace(specification, seed=1), out, Inline())
    assert [entry.name for entry in again.done_now] == REFINED
    run_batch(specification, out, Inline())


@pytest.mark.slow
@pytest.mark.parametrize("tasks", [1, 3])
def test_stopped_and_resumed_it_is_what_it_is_in_one_go(done, specification, tmp_path, tasks):
    out, _ = done
    pool = Inline(tasks)
    summary = run_batch(specification, tmp_path, pool, stopped=pool.stopped)
    assert len(summary.done_now) == tasks and not summary.is_complete
    assert run_batch(specification, tmp_path, Inline()).is_complete
    assert files(tmp_path).keys() == files(out).keys()
    one, two = told(out), told(tmp_path)
    assert one.keys() == two.keys()
    for name in one:
        assert (one[name].status, one[name].reason, one[name].key) == (
            two[name].status,
            two[name].reason,
            two[name].key,
        )


def test_the_command_tells_of_falls_and_a_report_leaves_files_for_controllers_out(done, clips, specification, capsys):
    out, _ = done
    motions, _ = find([out])
    assert sorted(motions) == [f"{name}.npz" for name in (REFINED[0], *NAMES)]
    table = "[refinement]\nhorizon = 0.2\nsamples = 8\nmost_samples = 8\niterations = 1\nattempts = 1\n"
    file = clips.parent / "set.toml"
    file.write_text(f'clips = ["{clips}"]\nobjects = "{clips}/objects"\nrefine = true\n{table}')
    assert read_specification(file).refinement == FEW
    assert main(["batch", str(file), "--out", str(out), "--workers", "1"]) == 1
    said = capsys.readouterr()
    assert "2 jobs, 2 of them done before." in said.out and "2 results to refine, 2 of them done before." in said.out
    assert "failed by Fall" in said.out
    assert main(["batch", str(file), "--out", str(out), "--refine"]) == 2
    assert "refine = true" in capsys.readouterr().err
    lines = [json.loads(line) for line in (out / "manifest.jsonl").read_text().splitlines()]
    assert [line["name"] for line in lines] == [*NAMES, *REFINED]
