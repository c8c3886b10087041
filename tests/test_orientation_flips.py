"""Links that point away from the human's are named, with frames."""

from dataclasses import replace

import numpy as np

from hoi_retarget.motion.motion_report import Event
from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.config import Scaling
from hoi_retarget.retargeting.orientation_flips import (
    limb_joints,
    orientation_flips,
    rotation_errors_deg,
    short_flips,
    with_reasons,
)
from hoi_retarget.retargeting.targets import Targets, make_targets
from synthetic import make
from trajectories import MODELS, random_qpos

MODEL = MODELS["unitree_g1"]
ROWS = [row.site for row in MODEL.spec.ik]


def following(frames: int) -> tuple[np.ndarray, Targets]:
    """Return a trajectory and targets that it follows exactly."""
    qpos = random_qpos(MODEL, frames, np.random.default_rng(0))
    kinematics = MODEL.forward(qpos)
    quats = np.stack([se3.matrix_to_quat(kinematics.site_rotation(site)) for site in ROWS], axis=1)
    targets = make_targets(make("carry_box"), MODEL, Scaling()).window(0, frames)
    return qpos, replace(targets, site_quats=quats)


def test_what_follows_is_not_reported():
    qpos, targets = following(20)
    assert orientation_flips(rotation_errors_deg(MODEL.forward(qpos), targets)) == ()


def test_a_turned_wrist_is_reported_with_its_frames_and_angle():
    qpos, targets = following(20)
    quats = targets.site_quats.copy()
    turn = se3.exp(np.array([0.0, 0.0, np.radians(150.0)]))
    quats[5:9, ROWS.index("left_wrist")] = se3.quat_multiply(quats[5:9, ROWS.index("left_wrist")], turn)
    (found,) = orientation_flips(rotation_errors_deg(MODEL.forward(qpos), replace(targets, site_quats=quats)))
    assert (found.subject, found.first_frame, found.last_frame) == ("left_wrist", 5, 8)
    np.testing.assert_allclose(found.value, 150.0, atol=1e-6)
    assert str(Event("orientation_flip", 5, 8, 150.0, subject="left_wrist")).startswith(
        "left_wrist is turned by up to 150 degrees"
    )


def test_a_flip_is_short_below_a_second():
    degrees = {"left_wrist": np.where(np.arange(100) % 50 < 29, 100.0, 80.0), "head": np.full(100, 91.0)}
    flips = orientation_flips(degrees)
    assert [(flip.first_frame, flip.last_frame) for flip in flips] == [(0, 28), (50, 78), (0, 99)]
    assert short_flips(degrees, 30.0) == flips[:2]
    assert short_flips(degrees, 29.0) == ()


def test_the_reason_for_a_flip_is_the_condition_of_most_of_its_frames():
    qpos, targets = following(20)
    qpos = np.tile(0.5 * np.r_[np.zeros(7), MODEL.lower + MODEL.upper], (20, 1)) + np.eye(len(qpos[0]))[3]
    joint = int(limb_joints(MODEL, "left_wrist")[-1])
    wrist = targets.contact_links.index("left_palm")
    free = replace(targets, contact_flags=np.zeros_like(targets.contact_flags))
    flip = Event("orientation_flip", 5, 8, 150.0, subject="left_wrist")

    def reason(qpos: np.ndarray, targets: Targets) -> str:
        (found,) = with_reasons((flip,), MODEL.forward(qpos), targets)
        return found.reason

    none = "no start of the inverse kinematics led past it"
    assert reason(qpos, free) == none
    for held, expected in ((slice(6, 9), True), (slice(5, 8), True), (slice(5, 7), False), (slice(9, 20), False)):
        for end in (MODEL.lower, MODEL.upper):
            stopped = qpos.copy()
            stopped[held, 7 + joint] = end[joint]
            assert reason(stopped, free) == (
                f"at the end of the range of {MODEL.joint_names[joint]}" if expected else none
            )
        flags = free.contact_flags.copy()
        flags[held, wrist] = True
        touching = reason(qpos, replace(free, contact_flags=flags))
        assert touching == ("the contact of left_palm comes first" if expected else none)
