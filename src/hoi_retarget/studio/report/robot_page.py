"""The page of a robot, to check its description: one file that opens without a server or the internet."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass

from hoi_retarget.robots.adding.findings import RobotFinding
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.robot_tables import joint_table, role_table
from hoi_retarget.studio.html import render
from hoi_retarget.studio.offscreen.robot_portraits import Portrait, portraits
from hoi_retarget.studio.report.page import Table

_LEVELS = {"ok": "pass", "warn": "warn", "error": "fail"}


@dataclass(frozen=True)
class Trial:
    """A robot's result on a clip."""

    clip: str
    gates: Sequence[tuple[str, bool]]
    """What its motion must do, with figures, and whether it does."""
    picture: bytes | None
    """JPEG file; None where there is no motion."""


def robot_page(model: RobotModel, findings: Sequence[RobotFinding], trials: Sequence[Trial]) -> str:
    """Return the page; raises `DrawingError` where this machine has no way to draw without a screen."""
    caption = "The person and the robot, at the middle of the longest contact."
    on_clips = (Portrait(trial.clip, caption, trial.picture) for trial in trials if trial.picture is not None)
    return render(
        "studio/report/page/robot.html.j2",
        spec=model.spec,
        pictures=[
            (one.title, one.caption, base64.b64encode(one.jpeg).decode("ascii"))
            for one in (*portraits(model), *on_clips)
        ],
        findings=[(_LEVELS[one.level], one) for one in findings],
        trials=trials,
        joints=_joints(model),
        sites=_sites(model),
    )


def _joints(model: RobotModel) -> Table:
    heads = {"joint": "", **dict.fromkeys(("lower [rad]", "upper [rad]", "speed [rad/s]", "home [rad]"), "number")}
    rows = []
    for row in joint_table(model):
        numbers = (row.lower, row.upper, row.speed_limit, model.spec.home.get(row.joint, 0.0))
        rows.append((row.joint, *(f"{value:.2f}" for value in numbers)))
    return Table("Joints", heads, rows)


def _sites(model: RobotModel) -> Table:
    rows = [
        (row.site, row.body, " ".join(f"{number:.3f}" for number in row.place), row.follows)
        for row in role_table(model)
    ]
    return Table("Sites", {"site": "", "on": "", "at [m]": "", "follows": "soft"}, rows)
