"""Makers' files of real humanoids: each is made a robot of without a hint, or refused with its reason.

They are not part of the project: `../shared/data/robots`, described in its README.
"""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

import hoi_retarget as hr
from hoi_retarget.cli.robots import gates_of, without_shapes
from hoi_retarget.errors import RobotError
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.adding.build import build_robot
from hoi_retarget.robots.adding.findings import Hints, UnsuitableRobotError
from hoi_retarget.robots.spec import SIDES

FOLDER = Path(__file__).parents[2] / "shared" / "data" / "robots"
ROBOTS = {
    "unitree_g1/g1_29dof_rev_1_0.xml": (29, 0, "left_knee_joint", "left_elbow_joint"),
    "unitree_g1/g1_29dof_rev_1_0.urdf": (29, 0, "left_knee_joint", "left_elbow_joint"),
    "unitree_g1_23/g1_23dof_rev_1_0.urdf": (23, 0, "left_knee_joint", "left_elbow_joint"),
    "unitree_g1_hands/g1_29dof_with_hand_rev_1_0.urdf": (29, 14, "left_knee_joint", "left_elbow_joint"),
    "unitree_h1/h1.urdf": (19, 0, "left_knee_joint", "left_elbow_joint"),
    "unitree_h2/H2.urdf": (31, 0, "left_knee_joint", "left_elbow_joint"),
    "unitree_r1/R1.urdf": (26, 0, "left_knee_joint", "left_elbow_joint"),
    "booster_t1/T1_23dof.urdf": (23, 0, "Left_Knee_Pitch", "Left_Elbow_Yaw"),
    "fourier_n1/n1_mocap.xml": (23, 0, "left_knee_pitch_joint", "left_elbow_pitch_joint"),
    "hightorque_hi/hi_25dof.urdf": (25, 0, "l_calf_joint", "l_elbow_joint"),
    "openloong/AzureLoong.xml": (31, 0, "J_knee_l_pitch", "J_arm_l_04"),
    "toddlerbot/toddy_mocap.xml": (22, None, "left_knee", "left_elbow_roll"),
    "agibot_x1/x1_all.xml": (29, 0, "left_knee_pitch_joint", "left_elbow_pitch_joint"),
    "engineai_pm01/xml/serial_pm_v2.xml": (24, 0, "J03_KNEE_PITCH_L", "J16_ELBOW_PITCH_L"),
    "unitree_h1_2_inspire/h1_2.urdf": (27, 24, "left_knee_joint", "left_elbow_joint"),
}
"""File -> joints that move, joints that are held, left knee and left elbow by the makers' names."""
REFUSED = {"galaxea_r1pro/r1_pro.xml": "stands on wheels"}

pytestmark = [pytest.mark.slow, pytest.mark.skipif(not FOLDER.is_dir(), reason=f"{FOLDER} is not here")]


@pytest.mark.parametrize("file", ROBOTS)
def test_file_is_made_a_robot_of(tmp_path, file):
    joints, held, knee, elbow = ROBOTS[file]
    built = build_robot(FOLDER / file, "made", Hints())
    assert len(built.spec.speed_limits) == joints
    assert held is None or len(built.spec.held) == held
    said = {finding.subject: finding.what for finding in built.findings}
    assert said["left knee"].startswith(f"{knee}, ")
    assert said["left elbow"].startswith(f"{elbow}, ")
    assert max(built.home.missed_deg.values()) < 5.0
    model = without_shapes(built.spec, built.mjcf, tmp_path)
    motion = hr.retarget(hr.open_clip("builtin:carry_box"), model, hr.Config(contact="landmark"))
    assert not [what for what, holds in gates_of(motion, model) if not holds]


@pytest.mark.parametrize("file", REFUSED)
def test_file_is_refused_with_the_reason(file):
    with pytest.raises(UnsuitableRobotError, match=REFUSED[file]):
        build_robot(FOLDER / file, "made", Hints())


def test_any_other_file_is_made_a_robot_of_or_refused_in_words():
    there = {str(path.relative_to(FOLDER)) for suffix in ("urdf", "xml") for path in FOLDER.rglob(f"*.{suffix}")}
    assert there >= {*ROBOTS, *REFUSED}
    for file in sorted(there - {*ROBOTS, *REFUSED}):
        with suppress(RobotError):
            assert build_robot(FOLDER / file, "made", Hints()).findings


@pytest.mark.parametrize(
    ("file", "name"), [("unitree_g1/g1_29dof_rev_1_0.urdf", "unitree_g1"), ("unitree_h2/H2.urdf", "unitree_h2")]
)
def test_found_joints_and_sites_are_those_of_the_robot_made_by_hand(tmp_path, file, name):
    built = build_robot(FOLDER / file, "made", Hints())
    found, ours = without_shapes(built.spec, built.mjcf, tmp_path), load_robot(name)
    assert set(found.joint_names) == set(ours.joint_names)
    # The zero poses are the same, and so are the roots; elbows and shoulders are defined elsewhere by hand.
    zero = np.array([0, 0, 0, 1, 0, 0, 0], dtype=float)
    places = [model.forward(np.concatenate([zero, np.zeros(model.n)])[None]) for model in (found, ours)]
    for side in SIDES:
        for site, apart in (("knee", 0.005), ("wrist", 0.005), ("foot", 0.04), ("palm", 0.05), ("hip", 0.05)):
            one, other = (kinematics.site_position(f"{side}_{site}")[0] for kinematics in places)
            # A knee's middle may be anywhere along its axis.
            away = (one - other)[[0, 2]] if site == "knee" else one - other
            assert np.linalg.norm(away) < apart, (side, site)


def test_upper_body_on_wheels_reaches_its_contacts(tmp_path):
    built = build_robot(FOLDER / "galaxea_r1pro/r1_pro.xml", "made", Hints(base="follows"))
    model = without_shapes(built.spec, built.mjcf, tmp_path)
    for clip in ("builtin:carry_box", "builtin:push_table"):
        motion = hr.retarget(hr.open_clip(clip), model, hr.Config(contact="landmark"))
        assert not [what for what, holds in gates_of(motion, model) if not holds]
