"""Any humanoid from its file: what is found is what is true, for makers' choices of all kinds."""

import re
from dataclasses import replace

import numpy as np
import pytest

import hoi_retarget as hr
from hoi_retarget.cli import main
from hoi_retarget.cli.robots import without_shapes
from hoi_retarget.errors import ArgumentError, RobotError
from hoi_retarget.robots import load_robot, robot, user_robots
from hoi_retarget.robots.adding.build import build_robot
from hoi_retarget.robots.adding.description import read_description, with_ranges
from hoi_retarget.robots.adding.findings import Hints, UnsuitableRobotError, read_hints
from hoi_retarget.robots.adding.morphology import find_morphology
from hoi_retarget.robots.model import load_model
from hoi_retarget.robots.spec import SIDES
from synthetic_humanoids import Choices, humanoid


def random_choices(seed):
    rng = np.random.default_rng(1000 + seed)
    return Choices(
        seed=seed,
        root=str(rng.choice(["pelvis", "torso"])),
        waist=int(rng.integers(0, 4)),
        wrist=int(rng.integers(0, 4)),
        ankle=2,
        fingers=int(rng.choice([0, 3])),
        spread=bool(rng.integers(2)),
        knee_zero=float(rng.choice([0.0, 0.4])),
        elbow_zero=float(rng.choice([0.0, 0.8, 1.5])),
        scrambled=bool(rng.integers(2)),
        yaw=float(rng.choice([0.0, 0.5, np.pi / 2, np.pi, -1.0])),
    )


def written(tmp_path, choices):
    made = humanoid(choices)
    path = tmp_path / "maker.xml"
    path.write_text(made.mjcf)
    return made, path


@pytest.mark.parametrize("seed", range(20))
def test_what_is_found_is_what_is_true(tmp_path, seed):
    choices = random_choices(seed)
    truth, path = written(tmp_path, choices)
    found = find_morphology(read_description(path), Hints())
    axes = found.trunk.axes
    np.testing.assert_allclose(axes, truth.turn, atol=0.02, err_msg="which way it looks")
    assert {one.joint for one in found.pose.held} == set(truth.held)
    hips = 0.5 * (found.sites["left_hip"].position + found.sites["right_hip"].position)

    def seen(site):
        return axes.T @ (found.sites[site].position - hips)

    # Of a wrist with one joint, or none, nothing tells where it is.
    told = ["hip", "knee", "foot", "shoulder", "elbow", *(["wrist"] if choices.wrist > 1 else [])]
    for side in SIDES:
        for site in told:
            np.testing.assert_allclose(
                seen(f"{side}_{site}"), truth.places[f"{side}_{site}"], atol=0.012, err_msg=f"{side}_{site}"
            )
        heel, toe = truth.places[f"{side}_heel"], truth.places[f"{side}_toe_end"]
        for end, corners in ((heel, "heel"), (toe, "toe")):
            middle = 0.5 * (seen(f"{side}_sole_{corners}_inner") + seen(f"{side}_sole_{corners}_outer"))
            np.testing.assert_allclose(
                middle, end, atol=0.05 * float(np.linalg.norm(toe - heel)), err_msg=f"{side} {corners}"
            )
    for arm, side in zip(found.arms, SIDES, strict=True):
        assert found.pose.name(arm.elbow.joint) == truth.joints[f"{side}_elbow"]
        assert len(arm.beyond) == choices.wrist


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("limb", ["left_knee", "right_elbow"])
def test_ranges_that_were_not_mirrored_with_their_axes_are_told_and_mended_by_the_hint(tmp_path, seed, limb):
    truth, path = written(tmp_path, replace(random_choices(seed), scrambled=False))
    name = truth.joints[limb]

    def told(hints):
        findings = find_morphology(with_ranges(read_description(path), hints.range), hints).findings
        return [finding for finding in findings if finding.subject == "ranges"]

    assert not told(Hints())
    turned = re.sub(
        rf'(name="{name}"[^>]* range=")(\S+) (\S+)"',
        lambda found: f'{found[1]}{-float(found[3])} {-float(found[2])}"',
        truth.mjcf,
    )
    path.write_text(turned)
    (finding,) = told(Hints())
    assert name in finding.what
    for line in finding.hint.split("  # or "):
        (tmp_path / "hints.toml").write_text(line)
        assert not told(read_hints(tmp_path / "hints.toml"))


@pytest.mark.parametrize("seed", range(4))
def test_robot_made_of_a_file_stands_relaxed_whatever_its_zero_pose_is(tmp_path, seed):
    truth, path = written(tmp_path, random_choices(seed))
    built = build_robot(path, "made", Hints())
    assert max(built.home.missed_deg.values()) < 5.0
    assert (built.spec.joint_order or truth.order) == truth.order, "the maker's order"
    assert built.spec.contact_weight == (1.0 if built.spec.palm_weight == 1.0 else 3.0)
    (tmp_path / "robot.xml").write_text(built.mjcf)
    model = load_model(replace(built.spec, mjcf=tmp_path / "robot.xml"))
    standing = model.forward(model.home_qpos[None])
    np.testing.assert_allclose(standing.site_rotation("torso")[0], np.eye(3), atol=0.1)
    soles = [standing.site_position(name)[0, 2] for name in model.site_names if "_sole_" in name]
    assert min(soles) == pytest.approx(0.0, abs=1e-6)
    assert max(soles) < 0.01
    left, right = (standing.site_position(f"{side}_palm")[0] for side in SIDES)
    np.testing.assert_allclose(left - right, [0.0, (left - right)[1], 0.0], atol=0.01)
    assert left[1] > right[1]


@pytest.mark.slow
@pytest.mark.parametrize(("root", "waist", "yaw"), [("torso", 2, np.pi), ("torso", 0, 0.0), ("pelvis", 3, 1.0)])
def test_any_link_may_be_the_root_and_look_anywhere(tmp_path, root, waist, yaw):
    """Robots whose torso is the root link, and those whose root frame looks backwards, were never solved before."""
    _, path = written(tmp_path, Choices(3, root=root, waist=waist, yaw=yaw, elbow_zero=0.8))
    built = build_robot(path, "made", Hints())
    model = without_shapes(built.spec, built.mjcf, tmp_path)
    motion = hr.retarget(hr.open_clip("builtin:carry_box"), model, hr.Config(contact="landmark"))
    assert motion.converged
    assert (motion.report.robot_file, motion.report.robot_sha256) == ("maker.xml", model.spec.description_sha256)
    gap, pose = (motion.report.figures[name] for name in ("contact_gap_m", "body_pose_deviation_deg"))
    assert gap is not None
    assert gap < 0.005
    assert pose is not None
    assert pose < 25.0


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('name="left_elbow_joint"', 'type="slide" name="left_elbow_joint"', "arms have only"),
        ("</worldbody>", "", "is no XML"),
        ("<mujoco>", '<!DOCTYPE a [<!ENTITY b "c">]><mujoco>', "entities"),
        ("<worldbody>", '<include file="../../other.xml"/><worldbody>', "not in its folder"),
    ],
)
def test_files_that_are_no_humanoid_are_refused_with_the_reason(tmp_path, old, new, says):
    truth, path = written(tmp_path, Choices(1, wrist=0))
    assert old in truth.mjcf
    path.write_text(truth.mjcf.replace(old, new, 1))
    with pytest.raises(RobotError, match=says):
        build_robot(path, "made", Hints())


def test_legs_alone_are_refused(tmp_path):
    truth, path = written(tmp_path, Choices(1))
    for side in SIDES:
        for joint in ("shoulder_0", "shoulder_1", "shoulder_2", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw"):
            truth = replace(
                truth, mjcf=truth.mjcf.replace(f'name="{side}_{joint}_joint"', f'name="{side}_{joint}" type="slide"')
            )
    path.write_text(truth.mjcf)
    with pytest.raises(UnsuitableRobotError, match="two legs and two arms"):
        build_robot(path, "made", Hints())


def test_added_robot_is_known_by_its_name_and_by_its_file_until_it_is_removed(tmp_path, monkeypatch):
    monkeypatch.setenv("HOI_RETARGET_ROBOTS", str(tmp_path / "robots"))
    _, path = written(tmp_path, Choices(2, fingers=3))
    spec = robot(str(path))
    assert spec == robot("maker") == robot(str(path)), "the same file is the same robot"
    assert user_robots.names() == ("maker",)
    assert load_robot("maker").joint_names == tuple(spec.speed_limits)
    assert len(spec.held) == 12
    assert user_robots.remove("maker") == tmp_path / "robots" / "maker"
    assert not list((tmp_path / "robots").iterdir()), "nothing is left behind"
    with pytest.raises(ArgumentError, match="no robot 'maker'"):
        robot("maker")


def test_command_adds_lists_and_removes_a_robot(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("HOI_RETARGET_ROBOTS", str(tmp_path / "robots"))
    _, path = written(tmp_path, Choices(2))
    assert main(["robots", "add", str(path), "--name", "mine"]) == 1, "speeds are assumed, which is a warning"
    assert "left_knee_joint" in capsys.readouterr().out
    assert main(["robots", "list"]) == 0
    assert "mine" in capsys.readouterr().out
    assert main(["robots", "remove", "mine"]) == 0
    path.write_text("<mujoco><worldbody><body><geom size='1'/></body></worldbody></mujoco>")
    assert main(["robots", "add", str(path)]) == 2
    assert "no legs" in capsys.readouterr().err
    assert user_robots.names() == ()
