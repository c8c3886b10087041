"""Reads HUMOTO, motion capture of a person and household objects, from its binary glTF files: `<sequence>.glb`.

One scene, y up: a node `Armature`, scaled by 0.01 as all below it is in centimetres, with the 65 joints `mixamorig:*`
of a Mixamo skeleton, and each object as a node of its own with its mesh in metres. All are animated. Poses that do not
change are stored as two keys, so what is in between is sampled by time.

The files say 24 frames a second, but each key is one frame of a capture of 30: played as they say, people would move
a quarter too slowly. Files that say 30 are taken at their word.

Rotations of Mixamo's bones are counted from its bind pose and from axes of its own. Here they become those of
`skeleton`: the T-pose is where thighs and shins hang down and upper arms and forearms point sideways, whatever the bind
pose is, as long as that is near. The body's meshes become the person's skin. There are no labels of contacts.

The floor is at y = 0: in the bind pose, which stands on it, the skin's lowest point is 2 mm below, and furniture stands
within 5 mm of it in most files. Mixamo's toe joints lie on the sole, not inside the foot, and its head ends at
`HeadTop_End`: the stature is what is between them.

Cites: arXiv 2504.10414 (30 frames a second, one rig); adobe-research/humoto `README.md` and files; Jiaxin-Lu/humoto
`scripts/blender_helper.py` (30 frames a second).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError, GeometryError, ReadError
from hoi_retarget.files.gltf import Gltf, NodePoses, text_of
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS
from hoi_retarget.human.skinned_mesh import SkinnedMesh
from hoi_retarget.human.t_pose import LIMBS, body_axes, turns_from_t_pose
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.object_files import MAX_OBJECT_SIZE, quats_of
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks

FORMAT = "humoto"
LICENCE = "Adobe Research License v1.1: research use; the full set on request"
FPS = 30.0
STAMPED_FPS = (24.0, 30.0)  # Keys a second that files say; each key is one frame of the capture.
PREFIX = "mixamorig:"
HEAD_TOP = f"{PREFIX}HeadTop_End"
TOE_HEIGHT = 0.006  # [m]; of the toe joints over the floor, in the bind pose and wherever people stand.
FBX = ".fbx"
MAX_ANGLE_TO_T_POSE = 60.0  # [deg]; limbs of a bind pose that are farther from a T-pose's are of another pose.

_SIDES = {
    "UpLeg": "hip",
    "Leg": "knee",
    "Foot": "ankle",
    "ToeBase": "foot",
    "Shoulder": "collar",
    "Arm": "shoulder",
    "ForeArm": "elbow",
    "Hand": "wrist",
    **{
        f"Hand{finger.title()}{bone}": f"{finger}{bone}"
        for finger in ("index", "middle", "pinky", "ring", "thumb")
        for bone in (1, 2, 3)
    },
}
BONES: Mapping[str, str] = {
    "pelvis": "Hips",
    "spine1": "Spine",
    "spine2": "Spine1",
    "spine3": "Spine2",
    "neck": "Neck",
    "head": "Head",
    **{f"{side}_{joint}": f"{side.title()}{bone}" for side in ("left", "right") for bone, joint in _SIDES.items()},
}
"""Joint of `skeleton.JOINTS` -> Mixamo's bone."""

_STEP_TOLERANCE = 0.05  # [frames]; of keys from the frames they are on.


@dataclass(frozen=True, eq=False)
class _Capture:
    """A file's scene with its nodes of the body and of objects."""

    path: Path
    scene: Gltf

    @cached_property
    def joints(self) -> tuple[int, ...]:
        """The nodes of `skeleton.JOINTS`; raises `ClipError` where some are missing."""
        nodes = {name: index for index, name in enumerate(self.scene.names)}
        missing = [f"{PREFIX}{BONES[joint]}" for joint in JOINTS if f"{PREFIX}{BONES[joint]}" not in nodes]
        if missing:
            raise ClipError(
                f"{self.path}: the skeleton lacks {', '.join(missing[:4])}{', ...' if len(missing) > 4 else ''}, which "
                "HUMOTO's has. Download the file again."
            )
        return tuple(nodes[f"{PREFIX}{BONES[joint]}"] for joint in JOINTS)

    @cached_property
    def armature(self) -> frozenset[int]:
        """All nodes of the body: the skeleton's root, and all that hang from it."""
        root = (self.joints[0], *self.scene.ancestors(self.joints[0]))[-1]
        below = (node for node in self.scene.order if root in self.scene.ancestors(node))
        return frozenset((root, *below))

    @cached_property
    def objects(self) -> tuple[int, ...]:
        """The nodes with a mesh of their own that are not of the body; raises `ClipError` for two of one name."""
        nodes = tuple(
            node
            for node in range(len(self.scene.names))
            if node not in self.armature and self.scene.mesh_of(node) is not None
        )
        names = [self.scene.names[node] for node in nodes]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ClipError(f"{self.path}: two objects are called {twice[0]!r}. Rename one in the file.")
        return nodes

    @cached_property
    def clock(self) -> tuple[Float[np.ndarray, "T"], float]:
        """The frames that are captured, and the file's rate [Hz].

        Raises `ClipError` where keys are not those of frames, or the body's and an object's are not of the same ones.
        """
        of_body = [channel.times for channel in self.scene.channels if channel.node in self.armature]
        if not of_body:
            raise ClipError(f"{self.path}: the body is not animated. Export the file with its animations.")
        times = np.unique(np.concatenate(of_body))
        rate = next((rate for rate in STAMPED_FPS if self._fits(times, rate)), None)
        if rate is None:
            apart = f"mostly {np.median(np.diff(times)):.4g} s apart" if len(times) > 1 else "all at one time"
            raise ClipError(
                f"{self.path}: the body's keys are {apart}, expected one for every frame, 24 or 30 a second, as "
                "HUMOTO's are. Export the file with every frame sampled."
            )
        first, last = np.rint(times[[0, -1]] * rate)
        frames = np.arange(first, last + 1)
        for channel in self.scene.channels:
            ends = channel.times[[0, -1]] * rate
            if channel.node in self.objects and not channel.constant and np.abs(ends - frames[[0, -1]]).max() > 0.5:
                raise ClipError(
                    f"{self.path}: {self.scene.names[channel.node]!r} is animated from frame {ends[0]:.1f} to "
                    f"{ends[1]:.1f}, the body from {first:.0f} to {last:.0f}. Export both over the same frames."
                )
        return frames, rate

    @staticmethod
    def _fits(times: Float[np.ndarray, "K"], rate: float) -> bool:
        """Return whether keys are on frames of this rate, and on most of them."""
        keys = times * rate
        steps = np.diff(np.rint(keys))
        return bool((np.abs(keys - np.rint(keys)) < _STEP_TOLERANCE).all() and steps.sum() < 2 * len(steps))


def holds(file: SourceFile) -> bool:
    """Return whether a `.glb` file has a skeleton of Mixamo."""
    return f'"{PREFIX}{BONES["pelvis"]}"'.encode() in text_of(file.content)


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a file."""
    if file.suffix == FBX:
        raise ReadError(
            f"{file.name}: .fbx files are not read. HUMOTO has the same sequence as .glb; otherwise open it in Blender "
            "and export it as binary glTF with animations."
        )
    capture = _Capture(file.path, Gltf(file.path, file.content))
    frames, rate = capture.clock

    def read_tracks() -> Tracks:
        poses = capture.scene.poses(frames, rate)
        person, notes = _person(capture, poses)
        objects = tuple(_object(capture, poses, node) for node in capture.objects)
        return Tracks(people=(person,), objects=objects, notes=notes)

    return SourceRecording(
        name=file.path.stem,
        description="HUMOTO capture of one person and household objects",
        frames=len(frames),
        fps=FPS,
        fps_stated=rate == FPS,
        skeleton=f"{len(JOINTS)} of Mixamo's 65 joints",
        objects=tuple(capture.scene.names[node] for node in capture.objects),
        licence=LICENCE,
        notes=(_rate_note(rate), *_part_notes(capture)),
        up="y",
        read_tracks=read_tracks,
    )


def _rate_note(rate: float) -> str:
    if rate == FPS:
        return f"The file says {FPS:g} frames a second, as the capture had."
    return (
        f"The file says {rate:g} frames a second, but has one key for each of the capture's {FPS:g}: times are changed."
    )


def _part_notes(capture: _Capture) -> tuple[str, ...]:
    """Return notes of objects that hang from others: their poses hold the motion of a hinge or a drawer."""
    notes: tuple[str, ...] = ()
    for node in capture.objects:
        above = next((other for other in capture.scene.ancestors(node) if other in capture.objects), None)
        if above is not None:
            names = capture.scene.names
            notes += (f"{names[node]} is a part of {names[above]}, with poses of its own.",)
    return notes


@dataclass(frozen=True, eq=False)
class _BindPose:
    """Where the bones are while the mesh is bound to them, in the mesh's frame."""

    skin: int  # The file's skin, which has the bones.
    joints: tuple[int, ...]  # All its nodes.
    positions: Float[np.ndarray, "52 3"]
    quats: Float[np.ndarray, "52 4"]  # wxyz
    head_top: Float[np.ndarray, "3"] | None  # Where the head ends; None where the skin has no such bone.


def _person(capture: _Capture, poses: NodePoses) -> tuple[Person, tuple[str, ...]]:
    joints = list(capture.joints)
    bound = _bind_pose(capture)
    try:
        body = body_axes(bound.positions)
        turns, largest = turns_from_t_pose(bound.positions, bound.quats, body, MAX_ANGLE_TO_T_POSE)
    except ClipError as error:
        raise ClipError(f"{capture.path}: {error}. Export the file with Mixamo's bind pose.") from error
    positions, quats = poses.positions[:, joints], se3.quat_multiply(poses.quats[:, joints], turns)
    notes = (f"Limbs of the bind pose are up to {largest:.0f} deg from those of a T-pose, which is accounted for.",)
    # The mesh may be in another unit than the bones.
    unit, stature = _limbs_length(positions) / _limbs_length(bound.positions), None
    if bound.head_top is not None:
        height = se3.rotate_inverse(body, bound.head_top)[1] - se3.rotate_inverse(body, bound.positions)[:, 1].min()
        stature = float(height * unit)
        notes += (f"The person is {stature:.3f} m tall, from the toes to {HEAD_TOP} in the bind pose.",)
    shape = _skin(capture, bound, turns, unit)
    notes += ("The person's skin is the file's.",) if shape else ()
    return Person("person", positions, quats, shape=shape, stature=stature, toe_height=TOE_HEIGHT), notes


def _skin(capture: _Capture, bound: _BindPose, turns: Float[np.ndarray, "52 4"], unit: float) -> SkinnedMesh | None:
    """Return the skin, its bones beyond the skeleton's as parts of the bones above; None without a mesh.

    `capture`: the file; `bound`: its bind pose; `turns`: of each bone, in its own frame, that give its joint's rotation
    from the T-pose, wxyz; `unit`: of the mesh's frame [m].
    """
    scene, columns = capture.scene, {node: column for column, node in enumerate(capture.joints)}
    vertices: list[np.ndarray] = []
    faces: list[np.ndarray] = []
    weights: list[np.ndarray] = []
    for mesh in scene.bound_meshes(bound.skin):
        points, triangles = scene.mesh(mesh)
        faces.append(triangles + sum(map(len, vertices)))
        vertices.append(points)
        own, of_bones = np.zeros((len(points), len(JOINTS))), scene.vertex_weights(mesh, len(bound.joints))
        for bone, share in zip(bound.joints, of_bones.T, strict=True):
            above = next((node for node in (bone, *scene.ancestors(bone)) if node in columns), capture.joints[0])
            own[:, columns[above]] += share
        weights.append(own)
    if not vertices:
        return None
    return SkinnedMesh(
        rest_vertices=unit * np.concatenate(vertices),
        faces=np.concatenate(faces),
        weights=np.concatenate(weights),
        rest_joints=unit * bound.positions,
        rest_quats=se3.quat_multiply(bound.quats, turns),
    )


def _limbs_length(positions: Float[np.ndarray, "*T 52 3"]) -> float:
    """Return the length of all limbs together, its mean over time."""
    starts, ends = [JOINT_INDEX[joint] for joint in LIMBS], [JOINT_INDEX[end] for end, _ in LIMBS.values()]
    return float(np.linalg.norm(positions[..., ends, :] - positions[..., starts, :], axis=-1).sum(axis=-1).mean())


def _bind_pose(capture: _Capture) -> _BindPose:
    """Return the bind pose; raises `ClipError` where no skin has all bones."""
    names = capture.scene.names
    for skin, (joints, inverse) in enumerate(capture.scene.skins()):
        places = {node: index for index, node in enumerate(joints)}
        if set(capture.joints) <= set(places):
            head_top = next((place for node, place in places.items() if names[node] == HEAD_TOP), None)
            order = [places[node] for node in capture.joints] + ([] if head_top is None else [head_top])
            sizes = np.cbrt(np.abs(np.linalg.det(inverse[order, :3, :3])))
            if not (sizes > 1e-9).all():
                break
            turns = inverse[order, :3, :3] / sizes[:, None, None]
            quats = se3.quat_conjugate(quats_of(capture.path, "inverseBindMatrices", turns))
            positions = -se3.rotate(quats, inverse[order, :3, 3] / sizes[:, None])
            bones = len(JOINTS)
            top = None if head_top is None else positions[-1]
            return _BindPose(skin, joints, positions[:bones], quats[:bones], top)
    raise ClipError(
        f"{capture.path}: no skin binds a mesh to all bones, so their bind pose is not known. Export the file with "
        "the body's mesh."
    )


def _object(capture: _Capture, poses: NodePoses, node: int) -> ObjectTrack:
    name, scales = capture.scene.names[node], poses.scales[:, node]
    scale = float(scales.mean())
    if np.ptp(scales) > 0.01 * scale:
        raise GeometryError(
            f"{capture.path}: {name!r} changes its size by {np.ptp(scales) / scale:.0%}; rigid objects are read."
        )
    mesh = capture.scene.mesh_of(node)
    assert mesh is not None  # Objects are nodes with a mesh.
    vertices, faces = capture.scene.mesh(mesh)
    vertices = vertices * scale
    if np.abs(vertices).max() > MAX_OBJECT_SIZE:
        raise GeometryError(
            f"{capture.path}: {name!r} reaches {np.abs(vertices).max():.4g} m from its origin, expected at most "
            f"{MAX_OBJECT_SIZE:g}: another unit, or damage."
        )
    geometry = ObjectGeometry(vertices, faces=faces)
    return ObjectTrack(name, poses.positions[:, node], poses.quats[:, node], geometry)


READER = Reader(FORMAT, record, holds=holds, floor_at_zero=True, rotation_readings=())
