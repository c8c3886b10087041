"""Fatal motions: set aside and told, never under a result's name, whoever asked for them."""

import shutil
from dataclasses import replace

import pytest

from hoi_retarget.batch.manifest import read_manifest
from hoi_retarget.cli import main
from hoi_retarget.clip.clip import Severity
from hoi_retarget.errors import SolveError
from hoi_retarget.evaluation.thresholds import Level, verdict_of
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.motion_report import Event, Optimality, Status, Window
from hoi_retarget.motion.result_file import load, set_aside
from hoi_retarget.retargeting.retarget import write
from hoi_retarget.studio.report.discover import read_manifests
from test_curves import carried

OPTIMALITY = Optimality(1.0, 1.0, 0.0)
UNFINISHED = ("--solver.max-iterations", "1")
BATCH = """
robots = ["unitree_g1"]
clips = ["builtin:carry_box"]
[config]
contact = "landmark"
[config.solver]
max_iterations = {}
"""


def ended_with(status: Status, share: float = 1.0, stage: str = "trajectory") -> Motion:
    """Return a motion, a stage of which ended so in a share of its frames, and was solved in the others."""
    motion = carried()
    cut = round(share * motion.frames)
    windows = (
        Window(0, cut, status, 3, 1.0, {}, OPTIMALITY),
        Window(cut, motion.frames, Status.SOLVED, 3, 1.0, {}, OPTIMALITY),
    )
    windows = windows[: 1 if cut == motion.frames else 2]
    stages = (replace(item, windows=windows) if item.name == stage else item for item in motion.stages)
    return replace(motion, stages=tuple(stages))


def turned(degrees: float) -> Motion:
    return carried().with_report(trunk_turns=(Event("trunk_turn", 3, 5, degrees),))


def flipped(frames: int) -> Motion:
    return carried().with_report(orientation_flips=(Event("orientation_flip", 3, 2 + frames, 120.0, subject="head"),))


FATAL = {
    "turned over": (lambda: turned(107.0), "107 degrees"),
    "flipped": (lambda: flipped(9), "120 degrees"),
    "stalled": (lambda: ended_with(Status.STALLED), "no step decreased"),
    "at the limit": (lambda: ended_with(Status.MAX_ITERATIONS), "stopped at the iteration limit"),
    "mostly unsolved": (lambda: ended_with(Status.STALLED, 0.6), "unsolved frames"),
    "inverse kinematics": (lambda: ended_with(Status.MAX_ITERATIONS, stage="ik"), "inverse kinematics"),
}


@pytest.mark.parametrize("contact", ["surface", "landmark"])
@pytest.mark.parametrize("kind", FATAL)
def test_one_fatal_motion_sets_all_of_a_clip_aside_and_nothing_stale_stays(tmp_path, kind, contact):
    make_motion, reason = FATAL[kind]
    motion = make_motion()
    motion = motion.with_report(config={**motion.report.config, "contact": contact})
    paths = [tmp_path / "pair.p0.npz", tmp_path / "pair.p1.npz"]
    assert verdict_of(motion).level is Level.FAIL
    for path in paths:
        path.write_bytes(b"of an earlier run")
    with pytest.raises(SolveError, match=reason):
        write([carried(), motion], paths)
    assert sorted(tmp_path.iterdir()) == [set_aside(path) for path in paths]
    assert verdict_of(load(set_aside(paths[1]))).fatal == verdict_of(motion).fatal
    write([carried(), carried()], paths)
    assert sorted(tmp_path.iterdir()) == paths, "a later success takes away what was set aside"


@pytest.mark.parametrize("kind", ["partly stalled", "flipped for a moment", "touching nothing"])
def test_what_is_bad_and_not_fatal_is_a_result(tmp_path, kind):
    path = tmp_path / "kept.npz"
    nothing = {**carried().report.figures, "touch_share": 0.0}
    bad = {"partly stalled": ended_with(Status.STALLED, 0.4), "flipped for a moment": flipped(3)}
    write([bad.get(kind, carried().with_report(figures=nothing))], [path])
    assert sorted(tmp_path.iterdir()) == [path]
    verdict = verdict_of(load(path))
    assert verdict.level is not Level.PASS and not verdict.fatal
    assert {warning.severity for warning in load(path).warnings} <= {Severity.WARNING}


def test_a_solve_without_a_motion_takes_the_earlier_result_away(tmp_path, monkeypatch):
    def no_motion(*_: object, **__: object) -> None:
        raise SolveError("frames 0 to 9: nothing is kept.")

    monkeypatch.setattr("hoi_retarget.cli.run.retarget_people", no_motion)
    (tmp_path / "carry_box.npz").write_bytes(b"of an earlier run")
    assert main(["run", "builtin:carry_box", "--out", str(tmp_path)]) == 1
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "missing.npz").write_bytes(b"of an earlier run")
    assert main(["run", str(tmp_path / "missing.pt"), "--out", str(tmp_path)]) != 0
    assert (tmp_path / "missing.npz").exists(), "nothing was solved"


def test_run_fails_a_motion_at_landmarks_that_did_not_converge(tmp_path, capsys):
    command = ["run", "builtin:carry_box", "--robot", "unitree_g1", "--contact", "landmark", "--out", str(tmp_path)]
    assert main([*command, *UNFINISHED]) == 1
    told = capsys.readouterr()
    assert "stopped at the iteration limit" in told.err and "0 solved, 1 failed" in told.out
    assert "fatal: unsolved frames 100 %, above 50" in told.out and "contact gap [mm]" in told.out
    assert [path.name for path in tmp_path.iterdir()] == ["carry_box.npz.failed"]
    assert main(["evaluate", str(tmp_path / "carry_box.npz.failed")]) == 0, "to look at"
    report = ["report", str(tmp_path / "carry_box.npz.failed"), "--out", str(tmp_path / "report"), "--pages", "0"]
    assert main(report) == 0 and main([*report, "--strict"]) == 1
    shutil.rmtree(tmp_path / "report")
    assert main(command) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["carry_box.npz"]
    assert verdict_of(load(tmp_path / "carry_box.npz")).fatal == ()


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
