"""Real recordings for everybody: two OMOMO clips and their object's mesh, from the Python package index.

The wheel `holosoma-retargeting` 0.1.0 (Amazon FAR, Apache-2.0) ships them. It is downloaded by pip and
not installed: only the files named here are read from it, each checked against a known hash, and
written to places named here.
"""

import hashlib
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from types import MappingProxyType

from hoi_retarget.errors import ReadError, WriteError
from hoi_retarget.files.atomic import write_atomically

PACKAGE = "holosoma-retargeting"
VERSION = "0.1.0"
LICENCE = "Apache-2.0, as the package says; the recordings are from OMOMO, by way of InterMimic"
WHEEL_SHA256 = "3dcdcc06c6705c091478808024298dfcc684d9eb49e890cc6b11fc03fa246cb4"
_DATA = "holosoma_retargeting"
MEMBERS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
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
)
"""Where each file goes, below the folder that is asked for: its name in the wheel, and its SHA-256."""
CLIPS = tuple(name for name in MEMBERS if name.endswith(".pt"))
OBJECTS = "objects"


def fetch_sample(folder: Path) -> tuple[Path, ...]:
    """Download the sample into a folder and return the files; those that are there already stay.

    Raises:
        ReadError: pip or the network is missing, or what came is not what was expected.
        WriteError: the folder cannot be written.
    """
    targets = tuple(folder / name for name in MEMBERS)
    if is_complete(folder):
        return targets
    try:
        with tempfile.TemporaryDirectory(prefix="hoi-retarget-") as scratch:
            unpack(_download(Path(scratch)), folder, MEMBERS, WHEEL_SHA256)
    except OSError as error:
        raise WriteError(
            f"{tempfile.gettempdir()}: no room for the download ({error.strerror or error}). Free 110 MB."
        ) from error
    return targets


def is_complete(folder: Path) -> bool:
    """Return whether all files of the sample are in a folder, unchanged."""
    places = [(folder / name, sha256) for name, (_, sha256) in MEMBERS.items()]
    return all(path.is_file() and _sha256_of_file(path) == sha256 for path, sha256 in places)


def unpack(wheel: Path, folder: Path, members: Mapping[str, tuple[str, str]], wheel_sha256: str) -> None:
    """Check a wheel and write some of its files below a folder; nothing is written unless all are as expected.

    Raises:
        ReadError: the wheel or one of its files is not what its hash says, or a place lies outside the folder.
        WriteError: a file cannot be written.
    """
    _check_hash(str(wheel.name), _sha256_of_file(wheel), wheel_sha256)
    contents: dict[str, bytes] = {}
    try:
        with zipfile.ZipFile(wheel) as archive:
            for place, (member, sha256) in members.items():
                parts = PurePosixPath(place).parts
                if not parts or parts[0] == "/" or ".." in parts:
                    raise ReadError(f"{wheel.name}: {member} would be written to {place!r}, outside {folder}. Refused.")
                contents[place] = archive.read(member)
                _check_hash(f"{wheel.name}: {member}", hashlib.sha256(contents[place]).hexdigest(), sha256)
    except (KeyError, zipfile.BadZipFile) as error:
        raise ReadError(f"{wheel.name}: not the archive that was expected ({error}). Nothing was unpacked.") from error
    for place, content in contents.items():
        try:
            write_atomically(folder / place, content)
        except WriteError as error:
            reason = getattr(error.__cause__, "strerror", None) or error
            raise WriteError(
                f"{folder / place}: cannot be written ({reason}). Free some space or name another folder."
            ) from error


def _download(folder: Path) -> Path:
    """Fetch the wheel with pip, without installing it or running anything from it."""
    command = [
        *(sys.executable, "-m", "pip", "download", f"{PACKAGE}=={VERSION}", "--no-deps", "--only-binary=:all:"),
        *("--dest", str(folder), "--no-input", "--disable-pip-version-check", "--progress-bar", "off", "--quiet"),
        *("--retries", "2"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    if "No module named pip" in done.stderr:
        raise ReadError(
            f"pip is missing in {sys.executable}, and the sample comes through it. "
            "Run `python -m ensurepip`, or use another environment."
        )
    wheels = sorted(folder.glob("*.whl"))
    if done.returncode != 0 or not wheels:
        lines = [line.removeprefix("ERROR: ") for line in done.stderr.splitlines() if line.startswith("ERROR")]
        reason = lines[-1].rstrip(".") if lines else f"pip ended with {done.returncode}"
        raise ReadError(
            f"the sample ({PACKAGE} {VERSION}) could not be fetched from the Python package index: {reason}. "
            "Check the network. `hoi-retarget demo` needs none."
        )
    return wheels[0]


def _sha256_of_file(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _check_hash(what: str, found: str, expected: str) -> None:
    if found != expected:
        raise ReadError(f"{what}: its SHA-256 is {found}, expected {expected}. Nothing was unpacked; try again later.")
