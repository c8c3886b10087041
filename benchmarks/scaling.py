"""How CPU time and memory grow with the number of frames, for one problem and for windows.

A clip is played forth and back until it is long enough. Every size runs in a fresh process, so that
its peak memory is its own; it can be given a limit of memory, and the paper's collision cost.
"""

import math
import resource
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from capsule_clearance import counted
from common import Source, peak_memory, pin_threads, run_fresh, show, write_json

from hoi_retarget.retargeting.config import Config, parse_horizon
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.robots import load_robot
from short_clips import tiled


@dataclass(frozen=True)
class Arguments:
    """Measure one clip at several lengths."""

    source: tyro.conf.OmitArgPrefixes[Source] = field(default_factory=Source)
    robot: str = "unitree_g1"
    sizes: tuple[int, ...] = (200, 300, 500, 1000, 2000, 5000, 10000)
    """Numbers of frames."""
    horizons: tuple[str, ...] = ("whole", "auto", "windowed:60:3")
    clearance: float = 0.0
    """Weight of the collision cost `capsule_clearance`."""
    memory_limit: float | None = None
    """Gigabytes of address space that each process may have."""
    json: Path | None = None


def measure(arguments: Arguments, frames: int, horizon: str) -> dict[str, Any]:
    """Return CPU seconds by stage and peak memory [MB] in this process, or that memory did not suffice."""
    loaded = peak_memory()
    if arguments.memory_limit is not None:
        limit = int(arguments.memory_limit * 2**30)
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    model, clip = load_robot(arguments.robot), tiled(arguments.source.read(), frames)
    start = time.process_time()
    try:
        with counted(arguments.clearance):
            result = retarget(clip, model, Config(horizon=parse_horizon(horizon), contact="landmark"))
    except MemoryError:
        return {"horizon": horizon, "frames": frames, "failed": "out of memory", "megabytes_of_imports": loaded}
    total = time.process_time() - start
    windows = result.stages[-1].windows
    return {
        "horizon": horizon,
        "frames": frames,
        "seconds": {**result.report.cpu_seconds, "all": total},
        "iterations": sum(window.iterations for window in windows),
        "windows": len(windows),
        "megabytes": peak_memory(),
        "megabytes_of_imports": loaded,
    }


def slope(results: list[dict[str, Any]], stage: str) -> float:
    """Return the exponent of the growth of a stage's time with frames."""
    frames = [math.log(result["frames"]) for result in results]
    seconds = [math.log(result["seconds"][stage]) for result in results]
    return float(np.polyfit(frames, seconds, 1)[0]) if len(results) > 1 else math.nan


def report(horizon: str, results: list[dict[str, Any]]) -> None:
    stages = ("ik", "trajectory", "all")
    failed = [(str(result["frames"]), result["failed"]) for result in results if "failed" in result]
    results = [result for result in results if "failed" not in result]
    rows = [
        (
            str(result["frames"]),
            str(result["windows"]),
            str(result["iterations"]),
            *(f"{1e3 * result['seconds'][stage] / result['frames']:.3f}" for stage in stages),
            f"{result['megabytes']:.0f}",
        )
        for result in results
    ]
    slopes = ", ".join(f"{stage} {slope(results, stage):.2f}" for stage in stages)
    note = f"Exponent of growth (1 is linear): {slopes}."
    if results:
        note += f" {results[0]['megabytes_of_imports']:.0f} MB are the imports."
    header = ("frames", "windows", "iterations", *(f"{stage} [ms/frame]" for stage in stages), "peak [MB]")
    rows += [(frames, reason, *("-" for _ in header[2:])) for frames, reason in failed]
    show(f"Horizon {horizon}", header, rows, note)


def main(arguments: Arguments) -> None:
    document = {}
    for horizon in arguments.horizons:
        document[horizon] = [run_fresh(measure, arguments, frames, horizon) for frames in arguments.sizes]
        report(horizon, document[horizon])
    write_json(arguments.json, {"results": document})


if __name__ == "__main__":
    pin_threads()
    main(tyro.cli(Arguments, description=__doc__))
