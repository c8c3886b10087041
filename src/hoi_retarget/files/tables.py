"""Tables of settings, from TOML or JSON, as typed values: every key known, every value of its field's type."""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from hoi_retarget.errors import ReadError
from hoi_retarget.files.reading import read_bytes

T = TypeVar("T")


def read_toml(path: Path) -> dict[str, Any]:
    """Return the table of a TOML file; raises `ReadError` when it is missing or no TOML."""
    try:
        return tomllib.loads(read_bytes(path).decode())
    except (ValueError, RecursionError) as error:
        raise ReadError(f"{path}: not a TOML file ({error}).") from error


def decode(  # noqa: PLR0913  # the last three are options
    kind: type[T],
    values: Any,
    owner: str,
    *,
    default: T | None = None,
    folder: Path = Path(),
    hidden: tuple[str, ...] = (),
) -> T:
    """Return plain values as a frozen dataclass, checked against the types of its fields.

    Args: `kind`: the dataclass; fields of it may be dataclasses, tuples and mappings of them; `values`: from TOML or
    JSON; `owner`: begins an error: the file, and the key there; `default`: holds what the values leave out; by default
    the fields' own defaults do; `folder`: what relative paths are relative to; `hidden`: fields that are no keys.
    Raises `ReadError`: a key does not exist, or a value is not of its field's type; `ArgumentError`: the dataclass
    refuses a value.
    """
    import msgspec  # noqa: PLC0415  # help needs none of it

    def path(kind: type, value: Any) -> Any:
        if kind is Path and isinstance(value, str):
            return folder / value
        raise TypeError

    _check_all_keys(kind, values, owner, hidden)
    whole = values if default is None else _overlaid(asdict(default), values)  # pyright: ignore[reportArgumentType]  # T is a dataclass
    try:
        return msgspec.convert(whole, kind, dec_hook=path)
    except msgspec.ValidationError as error:
        reason, _, place = str(error).partition(" - at `$")
        steps = re.findall(r"[^.\[\]`]+", place)
        if not steps:
            raise ReadError(f"{owner}: {reason[:1].lower()}{reason[1:]}.") from error
        value, expected = _mistaken(kind, whole, steps)
        raise ReadError(f"{owner}: {place[1:-1]} holds {value!r}; expected {expected}.") from error


def check_keys(kind: type, values: Any, owner: str, hidden: tuple[str, ...] = ()) -> None:
    """Raise `ReadError` unless values are a table with fields of a dataclass as keys.

    An error begins with the owner; `hidden` fields are no keys.
    """
    if not isinstance(values, Mapping):
        raise ReadError(f"{owner} is {values!r}; expected a table of settings.")
    known = [item.name for item in fields(kind) if item.name not in hidden]
    unknown = [str(key) for key in values if key not in known]
    if unknown:
        raise ReadError(f"{owner}: there is no {', '.join(map(repr, unknown))}. Keys there: {', '.join(known)}.")


def _check_all_keys(kind: type, values: Any, owner: str, hidden: tuple[str, ...] = ()) -> None:
    """Do the same for the tables in a table, too."""
    check_keys(kind, values, owner, hidden)
    types = get_type_hints(kind)
    for key, value in values.items():
        if isinstance(types[key], type) and is_dataclass(types[key]):
            _check_all_keys(types[key], value, f"{owner}.{key}")


def _overlaid(table: dict[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table in which values replace others, those of inner tables one by one."""
    inner = {key: _overlaid(table[key], value) for key, value in values.items() if isinstance(table.get(key), dict)}
    return {**table, **values, **inner}


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
