"""The digest of all inputs of a job: while it stays the same, its result does too, and need not be made again."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path

from hoi_retarget import __version__
from hoi_retarget.batch.jobs import Job
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.readers.object_files import geometry_files, known_objects
from hoi_retarget.readers.open import builtin_scene
from hoi_retarget.readers.own_layout import file_of, mesh_files
from hoi_retarget.robots import robot, team


class Contents:
    """Digests of the inputs of jobs, each file read once."""

    def __init__(self) -> None:
        self.of_file = cache(digest_of_file)
        self._of_recording = cache(self._digests_of_recording)
        self._of_robot = cache(_digest_of_robot)
        self._of_object = cache(self._digest_of_object)
        self._known_objects = cache(known_objects)

    def key(self, job: Job, objects: Sequence[str] | None, files: Sequence[str]) -> str:
        """Return the digest of a job's inputs, settings and program.

        Args:
            job: The job.
            objects: Names of the objects in its clip; None where the clip could not be read, and any object may matter.
            files: Other files that its clip was read from.
        """
        folder = job.reading.objects
        names = self._objects(folder) if objects is None else objects
        parts = {
            "version": __version__,
            "clip": job.clip
            if builtin_scene(job.clip) is not None
            else self._of_recording(SourceFile(Path(job.clip)).path),
            "files": {name: self.of_file(Path(name)) for name in files},
            "objects": {name: self._of_object(folder, name) for name in names} if folder else {},
            "reading": replace(job.reading, objects=None).as_json(),
            "edits": self.of_file(job.edits) if job.edits else "",
            "robot": [self._of_robot(spec.name) for spec in team(job.robot)],
            "config": job.config.as_json(),
            "augmentation": asdict(job.augmentation),
        }
        return _sha256(json.dumps(parts, sort_keys=True).encode())

    def _objects(self, folder: Path | None) -> Sequence[str]:
        try:
            return self._known_objects(folder) if folder else ()
        except OSError:
            return ()

    def _digests_of_recording(self, path: Path) -> list[str]:
        main = file_of(path)
        meshes = mesh_files(path) if main.suffix.lower() == ".npz" else ()
        return [self.of_file(file) for file in (main, *meshes)]

    def _digest_of_object(self, folder: Path, name: str) -> list[str]:
        return [self.of_file(path) for path in geometry_files(folder, name)]


def digest_of_file(path: Path) -> str:
    """Return the SHA-256 of a file, or the kind of error where it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except (OSError, ValueError) as error:  # A name may hold what no path can.
        return type(error).__name__


def _digest_of_robot(name: str) -> str:
    spec = robot(name)
    files = [path for path in (spec.mjcf, spec.skin) if path is not None]
    # The content of the package matters, not the folder that it is installed in.
    named = replace(spec, mjcf=Path(spec.mjcf.name), skin=spec.skin and Path(spec.skin.name))
    return _sha256(b"".join(path.read_bytes() for path in files) + repr(named).encode())


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
