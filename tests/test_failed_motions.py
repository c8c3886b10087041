"""Motions with faults: set aside and told, never under a result's name, whoever asked for them."""

from dataclasses import replace

import pytest

from hoi_retarget.batch.manifest import read_manifest
from hoi_retarget.cli import main
from hoi_retarget.clip.quality_warning import Severity
from hoi_retarget.errors import SolveError
from hoi_retarget.evaluation.thresholds import Level, verdict_of
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.report import Optimality, Status, TrunkTurn, Window
from hoi_retarget.motion.result_file import load, set_aside
from hoi_retarget.report.batches import read_manifests
from hoi_retarget.retargeting.multi_person import with_report, write
from test_curves import carried

UNSOLVED = Window(0, 9, Status.STALLED, 3, 1.0, {}, Optimality(1.0, 1.0, 0.0))
AT_THE_LIMIT = replace(UNSOLVED, status=Status.MAX_ITERATIONS)
UNFINISHED = ("--solver.max-iterations", "1")
BATCH = """
robots = ["unitree_g1"]
clips = ["builtin:carry_box"]
[config]
contact = "landmark"
[config.solver]
max_iterations = {}
"""


def faulty(kind: str) -> Motion:
    motion = carried()
    if kind == "turned over":
        return with_report(motion, trunk_turns=(TrunkTurn(3, 5, 107.0),))
    return ended_with(motion, UNSOLVED)


def ended_with(motion: Motion, window: Window, stage: str = "trajectory") -> Motion:
    """Return a motion with a stage that ended with this window."""
    stages = (replace(item, windows=(window,)) if item.name == stage else item for item in motion.stages)
    return replace(motion, stages=tuple(stages))


def asked_for(contact: str, motion: Motion) -> Motion:
    return with_report(motion, config={**motion.report.config, "contact": contact})


@pytest.mark.parametrize(("kind", "reason"), [("turned over", "107 degrees"), ("unsolved", "no step decreased")])
def test_one_fault_sets_all_motions_of_a_clip_aside(tmp_path, kind, reason):
    paths = [tmp_path / "pair.p0.npz", tmp_path / "pair.p1.npz"]
    with pytest.raises(SolveError, match=reason):
        write([carried(), faulty(kind)], paths)
    assert sorted(tmp_path.iterdir()) == [set_aside(path) for path in paths]
    assert load(set_aside(paths[1])).faults == faulty(kind).faults
    write([carried(), carried()], paths)
    assert sorted(tmp_path.iterdir()) == paths, "a later success takes away what was set aside"


def test_a_trajectory_on_surfaces_that_stops_at_the_limit_is_kept_with_a_warning(tmp_path):
    kept = ended_with(carried(), AT_THE_LIMIT)
    path = tmp_path / "kept.npz"
    write([kept], [path])
    assert sorted(tmp_path.iterdir()) == [path]
    (warning,) = load(path).warnings
    assert (warning.code, warning.severity) == ("not_converged", Severity.WARNING)
    assert "frames 0 to 8: stopped at the iteration limit" in warning.text
    verdict = verdict_of(load(path))
    assert verdict.level is Level.WARN
    assert "unsolved_share" in [reason.threshold.name for reason in verdict.reasons]


@pytest.mark.parametrize(
    ("contact", "stage", "window"),
    [
        ("landmark", "trajectory", AT_THE_LIMIT),
        ("surface", "ik", AT_THE_LIMIT),
        ("surface", "trajectory", UNSOLVED),
        ("surface", "trajectory", replace(UNSOLVED, status=Status.FAILED)),
    ],
)
def test_any_other_unsolved_window_is_a_fault(contact, stage, window):
    assert asked_for(contact, carried()).faults == ()
    assert [fault.code for fault in ended_with(asked_for(contact, carried()), window, stage).faults] == [
        "not_converged"
    ]


def test_run_fails_a_motion_at_landmarks_that_did_not_converge(tmp_path, capsys):
    command = ["run", "builtin:carry_box", "--robot", "unitree_g1", "--contact", "landmark", "--out", str(tmp_path)]
    assert main([*command, *UNFINISHED]) == 1
    told = capsys.readouterr()
    assert "stopped at the iteration limit" in told.err and "0 solved, 1 failed" in told.out
    assert [path.name for path in tmp_path.iterdir()] == ["carry_box.npz.failed"]
    assert main(["evaluate", str(tmp_path / "carry_box.npz.failed")]) == 0, "to look at"
    assert main(command) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["carry_box.npz"]
    assert load(tmp_path / "carry_box.npz").faults == ()


@pytest.mark.slow
def test_batch_marks_it_failed_and_resumes_without_it(tmp_path, capsys):
    specification, out = tmp_path / "set.toml", tmp_path / "out"
    specification.write_text(BATCH.format(1))
    for done in ("1 jobs done", "0 jobs done"):
        assert main(["batch", str(specification), "--out", str(out), "--workers", "1"]) == 1
        assert done in capsys.readouterr().out
        (entry,) = read_manifest(out).values()
        assert (entry.status, entry.error, entry.results) == ("failed", "SolveError", ())
        assert "stopped at the iteration limit" in entry.reason and entry.frame == 0
        assert str(tmp_path) not in entry.reason
        (row,) = read_manifests([out / "manifest.jsonl"])[1]
        assert row.error == f"failed: {entry.reason}"
    specification.write_text(BATCH.format(200))
    assert main(["batch", str(specification), "--out", str(out), "--workers", "1"]) == 0
    assert not list(out.rglob("*.failed")) and len(list(out.rglob("*.npz"))) == 1
