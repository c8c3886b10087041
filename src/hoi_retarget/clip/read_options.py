"""How a clip is read: what recordings leave open, and the user says."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, get_args

from hoi_retarget.errors import ArgumentError, ReadError

HIGHEST_FLOOR = 1000.0
"""[m]"""
Labels = Literal["auto", "proximity", "interact"]
Grasps = Literal["refuse", "warn"]
_CHOICES: Mapping[str, tuple[str, ...]] = {"labels": get_args(Labels), "grasps": get_args(Grasps)}


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """What a clip is read with, beside its name."""

    objects: Path | None = None
    """Folder with the objects' geometry, `<name>/<name>.obj` or as the source gives it; built-in clips need none."""
    object_name: str | None = None
    """The object's name, where the recording does not tell it."""
    body_models: Path | None = None
    """Folder with SMPL-X or SMPL-H models, for recordings that hold their parameters."""
    floor: float | None = None
    """Height of the floor in the recording [m], where it is known better than by the source or an estimate."""
    labels: Labels = "auto"
    """Where contacts come from, as `infer_contacts.with_contacts` takes it."""
    grasps: Grasps = "refuse"
    """Whether a clip is refused whose grasps contradict how its rotations or units are read, or only warned of."""

    def __post_init__(self) -> None:
        if self.floor is not None and not abs(self.floor) <= HIGHEST_FLOOR:
            raise ArgumentError(
                f"--floor {self.floor:g}: the floor's height in the recording is at most {HIGHEST_FLOOR:g} m, up or "
                "down. Leave the option out to have it estimated."
            )

    def as_json(self) -> dict[str, str | float | None]:
        """Return the options as a result's report keeps them."""
        values = {name: getattr(self, name) for name in NAMES}
        return {name: str(value) if isinstance(value, Path) else value for name, value in values.items()}

    @staticmethod
    def from_json(table: Mapping[str, Any]) -> "ReadOptions":
        """Return the options in a table, such as `as_json` makes; raises `ReadError` where a value means nothing.

        The table may have other entries, too; options that it lacks keep their defaults.
        """
        values = {name: table[name] for name in NAMES if table.get(name) is not None}
        for name, value in values.items():
            if name == "floor":
                good, expected = type(value) in (int, float), "a number"
            elif name in _CHOICES:
                good, expected = value in _CHOICES[name], f"one of {', '.join(_CHOICES[name])}"
            else:
                good, expected = isinstance(value, str), "a text"
            if not good:
                raise ReadError(f"{name} is {value!r}; expected {expected}.")
            if name in ("objects", "body_models"):
                values[name] = Path(value)
        return ReadOptions(**values)


NAMES: tuple[str, ...] = tuple(field.name for field in fields(ReadOptions))
"""Names of the options."""
