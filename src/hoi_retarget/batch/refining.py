"""The second stage of a batch: a solved result made into a motion that a simulated robot performs."""

import hashlib
import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from hoi_retarget.batch.manifest import ManifestEntry, ManifestResult, Status
from hoi_retarget.batch.specification import Specification
from hoi_retarget.evaluation.thresholds import verdict_of
from hoi_retarget.motion.result_file import load
from hoi_retarget.physics.feasibility import physics_of_motion
from hoi_retarget.physics.settings import Refinement
from hoi_retarget.readers.open import clip_of
from hoi_retarget.retargeting.performing import Performed, perform, write_performed

FOLDER = "refined"
"""Folder for performed motions below that of the results."""


@dataclass(frozen=True)
class Refining:
    """A result that is to be refined; a value that any process can be given."""

    solved: ManifestEntry
    """What is known of the result's job."""
    result: ManifestResult
    out: Path
    """Folder of the batch."""
    refinement: Refinement
    seed: int

    @property
    def name(self) -> str:
        """Of the job: the path of what is performed below the output folder, without the suffix."""
        return f"{FOLDER}/{self.result.path.removesuffix('.npz')}"

    @property
    def key(self) -> str:
        """Digest of all that the performed motion depends on."""
        parts = {"solved": self.solved.key, "refinement": asdict(self.refinement), "seed": self.seed}
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def refinings_of(specification: Specification, solved: Iterable[ManifestEntry], out: Path) -> Iterator[Refining]:
    """Yield the second stage of solved jobs: one for each person's result; none unless it is asked for."""
    if specification.refine:
        for entry in solved:
            for result in entry.results:
                yield Refining(entry, result, out, specification.refinement, specification.seed)


def refined(task: Refining) -> ManifestEntry:
    """Refine a result and write what is performed; a robot that falls is a failure, kept beside with its reason.

    Raises `HoiRetargetError` where the result cannot be refined.
    """
    motion = load(task.out / task.result.path)
    clip = clip_of(motion) if motion.object_names or motion.report.source.path else None
    performed = perform(motion, clip, physics_of_motion(motion), task.refinement, seed=task.seed)
    place = task.out / f"{task.name}.npz"
    place.parent.mkdir(parents=True, exist_ok=True)
    kept, for_controllers = write_performed(performed, place)
    entry = replace(unrefined(task, "solved", ""), frames=performed.motion.frames)
    if performed.performance.fell:
        return _fallen(entry, performed)
    verdict = verdict_of(performed.motion, performed.scene.model)
    result = ManifestResult(
        path=kept.relative_to(task.out).as_posix(),
        sha256=_sha256(kept),
        figures=performed.motion.report.figures,
        verdict=verdict.as_json(),
        companions={for_controllers.relative_to(task.out).as_posix(): _sha256(for_controllers)},
    )
    certificate = performed.performance.robustness
    return replace(entry, verdict=str(verdict.level), results=(result,), certificate=certificate)


def unrefined(task: Refining, status: Status, reason: str) -> ManifestEntry:
    """Return the manifest entry of a result that was not performed."""
    return replace(task.solved, name=task.name, status=status, reason=reason, verdict="", results=(), seconds=0.0)


def _fallen(entry: ManifestEntry, performed: Performed) -> ManifestEntry:
    performance, frame = performed.performance, performed.motion.frames
    reason = f"the robot falls after {performance.seconds:.1f} s, in frame {frame}: {performance.cause}"
    return replace(
        entry, status="failed", reason=reason, error="Fall", frame=frame, fell_after=performed.rollout.fell_after
    )


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
