"""How far should one solve see? Per frame, windows with and without look-ahead, whole clip.

Every horizon runs the whole pipeline over the same clips in a process of its own, with the paper's contacts,
without and with its collision cost. Seams are the frames where what is kept of one window meets what
is kept of the next; their jerk is compared with the jerk elsewhere. Last, our figures stand beside
those of the paper's Appendix B.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import paper_figures
import tyro
from capsule_clearance import counted
from common import Source, clip_files, peak_memory, pin_threads, run_fresh, show, write_json

import synthetic
from hoi_retarget.errors import SolveError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.motion_report import Status
from hoi_retarget.retargeting.config import Config, Horizon, Scaling, parse_horizon
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.retargeting.trajopt.windows import windows_of
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import RobotModel

FIGURES = (
    ("contact_gap_m", "gap [mm]", 1e3, 2),
    ("body_pose_deviation_deg", "pose [deg]", 1.0, 2),
    ("link_velocity_direction_deg", "vel. [deg]", 1.0, 2),
    ("body_jerk_mps3", "jerk [m/s^3]", 1.0, 2),
    ("body_jerk_max_mps3", "jerk max", 1.0, 0),
    ("joint_jerk_radps3", "joint jerk", 1.0, 0),
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
    clearance: float = 0.0
    """Weight of the collision cost with which every horizon is run once more."""
    object_scale: float | Literal["auto"] = "auto"
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
    seams = [window.first + window.pinned for window in windows_of(horizon, motion.frames)[1:]]
    # Difference `i` spans the frames `i` to `i + 3`.
    middle = np.arange(len(jerk)) + 1.5
    near = np.zeros(len(jerk), dtype=bool)
    for seam in seams:
        near |= np.abs(middle - (seam - 0.5)) < NEAR_SEAM
    return jerk[near], jerk[~near]


def joint_jerk(motion: Motion) -> float:
    """Return the root mean square of the joints' third differences [rad/s^3], as the paper's Appendix B has it."""
    third = np.diff(motion.qpos[:, 7:], 3, axis=0) * motion.fps**3
    return float(np.sqrt(np.mean(third**2)))


def measured(source: Source, model: RobotModel, config: Config) -> dict[str, Any]:
    """Return times, figures and seams of one clip, or why it could not be solved."""
    clip = source.read()
    found = {"clip": clip.name, "objects": [track.name for track in clip.objects], "frames": clip.frames}
    try:
        motion = retarget(clip, model, config)
    except (SolveError, MemoryError) as error:
        return {**found, "failed": str(error) or "out of memory"}
    windows = [window for stage in motion.stages for window in stage.windows]
    near, away = seam_jerk(motion, model, config.horizon)
    return {
        **found,
        "windows": len(motion.stages[-1].windows),
        "unsolved": sum(window.status is not Status.SOLVED for window in windows),
        "seconds": motion.report.cpu_seconds,
        "figures": {**motion.report.figures, "joint_jerk_radps3": joint_jerk(motion)},
        "jerk_at_seams": near.tolist(),
        "jerk_elsewhere": away.tolist(),
    }


def measure(arguments: Arguments, name: str, clearance: float) -> dict[str, Any]:
    """Return what one horizon does with all clips, and the memory it takes, in this process."""
    config = Config(
        scaling=Scaling(object_scale=arguments.object_scale), horizon=parse_horizon(name), contact="landmark"
    )
    model = load_robot(arguments.robot)
    with counted(clearance):
        clips = [measured(source, model, config) for source in sources(arguments)]
    return {"horizon": name, "clearance": clearance, "clips": clips, "megabytes": peak_memory()}


def summary(result: dict[str, Any], counted: set[str]) -> dict[str, Any]:
    """Return the medians of one horizon over some clips, and sums of what is counted."""
    clips = [clip for clip in result["clips"] if clip["clip"] in counted]
    figures = {key: [clip["figures"][key] for clip in clips if clip["figures"][key] is not None] for key, *_ in FIGURES}
    at, away = (
        np.concatenate([np.zeros(0), *(clip[key] for clip in clips)]) for key in ("jerk_at_seams", "jerk_elsewhere")
    )
    stages = ("targets", "ik", "trajectory")
    return {
        "horizon": result["horizon"],
        "clearance": result["clearance"],
        "clips": len(result["clips"]),
        "solved": sum("failed" not in clip for clip in result["clips"]),
        "frames": sum(clip["frames"] for clip in clips),
        "windows": sum(clip["windows"] for clip in clips),
        "unsolved": sum(clip["unsolved"] for clip in clips),
        "seconds": {stage: sum(clip["seconds"][stage] for clip in clips) for stage in stages},
        "seconds_a_clip": median([sum(clip["seconds"][stage] for stage in stages) for clip in clips]),
        "megabytes": result["megabytes"],
        "figures": {key: median(values) for key, values in figures.items()},
        "jerk_at_seams": float(at.mean()) if at.size else None,
        "jerk_elsewhere": float(away.mean()) if away.size else None,
    }


def median(values: list[float]) -> float | None:
    return float(np.median(values)) if values else None


def row_of(result: dict[str, Any], clips: int) -> tuple[str, ...]:
    figures = [
        "-" if (value := result["figures"][key]) is None else f"{value * scale:.{digits}f}"
        for key, _, scale, digits in FIGURES
    ]
    at, away = result["jerk_at_seams"], result["jerk_elsewhere"]
    return (
        result["horizon"] + (f", cost {result['clearance']:g}" if result["clearance"] else ""),
        f"{result['solved']}/{clips}",
        f"{result['unsolved']}/{result['windows']}",
        *(f"{1e3 * result['seconds'][stage] / max(1, result['frames']):.2f}" for stage in ("ik", "trajectory")),
        f"{result['megabytes']:.0f}",
        *figures,
        "-" if at is None or away is None else f"{at:.1f} / {away:.1f}",
    )


def show_beside_paper(results: list[dict[str, Any]], clips: int) -> None:
    """Print our figures before the paper's; times as ratios to windows without the collision cost."""
    ours = {(result["horizon"], result["clearance"] > 0): result for result in results}
    base = ("windowed:60:3", False)
    unit = ours[base]["seconds_a_clip"] if base in ours else None
    rows = []
    for key, (solved, seconds, megabytes, degrees, jerk) in paper_figures.HORIZON.items():
        result = ours.get(key)
        if result is None or not result["frames"]:
            continue
        figures = result["figures"]
        rows.append(
            (
                key[0],
                "with" if key[1] else "without",
                f"{result['solved']}/{clips}  {solved}/{paper_figures.HORIZON_CLIPS}",
                f"{result['seconds_a_clip']:.2f}  {seconds}",
                f"{result['seconds_a_clip'] / unit:.2f}  {seconds / paper_figures.HORIZON[base][1]:.2f}"
                if unit
                else "-",
                f"{result['megabytes']:.0f}  {megabytes}",
                f"{figures['link_velocity_direction_deg']:.1f}  {degrees}",
                f"{figures['joint_jerk_radps3']:.0f}  {jerk}",
            )
        )
    header = ("horizon", "collision cost", "solved", "CPU [s/clip]", "CPU, ratio", "memory [MB]", "velocity [deg]",
              "joint jerk [rad/s^3]")  # fmt: skip
    note = (
        f"In each cell ours over {clips} clips, then the paper's over {paper_figures.HORIZON_CLIPS}, the ten longest "
        "of each of 13 objects, which are not here. Its medians are over the 87 clips that all completed, its times "
        "wall time on another machine; its memory is a median too, ours that of the largest clip."
    )
    show("Beside the paper's Appendix B", header, rows, note)


def main(arguments: Arguments) -> None:
    weights = sorted({0.0, arguments.clearance})
    results = [run_fresh(measure, arguments, name, weight) for name in arguments.horizons for weight in weights]
    solved = [{clip["clip"] for clip in result["clips"] if "failed" not in clip} for result in results]
    counted = set.intersection(*solved)
    clips = results[0]["clips"]
    summaries = [summary(result, counted) for result in results]
    header = ("horizon", "clips", "unsolved windows", "ik [ms/fr]", "traj [ms/fr]", "peak [MB]",
              *(title for _, title, *_ in FIGURES), "seams / elsewhere")  # fmt: skip
    kinds = {name for clip in clips for name in clip["objects"]}
    title = (
        f"{len(clips)} clips of {len(kinds)} objects, {sum(clip['frames'] for clip in clips)} frames, {arguments.robot}"
    )
    note = f"Medians over the {len(counted)} clips that all solved. Seams: jerk [m/s^3] within 2 frames of one."
    show(title, header, [row_of(result, len(clips)) for result in summaries], note)
    show_beside_paper(summaries, len(clips))
    seams = ("jerk_at_seams", "jerk_elsewhere")
    for result in results:
        result["clips"] = [{key: value for key, value in clip.items() if key not in seams} for clip in result["clips"]]
    write_json(arguments.json, {"results": summaries, "clips": results})


if __name__ == "__main__":
    pin_threads()
    main(tyro.cli(Arguments, description=__doc__))
