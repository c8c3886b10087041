"""A scene and its motion as a USD stage, as Isaac Sim, Blender and usdview open it.

Every body is a transform over time, in the world. Links of the robot and objects on joints are kinematic, other objects
rigid bodies with their masses, so that a simulator may go on from any frame; convex parts that collide are guides and
not drawn. Lengths are in metres, z is up. Materials and joints are left out.

Cites: openusd.org (schemas UsdGeom and UsdPhysics).
"""

from collections.abc import Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np

from hoi_retarget.dynamics.physics_scene import PhysicsScene, compiled
from hoi_retarget.errors import HoiRetargetError, install_hint
from hoi_retarget.motion.motion import Motion

NAME = "scene.usdc"
_COLLIDING = 3  # MuJoCo's group of geometries that are not drawn.
_FLOOR_M = 40.0  # Side of the floor, which has no end in MuJoCo [m].
_GEOM = mujoco.mjtGeom
_library: Any = partial(import_module, package="pxr")


def check_installed() -> None:
    """Raise `HoiRetargetError` where usd-core is missing."""
    if hint := install_hint("pxr"):
        raise HoiRetargetError(f"USD is written with usd-core, which is not installed. {hint}")


def usd_file(scene: PhysicsScene, motion: Motion) -> bytes:
    """Return a USD file of a scene along a motion, one time code a frame.

    Raises `HoiRetargetError` where usd-core is missing, and `RobotError` where MuJoCo cannot compile the scene.
    """
    check_installed()
    gf, usd, geometry, physics = map(_library, (".Gf", ".Usd", ".UsdGeom", ".UsdPhysics"))
    simulated, qpos = compiled(scene), scene.qpos(motion)
    stage = usd.Stage.CreateInMemory()
    geometry.SetStageUpAxis(stage, geometry.Tokens.z)
    geometry.SetStageMetersPerUnit(stage, 1.0)
    physics.SetStageKilogramsPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(motion.fps)
    stage.SetFramesPerSecond(motion.fps)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(len(qpos) - 1)
    stage.SetDefaultPrim(geometry.Xform.Define(stage, "/World").GetPrim())
    physics.Scene.Define(stage, "/World/physics")
    jointed = [item for item in scene.objects if item.path is not None]
    jointed += [scene.objects[item.parent] for item in jointed if item.parent >= 0]
    objects = {simulated.body(item.body_name).id: item for item in scene.objects}
    moved: list[tuple[Any, Any]] = []
    for body, path in enumerate(_paths(simulated, list(objects))):
        prim = geometry.Xform.Define(stage, path)
        for geom in np.flatnonzero(simulated.geom_bodyid == body).tolist():
            _add_shape(stage, f"{path}/shape_{geom}", simulated, geom)
        moved.append((prim.AddTranslateOp(), prim.AddOrientOp(geometry.XformOp.PrecisionDouble)))
        if body:
            moves_alone = body in objects and objects[body] not in jointed
            physics.RigidBodyAPI.Apply(prim.GetPrim()).CreateKinematicEnabledAttr(not moves_alone)
        if body in objects:
            mass = physics.MassAPI.Apply(prim.GetPrim())
            mass.CreateMassAttr(float(simulated.body_mass[body]))
            mass.CreateCenterOfMassAttr(gf.Vec3f(*simulated.body_ipos[body].tolist()))
            mass.CreateDiagonalInertiaAttr(gf.Vec3f(*simulated.body_inertia[body].tolist()))
            mass.CreatePrincipalAxesAttr(gf.Quatf(*simulated.body_iquat[body].tolist()))
    data = mujoco.MjData(simulated)
    for frame, row in enumerate(qpos):
        data.qpos[:] = row
        mujoco.mj_kinematics(simulated, data)
        for (place, turn), at, quat in zip(moved, data.xpos.tolist(), data.xquat.tolist(), strict=True):
            place.Set(gf.Vec3d(*at), frame)
            turn.Set(gf.Quatd(*quat), frame)
    with TemporaryDirectory() as folder:
        file = Path(folder) / NAME
        stage.GetRootLayer().Export(str(file))
        return file.read_bytes()


def _paths(simulated: mujoco.MjModel, objects: Sequence[int]) -> list[str]:
    """Return the paths of the bodies on the stage, the world's first; no two are the same."""
    paths = ["/World/ground"]
    for body in range(1, simulated.nbody):
        name = _library(".Tf").MakeValidIdentifier(simulated.body(body).name)
        path = f"/World/{'objects' if body in objects else 'robot'}/{name}"
        paths.append(f"{path}_{body}" if path in paths else path)
    return paths


def _add_shape(stage: Any, path: str, simulated: mujoco.MjModel, geom: int) -> None:
    """Add a geometry to its body."""
    gf, geometry, physics = map(_library, (".Gf", ".UsdGeom", ".UsdPhysics"))
    kind, size, scale = simulated.geom_type[geom], simulated.geom_size[geom].tolist(), None
    match kind:
        case _GEOM.mjGEOM_PLANE:
            shape = geometry.Plane.Define(stage, path)
            shape.CreateWidthAttr(_FLOOR_M)
            shape.CreateLengthAttr(_FLOOR_M)
        case _GEOM.mjGEOM_CAPSULE | _GEOM.mjGEOM_CYLINDER:
            shape = (geometry.Capsule if kind == _GEOM.mjGEOM_CAPSULE else geometry.Cylinder).Define(stage, path)
            shape.CreateRadiusAttr(size[0])
            shape.CreateHeightAttr(2.0 * size[1])
        case _GEOM.mjGEOM_MESH:
            shape = geometry.Mesh.Define(stage, path)
            points, faces = _mesh(simulated, int(simulated.geom_dataid[geom]))
            shape.CreatePointsAttr(points.tolist())
            shape.CreateFaceVertexIndicesAttr(faces.ravel().tolist())
            shape.CreateFaceVertexCountsAttr([3] * len(faces))
            shape.CreateSubdivisionSchemeAttr("none")
        case _GEOM.mjGEOM_BOX:
            shape, scale = geometry.Cube.Define(stage, path), size  # From -1 to 1.
        case _:
            shape, scale = geometry.Sphere.Define(stage, path), size
            shape.CreateRadiusAttr(1.0)
            if kind == _GEOM.mjGEOM_SPHERE:
                scale = [size[0]] * 3
    shape.AddTranslateOp().Set(gf.Vec3d(*simulated.geom_pos[geom].tolist()))
    shape.AddOrientOp(geometry.XformOp.PrecisionDouble).Set(gf.Quatd(*simulated.geom_quat[geom].tolist()))
    if scale is not None:
        shape.AddScaleOp().Set(gf.Vec3f(*scale))
    shape.CreateDisplayColorAttr([gf.Vec3f(*simulated.geom_rgba[geom, :3].tolist())])
    if simulated.geom_contype[geom] or simulated.geom_conaffinity[geom]:
        physics.CollisionAPI.Apply(shape.GetPrim())
        if kind == _GEOM.mjGEOM_MESH:
            physics.MeshCollisionAPI.Apply(shape.GetPrim()).CreateApproximationAttr("convexHull")
    if simulated.geom_group[geom] == _COLLIDING:
        shape.CreatePurposeAttr("guide")


def _mesh(simulated: mujoco.MjModel, mesh: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners [m] and the triangles of a mesh."""
    first, count = simulated.mesh_vertadr[mesh], simulated.mesh_vertnum[mesh]
    start, faces = simulated.mesh_faceadr[mesh], simulated.mesh_facenum[mesh]
    return simulated.mesh_vert[first : first + count], simulated.mesh_face[start : start + faces]
