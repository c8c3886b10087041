"""Links that point away from the human's are named, with frames."""

from dataclasses import replace

import numpy as np

from hoi_retarget.motion.report import OrientationFlip
from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.config import Scaling
from hoi_retarget.retargeting.orientation_flips import orientation_flips, rotation_errors_deg
from hoi_retarget.retargeting.targets import Targets, make_targets
from hoi_retarget.synthetic import make
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
    assert (found.site, found.first_frame, found.last_frame) == ("left_wrist", 5, 8)
    np.testing.assert_allclose(found.largest_deg, 150.0, atol=1e-6)
    assert str(OrientationFlip("left_wrist", 5, 8, 150.0)).startswith("left_wrist is turned by up to 150 degrees")
