"""A robot made of a manufacturer's file: its specification, and its MJCF with the file's tree, limits and shapes."""

import tempfile
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.robots.adding.description import DEFAULT_SPEED, finite_range, read_description, with_ranges
from hoi_retarget.robots.adding.findings import Hints, RobotFinding, UnsuitableRobotError, hint_of_site
from hoi_retarget.robots.adding.home_pose import HomePose, solve_home, standing_height
from hoi_retarget.robots.adding.morphology import Morphology, check_names, find_morphology
from hoi_retarget.robots.adding.upper_body import find_upper_body
from hoi_retarget.robots.adding.zero_pose import ZeroPose
from hoi_retarget.robots.mjcf import mesh_of
from hoi_retarget.robots.model import load_model
from hoi_retarget.robots.spec import SIDES, TRUNK, IkRow, RobotSpec, ik_table

_VISIBLE_GROUP = 2  # Viewers draw it.
_MIN_MASS, _MIN_INERTIA = 1e-3, 1e-7
_MIN_STATURE_FOR_CAPTURED_OBJECTS = 1.64
"""[m]; hands and arms of smaller robots are too small for objects of captured size."""
_GOOD_DEG, _USABLE_DEG = 5.0, 15.0  # Between the home pose and its goals.
_WEAK_PALM = 0.04  # Palms that cannot turn freely: their rotations would cost millimetres of contact.
_FIRM_CONTACT = 3.0
"""Contacts of robots that cannot take a person's pose: at one they are 5 mm off, at five jerk rises by a third."""
_SHOULDER_JOINTS = 3  # That an upper arm needs to point anywhere, turned in any way.
_WRIST_WEIGHTS = {0: 0.0, 1: 1.0, 2: 2.5}
"""IK weight of a wrist's rotation by how many axes the joints after the elbow have [1/rad]."""
_POSTURE = 1.0


def robot_file(morphology: Morphology, name: str, *, shapes: bool = True) -> mujoco.MjSpec:
    """Return a robot's description: upright and looking along x in its zero pose, its root at the origin.

    Frames of bodies, axes and names are the source file's; held joints are left out, and shapes without `shapes`.
    """
    pose = morphology.pose
    description = mujoco.MjSpec()
    description.modelname = name
    description.compiler.degree = False
    description.compiler.balanceinertia = True
    bodies: dict[int, mujoco.MjsBody] = {}
    for body in sorted(body for part in pose.parts for body in part.bodies):
        bodies[body] = _body(description, bodies, morphology, body)
        if shapes:
            _add_shapes(description, bodies[body], pose, body)
    for site, placed in morphology.sites.items():
        body = placed.part.body
        position = pose.body_rotation[body].T @ (placed.position - pose.body_position[body])
        rotation = pose.body_rotation[body].T @ placed.rotation
        bodies[body].add_site(name=site, pos=position, quat=se3.matrix_to_quat(rotation))
    return description


def _body(
    description: mujoco.MjSpec, bodies: dict[int, mujoco.MjsBody], morphology: Morphology, body: int
) -> mujoco.MjsBody:
    pose, compiled = morphology.pose, morphology.pose.compiled
    is_root = body == pose.root.body
    parent = int(compiled.body_parentid[body])
    turn = morphology.trunk.axes if is_root else pose.body_rotation[parent]
    place = pose.body_position[body] if is_root else pose.body_position[parent]
    owner = description.worldbody if is_root else bodies[parent]
    new = owner.add_body(
        name=compiled.body(body).name,
        pos=turn.T @ (pose.body_position[body] - place),
        quat=se3.matrix_to_quat(turn.T @ pose.body_rotation[body]),
    )
    hinges = next((part.hinges for part in pose.parts if part.body == body), ())
    if is_root:
        new.add_freejoint(name="root")
    for joint in hinges:
        _add_joint(new, morphology, joint)
    if compiled.body_mass[body] > 0 or hinges or is_root:
        new.explicitinertial = True
        new.mass = max(float(compiled.body_mass[body]), _MIN_MASS if hinges or is_root else 0.0)
        new.ipos, new.iquat = compiled.body_ipos[body], compiled.body_iquat[body]
        new.inertia = np.maximum(compiled.body_inertia[body], _MIN_INERTIA)
    return new


def _add_joint(body: mujoco.MjsBody, morphology: Morphology, joint: int) -> None:
    compiled = morphology.pose.compiled
    name = compiled.joint(joint).name
    zero = morphology.pose.zero_angle(joint)
    torque = morphology.pose.description.torques.get(name)
    new = body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        pos=compiled.jnt_pos[joint],
        axis=compiled.jnt_axis[joint],
        range=finite_range(compiled, joint) or (zero - np.pi, zero + np.pi),
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        ref=zero,
        armature=float(compiled.dof_armature[compiled.jnt_dofadr[joint]]),
    )
    if torque is not None:
        new.actfrclimited = mujoco.mjtLimited.mjLIMITED_TRUE
        new.actfrcrange = (-torque, torque)


def _add_shapes(description: mujoco.MjSpec, body: mujoco.MjsBody, pose: ZeroPose, own: int) -> None:
    """Add the visible shapes, or the colliding ones without any; each is visible and collides."""
    compiled = pose.compiled
    geoms = np.flatnonzero(compiled.geom_bodyid == own).tolist()
    visible = [geom for geom in geoms if compiled.geom_group[geom] == 1] or geoms
    for geom in visible:
        kind = mujoco.mjtGeom(compiled.geom_type[geom])
        material = compiled.geom_matid[geom]
        colour = compiled.geom_rgba[geom] if material < 0 else compiled.mat_rgba[material]
        shape = {
            "pos": compiled.geom_pos[geom],
            "quat": compiled.geom_quat[geom],
            "rgba": np.clip(np.nan_to_num(colour, nan=1.0), 0.0, 1.0),
            "group": _VISIBLE_GROUP,
            "density": 0.0,
        }
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            vertices, faces = mesh_of(compiled, geom)
            if len(vertices) < 4 or np.linalg.svd(vertices - vertices.mean(axis=0), compute_uv=False)[2] < 1e-4:
                continue  # A sheet has no hull.
            mesh = f"shape{geom}"
            description.add_mesh(
                name=mesh,
                uservert=np.round(vertices, 5).ravel(),
                userface=faces.ravel(),
                inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
            )
            body.add_geom(type=kind, meshname=mesh, **shape)
        elif kind not in (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD):
            body.add_geom(type=kind, size=compiled.geom_size[geom], **shape)


@dataclass(frozen=True, eq=False)
class BuiltRobot:
    """A robot that is not saved yet; its `mjcf` is a name in a folder to come."""

    spec: RobotSpec
    mjcf: str  # Text of the MJCF.
    findings: tuple[RobotFinding, ...]
    home: HomePose


def build_robot(path: Path, name: str, hints: Hints, meshes: Path | None = None) -> BuiltRobot:
    """Make a robot of a URDF or an MJCF.

    `path`: the source file; `name`: of the robot; `hints`: the user's; `meshes`: a folder with its meshes, where they
    are not beside it. Raises `RobotError`: the file cannot be read or compiled; `UnsuitableRobotError`: it is no
    humanoid that can be retargeted to.
    """
    description = read_description(path, meshes)
    check_names(description, hints)
    description = with_ranges(description, hints.range)
    morphology = find_upper_body(description, hints) if hints.base else find_morphology(description, hints)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "robot.xml"
        spec = _spec(morphology, hints, name, file)
        bare = robot_file(morphology, name, shapes=False)
        bare.compile()
        file.write_text(bare.to_xml())
        model = load_model(spec)
    home = solve_home(model)
    taut = spec.palm_weight < 1.0 or max(home.missed_deg.values()) > _GOOD_DEG
    spec = replace(spec, home=home.angles, contact_weight=_FIRM_CONTACT if taut else 1.0)
    standing = replace(model, home_qpos=frozen([*model.home_qpos[:7], *home.angles.values()]))
    described = robot_file(morphology, name)
    described.worldbody.first_body().pos = (0.0, 0.0, standing_height(standing))
    described.compile()
    findings = (*morphology.findings, *_speed_findings(morphology, spec), _home_finding(home, _excused(morphology)))
    return BuiltRobot(replace(spec, mjcf=Path("robot.xml")), described.to_xml(), findings, home)


def _spec(morphology: Morphology, hints: Hints, name: str, file: Path) -> RobotSpec:
    pose, description = morphology.pose, morphology.pose.description
    moving = [pose.name(joint) for part in pose.parts for joint in part.hinges]
    speeds = {**description.speeds, **hints.speed}
    turns = min(arm.free_turns for arm in morphology.arms)
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
        stature=round(morphology.stature, 4),
        object_size="root" if morphology.stature < _MIN_STATURE_FOR_CAPTURED_OBJECTS else "captured",
        speed_limits={joint: speeds.get(joint, speeds.get("default", DEFAULT_SPEED)) for joint in moving},
        home={},
        ik=tuple(_with_wrist_weight(row, turns) for row in ik_table(TRUNK)),
        posture_weight=_POSTURE,
        palm_weight=1.0 if turns >= 3 else _WEAK_PALM,
        dropped_rotations=() if turns else ("left_wrist", "right_wrist"),
        fingers={name: name for name in morphology.fingers},
        held=pose.held,
        couplings=morphology.couplings,
        motors=hints.motor,
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


def _home_finding(home: HomePose, excused: Collection[str]) -> RobotFinding:
    """Return how well the home pose is met, which sites may miss that are `excused`; raises `UnsuitableRobotError`."""
    site = max(home.missed_deg, key=lambda name: home.missed_deg[name])
    degrees = home.missed_deg[site]
    if max(missed for name, missed in home.missed_deg.items() if name not in excused) > _USABLE_DEG:
        raise UnsuitableRobotError(
            f"it cannot stand relaxed: in the pose that comes nearest, {site} is {degrees:.0f} degrees off. Either its "
            "joints cannot, or one was taken for another: say knees and elbows in a hints file."
        )
    what = f"missed by {degrees:.1f} deg at most ({site})"
    return RobotFinding("ok" if degrees <= _GOOD_DEG else "warn", "home pose", what, hint_of_site(site))


def _excused(morphology: Morphology) -> tuple[str, ...]:
    """Return the sites of arms with a joint too few to turn their upper arms about themselves."""
    places = zip(SIDES, morphology.arms, strict=True)
    short = [side for side, arm in places if arm.elbow.place < _SHOULDER_JOINTS]
    return tuple(f"{side}_{name}" for side in short for name in ("shoulder", "elbow", "wrist"))


def _speed_findings(morphology: Morphology, spec: RobotSpec) -> Iterator[RobotFinding]:
    assumed = [joint for joint in spec.speed_limits if joint not in morphology.pose.description.speeds]
    if assumed:
        joints = f"{len(assumed)} of {len(spec.speed_limits)} joints"
        what = f"no file says them for {joints}: {DEFAULT_SPEED:g} rad/s is assumed"
        yield RobotFinding("warn", "speed limits", what, "speed.default = RAD_PER_S")
    else:
        yield RobotFinding(
            "ok", "speed limits", f"{len(spec.speed_limits)} from the manufacturer's URDF", "speed.JOINT = RAD_PER_S"
        )
