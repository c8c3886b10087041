"""What the benchmarks share: one thread, the clips to run on, tables and JSON."""

import json
import os
import platform
import resource
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.readers.open import open_clip

sys.path.append(str(Path(__file__).parents[1] / "tests"))  # Writers of recordings belong to the tests.
import synthetic
from short_clips import taken

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "IGL_NUM_THREADS",
)


@dataclass(frozen=True)
class Source:
    """Which clip to run on: a synthetic one, or a file."""

    synthetic: str = "carry_box"
    """Name of a synthetic scene."""
    clip: Path | None = None
    """A recorded clip instead."""
    objects: Path | None = None
    """Folder with the geometry of the recorded clip's object."""
    frames: int | None = None
    """Only the first so many frames."""

    def read(self) -> Clip:
        """Return the clip."""
        clip = (
            synthetic.make(self.synthetic)
            if self.clip is None
            else open_clip(self.clip, ReadOptions(objects=self.objects))
        )
        return clip if self.frames is None else taken(clip, np.arange(min(self.frames, clip.frames)))


def clip_files(folder: Path, limit: int | None) -> list[Path]:
    """Return the recorded clips of a folder; with a limit, so many spread evenly over their names."""
    files = sorted(folder.glob("*.pt"))
    if not files:
        raise SystemExit(f"{folder}: there are no .pt files in it.")
    if limit is None or limit >= len(files):
        return files
    return [files[index] for index in np.linspace(0, len(files) - 1, limit).round().astype(int)]


def one_of_each_first(files: list[Path]) -> list[Path]:
    """Return clips in rounds of one a kind of object, small files first, so that a part of them has all kinds."""
    kinds: dict[str, list[Path]] = {}
    for file in sorted(files, key=lambda file: file.stat().st_size):
        kinds.setdefault(file.stem.split("_")[1], []).append(file)
    rank = {file: (index, file.stat().st_size) for clips in kinds.values() for index, file in enumerate(clips)}
    return sorted(files, key=rank.__getitem__)


def pin_threads() -> None:
    """Start this program again with one thread for linear algebra unless that is so already.

    The libraries read these variables when they are loaded, so they must be set before that.
    """
    if all(os.environ.get(name) == "1" for name in THREAD_VARIABLES):
        return
    sys.stdout.flush()
    os.execve(sys.executable, [sys.executable, *sys.argv], os.environ | dict.fromkeys(THREAD_VARIABLES, "1"))


def run_fresh(function: Callable[..., dict[str, Any]], *arguments: Any) -> dict[str, Any]:
    """Return what a function of a benchmark returns in a process of its own."""
    with ProcessPoolExecutor(max_workers=1, mp_context=get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


def peak_memory() -> float:
    """Return the peak of this process's resident memory [MB].

    Linux keeps in `ru_maxrss` what the process that started this one had; `VmHWM` is its own.
    """
    status = Path("/proc/self/status")
    if status.exists():
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) / 1024
    unit = 2**20 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def show(title: str, header: Sequence[str], rows: Sequence[Sequence[str]], note: str = "") -> None:
    """Print a table: the first column to the left, numbers to the right."""
    table = Table(title=Text(title), title_justify="left")
    for index, name in enumerate(header):
        table.add_column(Text(name), justify="left" if index == 0 else "right", no_wrap=index == 0)
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    console = Console(width=None if sys.stdout.isatty() else 160)
    console.print(table)
    if note:
        console.print(Text(note))
    console.print()


def write_json(path: Path | None, document: dict[str, Any]) -> None:
    """Write results with what they were measured on."""
    if path is None:
        return
    machine = {"platform": platform.platform(), "python": platform.python_version(), "cpus": os.cpu_count()}
    path.write_text(json.dumps(document | {"machine": machine}, indent=1) + "\n")
