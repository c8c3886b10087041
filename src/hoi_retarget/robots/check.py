"""Check of a robot's description: one result for everything that retargeting needs, instead of an exception."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from hoi_retarget.errors import RobotError
from hoi_retarget.numerics import se3
from hoi_retarget.robots.mjcf import compile_mjcf
from hoi_retarget.robots.model import Kinematics, RobotModel, load_model
from hoi_retarget.robots.parts import Frame
from hoi_retarget.robots.spec import SIDES, SITES, SOLE_CORNERS, RobotSpec

Level = Literal["ok", "warn", "error"]

# Standing: z up, looking along +x. Columns are the human's x (left), y (up), z (ahead) in the world.
_QUAT_HUMAN_STANDING = (0.5, 0.5, 0.5, 0.5)
# The arms of a standing human hang: turned from the T-pose about the axis that points ahead [rad].
_ARM_DOWN = {"left": -0.5 * np.pi, "right": 0.5 * np.pi}
_ARM_JOINTS = ("shoulder", "elbow", "wrist")

_SOLE_TOLERANCE = 0.002
"""Corners of the soles may differ in height by this much [m] in the home pose."""
_MIRROR_TOLERANCE = 0.002
"""Left and right may differ by this much [m]."""
_OFFSET_TOLERANCE = 60.0
"""A link further than this [deg] from where a standing human has it is not a matter of pose."""


@dataclass(frozen=True)
class CheckResult:
    """How one check ended."""

    level: Level
    what: str
    """The state of things, with the numbers."""
    where: str
    """Joint, site, body or file."""
    advice: str = ""
    """What to do; empty where all is well."""


def check(subject: RobotSpec | Path) -> list[CheckResult]:
    """Check everything that retargeting needs of a robot.

    Args:
        subject: A specification, or an MJCF file on its own: then what only a specification says
            (speed limits, home pose, rotation offsets) is named as still missing.

    Returns:
        The results, good ones included; poses are checked only where nothing else is an error.
    """
    spec = subject if isinstance(subject, RobotSpec) else _file_on_its_own(subject)
    if not spec.mjcf.is_file():
        return [CheckResult("error", "there is no such file", str(spec.mjcf), "Give the path of an MJCF file.")]
    try:
        compiled = compile_mjcf(spec.mjcf, spec.sites)
    except RobotError as error:
        what = str(error).removeprefix(f"{spec.mjcf}: ")
        return [CheckResult("error", what, str(spec.mjcf), "Fix the MJCF.")]
    hinges = compiled.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
    names = [compiled.joint(int(index)).name for index in np.flatnonzero(hinges)]
    if not all(names):
        bodies = compiled.jnt_bodyid[hinges]
        nameless = [compiled.body(body).name for body, name in zip(bodies, names, strict=True) if not name]
        return [CheckResult("error", "has a joint without a name", ", ".join(nameless), "Name every joint.")]
    results = [
        CheckResult("ok", f"compiles: {compiled.nbody - 1} bodies, {compiled.njnt} joints", str(spec.mjcf)),
        *_root(compiled),
        *_ranges(compiled, names),
        *_masses(compiled),
        *_sites(compiled),
    ]
    # Any speeds do for standing, so that missing ones hide nothing else.
    standing = replace(spec, speed_limits=dict.fromkeys(names, 1.0))
    model = None if has_errors(results) else load_model(standing)
    if model is not None:
        results += [*_soles(model), *_palms(model)]
    if spec is not subject:
        return [*results, _needs_specification(spec.mjcf)]
    return [*results, *_speeds(spec, names), *_home(compiled, spec, names), *(_offsets(model) if model else ())]


def has_errors(results: Iterable[CheckResult]) -> bool:
    """Return whether any result is an error."""
    return any(result.level == "error" for result in results)


def _file_on_its_own(path: Path) -> RobotSpec:
    return RobotSpec(path.stem, path.stem, path, "", 1.0, "captured", speed_limits={}, home={}, ik=())


def _needs_specification(path: Path) -> CheckResult:
    advice = "Write a module with SPEC = RobotSpec(...) beside the MJCF; the robots page says how."
    what = "speed limits, home pose and rotation offsets come with a specification"
    return CheckResult("warn", what, path.name, advice)


def _root(compiled: mujoco.MjModel) -> Iterator[CheckResult]:
    free = np.flatnonzero(compiled.jnt_type == mujoco.mjtJoint.mjJNT_FREE).tolist()
    if free == [0] and compiled.body_parentid[compiled.jnt_bodyid[0]] == 0:
        yield CheckResult("ok", "the root is free", compiled.body(compiled.jnt_bodyid[0]).name)
    else:
        advice = "Put one <freejoint/> into the outermost body, and no other free joint anywhere."
        yield CheckResult("error", f"{len(free)} free joints; the root body needs exactly one", "worldbody", advice)


def _ranges(compiled: mujoco.MjModel, hinges: list[str]) -> Iterator[CheckResult]:
    bad = 0
    for index in np.flatnonzero(compiled.jnt_type != mujoco.mjtJoint.mjJNT_FREE).tolist():
        name, (lower, upper) = compiled.joint(index).name, compiled.jnt_range[index]
        bad += 1
        if name not in hinges:
            advice = "Only hinges can be retargeted; fix it or model it as hinges."
            yield CheckResult("error", "is no hinge", name, advice)
        elif not compiled.jnt_limited[index] or not np.isfinite([lower, upper]).all():
            yield CheckResult("error", "has no range", name, "Give it range='LOWER UPPER' in radians.")
        elif upper - lower > 4 * np.pi:
            advice = "Is the compiler's angle='radian' set, and the range in radians?"
            yield CheckResult("warn", f"turns {np.degrees(upper - lower):.0f} degrees", name, advice)
        else:
            bad -= 1
    if not bad:
        yield CheckResult("ok", f"all {len(hinges)} hinges have ranges", "joints")


def _masses(compiled: mujoco.MjModel) -> Iterator[CheckResult]:
    light = 1 + np.flatnonzero((compiled.body_dofnum[1:] > 0) & (compiled.body_mass[1:] <= 0))
    if light.size:
        names = ", ".join(compiled.body(index).name for index in light)
        yield CheckResult("error", "has no mass", names, "Add an <inertial> with the maker's numbers.")
    else:
        yield CheckResult("ok", f"every link has mass, {compiled.body_mass.sum():.1f} kg together", "bodies")


def _sites(compiled: mujoco.MjModel) -> Iterator[CheckResult]:
    there = {compiled.site(index).name for index in range(compiled.nsite)}
    missing = [name for name in SITES if name not in there]
    if missing:
        what = f"{len(missing)} of {len(SITES)} sites are missing"
        advice = "Add them to the MJCF, or to sites of the specification."
        yield CheckResult("error", what, ", ".join(missing), advice)
    else:
        yield CheckResult("ok", f"all {len(SITES)} sites are there", "sites")


def _soles(model: RobotModel) -> Iterator[CheckResult]:
    standing, home = model.forward(model.home_qpos[None]), bool(model.spec.home)
    pose = "the home pose" if home else "the zero pose"
    heights = [_height(standing, f"{side}_sole_{corner}") for side in SIDES for corner in SOLE_CORNERS]
    spread = max(heights) - min(heights)
    if spread > _SOLE_TOLERANCE:
        advice = "Place the corners on the sole's plane, and let both feet stand flat in the home pose."
        what = f"differ in height by {1000 * spread:.1f} mm in {pose}"
        yield CheckResult("error" if home else "warn", what, "sole corners", advice)
    else:
        yield CheckResult("ok", f"lie in one plane within {1000 * spread:.1f} mm in {pose}", "sole corners")
    frames = [*model.sites.frames.items(), *model.body_frames.frames.items()]
    below = [name for name, frame in frames if _height(standing, frame) < min(heights) - _SOLE_TOLERANCE]
    if below:
        advice = "The corners belong on the underside of the feet, and nothing below them."
        yield CheckResult("error", f"lie below the sole corners in {pose}", ", ".join(below), advice)


def _height(standing: Kinematics, site: str | Frame) -> float:
    return float(standing.point(site)[2, 0])


def _palms(model: RobotModel) -> Iterator[CheckResult]:
    # In the zero pose the trunk's middle plane mirrors left and right.
    upright = model.forward(np.concatenate([model.home_qpos[:7], np.zeros(model.n)])[None])
    flip = np.diag([1.0, -1.0, 1.0])
    left, right = (upright.site_position(f"{side}_palm")[0] for side in SIDES)
    left_turn, right_turn = (upright.site_rotation(f"{side}_palm")[0] for side in SIDES)
    apart = float(np.linalg.norm(flip @ left - right))
    angle = _degrees_between(se3.matrix_to_quat(flip @ left_turn @ flip), se3.matrix_to_quat(right_turn))
    if apart > _MIRROR_TOLERANCE or angle > 1.0:
        what = f"are no mirror images: {1000 * apart:.1f} mm and {angle:.1f} degrees apart"
        yield CheckResult("warn", what, "palms", "Negate y of the position, and x and z of the quaternion.")
    else:
        yield CheckResult("ok", "mirror each other", "palms")


def _speeds(spec: RobotSpec, hinges: list[str]) -> Iterator[CheckResult]:
    limits = spec.speed_limits
    wrong = (
        (
            "no speed limit",
            [name for name in hinges if name not in limits],
            "Add it to speed_limits of the specification; makers' URDFs have it as 'limit velocity'.",
        ),
        (
            "speed limit of a joint that does not exist",
            [name for name in limits if name not in hinges],
            "Fix the name.",
        ),
        (
            "speed limit is not a positive number",
            [name for name in hinges if name in limits and not 0 < limits[name] < np.inf],
            "Give it in rad/s.",
        ),
    )
    yield from _lists(wrong, CheckResult("ok", f"all {len(hinges)} hinges have speed limits", "joints"))


def _home(compiled: mujoco.MjModel, spec: RobotSpec, hinges: list[str]) -> Iterator[CheckResult]:
    def inside(name: str) -> bool:
        lower, upper = compiled.joint(name).range
        return not compiled.jnt_limited[compiled.joint(name).id] or bool(lower < spec.home.get(name, 0.0) < upper)

    wrong = (
        (
            "home pose names joints that do not exist",
            [name for name in spec.home if name not in hinges],
            "Fix the names.",
        ),
        (
            "home pose is not inside the range",
            [name for name in hinges if not inside(name)],
            "Solvers start from the home pose: it has to lie strictly inside the ranges.",
        ),
    )
    yield from _lists(wrong, CheckResult("ok", "lies inside the ranges", "home pose"))


def _lists(wrong: Iterable[tuple[str, list[str], str]], well: CheckResult) -> Iterator[CheckResult]:
    """Yield an error for each list (what, names, advice) that is not empty, or the good result where all are."""
    errors = [CheckResult("error", what, ", ".join(names), advice) for what, names, advice in wrong if names]
    yield from errors or [well]


def _offsets(model: RobotModel) -> Iterator[CheckResult]:
    foreign = [row.site for row in model.spec.ik if row.site not in SITES]
    if foreign:
        yield CheckResult("error", "the IK table names sites that have no role", ", ".join(foreign), "Fix the names.")
    standing = model.forward(model.home_qpos[None])
    worst = 0.0
    for row in model.spec.ik:
        offset = np.array(row.rotation_offset)
        if row.site in foreign:
            continue
        if abs(np.linalg.norm(offset) - 1.0) > 1e-3:
            advice = "Give it as wxyz, of length 1."
            yield CheckResult("error", "rotation offset is no unit quaternion", row.site, advice)
            continue
        target = se3.quat_multiply(_human_standing(row.human_joint), offset)
        angle = _degrees_between(se3.matrix_to_quat(standing.site_rotation(row.site)[0]), target)
        worst = max(worst, angle)
        if angle > _OFFSET_TOLERANCE:
            what = f"home pose is {angle:.0f} degrees off where a standing human has its {row.human_joint}"
            yield CheckResult("error", what, row.site, "Derive the rotation offset anew; the robots page says how.")
    if worst <= _OFFSET_TOLERANCE:
        yield CheckResult("ok", f"fit a standing human within {worst:.0f} degrees in the home pose", "rotation offsets")


def _human_standing(joint: str) -> np.ndarray:
    """Return the world rotation of a joint of a human who stands along +z and looks along +x, arms down."""
    standing = np.array(_QUAT_HUMAN_STANDING)
    side, _, name = joint.partition("_")
    if name not in _ARM_JOINTS:
        return standing
    # Ahead is the human's own z axis.
    return se3.quat_multiply(standing, se3.exp(np.array([0.0, 0.0, _ARM_DOWN[side]])))


def _degrees_between(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(se3.angle_between(a[None], b[None])[0]))
