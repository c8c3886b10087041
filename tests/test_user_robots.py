"""Results of an added robot say which file it was made from, and are refused where that robot is not here."""

from dataclasses import replace
from pathlib import Path

import pytest

from export_motions import smooth_motion
from hoi_retarget.cli import main
from hoi_retarget.errors import ReadError, RobotError
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


def test_robot_that_a_killed_save_moved_aside_comes_back(tmp_path, monkeypatch):
    monkeypatch.setenv("HOI_RETARGET_ROBOTS", str(tmp_path / "robots"))
    model = added(tmp_path)

    class KilledError(BaseException):
        """Ends a process between two renames, before anything is cleared up."""

    moved = Path.rename

    def rename(path, target):
        if not path.name.endswith("mine") and not str(target).endswith(".old"):
            raise KilledError
        return moved(path, target)

    with monkeypatch.context() as patch, pytest.raises(KilledError):
        patch.setattr(Path, "rename", rename)
        patch.setattr(user_robots.shutil, "rmtree", lambda *_, **__: None)
        added(tmp_path)
    assert not (tmp_path / "robots" / "mine").exists()
    assert user_robots.names() == ("mine",)
    assert load_robot("mine").joint_names == model.joint_names
    (left,) = (tmp_path / "robots").glob(".*")
    monkeypatch.setattr(user_robots, "_MAX_SAVE_S", -1.0)
    assert user_robots.names() == ("mine",) and not left.exists(), "nothing stays for ever"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("{", "claw"),
        ('"site": "left_wrist"', '"site": "left_claw"'),
        ('"human_joint": "left_wrist"', '"human_joint": "left_claw"'),
        ('"left_hand": "left_palm"', '"left_hand": "left_claw"'),
    ],
)
def test_damaged_robot_is_told_and_hides_no_other(tmp_path, monkeypatch, capsys, old, new):
    monkeypatch.setenv("HOI_RETARGET_ROBOTS", str(tmp_path / "robots"))
    spec = added(tmp_path).spec
    user_robots.save(replace(spec, name="other"), spec.mjcf.read_text())
    file = tmp_path / "robots" / "mine" / "robot.json"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    assert main(["robots", "list"]) == 1
    shown = capsys.readouterr()
    assert "unitree_g1" in shown.out and "other" in shown.out
    assert "damaged" in shown.err and "robots remove mine" in shown.err
    with pytest.raises(RobotError, match="damaged"):
        load_robot("mine")


def test_result_made_before_digests_were_stored_opens(tmp_path, monkeypatch):
    monkeypatch.setenv("HOI_RETARGET_ROBOTS", str(tmp_path / "robots"))
    save(smooth_motion(added(tmp_path)), tmp_path / "take.npz")
    assert load(tmp_path / "take.npz").robot == "mine"
