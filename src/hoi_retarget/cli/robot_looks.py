"""The maker's look of robots of this package, fetched once for all pictures: by `demo`, and by `robots meshes`."""

from functools import partial
from pathlib import Path

from hoi_retarget.cli.terminal import Working, say, warn
from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.robots.fetched_meshes import SOURCES, fetch_meshes, fetched_meshes, mesh_names, read_folder
from hoi_retarget.robots.spec import RobotSpec


def fetch_look(spec: RobotSpec, folder: Path | None = None) -> None:
    """Fetch a robot's meshes, and say from where and under which terms.

    Args:
        spec: Of a robot in `SOURCES`.
        folder: With the maker's files; by default they are downloaded.

    Raises:
        ReadError: They cannot be fetched, or are not what was expected.
        WriteError: The user's folder cannot be written.
    """
    source = SOURCES[spec.name]
    read = source.read if folder is None else partial(read_folder, folder)
    say(f"Fetching {len(mesh_names(spec))} meshes of {spec.title}: {folder or source.place}.")
    say(f"Terms: {source.licence}.")
    with Working("fetching", None):
        kept = fetch_meshes(spec, read, source.licence)
    size = sum(path.stat().st_size for path in kept.iterdir()) / 1e6
    say(f"kept: {kept} ({size:.1f} MB). Pictures show them from now on.")


def fetch_look_once(spec: RobotSpec) -> None:
    """Fetch a robot's meshes where they are not there yet; without them pictures show the surface touch is measured on.

    A robot that was added has its own; a network that fails is a warning.
    """
    if spec.name not in SOURCES or fetched_meshes(spec) is not None:
        return
    try:
        fetch_look(spec)
    except HoiRetargetError as error:
        warn(f"The maker's look is missing, pictures show a plainer robot: {error}")
    say()
