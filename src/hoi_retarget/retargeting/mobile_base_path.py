"""Where a base goes that carries an upper body: given before anything is solved, upright and at one height."""

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import smooth
from hoi_retarget.robots.model import RobotModel

_UP = np.array([0.0, 0.0, 1.0])
_LEAST = 0.1  # Of a heading's length, which is 1 upright and 0 upside down: with less, a pelvis says nothing of it.


def mobile_base_path(
    model: RobotModel,
    pelvis: Float[np.ndarray, "T 3"],
    quats: Float[np.ndarray, "T 4"],
    working: Bool[np.ndarray, "T"],
    fps: float,
) -> Float[np.ndarray, "T 7"]:
    """Return position [m] and rotation of the root in every frame.

    A base that follows has its pelvis over the person's, smoothly; one that stays has it where the person's is on
    average while the hands touch something, or always where they never do.

    Args:
        model: The robot.
        pelvis: Target of the site `pelvis` [m].
        quats: Its rotation, x ahead.
        working: Whether a hand touches something.
        fps: Of the frames.
    """
    planar = np.column_stack([pelvis[:, :2], _headings(quats)])
    if model.spec.base == "stays":
        planar = np.repeat(planar[working if working.any() else slice(None)].mean(axis=0)[None], len(pelvis), axis=0)
    else:
        planar = smooth(planar, fps)
    turn = se3.exp(np.arctan2(planar[:, 3], planar[:, 2])[:, None] * _UP)
    home = model.forward(model.home_qpos[None])
    to_root = model.home_qpos[:3] - home.site_position("pelvis")[0]
    own = home.site_rotation("pelvis")[0][:, 0]
    turn = se3.quat_multiply(turn, se3.exp(-np.arctan2(own[1], own[0]) * _UP))
    place = np.column_stack([planar[:, :2], np.full(len(planar), home.site_position("pelvis")[0, 2])])
    return np.column_stack([place + se3.rotate(turn, to_root), se3.quat_multiply(turn, model.home_qpos[3:7])])


def _headings(quats: Float[np.ndarray, "T 4"]) -> Float[np.ndarray, "T 2"]:
    """Return where pelvises look, as seen from above, of unit length, however far they bend or lean.

    It is the turn about the vertical that is left when a pelvis is brought upright on the shortest way. Upside down
    there are many; the heading is then that of the nearest frame that has one.
    """
    turns = se3.quat_to_matrix(quats)
    ahead, left = turns[:, :2, 0], turns[:, :2, 1]
    headings = 0.5 * (ahead + np.column_stack([left[:, 1], -left[:, 0]]))
    lengths = np.linalg.norm(headings, axis=1, keepdims=True)
    known = np.flatnonzero(lengths > _LEAST)
    if not len(known):
        return np.tile([1.0, 0.0], (len(quats), 1))
    nearest = np.rint(np.interp(np.arange(len(quats)), known, np.arange(len(known)))).astype(int)
    return (headings / np.maximum(lengths, _LEAST))[known[nearest]]
