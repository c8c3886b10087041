"""Containers of motion formats: named values out of a kind of file, with clear errors, and into it as bytes."""

import io
import json
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.files import npz
from hoi_retarget.files.array_pickle import parse_pickle
from hoi_retarget.files.reading import read_bytes
from hoi_retarget.files.torch_file import parse_torch

FOLDER = "/"  # Stands for the ending of a folder's name.
TABLE, HEADER = "table", "header"
"""The one array of a CSV file, which has no name in it, and the names of its columns where the first line has them."""
MOTION, META = "motion.npz", "meta.json"  # Files of a folder: its arrays, and its value `META` as JSON.
JOINTS = "joint_pos"
"""The table of a folder of tables that has the joints; `<name> columns` are the names of a table's columns."""
_TABLES = (JOINTS, "joint_vel", "body_pos", "body_quat", "body_lin_vel", "body_ang_vel")
_KINDS = "biufU"
_PICKLE_START = b"\x80"  # Begins pickles of protocol 2 and later, but no UTF-8 text.
_MAX_RATE = 1e300  # A whole number may be too large for a float.
_PICKLED_BY_NUMPY_2 = b"cnumpy._core.multiarray\n_reconstruct\n"
_READ_BY_ALL_NUMPYS = b"cnumpy.core.multiarray\n_reconstruct\n"


@dataclass(frozen=True, eq=False)
class Container:
    """A kind of file."""

    suffixes: tuple[str, ...]  # Of names of files that are read so; the first is written.
    read: Callable[[Path], Any]  # Returns values by name, as far as the file has names; raises `ReadError`.
    inside: str = ""  # The file that is read of a folder; empty where a folder is no such container.
    encode: Callable[[Mapping[str, Any]], Mapping[str, bytes]] | None = None
    """Returns files' bytes by what follows the export's name: the same bytes for the same values; None if only read."""


def read_npz(path: Path) -> dict[str, Any]:
    """Return the arrays of an .npz file, and plain values such as None that were saved as objects.

    Raises `ReadError` for a damaged file, and for objects that are no plain values.
    """
    content = read_bytes(path)
    try:
        packed = npz.members(content)
    except ValueError as error:
        raise ReadError(f"{path}: not a readable .npz file ({error}). Download or make it again.") from error
    arrays: dict[str, Any] = {}
    for name, member in packed.items():
        try:
            is_object = b"'descr': '|O'" in member[:128]
            arrays[name] = npz.object_or_array(path, name, member) if is_object else npz.array(name, member, _KINDS)
        except ValueError as error:
            raise ReadError(f"{path}: the file is damaged ({error}). Download or make it again.") from error
    return arrays


def _read_pickle(path: Path) -> Any:
    return parse_pickle(read_bytes(path), path)


def read_csv(path: Path) -> dict[str, Any]:
    """Return the same as `parse_csv` of a file's content; raises `ReadError`."""
    return parse_csv(read_bytes(path), path)


def parse_csv(content: bytes, path: Path) -> dict[str, Any]:
    """Return the table of a CSV file, and the names of its columns where it has a header; raises `ReadError`."""
    if content.startswith(_PICKLE_START):
        raise ReadError(f"{path}: this is a pickle, not a text file. Call it {path.with_suffix('.pkl').name}.")
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ReadError(f"{path}: not a text file. Expected rows of numbers with commas between them.") from error
    rows = [(number, line.split(",")) for number, line in enumerate(lines, 1) if line.strip()]
    if not rows:
        raise ReadError(f"{path}: the file is empty, expected rows of numbers with commas between them.")
    names = header_of(",".join(rows[0][1]))
    width = len(rows[0][1])
    rows = rows[1:] if names else rows
    table = np.zeros((len(rows), width))
    for index, (number, cells) in enumerate(rows):
        if len(cells) != width:
            raise ReadError(f"{path}: line {number} has {len(cells)} columns, those before it {width}.")
        try:
            table[index] = [float(cell) for cell in cells]
        except ValueError as error:
            raise ReadError(f"{path}: line {number}: {error}. Expected numbers below at most one header.") from error
    return {TABLE: table, HEADER: names} if names else {TABLE: table}


def _read_csv_folder(path: Path) -> dict[str, Any]:
    """Return the tables of a folder, of which one is named, with the names of their columns; raises `ReadError`."""
    values: dict[str, Any] = {}
    for name in _TABLES:
        place = path.with_name(f"{name}.csv")
        if name == JOINTS or place.is_file():
            content = read_csv(place)
            values[name] = content[TABLE]
            values[f"{name} columns"] = content.get(HEADER) or tuple(f"q{i}" for i in range(content[TABLE].shape[1]))
    return values


def header_of(line: str) -> tuple[str, ...]:
    """Return the names in a table's first line; none where any cell is a number."""
    names = tuple(cell.strip().strip("\"'").strip() for cell in line.lstrip("# ").split(","))
    return () if any(_is_number(name) for name in names) else names


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def to_json(content: Mapping[str, Any]) -> bytes:
    """Return an indented JSON file; question marks stand for half characters, which no text can hold."""
    return (json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n").encode("utf-8", "replace")


def to_pickle(content: Mapping[str, Any]) -> bytes:
    """Return a pickled dict of plain values and arrays that numpy 1 and 2 both read."""
    # Protocol 3 spells the names of functions as lines of text. numpy 2 has another name for the one
    # that makes an array; numpy 1 knows only the older one, which numpy 2 knows too. It is spelled
    # once, before any array's numbers.
    return pickle.dumps(dict(content), protocol=3).replace(_PICKLED_BY_NUMPY_2, _READ_BY_ALL_NUMPYS, 1)


def _to_csv(content: Mapping[str, Any]) -> bytes:
    text = io.StringIO()
    header = ",".join(content.get(HEADER, ()))
    np.savetxt(text, content[TABLE], fmt="%.9f", delimiter=",", header=header, comments="")
    return text.getvalue().encode()


def _to_folder(content: Mapping[str, Any]) -> dict[str, bytes]:
    arrays = {name: value for name, value in content.items() if name != META}
    return {f"/{MOTION}": npz.encode(arrays), f"/{META}": to_json(content[META])}


NPZ = Container((".npz",), read_npz, encode=lambda values: {".npz": npz.encode(values)})
PICKLE = Container((".pkl", ".pickle", ".joblib"), _read_pickle, encode=lambda values: {".pkl": to_pickle(values)})
TORCH = Container((".motion",), lambda path: parse_torch(read_bytes(path), path))
CSV = Container((".csv",), read_csv, encode=lambda values: {".csv": _to_csv(values)})
NPZ_AND_JSON = Container((FOLDER, ".npz"), read_npz, inside=MOTION, encode=_to_folder)
"""A folder of two files; its arrays are also read on their own."""
CSV_FOLDER = Container((FOLDER,), _read_csv_folder, inside=f"{JOINTS}.csv")  # A folder of tables.


@dataclass(frozen=True, eq=False)
class ArraysByName:
    """A file's entries by name; raises `ReadError` for one that is missing or something else."""

    path: Path
    values: Mapping[str, Any]

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def numbers(self, name: str) -> np.ndarray:
        """Return an array of numbers."""
        if name not in self.values:
            there = ", ".join(sorted(map(str, self.values))) or "nothing"
            raise ReadError(f"{self.path}: there is no '{name}' in it. It holds: {there}.")
        value = self.values[name]
        if isinstance(value, list | tuple):
            value = _from_list(value)
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "biuf":
            raise ReadError(f"{self.path}: '{name}' is no array of numbers. Make the file again.")
        return value.astype(float)

    def optional(self, name: str) -> np.ndarray | None:
        """Return an array of numbers, None where it is not there."""
        return self.numbers(name) if self.values.get(name) is not None else None

    def table(self, name: str, min_columns: int) -> np.ndarray:
        """Return a table, a frame a row."""
        array = self.numbers(name)
        if array.ndim != 2 or array.shape[1] < min_columns:
            raise ReadError(
                f"{self.path}: {name} has shape {array.shape}, expected a table of at least {min_columns} columns."
            )
        return array

    def pose(self, position: str, rotation: str) -> np.ndarray:
        """Return a free joint of its two arrays, the position first."""
        return self.joined(self.numbers(position), self.numbers(rotation))

    def joined(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Return a free joint of its position and its rotation over time, or its velocity of theirs."""
        if first.ndim != 2 or second.ndim != 2 or len(first) != len(second):
            raise ReadError(
                f"{self.path}: parts of shapes {first.shape} and {second.shape} are no pose over time, nor a velocity."
            )
        return np.concatenate([first, second], axis=1)

    def rate(self) -> float | None:
        """Return the stated frames a second [Hz], None where there are none."""
        value = self.values.get("fps")
        if value is None:
            return None
        if isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.size == 1:
            return float(value.reshape(()))
        if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < _MAX_RATE:
            return float(value)
        raise ReadError(f"{self.path}: 'fps' is not one number. Make the file again.")

    def text(self, name: str) -> str:
        """Return a text."""
        value = self.values.get(name)
        if isinstance(value, np.ndarray) and value.dtype.kind == "U" and value.size == 1:
            value = value.item()
        if not isinstance(value, str):
            raise ReadError(f"{self.path}: '{name}' is no text. Make the file again.")
        return value

    def names(self, name: str) -> tuple[str, ...]:
        """Return a list of names."""
        value = self.values.get(name)
        if isinstance(value, np.ndarray) and value.dtype.kind == "U":
            value = value.ravel().tolist()
        if not isinstance(value, list | tuple) or not all(isinstance(item, str) for item in value):
            raise ReadError(f"{self.path}: '{name}' is no list of names. Make the file again.")
        return tuple(value)

    def joint_names(self) -> tuple[str, ...] | None:
        """Return the names of the joints' columns, by either of the keys that are in use; None without them."""
        keys = (key for key in ("joint_names", "dof_names") if self.values.get(key) is not None)
        return next((self.names(key) for key in keys), None)

    def contents(self) -> tuple[str, ...]:
        """Return the names, types and shapes of all entries, in words."""
        return tuple(
            f"{name} {value.dtype.name} {value.shape}"
            if isinstance(value, np.ndarray)
            else f"{name} {type(value).__name__}"
            for name, value in self.values.items()
        )


def has(*names: str) -> Callable[[Mapping[str, Any]], bool]:
    """Return whether all of these are among a file's entries, as a function of them."""
    return lambda values: set(names) <= set(values)


def _from_list(value: list | tuple) -> Any:
    try:
        return np.array(value)
    except ValueError:  # Rows of different lengths.
        return None
