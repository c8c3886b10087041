"""Which bodies of a file are objects: those that no link of the robot carries."""

import numpy as np

from hoi_retarget.motion.check.bodies import FoundBodies
from hoi_retarget.motion.formats import MotionFile, ObjectPoses
from hoi_retarget.numerics import se3

_WORLD = "world"
_FIXED = 1e-3
"""A body whose origin wanders less in a link's frame is carried by the link [m]."""
_MOVES = 0.02
"""...unless it wanders less than this in the world: then nothing is told [m]."""


def objects_among_bodies(file: MotionFile, found: FoundBodies | None) -> list[ObjectPoses]:
    """Return the bodies with names that are neither links of the robot nor carried by them.

    Fixed links, fingers and what hangs on them keep their origin's place in the frame of the link before them.
    """
    if file.bodies is None or file.body_names is None or found is None:
        return []
    pos = found.reading.position(file.bodies.pos)
    quat = found.reading.rotation(file.bodies.quat)
    links = list(found.there.places.values())
    others = [index for index, name in enumerate(file.body_names) if index not in links and name != _WORLD]
    while carried := [index for index in others if _is_carried(pos, quat, index, links)]:
        links = carried
        others = [index for index in others if index not in carried]
    poses = np.concatenate([file.bodies.pos, file.bodies.quat], axis=2)
    return [
        ObjectPoses(file.body_names[index], poses[:, index])
        for index in others
        if not file.body_names[index].endswith("_link")
    ]


def _is_carried(pos: np.ndarray, quat: np.ndarray, index: int, links: list[int]) -> bool:
    if np.ptp(pos[:, index], axis=0).max() < _MOVES:
        return False
    local = se3.rotate_inverse(quat[:, links], pos[:, index, None] - pos[:, links])
    return bool((np.ptp(local, axis=0).max(axis=1) < _FIXED).any())
