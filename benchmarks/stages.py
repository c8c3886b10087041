"""CPU time by stage, from file to file, on one thread: ms per frame and clips per second.

Synthetic clips by default, recorded ones with `--data DIR --objects DIR`; every robot.
"""

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import clip_files, pin_threads, show, write_json

import synthetic
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.motion.result_file import save
from hoi_retarget.readers import read_clip
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.robots import ROBOTS, load_robot
from hoi_retarget.robots.model import RobotModel
from short_clips import taken

STAGES = ("read", "targets", "ik", "trajectory", "metrics", "write")


@dataclass(frozen=True)
class Arguments:
    """Measure every stage of the pipeline."""

    robots: tuple[str, ...] = tuple(ROBOTS)
    synthetic: tuple[str, ...] = tuple(synthetic.SCENES)
    """Scenes to make clips from; reading them is making them."""
    data: Path | None = None
    """Folder with recorded clips."""
    objects: Path | None = None
    """Folder with the geometry of their objects."""
    limit: int | None = None
    """Only so many recorded clips, spread evenly over their names."""
    frames: int | None = None
    """Only the first so many frames of every clip."""
    repeats: int = 1
    """Runs of every clip, of which the fastest counts, stage by stage."""
    json: Path | None = None


def measure(read: Callable[[], Clip], model: RobotModel, out: Path, frames: int | None) -> dict[str, Any]:
    """Return CPU seconds by stage for one clip, and its number of frames."""
    start = time.process_time()
    clip = read()
    seconds = {"read": time.process_time() - start}
    if frames is not None:
        clip = taken(clip, np.arange(min(frames, clip.frames)))
    result = retarget(clip, model, Config())
    seconds |= result.report.cpu_seconds
    start = time.process_time()
    save(result, out / f"{clip.name}.npz")
    seconds["write"] = time.process_time() - start
    return {"clip": clip.name, "frames": clip.frames, "seconds": seconds}


def fastest(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Return one clip's measurement with the fastest run of every stage."""
    seconds = {stage: min(run["seconds"][stage] for run in runs) for stage in STAGES}
    return runs[0] | {"seconds": seconds}


def sources(arguments: Arguments) -> Iterator[tuple[str, list[Callable[[], Clip]]]]:
    """Yield names of clip sets with one reading function per clip."""
    if arguments.synthetic:
        yield "synthetic", [lambda name=name: synthetic.make(name) for name in arguments.synthetic]
    if arguments.data is not None:
        files, objects = clip_files(arguments.data, arguments.limit), arguments.objects
        yield "recorded", [lambda file=file: read_clip(file, ReadOptions(objects=objects)) for file in files]


def row_of(name: str, results: list[dict[str, Any]]) -> tuple[str, ...]:
    """Return a table row: ms per frame by stage, then everything together."""
    frames = sum(result["frames"] for result in results)
    seconds = [sum(result["seconds"][stage] for result in results) for stage in STAGES]
    total = sum(seconds)
    by_stage = [f"{1e3 * value / frames:.3f}" for value in seconds]
    return (name, str(len(results)), str(frames), *by_stage, f"{1e3 * total / frames:.3f}",
            f"{len(results) / total:.1f}")  # fmt: skip


def main(arguments: Arguments) -> None:
    rows, document = [], {}
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        for robot in arguments.robots:
            model = load_robot(robot)
            measure(lambda: synthetic.make("carry_box"), model, out, 20)  # Imports and caches are not counted.
            for name, readers in sources(arguments):
                results = [
                    fastest([measure(read, model, out, arguments.frames) for _ in range(arguments.repeats)])
                    for read in readers
                ]
                rows.append(row_of(f"{robot}, {name}", results))
                document[f"{robot}, {name}"] = results
    header = ("robot, clips", "clips", "frames", *STAGES, "all", "clips/s")
    show("CPU by stage [ms/frame]", header, rows, "One thread, from file to file.")
    write_json(arguments.json, {"results": document})


if __name__ == "__main__":
    pin_threads()
    main(tyro.cli(Arguments, description=__doc__))
