"""A person's skin, where a body model tells it: a piece for each joint, which moves with it.

Pieces are rigid, so seams open a little at bent joints; in return every renderer that can draw a solid can draw a
person, and a frame is a pose for each joint instead of ten thousand vertices.
"""

import numpy as np

from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINTS
from hoi_retarget.viewers.scene.drawing import Solid
from hoi_retarget.viewers.scene.human_shapes import COLOUR


def human_skin(person: Person) -> tuple[Solid, ...]:
    """Return the skin of a person whose shape is known, in pieces."""
    shape = person.shape
    assert shape is not None, "there is a skin"
    # A triangle belongs to the joint of most of its corners: the middle one of the three in order.
    owners = np.sort(shape.owners[shape.model.faces], axis=1)[:, 1]
    pieces = []
    for index in range(len(JOINTS)):
        faces = shape.model.faces[owners == index]
        if len(faces):
            used, corners = np.unique(faces, return_inverse=True)
            vertices = shape.rest_vertices[used] - shape.rest_joints[index]
            positions, quats = person.joint_positions[:, index], person.joint_quats[:, index]
            pieces.append(Solid(vertices, corners.reshape(faces.shape), COLOUR, positions, quats))
    return tuple(pieces)
