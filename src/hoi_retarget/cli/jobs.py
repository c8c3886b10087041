"""What commands share: where they may write, what they ask for, and what they say about a result."""

import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

from hoi_retarget.cli.commands import Solving
from hoi_retarget.cli.terminal import say, warn
from hoi_retarget.errors import ArgumentError, ReadError, WriteError
from hoi_retarget.evaluation import FIGURES, Score
from hoi_retarget.evaluation.table import scales_text
from hoi_retarget.files.atomic import write_atomically
from hoi_retarget.motion.motion import Motion
from hoi_retarget.readers import own_layout
from hoi_retarget.readers.open import result_stem
from hoi_retarget.retargeting.config import Config, Scaling, parse_horizon


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


def config_of(command: Solving) -> Config:
    """Return the configuration that a command asks for; raises `ArgumentError`."""
    scaling = Scaling(command.root_scale, command.object_scale, command.size_multiplier, command.body_scale)
    return Config(scaling, command.weights, command.ik, command.solver, parse_horizon(command.horizon))


def describe_result(motion: Motion, path: Path) -> None:
    """Print where a result is and what is not right with it."""
    seconds = sum(motion.report.cpu_seconds.values())
    say(f"  {path}  ({motion.frames} frames, {seconds:.2f} s)")
    say(f"  root scale {motion.report.root_scale:.3f}, object scale {scales_text(motion.object_scale)}")
    for warning in motion.warnings:
        warn(f"{path.name}: {warning}")


def score(motion: Motion, path: Path) -> Score:
    """Return the figures that a motion's report holds, as tables need them; raises `ReadError` where it has none."""
    report = motion.report
    missing = [figure.name for figure in FIGURES if figure.name not in report.figures]
    if missing:
        raise ReadError(f"{path}: its report lacks figures ({', '.join(missing)}). Run the retarget again.")
    return Score(
        path.stem,
        report.figures,
        motion.frames,
        sum(report.cpu_seconds.values()),
        file=str(path),
        robot=motion.robot,
        root_scale=report.root_scale,
        object_scale=tuple(motion.object_scale.tolist()),
    )
