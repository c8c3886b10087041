"""Makers' files of humanoids, added without a hint: what each is, and how it does on recorded clips.

Prints the tables of docs/robots.md. `--folders` are `../shared/data/robots` and unpacked packages of the Python package
index; files that are not there are left out, saying so. `--sheet` draws all robots into one picture instead.
"""

import os
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import numpy as np
import tyro
from common import pin_threads
from PIL import Image, ImageDraw, ImageFont

from hoi_retarget.cli.robots import without_shapes
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import DrawingError, RobotError
from hoi_retarget.evaluation.thresholds import judged_figures
from hoi_retarget.readers.open import open_clip
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.robots import ROBOTS, load_robot, robot, user_robots
from hoi_retarget.robots.adding.build import BuiltRobot, build_robot
from hoi_retarget.robots.adding.findings import Hints
from hoi_retarget.robots.model import RobotModel

CLIPS = ("sub3_largebox_003", "sub8_suitcase_000", "sub2_woodchair_001")
FILES = (
    ("Unitree G1, MJCF", "unitree_g1/*.xml"),
    ("Unitree H2", "unitree_h2/*.urdf"),
    ("Unitree H1", "unitree_h1/*.urdf"),
    ("Unitree G1, 23 joints", "unitree_g1_23/*.urdf"),
    ("Unitree G1 with hands", "unitree_g1_hands/*.urdf"),
    ("Unitree R1", "unitree_r1/*.urdf"),
    ("Booster T1", "booster_t1/*.urdf"),
    ("Fourier N1", "fourier_n1/*.xml"),
    ("HighTorque Hi", "hightorque_hi/*.urdf"),
    ("OpenLoong", "openloong/*.xml"),
    ("ToddlerBot", "toddlerbot/*.xml"),
    ("Unitree H1-2, Inspire hands", "unitree_h1_2_inspire/*.urdf"),
    ("Atlas", "atlas/*.urdf"),
    ("Valkyrie", "valkyrie/*.urdf"),
    ("NAO", "nao/*.urdf"),
    ("JAXON", "jaxon/*.urdf"),
    ("EngineAI PM01", "engineai_pm01/pm_v2.xml"),
    ("AgiBot X1", "agibot_x1/*.xml"),
    ("Digit", "digit/*.urdf"),
    ("Fourier GR1T1", "assets/urdf/gr1t1.urdf"),
    ("Fourier GR1T2", "assets/urdf/gr1t2.urdf"),
    ("GR1T2 with hands", "assets/urdf/gr1t2_fourier_hand_6dof.urdf"),
    ("Fourier GR2", "assets/urdf/gr2t2.urdf"),
    ("GR2 with hands", "assets/urdf/gr2t2_fourier_hand_12dof.urdf"),
    ("Fourier GR3", "assets/urdf/gr3.urdf"),
    ("GR3 with hands", "assets/urdf/gr3_fourier_hand_12dof.urdf"),
    ("QingLong", "assets/urdf/qinglong.urdf"),
    ("PAL Talos", "robots/talos_full_v2.urdf"),
    ("Talos, reduced", "robots/talos_reduced.urdf"),
    ("Romeo", "romeo_description/urdf/romeo.urdf"),
    ("simple_humanoid", "urdf/simple_humanoid.urdf"),
    ("iCub (example-robot-data)", "robots/icub.urdf"),
    ("Apptronik Apollo", "apptronik_apollo/apptronik_apollo.xml"),
    ("G1 (menagerie)", "mujoco_menagerie/unitree_g1/g1.xml"),
    ("G1 with hands (menagerie)", "unitree_g1/g1_with_hands.xml"),
    ("H1 (menagerie)", "mujoco_menagerie/unitree_h1/h1.xml"),
    ("T1 (menagerie)", "mujoco_menagerie/booster_t1/t1.xml"),
    ("JVRC-1", "jvrc*.urdf"),
    ("iCub (icub-models)", "iCubGazeboV2_7/model.urdf"),
    ("Galaxea R1 Pro", "galaxea_r1pro/*.xml"),
    ("Centauro", "urdf/centauro.urdf"),
    ("ROBOTIS OP3", "robotis_op3/op3.xml"),
    ("Berkeley Humanoid", "berkeley_humanoid/*.xml"),
    ("Bolt", "robots/bolt.urdf"),
    ("Alexander, lower half", "urdf/alexander_v1.lowerBodyOnly.urdf"),
    ("Alex", "urdf/alex_nub_hands.urdf"),
    ("PR2", "urdf/pr2.urdf"),
    ("Baxter", "urdf/baxter.urdf"),
    ("Go2", "urdf/go2.urdf"),
    ("Tiago", "robots/tiago.urdf"),
)
"""What each file is of, and where it is below one of the folders."""
_UNSEEN = {
    *("Unitree H1", "Unitree G1, 23 joints", "Unitree R1", "Fourier N1", "HighTorque Hi", "OpenLoong"),
    "simple_humanoid",
}
"""Files that lack meshes of links that are seen, or have other shapes: a contact sheet leaves them out."""
_CELL, _COLUMNS, _LINE = (150, 242), 9, 13  # Of a contact sheet [px].


@dataclass(frozen=True)
class Arguments:
    """What is measured."""

    folders: tuple[Path, ...] = (Path("../shared/data/robots"),)
    """In which the files are."""
    clips: Path = Path("../shared/data/omomo")
    """Folder of the clips."""
    objects: Path = Path("../shared/data/objects")
    """Folder of their objects."""
    sheet: Path | None = None
    """Draw the robots into this file (.jpg) instead."""


def main() -> None:
    arguments = tyro.cli(Arguments)
    pin_threads()
    with tempfile.TemporaryDirectory() as folder:
        if arguments.sheet is not None:
            draw_sheet(arguments, Path(folder))
            return
        print_tables(arguments, Path(folder))


def print_tables(arguments: Arguments, folder: Path) -> None:
    print(
        "| robot | joints | home pose missed [deg] | converged | gap [mm] | contacts unreached, worst clip [%] "
        "| pose deviation [deg] | ranges | CPU [s] |\n|---|---|---|---|---|---|---|---|---|"
    )
    for name in ROBOTS:
        print(row(f"shipped: {name}", "-", "-", load_robot(name), arguments, "-"), flush=True)
    refused = []
    for title, path in found(arguments):
        start = process_time()
        try:
            built = build_robot(path, "tried", Hints())
        except RobotError as error:
            refused.append(f"{title}: {error}")
            continue
        seconds = f"{process_time() - start:.1f}"
        joints = f"{len(built.spec.speed_limits)}" + (f" + {len(built.spec.held)}" if built.spec.held else "")
        missed = f"{max(built.home.missed_deg.values()):.1f}"
        model = without_shapes(built.spec, built.mjcf, folder)
        print(row(title, joints, missed, model, arguments, seconds), flush=True)
    print("\nRefused:", *refused, sep="\n- ")


def found(arguments: Arguments) -> Iterator[tuple[str, Path]]:
    """Yield titles and files, those that are there."""
    for title, pattern in FILES:
        paths = [path for folder in arguments.folders for path in sorted(folder.rglob(pattern))]
        if paths:
            yield title, paths[0]
        else:
            print(f"not there: {title} ({pattern})", file=sys.stderr)


def row(  # noqa: PLR0913, PLR0917 - the columns
    title: str, joints: str, missed: str, model: RobotModel, arguments: Arguments, seconds: str
) -> str:
    """Return a row of the table, of a robot's motions of the clips."""
    motions = []
    for name in CLIPS:
        clip = open_clip(arguments.clips / f"{name}.pt", ReadOptions(objects=arguments.objects))
        motions.append(retarget(clip, model, Config(contact="landmark")))
    figures = [judged_figures(motion, model) for motion in motions]
    gaps = " / ".join(f"{1000 * (one['contact_gap_m'] or 0.0):.1f}" for one in figures)
    poses = " / ".join(f"{one['body_pose_deviation_deg']:.0f}" for one in figures)
    unreached = f"{100 * max(one['unreached_share'] or 0.0 for one in figures):.0f}"
    kept = all((one["joint_range_margin_rad"] or 0.0) >= 0.0 for one in figures)
    converged = f"{sum(motion.converged for motion in motions)}/{len(motions)}"
    cells = (title, joints, missed, converged, gaps, unreached, poses, "kept" if kept else "not kept", seconds)
    return f"| {' | '.join(cells)} |"


def draw_sheet(arguments: Arguments, folder: Path) -> None:
    """Draw all robots that can be added, and those of the package with the maker's meshes where they were fetched."""
    from hoi_retarget.studio.offscreen.robot_portraits import picture  # noqa: PLC0415
    from hoi_retarget.studio.scene.camera import CameraSettings  # noqa: PLC0415

    cells = [(name, picture(robot(name), views=(CameraSettings(155.0, -6.0),), height=_CELL[1])) for name in ROBOTS]
    os.environ[user_robots.FOLDER_VARIABLE] = str(folder)
    for index, (title, path) in enumerate(item for item in found(arguments) if item[0] not in _UNSEEN):
        try:
            built: BuiltRobot = build_robot(path, f"robot{index}", Hints())
        except RobotError:
            continue
        user_robots.save(built.spec, built.mjcf)
        shown = picture(robot(f"robot{index}"), views=(CameraSettings(155.0, -6.0),), height=_CELL[1])
        cells.append((title, shown))
    rows = -(-len(cells) // _COLUMNS)
    sheet = Image.new("RGB", (_COLUMNS * _CELL[0], rows * (_CELL[1] + 2 * _LINE)), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(_LINE)
    for index, (title, shown) in enumerate(cells):
        x, y = (index % _COLUMNS) * _CELL[0], (index // _COLUMNS) * (_CELL[1] + 2 * _LINE)
        sheet.paste(Image.fromarray(np.ascontiguousarray(shown)), (x, y))
        pen.text((x + _CELL[0] // 2, y + _CELL[1] + 3), title, (30, 34, 40), font, anchor="ma")
    assert arguments.sheet is not None
    sheet.save(arguments.sheet, quality=82, optimize=True)


if __name__ == "__main__":
    try:
        main()
    except DrawingError as error:
        sys.exit(str(error))
