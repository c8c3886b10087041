"""`hoi-retarget robots`: list, show and check."""

import numpy as np

from hoi_retarget.cli.commands import CheckRobot, ListRobots, Robots, ShowRobot
from hoi_retarget.cli.terminal import say, show_table
from hoi_retarget.robots import ROBOTS, robot
from hoi_retarget.robots.model import load_model


def execute(command: Robots) -> int:
    """Do what is asked about robots."""
    match command.action:
        case ListRobots():
            return _list()
        case ShowRobot() as action:
            return _show(action)
        case CheckRobot() as action:
            return _check(action)


def _list() -> int:
    sizes = {"root": "shrinks with the robot", "captured": "as captured"}
    rows = [
        (spec.name, spec.title, str(len(spec.speed_limits)), f"{spec.stature:.3f}", sizes[spec.object_size])
        for spec in ROBOTS.values()
    ]
    show_table([("robot", "is", "joints", "stature [m]", "object size"), *rows], words=(0, 1, 4))
    return 0


def _show(action: ShowRobot) -> int:
    spec = robot(action.name)
    model = load_model(spec)
    say(f"{spec.name}: {spec.title}")
    say(f"  {spec.provenance}")
    say(f"  description: {spec.mjcf}")
    say()
    degrees = np.rad2deg
    rows = [
        (str(index), name, f"{degrees(low):.1f}", f"{degrees(high):.1f}", f"{speed:g}", f"{home:.2f}")
        for index, (name, low, high, speed, home) in enumerate(
            zip(model.joint_names, model.lower, model.upper, model.speed_limits, model.home_qpos[7:], strict=True)
        )
    ]
    header = ("dof", "joint", "lower [deg]", "upper [deg]", "speed limit [rad/s]", "home [rad]")
    show_table([header, *rows], words=(1,))
    say()
    followers = {row.site: (row.human_joint, row) for row in spec.ik}
    touching = {site: part for part, site in spec.part_sites.items()}
    roles = []
    for site in model.site_names:
        joint, row = followers.get(site, ("", None))
        weights = f"{row.position_weight:g} / {row.rotation_weight:g}" if row else ""
        roles.append((site, joint, weights, touching.get(site, "")))
    show_table([("site", "follows", "weights (position / rotation)", "touches for"), *roles], words=(0, 1, 2, 3))
    return 0


def _check(action: CheckRobot) -> int:
    raise NotImplementedError(action)
