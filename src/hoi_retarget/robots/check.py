"""Does a robot's description offer what retargeting needs? Findings instead of exceptions."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from hoi_retarget.errors import RobotError
from hoi_retarget.numerics import se3
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
class Finding:
    """One thing that was looked at."""

    level: Level
    what: str
    """What is the case, with the numbers."""
    where: str
    """Joint, site, body or file."""
    advice: str = ""
    """What to do; empty where all is well."""


@dataclass(frozen=True)
class JointRow:
    """One row of the table of joints."""

    joint: str
    lower: float
    """[rad]"""
    upper: float
    """[rad]"""
    speed_limit: float
    """[rad/s]"""
    effort: float | None
    """[N m], where the MJCF has it (`actuatorfrcrange`)."""


@dataclass(frozen=True)
class RoleRow:
    """One row of the table of roles."""

    site: str
    body: str
    place: tuple[float, float, float]
    """In the body's frame [m]."""
    follows: str
    """The human joint that inverse kinematics follows with it, or the human part that touches."""


def check(subject: RobotSpec | Path) -> list[Finding]:
    """Look at everything that retargeting needs of a robot.

    Args:
        subject: A specification, or an MJCF file on its own: then what only a specification says
            (speed limits, home pose, rotation offsets) is named as still missing.

    Returns:
        What was found, errors included; the list ends early where the file cannot be compiled.
    """
    spec = subject if isinstance(subject, RobotSpec) else None
    path = subject.mjcf if isinstance(subject, RobotSpec) else subject
    if not path.is_file():
        return [Finding("error", "there is no such file", str(path), "Give the path of an MJCF file.")]
    try:
        compiled = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        return [Finding("error", f"MuJoCo cannot compile it: {error}", str(path), "Mend the MJCF.")]
    nameless = [body for body, joint in _hinge_bodies(compiled) if not joint]
    if nameless:
        return [Finding("error", "has a joint without a name", ", ".join(nameless), "Name every joint.")]
    findings = [
        Finding("ok", f"compiles: {compiled.nbody - 1} bodies, {compiled.njnt} joints", str(path)),
        *_root(compiled),
        *_ranges(compiled),
        *_masses(compiled),
        *_sites(compiled),
    ]
    home = spec.home if spec else {}
    findings += _soles(compiled, home)
    findings += _palms(compiled)
    if spec is None:
        return [*findings, _needs_specification(path)]
    return [*findings, *_speeds(compiled, spec), *_home(compiled, spec), *_offsets(compiled, spec)]


def describe(spec: RobotSpec) -> tuple[tuple[JointRow, ...], tuple[RoleRow, ...]]:
    """Return the table of joints and the table of roles of a robot.

    Raises:
        RobotError: MuJoCo cannot compile the MJCF, or a joint has no speed limit.
    """
    try:
        compiled = mujoco.MjModel.from_xml_path(str(spec.mjcf))
    except ValueError as error:
        raise RobotError(f"{spec.mjcf}: MuJoCo cannot compile it: {error}") from error
    missing = [name for name in _hinges(compiled) if name not in spec.speed_limits]
    if missing:
        raise RobotError(f"{spec.name}: no speed limit for {', '.join(missing)}. Add it to the specification.")
    joints = tuple(_joint_row(compiled, spec, name) for name in _hinges(compiled))
    follows = {row.site: row.human_joint for row in spec.ik}
    touches = {site: part for part, site in spec.part_sites.items()}
    roles = []
    for index in range(compiled.nsite):
        site = compiled.site(index)
        if site.name in SITES:
            x, y, z = (float(number) for number in site.pos)
            body = compiled.body(compiled.site_bodyid[index]).name
            human = "; ".join(
                text
                for text in (
                    follows.get(site.name, ""),
                    f"touches for {touches[site.name]}" if site.name in touches else "",
                )
                if text
            )
            roles.append(RoleRow(site.name, body, (x, y, z), human))
    return joints, tuple(sorted(roles, key=lambda row: SITES.index(row.site)))


def _joint_row(compiled: mujoco.MjModel, spec: RobotSpec, name: str) -> JointRow:
    index = compiled.joint(name).id
    lower, upper = (float(number) for number in compiled.jnt_range[index])
    limited = bool(compiled.jnt_actfrclimited[index])
    effort = float(compiled.jnt_actfrcrange[index, 1]) if limited else None
    return JointRow(name, lower, upper, spec.speed_limits[name], effort)


def _hinge_bodies(compiled: mujoco.MjModel) -> list[tuple[str, str]]:
    return [
        (compiled.body(compiled.jnt_bodyid[index]).name, compiled.joint(index).name)
        for index in range(compiled.njnt)
        if compiled.jnt_type[index] == mujoco.mjtJoint.mjJNT_HINGE
    ]


def _hinges(compiled: mujoco.MjModel) -> list[str]:
    return [joint for _, joint in _hinge_bodies(compiled)]


def _root(compiled: mujoco.MjModel) -> Iterator[Finding]:
    free = [index for index in range(compiled.njnt) if compiled.jnt_type[index] == mujoco.mjtJoint.mjJNT_FREE]
    if free == [0] and compiled.body_parentid[compiled.jnt_bodyid[0]] == 0:
        yield Finding("ok", "the root is free", compiled.body(compiled.jnt_bodyid[0]).name)
    else:
        advice = "Put one <freejoint/> into the outermost body, and no other free joint anywhere."
        yield Finding("error", f"{len(free)} free joints; the root body needs exactly one", "worldbody", advice)


def _ranges(compiled: mujoco.MjModel) -> Iterator[Finding]:
    bad = 0
    for index in range(compiled.njnt):
        kind, name = compiled.jnt_type[index], compiled.joint(index).name
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            continue
        lower, upper = compiled.jnt_range[index]
        if kind != mujoco.mjtJoint.mjJNT_HINGE:
            bad += 1
            yield Finding("error", "is no hinge", name, "Only hinges can be retargeted; fix it or model it as hinges.")
        elif not compiled.jnt_limited[index] or not np.isfinite([lower, upper]).all():
            bad += 1
            yield Finding("error", "has no range", name, "Give it range='LOWER UPPER' in radians.")
        elif upper - lower > 4 * np.pi:
            bad += 1
            advice = "Is the compiler's angle='radian' set, and the range in radians?"
            yield Finding("warn", f"turns {np.degrees(upper - lower):.0f} degrees", name, advice)
    if not bad:
        yield Finding("ok", f"all {len(_hinges(compiled))} hinges have ranges", "joints")


def _masses(compiled: mujoco.MjModel) -> Iterator[Finding]:
    moving = [index for index in range(1, compiled.nbody) if compiled.body_dofnum[index] > 0]
    light = [compiled.body(index).name for index in moving if compiled.body_mass[index] <= 0]
    if light:
        yield Finding("error", "has no mass", ", ".join(light), "Add an <inertial> with the maker's numbers.")
    else:
        yield Finding("ok", f"every link has mass, {compiled.body_mass.sum():.1f} kg together", "bodies")


def _site_names(compiled: mujoco.MjModel) -> set[str]:
    return {compiled.site(index).name for index in range(compiled.nsite)}


def _sites(compiled: mujoco.MjModel) -> Iterator[Finding]:
    missing = [name for name in SITES if name not in _site_names(compiled)]
    if missing:
        yield Finding(
            "error", f"{len(missing)} of {len(SITES)} sites are missing", ", ".join(missing), "Add them to the MJCF."
        )
    else:
        yield Finding("ok", f"all {len(SITES)} sites are there", "sites")


def _posed(compiled: mujoco.MjModel, angles: Mapping[str, float]) -> mujoco.MjData:
    data = mujoco.MjData(compiled)
    for name in _hinges(compiled):
        if name in angles:
            data.joint(name).qpos = angles[name]
    mujoco.mj_forward(compiled, data)
    return data


def _soles(compiled: mujoco.MjModel, home: Mapping[str, float]) -> Iterator[Finding]:
    names = [f"{side}_sole_{corner}" for side in SIDES for corner in SOLE_CORNERS]
    if not set(names) <= _site_names(compiled):
        return
    data = _posed(compiled, home)
    pose = "the home pose" if home else "the zero pose"
    heights = np.array([data.site(name).xpos[2] for name in names])
    spread, lowest = float(np.ptp(heights)), float(heights.min())
    if spread > _SOLE_TOLERANCE:
        advice = "Place the corners on the sole's plane, and let both feet stand flat in the home pose."
        what = f"differ in height by {1000 * spread:.1f} mm in {pose}"
        yield Finding("error" if home else "warn", what, "sole corners", advice)
    else:
        yield Finding("ok", f"lie in one plane within {1000 * spread:.1f} mm in {pose}", "sole corners")
    below = list(_frames_below(compiled, data, lowest - _SOLE_TOLERANCE))
    if below:
        advice = "The corners belong on the underside of the feet, and nothing below them."
        yield Finding("error", f"lie below the sole corners in {pose}", ", ".join(below), advice)


def _frames_below(compiled: mujoco.MjModel, data: mujoco.MjData, height: float) -> Iterator[str]:
    for index in range(compiled.nsite):
        if data.site_xpos[index, 2] < height:
            yield compiled.site(index).name
    for index in range(1, compiled.nbody):
        if data.xpos[index, 2] < height:
            yield compiled.body(index).name


def _palms(compiled: mujoco.MjModel) -> Iterator[Finding]:
    if not {f"{side}_{role}" for side in SIDES for role in ("palm", "wrist")} <= _site_names(compiled):
        return
    # In the zero pose the trunk's middle plane mirrors left and right.
    data = _posed(compiled, {})
    flip = np.diag([1.0, -1.0, 1.0])
    left, right = (data.site(f"{side}_palm") for side in SIDES)
    apart = float(np.linalg.norm(flip @ left.xpos - right.xpos))
    turned = flip @ left.xmat.reshape(3, 3) @ flip
    angle = _degrees_between(se3.matrix_to_quat(turned), se3.matrix_to_quat(right.xmat.reshape(3, 3)))
    if apart > _MIRROR_TOLERANCE or angle > 1.0:
        what = f"are no mirror images: {1000 * apart:.1f} mm and {angle:.1f} degrees apart"
        yield Finding("warn", what, "palms", "Negate y of the position, and x and z of the quaternion.")
    else:
        yield Finding("ok", "mirror each other", "palms")


def _speeds(compiled: mujoco.MjModel, spec: RobotSpec) -> Iterator[Finding]:
    hinges = _hinges(compiled)
    missing = [name for name in hinges if name not in spec.speed_limits]
    foreign = [name for name in spec.speed_limits if name not in hinges]
    useless = [name for name in hinges if name in spec.speed_limits and not 0 < spec.speed_limits[name] < np.inf]
    if missing:
        advice = "Add it to speed_limits of the specification; makers' URDFs have it as 'limit velocity'."
        yield Finding("error", "no speed limit", ", ".join(missing), advice)
    if foreign:
        yield Finding("error", "speed limit of a joint that does not exist", ", ".join(foreign), "Mend the name.")
    if useless:
        yield Finding("error", "speed limit is not a positive number", ", ".join(useless), "Give it in rad/s.")
    if not (missing or foreign or useless):
        yield Finding("ok", f"all {len(hinges)} hinges have speed limits", "joints")


def _home(compiled: mujoco.MjModel, spec: RobotSpec) -> Iterator[Finding]:
    hinges = _hinges(compiled)
    foreign = [name for name in spec.home if name not in hinges]
    outside = []
    for name in hinges:
        lower, upper = compiled.joint(name).range
        if compiled.jnt_limited[compiled.joint(name).id] and not lower < spec.home.get(name, 0.0) < upper:
            outside.append(name)
    if foreign:
        yield Finding("error", "home pose names joints that do not exist", ", ".join(foreign), "Mend the names.")
    if outside:
        advice = "Solvers start from the home pose: it has to lie strictly inside the ranges."
        yield Finding("error", "home pose is not inside the range", ", ".join(outside), advice)
    if not (foreign or outside):
        yield Finding("ok", "lies inside the ranges", "home pose")


def _offsets(compiled: mujoco.MjModel, spec: RobotSpec) -> Iterator[Finding]:
    rows = [row for row in spec.ik if row.site in _site_names(compiled)]
    foreign = [row.site for row in spec.ik if row.site not in SITES]
    if foreign:
        yield Finding("error", "the IK table names sites that have no role", ", ".join(foreign), "Mend the names.")
    data = _posed(compiled, spec.home)
    worst = 0.0
    for row in rows:
        offset = np.array(row.rotation_offset)
        if abs(np.linalg.norm(offset) - 1.0) > 1e-3:
            yield Finding("error", "rotation offset is no unit quaternion", row.site, "Give it as wxyz, of length 1.")
            continue
        target = se3.quat_multiply(_human_standing(row.human_joint), offset)
        here = se3.matrix_to_quat(data.site(row.site).xmat.reshape(3, 3))
        angle = _degrees_between(here, target)
        worst = max(worst, angle)
        if angle > _OFFSET_TOLERANCE:
            what = f"home pose is {angle:.0f} degrees off where a standing human has its {row.human_joint}"
            yield Finding("error", what, row.site, "Derive the rotation offset anew; the robots page says how.")
    if worst <= _OFFSET_TOLERANCE:
        yield Finding("ok", f"fit a standing human within {worst:.0f} degrees in the home pose", "rotation offsets")


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


def _needs_specification(path: Path) -> Finding:
    advice = "Write a module with SPEC = RobotSpec(...) beside the MJCF; the robots page says how."
    return Finding("warn", "speed limits, home pose and rotation offsets come with a specification", path.name, advice)


def has_errors(findings: Iterable[Finding]) -> bool:
    """Return whether any finding is an error."""
    return any(finding.level == "error" for finding in findings)
