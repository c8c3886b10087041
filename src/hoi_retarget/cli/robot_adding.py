"""`hoi-retarget robots add`: a robot made of its maker's file, what was found, and how it does on a clip."""

import tempfile
from dataclasses import replace
from pathlib import Path

import mujoco

from hoi_retarget.cli.commands import AddRobot
from hoi_retarget.cli.terminal import say, show_table, warn
from hoi_retarget.errors import ArgumentError, HoiRetargetError, RobotError
from hoi_retarget.evaluation.thresholds import judged_figures
from hoi_retarget.motion.motion import Motion
from hoi_retarget.readers.open import builtin_scene, open_clip
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.pipeline import retarget
from hoi_retarget.robots import ROBOTS, user_robots
from hoi_retarget.robots.adding.build import Built, build_robot
from hoi_retarget.robots.adding.hints import read_hints
from hoi_retarget.robots.model import RobotModel, load_model

USABLE, REFUSED = 1, 2
"""Exit codes beside 0."""
_GAP, _POSE, _POSE_OF_SHORT_ARMS = 0.002, 25.0, 30.0


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
    gates = [gate for clip in action.tried for gate in _gates(built, clip)]
    folder = user_robots.save(built.spec, built.mjcf)
    say()
    say(f"added: {name} ({folder}). Try it: hoi-retarget run CLIP --robot {name} --out results")
    well = all(gates) and all(finding.level == "ok" for finding in built.findings)
    return 0 if well else USABLE


def _gates(built: Built, clip: str) -> list[bool]:
    """Retarget a clip by its landmarks, and print whether each figure is as it should be."""
    with tempfile.TemporaryDirectory() as folder:
        model = without_shapes(built, Path(folder))
        try:
            motion = retarget(open_clip(clip), model, Config(contact="landmark"))
        except HoiRetargetError as error:
            warn(f"{clip}: {error}")
            return [False]
    gates = gates_of(motion, model)
    say(f"{clip}: " + ", ".join(f"{what}{'' if well else ' (!)'}" for what, well in gates))
    return [well for _, well in gates]


def gates_of(motion: Motion, model: RobotModel) -> list[tuple[str, bool]]:
    """Return what a motion must do, in words with its figures, and whether it does."""
    figures = judged_figures(motion, model)
    gap, pose = figures["contact_gap_m"], figures["body_pose_deviation_deg"]
    unreached, margin = figures["unreached_share"] or 0.0, figures["joint_range_margin_rad"]
    widest = _POSE if model.spec.palm_weight == 1.0 else _POSE_OF_SHORT_ARMS
    return [
        ("converged", motion.converged) if motion.converged else ("not converged", False),
        (f"contacts {1000 * (gap or 0.0):.1f} mm off", gap is None or gap <= _GAP),
        (f"{100 * unreached:.0f} % of them unreached", unreached == 0.0),
        (f"pose {pose or 0.0:.0f} deg from the person's", pose is None or pose <= widest),
        ("ranges kept" if margin is None or margin >= 0 else "ranges not kept", margin is None or margin >= 0),
    ]


def without_shapes(built: Built, folder: Path) -> RobotModel:
    """Return a robot's model without geometry: skins take minutes, and landmarks need none."""
    description = mujoco.MjSpec.from_string(built.mjcf)
    for element in (*description.geoms, *description.meshes):
        description.delete(element)
    file = folder / "robot.xml"
    description.compile()
    file.write_text(description.to_xml(), encoding="utf-8")
    return load_model(replace(built.spec, mjcf=file))
