"""Checks of places to write before any work is done, and files that are written whole or not at all."""

import json
import os
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

from hoi_retarget.cli.terminal import STDOUT, put, say
from hoi_retarget.errors import ArgumentError, WriteError
from hoi_retarget.files.atomic import write_atomically


def check_writable(option: str, folder: Path) -> None:
    """Raise `ArgumentError` unless files can be made in a folder, which need not exist yet; leave nothing behind."""
    existing = folder.absolute()
    while not os.path.lexists(existing):
        existing = existing.parent
    try:
        tempfile.TemporaryFile(dir=existing).close()
    except OSError as error:
        raise ArgumentError(
            f"{option} {folder}: cannot write there ({existing}: {error.strerror or error}). Choose another folder."
        ) from error


def check_inputs_kept(option: str, written: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Raise `ArgumentError` when a file would be written over one that was read."""
    kept = {path.resolve(): path for path in inputs}
    for path in written:
        if (lost := kept.get(path.resolve())) is not None:
            raise ArgumentError(f"{option}: {path} would be written over {lost}, which was read. Choose another place.")


def check_stems(paths: Iterable[Path], stem_of: Callable[[Path], str], target: str) -> None:
    """Raise `ArgumentError` where two files would be written to one `target`, a text with `{}` for the stem."""
    seen: dict[str, Path] = {}
    for path in paths:
        stem = stem_of(path)
        if (other := seen.setdefault(stem, path)) is not path:
            raise ArgumentError(f"{other} and {path} would both be written {target.format(stem)}")


def check_json(path: Path | None, inputs: Iterable[Path] = ()) -> None:
    """Raise `ArgumentError` where the file of `--json` cannot be written, or is one of the inputs."""
    if path is not None and path != STDOUT:
        check_writable("--json", path.parent)
        check_inputs_kept("--json", [path], inputs)


def write_json(path: Path | None, facts: object) -> None:
    """Write facts to the file of `--json`, where one is given, or to stdout for `-`; raises `WriteError`."""
    if path is None:
        return
    text = json.dumps(facts, indent=1, allow_nan=False) + "\n"
    if path == STDOUT:
        put(text)
        return
    write_file("--json", path, text.encode())
    say(f"written: {path}")


def write_file(option: str, path: Path, content: bytes) -> None:
    """Write the file of an option; raises `WriteError`, which names it."""
    try:
        write_atomically(path, content)
    except WriteError as error:
        reason = getattr(error.__cause__, "strerror", None) or error
        raise WriteError(
            f"{option} {path}: cannot be written ({reason}). Free some space or name another file."
        ) from error
