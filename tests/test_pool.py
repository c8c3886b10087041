"""Batches among processes that die: workers, the batch itself, and by whatever signal."""

import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from batch_tasks import act, unpicklable
from hoi_retarget.batch import pool
from hoi_retarget.batch.manifest import MANIFEST, read_manifest
from hoi_retarget.batch.pool import LocalPool, LostTask
from hoi_retarget.batch.run_batch import locked
from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.motion.result_file import encode, load
from said import complaints_in

PATIENCE_S = 300.0  # On a busy machine.


def run(crew, tasks, stopped=lambda: False) -> list:
    """Return what became of each task, None where it was not done."""
    outcomes = dict(crew.run(tasks, stopped))
    return [outcomes.get(index) for index in range(len(tasks))]


def until(condition) -> None:
    start = time.monotonic()
    while not condition():
        assert time.monotonic() - start < PATIENCE_S
        time.sleep(0.05)


def is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    # What has ended and was not waited for by its new parent is a zombie.
    return "\nState:\tZ" not in Path(f"/proc/{process}/status").read_text()


# the pool


@pytest.mark.slow
def test_whatever_a_task_does_costs_that_task_alone():
    tasks = ["a", "die SIGKILL", "b", "hang", "exit 3", "die SIGSEGV", "raise", "interrupt", "c"]
    outcomes = run(LocalPool(act, workers=2, time_limit=1.0), tasks)
    done = {task: value for task, value in zip(tasks, outcomes, strict=True) if not isinstance(value, LostTask)}
    assert done == {"a": "A", "b": "B", "interrupt": "INTERRUPT", "c": "C"}
    lost = {task: value for task, value in zip(tasks, outcomes, strict=True) if isinstance(value, LostTask)}
    assert {task: value.status for task, value in lost.items()} == {
        "die SIGKILL": "killed",
        "hang": "timeout",
        "exit 3": "killed",
        "die SIGSEGV": "killed",
        "raise": "killed",
    }
    assert "SIGKILL, perhaps for lack of memory" in lost["die SIGKILL"].reason
    assert "SIGSEGV" in lost["die SIGSEGV"].reason and "exit code 3" in lost["exit 3"].reason
    assert "limit of 1 s" in lost["hang"].reason and lost["hang"].seconds > 1.0


@pytest.mark.slow
def test_memory_beyond_the_limit_is_refused_and_the_worker_goes_on():
    outcomes = run(LocalPool(act, workers=1, memory_limit=1000.0), ["hog 4000", "hog 10", "a"])
    assert outcomes == ["MemoryError", "10 MB", "A"]


@pytest.mark.slow
def test_a_value_that_cannot_be_sent_is_lost():
    (outcome,) = run(LocalPool(unpicklable, workers=1), ["a"])
    assert isinstance(outcome, LostTask) and outcome.status == "killed"


@pytest.mark.slow
def test_a_pool_that_is_stopped_leaves_no_process(tmp_path):
    def stopped() -> bool:
        return len(list(tmp_path.iterdir())) == 2

    assert run(LocalPool(act, workers=2), [f"stay {tmp_path}"] * 3, stopped) == [None, None, None]
    assert not any(is_alive(int(path.name)) for path in tmp_path.iterdir())


@pytest.mark.slow
def test_workers_that_cannot_start_end_the_batch(monkeypatch):
    monkeypatch.setenv("BATCH_TASKS_BROKEN", "1")
    with pytest.raises(HoiRetargetError, match=r"3 workers in a row ended as they started: .* exit code 7"):
        run(LocalPool(act, workers=1), ["a"])


@pytest.mark.slow
def test_starts_that_fail_now_and_then_do_not_add_up(monkeypatch):
    started = []

    def every_other_broken(asked):
        started.append(len(started) % 2 == 0)
        if started[-1]:
            monkeypatch.setenv("BATCH_TASKS_BROKEN", "1")
        else:
            monkeypatch.delenv("BATCH_TASKS_BROKEN")
        return worker(asked)

    worker = pool._Worker
    monkeypatch.setattr(pool, "_Worker", every_other_broken)
    outcomes = run(LocalPool(act, workers=1, time_limit=0.1), ["hang"] * 3)
    assert [outcome.status for outcome in outcomes] == ["timeout"] * 3 and len(started) == 6


@pytest.mark.slow
def test_without_room_for_another_process_those_that_are_there_go_on(monkeypatch):
    started = []

    def one(asked):
        if started:
            raise OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))
        started.append(worker(asked))
        return started[0]

    worker = pool._Worker
    monkeypatch.setattr(pool, "_Worker", one)
    assert run(LocalPool(act, workers=2), ["a", "b", "c"]) == ["A", "B", "C"]
    with pytest.raises(HoiRetargetError, match="no worker can be started: Resource temporarily unavailable"):
        run(LocalPool(act, workers=2), ["a"])


def test_nothing_to_do_starts_no_process():
    assert run(LocalPool(act, workers=2), []) == []


# the command

SPECIFICATION = (
    'clips = ["builtin:carry_box", "builtin:move_chair"]\nsize_multipliers = [1.0, 0.9]\nspeeds = [1.0, 1.5]\n'
    '[config]\ncontact = "landmark"\n'  # Solved in a third of the time.
)
JOBS = 8


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "set.toml").write_text(SPECIFICATION)
    return tmp_path


def start(folder: Path, *words: str) -> subprocess.Popen:
    """Start a batch in a session of its own, as a terminal does."""
    command = [sys.executable, "-m", "hoi_retarget", "batch", "set.toml", "--out", "out", "--workers", "2", *words]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    # Where the tests run in the background, a shell has SIGINT ignored, which programs inherit.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    return subprocess.Popen(command, cwd=folder, text=True, start_new_session=True, **pipes)


def finish(folder: Path, *words: str) -> str:
    """Run the batch to its end and check that its manifest is complete; return what it said."""
    process = start(folder, *words)
    said, complaints = process.communicate(timeout=4 * PATIENCE_S)
    assert (process.returncode, complaints_in(complaints)) == (0, "")
    entries = read_manifest(folder / "out")
    assert len(entries) == JOBS
    for entry in entries.values():
        assert all(load(folder / "out" / result.path).frames == entry.frames for result in entry.results)
    assert not list((folder / "out").rglob(".*.npz.*"))
    return said


def made_in(out: Path) -> dict:
    """Return what a batch made: all files, of results everything but how long they took, and the manifest."""
    untimed = {
        path: encode(load(path).with_report(cpu_seconds={})) if path.suffix == ".npz" else b""
        for path in out.rglob("*")
        if path.is_file()
    }
    entries = {name: replace(entry, seconds=0.0, results=()) for name, entry in read_manifest(out).items()}
    return {path.relative_to(out).as_posix(): content for path, content in untimed.items()} | entries


def lines(folder: Path) -> int:
    manifest = folder / "out" / MANIFEST
    return manifest.read_bytes().count(b"\n") if manifest.exists() else 0


def workers(process: subprocess.Popen) -> list[int]:
    """Return the processes that do the work; another one tracks what they share."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return [int(child) for child in children if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]


@pytest.mark.slow
def test_a_batch_that_is_killed_loses_no_more_than_what_it_was_at(folder):
    process = start(folder)
    until(lambda: lines(folder) >= 3)
    children = workers(process)
    process.kill()
    assert complaints_in(process.communicate()[1]) == "", "orphaned workers end without a word"
    assert len(children) == 2
    until(lambda: not any(map(is_alive, children)))
    kept = lines(folder)
    with (folder / "out" / MANIFEST).open("a") as file:
        file.write('{"name": "unitree_g1/carry_b')  # As a power cut leaves it.
    (folder / "out" / "unitree_g1" / ".carry_box.npz.0123abcd").touch()
    assert f"{JOBS} jobs, {kept} of them done before." in finish(folder)
    assert "0 jobs done: nothing was left to do." in finish(folder)


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_batch_that_is_asked_to_stop_does(folder, number, code):
    process = start(folder)
    until(lambda: lines(folder) >= 2)
    children = workers(process)
    if number == signal.SIGINT:
        os.killpg(process.pid, number)  # Ctrl-C goes to the workers, too.
    else:
        process.send_signal(number)
    said, complaints = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == code
    kept = lines(folder)
    assert (
        complaints_in(complaints)
        == f"error: stopped by {number.name}: {JOBS - kept} jobs are left. The same command goes on with them.\n"
    )
    assert "solved" in said
    assert not any(map(is_alive, children))
    assert not list((folder / "out").rglob(".*.npz.*"))
    assert f"{kept} of them done before" in finish(folder)


@pytest.mark.slow
def test_a_second_batch_is_refused(folder):
    with locked(folder / "out"):
        process = start(folder)
        _, complaints = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert f"another batch is at work there (process {os.getpid()})" in complaints


@pytest.mark.slow
def test_a_worker_that_is_killed_costs_its_clip(folder):
    process = start(folder)
    until(lambda: lines(folder) >= 1)
    os.kill(workers(process)[0], signal.SIGKILL)
    process.communicate(timeout=4 * PATIENCE_S)
    entries = read_manifest(folder / "out").values()
    killed = [entry for entry in entries if not entry.succeeded]
    assert len(entries) == JOBS and len(killed) <= 1, "it may have been between two clips"
    assert all(entry.status == "killed" and "SIGKILL" in entry.reason for entry in killed)
    assert process.returncode == (1 if killed else 0)
    assert f"{JOBS - len(killed)} of them done before" in finish(folder)


def kill_in_the_middle(folder: Path, *, whole: bool, rng: np.random.Generator) -> str:
    """Start the batch, kill it or one of its workers at some moment, wait for its end, and return its complaints."""
    process = start(folder)
    until(lambda: len(workers(process)) == 2 or process.poll() is not None)
    time.sleep(rng.uniform(0.0, 4.0))
    children = workers(process) if process.poll() is None else []
    with suppress(ProcessLookupError):
        if whole:
            process.kill()
        elif children:
            os.kill(int(rng.choice(children)), signal.SIGKILL)
    complaints = complaints_in(process.communicate(timeout=4 * PATIENCE_S)[1])
    until(lambda: not any(map(is_alive, children)))
    return complaints


@pytest.mark.slow
def test_any_kills_in_the_middle_and_another_run_equal_an_undisturbed_one(folder):
    finish(folder)
    undisturbed = made_in(folder / "out")
    assert len(undisturbed) == 2 * JOBS + 2
    rng = np.random.default_rng(0)
    for number in range(6):
        shutil.rmtree(folder / "out")
        whole = number % 3 > 0
        complaints = kill_in_the_middle(folder, whole=whole, rng=rng)
        assert not complaints if whole else "Traceback" not in complaints
        finish(folder)
        assert made_in(folder / "out") == undisturbed
