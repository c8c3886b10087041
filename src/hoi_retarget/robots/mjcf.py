"""A robot's MJCF, read by MuJoCo together with the sites of a specification, and without its log file."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.errors import RobotError
from hoi_retarget.robots.spec import SitePose


def read_mjcf(path: Path, sites: Mapping[str, SitePose]) -> mujoco.MjSpec:
    """Return the description in a file, with more sites; raises `RobotError` for bad files and unknown bodies."""
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
    """Return the compiled description in a file, with more sites; raises `RobotError` when MuJoCo refuses it."""
    description = read_mjcf(path, sites)
    try:
        return description.compile()
    except ValueError as error:
        raise RobotError(f"{path}: MuJoCo cannot compile it: {error}") from error


def mesh_of(compiled: mujoco.MjModel, geom: int) -> tuple[Float[np.ndarray, "V 3"], Int[np.ndarray, "F 3"]]:
    """Return vertices [m] and triangles of a mesh geometry, in the geometry's frame."""
    mesh = int(compiled.geom_dataid[geom])
    first, count = int(compiled.mesh_vertadr[mesh]), int(compiled.mesh_vertnum[mesh])
    face, faces = int(compiled.mesh_faceadr[mesh]), int(compiled.mesh_facenum[mesh])
    return compiled.mesh_vert[first : first + count].astype(float), compiled.mesh_face[face : face + faces].astype(int)


@contextmanager
def quiet() -> Iterator[None]:
    """Keep MuJoCo from writing its warnings into `MUJOCO_LOG.TXT` in the current folder."""
    previous = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(_ignore)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(previous)


def _ignore(_: str) -> None:
    """Drop a warning: simulations count theirs, and readers of descriptions report findings."""
