"""The text files of contact edits: TOML, read by Python's own parser, never executed.

Beside a file of edits there may be versions of it by name, and unsaved edits. Numbers are written with all of their
digits, so that reading gives the written ones.
"""

import json
import os
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import MISSING, dataclass, fields
from itertools import count
from pathlib import Path
from typing import Any

from hoi_retarget.clip.edits.edits import ContactEdits, MadeFor
from hoi_retarget.clip.edits.operations import OPERATIONS, Edit, fields_of, operation_name
from hoi_retarget.errors import ArgumentError, ReadError, WriteError
from hoi_retarget.files.atomic import write_atomically
from hoi_retarget.files.reading import read_bytes
from hoi_retarget.files.tables import decode

SCHEMA = 1
HEADER = """\
# Contact edits for hoi-retarget: what is changed about who touches what, where and when.
# To use them: hoi-retarget run CLIP --edits FILE --out DIR. To see them: hoi-retarget contacts CLIP --edits FILE.
# They are done from top to bottom. frame is any frame of the contact that is meant, start the first frame, stop one
# past the last; points and offsets are in the object's frame at captured size [m].
"""


def save(edits: ContactEdits, path: Path) -> None:
    """Write edits to a file; raises `WriteError`, and a previous file at `path` is then intact."""
    write_atomically(path, to_text(edits).encode())


def load(path: Path) -> ContactEdits:
    """Return the edits in a file; raises `ReadError` where it is missing, or as `from_text`."""
    try:
        text = read_bytes(path).decode()
    except UnicodeDecodeError as error:
        raise ReadError(f"{path}: not a text file of contact edits ({error}).") from error
    return from_text(text, str(path))


def to_text(edits: ContactEdits) -> str:
    """Return the text of a file with these edits: the same text for the same edits."""
    lines = [HEADER + f"schema = {SCHEMA}", "", "[clip]"]
    lines += [f"{field.name} = {_written(getattr(edits.made_for, field.name))}" for field in fields(MadeFor)]
    for edit in edits.edits:
        lines += ["", "[[edit]]", f'operation = "{operation_name(type(edit))}"']
        values = ((field, getattr(edit, field.name)) for field in fields_of(type(edit)))
        lines += [f"{field.name} = {_written(value)}" for field, value in values if value != field.default]
    return "\n".join(lines) + "\n"


def from_text(text: str, owner: str) -> ContactEdits:
    """Return the edits of a text such as `to_text` returns, from `owner`, which begins messages.

    Raises `ReadError` for no TOML, another schema, and a key, an operation or a value that means nothing.
    """
    try:
        table = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
        raise ReadError(f"{owner}: not a file of contact edits, which is TOML ({error}).") from error
    if "schema" not in table:
        raise ReadError(f"{owner}: no 'schema' entry: not a file of contact edits. It begins with: schema = {SCHEMA}.")
    if table["schema"] != SCHEMA or isinstance(table["schema"], bool):
        raise ReadError(f"{owner}: schema {table['schema']!r}; this version reads {SCHEMA}. Make the edits again.")
    _check_keys(owner, table, ("schema", "clip", "edit"), ("schema", "clip"))
    made_for = _made_for(f"{owner}: [clip]", table["clip"])
    entries = table.get("edit", [])
    if not isinstance(entries, list):
        raise ReadError(f"{owner}: 'edit' is no list of tables. Write [[edit]] above each edit.")
    return ContactEdits(made_for, tuple(_edits(owner, entries)))


def _made_for(owner: str, table: Any) -> MadeFor:
    if not isinstance(table, dict):
        raise ReadError(f"{owner} is no table.")
    names = [item.name for item in fields(MadeFor)]
    _check_keys(owner, table, names, names)
    made_for = decode(MadeFor, table, owner)
    if not 0 < made_for.fps < 1e6:
        raise ReadError(f"{owner} fps is {made_for.fps}; expected frames a second.")
    return made_for


def _edits(owner: str, entries: list[Any]) -> Iterator[Edit]:
    for number, entry in enumerate(entries, start=1):
        here = f"{owner}: edit {number}"
        if not isinstance(entry, dict):
            raise ReadError(f"{here} is no table. Write [[edit]] above each edit.")
        yield edit_of(entry, here)


def edit_of(entry: Mapping[str, Any], owner: str) -> Edit:
    """Return the edit of a table as files have it; raises `ReadError`, begun by `owner`, as `from_text`."""
    name = entry.get("operation")
    kind = OPERATIONS.get(name) if isinstance(name, str) else None
    if kind is None:
        problem = "says no operation" if "operation" not in entry else f"there is no operation {name!r}"
        raise ReadError(f"{owner}: {problem}. Operations: {', '.join(OPERATIONS)}.")
    values = {key: value for key, value in entry.items() if key != "operation"}
    known = fields_of(kind)
    required = [item.name for item in known if item.default is MISSING]
    _check_keys(f"{owner} ({name})", values, [item.name for item in known], required)
    try:
        plain: dict[str, Any] = {key: kind.plain(key, value) for key, value in values.items()}
        return kind(**plain)
    except ArgumentError as error:
        raise ReadError(f"{owner} ({name}): {error}") from error


def _check_keys(owner: str, table: Mapping[str, Any], known: Sequence[str], required: Sequence[str]) -> None:
    unknown, missing = [key for key in table if key not in known], [key for key in required if key not in table]
    keys = f"Keys there can be: {', '.join(known) or 'none'}."
    if unknown:
        raise ReadError(f"{owner}: unknown key {', '.join(map(repr, unknown))}. {keys}")
    if missing:
        raise ReadError(f"{owner}: {', '.join(map(repr, missing))} is missing. {keys}")


def _written(value: Any) -> str:
    if isinstance(value, str):
        # JSON's escapes are TOML's, which also wants one for the delete character.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, tuple):
        return f"[{', '.join(map(_written, value))}]"
    return repr(value)


ENDING = ".edits.toml"
UNSAVED = "unsaved"


@dataclass(frozen=True)
class EditsFiles:
    """The files beside a file of edits: `box.edits.toml`, `box.NAME.edits.toml`, `box.edits.toml.unsaved`."""

    saved: Path

    @property
    def unsaved(self) -> Path:
        """The file of edits that are not saved yet."""
        return self.saved.with_name(f"{self.saved.name}.{UNSAVED}")

    @property
    def versions(self) -> tuple[str, ...]:
        """The names of all versions."""
        begin, end = f"{self._stem}.", self._ending
        found = (path.name for path in self.saved.parent.glob(f"*{end}"))
        names = (name[len(begin) : -len(end)] for name in found if name.startswith(begin) and name != self.saved.name)
        return tuple(sorted(name for name in names if _is_name(name)))

    def version(self, name: str) -> Path:
        """Return the file of a version; raises `ArgumentError` for anything but a name."""
        if not _is_name(name):
            raise ArgumentError(f"{name!r} is no name for a version: letters, digits, - and _, at most 40 of them.")
        return self.saved.with_name(f"{self._stem}.{name}{self._ending}")

    def keep(self, edits: ContactEdits) -> None:
        """Write unsaved edits; raises `WriteError`."""
        save(edits, self.unsaved)

    def forget(self) -> None:
        """Remove the unsaved edits."""
        with suppress(OSError):
            self.unsaved.unlink(missing_ok=True)

    def set_aside(self) -> str:
        """Make a version of the unsaved edits, and return its name; raises `WriteError`."""
        names = (UNSAVED if number == 1 else f"{UNSAVED}-{number}" for number in count(1))
        name = next(name for name in names if not os.path.lexists(self.version(name)))
        try:
            self.unsaved.rename(self.version(name))
        except OSError as error:
            raise WriteError(f"{self.unsaved}: cannot be renamed ({error.strerror}).") from error
        return name

    @property
    def _ending(self) -> str:
        return ENDING if self.saved.name.endswith(ENDING) else self.saved.suffix or ENDING

    @property
    def _stem(self) -> str:
        return self.saved.name.removesuffix(self._ending)


def _is_name(text: str) -> bool:
    return re.fullmatch(r"[A-Za-z0-9_-]{1,40}", text) is not None
