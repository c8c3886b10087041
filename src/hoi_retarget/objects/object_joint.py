"""Joints between objects: a door in its frame, a lid on its box, a drawer.

Parts are objects of their own, whose poses stay poses in the world. A joint tells how a part may move in the frame of
its parent; axis and anchor are fitted to poses where a source does not tell them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import ClipError
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import JointKind, ObjectJoint, ObjectTrack

KINDS: tuple[JointKind, ...] = get_args(JointKind)
MAX_OFF, MAX_OFF_DEG = 0.005, 2.0  # Of a part from where its joint puts it [m], [deg].
MIN_TURN_DEG, MIN_SLIDE = 5.0, 0.02  # Below them no axis can be fitted [deg], [m].


@dataclass(frozen=True, eq=False)
class JointPath:
    """A part along its joint over T frames, in its parent's frame; all states of a joint that is fixed are zero."""

    joint: ObjectJoint
    rest_position: Float[np.ndarray, "3"]  # Of the part's origin where the state is zero, as in the first frame [m].
    rest_quat: Float[np.ndarray, "4"]
    states: Float[np.ndarray, "T"]  # Angles [rad], or ways [m].

    def poses(self, scale: float = 1.0) -> tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 4"]]:
        """Return the part's positions [m] and rotations (wxyz) in its parent's frame, `scale` times as large."""
        axis, anchor = np.array(self.joint.axis), np.array(self.joint.anchor)
        if self.joint.kind != "hinge":
            quats = np.tile(self.rest_quat, (len(self.states), 1))
            return scale * (self.rest_position + self.states[:, None] * axis), quats
        turns = se3.exp(self.states[:, None] * axis)
        positions = anchor + se3.rotate(turns, self.rest_position - anchor)
        return scale * positions, se3.quat_multiply(turns, self.rest_quat)

    def in_world(
        self, position: Float[np.ndarray, "T 3"], quat: Float[np.ndarray, "T 4"], scale: float
    ) -> tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 4"]]:
        """Return the part's positions [m] and rotations (wxyz) with the parent at these."""
        own, turns = self.poses(scale)
        return position + se3.rotate(quat, own), se3.quat_multiply(quat, turns)


def path_of(joint: ObjectJoint, parent: ObjectTrack, part: ObjectTrack) -> JointPath:
    """Return the path along a joint that is nearest to the poses of a part and its parent."""
    position, quat = _in_parent(parent, part)
    axis, states = np.array(joint.axis), np.zeros(len(position))
    if joint.kind == "hinge":
        turned = se3.quat_continuous(se3.quat_multiply(quat, se3.quat_conjugate(quat[0])))
        states = np.unwrap(2.0 * np.arctan2(turned[:, 1:] @ axis, turned[:, 0]))
    elif joint.kind == "slide":
        states = (position - position[0]) @ axis
    # At rest it is at the mean of its poses, each moved back to the first frame.
    if joint.kind == "hinge":
        back, anchor = se3.exp(-states[:, None] * axis), np.array(joint.anchor)
        rest, quat = anchor + se3.rotate(back, position - anchor), se3.quat_multiply(back, quat)
    else:
        rest = position - states[:, None] * axis
    rest_quat = se3.quat_normalize(se3.quat_continuous(quat).mean(axis=0))
    return JointPath(joint, rest.mean(axis=0), rest_quat, states)


def distance_from(path: JointPath, parent: ObjectTrack, part: ObjectTrack) -> tuple[float, float]:
    """Return how far a part is from its joint's path at most, [m] and [deg]."""
    position, quat = _in_parent(parent, part)
    own, turns = path.poses()
    off = np.linalg.norm(own - position, axis=1).max()
    return float(off), float(np.degrees(se3.angle_between(turns, quat)).max())


def fitted_joint(parent: ObjectTrack, part: ObjectTrack, kind: JointKind | None = None) -> ObjectJoint | None:
    """Return the joint of a kind, or of the first kind that fits, from poses; None where none fits."""
    position, quat = _in_parent(parent, part)
    for candidate in KINDS if kind is None else (kind,):
        joint = _FITS[candidate](parent.name, position, quat)
        if joint is not None:
            off, turned = distance_from(path_of(joint, parent, part), parent, part)
            if off <= MAX_OFF and turned <= MAX_OFF_DEG:
                return joint
    return None


def world_of(track: ObjectTrack) -> ObjectTrack:
    """Return the world as the parent of an object that is fixed in it."""
    frames = len(track.positions)
    return replace(track, name="", positions=np.zeros((frames, 3)), quats=np.tile(se3.IDENTITY_QUAT, (frames, 1)))


def scaled(joint: ObjectJoint, scale: float) -> ObjectJoint:
    """Return the joint of objects that are `scale` times as large."""
    return replace(joint, anchor=tuple((scale * np.array(joint.anchor)).tolist()))


def mirrored_joint(joint: ObjectJoint) -> ObjectJoint:
    """Return the joint of objects that are mirrored at the planes y = 0 of their frames; its states stay."""
    (x, y, z), (along, across, up) = joint.axis, joint.anchor
    axis = (-x, y, -z) if joint.kind == "hinge" else (x, -y, z)
    return replace(joint, axis=axis, anchor=(along, -across, up))


def parents_of(tracks: Sequence[ObjectTrack]) -> tuple[int, ...]:
    """Return the index of each object's parent, -1 where it has none.

    Raises `ClipError` where a joint names no other object, or parts hang on each other in a circle.
    """
    names = [track.name for track in tracks]
    found = []
    for track in tracks:
        parent = track.joint.parent if track.joint is not None else ""
        if parent and parent not in names:
            raise ClipError(f"object {track.name!r}: it hangs on {parent!r}; the objects are {', '.join(names)}.")
        found.append(names.index(parent) if parent else -1)
    if len(depth_first(found)) < len(found):
        raise ClipError(f"objects {', '.join(names)}: parts hang on each other in a circle.")
    return tuple(found)


def depth_first(parents: Sequence[int], root: int = -1) -> list[int]:
    """Return the objects depth first, each behind its parent, as a tree of bodies has them; of one root, if given."""
    found, waiting = [], [root]
    while waiting:
        found.append(waiting.pop())
        waiting += [child for child in range(len(parents) - 1, -1, -1) if parents[child] == found[-1]]
    return found[root < 0 :]


def root_of(parents: Sequence[int], index: int) -> int:
    """Return the object of which an object is a part, or a part's part; itself where it is none."""
    while parents[index] >= 0:
        index = parents[index]
    return index


def _in_parent(parent: ObjectTrack, part: ObjectTrack) -> tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 4"]]:
    back = se3.quat_conjugate(parent.quats)
    turns = se3.quat_continuous(se3.quat_multiply(back, part.quats))
    return se3.rotate(back, part.positions - parent.positions), turns


def _slide(parent: str, position: np.ndarray, quat: np.ndarray) -> ObjectJoint | None:
    way = position - position.mean(axis=0)
    axis = np.linalg.svd(way, full_matrices=False)[2][0]
    along = way @ axis
    if np.ptp(along) < MIN_SLIDE:
        return None
    return ObjectJoint(parent, "slide", tuple((axis * _sign(along - along[0])).tolist()))


def _hinge(parent: str, position: np.ndarray, quat: np.ndarray) -> ObjectJoint | None:
    turned = se3.quat_continuous(se3.quat_multiply(quat, se3.quat_conjugate(quat[0])))
    axis = np.linalg.svd(turned[:, 1:], full_matrices=False)[2][0]
    angles = np.unwrap(2.0 * np.arctan2(turned[:, 1:] @ axis, turned[:, 0]))
    if np.degrees(np.ptp(angles)) < MIN_TURN_DEG:
        return None
    # A part at r about a point a of the axis is at a + R r: both are found together, up to a way along the axis.
    rotations = se3.quat_to_matrix(se3.exp(angles[:, None] * axis))
    rows = np.concatenate([np.broadcast_to(np.eye(3), rotations.shape), rotations], axis=2).reshape(-1, 6)
    anchor, arm = np.split(np.linalg.lstsq(rows, position.reshape(-1), rcond=None)[0], 2)
    anchor = anchor + axis * (axis @ arm)
    axis = axis * _sign(angles - angles[0])
    return ObjectJoint(parent, "hinge", tuple(axis.tolist()), tuple(anchor.tolist()))


def _sign(states: Float[np.ndarray, "T"]) -> float:
    return 1.0 if states[np.abs(states).argmax()] >= 0.0 else -1.0  # Of the state that is farthest from zero.


_FITS = {"fixed": lambda parent, _position, _quat: ObjectJoint(parent, "fixed"), "hinge": _hinge, "slide": _slide}
