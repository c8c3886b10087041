"""Every error the package raises on purpose, in one tree.

Each message says what is wrong, where, what exists or was expected, and what to do::

    HoiRetargetError
    ├── ArgumentError      a name or a number that was asked for does not exist or is out of range
    ├── ReadError          a file is missing, damaged, unsafe, or not of the format it should be
    ├── ClipError          a file was read, but what it holds is not a usable clip
    ├── GeometryError      an object has no geometry, or none that can be used
    │   └── MeshError      its file is there, and cannot be used
    ├── BodyModelError     a recording needs a body model that was not given
    ├── RobotError         a robot's model lacks a frame, a limit or a joint that its roles need
    ├── SolveError         a solve ended without a usable trajectory
    ├── DrawingError       a picture was asked for on a machine that cannot draw without a screen
    └── WriteError         a result could not be written; nothing half-written is left behind

The command line exits with 2 for an `ArgumentError` and with 1 for the others.
"""

import shlex
import sys
from collections.abc import Iterable
from difflib import get_close_matches
from importlib.util import find_spec

EXTRAS = {
    "coacd": ("coacd>=1.0.5", "convex parts of objects in simulations"),
    "h5py": ("h5py>=3.11", "data sets of Isaac Lab"),
    "imageio_ffmpeg": ("imageio-ffmpeg>=0.5", "films as MP4"),
    "mcap_ros2": ("mcap-ros2-support>=0.5", "ROS 2 messages as MCAP"),
    "pxr": ("usd-core>=24.11", "USD stages"),
    "pyarrow": ("pyarrow>=17", "data sets and Parquet"),
    "zstandard": ("zstandard>=0.22", "archives `.tar.zst`"),
}
"""Module of a package that some work needs -> what pip installs, and which work."""


def install_hint(module: str) -> str:
    """Return the command that installs a package of `EXTRAS`, as a sentence; nothing where it is installed."""
    if find_spec(module) is not None:
        return ""
    return f'Install it with: {shlex.quote(sys.executable)} -m pip install "{EXTRAS[module][0]}"'


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ` Did you mean NAME?` with the known name that is most like another one; nothing where none is."""
    by_letters = {item.lower(): item for item in known}
    near = get_close_matches(name.lower(), by_letters, n=1)
    return f" Did you mean {by_letters[near[0]]}?" if near else ""


class HoiRetargetError(Exception):
    """Base of all errors that a caller can act on."""


class ArgumentError(HoiRetargetError):
    """An argument names something that does not exist or lies outside its range."""


class ReadError(HoiRetargetError):
    """A file cannot be read as the format it should be."""


class ClipError(HoiRetargetError):
    """The content of a file does not describe a usable clip."""


class GeometryError(HoiRetargetError):
    """Object geometry is absent or unusable."""


class MeshError(GeometryError):
    """A file of object geometry is there and cannot be used."""


class BodyModelError(HoiRetargetError):
    """A recording holds a body's parameters, and the model that they are of is not at hand."""


class RobotError(HoiRetargetError):
    """A robot's model does not offer what its specification promises."""


class SolveError(HoiRetargetError):
    """A solve ended without a usable trajectory."""


class DrawingError(HoiRetargetError):
    """This machine has no way to draw without a screen."""


class WriteError(HoiRetargetError):
    """A file could not be written; the previous one, if any, is intact."""
