"""The robots of this package, each a module of data beside its MJCF, and the user's own."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType

from hoi_retarget.errors import ArgumentError, did_you_mean
from hoi_retarget.robots import unitree_g1, unitree_h2, user_robots
from hoi_retarget.robots.model import RobotModel, load_model
from hoi_retarget.robots.spec import RobotSpec

_SPECS = (unitree_g1.SPEC, unitree_h2.SPEC, unitree_g1.DEX3)
ROBOTS: Mapping[str, RobotSpec] = MappingProxyType({spec.name: spec for spec in _SPECS})


def team(names: str) -> tuple[RobotSpec, ...]:
    """Return the robots of the people of a clip by their names with commas between; raises as `robot`."""
    return tuple(robot(name.strip()) for name in names.split(","))


def load_team(names: str) -> tuple[RobotModel, ...]:
    """Return the models of the robots of the people of a clip; raises as `robot`."""
    return tuple(load_robot(spec.name) for spec in team(names))


def robot(name: str) -> RobotSpec:
    """Return a robot: one of this package by its name or the end of it, `unitree_g1` or `g1`, or an added one.

    The path of a manufacturer's file stands for the robot made of it, which is added where it was not yet.

    Raises `ArgumentError`: there is no such robot; the message lists those there are; `RobotError`: the file cannot be
    made a robot of, or an added robot's files are damaged.
    """
    added = user_robots.names()
    if name in added:
        return user_robots.load(name)
    if Path(name).suffix.lower() in user_robots.SUFFIXES:
        return user_robots.of_file(Path(name), taken=ROBOTS)
    named = [spec for full, spec in ROBOTS.items() if f"_{full}".endswith(f"_{name.lower()}")]
    if len(named) != 1:
        near = did_you_mean(name, (*ROBOTS, *added)) or did_you_mean(name, (full.partition("_")[2] for full in ROBOTS))
        raise ArgumentError(f"There is no robot '{name}'.{near} The robots are: {', '.join((*ROBOTS, *added))}.")
    return named[0]


def load_robot(name: str) -> RobotModel:
    """Return the model of the robot called `name`, which is compiled once; raises as `robot`."""
    spec = robot(name)
    return _loaded(spec.name, spec.mjcf, spec.description_sha256)


@cache
def _loaded(name: str, mjcf: Path, digest: str) -> RobotModel:
    # An added robot may be another one later, with another file and digest.
    del mjcf, digest
    return load_model(ROBOTS[name] if name in ROBOTS else user_robots.load(name))
