"""`robots.check` finds what is wrong: one broken description per result."""

import dataclasses
from pathlib import Path

import pytest

from hoi_retarget.errors import RobotError
from hoi_retarget.robots import ROBOTS
from hoi_retarget.robots.model import load_model
from hoi_retarget.robots.robot_check import check, has_errors
from hoi_retarget.robots.robot_tables import joint_table, role_table
from hoi_retarget.robots.spec import SITES

G1 = ROBOTS["unitree_g1"]
TEXT = G1.mjcf.read_text()


def broken(tmp_path, *changes):
    """Return the G1's specification with its MJCF changed: (old, new) each."""
    text = TEXT
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    path = tmp_path / "broken.xml"
    path.write_text(text)
    return dataclasses.replace(G1, mjcf=path)


def troubles(subject):
    """Return what is not ok as (level, where, what), and check that each says what to do."""
    results = [result for result in check(subject) if result.level != "ok"]
    assert all(result.hint for result in results)
    return [(result.level, result.subject, result.what) for result in results]


def only(found, level, where, what):
    """Assert that there is exactly one trouble, and that it is this one."""
    assert len(found) == 1, found
    assert found[0][0] == level
    assert where in found[0][1]
    assert what in found[0][2]


@pytest.mark.parametrize("name", ROBOTS)
def test_robots_of_the_package_are_in_order(name):
    results = check(ROBOTS[name])
    assert [result for result in results if result.level != "ok"] == []
    assert len(results) == 10
    assert not has_errors(results)


def test_file_on_its_own_is_told_what_a_specification_adds():
    only(troubles(G1.mjcf), "warn", "unitree_g1.xml", "speed limits")
    assert not has_errors(check(G1.mjcf))


def test_no_such_file():
    only(troubles(Path("nowhere.xml")), "error", "nowhere.xml", "no such file")


def test_file_that_does_not_compile(tmp_path):
    spec = broken(tmp_path, ('type="box"', 'type="bocks"'))
    only(troubles(spec), "error", "broken.xml", "cannot compile")
    assert has_errors(check(spec))


def test_root_that_is_not_free(tmp_path):
    assert ("error", "worldbody", "0 free joints; the root body needs exactly one") in troubles(
        broken(tmp_path, ("<freejoint/>", ""))
    )


def test_hinge_without_a_range(tmp_path):
    spec = broken(tmp_path, ('name="left_knee_joint" range="-0.087267 2.8798"', 'name="left_knee_joint"'))
    only(troubles(spec), "error", "left_knee_joint", "has no range")


def test_range_in_degrees(tmp_path):
    spec = broken(tmp_path, ('name="waist_yaw_joint" range="-2.618 2.618"', 'name="waist_yaw_joint" range="-150 150"'))
    only(troubles(spec), "warn", "waist_yaw_joint", "turns")


def test_joint_that_is_no_hinge(tmp_path):
    spec = broken(tmp_path, ('name="waist_yaw_joint"', 'name="waist_yaw_joint" type="slide"'))
    assert ("error", "waist_yaw_joint", "is no hinge") in troubles(spec)


def test_joint_without_a_name(tmp_path):
    spec = broken(tmp_path, ('name="waist_yaw_joint" ', ""))
    only(troubles(spec), "error", "waist_yaw_link", "without a name")


def test_missing_sites_are_named(tmp_path):
    spec = broken(tmp_path, ('name="left_toe"', 'name="toe_l"'), ('name="head"', 'name="skull"'))
    only(troubles(spec), "error", "head, left_toe", "2 of 27 sites")


def test_body_without_mass(tmp_path):
    moving = '<body name="massless"><joint name="extra" class="yaw" range="-1 1"/><body name="inner">'
    inner = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></body>'
    spec = broken(tmp_path, ('<site name="torso"/>', f'<site name="torso"/>{moving}{inner}'))
    spec = dataclasses.replace(spec, speed_limits={**G1.speed_limits, "extra": 1.0})
    only(troubles(spec), "error", "massless", "no mass")


def test_sole_corners_that_are_not_in_one_plane(tmp_path):
    corner = '"left_sole_toe_inner" pos="0.12 -0.03 '
    raised = broken(tmp_path, (f'{corner}-0.0354"', f'{corner}-0.0254"'))
    only(troubles(raised), "error", "sole corners", "10.0 mm")


def test_feet_that_are_not_flat_in_the_home_pose():
    spec = dataclasses.replace(G1, home={**G1.home, "left_ankle_pitch_joint": 0.1})
    only(troubles(spec), "error", "sole corners", "home pose")


def test_something_lies_below_the_soles(tmp_path):
    spec = broken(tmp_path, ('name="left_toe" pos="0.1 0 -0.02"', 'name="left_toe" pos="0.1 0 -0.06"'))
    only(troubles(spec), "error", "left_toe", "below the sole corners")


def test_palms_that_do_not_mirror(tmp_path):
    moved = broken(tmp_path, ('pos="0.1057 0.0303 0"', 'pos="0.1057 0.0403 0"'))
    only(troubles(moved), "warn", "palms", "10.0 mm")
    turned = broken(tmp_path, ('quat="0.99251 0 0 0.12214"', 'quat="0.99251 0 0 -0.12214"'))
    only(troubles(turned), "warn", "palms", "28.1 degrees")


def test_speed_limits():
    limits = dict(G1.speed_limits)
    del limits["left_knee_joint"]
    only(troubles(dataclasses.replace(G1, speed_limits=limits)), "error", "left_knee_joint", "no speed limit")
    limits = {**G1.speed_limits, "tail_joint": 3.0}
    only(troubles(dataclasses.replace(G1, speed_limits=limits)), "error", "tail_joint", "does not exist")
    limits = {**G1.speed_limits, "left_knee_joint": 0.0}
    only(troubles(dataclasses.replace(G1, speed_limits=limits)), "error", "left_knee_joint", "not a positive number")


def test_home_pose():
    home = {**G1.home, "left_elbow_joint": 2.0944}
    only(troubles(dataclasses.replace(G1, home=home)), "error", "left_elbow_joint", "not inside the range")
    home = {**G1.home, "tail_joint": 0.1}
    only(troubles(dataclasses.replace(G1, home=home)), "error", "tail_joint", "do not exist")


def with_row(site, /, **changes):
    rows = tuple(dataclasses.replace(row, **changes) if row.site == site else row for row in G1.ik)
    return dataclasses.replace(G1, ik=rows)


def test_rotation_offsets():
    swapped = with_row("left_elbow", rotation_offset=(0.0, 0.0, 0.0, -1.0))
    only(troubles(swapped), "error", "left_elbow", "degrees off")
    not_human = with_row("pelvis", rotation_offset=(1.0, 0.0, 0.0, 0.0))
    only(troubles(not_human), "error", "pelvis", "120 degrees off")
    only(troubles(with_row("torso", rotation_offset=(1.0, 1.0, 0.0, 0.0))), "error", "torso", "no unit quaternion")
    only(troubles(with_row("torso", site="chest")), "error", "chest", "no role")


def test_tables_of_joints_and_roles():
    joints, roles = joint_table(load_model(G1)), role_table(load_model(G1))
    assert len(joints) == 29 and joints[3].joint == "left_knee_joint"
    assert (joints[3].lower, joints[3].upper, joints[3].speed_limit, joints[3].effort) == (-0.087267, 2.8798, 20, 139)
    assert [row.site for row in roles] == list(SITES)
    palm = next(row for row in roles if row.site == "left_palm")
    assert palm.body == "left_wrist_yaw_link" and palm.follows == "touches for left_hand"
    assert next(row for row in roles if row.site == "torso").follows == "spine3"


def test_table_of_a_broken_robot(tmp_path):
    with pytest.raises(RobotError, match="cannot compile"):
        load_model(broken(tmp_path, ('type="box"', 'type="bocks"')))
    with pytest.raises(RobotError, match="no speed limit for left_hip_pitch_joint"):
        load_model(dataclasses.replace(G1, speed_limits={}))
    effortless = broken(tmp_path, (' actuatorfrcrange="-88 88"', ""))
    assert joint_table(load_model(effortless))[0].effort is None
