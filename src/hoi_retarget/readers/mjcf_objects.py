"""Objects with joints of a robot's motion, as an MJCF in the motion's folder has them: a door, HDMI's for one.

The motion has the pose of the MJCF's outermost body, and angles of its joints among those of the robot. Boxes, spheres,
capsules, cylinders and meshes that stand in the file are shapes; other files that it names are not opened.

Cites: LeCAR-Lab/HDMI `door.xml`, `door_joint`.
"""

from pathlib import Path

import mujoco
import numpy as np

from hoi_retarget.errors import GeometryError
from hoi_retarget.files.reading import parse_xml, read_bytes
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.motion.check import ObjectPath
from hoi_retarget.motion.formats import MotionFile
from hoi_retarget.numerics import se3
from hoi_retarget.objects.object_joint import depth_first
from hoi_retarget.objects.track import JointKind, ObjectGeometry, ObjectJoint, ObjectTrack
from hoi_retarget.readers.object_files import MAX_OBJECT_SIZE
from hoi_retarget.robots.mjcf import mesh_of, quiet

_TAGS = ("mujoco", "worldbody", "body", "geom", "joint", "freejoint", "site", "asset", "mesh", "inertial")
_TAGS += ("compiler", "option", "default", "material", "light", "camera")
"""Elements of MJCF that are read or passed over; others may open files, or make much out of little."""
_MOST_BODIES = 200
_KINDS: dict[int, JointKind] = {int(mujoco.mjtJoint.mjJNT_HINGE): "hinge", int(mujoco.mjtJoint.mjJNT_SLIDE): "slide"}


def objects_beside(file: SourceFile, stored: MotionFile, path: ObjectPath) -> tuple[ObjectTrack, ...]:
    """Return an object of a motion and its parts by an MJCF beside the motion; none where no such file has the object.

    Raises `GeometryError` where that file cannot be compiled, asks for other files, or lacks shapes.
    """
    folder = file.path if file.path.is_dir() else file.path.parent
    for place in sorted(path for path in folder.glob("*.xml") if path.is_file()):
        content = read_bytes(place)
        if path.name in _bodies(content):
            file.read(place)  # For the digest.
            compiled = _compiled(place, content)
            return _tracks(place, compiled, stored, path, compiled.body(path.name).id)
    return ()


def _bodies(content: bytes) -> list[str | None]:
    try:
        return [item.get("name") for item in parse_xml(content).iter("body")]
    except ValueError:
        return []


def _compiled(place: Path, content: bytes) -> mujoco.MjModel:
    root = parse_xml(content)
    for item in root.iter():
        reached = [name for name in item.attrib if name.startswith("file") or name.endswith("dir")]
        if item.tag not in _TAGS or reached:
            raise GeometryError(
                f"{place}: it has <{' '.join([item.tag, *reached])}>. Read are bodies, joints and shapes that stand in "
                "the file; other files are not opened. Take the rest out."
            )
    names = [item.get("name", "") for item in root.iter("body")]
    if len(names) > _MOST_BODIES or "" in names or len(set(names)) < len(names):
        raise GeometryError(f"{place}: it has {len(names)} bodies; read are {_MOST_BODIES}, each of its own name.")
    try:
        with quiet():
            return mujoco.MjSpec.from_string(content.decode()).compile()
    except (ValueError, RuntimeError, mujoco.FatalError) as error:  # Text that is no UTF-8 is a `ValueError`.
        raise GeometryError(f"{place}: MuJoCo cannot compile it: {error}") from error


def _tracks(
    place: Path, compiled: mujoco.MjModel, stored: MotionFile, path: ObjectPath, root: int
) -> tuple[ObjectTrack, ...]:
    below = depth_first([-1, *compiled.body_parentid[1:].tolist()], root)
    for body in below[1:]:
        if compiled.body_jntnum[body] > 1 or (compiled.body_jntnum[body] and _kind(compiled, body) is None):
            name = compiled.body(body).name
            raise GeometryError(f"{place}: {name!r} moves by more than one hinge or slide. Give each joint a body.")
    data, names = mujoco.MjData(compiled), stored.joint_names or ()
    joints = {int(compiled.body_jntadr[body]): body for body in below[1:] if compiled.body_jntnum[body]}
    columns = {joint: names.index(name) for joint in joints if (name := compiled.joint(joint).name) in names}
    poses = np.empty((len(path.pos), len(below), 7))
    for frame, pose in enumerate(poses):
        for joint, column in columns.items():
            assert stored.joint_pos is not None
            data.qpos[compiled.jnt_qposadr[joint]] = stored.joint_pos[frame, column]
        mujoco.mj_kinematics(compiled, data)
        pose[:, :3], pose[:, 3:] = data.xpos[below], data.xquat[below]
    back, ways = se3.quat_conjugate(poses[:, :1, 3:]), poses[:, :, :3] - poses[:, :1, :3]
    places = path.pos[:, None] + se3.rotate(path.quat[:, None], se3.rotate(back, ways))
    turns = se3.quat_multiply(path.quat[:, None], se3.quat_multiply(back, poses[:, :, 3:]))
    own = [(_geometry(place, compiled, body), _joint(compiled, body) if body != root else None) for body in below]
    return tuple(
        ObjectTrack(compiled.body(body).name, places[:, index], turns[:, index], *own[index])
        for index, body in enumerate(below)
    )


def _kind(compiled: mujoco.MjModel, body: int) -> JointKind | None:
    return _KINDS.get(int(compiled.jnt_type[compiled.body_jntadr[body]]))


def _joint(compiled: mujoco.MjModel, body: int) -> ObjectJoint:
    parent, first = compiled.body(int(compiled.body_parentid[body])).name, int(compiled.body_jntadr[body])
    kind = _kind(compiled, body) if compiled.body_jntnum[body] else None
    if kind is None:
        return ObjectJoint(parent, "fixed")
    pos, quat = compiled.body_pos[body], compiled.body_quat[body]
    axis, anchor = se3.rotate(quat, compiled.jnt_axis[first]), pos + se3.rotate(quat, compiled.jnt_pos[first])
    return ObjectJoint(parent, kind, tuple(axis.tolist()), tuple(anchor.tolist()))


def _geometry(place: Path, compiled: mujoco.MjModel, body: int) -> ObjectGeometry:
    from trimesh import creation  # noqa: PLC0415  # takes a third of a second

    kinds = mujoco.mjtGeom
    makers = {
        int(kinds.mjGEOM_BOX): lambda size: creation.box(extents=2.0 * size),
        int(kinds.mjGEOM_SPHERE): lambda size: creation.icosphere(radius=size[0]),
        int(kinds.mjGEOM_CAPSULE): lambda size: creation.capsule(radius=size[0], height=2.0 * size[1]),
        int(kinds.mjGEOM_CYLINDER): lambda size: creation.cylinder(radius=size[0], height=2.0 * size[1]),
    }
    points, faces, count = [], [], 0
    small = np.abs(compiled.geom_size).max() < MAX_OBJECT_SIZE
    for geom in np.flatnonzero(compiled.geom_bodyid == body).tolist() if small else ():
        kind = int(compiled.geom_type[geom])
        if kind == kinds.mjGEOM_MESH:
            vertices, triangles = mesh_of(compiled, geom)
        elif kind in makers:
            made = makers[kind](compiled.geom_size[geom])
            vertices, triangles = np.array(made.vertices), np.array(made.faces)
        else:
            continue
        points.append(compiled.geom_pos[geom] + se3.rotate(compiled.geom_quat[geom], vertices))
        faces.append(triangles + count)
        count += len(vertices)
    if not points or not np.abs(np.concatenate(points)).max() < MAX_OBJECT_SIZE:
        name = compiled.body(body).name
        raise GeometryError(f"{place}: {name!r} has no shape that is read, or one beyond {MAX_OBJECT_SIZE:g} m.")
    return ObjectGeometry(np.concatenate(points), faces=np.concatenate(faces))
