"""What a batch's manifest adds to its results: what was done to their recordings, and the jobs that have none."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hoi_retarget.batch.manifest import ManifestEntry, read_manifest
from hoi_retarget.report.rows import Row


@dataclass(frozen=True)
class ManifestSummary:
    """Lineages and failed jobs of several manifests."""

    lineages: Mapping[Path, Mapping[str, Any]]
    """Of results, by their resolved path."""
    missing: tuple[Row, ...]
    """Jobs without results, with the reason."""


def summarize_manifests(manifests: Sequence[Path]) -> ManifestSummary:
    """Return the lineages and failed jobs of batches; raises `ReadError` when one cannot be read."""
    lineages: dict[Path, Mapping[str, Any]] = {}
    missing: list[Row] = []
    for manifest in manifests:
        for entry in read_manifest(manifest.parent).values():
            paths = [(manifest.parent / result.path).resolve() for result in entry.results]
            lineages |= dict.fromkeys(paths, entry.lineage)
            if not entry.succeeded:
                missing.append(_row(entry, entry.name, f"{entry.status}: {entry.reason}"))
            missing += [
                _row(entry, entry.name, f"the batch wrote {path.name}, which is gone. Run the batch again.")
                for path in paths
                if entry.succeeded and not path.exists()
            ]
    return ManifestSummary(lineages, tuple(missing))


def _row(entry: ManifestEntry, name: str, error: str) -> Row:
    return Row(name, error=error, robot=entry.robot, licence=entry.source.licence)
