"""The arrays of a clip's file by name, each checked as it is taken."""

import difflib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hoi_retarget.clip.clip import MINIMUM_FRAMES
from hoi_retarget.errors import ClipError, ReadError
from hoi_retarget.files import npz
from hoi_retarget.readers.own_layout.layout import (
    DOCUMENT,
    FORMAT,
    INTEGERS,
    LARGEST_VALUE,
    NUMBERS,
    SCHEMA,
    SCHEMA_KEY,
    TEXT,
    UNIT,
    UP,
)


class Arrays:
    """The arrays of a file; what nobody takes is not known."""

    def __init__(self, path: Path, members: Mapping[str, bytes]) -> None:
        self.path, self._members, self._used = path, members, set[str]()

    def __contains__(self, name: str) -> bool:
        return name in self._members

    def dimensions(self, name: str) -> int:
        """Return how many axes an array has, none where it is missing or no plain array."""
        try:
            return npz.array(name, self._members[name], NUMBERS).ndim
        except (KeyError, ValueError):
            return 0

    def array(self, name: str, kinds: str, shape: tuple[int | str, ...], meaning: str) -> np.ndarray:
        """Return an array; letters in its shape stand for any length. Raises `ClipError`."""
        self._used.add(name)
        if name not in self._members:
            close = difflib.get_close_matches(name, self._members, n=1, cutoff=0.75)
            known = f"Did you mean {close[0]!r}?" if close else f"It has {', '.join(sorted(self._members)[:20])}."
            raise ClipError(f"{self.path}: the clip lacks {name!r}, {meaning}. {known} {DOCUMENT}")
        try:
            values = npz.array(name, self._members[name], kinds)
        except (ValueError, UnicodeDecodeError) as error:
            raise ClipError(f"{self.path}: {name}, {meaning}, cannot be used: {error}. {DOCUMENT}") from error
        fits = len(shape) == values.ndim and all(
            isinstance(want, str) or want == have for want, have in zip(shape, values.shape, strict=True)
        )
        if not fits:
            wanted = f"({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
            raise ClipError(f"{self.path}: {name}, {meaning}, has shape {values.shape}, expected {wanted}. {DOCUMENT}")
        if values.dtype.kind == "f" and name != "contact_points" and not np.isfinite(values).all():
            frames = np.unique(np.argwhere(~np.isfinite(values))[:, 0]) if values.ndim else np.zeros(1, dtype=int)
            raise ClipError(
                f"{self.path}: {name}, {meaning}, holds numbers that are not finite, first at row {frames[0]}. "
                "Cut those frames, or fill them where the recording is made."
            )
        if values.dtype.kind == "f" and np.abs(np.nan_to_num(values)).max(initial=0.0) > LARGEST_VALUE:
            raise ClipError(
                f"{self.path}: {name}, {meaning}, reaches {np.abs(np.nan_to_num(values)).max():.4g}, expected at most "
                f"{LARGEST_VALUE:g}: damage, or another unit. Lengths are in metres."
            )
        return values

    def people(self, name: str, shape: tuple[int | str, ...], meaning: str) -> np.ndarray:
        """Return an array of numbers with frames and people first; raises `ClipError` for too few of either."""
        values = self.array(name, NUMBERS, ("T", "P", *shape), meaning)
        frames, people = values.shape[:2]
        if frames < MINIMUM_FRAMES or people == 0:
            raise ClipError(
                f"{self.path}: {name} has {frames} frame(s) of {people} people; at least {MINIMUM_FRAMES} frames of "
                "one person are needed. Use a longer recording."
            )
        return values

    def person_names(self, count: int) -> list[str]:
        """Return what so many people are called; raises `ClipError`."""
        if "person_names" in self:
            return self.array("person_names", TEXT, (count,), "what the people are called").tolist()
        return [f"person {index}" for index in range(count)] if count > 1 else ["person"]

    def text(self, name: str, meaning: str) -> str:
        """Return a text; raises `ClipError`."""
        return str(self.array(name, TEXT, (), meaning))

    def texts(self, name: str) -> tuple[str, ...]:
        """Return sentences, none where they are missing; raises `ClipError`."""
        return tuple(self.array(name, TEXT, ("N",), "sentences").tolist()) if name in self else ()

    def number(self, name: str, meaning: str) -> float:
        """Return a number; raises `ClipError`."""
        return float(self.array(name, NUMBERS, (), meaning))

    def count(self, name: str) -> int:
        """Return a number of frames, 0 where it is missing; raises `ClipError`."""
        return int(self.array(name, INTEGERS, (), "a number of frames")) if name in self else 0

    def check_schema(self) -> None:
        """Raise `ReadError` unless the file is of this layout, `ClipError` unless z is up and lengths are metres."""
        if SCHEMA_KEY not in self:
            if "schema" in self:
                raise ReadError(
                    f"{self.path}: this is a result, not a clip. Use `hoi-retarget evaluate` on it, or name the "
                    "recording that it was made from."
                )
            listing = ", ".join(ascii(name)[:40] for name in sorted(self._members)[:10])
            raise ReadError(f"{self.path}: not a clip of {FORMAT}: it has no {SCHEMA_KEY!r}, but {listing}. {DOCUMENT}")
        schema = int(self.array(SCHEMA_KEY, INTEGERS, (), "the version of the layout"))
        if schema != SCHEMA:
            raise ReadError(f"{self.path}: {SCHEMA_KEY} is {schema}; this version reads {SCHEMA}.")
        for name, wanted, advice in (
            ("up", UP, "Turn the recording: from y-up, (x, y, z) becomes (x, -z, y)"),
            ("unit", UNIT, "Convert lengths to metres"),
        ):
            stated = self.text(name, f"always {wanted!r}")
            if stated != wanted:
                raise ClipError(f"{self.path}: {name} is {stated[:40]!r}, expected {wanted!r}. {advice}. {DOCUMENT}")

    def check_all_used(self) -> None:
        """Raise `ClipError` when there are arrays that nobody has taken."""
        allowed = {"name", "fps", "licence", "notes", "first_source_frame"}
        unknown = sorted(set(self._members) - self._used - allowed)
        if unknown:
            known = sorted(self._used | allowed)
            close = difflib.get_close_matches(unknown[0], known, n=1)
            hint = f"Did you mean {close[0]!r}?" if close else f"Known here: {', '.join(known)}."
            raise ClipError(f"{self.path}: the clip has {unknown[0]!a}, which the layout does not know. {hint}")


def check_unit(path: Path, name: str, quats: np.ndarray) -> None:
    """Raise `ClipError` unless all quaternions are of unit length, within rounding."""
    lengths = np.linalg.norm(quats, axis=-1)
    bad = np.argwhere(np.abs(lengths - 1.0) > 0.01)
    if len(bad):
        at = tuple(int(index) for index in bad[0])
        raise ClipError(
            f"{path}: {name}{list(at)} has length {lengths[at]:.4g}, expected unit quaternions, wxyz. "
            f"({len(bad)} of {lengths.size} are not.) {DOCUMENT}"
        )
