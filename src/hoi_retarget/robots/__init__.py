"""The robots this package knows, each a module of data beside its MJCF."""

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType

from hoi_retarget.errors import ArgumentError
from hoi_retarget.robots import unitree_g1, unitree_h2
from hoi_retarget.robots.model import RobotModel, load_model
from hoi_retarget.robots.spec import RobotSpec

ROBOTS: Mapping[str, RobotSpec] = MappingProxyType({spec.name: spec for spec in (unitree_g1.SPEC, unitree_h2.SPEC)})


def team(names: str) -> tuple[RobotSpec, ...]:
    """Return the robots of the people of a clip, whose names stand with commas between; raises as `robot`."""
    return tuple(robot(name.strip()) for name in names.split(","))


def load_team(names: str) -> tuple[RobotModel, ...]:
    """Return the models of the robots of the people of a clip; raises as `robot`."""
    return tuple(load_robot(spec.name) for spec in team(names))


def robot(name: str) -> RobotSpec:
    """Return the robot called `name`.

    Raises:
        ArgumentError: There is no such robot; the message lists those there are.
    """
    if name not in ROBOTS:
        raise ArgumentError(f"There is no robot '{name}'. The robots are: {', '.join(ROBOTS)}.")
    return ROBOTS[name]


@cache
def load_robot(name: str) -> RobotModel:
    """Return the model of the robot called `name`, which is compiled once; raises as `robot`."""
    return load_model(robot(name))
