"""Whatever the disk refuses, and however often, a batch ends in words, and the next one makes what is missing."""

import errno
import functools
import itertools
import os
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest

from hoi_retarget.batch import work
from hoi_retarget.batch.manifest import read_manifest
from hoi_retarget.batch.pool import LocalPool
from hoi_retarget.batch.run_batch import run_batch
from hoi_retarget.batch.specification import Specification
from hoi_retarget.batch.work import run_job
from hoi_retarget.errors import WriteError
from hoi_retarget.files.atomic import write_together
from hoi_retarget.motion.result_file import encode, load
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget_people
from hoi_retarget.robots import load_robot
from synthetic import make

CALLS = ("open", "write", "fsync", "close", "link", "replace", "unlink", "mkdir", "chmod", "truncate", "pwrite")
"""What Python asks the system for where something is written."""


class Disk:
    """Stands for a disk that refuses some of what it is asked for, counted from 0."""

    def __init__(self, monkeypatch, refused=()) -> None:
        self.refused, self.asked = refused, []
        for name in CALLS:
            monkeypatch.setattr(os, name, self._counted(getattr(os, name), name))
        opened = tempfile.NamedTemporaryFile
        monkeypatch.setattr(tempfile, "NamedTemporaryFile", lambda **options: File(self, opened(**options)))

    def _counted(self, call, name):
        def counted(*args, **kwargs):
            reads = name == "open" and not args[1] & (os.O_WRONLY | os.O_RDWR)
            refused = not reads and len(self.asked) in self.refused
            self.asked += [] if reads else [name]
            if refused and name == "write":
                call(args[0], args[1][: len(args[1]) // 2])
            elif refused and name == "close":
                call(*args)
            if refused:
                raise OSError(errno.EIO, os.strerror(errno.EIO))
            return call(*args, **kwargs)

        return counted


class File:
    """Stands for a file on it."""

    def __init__(self, disk: Disk, file) -> None:
        self._file = file
        self.name, self.fileno, self.flush = file.name, file.fileno, file.flush
        self.write = disk._counted(lambda _, content: file.write(content), "write")
        self.write = functools.partial(self.write, None)

    def __enter__(self):
        return self

    def __exit__(self, *details) -> None:
        self._file.close()


class Inline(LocalPool):
    """A pool in this process."""

    def __init__(self) -> None:
        super().__init__(run_job, 1)

    def run(self, tasks, stopped):
        for index, task in enumerate(tasks):
            yield index, run_job(task)


@pytest.fixture(scope="module")
def made():
    clip = make("carry_table", seconds=0.6)
    return clip, retarget_people(clip, (load_robot("unitree_g1"),), Config())


@pytest.fixture
def specification(made, tmp_path, monkeypatch):
    """A batch of two jobs with two people each, where nothing is solved."""
    clip, motions = made
    monkeypatch.setattr(work, "open_clip", lambda *_: clip)
    monkeypatch.setattr(
        work, "retarget_people", lambda *_, command: tuple(motion.with_report(command=command) for motion in motions)
    )
    monkeypatch.chdir(tmp_path)
    return Specification(clips=("builtin:carry_table",), robots=("unitree_g1",), size_multipliers=(1.0, 0.9))


def run(specification, out: str = "out"):
    return run_batch(specification, Path(out), Inline())


def left_in(out: str) -> dict:
    """Return what a batch left: of results everything but how long they took, of other files their names."""
    found = {}
    for path in Path(out).rglob("*"):
        if path.suffix == ".npz":
            motion = load(path)
            found[str(path.relative_to(out))] = encode(motion.with_report(cpu_seconds={}))
        elif path.is_file():
            found[str(path.relative_to(out))] = ""
    timed = {"seconds": 0.0, "results": ()}
    return found | {name: replace(entry, **timed) for name, entry in read_manifest(Path(out)).items()}


def recovers(specification, monkeypatch, refused) -> str:
    """Run the batch on a disk with faults, then go on with it on a sound one; return how the first one ended."""
    with monkeypatch.context() as patch:
        Disk(patch, refused)
        try:
            run(specification)
            ended = "complete"
        except WriteError as error:
            assert "cannot be written" in str(error)
            ended = "refused"
    assert run(specification).is_complete
    assert left_in("out") == left_in("undisturbed")
    return ended


def number_of_calls(specification, monkeypatch) -> int:
    with monkeypatch.context() as patch:
        disk = Disk(patch)
        run(specification, "undisturbed")
        return len(disk.asked)


@pytest.mark.parametrize("step", [pytest.param(1, marks=pytest.mark.slow), 9], ids=["every call", "some of the calls"])
def test_any_faults_at_any_writes_and_a_second_run_equal_an_undisturbed_one(specification, monkeypatch, step):
    calls = number_of_calls(specification, monkeypatch)
    assert calls > 30
    ends = set()
    for number, first in enumerate(range(0, calls, step)):
        faults = [(first,), (first, first + 1), range(first, 10**6), range(first, first + 7, 2)]
        for refused in faults if step == 1 else faults[number % 4 :][:1]:
            for path in sorted(Path("out").rglob("*"), reverse=True):
                path.rmdir() if path.is_dir() else path.unlink()
            ends.add(recovers(specification, monkeypatch, refused))
    assert ends == {"complete", "refused"}


def test_files_that_belong_together_are_all_new_or_all_old(tmp_path, monkeypatch):
    paths = [tmp_path / name for name in "abc"]
    most = 40
    for refused in (*((number,) for number in range(most)), *itertools.pairwise(range(most + 1))):
        for path, old in zip(paths, (b"1", b"2", None), strict=True):
            path.unlink(missing_ok=True) if old is None else path.write_bytes(old)
        with monkeypatch.context() as patch:
            disk = Disk(patch, refused)
            try:
                write_together(dict.fromkeys(paths, b"new"))
                expected = [b"new"] * 3
            except WriteError:
                expected = [b"1", b"2", None]
        there = [path.read_bytes() if path.exists() else None for path in paths]
        left = set(tmp_path.iterdir()) - set(paths)
        if len(refused) == 1:  # A second fault may hit what undoes the first.
            assert there == expected
            assert not left or disk.asked[refused[0]] == "unlink"
        for path in left:
            path.unlink()
    assert len(disk.asked) < most, "every call was refused"
