"""A person as unit shapes, or as the skin of a body model; and a person in a robot's pose.

Captures hold joints only: widths of limbs are those of an adult of 1.75 m, and grow with the person. A skin is a rigid
piece for each joint, with small seams at bent ones: a frame is a pose for each joint, not ten thousand vertices.
"""

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.robot_person import joint_quats
from hoi_retarget.human.body_model import BodyShape
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, PARENT, PARENTS, world_positions
from hoi_retarget.human.skinned_mesh import SkinnedMesh
from hoi_retarget.human.t_pose import rest_offsets
from hoi_retarget.numerics import se3
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.studio.scene.drawing import Colour, Kind, Shapes, Solid
from hoi_retarget.studio.scene.marks import rotations_to

COLOUR: Colour = (221, 155, 118)
REFERENCE_HEIGHT = 1.75  # [m]

# Radius of the limb that ends at a joint [m], by the joint's name without its side.
_RADII = {"spine1": 0.105, "spine2": 0.105, "spine3": 0.105, "neck": 0.055, "head": 0.05}
_RADII |= {"hip": 0.085, "knee": 0.066, "ankle": 0.046, "foot": 0.036}
_RADII |= {"collar": 0.055, "shoulder": 0.056, "elbow": 0.045, "wrist": 0.035}
_PALM_RADIUS, _FINGER_RADIUS = 0.014, 0.0095  # [m]

# Ellipsoids that fill the trunk out, in axes of a joint that point left, up and ahead: joint, middle, half extents [m].
_ROUNDINGS = (
    ("pelvis", (0.0, -0.01, -0.005), (0.165, 0.125, 0.112)),
    ("spine1", (0.0, 0.06, 0.0), (0.135, 0.17, 0.105)),
    ("spine3", (0.0, 0.0, 0.015), (0.16, 0.2, 0.115)),
    ("spine3", (0.0, 0.1, 0.0), (0.2, 0.085, 0.08)),
    ("head", (0.0, 0.08, 0.018), (0.074, 0.108, 0.092)),
)


def human_shapes(person: Person) -> tuple[Shapes, Shapes]:
    """Return a person's cylinders and rounded shapes over time."""
    growth = person.height / REFERENCE_HEIGHT
    radii = np.array([growth * _radius(joint) for joint in JOINTS])
    return _limbs(person, radii), _roundings(person, radii, growth)


def _radius(joint: str) -> float:
    if joint == "pelvis":
        return _RADII["spine1"]
    name = joint.removeprefix("left_").removeprefix("right_")
    if name in _RADII:
        return _RADII[name]
    return _PALM_RADIUS if name.endswith("1") else _FINGER_RADIUS


def _limbs(person: Person, radii: np.ndarray) -> Shapes:
    """Return a cylinder from each joint's parent to the joint, of its mean length."""
    ends = np.array([JOINT_INDEX[joint] for joint, parent in PARENT.items() if parent is not None])
    starts = np.array([JOINT_INDEX[parent] for parent in PARENT.values() if parent is not None])
    places = person.joint_positions
    along = places[:, ends] - places[:, starts]
    lengths = np.linalg.norm(along, axis=-1, keepdims=True)
    halves = 0.5 * lengths[..., 0].mean(axis=0)
    return Shapes.of(
        Kind.CYLINDER,
        np.column_stack([radii[ends], radii[ends], halves]),
        COLOUR,
        0.5 * (places[:, starts] + places[:, ends]),
        rotations_to(along / np.where(lengths > 0, lengths, 1.0)),
    )


def _roundings(person: Person, radii: np.ndarray, growth: float) -> Shapes:
    """Return a ball at every joint, as wide as the widest limb there, and the ellipsoids of trunk and head."""
    widest = radii.copy()
    for joint, parent in PARENT.items():
        if parent is not None:
            index = JOINT_INDEX[parent]
            widest[index] = max(widest[index], radii[JOINT_INDEX[joint]])
    joints = [JOINT_INDEX[joint] for joint, _, _ in _ROUNDINGS]
    middles = growth * np.array([middle for _, middle, _ in _ROUNDINGS])
    halves = growth * np.array([half for _, _, half in _ROUNDINGS])
    turns = person.joint_quats[:, joints]
    middle = person.joint_positions[:, joints] + se3.rotate(turns, middles)
    return Shapes.of(
        Kind.SPHERE,
        np.concatenate([np.repeat(widest[:, None], 3, axis=1), halves]),
        COLOUR,
        np.concatenate([person.joint_positions, middle], axis=1),
        np.concatenate([person.joint_quats, turns], axis=1),
    )


def has_pieces(person: Person) -> bool:
    """Return whether a person's skin may be drawn in rigid pieces: a rig's own, bent from its rest pose, would tear."""
    return isinstance(person.shape, BodyShape) or (person.shape is not None and person.shape.is_rigid)


def human_skin(person: Person) -> tuple[Solid, ...]:
    """Return the skin of a person in pieces."""
    shape = person.shape
    assert shape is not None, "there is a skin"
    unturned = np.tile(se3.IDENTITY_QUAT, (len(JOINTS), 1))  # A body model rests in the T-pose.
    turns = shape.rest_quats if isinstance(shape, SkinnedMesh) else unturned
    # A triangle belongs to the joint of most of its corners: the middle one of the three in order.
    owners = np.sort(shape.owners[shape.faces], axis=1)[:, 1]
    pieces = []
    for index in range(len(JOINTS)):
        faces = shape.faces[owners == index]
        if len(faces):
            used, corners = np.unique(faces, return_inverse=True)
            vertices = se3.rotate_inverse(turns[index], shape.rest_vertices[used] - shape.rest_joints[index])
            positions, quats = person.joint_positions[:, index], person.joint_quats[:, index]
            pieces.append(Solid(vertices, corners.reshape(faces.shape), COLOUR, positions, quats))
    return tuple(pieces)


_TOE_HEIGHT = 0.0145  # Of a standing person's toe joint, as a share of the stature.


def person_in_pose(kinematics: Kinematics, aside: Float[np.ndarray, "3"]) -> Person:
    """Return a person of the robot's stature on the floor, with limbs turned as the robot's in one pose or several.

    `aside` leads from the robot's pelvis to the person's [m]; its height does not count.
    """
    spec = kinematics.model.spec
    bones, quats = rest_offsets(spec.stature), joint_quats(kinematics)
    positions = world_positions(kinematics.site_position("pelvis") + aside, bones, quats, PARENTS)
    toes = positions[:, [JOINT_INDEX["left_foot"], JOINT_INDEX["right_foot"]], 2].min(axis=1)
    positions[..., 2] += (_TOE_HEIGHT * spec.stature - toes)[:, None]
    return Person("person", positions, quats)
