"""Parts of several commands: checks of places to write, results with their clips, and work on many files."""

import json
import os
import tempfile
from collections.abc import Callable, Collection, Iterable
from functools import cache
from hashlib import sha256
from math import isfinite
from pathlib import Path

from hoi_retarget.cli.commands import BesideClip, MadeFrom, Solving
from hoi_retarget.cli.terminal import STDOUT, Working, fail, program, put, say, warn
from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import ArgumentError, HoiRetargetError, ReadError, WriteError
from hoi_retarget.evaluation import FIGURES, Score
from hoi_retarget.evaluation.performed import PERFORMED
from hoi_retarget.evaluation.table import scales_text
from hoi_retarget.files.atomic import write_atomically
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.motion.motion import SIMULATED, Motion
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.readers import own_layout
from hoi_retarget.readers.open import builtin_scene, clip_of, result_stem
from hoi_retarget.report.load_any_motion import open_motion
from hoi_retarget.report.recording import Recording, with_recording
from hoi_retarget.retargeting.config import Config, Scaling, parse_horizon
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.skin import skin_of

OBJECT_SURFACES = {
    "shell": "a shell, with no inside: what is within 1 mm of its surface counts as inside",
    "hull": "only points of it are known: touch and penetration are those of their convex hull",
}
"""What is to be known of surfaces that are not an object's own solid."""


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


def check_spared(clip: Path, out: Path) -> None:
    """Raise `ArgumentError` when a clip's result would be written over the clip."""
    result = out / f"{result_stem(clip)}.npz"
    try:
        same = result.samefile(own_layout.file_of(clip))
    except (OSError, ValueError):
        return
    if same:
        raise ArgumentError(f"--out {out}: the result would be written over the clip {clip}. Choose another folder.")


def check_inputs_kept(option: str, written: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Raise `ArgumentError` when a file would be written over one that was read."""
    kept = {path.resolve(): path for path in inputs}
    for path in written:
        if (lost := kept.get(path.resolve())) is not None:
            raise ArgumentError(f"{option}: {path} would be written over {lost}, which was read. Choose another place.")


def write_file(option: str, path: Path, content: bytes) -> None:
    """Write what an option asks for; raises `WriteError`, which names it."""
    try:
        write_atomically(path, content)
    except WriteError as error:
        reason = getattr(error.__cause__, "strerror", None) or error
        raise WriteError(
            f"{option} {path}: cannot be written ({reason}). Free some space or name another file."
        ) from error


def check_json(path: Path | None, inputs: Iterable[Path] = ()) -> None:
    """Raise `ArgumentError` where what `--json` names cannot be written."""
    if path is not None and path != STDOUT:
        check_writable("--json", path.parent)
        check_inputs_kept("--json", [path], inputs)


def write_json(path: Path | None, facts: object) -> None:
    """Write what `--json` asks for, where it is given: to a file, or `-` for stdout."""
    if path is None:
        return
    text = json.dumps(facts, indent=1, allow_nan=False) + "\n"
    if path == STDOUT:
        put(text)
        return
    write_file("--json", path, text.encode())
    say(f"written: {path}")


def config_of(command: Solving) -> Config:
    """Return the configuration that a command asks for; raises `ArgumentError`."""
    scaling = Scaling(command.root_scale, command.object_scale, command.size_multiplier, command.body_scale)
    return Config(
        scaling,
        command.weights,
        command.ik,
        command.solver,
        parse_horizon(command.horizon),
        command.contact,
        command.physics,
    )


def recording_of(command: BesideClip) -> Recording:
    """Return what a command says of other programs' motions; raises `ArgumentError` for what cannot be."""
    for name, scale in (("--object-scale", command.object_scale), ("--root-scale", command.root_scale)):
        if not (isfinite(scale) and scale > 0):
            raise ArgumentError(f"{name} is {scale:g}; it must be a positive number.")
    clip = command.clip
    if clip is not None and builtin_scene(clip) is None and not os.path.exists(SourceFile(clip).path):  # noqa: PTH110  # raises nothing
        raise ArgumentError(f"--clip {clip}: there is no such file or folder.")
    return Recording(clip, command.objects, command.root_scale, command.object_scale)


def load_motion(
    path: Path, robot: str, warn: Callable[[str], None] = warn, recording: Recording | None = None
) -> Motion:
    """Return the motion in a result or in another program's file; raises `ReadError`, which for a clip says so.

    Args:
        path: The file, or a folder that is one motion.
        robot: The robot of another program's file, which does not say.
        warn: Takes what was assumed, and what contradicts such a file.
        recording: The clip of such a file, whose figures are wanted.
    """
    if path.suffix.lower() in (".pt", ".pth") and os.path.isfile(path):  # noqa: PTH113  # raises nothing
        raise ReadError(f"{path}: this is a clip, not a result. Use `{program()} run` on it first.")
    model = load_robot(robot)
    opened = open_motion(path, model)
    if recording is not None:
        opened = with_recording(opened, path, model, recording)
    for note in (*opened.contradictions, *opened.notes):
        warn(f"{path.name}: {note}")
    return opened.motion


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file, or of all files of a folder in the order of their names."""
    files = sorted(file for file in path.iterdir() if file.is_file()) if path.is_dir() else [path]
    return sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def at_stage(motion: Motion, path: Path, stage: str | None) -> Motion:
    """Return a motion as it was after a stage; None is its last. Raises `ArgumentError` where it has no such stage."""
    if stage is None:
        return motion
    try:
        return motion.at_stage(stage)
    except ArgumentError as error:
        advice = f" `{program()} refine {path}` makes it." if stage == SIMULATED else ""
        raise ArgumentError(f"--stage {stage}: {error}{advice}") from error


def clip_or_warning(
    path: Path, motion: Motion, command: MadeFrom, without: str, *, surfaces: bool = False
) -> Clip | None:
    """Return the clip that a result was made from; None, with a warning, where it is not to be had.

    Args:
        path: The result's file.
        motion: The result.
        command: What the user says about the clip.
        without: What the warning says is done without the clip.
        surfaces: Whether the objects' surfaces must be readable, too.

    Raises:
        HoiRetargetError: The user names the clip, and it is not to be had.
    """
    try:
        clip = clip_of(motion, name=command.clip, objects=command.objects)
        if surfaces:
            for track in clip.objects:
                if track.name in motion.object_names:
                    surface_of(track.geometry)
    except HoiRetargetError as error:
        if command.clip is not None:
            raise
        warn(f"{path.name}: {without} {error}")
        return None
    return clip


def do_for_each(what: str, paths: Collection[Path], do: Callable[[Path], None]) -> list[HoiRetargetError]:
    """Do something for every file, with a bar; print and return the errors of those that fail."""
    failures: list[HoiRetargetError] = []
    with Working(what, len(paths)) as working:
        for path in working.through(paths):
            try:
                do(path)
            except HoiRetargetError as error:
                failures.append(error)
                fail(with_file(path, error))
    return failures


def with_file(path: Path | str, problem: object) -> str:
    """Return the text of an error or a warning, which names its file."""
    text = str(problem)
    return text if Path(path).name in text else f"{path}: {text}"


def exit_code(failures: Collection[HoiRetargetError], total: int) -> int:
    """Return 0 for no failure, 2 where all of a total fail by their arguments, else 1."""
    if not failures:
        return 0
    return 2 if len(failures) == total and all(isinstance(error, ArgumentError) for error in failures) else 1


def check_stems(paths: Iterable[Path], stem_of: Callable[[Path], str], target: str) -> None:
    """Raise `ArgumentError` where two files would be written to one; `target` says where, and what to do."""
    seen: dict[str, Path] = {}
    for path in paths:
        stem = stem_of(path)
        if (other := seen.setdefault(stem, path)) is not path:
            raise ArgumentError(f"{other} and {path} would both be written {target.format(stem)}")


def describe_result(motion: Motion, path: Path) -> None:
    """Print where a result is and what is not right with it."""
    seconds = sum(motion.report.cpu_seconds.values())
    say(f"  {path}  ({motion.frames} frames, {seconds:.2f} s)")
    say(f"  root scale {motion.report.root_scale:.3f}, object scale {scales_text(motion.object_scale)}")
    for name, surface in motion.report.object_surfaces.items():
        if surface in OBJECT_SURFACES:
            say(f"  {name}: {OBJECT_SURFACES[surface]}")
    for warning in motion.warnings:
        warn(f"{path.name}: {warning}")


def score(motion: Motion, path: Path) -> Score:
    """Return the figures that a motion's report holds, as tables need them; raises `ReadError` where it has none.

    Those that the version which made it did not know are None.
    """
    if not {figure.name for figure in FIGURES} & set(motion.report.figures):
        raise ReadError(f"{path}: its report has none of the figures. Run the retarget again.")
    return known_figures(motion, path)


def known_figures(motion: Motion, path: Path) -> Score:
    """Return the figures that a motion's report holds, be it none."""
    report = motion.report
    figures = {figure.name: report.figures.get(figure.name) for figure in FIGURES}
    figures |= {figure.name: value for figure in PERFORMED if (value := report.figures.get(figure.name)) is not None}
    return Score(
        path.stem,
        figures,
        motion.frames,
        sum(report.cpu_seconds.values()) if report.cpu_seconds else None,
        file=str(path),
        robot=motion.robot,
        root_scale=report.root_scale,
        object_scale=tuple(motion.object_scale.tolist()),
        object_surfaces=tuple(report.object_surfaces.get(name, "") for name in motion.object_names),
    )


@cache
def prepare_skin(model: RobotModel) -> None:
    """Compute the skin of a robot that has meshes and no skin yet, which takes long, and say so."""
    if model.spec.skin is None and any(model.geometries.meshes):
        say(f"{model.spec.name}: computing the skins of its meshes, which takes about two minutes, once")
        skin_of(model)
