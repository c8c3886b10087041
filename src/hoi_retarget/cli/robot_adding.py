"""`hoi-retarget robots add`: a robot made of its maker's file, what was found, and how it does on a clip."""

from pathlib import Path

from hoi_retarget.cli.commands import AddRobot
from hoi_retarget.cli.jobs import write_file
from hoi_retarget.cli.robot_trials import Tried, page, tried
from hoi_retarget.cli.terminal import say, show_table, warn
from hoi_retarget.errors import ArgumentError, DrawingError, RobotError
from hoi_retarget.readers.open import builtin_scene
from hoi_retarget.robots import ROBOTS, load_robot, user_robots
from hoi_retarget.robots.adding.build import build_robot
from hoi_retarget.robots.adding.findings import Record
from hoi_retarget.robots.adding.hints import read_hints

USABLE, REFUSED = 1, 2
"""Exit codes beside 0."""


def add(action: AddRobot) -> int:
    """Add a robot; return 0 when all is well, 1 when it is usable with warnings, 2 when it is refused."""
    name = action.name or user_robots.name_of(action.file)
    user_robots.check_name(name)
    if name in {*ROBOTS, *(full.rpartition("_")[2] for full in ROBOTS)}:
        raise ArgumentError(f"{name} is a robot of this package. Choose another --name.")
    for clip in action.tried:
        if builtin_scene(Path(clip)) is None:
            raise ArgumentError(f"--try {clip}: name built-in clips, such as builtin:carry_box.")
    hints = read_hints(action.hints)
    try:
        built = build_robot(action.file, name, hints, action.meshes)
    except RobotError as refusal:
        warn(f"{action.file.name}: refused: {refusal}")
        return REFUSED
    rows = [(finding.level, finding.subject, finding.what, finding.hint) for finding in built.findings]
    show_table([("", "part", "taken for", "to change it"), *rows], words=(0, 1, 2, 3))
    say()
    trials = [tried(built.spec, built.mjcf, clip) for clip in action.tried]
    for trial in trials:
        say(f"{trial.name}: " + ", ".join(f"{what}{'' if holds else ' (!)'}" for what, holds in trial.gates))
    record = Record(built.findings, action.tried)
    folder = user_robots.save(built.spec, built.mjcf, record)
    _write_page(name, folder / user_robots.PAGE, record, trials)
    say()
    say(f"added: {name} ({folder}). Try it: hoi-retarget run CLIP --robot {name} --out results")
    well = all(holds for trial in trials for _, holds in trial.gates)
    return 0 if well and all(finding.level == "ok" for finding in built.findings) else USABLE


def _write_page(name: str, path: Path, record: Record, trials: list[Tried]) -> None:
    """Write the page of a robot that was added; without a way to draw it is added all the same."""
    try:
        content = page(load_robot(name), record.findings, trials)
    except DrawingError as error:
        warn(f"no page of {name} is made: {error}")
        return
    write_file("robots add", path, content)
    say(f"look at it: {path}")
