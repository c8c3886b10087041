"""Tables of settings, from TOML or JSON, as typed values: every key known, every value of its field's type."""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from hoi_retarget.errors import ReadError

T = TypeVar("T")


def read_toml(path: Path) -> dict[str, Any]:
    """Return the table of a TOML file; raises `ReadError` when it is missing or no TOML."""
    try:
        return tomllib.loads(path.read_bytes().decode())
    except FileNotFoundError as error:
        raise ReadError(f"{path}: there is no such file. Check the path.") from error
    except OSError as error:
        raise ReadError(f"{path}: cannot be read ({error.strerror or error}).") from error
    except (ValueError, RecursionError) as error:
        raise ReadError(f"{path}: not a TOML file ({error}).") from error


def decode(kind: type[T], values: Any, owner: str, *, folder: Path = Path(), hidden: tuple[str, ...] = ()) -> T:
    """Return plain values as a frozen dataclass, checked against the types of its fields.

    Args:
        kind: The dataclass; fields of it may be dataclasses, tuples and mappings of them.
        values: What TOML or JSON holds.
        owner: What an error begins with: the file, and the key there.
        folder: What relative paths are relative to.
        hidden: Fields that are no keys.

    Raises:
        ReadError: A key does not exist, or a value is not of its field's type.
        ArgumentError: The dataclass refuses a value.
    """
    import msgspec  # noqa: PLC0415  # help needs none of it

    def path(kind: type, value: Any) -> Any:
        if kind is Path and isinstance(value, str):
            return folder / value
        raise TypeError

    check_keys(kind, values, owner, hidden)
    try:
        return msgspec.convert(values, kind, dec_hook=path)
    except msgspec.ValidationError as error:
        reason, _, place = str(error).partition(" - at `$")
        steps = re.findall(r"[^.\[\]`]+", place)
        if not steps:
            raise ReadError(f"{owner}: {reason[:1].lower()}{reason[1:]}.") from error
        value, expected = _mistaken(kind, values, steps)
        raise ReadError(f"{owner}: {place[1:-1]} holds {value!r}; expected {expected}.") from error


def check_keys(kind: type, values: Any, owner: str, hidden: tuple[str, ...] = ()) -> None:
    """Raise `ReadError` for a key of a table, or of a table in it, that is no field."""
    if not isinstance(values, Mapping):
        raise ReadError(f"{owner} is {values!r}; expected a table of settings.")
    known = [item.name for item in fields(kind) if item.name not in hidden]
    unknown = [str(key) for key in values if key not in known]
    if unknown:
        raise ReadError(f"{owner}: there is no {', '.join(map(repr, unknown))}. Keys there: {', '.join(known)}.")
    types = get_type_hints(kind)
    for key, value in values.items():
        if is_dataclass(types[key]) and isinstance(types[key], type) and isinstance(value, Mapping):
            check_keys(types[key], value, f"{owner}.{key}")


_WORDS: Mapping[Any, str] = {
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    str: "a text",
    Path: "a text",
    tuple: "a list",
}


def _mistaken(kind: Any, value: Any, steps: list[str]) -> tuple[Any, str]:
    """Return the value at a place in nested tables and lists, and the words for its type."""
    for step in steps:
        if isinstance(value, list):
            value, kind = value[int(step)], get_args(kind)[0]
        elif is_dataclass(kind):
            value, kind = value[step], get_type_hints(kind)[step]
        else:  # A mapping, of which msgspec does not tell the key.
            return value, f"values that are {_words(get_args(kind)[-1])}"
    return value, _words(kind)


def _words(kind: Any) -> str:
    arguments = [argument for argument in get_args(kind) if argument is not NoneType]
    if get_origin(kind) is Literal:
        return " or ".join(map(repr, arguments))
    if get_origin(kind) in (Union, UnionType):
        return " or ".join(map(_words, arguments))
    return _WORDS.get(get_origin(kind) or kind, "a table")
