"""A clip in which somebody sits down on a stool, at known times, for tests of contacts that rest."""

import numpy as np

from hoi_retarget.clip.clip import Clip
from hoi_retarget.human.capsules import RESTING_CAPSULES
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectTrack
from synthetic.human import SIDES, STANDING_PELVIS_HEIGHT, Body, HandGoal, Trunk, hand_quat, heading_quat
from synthetic.object_shapes import Block, Shape
from synthetic.walking import Place, Walk, bump, feet_of, minimum_jerk

HEIGHT = 1.75
DOWN, SEATED = 0.7, 1.9
"""When the person begins to sit down, and sits [s]."""
SEAT = 0.42
"""Height of the stool [m]."""


def sits_down(*, seconds: float = 3.5, fps: float = 30.0, gap: float = 0.0) -> Clip:
    """The person stands before a stool, sits down on it and stays; looks along +x.

    Args:
        seconds: Duration [s].
        fps: Frames a second.
        gap: How far off the seat the person stays [m].
    """
    times = np.arange(round(seconds * fps)) / fps
    sat, zero = minimum_jerk(times, DOWN, SEATED), np.zeros_like(times)
    body = Body(HEIGHT, len(times))
    pitch = 0.6 * bump(times, DOWN, SEATED)
    (flesh,) = RESTING_CAPSULES["pelvis"]
    hips = se3.rotate(heading_quat(zero, pitch, zero), body.offset("left_hip")[None])[:, 2]
    low = SEAT + gap + flesh.radius * HEIGHT / 1.75 - hips
    pelvis = np.stack(
        [-0.27 * HEIGHT * sat, zero, (1.0 - sat) * 0.97 * STANDING_PELVIS_HEIGHT * HEIGHT + sat * low], axis=1
    )
    quat = heading_quat(zero, pitch, zero)
    body.set_trunk(Trunk(pelvis, quat, heading_quat(zero, 1.3 * pitch, zero), heading_quat(zero, pitch, zero)))
    for side, name in enumerate(SIDES):
        body.set_foot(name, feet_of(Walk(Place(0.0, 0.0)), HEIGHT, times)[side])
        outward = np.array([0.0, 1.0 if side == 0 else -1.0, 0.0])
        wrist = body.position(f"{name}_shoulder") + 0.24 * HEIGHT * np.array([0.75, 0.0, -0.4]) + 0.02 * outward
        turn = hand_quat(name, np.array([[1.0, 0.0, -0.3]]), np.array([[0.0, 0.0, -1.0]]))
        elbow = np.tile(np.array([-0.5, 0.0, -0.8]) + 0.4 * outward, (len(times), 1))
        body.set_hand(name, HandGoal(wrist, np.tile(turn, (len(times), 1)), elbow, zero + 0.3, zero))
    stool = Shape("stool", (0.4, 0.4, SEAT), (Block((-0.2, -0.2, 0.0), (0.2, 0.2, SEAT)),))
    place = np.tile([-0.27 * HEIGHT - 0.02, 0.0, 0.5 * SEAT], (len(times), 1))
    still = np.tile(se3.IDENTITY_QUAT, (len(times), 1))
    return Clip("sits_down", fps, (body.person("person"),), (ObjectTrack("stool", place, still, stool.geometry),), ())
