"""A scene as files that open in MuJoCo's own viewer: MJCF with keyframes of a motion, and meshes beside it.

MuJoCo writes six digits. Places of bodies, joints' axes and keyframes are put in again with all digits, so that
kinematics of the file are those of the motion.
"""

from collections.abc import Collection, Mapping
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from hoi_retarget.errors import RobotError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.physics.scene import Scene, mesh_name, scene_description

FILE, MESHES = "scene.xml", "meshes"
KEYFRAMES = 11
"""How many keyframes are spread over a motion, the first and the last frame included."""


def scene_files(scene: Scene, motion: Motion) -> Mapping[Path, bytes]:
    """Return the files of a scene, by their places in its folder.

    Args:
        scene: The scene.
        motion: The motion of which it has keyframes, named `frame_0` and so on.

    Raises:
        RobotError: The robot's MJCF has meshes, or MuJoCo cannot compile it with objects.
    """
    meshes = {
        f"{mesh_name(item, number)}.obj": _obj(item.scale * corners)
        for item in scene.objects
        for number, corners in enumerate(item.shape.parts)
    }
    description = scene_description(scene, meshes)
    check_no_meshes(scene, description, meshes)
    description.assets = meshes
    root = exact_xml(scene, description)
    for compiler in root.iter("compiler"):
        compiler.set("meshdir", MESHES)
    _add_keyframes(root, scene.qpos(motion), scene.model.n)
    return {
        Path(FILE): to_bytes(root),
        **{Path(MESHES) / name: content for name, content in meshes.items()},
    }


def check_no_meshes(scene: Scene, description: mujoco.MjSpec, known: Collection[str] = ()) -> None:
    """Raise `RobotError` where a description has other files of meshes than those of objects."""
    files = [mesh for mesh in description.meshes if mesh.file]  # An added robot's MJCF holds its meshes' corners.
    if own := [mesh.name for mesh in files if f"{mesh.name}.obj" not in known]:
        raise RobotError(f"{scene.model.spec.mjcf}: a scene of a robot with meshes ({own[0]}, ...) is not written yet.")


def exact_xml(scene: Scene, description: mujoco.MjSpec) -> ElementTree.Element:
    """Return a description of a scene, or of a part of it, as MJCF; raises `RobotError` when it cannot be compiled."""
    try:
        compiled = description.compile()
    except ValueError as error:
        raise RobotError(f"{scene.model.spec.mjcf}: MuJoCo cannot compile it with objects: {error}") from error
    root = ElementTree.fromstring(description.to_xml())
    _set_exactly(root, compiled)
    return root


def to_bytes(root: ElementTree.Element) -> bytes:
    """Return MJCF as the content of a file."""
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8") + b"\n"


def _set_exactly(root: ElementTree.Element, compiled: mujoco.MjModel) -> None:
    for element in root.iter("body"):
        body = compiled.body(element.get("name"))
        element.set("pos", _numbers(body.pos))
        element.set("quat", _numbers(body.quat))
    for element in root.iter("joint"):
        name = element.get("name")
        if name is not None and compiled.joint(name).type == mujoco.mjtJoint.mjJNT_HINGE:
            element.set("axis", _numbers(compiled.joint(name).axis))
    for element in root.iter("site"):
        name = element.get("name")
        if name is not None:
            element.set("pos", _numbers(compiled.site(name).pos))
            element.set("quat", _numbers(compiled.site(name).quat))


def _add_keyframes(root: ElementTree.Element, qpos: Float[np.ndarray, "T nq"], joints: int) -> None:
    keyframe = ElementTree.SubElement(root, "keyframe")
    for frame in np.unique(np.linspace(0, len(qpos) - 1, KEYFRAMES).round().astype(int)):
        angles = qpos[frame, 7 : 7 + joints]
        ElementTree.SubElement(
            keyframe, "key", name=f"frame_{frame}", qpos=_numbers(qpos[frame]), ctrl=_numbers(angles)
        )


def _numbers(values: np.ndarray) -> str:
    return " ".join(map(repr, np.asarray(values, dtype=float).tolist()))


def _obj(corners: Float[np.ndarray, "V 3"]) -> bytes:
    """Return a convex part as a mesh file."""
    faces = ConvexHull(corners, qhull_options="QJ").simplices
    lines = [f"v {_numbers(corner)}" for corner in corners] + [
        "f " + " ".join(str(corner + 1) for corner in face) for face in faces.tolist()
    ]
    return ("\n".join(lines) + "\n").encode()
