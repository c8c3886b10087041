"""Arrays by name out of .npz files and dictionaries, with one clear error for each thing that can be wrong."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hoi_retarget.errors import ReadError

_BEYOND_RATES = 1e300  # A whole number may be too large for a float.


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

    def table(self, name: str, least: int) -> np.ndarray:
        """Return a table of at least so many columns."""
        array = self.numbers(name)
        if array.ndim != 2 or array.shape[1] < least:
            raise ReadError(
                f"{self.path}: {name} has shape {array.shape}, expected a table of at least {least} columns."
            )
        return array

    def pose(self, position: str, rotation: str) -> np.ndarray:
        """Return a free joint of its two arrays, the position first."""
        return self.joined(self.numbers(position), self.numbers(rotation))

    def joined(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Return a free joint, or its velocity, of what its position and its rotation have over time."""
        if first.ndim != 2 or second.ndim != 2 or len(first) != len(second):
            raise ReadError(
                f"{self.path}: parts of shapes {first.shape} and {second.shape} are no pose over time, nor a velocity."
            )
        return np.concatenate([first, second], axis=1)

    def rate(self) -> float | None:
        """Return the frames a second that are stated, None where they are not."""
        value = self.values.get("fps")
        if value is None:
            return None
        if isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.size == 1:
            return float(value.reshape(()))
        if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < _BEYOND_RATES:
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
        """Return what is there, in words."""
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
