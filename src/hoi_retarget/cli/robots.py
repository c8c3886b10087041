"""Robots listed, shown, checked, added with a trial on clips, and removed; their meshes fetched."""

import os
import tempfile
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from functools import partial
from math import degrees
from pathlib import Path

import mujoco

from hoi_retarget.cli import commands
from hoi_retarget.cli.output_checks import check_json, check_writable, write_file, write_json
from hoi_retarget.cli.terminal import Working, say, show_table, warn
from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import ArgumentError, DrawingError, HoiRetargetError, RobotError
from hoi_retarget.evaluation.thresholds import judged_figures
from hoi_retarget.motion.motion import Motion
from hoi_retarget.readers.builtin_clips import builtin_scene
from hoi_retarget.readers.open import open_clip
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.robots import ROBOTS, load_robot, robot, user_robots
from hoi_retarget.robots import fetched_meshes as mesh_sources
from hoi_retarget.robots.adding.build import build_robot
from hoi_retarget.robots.adding.findings import Record, RobotFinding, read_hints
from hoi_retarget.robots.model import RobotModel, load_model
from hoi_retarget.robots.robot_check import check, has_errors
from hoi_retarget.robots.robot_tables import joint_table, role_table
from hoi_retarget.robots.skin import make_skin
from hoi_retarget.robots.spec import RobotSpec
from hoi_retarget.studio.offscreen.robot_portraits import jpeg, picture, picture_of, png, representative_frame
from hoi_retarget.studio.report.robot_page import Trial, robot_page
from hoi_retarget.studio.scene.camera import fit_camera
from hoi_retarget.studio.scene.drawing import DrawnScene
from hoi_retarget.studio.scene.robot_shapes import robot_parts
from hoi_retarget.studio.scene.scene import SceneItem, make_scene

_MAX_GAP_M, _MAX_POSE_DEG, _MAX_POSE_OF_SHORT_ARMS_DEG, _MAX_LEAN_DEG = 0.002, 25.0, 30.0, 10.0
"""Bounds of trials: contacts' gap, angles from the person's pose, and difference of sideways lean."""
_MAX_COUPLING_ERROR_RAD = 0.05
_USABLE, _REFUSED = 1, 2  # Exit codes of `robots add` beside 0.


def execute_robots(command: commands.Robots) -> int:
    """Execute an action on robots."""
    match command.action:
        case commands.AddRobot() as action:
            return _add(action)
        case commands.RemoveRobot() as action:
            say(f"removed: {user_robots.remove(action.name)}")
            return 0
        case commands.FetchMeshes() as action:
            return _meshes(action)
        case commands.ListRobots() as action:
            return _list(action)
        case commands.ShowRobot() as action:
            return _show(action)
        case commands.CheckRobot() as action:
            return _check(action)


def _meshes(action: commands.FetchMeshes) -> int:
    spec = robot(action.name)
    if spec.name not in mesh_sources.SOURCES:
        raise ArgumentError(
            f"{spec.name} was added from its maker's file, with the meshes that it found then. "
            "Add it again with --meshes DIR where some were missing."
        )
    if action.remove:
        removed = mesh_sources.remove_meshes(spec)
        say(f"removed: {removed}" if removed else f"No meshes of {spec.name} were fetched.")
        return 0
    fetch_look(spec, action.folder)
    return 0


def fetch_look(spec: RobotSpec, folder: Path | None = None) -> None:
    """Fetch a robot's meshes, from a folder with the maker's files where given, and say where from and on which terms.

    Raises `ReadError`: they cannot be fetched, or are not what was expected; `WriteError`: the user's folder cannot be
    written.
    """
    source = mesh_sources.SOURCES[spec.name]
    read = source.read if folder is None else partial(mesh_sources.read_folder, folder)
    say(f"Fetching {len(mesh_sources.mesh_names(spec))} meshes of {spec.title}: {folder or source.place}.")
    say(f"Terms: {source.licence}.")
    with Working("fetching", None):
        kept = mesh_sources.fetch_meshes(spec, read, source.licence)
    size = sum(path.stat().st_size for path in kept.iterdir()) / 1e6
    say(f"kept: {kept} ({size:.1f} MB). Pictures show them from now on.")


def fetch_look_once(spec: RobotSpec) -> None:
    """Fetch a robot's meshes where they are not there yet; without them pictures show the surface touch is measured on.

    A robot that was added has its own; a network that fails is a warning.
    """
    if spec.name not in mesh_sources.SOURCES or mesh_sources.fetched_meshes(spec) is not None:
        return
    try:
        fetch_look(spec)
    except HoiRetargetError as error:
        warn(f"The maker's look is missing, pictures show a plainer robot: {error}")
    say()


def _list(action: commands.ListRobots) -> int:
    check_json(action.json)
    sizes = {"root": "shrinks with the robot", "captured": "as captured"}
    specs, damaged = list(ROBOTS.values()), False
    for name in user_robots.names():
        try:
            specs.append(user_robots.load(name))
        except RobotError as error:
            warn(str(error))
            damaged = True
    rows = [(spec.name, spec.title, f"{spec.stature:.3f}", sizes[spec.object_size]) for spec in specs]
    show_table([("robot", "is", "stature [m]", "object size"), *rows], words=(0, 1, 3))
    write_json(
        action.json,
        [
            {"name": spec.name, "title": spec.title, "stature_m": spec.stature, "object_size": spec.object_size}
            for spec in specs
        ],
    )
    return 1 if damaged else 0


def _show(action: commands.ShowRobot) -> int:
    spec = robot(action.name)
    if action.picture is not None:
        _check_picture(action.picture)
    if action.page is not None:
        if action.page.suffix.lower() not in {".html", ".htm"}:
            raise ArgumentError(f"--page {action.page}: pages are HTML. Name a file that ends in .html.")
        check_writable("--page", action.page.parent)
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
        write_file("--picture", action.picture, png(picture(spec, meshes=action.meshes)))
        say(f"\nwritten: {action.picture}")
    if action.page is not None:
        findings = user_robots.record_of(spec.name).findings
        write_file("--page", action.page, page(model, findings, run_trials(spec)))
        say(f"\nwritten: {action.page}")
    return 0


def _check_picture(path: Path) -> None:
    if path.suffix.lower() != ".png":
        raise ArgumentError(f"--picture {path}: pictures are written as PNG. Name a file that ends in .png.")
    check_writable("--picture", path.parent)


def _check(action: commands.CheckRobot) -> int:
    """Print every finding, those of trials where nothing is an error; return 0 unless one is."""
    path = Path(action.subject)
    is_own = path.suffix.lower() == ".xml" and action.subject not in user_robots.names()
    if not is_own and action.subject not in ROBOTS and os.path.exists(path) and path.suffix.lower() != ".urdf":  # noqa: PTH110  # raises nothing
        raise ArgumentError(
            f"{path}: descriptions of robots are MJCF (.xml) or URDF (.urdf). Name one of them, or a robot."
        )
    findings = check(path if is_own else robot(action.subject))
    if not is_own and not has_errors(findings):
        findings += [_finding(trial) for trial in run_trials(robot(action.subject))]
    for finding in findings:
        say(f"{finding.level:6}{finding.subject}: {finding.what}" + (f". {finding.hint}" if finding.hint else ""))
    return 1 if has_errors(findings) else 0


def _add(action: commands.AddRobot) -> int:
    """Add a robot; return 0 when all is well, 1 when it is usable with warnings, 2 when it is refused."""
    name = action.name or user_robots.name_of(action.file)
    user_robots.check_name(name)
    if name in {*ROBOTS, *(full.rpartition("_")[2] for full in ROBOTS)}:
        raise ArgumentError(f"{name} is a robot of this package. Choose another --name.")
    for clip in action.trial_clips:
        if builtin_scene(Path(clip)) is None:
            raise ArgumentError(f"--try {clip}: name built-in clips, such as builtin:carry_box.")
    hints = read_hints(action.hints)
    try:
        built = build_robot(action.file, name, hints, action.meshes)
    except RobotError as refusal:
        warn(f"{action.file.name}: refused: {refusal}")
        return _REFUSED
    rows = [(finding.level, finding.subject, finding.what, finding.hint) for finding in built.findings]
    show_table([("", "part", "taken for", "to change it"), *rows], words=(0, 1, 2, 3))
    say()
    trials = [run_trial(built.spec, built.mjcf, clip) for clip in action.trial_clips]
    for trial in trials:
        say(f"{trial.name}: {_finding(trial).what}")
    record = Record(built.findings, action.trial_clips)
    folder = user_robots.save(built.spec, built.mjcf, record)
    with Working(f"{name}: skin", None) as working:
        make_skin(load_robot(name), lambda share: working.describe(f"{name}: skin, {100 * share:.0f} %"))
    _write_added_page(name, folder / user_robots.PAGE, record, trials)
    say()
    say(f"added: {name} ({folder}). Try it: hoi-retarget run CLIP --robot {name} --out results")
    well = all(holds for trial in trials for _, holds in trial.gates)
    return 0 if well and all(finding.level == "ok" for finding in built.findings) else _USABLE


@dataclass(frozen=True, eq=False)
class RobotTrial:
    """A robot's motion of a clip, and the demands on it."""

    name: str  # Of the clip.
    clip: Clip
    motion: Motion | None  # None where there is none.
    gates: list[tuple[str, bool]]  # Demands in words with figures, and whether each is met.


def _finding(trial: RobotTrial) -> RobotFinding:
    text = ", ".join(f"{what}{'' if holds else ' (!)'}" for what, holds in trial.gates)
    return RobotFinding("ok" if all(holds for _, holds in trial.gates) else "warn", trial.name, text)


def _write_added_page(name: str, path: Path, record: Record, trials: list[RobotTrial]) -> None:
    """Write the page of a robot that was added; without a way to draw it is added all the same."""
    try:
        # With the skin that is stored, as later pages: those of the model that it is of differ in the last digits.
        content = page(load_model(robot(name)), record.findings, trials)
    except DrawingError as error:
        warn(f"no page of {name} is made: {error}")
        return
    write_file("robots add", path, content)
    say(f"look at it: {path}")


def run_trials(spec: RobotSpec) -> list[RobotTrial]:
    """Return the trials of a robot on the clips that it was tried on when it was added."""
    mjcf = spec.mjcf.read_text(encoding="utf-8")
    return [run_trial(spec, mjcf, clip) for clip in user_robots.record_of(spec.name).tried or commands.TRIAL_CLIPS]


def run_trial(spec: RobotSpec, mjcf: str, clip: str) -> RobotTrial:
    """Retarget a built-in clip by its landmarks for a robot with the text of its MJCF."""
    opened = open_clip(clip)
    with tempfile.TemporaryDirectory() as folder:
        model = without_shapes(spec, mjcf, Path(folder))
        try:
            motion = retarget(opened, model, Config(contact="landmark"))
        except HoiRetargetError as error:
            return RobotTrial(clip, opened, None, [(str(error), False)])
    return RobotTrial(clip, opened, motion, gates_of(motion, model))


def gates_of(motion: Motion, model: RobotModel) -> list[tuple[str, bool]]:
    """Return the demands on a motion, in words with its figures, and whether each is met."""
    figures = judged_figures(motion, model)
    gap, pose = figures["contact_gap_m"], figures["body_pose_deviation_deg"]
    unreached, margin = figures["unreached_share"] or 0.0, figures["joint_range_margin_rad"]
    lean = figures["trunk_lean_p95_deg"]
    widest = _MAX_POSE_DEG if model.spec.palm_weight == 1.0 else _MAX_POSE_OF_SHORT_ARMS_DEG
    return [
        ("converged", motion.converged) if motion.converged else ("not converged", False),
        (f"contacts {1000 * (gap or 0.0):.1f} mm off", gap is None or gap <= _MAX_GAP_M),
        (f"{100 * unreached:.0f} % of them unreached", unreached == 0.0),
        (f"pose {pose or 0.0:.0f} deg from the person's", pose is None or pose <= widest),
        (f"leans {lean or 0.0:.0f} deg sideways from the person", lean is None or lean <= _MAX_LEAN_DEG),
        ("ranges kept" if margin is None or margin >= 0 else "ranges not kept", margin is None or margin >= 0),
        *_coupling_gates(figures["coupling_error_rad"]),
    ]


def _coupling_gates(error: float | None) -> list[tuple[str, bool]]:
    return [] if error is None else [(f"coupled joints {error:.2f} rad off", error <= _MAX_COUPLING_ERROR_RAD)]


def without_shapes(spec: RobotSpec, mjcf: str, folder: Path) -> RobotModel:
    """Return a robot's model without geometry: skins take minutes, and landmarks need none."""
    description = mujoco.MjSpec.from_string(mjcf)
    for element in (*description.geoms, *description.meshes):
        description.delete(element)
    file = folder / "robot.xml"
    description.compile()
    file.write_text(description.to_xml(), encoding="utf-8")
    return load_model(replace(spec, mjcf=file))


def page(model: RobotModel, findings: Iterable[RobotFinding], trials: Iterable[RobotTrial]) -> bytes:
    """Return the page of a robot with pictures; raises `DrawingError` where nothing draws without a screen."""
    shown = [Trial(trial.name, trial.gates, _picture(model, trial)) for trial in trials]
    return robot_page(model, tuple(findings), shown).encode("utf-8")


def _picture(model: RobotModel, trial: RobotTrial) -> bytes | None:
    if trial.motion is None:
        return None
    shown = SceneItem(trial.name, trial.motion, model, trial.clip)
    subject = make_scene([shown]).subjects[0]
    parts = robot_parts(model, model.forward(trial.motion.qpos), None)
    layers = (replace(layer, parts=parts) if layer.name == "robot" else layer for layer in subject.layers)
    scene = DrawnScene((replace(subject, layers=tuple(layers)),))
    return jpeg(picture_of(scene, representative_frame(trial.motion), fit_camera(scene, shown.ahead)))
