"""A robot made of a maker's file: everything that a module of this package would say by hand."""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.robots.adding.anatomy import Anatomy, check_names, find_anatomy
from hoi_retarget.robots.adding.description import DEFAULT_SPEED, read_description, with_ranges
from hoi_retarget.robots.adding.findings import Finding, Refused, hint_of_site
from hoi_retarget.robots.adding.hints import Hints
from hoi_retarget.robots.adding.home_pose import HomePose, solve_home, standing_height
from hoi_retarget.robots.adding.robot_file import robot_file
from hoi_retarget.robots.adding.upper_body import find_upper_body
from hoi_retarget.robots.ik_table import TRUNK, ik_table
from hoi_retarget.robots.model import load_model
from hoi_retarget.robots.spec import SIDES, IkRow, RobotSpec

_SMALL = 1.64
"""Robots of less stature [m] have hands and arms too small for objects of captured size."""
_WELL, _USABLE = 5.0, 15.0
"""By how much the home pose may miss its goals [deg]."""
_WEAK_PALM = 0.04
"""Palms that cannot turn freely: their rotations would cost millimetres of contact."""
_FIRM_CONTACT = 3.0
"""Contacts of robots that cannot take a person's pose: at one they are 5 mm off, at five jerk rises by a third."""
_WRIST_WEIGHTS = {0: 0.0, 1: 1.0, 2: 2.5}
"""IK weight of a wrist's rotation by how many axes the joints after the elbow have [1/rad]."""
_POSTURE = 1.0


@dataclass(frozen=True, eq=False)
class Built:
    """A robot that is nowhere saved yet; its `mjcf` is a name in a folder to come."""

    spec: RobotSpec
    mjcf: str
    """Text of the MJCF."""
    findings: tuple[Finding, ...]
    home: HomePose


def build_robot(path: Path, name: str, hints: Hints, meshes: Path | None = None) -> Built:
    """Make a robot of a URDF or an MJCF.

    Args:
        path: The maker's file.
        name: What the robot is to be called.
        hints: What the user knows.
        meshes: A folder with its meshes, where they are not beside it.

    Raises:
        RobotError: The file cannot be read or compiled.
        Refused: It is no humanoid that can be retargeted to.
    """
    description = read_description(path, meshes)
    check_names(description, hints)
    description = with_ranges(description, hints.range)
    anatomy = find_upper_body(description, hints) if hints.base else find_anatomy(description, hints)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "robot.xml"
        spec = _spec(anatomy, hints, name, file)
        bare = robot_file(anatomy, name, shapes=False)
        bare.compile()
        file.write_text(bare.to_xml())
        model = load_model(spec)
    home = solve_home(model)
    taut = spec.palm_weight < 1.0 or max(home.missed_deg.values()) > _WELL
    spec = replace(spec, home=home.angles, contact_weight=_FIRM_CONTACT if taut else 1.0)
    standing = replace(model, home_qpos=frozen([*model.home_qpos[:7], *home.angles.values()]))
    described = robot_file(anatomy, name)
    described.worldbody.first_body().pos = (0.0, 0.0, standing_height(standing))
    described.compile()
    home_finding = _home_finding(home)
    findings = (*anatomy.findings, *_speed_findings(anatomy, spec), home_finding)
    return Built(replace(spec, mjcf=Path("robot.xml")), described.to_xml(), findings, home)


def _spec(anatomy: Anatomy, hints: Hints, name: str, file: Path) -> RobotSpec:
    pose, description = anatomy.pose, anatomy.pose.description
    moving = [pose.name(joint) for part in pose.parts for joint in part.hinges]
    given = {**description.speeds, **hints.speed}
    turns = min(arm.free_turns for arm in anatomy.arms)
    order = tuple(
        pose.compiled.joint(joint).name
        for joint in range(pose.compiled.njnt)
        if pose.compiled.joint(joint).name in {*moving, *(one.joint for one in pose.held)}
    )
    licence = f", {description.licence} beside it" if description.licence else ", no licence beside it"
    spec = RobotSpec(
        name=name,
        title=f"{description.path.name}, {len(moving)} joints",
        mjcf=file,
        provenance=f"Made from {description.path.name} (SHA-256 {description.sha256[:16]}...){licence}.",
        stature=round(anatomy.stature, 4),
        object_size="root" if anatomy.stature < _SMALL else "captured",
        speed_limits={joint: given.get(joint, given.get("default", DEFAULT_SPEED)) for joint in moving},
        home={},
        ik=tuple(_with_wrist_weight(row, turns) for row in ik_table(TRUNK)),
        posture_weight=_POSTURE,
        palm_weight=1.0 if turns >= 3 else _WEAK_PALM,
        dropped_rotations=() if turns else ("left_wrist", "right_wrist"),
        held=pose.held,
        base=hints.base or "legs",
        joint_order=order if pose.held else (),
        description_file=description.path.name,
        description_sha256=description.sha256,
    )
    # Feet of a base touch nothing.
    return replace(spec, part_sites={f"{side}_hand": f"{side}_palm" for side in SIDES}) if hints.base else spec


def _with_wrist_weight(row: IkRow, turns: int) -> IkRow:
    weight = _WRIST_WEIGHTS.get(turns) if row.site.endswith("_wrist") else None
    return row if weight is None else replace(row, rotation_weight=weight)


def _home_finding(home: HomePose) -> Finding:
    site = max(home.missed_deg, key=lambda name: home.missed_deg[name])
    degrees = home.missed_deg[site]
    if degrees > _USABLE:
        raise Refused(
            f"it cannot stand relaxed: in the pose that comes nearest, {site} is {degrees:.0f} degrees off. Either its "
            "joints cannot, or one was taken for another: say knees and elbows in a hints file."
        )
    what = f"missed by {degrees:.1f} deg at most ({site})"
    return Finding("ok" if degrees <= _WELL else "warn", "home pose", what, hint_of_site(site))


def _speed_findings(anatomy: Anatomy, spec: RobotSpec) -> Iterator[Finding]:
    assumed = [joint for joint in spec.speed_limits if joint not in anatomy.pose.description.speeds]
    if assumed:
        joints = f"{len(assumed)} of {len(spec.speed_limits)} joints"
        what = f"no file says them for {joints}: {DEFAULT_SPEED:g} rad/s is assumed"
        yield Finding("warn", "speed limits", what, "speed.default = RAD_PER_S")
    else:
        yield Finding(
            "ok", "speed limits", f"{len(spec.speed_limits)} from the maker's URDF", "speed.JOINT = RAD_PER_S"
        )
