"""`hoi-retarget robots`: list, show, check, remove; `robot_adding.py` adds."""

import os
from dataclasses import asdict
from importlib.util import find_spec
from math import degrees
from pathlib import Path

from hoi_retarget.cli.commands import (
    TRIED,
    AddRobot,
    CheckRobot,
    FetchMeshes,
    ListRobots,
    RemoveRobot,
    Robots,
    ShowRobot,
)
from hoi_retarget.cli.jobs import check_json, check_writable, write_file, write_json
from hoi_retarget.cli.robot_adding import add
from hoi_retarget.cli.robot_trials import page, tried
from hoi_retarget.cli.terminal import Working, say, show_table
from hoi_retarget.errors import ArgumentError
from hoi_retarget.robots import ROBOTS, load_robot, robot, user_robots
from hoi_retarget.robots.check import check, has_errors
from hoi_retarget.robots.fetched_meshes import (
    SOURCES,
    fetch_meshes,
    mesh_names,
    read_folder,
    remove_meshes,
)
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.spec import RobotSpec
from hoi_retarget.robots.tables import joint_table, role_table

MENAGERIE = Path("menagerie")


def execute(command: Robots) -> int:
    """Do what is asked about robots."""
    match command.action:
        case AddRobot() as action:
            return add(action)
        case RemoveRobot() as action:
            say(f"removed: {user_robots.remove(action.name)}")
            return 0
        case FetchMeshes() as action:
            return _meshes(action)
        case ListRobots() as action:
            return _list(action)
        case ShowRobot() as action:
            return _show(action)
        case CheckRobot() as action:
            return _check(action)


def _meshes(action: FetchMeshes) -> int:
    spec = robot(action.name)
    if spec.name not in SOURCES:
        raise ArgumentError(
            f"{spec.name} was added from its maker's file, with the meshes that it found then. "
            "Add it again with --meshes DIR where some were missing."
        )
    if action.remove:
        removed = remove_meshes(spec)
        say(f"removed: {removed}" if removed else f"No meshes of {spec.name} were fetched.")
        return 0
    source = SOURCES[spec.name]
    read = source.place.read if action.folder is None else read_folder(action.folder)
    say(f"Fetching {len(mesh_names(spec))} meshes of {spec.title}: {action.folder or source.place}.")
    say(f"Terms: {source.licence}.")
    with Working("fetching", None):
        folder = fetch_meshes(spec, read, source.licence)
    size = sum(path.stat().st_size for path in folder.iterdir()) / 1e6
    say(f"kept: {folder} ({size:.1f} MB). Pictures show them from now on.")
    return 0


def _list(action: ListRobots) -> int:
    check_json(action.json)
    sizes = {"root": "shrinks with the robot", "captured": "as captured"}
    specs = [*ROBOTS.values(), *(user_robots.load(name) for name in user_robots.names())]
    rows = [(spec.name, spec.title, f"{spec.stature:.3f}", sizes[spec.object_size]) for spec in specs]
    show_table([("robot", "is", "stature [m]", "object size"), *rows], words=(0, 1, 3))
    write_json(
        action.json,
        [
            {"name": spec.name, "title": spec.title, "stature_m": spec.stature, "object_size": spec.object_size}
            for spec in specs
        ],
    )
    return 0


def _show(action: ShowRobot) -> int:
    spec = robot(action.name)
    if action.picture is not None:
        _check_picture(action.picture, action.meshes)
    if action.page is not None:
        _check_page(action.page)
    check_json(action.json)
    model = load_robot(action.name)
    say(f"{spec.name}: {spec.title}")
    say(f"  {spec.provenance}")
    say(f"  {spec.mjcf}")
    say()
    header = ("dof", "joint", "lower [deg]", "upper [deg]", "speed [rad/s]", "effort [N m]", "home [deg]")
    rows = [
        (
            *(str(index), row.joint, f"{degrees(row.lower):.1f}", f"{degrees(row.upper):.1f}"),
            *(f"{row.speed_limit:g}", "-" if row.effort is None else f"{row.effort:g}"),
            f"{degrees(spec.home.get(row.joint, 0.0)):.1f}",
        )
        for index, row in enumerate(joint_table(model))
    ]
    show_table([header, *rows], words=(1,))
    say()
    places = [
        (row.site, row.body, " ".join(f"{number:.4f}" for number in row.place), row.follows)
        for row in role_table(model)
    ]
    show_table([("site", "on", "at [m]", "follows"), *places], words=(0, 1, 2, 3))
    write_json(
        action.json,
        {
            "name": spec.name,
            "joints": [{**asdict(row), "home": spec.home.get(row.joint, 0.0)} for row in joint_table(model)],
            "sites": [{**asdict(row), "place": list(row.place)} for row in role_table(model)],
        },
    )
    if action.picture is not None:
        _draw(spec, action.picture, action.meshes)
    if action.page is not None:
        _write_page(model, action.page)
    return 0


def _check_page(path: Path) -> None:
    if path.suffix.lower() not in {".html", ".htm"}:
        raise ArgumentError(f"--page {path}: pages are HTML. Name a file that ends in .html.")
    check_writable("--page", path.parent)


def _write_page(model: RobotModel, path: Path) -> None:
    record = user_robots.record_of(model.spec.name)
    mjcf = model.spec.mjcf.read_text(encoding="utf-8")
    trials = [tried(model.spec, mjcf, clip) for clip in record.tried or TRIED]
    write_file("--page", path, page(model, record.findings, trials))
    say()
    say(f"written: {path}")


def _check_picture(path: Path, meshes: Path | None) -> None:
    if path.suffix.lower() != ".png":
        raise ArgumentError(f"--picture {path}: pictures are written as PNG. Name a file that ends in .png.")
    if meshes == MENAGERIE and find_spec("mujoco_menagerie") is None:
        raise ArgumentError(
            "--meshes menagerie: the package mujoco-menagerie is missing. "
            "Install it with: pip install '.[menagerie]' in a clone of this project."
        )
    check_writable("--picture", path.parent)


def _draw(spec: RobotSpec, path: Path, meshes: Path | None) -> None:
    # What draws is imported only where something is drawn.
    from hoi_retarget.viewers.offscreen.robot_picture import picture, png  # noqa: PLC0415

    write_file("--picture", path, png(picture(spec, meshes=vendor_meshes(spec, meshes))))
    say()
    say(f"written: {path}")


def vendor_meshes(spec: RobotSpec, folder: Path | None) -> Path | None:
    """Return the folder of vendor meshes that `--meshes` names, of a package where it says `menagerie`."""
    from hoi_retarget.viewers.scene.vendor_meshes import menagerie_meshes  # noqa: PLC0415

    return menagerie_meshes(spec) if folder == MENAGERIE else folder


def _check(action: CheckRobot) -> int:
    """Print every result; return 0 unless one is an error."""
    path = Path(action.subject)
    is_own = path.suffix.lower() == ".xml" and action.subject not in user_robots.names()
    if not is_own and action.subject not in ROBOTS and os.path.exists(path) and path.suffix.lower() != ".urdf":  # noqa: PTH110
        raise ArgumentError(
            f"{path}: descriptions of robots are MJCF (.xml) or URDF (.urdf). Name one of them, or a robot."
        )
    results = check(path if is_own else robot(action.subject))
    for result in results:
        say(f"{result.level:6}{result.where}: {result.what}" + (f". {result.advice}" if result.advice else ""))
    return 1 if has_errors(results) else 0
