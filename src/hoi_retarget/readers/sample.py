"""Real recordings for everybody: two OMOMO clips and their object's mesh, from the Python package index.

The wheel `holosoma-retargeting` 0.1.0 (Amazon FAR, Apache-2.0) ships them. It is downloaded by pip and
not installed: only the files named here are read from it, each checked against a known hash, and
written to places named here.
"""

import hashlib
import tempfile
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from hoi_retarget.errors import ReadError, WriteError
from hoi_retarget.files.atomic import write_atomically
from hoi_retarget.files.python_wheel import check_digest, download_wheel, read_members, sha256_of_file

PACKAGE = "holosoma-retargeting"
VERSION = "0.1.0"
LICENCE = "Apache-2.0, as the package says; the recordings are from OMOMO, by way of InterMimic"
WHEEL_SHA256 = "3dcdcc06c6705c091478808024298dfcc684d9eb49e890cc6b11fc03fa246cb4"
_DATA = "holosoma_retargeting"
MEMBERS: Mapping[str, tuple[str, str]] = {
    "sub3_largebox_003.pt": (
        f"{_DATA}/demo_data/OMOMO_new/sub3_largebox_003.pt",
        "dead7293077ca1e1ea1a344cf416182463fa2f4d66f4e304cc846866913a4844",
    ),
    "sub10_largebox_049.pt": (
        f"{_DATA}/demo_data/OMOMO_new/sub10_largebox_049.pt",
        "a26452327215eb3a5dfddba406d4a11c54fb911c3c963b0a87d4e343930a38c2",
    ),
    "objects/largebox/largebox.obj": (
        f"{_DATA}/models/largebox/largebox.obj",
        "dbcc11281f62e9226f49165252375080d2e490e5a3f0ab6ba917acbd8f7abc1c",
    ),
}
"""Where each file goes, below the folder that is asked for: its name in the wheel, and its SHA-256."""
CLIPS = tuple(name for name in MEMBERS if name.endswith(".pt"))
OBJECTS = "objects"


def fetch_sample(folder: Path) -> tuple[Path, ...]:
    """Download the sample into a folder and return the files; existing ones stay.

    Raises `ReadError` where pip or the network is missing, or the download is not the expected one; `WriteError` where
    the folder cannot be written.
    """
    targets = tuple(folder / name for name in MEMBERS)
    if is_complete(folder):
        return targets
    try:
        with tempfile.TemporaryDirectory(prefix="hoi-retarget-") as scratch:
            wheel = download_wheel("the sample", PACKAGE, VERSION, Path(scratch), " `hoi-retarget demo` needs none.")
            unpack(wheel, folder, MEMBERS, WHEEL_SHA256)
    except OSError as error:
        raise WriteError(
            f"{tempfile.gettempdir()}: no room for the download ({error.strerror or error}). Free 110 MB."
        ) from error
    return targets


def is_complete(folder: Path) -> bool:
    """Return whether all files of the sample are in a folder, unchanged."""
    places = [(folder / name, sha256) for name, (_, sha256) in MEMBERS.items()]
    return all(path.is_file() and sha256_of_file(path) == sha256 for path, sha256 in places)


def unpack(wheel: Path, folder: Path, members: Mapping[str, tuple[str, str]], wheel_sha256: str) -> None:
    """Check a wheel and write some of its files below a folder; nothing is written unless all are as expected.

    `wheel`: the downloaded file; `folder`: the target; `members`: target name -> name in the wheel and its SHA-256;
    `wheel_sha256`: of the wheel. Raises `ReadError`: the wheel or one of its files is not what its hash says, or a
    place lies outside the folder; `WriteError`: a file cannot be written.
    """
    for place, (member, _) in members.items():
        parts = PurePosixPath(place).parts
        if not parts or parts[0] == "/" or ".." in parts:
            raise ReadError(f"{wheel.name}: {member} would be written to {place!r}, outside {folder}. Refused.")
    read = read_members(wheel, wheel_sha256, (member for member, _ in members.values()))
    for member, sha256 in members.values():
        check_digest(f"{wheel.name}: {member}", hashlib.sha256(read[member]).hexdigest(), sha256)
    contents = {place: read[member] for place, (member, _) in members.items()}
    for place, content in contents.items():
        try:
            write_atomically(folder / place, content)
        except WriteError as error:
            reason = getattr(error.__cause__, "strerror", None) or error
            raise WriteError(
                f"{folder / place}: cannot be written ({reason}). Free some space or name another folder."
            ) from error
