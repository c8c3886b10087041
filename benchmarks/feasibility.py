"""What speaks against references in physics, and how long drives that follow them keep the robot on its feet.

Three ways of following, none of them optimized: the reference's joint angles; with the torques of inverse dynamics;
with feedback gains too. The rank correlations say what the figures are worth as forecasts.

    python benchmarks/feasibility.py --results results/*.npz --objects ../shared/data/objects
"""

import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import tyro
from common import pin_threads, show, write_json
from scipy.stats import spearmanr

from hoi_retarget.dynamics.feasibility import forces_on_clip, physics_of_motion
from hoi_retarget.dynamics.physics_scene import compiled, scene_of
from hoi_retarget.evaluation.physics_figures import FEASIBILITY, forces_figures
from hoi_retarget.motion.result_file import load
from hoi_retarget.readers.open import clip_of
from hoi_retarget.robots import load_robot
from hoi_retarget.simulation.control import feedback_gains
from hoi_retarget.simulation.rollout import drive_targets, object_errors, reference_of, track

WAYS = ("angles", "torques", "feedback")


@dataclass(frozen=True)
class Arguments:
    """Measure results."""

    results: tuple[Path, ...]
    objects: Path | None = None
    """Folder with the geometry of the recorded clips' objects."""
    jobs: int = 1
    json: Path | None = None


def measured(file: Path, objects: Path | None) -> dict[str, Any]:
    """Return the figures of one result, and how long it stands."""
    motion = load(file)
    model, clip = load_robot(motion.robot), clip_of(motion, objects=objects)
    forces_on_clip(motion, clip, model)  # Distance fields are there then.
    start = time.process_time()
    forces = forces_on_clip(motion, clip, model)
    spent = time.process_time() - start
    scene = scene_of(motion, model, clip.objects, physics_of_motion(motion))
    simulated, reference = compiled(scene), reference_of(scene, motion, forces)
    start = time.process_time()
    gains = feedback_gains(scene, simulated, reference)
    targets = drive_targets(scene, reference)
    rollouts = {
        "angles": track(simulated, reference, drive_targets(scene, reference, feedforward=False)),
        "torques": track(simulated, reference, targets),
        "feedback": track(simulated, reference, targets, gains),
    }
    errors = object_errors(rollouts["feedback"], reference, model.n)
    return {
        "clip": file.stem,
        "robot": motion.robot,
        "seconds": reference.seconds,
        "shape": ", ".join(item.shape.kind for item in scene.objects),
        "forces_s": spent,
        "simulation_s": time.process_time() - start,
        **forces_figures(forces, motion),
        **{way: rollout.seconds for way, rollout in rollouts.items()},
        "object_error_m": float(errors.mean()) if errors.size else None,
    }


def correlations(results: list[dict[str, Any]]) -> list[tuple[str, ...]]:
    """Return the rank correlation of each figure with the share of the motion that each way stands."""
    rows = [("figure", *WAYS)]
    for figure in FEASIBILITY:
        known = [result for result in results if result[figure.name] is not None]
        values = [result[figure.name] for result in known]
        cells = []
        for way in WAYS:
            stood = [result[way] / result["seconds"] for result in known]
            constant = len(set(values)) < 2 or len(set(stood)) < 2
            cells.append("-" if constant else f"{spearmanr(values, stood).statistic:+.2f}")
        rows.append((figure.title, *cells))
    return rows


def main(arguments: Arguments) -> None:
    """Measure every result, and print each and all together."""
    with ProcessPoolExecutor(arguments.jobs, mp_context=get_context("spawn")) as pool:
        futures = [pool.submit(measured, file, arguments.objects) for file in arguments.results]
        results = [future.result() for future in futures]
    header = ["clip", "robot", "shape", "length [s]", *(figure.header for figure in FEASIBILITY)]
    header += [f"stands [s], {way}" for way in WAYS] + ["forces [s]", "simulation [s]"]
    rows = [
        [
            *(result["clip"], result["robot"], result["shape"], f"{result['seconds']:.1f}"),
            *(figure.text(result[figure.name]) for figure in FEASIBILITY),
            *(f"{result[way]:.1f}" for way in WAYS),
            *(f"{result[name]:.2f}" for name in ("forces_s", "simulation_s")),
        ]
        for result in results
    ]
    show("feasibility", header, rows)
    head, *lines = correlations(results)
    show("rank correlation with the share of the motion that it stands", head, lines)
    write_json(arguments.json, {"clips": results, "correlations": lines})


if __name__ == "__main__":
    pin_threads()
    main(tyro.cli(Arguments))
