"""Any humanoid from its file: what is found is what is true, for choices of all kinds and real makers' files."""

import re
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest

import hoi_retarget as hr
from hoi_retarget.cli import main
from hoi_retarget.cli.robots import gates_of, without_shapes
from hoi_retarget.dynamics.actuators import actuators_of
from hoi_retarget.errors import ArgumentError, RobotError
from hoi_retarget.robots import load_robot, robot, user_robots
from hoi_retarget.robots.adding.build import build_robot
from hoi_retarget.robots.adding.description import finite_range, read_description, with_ranges
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
        ('name="left_elbow_joint"', 'type="slide" name="left_elbow_joint"', "no elbow"),
        ("</worldbody>", "", "is no XML"),
        ("<mujoco>", '<!DOCTYPE a [<!ENTITY b "c">]><mujoco>', "entities"),
        ("<worldbody>", '<include file="../../other.xml"/><worldbody>', "not in its folder"),
        ("<worldbody>", '<include file="maker.xml"/><worldbody>', "more than 200 files"),
        ("</worldbody>", '<replicate count="999999999"><body/></replicate></worldbody>', "more than 1000 links"),
        ("</worldbody>", f"{'<body>' * 2000}{'</body>' * 2000}</worldbody>", "256 deep"),
        ("</worldbody>", '<body><attach model="m" body="b" prefix="p"/></body></worldbody>', "other files"),
    ],
)
def test_files_that_are_no_humanoid_are_refused_with_the_reason(tmp_path, old, new, says):
    truth, path = written(tmp_path, Choices(1, wrist=0))
    assert old in truth.mjcf
    path.write_text(truth.mjcf.replace(old, new, 1))
    with pytest.raises(RobotError, match=says):
        build_robot(path, "made", Hints())


def changed_joint(mjcf, joint, **attributes):
    """Return an MJCF with other attributes of one joint."""
    (old,) = re.findall(rf'<joint name="{joint}"[^>]*>', mjcf)
    new = old
    for name, value in attributes.items():
        new = re.sub(rf'{name}="[^"]*"', f'{name}="{value}"', new)
    assert new != old
    return mjcf.replace(old, new)


def findings_of(path):
    return find_morphology(read_description(path), Hints()).findings


@pytest.mark.parametrize("ends", ["1 -1", "nan 1"])
def test_empty_range_is_told_by_joint_and_mended_by_the_hint(tmp_path, ends):
    truth, path = written(tmp_path, Choices(1))
    path.write_text(changed_joint(truth.mjcf, "left_knee_joint", range=ends))
    (told,) = (finding for finding in findings_of(path) if "an empty range" in finding.what)
    assert told.level == "warn" and "left_knee_joint" in told.what
    description = with_ranges(read_description(path), {"left_knee_joint": (-2.3, 0.1)})
    assert not any("an empty range" in finding.what for finding in find_morphology(description, Hints()).findings)


def urdf(limits):
    """Return a URDF of a chain of joints, by the type and limits of each."""
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    links = "".join(f'<link name="l{k}">{mass}</link>' for k in range(len(limits) + 1))
    joints = "".join(
        f'<joint name="j{k}" type="{kind}"><parent link="l{k}"/><child link="l{k + 1}"/><axis xyz="0 0 1"/>'
        f"<limit {limit}/></joint>"
        for k, (kind, limit) in enumerate(limits)
    )
    return f'<robot name="chain">{links}{joints}</robot>'


def test_ranges_of_a_urdf_are_those_that_it_states(tmp_path):
    path = tmp_path / "chain.urdf"
    path.write_text(
        urdf(
            [
                ("continuous", 'lower="-1" upper="2" effort="5" velocity="1"'),
                ("revolute", 'lower="1" upper="-1" effort="5" velocity="1"'),
                ("revolute", 'lower="nan" upper="1" effort="5" velocity="1"'),
                ("continuous", 'effort="0" velocity="1"'),
            ]
        )
    )
    description = read_description(path)
    compiled = description.compiled
    assert [finite_range(compiled, k) for k in range(4)] == [(-1.0, 2.0), (-1.0, 1.0), None, None]
    said = {finding.hint: (finding.level, finding.what) for finding in description.findings}
    assert said["range.JOINT = [LOWER, UPPER]"][0] == "ok" and "j0" in said["range.JOINT = [LOWER, UPPER]"][1]
    assert said["range.j1 = [LOWER, UPPER]"][0] == said["range.j2 = [LOWER, UPPER]"][0] == "warn"
    assert description.passive == ("j3",)
    stated = with_ranges(description, {"j1": (-0.5, 0.5)})
    assert not any(finding.hint.startswith("range.j1") for finding in stated.findings)


def test_coupling_of_two_legs_is_told_and_motions_fail_where_it_shows(tmp_path):
    """A joint that carries a limb is not held, as a finger is."""
    truth, path = written(tmp_path, Choices(1))
    first, second = (next(name for name in truth.order if name.startswith(f"{side}_hip")) for side in SIDES)
    equality = f'<equality><joint joint1="{first}" joint2="{second}"/></equality></mujoco>'
    path.write_text(truth.mjcf.replace("</mujoco>", equality))
    built = build_robot(path, "made", Hints())
    (coupling,) = built.spec.couplings
    assert {coupling.joint, coupling.other} == {first, second} and not built.spec.held
    assert [finding.level for finding in built.findings if finding.subject == "coupled joints"] == ["warn"]
    model = without_shapes(built.spec, built.mjcf, tmp_path)
    motion = hr.retarget(hr.open_clip("builtin:carry_box"), model, hr.Config(contact="landmark"))
    angles = dict(zip(model.joint_names, motion.qpos[:, 7:].T, strict=True))
    assert motion.report.figures["coupling_error_rad"] == pytest.approx(np.abs(angles[first] - angles[second]).max())
    locked = build_robot(path, "made", Hints(lock=(first, second)))
    assert not locked.spec.couplings


def test_first_axes_of_a_pair_of_limbs_may_cross(tmp_path):
    """A shoulder's first joint is anywhere along its axis, such as in the middle of the trunk."""
    truth, path = written(tmp_path, Choices(1, waist=0))
    root = ET.fromstring(truth.mjcf)
    data = mujoco.MjData(compiled := mujoco.MjModel.from_xml_string(truth.mjcf))
    mujoco.mj_kinematics(compiled, data)
    before = find_morphology(read_description(path), Hints()).sites
    for side in SIDES:
        first = next(name for name in truth.order if name.startswith(f"{side}_shoulder"))
        joint = next(one for one in root.iter("joint") if one.get("name") == first)
        axis = np.array(joint.get("axis").split(), dtype=float)
        place = data.xanchor[compiled.joint(first).id]
        # To where the axis is nearest to the other shoulder's.
        along = data.xaxis[compiled.joint(first).id] @ (np.array([*(0.0, 0.0), place[2]]) - place)
        joint.set("pos", " ".join(map(str, np.array(joint.get("pos").split(), dtype=float) + along * axis)))
    path.write_text(ET.tostring(root, encoding="unicode"))
    after = find_morphology(read_description(path), Hints()).sites
    for name, site in before.items():
        np.testing.assert_allclose(after[name].position, site.position, atol=1e-3, err_msg=name)


def test_drives_are_those_that_the_hints_state(tmp_path):
    _, path = written(tmp_path, Choices(1))
    hints = tmp_path / "hints.toml"
    hints.write_text("motor = { left_knee_joint = { armature = 0.02, torque = 90.0, gains = [80.0, 5.0] } }")
    built = build_robot(path, "made", read_hints(hints))
    model = without_shapes(built.spec, built.mjcf, tmp_path)
    model = replace(model, torque_limits=np.full(model.n, 50.0))
    drives, knee = actuators_of(model), model.joint_names.index("left_knee_joint")
    values = drives.armature, drives.torque, drives.stiffness, drives.damping
    assert [float(value[knee]) for value in values] == [0.02, 90.0, 80.0, 5.0]
    assert drives.torque[knee - 1] == 50.0 and not drives.published
    hints.write_text("motor = { left_knee_joint = { armature = 0.02, gains = [80.0, -5.0] } }")
    with pytest.raises(ArgumentError, match="positive"):
        read_hints(hints)


def test_nothing_outside_of_the_folder_is_opened_and_no_mesh_is_made_up(tmp_path):
    truth, path = written(tmp_path, Choices(1))
    asset = '<asset><model name="m" file="/nowhere/m.xml"/><mesh name="p" builtin="plate" params="9999 9999"/></asset>'
    path.write_text(truth.mjcf.replace("<worldbody>", f'{asset}<worldbody><geom type="mesh" mesh="p"/>'))
    assert not read_description(path).compiled.nmesh


def test_shapes_without_extent_are_left_out(tmp_path):
    truth, path = written(tmp_path, Choices(1))
    shapes = read_description(path).compiled.ngeom
    path.write_text(truth.mjcf.replace("<geom ", '<geom type="sphere" size="0"/><geom ', 1))
    description = read_description(path)
    assert description.compiled.ngeom == shapes
    assert [finding.what for finding in description.findings] == ["1 without extent are left out"]


def test_an_included_file_includes_what_is_beside_it(tmp_path):
    truth, path = written(tmp_path, Choices(1))
    joints = read_description(path).compiled.njnt
    body = truth.mjcf[truth.mjcf.index("<worldbody>") + len("<worldbody>") : truth.mjcf.index("</worldbody>")]
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "body.xml").write_text(f"<mujoco>{body}</mujoco>")
    whole = truth.mjcf.replace(body, '<include file="body.xml"/>')
    (tmp_path / "parts" / "whole.xml").write_text(whole)
    path.write_text('<mujoco><include file="parts/whole.xml"/></mujoco>')
    assert read_description(path).compiled.njnt == joints


def test_arm_of_three_joints_is_read_with_what_it_cannot_do(tmp_path):
    truth, path = written(tmp_path, Choices(1, wrist=0))
    mjcf = truth.mjcf
    for side in SIDES:
        last = [name for name in truth.order if name.startswith(f"{side}_shoulder")][-1]
        mjcf = re.sub(rf'<joint name="{last}"[^>]*/>', "", mjcf)
    path.write_text(mjcf)
    built = build_robot(path, "made", Hints())
    said = [finding for finding in built.findings if finding.subject == "left arm" and finding.level == "warn"]
    assert len(said) == 1 and "2 joints before the elbow" in said[0].what


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
    assert (tmp_path / "robots" / "mine" / "skin.npz").is_file(), "no run computes it"
    assert main(["robots", "remove", "mine"]) == 0
    path.write_text("<mujoco><worldbody><body><geom size='1'/></body></worldbody></mujoco>")
    assert main(["robots", "add", str(path)]) == 2
    assert "no legs" in capsys.readouterr().err
    assert user_robots.names() == ()


def test_trial_tells_a_sideways_lean_from_ten_degrees_on():
    model = load_robot("unitree_g1")
    motion = hr.retarget(hr.open_clip("builtin:carry_box"), model, hr.Config(contact="landmark"))
    for lean, holds in ((9.9, True), (35.2, False)):
        leaning = motion.with_report(figures={**motion.report.figures, "trunk_lean_p95_deg": lean})
        assert (f"leans {lean:.0f} deg sideways from the person", holds) in gates_of(leaning, model)


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
    "engineai_pm01/pm_v2.xml": (24, 0, "J03_KNEE_PITCH_L", "J16_ELBOW_PITCH_L"),
    "atlas/atlas_convex_hull.urdf": (30, 0, "l_leg_kny", "l_arm_elx"),
    "valkyrie/valkyrie_D.urdf": (32, 26, "leftKneePitch", "leftElbowPitch"),
    "jaxon/jaxon_jvrc.urdf": (34, 4, "LLEG_JOINT3", "LARM_JOINT4"),
    "unitree_h1_2_inspire/h1_2.urdf": (27, 24, "left_knee_joint", "left_elbow_joint"),
}
"""File -> joints that move, joints that are held, left knee and left elbow by the makers' names."""
LEANS = {"unitree_h1/h1.urdf": "builtin:carry_box", "unitree_h1_2_inspire/h1_2.urdf": "builtin:move_chair"}
"""Robots that lean sideways where the person does not, on a clip: their hips turn and spread too little."""
REFUSED = {"galaxea_r1pro/r1_pro.xml": "stands on wheels"}

makers_files = pytest.mark.skipif(not FOLDER.is_dir(), reason=f"{FOLDER} is not here")


@pytest.mark.slow
@makers_files
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
    clip = LEANS.get(file, "builtin:carry_box")
    motion = hr.retarget(hr.open_clip(clip), model, hr.Config(contact="landmark"))
    missed = [what for what, holds in gates_of(motion, model) if not holds]
    assert [bool(re.fullmatch(r"leans \d\d deg sideways from the person", what)) for what in missed] == (
        [True] if file in LEANS else []
    )


@pytest.mark.slow
@makers_files
@pytest.mark.parametrize("file", REFUSED)
def test_file_is_refused_with_the_reason(file):
    with pytest.raises(UnsuitableRobotError, match=REFUSED[file]):
        build_robot(FOLDER / file, "made", Hints())


@pytest.mark.slow
@makers_files
def test_any_other_file_is_made_a_robot_of_or_refused_in_words():
    there = {str(path.relative_to(FOLDER)) for suffix in ("urdf", "xml") for path in FOLDER.rglob(f"*.{suffix}")}
    assert there >= {*ROBOTS, *REFUSED}
    for file in sorted(there - {*ROBOTS, *REFUSED}):
        with suppress(RobotError):
            assert build_robot(FOLDER / file, "made", Hints()).findings


@pytest.mark.slow
@makers_files
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


@pytest.mark.slow
@makers_files
def test_upper_body_on_wheels_reaches_its_contacts(tmp_path):
    built = build_robot(FOLDER / "galaxea_r1pro/r1_pro.xml", "made", Hints(base="follows"))
    model = without_shapes(built.spec, built.mjcf, tmp_path)
    for clip in ("builtin:carry_box", "builtin:push_table"):
        motion = hr.retarget(hr.open_clip(clip), model, hr.Config(contact="landmark"))
        assert not [what for what, holds in gates_of(motion, model) if not holds]
