"""The MJCF of an added robot: the maker's tree, limits and inertias, our sites, and its shapes as they were found."""

import mujoco
import numpy as np

from hoi_retarget.numerics import se3
from hoi_retarget.robots.adding.anatomy import Anatomy
from hoi_retarget.robots.adding.description import finite_range
from hoi_retarget.robots.adding.zero_pose import ZeroPose, mesh_of

SEEN = 2
"""Group of what viewers draw."""
_LEAST_MASS, _LEAST_INERTIA = 1e-3, 1e-7


def robot_file(anatomy: Anatomy, name: str, *, shapes: bool = True) -> mujoco.MjSpec:
    """Return a robot's description: upright and looking along x in its zero pose, its root at the origin.

    Frames of bodies, axes and names are the maker's; joints that are held are gone, and shapes where none are wanted.
    """
    pose = anatomy.pose
    description = mujoco.MjSpec()
    description.modelname = name
    description.compiler.degree = False
    description.compiler.balanceinertia = True
    bodies: dict[int, mujoco.MjsBody] = {}
    for body in sorted(body for part in pose.parts for body in part.bodies):
        bodies[body] = _body(description, bodies, anatomy, body)
        if shapes:
            _add_shapes(description, bodies[body], pose, body)
    for site, placed in anatomy.sites.items():
        body = placed.part.body
        position = pose.body_rotation[body].T @ (placed.position - pose.body_position[body])
        rotation = pose.body_rotation[body].T @ placed.rotation
        bodies[body].add_site(name=site, pos=position, quat=se3.matrix_to_quat(rotation))
    return description


def _body(description: mujoco.MjSpec, bodies: dict[int, mujoco.MjsBody], anatomy: Anatomy, body: int) -> mujoco.MjsBody:
    pose, compiled = anatomy.pose, anatomy.pose.compiled
    is_root = body == pose.root.body
    parent = int(compiled.body_parentid[body])
    turn = anatomy.facing.axes if is_root else pose.body_rotation[parent]
    place = pose.body_position[body] if is_root else pose.body_position[parent]
    owner = description.worldbody if is_root else bodies[parent]
    new = owner.add_body(
        name=compiled.body(body).name,
        pos=turn.T @ (pose.body_position[body] - place),
        quat=se3.matrix_to_quat(turn.T @ pose.body_rotation[body]),
    )
    hinges = [] if is_root else [joint for joint in _hinges_of(pose, body)]
    if is_root:
        new.add_freejoint(name="root")
    for joint in hinges:
        _add_joint(new, anatomy, joint)
    if compiled.body_mass[body] > 0 or hinges or is_root:
        new.explicitinertial = True
        new.mass = max(float(compiled.body_mass[body]), _LEAST_MASS if hinges or is_root else 0.0)
        new.ipos, new.iquat = compiled.body_ipos[body], compiled.body_iquat[body]
        new.inertia = np.maximum(compiled.body_inertia[body], _LEAST_INERTIA)
    return new


def _hinges_of(pose: ZeroPose, body: int) -> tuple[int, ...]:
    return next((part.hinges for part in pose.parts if part.body == body), ())


def _add_joint(body: mujoco.MjsBody, anatomy: Anatomy, joint: int) -> None:
    compiled = anatomy.pose.compiled
    name = compiled.joint(joint).name
    zero = float(compiled.qpos0[compiled.jnt_qposadr[joint]])
    torque = anatomy.pose.description.torques.get(name)
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
    """Add the shapes that are seen, or those that collide where there are no others; each both is seen and collides."""
    compiled = pose.compiled
    geoms = np.flatnonzero(compiled.geom_bodyid == own).tolist()
    seen = [geom for geom in geoms if compiled.geom_group[geom] == 1] or geoms
    for geom in seen:
        kind = mujoco.mjtGeom(compiled.geom_type[geom])
        shape = {
            "pos": compiled.geom_pos[geom],
            "quat": compiled.geom_quat[geom],
            "rgba": compiled.geom_rgba[geom]
            if compiled.geom_matid[geom] < 0
            else compiled.mat_rgba[compiled.geom_matid[geom]],
            "group": SEEN,
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
