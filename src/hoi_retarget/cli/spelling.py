"""Commands, options and choices that do not exist, told with the name that they are most like."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from tyro.conf import Positional

from hoi_retarget.cli.commands import (
    COMMANDS,
    AddRobot,
    CheckRobot,
    FetchMeshes,
    ListRobots,
    RemoveRobot,
    Robots,
    ShowRobot,
)
from hoi_retarget.errors import ArgumentError, did_you_mean

_ACTIONS: Mapping[str, type] = {
    "add": AddRobot,
    "remove": RemoveRobot,
    "list": ListRobots,
    "show": ShowRobot,
    "check": CheckRobot,
    "meshes": FetchMeshes,
}
_POSITIONAL = get_args(Positional[int])[1]


def check_spelling(words: Sequence[str]) -> None:
    """Raise `ArgumentError` for a command, an option or a choice that does not exist."""
    kind, rest, shown = _named(COMMANDS, words, "hoi-retarget", "command")
    if kind is Robots:
        kind, rest, shown = _named(_ACTIONS, rest, shown, "action")
    if kind is None:
        return
    options = dict(_options(kind))
    for word, following in pairwise((*rest, "")):
        name, equals, value = word.partition("=")
        option = name.replace("_", "-")
        if not option.startswith("--") or option in ("--", "--help"):
            continue
        if option not in options:
            raise ArgumentError(f"{shown} has no option {name}.{_near(option, options)} See {shown} --help.")
        chosen, choices = value if equals else following, options[option]
        if choices and chosen and chosen not in choices:
            near = did_you_mean(chosen, choices)
            raise ArgumentError(f"{option} {chosen}: there is no such choice.{near} Choices: {', '.join(choices)}.")


def _named(kinds: Mapping[str, Any], words: Sequence[str], shown: str, noun: str) -> tuple[Any, Sequence[str], str]:
    """Return what the first word names, the words behind it, and all up to it; None where help is asked for."""
    if not words or words[0].startswith("-"):
        return None, (), shown
    if words[0] not in kinds:
        near = did_you_mean(words[0], kinds)
        raise ArgumentError(f"{shown} has no {noun} {words[0]!r}.{near} Each {noun}: {', '.join(kinds)}.")
    return kinds[words[0]], words[1:], f"{shown} {words[0]}"


def _near(option: str, options: Iterable[str]) -> str:
    """Return the option that is meant, whose group may have been left out: `--jerk` of `--weights.jerk`."""
    inner = [known for known in options if known.endswith(f".{option.removeprefix('--')}")]
    return f" Did you mean {inner[0]}?" if inner else did_you_mean(option, options)


def _options(kind: type, prefix: str = "--") -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield each option of a command and its choices, none where its value is free."""
    hints = get_type_hints(kind, include_extras=True)
    for field in fields(kind):
        hint, metadata = hints[field.name], ()
        if get_origin(hint) is Annotated:
            hint, *metadata = get_args(hint)
        if _POSITIONAL in metadata:
            continue
        if is_dataclass(hint):
            yield from _options(hint, f"{prefix}{field.name.replace('_', '-')}.")  # pyright: ignore[reportArgumentType]  # a class
            continue
        choices = tuple(map(str, get_args(hint))) if get_origin(hint) is Literal else ()
        names = {field.name, *(name for item in metadata if (name := getattr(item, "name", None)))}
        aliases = {alias for item in metadata for alias in getattr(item, "aliases", None) or ()}
        for option in {f"{prefix}{name.replace('_', '-')}" for name in names} | aliases:
            yield option, choices
            if hint is bool:
                yield option.replace("--", "--no-", 1), ()
