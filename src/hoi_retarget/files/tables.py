"""Tables of settings, from TOML or JSON, as typed values: every key known, every value of its field's type."""

import tomllib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

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


def decode(kind: type[T], values: Any, owner: str) -> T:
    """Return plain values as a frozen dataclass, checked against the types of its fields.

    Args:
        kind: The dataclass; fields of it may be dataclasses, tuples and mappings of them.
        values: What TOML or JSON holds.
        owner: What an error begins with: the file, and the key there.

    Raises:
        ReadError: A key does not exist, or a value is not of its field's type.
        ArgumentError: The dataclass refuses a value.
    """
    import msgspec  # noqa: PLC0415  # help needs none of it

    check_keys(kind, values, owner)
    try:
        return msgspec.convert(values, kind)
    except msgspec.ValidationError as error:
        reason, _, place = str(error).partition(" - at `$")
        raise ReadError(f"{owner}{place.rstrip('`')}: {reason[:1].lower()}{reason[1:]}.") from error


def check_keys(kind: type, values: Any, owner: str) -> None:
    """Raise `ReadError` for a key of a table, or of a table in it, that is no field."""
    if not isinstance(values, Mapping):
        raise ReadError(f"{owner} is {values!r}; expected a table of settings.")
    known = [item.name for item in fields(kind)]
    unknown = [str(key) for key in values if key not in known]
    if unknown:
        raise ReadError(f"{owner}: there is no {', '.join(map(repr, unknown))}. Keys there: {', '.join(known)}.")
    types = get_type_hints(kind)
    for key, value in values.items():
        if is_dataclass(types[key]) and isinstance(types[key], type) and isinstance(value, Mapping):
            check_keys(types[key], value, f"{owner}.{key}")
