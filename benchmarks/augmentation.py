"""Objects of other sizes, the paper's augmentation: do hands stay at the same places of a smaller or larger object?

One clip of each kind of object and some sizes, from a quarter to one and a half, on top of the scale that suits the
robot. Places are compared on the scaled surface, in every frame. `--picture` draws box and chair.

    python benchmarks/augmentation.py --data ../shared/data/omomo --objects ../shared/data/objects --picture sizes.png
"""

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from common import clip_files, one_of_each_first, pin_threads, show, write_json
from PIL import Image
from scores import mean

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import SolveError
from hoi_retarget.evaluation import Comparison, figures_of
from hoi_retarget.motion.motion_report import Status
from hoi_retarget.readers.open import open_clip
from hoi_retarget.retargeting.config import Config, Scaling
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.robots import load_robot

SIZES = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5)
COLUMNS = (
    ("contact_gap_m", "contact gap, landmark [mm]", 1e3),
    ("touch_share", "hands that touch [%]", 1e2),
    ("touch_place_m", "place on the scaled surface [mm]", 1e3),
    ("penetration_mean_m", "penetration, mean [mm]", 1e3),
    ("penetration_p95_m", "p95 [mm]", 1e3),
    ("body_jerk_mps3", "jerk [m/s^3]", 1.0),
)
COLOURS = 128  # Of the picture, which is a third as large then.
PICTURED = ("largebox", "woodchair")


@dataclass(frozen=True)
class Arguments:
    """Retarget clips with objects of several sizes."""

    data: Path | None = None
    """Folder with recorded clips; without it, two built-in ones."""
    objects: Path | None = None
    robots: tuple[str, ...] = ("unitree_g1", "unitree_h2")
    sizes: tuple[float, ...] = SIZES
    kinds: tuple[str, ...] = ()
    """Only these kinds of objects."""
    jobs: int = 1
    picture: Path | None = None
    """A picture of box and chair to write, with the robots' own meshes where they were fetched."""
    json: Path | None = None


def clips_of(arguments: Arguments) -> list[Path]:
    """Return the shortest clip of each kind of object."""
    if arguments.data is None:
        return [Path("builtin:carry_box"), Path("builtin:move_chair")]
    kinds: dict[str, Path] = {}
    for file in one_of_each_first(clip_files(arguments.data, None)):
        kinds.setdefault(kind_of(file), file)
    return [kinds[kind] for kind in sorted(kinds) if kind in (arguments.kinds or kinds)]


def kind_of(file: Path) -> str:
    return file.stem.split("_")[1]


def config_of(size: float, contact: Literal["surface", "landmark"]) -> Config:
    return Config(scaling=Scaling(size_multiplier=size), contact=contact)


def measured(file: Path, objects: Path | None, robot: str, size: float) -> dict[str, Any]:
    """Return the figures of one clip at one size; the gap of landmarks from a solve of its own."""
    clip, model = open_clip(file, ReadOptions(objects=objects)), load_robot(robot)
    found: dict[str, Any] = {"clip": clip.name, "object": clip.objects[0].name, "robot": robot, "size": size}
    try:
        motion = retarget(clip, model, config_of(size, "surface"))
        landmark = retarget(clip, model, config_of(size, "landmark"))
    except SolveError as error:
        return {**found, "failed": str(error)}
    figures = dict(figures_of(Comparison(motion, clip, 0, model.forward(motion.qpos))))
    figures["contact_gap_m"] = landmark.report.figures["contact_gap_m"]
    return {
        **found,
        **{key: figures[key] for key, *_ in COLUMNS},
        "object_scale": motion.object_scale.tolist(),
        "unreached": len(motion.report.unreached_contacts),
        "unreached_landmark": len(landmark.report.unreached_contacts),
        "solved": all(window.status is Status.SOLVED for window in motion.stages[-1].windows),
    }


def mean_row(results: list[dict[str, Any]], robot: str, size: float) -> dict[str, Any]:
    """Return means over the clips of one robot and size."""
    rows = [row for row in results if (row["robot"], row["size"]) == (robot, size)]
    done = [row for row in rows if "failed" not in row]
    return {
        "robot": robot,
        "size": size,
        "clips": len(rows),
        "failed": len(rows) - len(done),
        "solved": sum(row["solved"] for row in done),
        "clips_with_unreached": sum(row["unreached"] > 0 for row in done),
        "clips_with_unreached_landmark": sum(row["unreached_landmark"] > 0 for row in done),
        **{key: mean([row[key] for row in done]) for key, *_ in COLUMNS},
    }


def draw(files: list[Path], arguments: Arguments, out: Path) -> None:
    """Write box and chair, a row for each robot, a column for each size, at the middle of the longest contact."""
    from hoi_retarget.studio.offscreen import film  # noqa: PLC0415  # only pictures need a way to draw
    from hoi_retarget.studio.scene.camera import CameraSettings  # noqa: PLC0415
    from hoi_retarget.studio.scene.scene import SceneItem  # noqa: PLC0415

    rows = []
    for file in (file for file in files if arguments.data is None or kind_of(file) in PICTURED):
        clip = open_clip(file, ReadOptions(objects=arguments.objects))
        time = middle_of_contact(clip) / clip.fps
        for robot in arguments.robots:
            model, shown = load_robot(robot), []
            for size in arguments.sizes:
                motion = retarget(clip, model, config_of(size, "surface"))
                shown.append(SceneItem(f"x{size:g}", motion, model, clip))
            filmed = film.panels(shown, "robot")
            view = CameraSettings(film.good_azimuth(shown))
            with film.panel_renderer(filmed, view, 260 * len(shown), 300) as picture:
                rows.append(picture(time))
    Image.fromarray(np.concatenate(rows)).quantize(COLOURS).save(out, optimize=True)


def middle_of_contact(clip: Clip) -> int:
    """Return the middle of the frames in which most hands touch."""
    count = np.sum([track.active for track in clip.contacts if "hand" in track.part], axis=0)
    frames = np.flatnonzero(count == count.max())
    return int(frames[len(frames) // 2])


def text(row: dict[str, Any]) -> tuple[str, ...]:
    values = ("-" if row[key] is None else f"{row[key] * scale:.1f}" for key, _, scale in COLUMNS)
    return (
        f"{row['size']:g}",
        row["robot"],
        *values,
        f"{row['clips_with_unreached']}, {row['clips_with_unreached_landmark']} of {row['clips']}",
        f"{row['solved']} of {row['clips']}",
    )


def main(arguments: Arguments) -> None:
    """Measure every clip, robot and size; print means."""
    files = clips_of(arguments)
    asked: list[tuple[Path, str, float]] = [
        (file, robot, size) for file in files for robot in arguments.robots for size in arguments.sizes
    ]
    work: Callable[..., dict[str, Any]] = measured
    with ProcessPoolExecutor(arguments.jobs, mp_context=get_context("spawn")) as pool:
        futures = [pool.submit(work, file, arguments.objects, robot, size) for file, robot, size in asked]
        results = [future.result() for future in futures]
    means = [mean_row(results, robot, size) for robot in arguments.robots for size in arguments.sizes]
    header = (
        "size",
        "robot",
        *(title for _, title, _ in COLUMNS),
        "clips with a contact out of reach, by landmark",
        "solved",
    )
    show(f"{len(files)} clips, a kind of object each", header, [text(row) for row in means])
    if arguments.picture is not None:
        draw(files, arguments, arguments.picture)
    write_json(arguments.json, {"means": means, "clips": results})


if __name__ == "__main__":
    pin_threads()
    main(tyro.cli(Arguments, description=__doc__))
