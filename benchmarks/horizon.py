"""How far should one solve see? Per frame, windows with and without look-ahead, whole clip.

Every horizon runs the whole pipeline over the same clips in a process of its own. Seams are the
frames where what is kept of one window meets what is kept of the next; their jerk is compared with
the jerk elsewhere.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import Source, clip_files, peak_memory, pin_threads, run_fresh, show, write_json

from hoi_retarget import synthetic
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.report import Status
from hoi_retarget.retargeting.config import Config, Horizon, parse_horizon
from hoi_retarget.retargeting.pipeline import retarget
from hoi_retarget.retargeting.trajopt.windows import windows_of
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import RobotModel

FIGURES = (
    ("contact_gap_m", "gap [mm]", 1e3, 2),
    ("body_pose_deviation_deg", "pose [deg]", 1.0, 2),
    ("link_velocity_direction_deg", "velocity [deg]", 1.0, 2),
    ("body_jerk_mps3", "jerk [m/s^3]", 1.0, 2),
    ("body_jerk_max_mps3", "jerk max", 1.0, 0),
)
NEAR_SEAM = 2  # Frames on either side that a third difference reaches.


@dataclass(frozen=True)
class Arguments:
    """Compare horizons over some clips."""

    robot: str = "unitree_g1"
    synthetic: tuple[str, ...] = tuple(synthetic.SCENES)
    """Scenes to make clips from; not used with recorded clips."""
    data: Path | None = None
    """Folder with recorded clips."""
    objects: Path | None = None
    limit: int | None = 8
    """Only so many recorded clips, spread evenly over their names."""
    frames: int | None = None
    """Only the first so many frames of every clip."""
    horizons: tuple[str, ...] = (
        "per-frame",
        "windowed:30:3",
        "windowed:60:3",
        "windowed:60:15",
        "windowed:60:30",
        "windowed:120:30",
        "windowed:120:60",
        "windowed:240:60",
        "auto",
        "whole",
    )
    json: Path | None = None


def sources(arguments: Arguments) -> list[Source]:
    if arguments.data is None:
        return [Source(synthetic=name, frames=arguments.frames) for name in arguments.synthetic]
    files = clip_files(arguments.data, arguments.limit)
    return [Source(clip=file, objects=arguments.objects, frames=arguments.frames) for file in files]


def seam_jerk(motion: Motion, model: RobotModel, horizon: Horizon) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean jerk over links [m/s^3] of the frames near seams, and of the other ones."""
    positions = model.forward(motion.qpos).body_positions
    jerk = np.linalg.norm(np.diff(positions, 3, axis=0), axis=-1).mean(axis=1) * motion.fps**3
    seams = [start + pinned for start, _, pinned in windows_of(horizon, motion.frames)[1:]]
    # Difference `i` spans the frames `i` to `i + 3`.
    middle = np.arange(len(jerk)) + 1.5
    near = np.zeros(len(jerk), dtype=bool)
    for seam in seams:
        near |= np.abs(middle - (seam - 0.5)) < NEAR_SEAM
    return jerk[near], jerk[~near]


def measure(arguments: Arguments, name: str) -> dict[str, Any]:
    """Return times, memory, mean figures and seams of one horizon over all clips, in this process."""
    model, horizon = load_robot(arguments.robot), parse_horizon(name)
    config = Config(horizon=horizon)
    seconds, frames, windows, unsolved = {"ik": 0.0, "trajectory": 0.0}, 0, 0, 0
    figures: dict[str, list[float]] = {key: [] for key, *_ in FIGURES}
    at_seams, elsewhere = [], []
    for source in sources(arguments):
        motion = retarget(source.read(), model, config)
        report = motion.report
        seconds = {stage: value + report.cpu_seconds[stage] for stage, value in seconds.items()}
        frames += motion.frames
        windows += len(motion.stages[-1].windows)
        unsolved += sum(window.status is not Status.SOLVED for stage in motion.stages for window in stage.windows)
        for key, values in figures.items():
            if report.figures[key] is not None:
                values.append(report.figures[key])
        near, away = seam_jerk(motion, model, horizon)
        at_seams.append(near)
        elsewhere.append(away)
    at, away = np.concatenate(at_seams), np.concatenate(elsewhere)
    return {
        "horizon": name,
        "frames": frames,
        "windows": windows,
        "unsolved": unsolved,
        "seconds": seconds,
        "megabytes": peak_memory(),
        "figures": {key: float(np.mean(values)) if values else None for key, values in figures.items()},
        "jerk_at_seams": float(at.mean()) if at.size else None,
        "jerk_elsewhere": float(away.mean()) if away.size else None,
    }


def row_of(result: dict[str, Any]) -> tuple[str, ...]:
    figures = [
        "-" if (value := result["figures"][key]) is None else f"{value * scale:.{digits}f}"
        for key, _, scale, digits in FIGURES
    ]
    at, away = result["jerk_at_seams"], result["jerk_elsewhere"]
    return (
        result["horizon"],
        str(result["windows"]),
        str(result["unsolved"]),
        *(f"{1e3 * value / result['frames']:.2f}" for value in result["seconds"].values()),
        f"{result['megabytes']:.0f}",
        *figures,
        "-" if at is None or away is None else f"{at:.1f} / {away:.1f}",
    )


def main(arguments: Arguments) -> None:
    results = [run_fresh(measure, arguments, name) for name in arguments.horizons]
    header = ("horizon", "windows", "unsolved", "ik [ms/fr]", "traj [ms/fr]", "peak [MB]",
              *(title for _, title, *_ in FIGURES), "seams / elsewhere")  # fmt: skip
    title = f"{len(sources(arguments))} clips, {results[0]['frames']} frames, {arguments.robot}"
    show(title, header, [row_of(result) for result in results], "Seams: jerk [m/s^3] within 2 frames of one.")
    write_json(arguments.json, {"results": results})


if __name__ == "__main__":
    pin_threads()
    main(tyro.cli(Arguments, description=__doc__))
