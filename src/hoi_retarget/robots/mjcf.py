"""A robot's MJCF, read by MuJoCo together with the sites that a specification adds."""

from collections.abc import Mapping
from pathlib import Path

import mujoco

from hoi_retarget.errors import RobotError
from hoi_retarget.robots.spec import SitePose


def read_mjcf(path: Path, sites: Mapping[str, SitePose]) -> mujoco.MjSpec:
    """Return the description in a file, with more sites.

    Raises `RobotError` when MuJoCo cannot read the file, or a site is on a body that is not there.
    """
    try:
        description = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise RobotError(f"{path}: MuJoCo cannot compile it: {error}") from error
    for name, pose in sites.items():
        body = description.body(pose.body)
        if body is None:
            there = ", ".join(body.name for body in description.bodies)
            raise RobotError(f"{path}: site {name!r} is on the body {pose.body!r}. The bodies are: {there}.")
        try:
            body.add_site(name=name, pos=pose.position, quat=pose.quat)
        except ValueError as error:
            raise RobotError(f"{path}: MuJoCo cannot add the site {name!r} of the specification: {error}") from error
    return description


def compile_mjcf(path: Path, sites: Mapping[str, SitePose]) -> mujoco.MjModel:
    """Return the compiled description in a file, with more sites.

    Raises `RobotError` when MuJoCo cannot read or compile it.
    """
    description = read_mjcf(path, sites)
    try:
        return description.compile()
    except ValueError as error:
        raise RobotError(f"{path}: MuJoCo cannot compile it: {error}") from error
