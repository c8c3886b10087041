"""Results of an added robot say which file it was made from, and are refused where that robot is not here."""

import pytest

from export_motions import smooth_motion
from hoi_retarget.errors import ReadError
from hoi_retarget.motion.motion_report import Report
from hoi_retarget.motion.result_file import load, save
from hoi_retarget.robots import load_robot, user_robots
from hoi_retarget.robots.adding.build import build_robot
from hoi_retarget.robots.adding.findings import Hints
from synthetic_humanoids import Choices, humanoid


def added(folder, more=""):
    path = folder / "maker.xml"
    path.write_text(humanoid(Choices(1)).mjcf + more)
    built = build_robot(path, "mine", Hints())
    user_robots.save(built.spec, built.mjcf)
    return load_robot("mine")


def test_result_opens_with_its_robot_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("HOI_RETARGET_ROBOTS", str(tmp_path / "robots"))
    model = added(tmp_path)
    facts = {"robot_file": model.spec.description_file, "robot_sha256": model.spec.description_sha256}
    path = tmp_path / "take.npz"
    save(smooth_motion(model, report=Report(**facts)), path)
    assert {name: getattr(load(path).report, name) for name in facts} == facts

    def refused(says):
        with pytest.raises(ReadError, match=says) as error:
            load(path)
        for word in (str(path), "'mine'", "'maker.xml'", facts["robot_sha256"], "robots add maker.xml --name mine"):
            assert word in str(error.value)

    assert added(tmp_path, "<!-- mended -->").joint_names == model.joint_names, (
        "joints alone would not tell the two robots apart"
    )
    refused("made from another file")
    user_robots.remove("mine")
    refused("none of that name")
    added(tmp_path)
    assert load(path).robot == "mine"


def test_result_made_before_digests_were_stored_opens(tmp_path, monkeypatch):
    monkeypatch.setenv("HOI_RETARGET_ROBOTS", str(tmp_path / "robots"))
    save(smooth_motion(added(tmp_path)), tmp_path / "take.npz")
    assert load(tmp_path / "take.npz").robot == "mine"
