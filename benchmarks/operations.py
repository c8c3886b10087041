"""What single operations cost beside solving: help, a mesh, closest points on it, curves. CPU seconds of one thread.

Everything is synthetic: a ball of 82,000 triangles, and a motion played forth and back for more than five minutes.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
import tyro
from common import pin_threads, show, write_json

import synthetic
from hoi_retarget.objects.mesh import Surface
from hoi_retarget.readers.object_files import load_geometry
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.robots import load_robot
from hoi_retarget.studio.scene.curves import curves_of
from short_clips import tiled

HELP = """
import time
from hoi_retarget.cli import main
try:
    main(["--help"])
except SystemExit:
    print(time.process_time())
"""


@dataclass(frozen=True)
class Arguments:
    """Measure single operations."""

    frames: int = 10_000
    """Frames of the motion whose curves are made."""
    subdivisions: int = 6
    """Of an icosahedron into a ball: each makes four triangles of one."""
    points: int = 500
    """Points whose closest ones on the ball are looked for."""
    repeats: int = 3
    """Runs of each operation, of which the fastest counts."""
    json: Path | None = None


def seconds_of(operation: Callable[[], object]) -> float:
    """Return the CPU seconds of an operation in this process."""
    start = time.process_time()
    operation()
    return time.process_time() - start


def seconds_of_help() -> float:
    """Return the CPU seconds in which a process of its own starts and says its help."""
    done = subprocess.run([sys.executable, "-c", HELP], capture_output=True, text=True, check=True)
    return float(done.stdout.splitlines()[-1])


def seconds_of_mesh(ball: trimesh.Trimesh, folder: Path) -> float:
    """Return the CPU seconds of reading a mesh that was not read before."""
    name = f"ball{len(list(folder.iterdir()))}"
    path = folder / name / f"{name}.obj"
    path.parent.mkdir()
    ball.export(path)
    return seconds_of(lambda: load_geometry(folder, name))


def main(arguments: Arguments) -> None:
    ball = trimesh.creation.icosphere(subdivisions=arguments.subdivisions)
    surface = Surface(np.asarray(ball.vertices) * [0.3, 0.2, 0.4], np.asarray(ball.faces))
    points = 0.3 * np.random.default_rng(0).normal(size=(arguments.points, 3))
    model = load_robot("unitree_g1")
    motion = retarget(tiled(synthetic.make("carry_box"), arguments.frames), model, Config())
    with tempfile.TemporaryDirectory() as folder:
        operations = {
            "--help, a process of its own": seconds_of_help,
            f"mesh of {len(ball.faces)} triangles": lambda: seconds_of_mesh(ball, Path(folder)),
            f"{len(points)} closest points on them": lambda: seconds_of(lambda: surface.closest_points(points)),
            f"curves of {motion.frames} frames": lambda: seconds_of(lambda: curves_of(motion, model)),
        }
        seconds = {name: min(measured() for _ in range(arguments.repeats)) for name, measured in operations.items()}
    show("Single operations", ("operation", "CPU [s]"), [(name, f"{value:.3f}") for name, value in seconds.items()])
    write_json(arguments.json, {"results": seconds})


if __name__ == "__main__":
    pin_threads()
    main(tyro.cli(Arguments, description=__doc__))
