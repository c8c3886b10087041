"""Values of a source's file by name, each checked as it is taken."""

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hoi_retarget.errors import ClipError
from hoi_retarget.numerics.arrays import describe_frames

LARGEST_VALUE = 1e4
"""Of any number; metres, radians and parameters of bodies stay below."""


class Fields:
    """A table of a file's values; what is taken from it is of the right kind, shape and size."""

    def __init__(self, path: Path, values: Mapping[str, Any], *, within: str = "") -> None:
        """Take the values of a file; `within` says where in the file they stand."""
        self.path, self._values, self._within = path, values, within

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def get(self, name: str) -> Any:
        """Return a value as it is stored; None where there is none."""
        return self._values.get(name)

    def array(self, name: str, shape: tuple[int | str, ...], meaning: str) -> np.ndarray:
        """Return an array of finite numbers in double precision.

        Args:
            name: what it is called.
            shape: numbers must agree; letters stand for any length, the same letter for the same one.
            meaning: what it is, for errors.

        Raises:
            ClipError: it is missing, of another kind or shape, or holds numbers that are not finite or absurdly large.
        """
        try:
            values = np.asarray(self._value(name, meaning))
        except ValueError as error:  # Lists of different lengths.
            raise ClipError(f"{self._where(name, meaning)} is no array ({error}). Download it again.") from error
        if values.dtype.kind not in "fiub":
            raise ClipError(f"{self._where(name, meaning)} holds {values.dtype}, expected numbers. Download it again.")
        lengths: dict[str, int] = {}
        fits = len(shape) == values.ndim and all(
            have == (want if isinstance(want, int) else lengths.setdefault(want, have))
            for want, have in zip(shape, values.shape, strict=True)
        )
        if not fits:
            wanted = f"({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
            raise ClipError(f"{self._where(name, meaning)} has shape {values.shape}, expected {wanted}.")
        values = values.astype(float)
        bad = ~(np.abs(values) <= LARGEST_VALUE)
        if bad.any():
            rows = describe_frames(np.unique(np.argwhere(bad)[:, 0])) if values.ndim else "its only one"
            raise ClipError(
                f"{self._where(name, meaning)} holds numbers that are not finite or above {LARGEST_VALUE:g} in "
                f"{rows}. Cut them off, or convert the recording again."
            )
        return values

    def rows(self, name: str, frames: int | str, width: int, meaning: str) -> np.ndarray:
        """Return an array with so many numbers in a row for each frame, stored so or three by three."""
        stored = self.get(name)
        if isinstance(stored, np.ndarray) and stored.shape[1:] == (width // 3, 3):
            values = self.array(name, (frames, width // 3, 3), meaning)
            return values.reshape(len(values), width)
        return self.array(name, (frames, width), meaning)

    def text(self, name: str, meaning: str) -> str:
        """Return a text; raises `ClipError`."""
        value = self._value(name, meaning)
        if isinstance(value, np.ndarray) and value.size == 1 and value.dtype.kind in "US":
            value = value.reshape(()).item()
            value = value.decode("utf-8", "backslashreplace") if isinstance(value, bytes) else value
        if not isinstance(value, str):
            raise ClipError(f"{self._where(name, meaning)} is {type(value).__name__}, expected a text.")
        return value

    def table(self, name: str, meaning: str) -> "Fields":
        """Return a dictionary in it as fields of their own; raises `ClipError`."""
        value = self._value(name, meaning)
        if not isinstance(value, dict):
            raise ClipError(f"{self._where(name, meaning)} is {type(value).__name__}, expected a dictionary.")
        return Fields(self.path, value, within=f"{self._within}{name}/")

    def _value(self, name: str, meaning: str) -> Any:
        if name not in self._values:
            known = [str(key) for key in self._values]
            close = difflib.get_close_matches(name, known, n=1)
            hint = f"Did you mean {close[0]!r}?" if close else f"It has {', '.join(sorted(known)[:20]) or 'nothing'}."
            raise ClipError(f"{self._where(name, meaning)} is missing. {hint} Download the recording again.")
        return self._values[name]

    def _where(self, name: str, meaning: str) -> str:
        return f"{self.path}: {self._within}{name}, {meaning},"
