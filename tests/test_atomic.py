"""Files appear whole, and what killed programs left goes with the next write."""

import subprocess
import sys
import time

import pytest

from hoi_retarget.files import atomic

KILLED = """
import os, sys
from pathlib import Path
from hoi_retarget.files import atomic

def die(*arguments):
    os.kill(os.getpid(), 9)

if sys.argv[2] == "fsync":
    os.fsync = die
else:
    Path.replace = die
folder = Path(sys.argv[1])
atomic.write_together({folder / "a.npz": b"new", folder / "b.npz": b"new"})
"""


@pytest.mark.parametrize("killed_at", ["fsync", "replace"])
def test_what_a_killed_program_left_goes_with_the_next_write(killed_at, tmp_path, monkeypatch):
    files = {tmp_path / name: b"old" for name in ("a.npz", "b.npz")}
    atomic.write_together(files)
    assert subprocess.run([sys.executable, "-c", KILLED, str(tmp_path), killed_at], check=False).returncode == -9
    assert len(list(tmp_path.iterdir())) > 2
    assert all(path.read_bytes() == b"old" for path in files)
    later = time.time() + 10
    monkeypatch.setattr(atomic.time, "time", lambda: later)
    atomic.write_together(files)
    assert sorted(tmp_path.iterdir()) == sorted(files)


def test_what_is_being_written_or_is_the_users_stays(tmp_path, monkeypatch):
    mine, held = tmp_path / ".a.npz.backup", tmp_path / ".a.npz.abcd1234"
    mine.write_bytes(b"mine")
    held.write_bytes(b"held")
    (handle,) = atomic.hold(held)
    later = time.time() + 10
    monkeypatch.setattr(atomic.time, "time", lambda: later)
    atomic.write_atomically(tmp_path / "a.npz", b"new")
    assert {path.name for path in tmp_path.iterdir()} == {"a.npz", mine.name, held.name}
    atomic.os.close(handle)
