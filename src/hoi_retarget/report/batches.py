"""Batches' manifests: changes to the recordings of their results, and jobs without results."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hoi_retarget.batch.manifest import read_manifest
from hoi_retarget.report.rows import Row


def read_manifests(manifests: Sequence[Path]) -> tuple[dict[Path, Mapping[str, Any]], list[Row]]:
    """Return the lineages of batches' results by their resolved paths, and a row for each job without one.

    Raises:
        ReadError: A manifest cannot be read.
    """
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
            missing += [
                Row(entry.name, error=reason, robot=entry.robot, licence=entry.source.licence) for reason in reasons
            ]
    return lineages, missing
