"""Discovery of a report's files, named or in folders, and of batches' manifests with their missing results."""

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hoi_retarget.batch.manifest import read_manifest
from hoi_retarget.errors import ArgumentError
from hoi_retarget.motion.formats import csv, sonic
from hoi_retarget.motion.formats.containers import HEADER, header_of
from hoi_retarget.motion.formats.csv import named_columns
from hoi_retarget.motion.result_file import set_aside
from hoi_retarget.simulation.physics_stage import FOR_CONTROLLERS
from hoi_retarget.studio.report.rows import Row


def read_manifests(manifests: Sequence[Path]) -> tuple[dict[Path, Mapping[str, Any]], list[Row]]:
    """Return lineages of batches' results by resolved path, and a row for each job without one; raises `ReadError`."""
    lineages: dict[Path, Mapping[str, Any]] = {}
    missing: list[Row] = []
    for manifest in manifests:
        for entry in read_manifest(manifest.parent).values():
            paths = [(manifest.parent / result.path).resolve() for result in entry.results]
            lineages |= dict.fromkeys(paths, entry.lineage)
            reasons = [] if entry.succeeded else [f"{entry.status}: {entry.reason}"]
            reasons += [
                f"the batch wrote {path.name}, which is gone. Run the batch again."
                for path in paths
                if entry.succeeded and not path.exists()
            ]
            licence = entry.source.licence
            missing += [Row(entry.name, error=reason, robot=entry.robot, licence=licence) for reason in reasons]
    return lineages, missing


MANIFEST = "manifest.jsonl"  # A batch's manifest, in the folder of its results.
_SUFFIXES = (".npz", ".pkl", ".csv", ".motion")
_CONTACTS = ".contacts.npz"  # Ending of the contacts beside an exported motion whose format has no room for them.
_OWN = ("index.csv", "verdicts.json")  # Beside each other they tell a folder that a report was written into.


def find(named: Sequence[Path]) -> tuple[dict[str, Path], tuple[Path, ...]]:
    """Return the motions and the batches' manifests of a report, each one once.

    A motion has its path from the folder that holds all of them, with forward slashes, as its name.

    In folders, hidden files, what an earlier report wrote and contacts beside exports are left out, and tables (.csv)
    that are no motion: words without columns of a root. A folder of tables that are one motion is named as a whole.
    Raises `ArgumentError` for a path that does not exist, or when there is no such file in any of the folders.
    """
    paths: dict[Path, Path] = {}
    manifests: dict[Path, Path] = {}
    for path in named:
        if os.path.isdir(path) and not _is_motion(path):  # noqa: PTH112  # raises nothing
            for file in _walk(path):
                (manifests if file.name == MANIFEST else paths).setdefault(file.resolve(), file)
        elif os.path.exists(path):  # noqa: PTH110  # raises nothing
            (manifests if path.name == MANIFEST else paths).setdefault(path.resolve(), path)
        else:
            raise ArgumentError(f"{path}: there is no such file or folder. Name results, or folders with results.")
    if not paths and not manifests:
        raise ArgumentError(
            f"{', '.join(map(str, named))}: there are no results in it ({', '.join(_SUFFIXES)}). Name another folder."
        )
    root = Path(os.path.commonpath([file.parent for file in paths])) if paths else Path()
    motions = {resolved.relative_to(root).as_posix(): path for resolved, path in paths.items()}
    return dict(sorted(motions.items())), tuple(sorted(manifests.values()))


def files_of(path: Path) -> tuple[Path, ...]:
    """Return a named file, or all motions of a named folder; raises `ArgumentError` where there is none in it."""
    inside = os.path.isdir(path) and not _is_motion(path)  # noqa: PTH112  # raises nothing
    return tuple(find([path])[0].values()) if inside else (path,)


def _walk(folder: Path) -> Iterator[Path]:
    for parent, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        tables = [name for name in folders if _is_motion(Path(parent) / name)]
        yield from (Path(parent) / name for name in tables)
        folders[:] = [name for name in folders if name not in tables]
        report = all(name in files for name in _OWN)
        for name in sorted(files):
            path = Path(parent) / name
            if name == MANIFEST:
                yield path
            elif (
                name.startswith(".")
                or name.endswith(_CONTACTS)
                or (report and name in _OWN)
                or _is_for_controllers(path)
            ):
                continue
            elif path.suffix.lower() in _SUFFIXES and (path.suffix.lower() != ".csv" or _holds_motion(path)):
                yield path


def _is_for_controllers(path: Path) -> bool:
    """Return whether a file lies beside a refined result of the same motion."""
    result = path.parent.parent / path.name
    return path.parent.name == FOR_CONTROLLERS and (result.is_file() or set_aside(result).is_file())


def _is_motion(folder: Path) -> bool:
    return (folder / sonic.FORMAT.container.inside).is_file()


def _holds_motion(table: Path) -> bool:
    try:
        with table.open("rb") as file:
            header = file.readline(10_000).decode("utf-8-sig")
    except (OSError, ValueError):
        return False
    if not header_of(header.split(",")[0]):
        return True  # A number.
    names = header_of(header)
    return csv.SEED_CSV.holds({HEADER: names}) or named_columns(names).has_root
