"""Robots of which the upper body alone follows a person: what carries it is no part of the problem."""

from itertools import product

import numpy as np
import pytest

import hoi_retarget as hr
from hoi_retarget.cli.robots import without_shapes
from hoi_retarget.dynamics.feasibility import forces_on_clip
from hoi_retarget.dynamics.physics_scene import scene_of
from hoi_retarget.errors import ArgumentError, RobotError
from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.mobile_base_path import mobile_base_path
from hoi_retarget.retargeting.targets import make_targets
from hoi_retarget.retargeting.trajopt.normal import assemble
from hoi_retarget.retargeting.trajopt.trajectory_terms import trajectory_terms
from hoi_retarget.robots import robot, user_robots
from hoi_retarget.robots.adding.build import build_robot
from hoi_retarget.robots.adding.findings import Hints, UnsuitableRobotError, read_hints
from synthetic_humanoids import Choices, humanoid

CLIP = "builtin:push_table"
LANDMARK = hr.Config(contact="landmark")


def built_of(tmp_path, base, **choices):
    made = humanoid(Choices(3, **{"waist": 2, **choices}))
    path = tmp_path / "maker.xml"
    path.write_text(made.mjcf)
    return made, build_robot(path, "made", Hints(base=base))


def on_wheels(tmp_path, base=""):
    """Write a humanoid whose legs are gone, on a box with wheels."""
    text = humanoid(Choices(3, waist=2)).mjcf
    for side in ("left", "right"):
        start = text.index(f'<body name="{side}_thigh"')
        depth, at = 0, start
        while True:
            opening, closing = text.find("<body", at), text.find("</body>", at)
            depth, at = (depth + 1, opening + 5) if 0 <= opening < closing else (depth - 1, closing + 7)
            if depth == 0:
                break
        wheel = (
            f'<body name="{side}_wheel" pos="0 0 -0.8"><joint name="{side}_wheel_joint" axis="0 1 0"/>'
            '<geom type="cylinder" size="0.1 0.02" mass="1"/></body>'
        )
        text = text[:start] + wheel + text[at:]
    path = tmp_path / "wheels.xml"
    path.write_text(text)
    return build_robot(path, "wheels", Hints(base=base))


@pytest.mark.parametrize("base", ["follows", "stays"])
def test_base_looks_where_the_person_does_however_far_the_pelvis_bends_or_leans(tmp_path, base):
    _, built = built_of(tmp_path, base)
    model = without_shapes(built.spec, built.mjcf, tmp_path)
    pelvis, working = np.tile([0.3, -0.2, 0.8], (9, 1)), np.ones(9, dtype=bool)
    hanging = np.tile(model.home_qpos[7:], (9, 1))
    for axis, angle, turn in product((0, 1), (0.0, 1.0, np.pi / 2, 2.2, -np.pi / 2), (0.0, 1.2, -2.5, np.pi)):
        lean = se3.exp(np.eye(3)[axis] * angle)
        quats = np.tile(se3.quat_multiply(se3.exp(np.array([0.0, 0.0, turn])), lean), (9, 1))
        quats[4] = se3.exp(np.array([np.pi, 0.0, 0.0]))  # Upside down for a moment: that frame says nothing.
        path = mobile_base_path(model, pelvis, quats, working, 30.0)
        ahead = model.forward(np.concatenate([path, hanging], axis=1)).site_rotation("pelvis")[:, :2, 0]
        np.testing.assert_allclose(ahead, np.tile([np.cos(turn), np.sin(turn)], (9, 1)), atol=1e-6)


@pytest.mark.parametrize(("root", "waist", "yaw"), [("pelvis", 3, 0.0), ("torso", 2, 1.0), ("pelvis", 1, np.pi)])
def test_arms_and_trunk_are_those_of_the_whole_robot_and_legs_are_held(tmp_path, root, waist, yaw):
    truth, built = built_of(tmp_path, "stays", root=root, waist=waist, yaw=yaw)
    moved, held = set(built.spec.speed_limits), {one.joint for one in built.spec.held}
    legs = {joint for role, joint in truth.joints.items() if any(part in role for part in ("hip", "knee", "ankle"))}
    arms = {
        joint for role, joint in truth.joints.items() if any(part in role for part in ("shoulder", "elbow", "wrist"))
    }
    assert legs <= held and arms <= moved and not moved & held
    assert moved | held == set(truth.order)
    assert max(built.home.missed_deg.values()) < 5.0
    assert set(built.spec.part_sites) == {"left_hand", "right_hand"}


@pytest.mark.parametrize("base", ["stays", "follows"])
def test_base_and_lower_joints_keep_their_values_to_the_bit(tmp_path, base):
    _, built = built_of(tmp_path, base)
    model = without_shapes(built.spec, built.mjcf, tmp_path)
    motion = hr.retarget(hr.open_clip(CLIP), model, LANDMARK)
    assert motion.converged
    for stage in motion.stages:
        for column in {"stays": range(7), "follows": (2,)}[base]:
            assert np.ptp(stage.qpos[:, column]) == 0.0, (stage.name, column)
        upright = se3.quat_to_matrix(stage.qpos[:, 3:7])[:, 2]
        np.testing.assert_allclose(upright, np.broadcast_to(upright[0], upright.shape), atol=1e-12)
    if base == "follows":
        assert np.ptp(motion.qpos[:, :2], axis=0).max() > 0.5, "the person goes somewhere"
    # Nothing of the legs is in what was solved: exports give all of them back as they are held.
    assert not {one.joint for one in built.spec.held} & set(motion.joint_names)
    assert not motion.stance_flags.any()
    assert not [
        flip.subject for flip in motion.report.orientation_flips if "hip" in flip.subject or "knee" in flip.subject
    ]


def test_contacts_are_exact_where_the_base_follows(tmp_path):
    _, built = built_of(tmp_path, "follows", waist=3)
    model = without_shapes(built.spec, built.mjcf, tmp_path)
    motion = hr.retarget(hr.open_clip(CLIP), model, LANDMARK)
    figures = motion.report.figures
    assert figures["contact_gap_m"] is not None and figures["contact_gap_m"] < 0.002
    assert not motion.report.unreached_contacts
    assert figures["body_pose_deviation_deg"] is not None and figures["body_pose_deviation_deg"] < 30.0


@pytest.mark.parametrize("base", ["stays", "follows"])
def test_fixed_coordinates_are_decoupled_and_the_others_are_as_without_them(tmp_path, base):
    """The normal matrix is that of the free coordinates alone: what is fixed has no part in any step."""
    _, built = built_of(tmp_path, base)
    model = without_shapes(built.spec, built.mjcf, tmp_path)
    targets = make_targets(hr.open_clip(CLIP), model, hr.Scaling(), contact="landmark").window(0, 8)
    rng = np.random.default_rng(0)
    assert targets.base_qpos is not None and len(targets.base_qpos) == 8
    qpos = np.concatenate([targets.base_qpos, model.home_qpos[7:] + 0.1 * rng.normal(size=(8, model.n))], axis=1)
    kinematics = model.forward(qpos)
    rows = [part for term in trajectory_terms(hr.Weights(), targets, kinematics) for part in term.rows(kinematics)]
    equations = assemble(kinematics, rows)
    dense = dense_of(equations.band)
    fixed = np.tile(model.fixed_columns, 8)
    np.testing.assert_array_equal(dense[np.ix_(fixed, ~fixed)], 0.0)
    np.testing.assert_array_equal(dense[np.ix_(fixed, fixed)], np.eye(fixed.sum()))
    np.testing.assert_array_equal(equations.gradient[:, model.fixed_columns], 0.0)
    object.__setattr__(model, "fixed_columns", np.zeros(model.nv, dtype=bool))
    whole = assemble(kinematics, rows)
    np.testing.assert_array_equal(dense_of(whole.band)[np.ix_(~fixed, ~fixed)], dense[np.ix_(~fixed, ~fixed)])
    assert np.abs(dense_of(whole.band)[np.ix_(fixed, ~fixed)]).max() > 0.0, "there was a coupling"


def dense_of(band):
    frames, nv, width = band.shape
    dense = np.zeros((frames * nv, frames * nv))
    for index in range(frames * nv):
        for further in range(min(width, frames * nv - index)):
            dense[index + further, index] = dense[index, index + further] = band[index // nv, index % nv, further]
    return dense


def test_wheels_are_refused_unless_the_upper_body_alone_is_asked_for(tmp_path):
    with pytest.raises(UnsuitableRobotError, match=r'wheel.*base = "follows" or base = "stays"'):
        on_wheels(tmp_path)
    built = on_wheels(tmp_path, "follows")
    assert {"left_wheel_joint", "right_wheel_joint"} <= {one.joint for one in built.spec.held}
    model = without_shapes(built.spec, built.mjcf, tmp_path)
    lowest = min(
        model.forward(model.home_qpos[None]).site_position(f"left_sole_{end}_inner")[0, 2] for end in ("heel", "toe")
    )
    assert lowest == pytest.approx(0.0, abs=1e-6)
    assert hr.retarget(hr.open_clip(CLIP), model, LANDMARK).converged


def test_base_that_stays_stands_where_the_hands_work_is(tmp_path):
    _, built = built_of(tmp_path, "stays")
    model = without_shapes(built.spec, built.mjcf, tmp_path)
    clip = hr.open_clip(CLIP)
    targets = make_targets(clip, model, hr.Scaling())
    person = targets.root_scale * clip.people[0].position("pelvis")[targets.contact_flags.any(axis=1), :2].mean(axis=0)
    assert targets.base_qpos is not None
    pelvis = model.forward(np.concatenate([targets.base_qpos[0], model.home_qpos[7:]])[None]).site_position("pelvis")
    np.testing.assert_allclose(pelvis[0, :2], person, atol=0.02)
    upright = se3.quat_to_matrix(targets.base_qpos[0, 3:7])[2] - se3.quat_to_matrix(model.home_qpos[3:7])[2]
    np.testing.assert_allclose(upright, 0.0, atol=1e-12)


def test_physics_of_robots_on_a_base_is_refused_with_the_reason(tmp_path):
    _, built = built_of(tmp_path, "follows")
    model = without_shapes(built.spec, built.mjcf, tmp_path)
    clip = hr.open_clip(CLIP)
    motion = hr.retarget(clip, model, LANDMARK)
    for asked in (lambda: scene_of(motion, model, clip.objects), lambda: forces_on_clip(motion, clip, model)):
        with pytest.raises(RobotError, match=r"its base follows, .* robots on legs"):
            asked()
    assert motion.report.figures["missing_wrench_p95_share"] is None


def test_added_robot_knows_what_its_base_does(tmp_path, monkeypatch):
    monkeypatch.setenv("HOI_RETARGET_ROBOTS", str(tmp_path / "robots"))
    _, built = built_of(tmp_path, "follows")
    user_robots.save(built.spec, built.mjcf)
    assert robot("made").base == "follows"
    (tmp_path / "hints.toml").write_text('base = "rolls"')
    with pytest.raises(ArgumentError, match="base"):
        read_hints(tmp_path / "hints.toml")
