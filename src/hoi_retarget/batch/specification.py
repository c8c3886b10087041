"""What a set is made of: clips, times robots, sizes, mirror images and speeds. Declared in a small TOML file."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from itertools import product
from pathlib import Path
from typing import Any, Literal, get_args

from hoi_retarget.clip.clip import Augmentation
from hoi_retarget.clip.infer_contacts import Labels
from hoi_retarget.errors import ArgumentError, ReadError
from hoi_retarget.retarget.config import Scaling, parse_horizon
from hoi_retarget.robots import team

Scale = float | Literal["auto"]
_OBJECTS = "objects"  # A folder's own objects, where none are named.


@dataclass(frozen=True)
class Specification:
    """Clips and the grid of what is made of each; every combination is one job.

    Raises `ArgumentError` when a name does not exist or a number is out of its range.
    """

    clips: tuple[str, ...]
    """Files, patterns such as `*.pt`, folders, or built-in clips such as `builtin:carry_box`."""
    folder: Path = Path()
    """What relative paths are relative to."""
    objects: Path | None = None
    """Folder with the objects' geometry."""
    object_name: str | None = None
    """Which object the clips are with, where neither they nor their names say."""
    body_models: Path | None = None
    """Folder with SMPL-X or SMPL-H models, for recordings that hold their parameters."""
    floor: float | None = None
    """Height of the floor in the recordings [m], where it is known better than by the format or an estimate."""
    labels: Labels = "auto"
    """Where contacts come from: `auto`, `proximity` or `interact`, as for `run`."""
    edits: Path | None = None
    """Folder with contact edits, `<clip>.edits.toml` for those clips that have some."""
    robots: tuple[str, ...] = ("unitree_g1",)
    root_scale: Scale = "auto"
    horizon: str = "auto"
    object_scales: tuple[Scale, ...] = ("auto",)
    size_multipliers: tuple[float, ...] = (1.0,)
    mirrored: tuple[bool, ...] = (False,)
    speeds: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        for name in ("clips", "robots", "object_scales", "size_multipliers", "mirrored", "speeds"):
            values = getattr(self, name)
            if not values:
                raise ArgumentError(f"{name} is empty: there is nothing to make. Name at least one.")
            if len(set(values)) < len(values):
                raise ArgumentError(f"{name} names the same twice: {', '.join(map(str, values))}. Name each once.")
        for names in self.robots:
            team(names)
        for object_scale, multiplier in product(self.object_scales, self.size_multipliers):
            Scaling(self.root_scale, object_scale, multiplier)
        for speed in self.speeds:
            Augmentation(speed=speed)
        parse_horizon(self.horizon)


def of_folder(folder: Path, objects: Path | None = None) -> Specification:
    """Return what is made of a folder by default: every clip in it once, for the default robot.

    Without `objects`, a folder of that name in the folder is taken where there is one.
    """
    own = folder / _OBJECTS
    return Specification(("",), folder, objects or (own if own.is_dir() else None))


def read_specification(path: Path) -> Specification:
    """Return what a TOML file declares; its keys are the fields of `Specification`, without `folder`.

    Relative paths in it are relative to its own folder.

    Raises:
        ReadError: the file is missing, no TOML, or has a key or a value that means nothing.
        ArgumentError: as `Specification`.
    """
    try:
        table = tomllib.loads(path.read_bytes().decode())
    except FileNotFoundError as error:
        raise ReadError(
            f"{path}: there is no such file. Name a file like that in docs/dataset.md, or a folder."
        ) from error
    except OSError as error:
        raise ReadError(f"{path}: cannot be read ({error.strerror or error}).") from error
    except (ValueError, RecursionError) as error:
        raise ReadError(f"{path}: not a TOML file ({error}). Write one like that in docs/dataset.md.") from error
    known = [field.name for field in fields(Specification) if field.name != "folder"]
    unknown = [key for key in table if key not in known]
    if unknown:
        raise ReadError(f"{path}: unknown key {', '.join(map(repr, unknown))}. Keys there can be: {', '.join(known)}.")
    if "clips" not in table:
        raise ReadError(f"{path}: 'clips' is missing. Write, for example, clips = [\"recordings/*.pt\"].")
    values = {key: _value(f"{path}: {key}", key, value) for key, value in table.items()}
    folder = path.parent
    return Specification(folder=folder, **_with_paths(values, folder))


def _with_paths(values: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    return {
        key: folder / value if key in ("objects", "body_models", "edits") else value for key, value in values.items()
    }


_LARGEST_INTEGER = 2**63  # Of TOML; Python's may be too large for any float.
_LISTS_OF_TEXTS = ("clips", "robots")


def _value(owner: str, key: str, value: Any) -> Any:
    """Return a value as its field has it, or raise `ReadError`."""
    if key in _SINGLE:
        return _SINGLE[key](owner, value)
    if not isinstance(value, list):
        raise ReadError(f"{owner} is {value!r}; expected a list, such as [{value!r}].")
    if key in _LISTS_OF_TEXTS:
        return tuple(_checked(owner, item, isinstance(item, str), "a list of texts") for item in value)
    if key == "mirrored":
        return tuple(_checked(owner, item, isinstance(item, bool), "a list of true and false") for item in value)
    if key == "object_scales":
        return tuple(_scale(owner, item) for item in value)
    return tuple(_number(owner, item) for item in value)


def _text(owner: str, value: Any) -> str:
    return _checked(owner, value, isinstance(value, str), "a text")


def _labels(owner: str, value: Any) -> Labels:
    known = get_args(Labels)
    return _checked(owner, value, isinstance(value, str) and value in known, f"one of {', '.join(known)}")


def _scale(owner: str, value: Any) -> Scale:
    return "auto" if value == "auto" else _number(owner, value)


def _number(owner: str, value: Any) -> float:
    is_number = isinstance(value, float) or (type(value) is int and abs(value) < _LARGEST_INTEGER)
    return float(_checked(owner, value, is_number, "numbers"))


def _checked(owner: str, value: Any, good: bool, expected: str) -> Any:
    if not good:
        raise ReadError(f"{owner} holds {value!r}; expected {expected}.")
    return value


_SINGLE = {
    **dict.fromkeys(("objects", "object_name", "body_models", "edits", "horizon"), _text),
    "root_scale": _scale,
    "floor": _number,
    "labels": _labels,
}
"""Keys whose value is no list, and what checks it."""
