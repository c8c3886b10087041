"""Check of a robot's description: one finding for each requirement of retargeting, instead of an exception."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from hoi_retarget.errors import RobotError
from hoi_retarget.numerics import se3
from hoi_retarget.robots.adding.findings import RobotFinding
from hoi_retarget.robots.frames import Frame
from hoi_retarget.robots.mjcf import compile_mjcf
from hoi_retarget.robots.model import Kinematics, RobotModel, load_model
from hoi_retarget.robots.spec import SIDES, SITES, SOLE_CORNERS, RobotSpec

# Standing: z up, looking along +x. Columns are the human's x (left), y (up), z (ahead) in the world.
_QUAT_HUMAN_STANDING = (0.5, 0.5, 0.5, 0.5)
# The arms of a standing human hang: turned from the T-pose about the axis that points ahead [rad].
_ARM_DOWN = {"left": -0.5 * np.pi, "right": 0.5 * np.pi}
_ARM_JOINTS = ("shoulder", "elbow", "wrist")

_SOLE_TOLERANCE = 0.002  # Corners of the soles may differ in height by this much [m] in the home pose.
_MIRROR_TOLERANCE = 0.002  # Left and right may differ by this much [m].
_OFFSET_TOLERANCE = 60.0  # A larger angle [deg] between a link and a standing human's is not a matter of pose.


def check(subject: RobotSpec | Path) -> list[RobotFinding]:
    """Return a finding for each requirement of retargeting to a robot; poses are checked where nothing is an error yet.

    Of an MJCF file on its own, the facts of a specification are named as missing: speed limits, home pose, offsets.
    """
    spec = subject
    if isinstance(spec, Path):
        spec = RobotSpec(spec.stem, spec.stem, spec, "", 1.0, "captured", speed_limits={}, home={}, ik=())
    if not spec.mjcf.is_file():
        return [RobotFinding("error", str(spec.mjcf), "there is no such file", "Give the path of an MJCF file.")]
    try:
        compiled = compile_mjcf(spec.mjcf, spec.sites)
    except RobotError as error:
        what = str(error).removeprefix(f"{spec.mjcf}: ")
        return [RobotFinding("error", str(spec.mjcf), what, "Fix the MJCF.")]
    hinges = compiled.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
    names = [compiled.joint(int(index)).name for index in np.flatnonzero(hinges)]
    if not all(names):
        bodies = compiled.jnt_bodyid[hinges]
        nameless = [compiled.body(body).name for body, name in zip(bodies, names, strict=True) if not name]
        return [RobotFinding("error", ", ".join(nameless), "has a joint without a name", "Name every joint.")]
    findings = [
        RobotFinding("ok", str(spec.mjcf), f"compiles: {compiled.nbody - 1} bodies, {compiled.njnt} joints"),
        *_root(compiled),
        *_ranges(compiled, names),
        *_masses(compiled),
        *_sites(compiled),
    ]
    # Any speeds do for standing, and joints that do not exist are told below: neither hides anything else.
    home = {name: angle for name, angle in spec.home.items() if name in names}
    standing = replace(spec, speed_limits=dict.fromkeys(names, 1.0), home=home)
    model = None if has_errors(findings) else load_model(standing)
    if model is not None:
        findings += [*_soles(model), *_palms(model)]
    if spec is not subject:
        what = "speed limits, home pose and rotation offsets come with a specification"
        advice = "Write a module with SPEC = RobotSpec(...) beside the MJCF; the robots page says how."
        return [*findings, RobotFinding("warn", spec.mjcf.name, what, advice)]
    return [*findings, *_speeds(spec, names), *_home(compiled, spec, names), *(_offsets(model) if model else ())]


def has_errors(findings: Iterable[RobotFinding]) -> bool:
    """Return whether any finding is an error."""
    return any(finding.level == "error" for finding in findings)


def _root(compiled: mujoco.MjModel) -> Iterator[RobotFinding]:
    free = np.flatnonzero(compiled.jnt_type == mujoco.mjtJoint.mjJNT_FREE).tolist()
    if free == [0] and compiled.body_parentid[compiled.jnt_bodyid[0]] == 0:
        yield RobotFinding("ok", compiled.body(compiled.jnt_bodyid[0]).name, "the root is free")
    else:
        advice = "Put one <freejoint/> into the outermost body, and no other free joint anywhere."
        yield RobotFinding("error", "worldbody", f"{len(free)} free joints; the root body needs exactly one", advice)


def _ranges(compiled: mujoco.MjModel, hinges: list[str]) -> Iterator[RobotFinding]:
    bad = 0
    for index in np.flatnonzero(compiled.jnt_type != mujoco.mjtJoint.mjJNT_FREE).tolist():
        name, (lower, upper) = compiled.joint(index).name, compiled.jnt_range[index]
        bad += 1
        if name not in hinges:
            advice = "Only hinges can be retargeted; fix it or model it as hinges."
            yield RobotFinding("error", name, "is no hinge", advice)
        elif not compiled.jnt_limited[index] or not np.isfinite([lower, upper]).all():
            yield RobotFinding("error", name, "has no range", "Give it range='LOWER UPPER' in radians.")
        elif upper - lower > 4 * np.pi:
            advice = "Is the compiler's angle='radian' set, and the range in radians?"
            yield RobotFinding("warn", name, f"turns {np.degrees(upper - lower):.0f} degrees", advice)
        else:
            bad -= 1
    if not bad:
        yield RobotFinding("ok", "joints", f"all {len(hinges)} hinges have ranges")


def _masses(compiled: mujoco.MjModel) -> Iterator[RobotFinding]:
    light = 1 + np.flatnonzero((compiled.body_dofnum[1:] > 0) & (compiled.body_mass[1:] <= 0))
    names = [compiled.body(index).name for index in light]
    well = RobotFinding("ok", "bodies", f"every link has mass, {compiled.body_mass.sum():.1f} kg together")
    yield from _lists([("has no mass", names, "Add an <inertial> with the manufacturer's numbers.")], well)


def _sites(compiled: mujoco.MjModel) -> Iterator[RobotFinding]:
    there = {compiled.site(index).name for index in range(compiled.nsite)}
    missing = [name for name in SITES if name not in there]
    what = f"{len(missing)} of {len(SITES)} sites are missing"
    advice = "Add them to the MJCF, or to sites of the specification."
    yield from _lists([(what, missing, advice)], RobotFinding("ok", "sites", f"all {len(SITES)} sites are there"))


def _soles(model: RobotModel) -> Iterator[RobotFinding]:
    standing, home = model.forward(model.home_qpos[None]), bool(model.spec.home)
    pose = "the home pose" if home else "the zero pose"
    heights = [_height(standing, f"{side}_sole_{corner}") for side in SIDES for corner in SOLE_CORNERS]
    spread = max(heights) - min(heights)
    if spread > _SOLE_TOLERANCE:
        advice = "Place the corners on the sole's plane, and let both feet stand flat in the home pose."
        what = f"differ in height by {1000 * spread:.1f} mm in {pose}"
        yield RobotFinding("error" if home else "warn", "sole corners", what, advice)
    else:
        yield RobotFinding("ok", "sole corners", f"lie in one plane within {1000 * spread:.1f} mm in {pose}")
    frames = [*model.sites.frames.items(), *model.body_frames.frames.items()]
    below = [name for name, frame in frames if _height(standing, frame) < min(heights) - _SOLE_TOLERANCE]
    if below:
        advice = "The corners belong on the underside of the feet, and nothing below them."
        yield RobotFinding("error", ", ".join(below), f"lie below the sole corners in {pose}", advice)


def _height(standing: Kinematics, site: str | Frame) -> float:
    return float(standing.point(site)[2, 0])


def _palms(model: RobotModel) -> Iterator[RobotFinding]:
    # In the zero pose the trunk's middle plane mirrors left and right.
    upright = model.forward(np.concatenate([model.home_qpos[:7], np.zeros(model.n)])[None])
    flip = np.diag([1.0, -1.0, 1.0])
    left, right = (upright.site_position(f"{side}_palm")[0] for side in SIDES)
    left_turn, right_turn = (upright.site_rotation(f"{side}_palm")[0] for side in SIDES)
    apart = float(np.linalg.norm(flip @ left - right))
    angle = _degrees_between(se3.matrix_to_quat(flip @ left_turn @ flip), se3.matrix_to_quat(right_turn))
    if apart > _MIRROR_TOLERANCE or angle > 1.0:
        what = f"are no mirror images: {1000 * apart:.1f} mm and {angle:.1f} degrees apart"
        yield RobotFinding("warn", "palms", what, "Negate y of the position, and x and z of the quaternion.")
    else:
        yield RobotFinding("ok", "palms", "mirror each other")


def _speeds(spec: RobotSpec, hinges: list[str]) -> Iterator[RobotFinding]:
    limits = spec.speed_limits
    wrong = (
        (
            "no speed limit",
            [name for name in hinges if name not in limits],
            "Add it to speed_limits of the specification; manufacturers' URDFs have it as 'limit velocity'.",
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
    yield from _lists(wrong, RobotFinding("ok", "joints", f"all {len(hinges)} hinges have speed limits"))


def _home(compiled: mujoco.MjModel, spec: RobotSpec, hinges: list[str]) -> Iterator[RobotFinding]:
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
    yield from _lists(wrong, RobotFinding("ok", "home pose", "lies inside the ranges"))


def _lists(wrong: Iterable[tuple[str, list[str], str]], well: RobotFinding) -> Iterator[RobotFinding]:
    """Yield an error for each non-empty list (fault, names, advice), or the good finding without any."""
    errors = [RobotFinding("error", ", ".join(names), what, advice) for what, names, advice in wrong if names]
    yield from errors or [well]


def _offsets(model: RobotModel) -> Iterator[RobotFinding]:
    foreign = [row.site for row in model.spec.ik if row.site not in SITES]
    if foreign:
        yield RobotFinding("error", ", ".join(foreign), "the IK table names sites that have no role", "Fix the names.")
    standing = model.forward(model.home_qpos[None])
    worst = 0.0
    for row in model.spec.ik:
        offset = np.array(row.rotation_offset)
        if row.site in foreign:
            continue
        if abs(np.linalg.norm(offset) - 1.0) > 1e-3:
            advice = "Give it as wxyz, of length 1."
            yield RobotFinding("error", row.site, "rotation offset is no unit quaternion", advice)
            continue
        target = se3.quat_multiply(_human_standing(row.human_joint), offset)
        angle = _degrees_between(se3.matrix_to_quat(standing.site_rotation(row.site)[0]), target)
        worst = max(worst, angle)
        if angle > _OFFSET_TOLERANCE:
            what = f"home pose is {angle:.0f} degrees off where a standing human has its {row.human_joint}"
            yield RobotFinding("error", row.site, what, "Derive the rotation offset anew; the robots page says how.")
    if worst <= _OFFSET_TOLERANCE:
        fit = f"fit a standing human within {worst:.0f} degrees in the home pose"
        yield RobotFinding("ok", "rotation offsets", fit)


def _human_standing(joint: str) -> np.ndarray:
    """Return the world rotation of a joint of a human who stands along +z and looks along +x, arms down."""
    standing = np.array(_QUAT_HUMAN_STANDING)
    side, _, name = joint.partition("_")
    if name not in _ARM_JOINTS:
        return standing
    # The human's own z axis points ahead.
    return se3.quat_multiply(standing, se3.exp(np.array([0.0, 0.0, _ARM_DOWN[side]])))


def _degrees_between(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(se3.angle_between(a[None], b[None])[0]))
