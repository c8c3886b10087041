"""What an installation can do, in three lines, and a command for what it cannot."""

import sys
import tomllib
from pathlib import Path

import pytest

from hoi_retarget import robots
from hoi_retarget.cli import main
from hoi_retarget.errors import EXTRAS, DrawingError, RobotError
from hoi_retarget.robots import fetched_meshes
from hoi_retarget.studio.offscreen import stage


def told(capsys) -> tuple[int, list[str]]:
    code = main(["doctor"])
    return code, capsys.readouterr().out.splitlines()


@pytest.fixture
def complete(monkeypatch):
    """Everything is there, whatever this machine lacks."""
    monkeypatch.setattr("hoi_retarget.errors.find_spec", lambda name: name)
    monkeypatch.setattr(stage, "check_can_draw", lambda: None)
    monkeypatch.setattr(fetched_meshes, "fetched_meshes", lambda spec: Path(spec.name))


@pytest.mark.usefixtures("complete")
def test_where_all_is_well_it_is_three_lines_without_advice(capsys):
    code, lines = told(capsys)
    assert code == 0 and [line.partition(":")[0] for line in lines] == ["retargeting", "drawing", "optional"]
    assert lines[1] == "drawing: works" and "install" not in "".join(lines).lower()


@pytest.mark.usefixtures("complete")
def test_missing_looks_packages_and_ways_to_draw_come_with_commands(capsys, monkeypatch):
    monkeypatch.setattr("hoi_retarget.errors.find_spec", lambda name: None)
    monkeypatch.setattr(fetched_meshes, "fetched_meshes", lambda spec: None)
    code, lines = told(capsys)
    assert code == 0 and all(f"robots meshes {name}" in lines[1] for name in robots.ROBOTS)
    assert [line.rpartition("install ")[2] for line in lines[3:]] == [f'"{needed}"' for needed, _ in EXTRAS.values()]
    assert lines[2] == "optional: nothing"

    def fails() -> None:
        raise DrawingError("Install EGL.")

    monkeypatch.setattr(stage, "check_can_draw", fails)
    assert told(capsys)[1][1] == "drawing: in a browser alone. Install EGL."


@pytest.mark.usefixtures("complete")
def test_an_installation_that_cannot_retarget_is_told_and_exits_with_one(capsys, monkeypatch):
    def damaged(name: str) -> None:
        raise RobotError(f"{name} is damaged.")

    monkeypatch.setattr(robots, "load_robot", damaged)
    code, lines = told(capsys)
    assert code == 1 and lines[0] == "retargeting: fails. unitree_g1 is damaged."
    monkeypatch.setitem(sys.modules, "hoi_retarget.retargeting.retarget", None)
    assert told(capsys)[0] == 1


def test_extras_are_those_of_the_project():
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
    declared = {
        line
        for group in ("archives", "dataset", "isaaclab", "physics", "ros", "usd", "video")
        for line in project["optional-dependencies"][group]
    }
    assert {needed for needed, _ in EXTRAS.values()} == declared
