"""Reads BVH, skeletons and their motion as text: a hierarchy of joints, then a row of numbers for each frame.

A joint's frame is its parent's, moved by its offset and turned by its rotation channels in the order they stand in,
each about the axis that the ones before have turned. Position channels stand for the offset, not beside it, as current
tools write and read them. Angles are in degrees; the file states no unit of length and no axis that is up.

Cites: Biovision's format as in ubisoft/ubisoft-laforge-animation-dataset `lafan1/extract.py` and Blender's
`import_bvh.py`.
"""

import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float

from hoi_retarget.errors import ReadError
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import describe_frames

END = " end"  # Stands behind a joint's name in that of its end, which has a place only.
CHANNELS = tuple(f"{axis}{kind}" for kind in ("position", "rotation") for axis in "XYZ")

_MAX_JOINTS = 1000


@dataclass(frozen=True, eq=False)
class Bvh:
    """A skeleton of J joints, ends of limbs among them, and T frames of its motion."""

    names: tuple[str, ...]
    parents: tuple[int, ...]  # -1 for the root; before their children.
    offsets: Float[np.ndarray, "J 3"]  # Places in the parents' frames while nothing is turned.
    channels: tuple[tuple[str, ...], ...]  # Of each joint, some of `CHANNELS`; an end has none.
    frame_time: str  # Seconds from one frame to the next, as the file writes them.
    values: Float[np.ndarray, "T C"]  # Of all channels in order; angles in degrees.

    @property
    def rate(self) -> float:
        """Frames a second [Hz]: a whole number where the file's time is that of one, rounded."""
        seconds = float(self.frame_time)
        last_digit = 10.0 ** -len(self.frame_time.partition(".")[2])
        whole = round(1.0 / seconds)
        is_rounded = whole > 0 and abs(1.0 / whole - seconds) <= 0.5 * last_digit * (1.0 + 1e-6)
        return float(whole) if is_rounded and last_digit < 0.05 * seconds else 1.0 / seconds

    def poses(self) -> tuple[Float[np.ndarray, "T J 3"], Float[np.ndarray, "T J 4"]]:
        """Return positions, in the file's unit, and rotations, wxyz, of all joints in the world."""
        frames = len(self.values)
        positions, quats = np.empty((frames, len(self.names), 3)), np.empty((frames, len(self.names), 4))
        first = 0
        for joint, (parent, channels) in enumerate(zip(self.parents, self.channels, strict=True)):
            place, quat = self._local(joint, self.values[:, first : first + len(channels)])
            first += len(channels)
            if parent < 0:
                positions[:, joint], quats[:, joint] = place, quat
            else:
                positions[:, joint] = positions[:, parent] + se3.rotate(quats[:, parent], place)
                quats[:, joint] = se3.quat_multiply(quats[:, parent], quat)
        return positions, quats

    def rest_positions(self) -> Float[np.ndarray, "J 3"]:
        """Return places of the joints while nothing is turned, the root at the origin, in the file's unit."""
        positions = np.zeros_like(self.offsets)
        for joint, parent in list(enumerate(self.parents))[1:]:
            positions[joint] = positions[parent] + self.offsets[joint]
        return positions

    def _local(self, joint: int, values: np.ndarray) -> tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 4"]]:
        place = np.tile(self.offsets[joint], (len(values), 1))
        quat = np.tile(se3.IDENTITY_QUAT, (len(values), 1))
        for channel, column in zip(self.channels[joint], values.T, strict=True):
            axis = "XYZ".index(channel[0])
            if channel.endswith("position"):
                place[:, axis] = column
            else:
                quat = se3.quat_multiply(quat, se3.exp(np.deg2rad(column)[:, None] * np.eye(3)[axis]))
        return place, quat


def bvh_of_rotations(  # noqa: PLR0913 - the fields of a file
    names: Sequence[str],
    parents: Sequence[int],
    offsets: Float[np.ndarray, "J 3"],
    root: Float[np.ndarray, "T 3"],
    quats: Float[np.ndarray, "T J 4"],
    *,
    rate: float,
) -> Bvh:
    """Return the motion of a skeleton, from its joints' rotations in their parents.

    Args: `names`: of the joints; `parents`: -1 for the root, which comes first; `offsets`: places in the parents'
    frames while nothing is turned; `root`: its places; `quats`: wxyz; `rate`: frames a second [Hz].
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Where two axes are one, one of the two angles is as good as the other.
        angles = scipy.spatial.transform.Rotation.from_quat(se3.quat_to_xyzw(quats.reshape(-1, 4))).as_euler(
            "XYZ", degrees=True
        )
    values = np.concatenate([np.tile(offsets, (len(root), 1, 1)), angles.reshape(len(root), -1, 3)], axis=2)
    values[:, 0, :3] = root
    channels = (CHANNELS,) * len(names)
    return Bvh(tuple(names), tuple(parents), offsets, channels, str(1.0 / rate), values.reshape(len(root), -1))


def is_bvh(content: bytes) -> bool:
    """Return whether a file begins as BVH does."""
    return content[:200].lstrip(b"\xef\xbb\xbf \t\r\n")[:9].upper() == b"HIERARCHY"


def parse_bvh(content: bytes, path: Path) -> Bvh:
    """Return the skeleton and motion of a BVH file; raises `ReadError` naming the line where it is damaged."""
    lines = enumerate(content.decode("utf-8-sig", "replace").splitlines(), 1)
    parser = _Parser(path, ((number, line.strip()) for number, line in lines if not line.isspace() and line))
    return parser.parse()


@dataclass(eq=False)
class _Parser:
    """Takes a file line by line."""

    path: Path
    lines: Iterator[tuple[int, str]]
    number: int = 0
    rest: list[str] = field(default_factory=list)  # Rest of the line `number`: braces may stand on the lines of others.
    names: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[list[float]] = field(default_factory=list)
    channels: list[tuple[str, ...]] = field(default_factory=list)

    def parse(self) -> Bvh:
        self._hierarchy()
        frames = self._numbers(self._expect("FRAMES:"), 1, "the number of frames")[0]
        frame_time = self._expect("FRAME TIME:").strip()
        if self._numbers(frame_time, 1, "the seconds between frames")[0] <= 0.0:
            raise self._error(f"the time between frames is {frame_time}; it must be positive")
        values = self._motion(frames)
        offsets = np.array(self.offsets)
        return Bvh(tuple(self.names), tuple(self.parents), offsets, tuple(self.channels), frame_time, values)

    def _hierarchy(self) -> None:
        """Take all joints, up to the line `MOTION`."""
        self._expect("HIERARCHY")
        open_joints: list[int] = []
        while (line := self._next()).upper() != "MOTION":
            word, _, rest = line.partition(" ")
            if word.upper() in ("ROOT", "JOINT", "END"):
                self._begin(word.upper(), rest.strip(), open_joints)
            elif line == "}" and open_joints:
                open_joints.pop()
            else:
                raise self._error(f"{line[:40]!r} is no part of a hierarchy")
        if open_joints or not self.names:
            raise self._error("the hierarchy is not complete")

    def _begin(self, word: str, name: str, open_joints: list[int]) -> None:
        """Take the beginning of a joint, up to its children."""
        if (word == "ROOT") != (not open_joints) or (word == "ROOT" and self.names):
            raise self._error(f"{word} {name[:40]!r} does not belong there; one skeleton with one root is read")
        if len(self.names) == _MAX_JOINTS:
            raise self._error(f"there are more than {_MAX_JOINTS} joints")
        parent = open_joints[-1] if open_joints else -1
        open_joints.append(len(self.names))
        self.names.append(f"{self.names[parent]}{END}" if word == "END" else name)
        self.parents.append(parent)
        self._expect("{")
        self.offsets.append(self._numbers(self._expect("OFFSET"), 3, f"the offset of {name[:40]!r}"))
        self.channels.append(() if word == "END" else self._channels(name))

    def _channels(self, name: str) -> tuple[str, ...]:
        count, *channels = self._expect("CHANNELS").split() or [""]
        known = {channel.lower(): channel for channel in CHANNELS}
        named = tuple(known.get(channel.lower(), "") for channel in channels)
        if count != str(len(channels)) or "" in named or len(set(named)) < len(named):
            raise self._error(
                f"the channels of {name[:40]!r} are {' '.join([count, *channels])[:80]!r}, expected their number and "
                f"as many of {', '.join(CHANNELS)}"
            )
        return named

    def _motion(self, frames: float) -> Float[np.ndarray, "T C"]:
        width = sum(map(len, self.channels))
        rows = [line for _, line in self.lines]
        if len(rows) != frames:
            raise self._error(f"{frames:g} frames are promised, {len(rows)} rows of numbers follow")
        if not rows:
            return np.zeros((0, width))
        try:
            values = np.loadtxt(rows, dtype=float, comments=None, ndmin=2)
        except ValueError as error:
            raise self._error(f"the frames that follow are no table of numbers ({error})") from error
        if values.shape[1] != width:
            raise self._error(f"each frame has {values.shape[1]} numbers, but the channels are {width}")
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(bad):
            raise self._error(f"numbers of {describe_frames(bad)} are not finite")
        return values

    def _next(self) -> str:
        if not self.rest:
            self.number, line = next(self.lines, (self.number, ""))
            self.rest = [part.strip() for part in re.split("([{}])", line) if part.strip()]
        if not self.rest:
            raise self._error("the file ends there")
        return self.rest.pop(0)

    def _expect(self, word: str) -> str:
        """Take a line that begins with a word, and return the rest of it."""
        line = self._next()
        if not line.upper().startswith(word):
            raise self._error(f"{line[:40]!r} stands in the place of {word}")
        return line[len(word) :]

    def _numbers(self, text: str, count: int, meaning: str) -> list[float]:
        try:
            numbers = [float(word) for word in text.split()]
        except ValueError:
            numbers = []
        if len(numbers) != count or not np.isfinite(numbers).all():
            raise self._error(f"{text.strip()[:60]!r} stands in the place of {meaning}")
        return numbers

    def _error(self, what: str) -> ReadError:
        return ReadError(f"{self.path}: line {self.number}: {what}. Export or download the file again.")
