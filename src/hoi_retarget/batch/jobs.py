"""The jobs of a specification: one clip, one robot, one variant each; and digests of all their inputs.

While the digest of a job stays the same, its result does too, and need not be made again.
"""

import errno
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from hashlib import sha256
from itertools import product
from pathlib import Path

from hoi_retarget import __version__
from hoi_retarget.batch.specification import Specification
from hoi_retarget.clip.augment import describe
from hoi_retarget.clip.clip import Augmentation
from hoi_retarget.clip.read_options import READ_OPTIONS, ReadOptions
from hoi_retarget.errors import ArgumentError, ClipError, ReadError
from hoi_retarget.files.python_wheel import sha256_of_file
from hoi_retarget.files.source_file import FOLDER, SourceFile
from hoi_retarget.readers import SUFFIXES, can_be_clip, clips_in, reader_of, recordings_below
from hoi_retarget.readers.builtin_clips import builtin_scene
from hoi_retarget.readers.object_files import geometry_files, known_objects
from hoi_retarget.readers.open import clip_stem, result_stem
from hoi_retarget.readers.own_layout import mesh_files
from hoi_retarget.retargeting.config import Config
from hoi_retarget.robots import robot, team

_WILDCARDS = frozenset("*?[")


@dataclass(frozen=True)
class Job:
    """One clip for one robot in one variant; a value that any process can be given."""

    name: str  # The path of its results below the output folder, without the suffix: `<robot>/<clip>[-<variant>...]`.
    clip: str  # `builtin:<scene>` or an absolute path.
    shown: str  # The clip as it was named: relative to the specification's folder, where it was.
    reading: ReadOptions
    edits: Path | None
    robot: str
    config: Config
    augmentation: Augmentation


def jobs_of(specification: Specification) -> tuple[Job, ...]:
    """Return all jobs, clip by clip; raises `ArgumentError` for names without clips, and clips with equal results."""
    jobs: dict[str, Job] = {}
    for named in specification.clips:
        try:
            clips = list(_matching(specification, named))
        except OSError as error:
            where = specification.folder / named
            raise ArgumentError(f"clips: {where}: cannot be looked for ({error}). Check the path.") from error
        for job in (job for clip in clips for job in _variants(clip, specification)):
            other = jobs.setdefault(job.name, job)
            if other is not job:
                raise ArgumentError(
                    f"{other.clip} and {job.clip} would both be written to {job.name}.npz. Name only one of them, or "
                    "a folder that both are below: results then have the folders' names, too."
                )
    return tuple(jobs.values())


@dataclass(frozen=True)
class _NamedClip:
    """A clip and the name of its results."""

    name: str
    clip: str
    shown: str


def _variants(clip: _NamedClip, specification: Specification) -> Iterator[Job]:
    edits = specification.edits and _edits_of(clip, specification.edits)
    options = ReadOptions(**{name: getattr(specification, name) for name in READ_OPTIONS})
    objects, models = options.objects, options.body_models
    reading = replace(options, objects=objects and objects.absolute(), body_models=models and models.absolute())
    grid = product(
        specification.robots,
        specification.object_scales,
        specification.size_multipliers,
        specification.mirrored,
        specification.speeds,
    )
    for names, object_scale, multiplier, mirrored, speed in grid:
        robot = ",".join(spec.name for spec in team(names))
        augmentation = Augmentation(mirrored, speed)
        words = (
            *(() if object_scale == "auto" else (f"object {object_scale:g}",)),
            *(() if multiplier == 1.0 else (f"size {multiplier:g}",)),
            *describe(augmentation),
        )
        yield Job(
            name="-".join((f"{robot}/{clip.name}", *(word.replace(" ", "") for word in words))),
            clip=clip.clip,
            shown=clip.shown,
            reading=reading,
            edits=edits,
            robot=robot,
            config=specification.config_of(object_scale, multiplier),
            augmentation=augmentation,
        )


def _edits_of(clip: _NamedClip, folder: Path) -> Path | None:
    path = folder.absolute() / f"{clip.name}.edits.toml"
    try:
        return path if path.exists() else None
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            return None
        raise ArgumentError(f"edits: {path}: cannot be read ({error.strerror}). Check its permissions.") from error


def _matching(specification: Specification, named: str) -> Iterator[_NamedClip]:
    """Yield the clips of one name or pattern in the specification."""
    scene = builtin_scene(named)
    path = specification.folder / named
    if scene is not None:
        yield _NamedClip(scene, named, named)
    elif _WILDCARDS & set(named):
        steps = Path(named).parts
        fixed = next(index for index, step in enumerate(steps) if _WILDCARDS & set(step))
        # The name of a clip is its path from the first wildcard on, which must not lead out of the output folder.
        if any(step == ".." or ("**" in step and step != "**") for step in steps[fixed:]):
            raise ArgumentError(
                f"clips: {named!r} is no pattern: '**' stands alone between slashes, and '..' only before the first "
                "wildcard. Name, for example, 'recordings/**/*.pt'."
            )
        yield from _below(specification, Path(*steps[:fixed]), str(Path(*steps[fixed:])), named)
    elif path.is_dir() and not can_be_clip(path, specification.from_robot):
        yield from _below(specification, Path(named), "**/*", named)
    else:
        for clip in _selected(path, specification.from_robot):
            yield _NamedClip(result_stem(clip), str(clip.absolute()), named.removesuffix(path.name) + clip.name)


def _below(specification: Specification, folder: Path, pattern: str, named: str) -> Iterator[_NamedClip]:
    """Yield the clips in a folder that fit a pattern, named by their path from there."""
    root = specification.folder / folder
    found = recordings_below(root, pattern, specification.from_robot)
    if not found:
        known = ", ".join(f"*{suffix}" for suffix in SUFFIXES if suffix != FOLDER)
        raise ArgumentError(
            f"{specification.folder / named}: there are no clips ({known}). Name a folder or a pattern that has some."
        )
    for path in (path for path in found if _is_asked_for(path, root, specification)):
        for clip in _selected(path, specification.from_robot):
            below = clip.relative_to(root)
            name = (below.parent / clip_stem(clip)).as_posix()
            yield _NamedClip(name, str(clip.absolute()), (folder / below).as_posix())


def _is_asked_for(path: Path, root: Path, specification: Specification) -> bool:
    """Return whether a recording is selected; also where it cannot be read: its job then reports why."""
    if not specification.about and specification.longest is None:
        return True
    file = SourceFile(path)
    try:
        facts = reader_of(file, specification.from_robot).headline(file)
    except (ReadError, ClipError):
        return True
    text = f"{path.relative_to(root)} {facts.words}".lower()
    short = specification.longest is None or facts.seconds <= specification.longest
    return short and (not specification.about or any(word.lower() in text for word in specification.about))


def _selected(path: Path, from_robot: str | None) -> tuple[Path, ...]:
    """Return the names of all clips in a file; the file itself where it cannot be read: its job then reports why."""
    try:
        return clips_in(path) if from_robot is None else (path,)
    except ReadError:
        return (path,)


class JobDigests:
    """Digests of the inputs of jobs, each file read once."""

    def __init__(self) -> None:
        self.of_file = cache(digest_of_file)
        self._of_recording = cache(self._digests_of_recording)
        self._of_robot = cache(_digest_of_robot)
        self._of_object = cache(lambda folder, name: list(map(self.of_file, geometry_files(folder, name))))
        self._known_objects = cache(known_objects)

    def key(self, job: Job, objects: Sequence[str] | None, files: Sequence[str]) -> str:
        """Return the digest of a job's inputs, settings and program.

        `objects` are those in its clip, None where it could not be read, and any object may matter; `files` are other
        files that it was read from.
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
        return sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()

    def _objects(self, folder: Path | None) -> Sequence[str]:
        try:
            return self._known_objects(folder) if folder else ()
        except OSError:
            return ()

    def _digests_of_recording(self, path: Path) -> list[str]:
        main = SourceFile(path).clip_file
        meshes = mesh_files(path) if main.suffix.lower() == ".npz" else ()
        return [self.of_file(file) for file in (main, *meshes)]


def digest_of_file(path: Path) -> str:
    """Return the SHA-256 of a file, or the kind of error where it cannot be read."""
    try:
        return sha256_of_file(path)
    except (OSError, ValueError) as error:  # A name may hold what no path can.
        return type(error).__name__


def _digest_of_robot(name: str) -> str:
    spec = robot(name)
    files = [path for path in (spec.mjcf, spec.skin) if path is not None]
    # The content of the package matters, not the folder that it is installed in.
    named = replace(spec, mjcf=Path(spec.mjcf.name), skin=spec.skin and Path(spec.skin.name))
    return sha256(b"".join(path.read_bytes() for path in files) + repr(named).encode()).hexdigest()
