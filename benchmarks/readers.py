"""What reading costs: time and memory for short and long clips of every format.

The clips are synthetic, written as the sources have them by what the tests use, with body models of a few vertices; a
model's own vertices are not needed to read joints. Each reading is the first one in a process of its own, which has
read a short clip of the same format before, so that no import and no cache of its files counts.
"""

import gc
import tempfile
import time
import tracemalloc
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import pin_threads, run_fresh, show, write_json

from hoi_retarget.clip.clip import Clip
from recordings import WRITERS, Recording

SHORT = 60  # Frames of the clip that is read before.


@dataclass(frozen=True)
class Arguments:
    """Read clips of all formats."""

    formats: tuple[str, ...] = tuple(WRITERS)
    frames: tuple[int, ...] = (300, 10_000)
    repeats: int = 3
    """Readings of every clip, of which the fastest counts."""
    json: Path | None = None


def seconds_of(recording: Recording, short: Recording) -> dict[str, Any]:
    """Return the CPU seconds of reading a recording in this process."""
    short.read()
    start = time.process_time()
    recording.read()
    return {"seconds": time.process_time() - start}


def memory_of(recording: Recording) -> dict[str, Any]:
    """Return the bytes of the files that a recording is, of the clip's arrays, and what Python held at most."""
    recording.read()  # Body models and meshes stay in memory.
    gc.collect()
    tracemalloc.start()
    clip = recording.read()
    _, peak = tracemalloc.get_traced_memory()
    return {"bytes": bytes_of_files(recording, clip), "clip": bytes_of(clip), "peak": peak}


def bytes_of_files(recording: Recording, clip: Clip) -> int:
    """Return the size of all files that a clip was read from."""
    paths = {Path(name) for name in clip.source.files} | {recording.path}
    return sum(path.stat().st_size for path in paths if path.is_file())


def bytes_of(clip: Clip) -> int:
    """Return the size of a clip's arrays, without shapes."""
    arrays: list[np.ndarray] = []
    for person in clip.people:
        arrays += [person.joint_positions, person.joint_quats]
    for track in clip.objects:
        arrays += [track.positions, track.quats]
    for contact in clip.contacts:
        arrays += [contact.active, contact.contact_points]
    return sum(array.nbytes for array in arrays)


def measure(name: str, frames: int, repeats: int) -> dict[str, Any]:
    """Return what reading a clip of one format costs."""
    with tempfile.TemporaryDirectory() as text:
        recording, short = (
            _written(name, Path(text, kind), count) for kind, count in (("measured", frames), ("before", SHORT))
        )
        seconds = [run_fresh(seconds_of, recording, short)["seconds"] for _ in range(repeats)]
        memory = run_fresh(memory_of, recording)
    return {"format": name, "frames": frames, "seconds": min(seconds), **memory}


def _written(name: str, folder: Path, frames: int) -> Recording:
    folder.mkdir()
    return WRITERS[name](folder, frames)


def row(result: dict[str, Any]) -> list[str]:
    beyond = result["peak"] - result["bytes"]
    return [
        result["format"],
        str(result["frames"]),
        f"{result['bytes'] / 1e6:.1f}",
        f"{result['seconds']:.3f}",
        f"{beyond / 1e6:.1f}",
        f"{result['clip'] / 1e6:.1f}",
        f"{beyond / result['clip']:.1f}",
    ]


def main(arguments: Arguments) -> None:
    results = [measure(name, count, arguments.repeats) for name in arguments.formats for count in arguments.frames]
    header = ("format", "frames", "files [MB]", "read [CPU s]", "peak beyond files [MB]", "clip [MB]", "times the clip")
    show("Reading", header, [row(result) for result in results])
    write_json(arguments.json, {"results": results})


if __name__ == "__main__":
    pin_threads()
    main(tyro.cli(Arguments, description=__doc__))
