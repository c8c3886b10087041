"""Touch without sinking: how well robots' hands touch objects over recorded clips, and what goes through what.

Distances are those of the skins made from the makers' meshes and of the objects' exact triangles, in every frame. An
object that is a shell (*) has no inside: only its points inside links count, and gaps are from 1 mm off its surface.
Of an object that is known by its hull (+), the depth is in the hull.

    python benchmarks/contact.py --data ../shared/data/omomo --objects ../shared/data/objects --contact both
    python benchmarks/contact.py --results BATCH/unitree_g1 --verdicts    # counts, from the figures in the results
"""

from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from common import clip_files, pin_threads, show, write_json

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.evaluation import contact_figures, figures, penetration
from hoi_retarget.evaluation.comparison import Comparison, Figure
from hoi_retarget.evaluation.contact_figures import SurfaceCurves, surface_curves
from hoi_retarget.evaluation.thresholds import Level, by_kind, verdict_of
from hoi_retarget.motion.motion import Motion, Stage
from hoi_retarget.motion.motion_report import Report, Status
from hoi_retarget.motion.result_file import load
from hoi_retarget.readers.open import open_clip
from hoi_retarget.retargeting.config import Config, Scaling
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.robots import load_robot
from short_clips import taken

SURFACE = (
    penetration.penetration_mean_m,
    penetration.penetration_p95_m,
    penetration.penetration_max_m,
    contact_figures.touch_share,
    contact_figures.touch_gap_p95_m,
    contact_figures.touch_place_m,
    penetration.self_penetration_max_m,
    penetration.link_below_floor_m,
)
KEPT = ("stance_float_m", "stance_slide_mps", "body_jerk_mps3", "body_jerk_max_mps3", "body_pose_deviation_deg")
KEPT += ("link_velocity_direction_deg", "relative_hand_rotation_deg", "joint_range_margin_rad")
KEPT += ("joint_speed_margin_radps", "trunk_deviation_deg", "trunk_deviation_p95_deg", "trunk_lean_p95_deg")
KEPT += ("palm_touch_share", "fingertip_touch_share", "hand_slip_mps", "hand_slip_fast_share", "hand_wander_excess_m")
KEPT += ("person_slip_mps", "person_wander_m")
COLUMNS: tuple[Figure, ...] = (
    *SURFACE,
    *(figure for name in KEPT for figure in figures.FIGURES if figure.name == name),
)
DEEP, SELF_DEEP = 5e-3, 2e-3
BY_PALM = "palm_touch_share"
"""Figure that rigid hands seldom pass."""


@dataclass(frozen=True)
class Arguments:
    """Measure contact over the clips of a folder."""

    data: Path = Path("../shared/data/omomo")
    objects: Path = Path("../shared/data/objects")
    robot: str = "unitree_g1"
    contact: Literal["surface", "landmark", "both"] = "surface"
    object_scale: float | None = 1.0
    """1 keeps objects at captured size; None is the robot's default."""
    clips: tuple[str, ...] = ()
    """Only these clips, by name."""
    limit: int | None = None
    """Only so many clips, spread evenly over their names."""
    every: int = 1
    """Look at surfaces in every so many frames only: quicker, and maxima are too low."""
    jobs: int = 1
    json: Path | None = None
    results: Path | None = None
    """Judge the results of `run` in this folder in place of solving; they may be of another version."""
    verdicts: bool = False
    """Count the verdicts on those results by the figures that they hold, and do nothing else."""


def measured(file: Path, arguments: Arguments, contact: str) -> dict[str, Any]:
    """Return the figures of one clip."""
    clip = open_clip(file, ReadOptions(objects=arguments.objects))
    model = load_robot(arguments.robot)
    scaling = Scaling() if arguments.object_scale is None else Scaling(object_scale=arguments.object_scale)
    if arguments.results is None:
        motion = retarget(clip, model, Config(scaling=scaling, contact=contact))  # pyright: ignore[reportArgumentType]
        reported = motion.report.figures
    else:
        motion = load(arguments.results / f"{file.stem}.npz")
        reported = figures.evaluate(motion, clip, model)
    seconds = {stage: spent for stage, spent in motion.report.cpu_seconds.items() if stage != "metrics"}
    view = compared(motion, clip, arguments.every, arguments.robot)
    curves = view.cached(surface_curves)
    kinds = set(motion.report.object_surfaces.values())
    windows = motion.stages[-1].windows
    return {
        "clip": clip.name,
        "mark": "*" * ("shell" in kinds) + "+" * ("hull" in kinds),
        "frames": clip.frames,
        "worst_link": worst_link(curves),
        "solved": all(window.status is Status.SOLVED for window in windows),
        "iterations": sum(window.iterations for window in windows),
        "ms_a_frame": 1e3 * sum(seconds.values()) / clip.frames,
        **{name: reported[name] for name in KEPT},
        **{figure.name: figure.measure(view) for figure in SURFACE if figure.measure is not None},
    }


def worst_link(curves: SurfaceCurves) -> str:
    """Return the link that is deepest in an object, or an object in it; a dash where nothing is."""
    deepest = curves.depth.max(axis=(0, 2), initial=0.0)
    return curves.links[int(deepest.argmax())] if deepest.max(initial=0.0) > 0.0 else "-"


def compared(motion: Motion, clip: Clip, every: int, robot: str) -> Comparison:
    """Return the comparison, of every so many frames from the first that counts on."""
    model = load_robot(robot)
    whole = Comparison(motion, clip, 0, model.forward(motion.qpos))
    if every == 1:
        return whole
    frames = np.arange(whole.first, clip.frames, every)
    arrays = ("object_pos", "object_quat", "contact_flags", "contact_object", "contact_points", "stance_flags")
    cut = {name: getattr(motion, name)[frames] for name in arrays}
    stages = (Stage("every", motion.qpos[frames]),)
    part = replace(motion, stages=stages, first_source_frame=1, report=Report(), **cut)  # Its frames are others.
    shorter = replace(taken(clip, frames), first_source_frame=1)
    return Comparison(part, shorter, 0, model.forward(part.qpos))


def report(name: str, results: list[dict[str, Any]]) -> dict[str, Any]:
    """Print the clips and what the issue asks of them together, and return it."""
    facts = ("worst_link", "solved", "iterations", "ms_a_frame")
    header = ["clip", *(figure.header for figure in COLUMNS), *facts]
    rows = [
        [
            f"{result['clip']} {result['mark']}",
            *(figure.text(result[figure.name]) for figure in COLUMNS),
            *(result["worst_link"], "yes" if result["solved"] else "NO", str(result["iterations"])),
            f"{result['ms_a_frame']:.2f}",
        ]
        for result in results
    ]
    show(name, header, rows)

    def column(key: str) -> np.ndarray:
        return np.array([result[key] for result in results if result[key] is not None])

    deepest, inside = column("penetration_max_m"), column("self_penetration_max_m")
    lines = {
        "penetration in contact frames, mean of clips [mm]": 1e3 * column("penetration_mean_m").mean(),
        "p95 over a clip's frames, mean of clips [mm]": 1e3 * column("penetration_p95_m").mean(),
        "deepest of a clip, median [mm]": 1e3 * np.median(deepest),
        "deepest of a clip, mean [mm]": 1e3 * deepest.mean(),
        "clips above 5 mm": int((deepest > DEEP).sum()),
        "hand-frames with gap within 2 mm, mean of clips [%]": 1e2 * column("touch_share").mean(),
        "gap p95, mean of clips [mm]": 1e3 * column("touch_gap_p95_m").mean(),
        "place on the object, mean of clips [mm]": 1e3 * column("touch_place_m").mean(),
        "self-penetration above 2 mm, clips": int((inside > SELF_DEEP).sum()),
        "self-penetration, mean of clips [mm]": 1e3 * inside.mean(),
        "floor, any link, deepest, mean of clips [mm]": 1e3 * column("link_below_floor_m").mean(),
        "soles off the floor in stance, mean of clips [mm]": 1e3 * column("stance_float_m").mean(),
        "foot slide, mean of clips [cm/s]": 1e2 * column("stance_slide_mps").mean(),
        "jerk, mean of clips [m/s^3]": column("body_jerk_mps3").mean(),
        "jerk, worst clip [m/s^3]": column("body_jerk_mps3").max(),
        "largest jerk, mean of clips [m/s^3]": column("body_jerk_max_mps3").mean(),
        "pose [deg]": column("body_pose_deviation_deg").mean(),
        "velocity direction [deg]": column("link_velocity_direction_deg").mean(),
        "hand rotation [deg]": column("relative_hand_rotation_deg").mean(),
        "trunk off the person's [deg]": column("trunk_deviation_deg").mean(),
        "trunk off the person's, worst clip [deg]": column("trunk_deviation_deg").max(),
        "trunk off the person's, p95 [deg]": column("trunk_deviation_p95_deg").mean(),
        "lean off the person's, p95 [deg]": column("trunk_lean_p95_deg").mean(),
        "touch by 2 cm2 of palmar side [%]": 1e2 * column("palm_touch_share").mean(),
        "touch by a fingertip alone [%]": 1e2 * column("fingertip_touch_share").mean(),
        "hand slip where the person's holds still [mm/s]": 1e3 * column("hand_slip_mps").mean(),
        "frames of these above 10 cm/s [%]": 1e2 * column("hand_slip_fast_share").mean(),
        "hand wander beyond the person's [mm]": 1e3 * column("hand_wander_excess_m").mean(),
        "the person's own slip there [mm/s]": 1e3 * column("person_slip_mps").mean(),
        "the person's own wander [mm]": 1e3 * column("person_wander_m").mean(),
        "clips with joint range or speed violated": int(
            ((column("joint_range_margin_rad") < 0.0) | (column("joint_speed_margin_radps") < 0.0)).sum()
        ),
        "clips solved to tolerance": int(column("solved").sum()),
        "CPU [ms a frame], mean of clips": column("ms_a_frame").mean(),
    }
    show(f"{name}: {len(results)} clips", ("figure", "value"), [(key, f"{value:.4g}") for key, value in lines.items()])
    worst = {
        "deepest": [(result["clip"], result["penetration_max_m"]) for result in results],
        "in itself": [(result["clip"], result["self_penetration_max_m"]) for result in results],
        "gap p95": [(result["clip"], result["touch_gap_p95_m"] or 0.0) for result in results],
        "below floor": [(result["clip"], result["link_below_floor_m"]) for result in results],
    }
    for what, values in worst.items():
        five = sorted(values, key=lambda pair: -pair[1])[:5]
        print(f"worst, {what}: " + ", ".join(f"{clip} {1e3 * value:.1f} mm" for clip, value in five))
    return {"means": {key: float(value) for key, value in lines.items()}, "clips": results}


def count_verdicts(folder: Path) -> dict[str, Any]:
    """Print how many results pass, warn and fail by either light, and what for; return the counts."""
    verdicts = {path.name: verdict_of(load(path)) for path in sorted(folder.glob("*.npz*"))}
    lights = {name: Counter(getattr(one, name).level for one in verdicts.values()) for name in ("motion", "physics")}
    without = Counter(
        max((reason.level for reason in one.motion.reasons if reason.threshold.name != BY_PALM), default=Level.PASS)
        for one in verdicts.values()
    )
    reasons = Counter((reason.kind, reason.threshold.name) for one in verdicts.values() for reason in one.reasons)
    rows = {**lights, f"motion without {BY_PALM}": without}
    show(
        f"{len(verdicts)} results",
        ("light", *map(str, Level)),
        [(k, *(str(v[x]) for x in Level)) for k, v in rows.items()],
    )
    show("reasons", ("kind", "figure", "results"), [(*key, str(number)) for key, number in reasons.most_common()])
    for name, one in verdicts.items():
        if one.level is Level.FAIL:
            print(f"{name}: {by_kind(one.motion.reasons)}")
    return {name: {str(level): counts[level] for level in Level} for name, counts in rows.items()}


def main(arguments: Arguments) -> None:
    """Measure every clip, and print per clip and together."""
    if arguments.verdicts:
        if arguments.results is None:
            raise SystemExit("--verdicts counts those of stored results: name their folder with --results.")
        write_json(arguments.json, count_verdicts(arguments.results))
        return
    files = [
        file
        for file in clip_files(arguments.data, arguments.limit)
        if not arguments.clips or file.stem in arguments.clips
    ]
    kinds = ("landmark", "surface") if arguments.contact == "both" else (arguments.contact,)
    with ProcessPoolExecutor(arguments.jobs, mp_context=get_context("spawn")) as pool:
        asked = {kind: [pool.submit(measured, file, arguments, kind) for file in files] for kind in kinds}
        results = {
            kind: report(f"--contact {kind}, {arguments.robot}", [future.result() for future in futures])
            for kind, futures in asked.items()
        }
    write_json(arguments.json, results)


if __name__ == "__main__":
    pin_threads()
    main(tyro.cli(Arguments))
