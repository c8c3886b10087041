"""What every operation of a file of edits is: fields with plain values, checked when it is made."""

import operator
from collections.abc import Callable, Iterable, Mapping
from dataclasses import Field, fields
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from hoi_retarget.errors import ArgumentError
from hoi_retarget.human.skeleton import PARTS

Point = tuple[float | int, float | int, float | int]

LARGEST_COORDINATE = 100.0
"""[m]; points farther from an object's origin are another unit or a slip."""
LARGEST_TURN = 180.0
"""[degrees]"""


class Operation:
    """An operation on a clip; its fields are checked, and numbers made plain, when it is made."""

    parts: ClassVar[tuple[str, ...]] = tuple(PARTS)
    """That it can name."""
    what_parts_do: ClassVar[str] = "touch"

    def __post_init__(self) -> None:
        for item in fields_of(type(self)):
            value = getattr(self, item.name)
            if value is not None or item.default is not None:
                object.__setattr__(self, item.name, self.checked(item.name, value))

    @classmethod
    def checked(cls, name: str, value: Any) -> Any:
        """Return a field's value, of whatever type it is, made plain; raises `ArgumentError`."""
        if name != "part":
            return _CHECKS[name](name, value)
        if not isinstance(value, str) or value not in cls.parts:
            raise ArgumentError(f"part is {value!r}; parts that can {cls.what_parts_do}: {', '.join(cls.parts)}.")
        return value


def fields_of(kind: type[Operation]) -> list["Field[Any]"]:
    """Return the fields of an operation in the order in which files have them: the person last."""
    return sorted(fields(kind), key=lambda item: bool(item.kw_only))  # pyright: ignore[reportArgumentType]  # a dataclass


def _text(name: str, value: Any) -> str:
    if not isinstance(value, str):
        raise ArgumentError(f"{name} is {value!r}; expected a name.")
    return value


def _count(name: str, value: Any) -> int:
    try:
        number = -1 if isinstance(value, bool) else operator.index(value)
    except TypeError:
        number = -1
    if number < 0:
        raise ArgumentError(f"{name} is {value!r}; expected a whole number from 0 on.")
    return number


def _vector(name: str, value: Any) -> Point:
    x, y, z = _numbers(name, value, LARGEST_COORDINATE, "metres")
    return (x, y, z)


def _turn(name: str, value: Any) -> Point:
    x, y, z = _numbers(name, value, LARGEST_TURN, "degrees")
    return (x, y, z)


def _numbers(name: str, value: Any, largest: float, unit: str) -> list[float]:
    numbers = list(value) if isinstance(value, Iterable) and not isinstance(value, str | bytes) else []
    if len(numbers) != 3 or not all(_is_number(number, largest) for number in numbers):
        raise ArgumentError(f"{name} is {value!r}; expected three numbers in {unit}, none beyond {largest:g}.")
    return [float(number) for number in numbers]


def _is_number(number: Any, largest: float) -> bool:
    is_number = isinstance(number, int | float | np.integer | np.floating) and not isinstance(number, bool)
    return is_number and bool(abs(number) <= largest)  # Not so for NaN.


_CHECKS: Mapping[str, Callable[[str, Any], Any]] = MappingProxyType(
    {
        "object": _text,
        **dict.fromkeys(("person", "frame", "start", "stop", "at"), _count),
        **dict.fromkeys(("offset", "point", "position"), _vector),
        "turn": _turn,
    }
)
