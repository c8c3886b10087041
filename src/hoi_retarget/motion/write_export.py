"""A motion written in another program's format, from Python in one call."""

from hashlib import sha256
from pathlib import Path, PureWindowsPath

from hoi_retarget.clip.clip import Clip
from hoi_retarget.files.atomic import write_together
from hoi_retarget.motion.export import export, format_named
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.result import Result
from hoi_retarget.motion.result_file import encode
from hoi_retarget.robots import load_robot


def write_export(  # noqa: PLR0913 - the last four are options
    motion: Motion,
    to: str,
    folder: Path | str,
    *,
    name: str | None = None,
    clip: Clip | None = None,
    fps: float | None = None,
    stage: str | None = None,
) -> tuple[Path, ...]:
    """Write a motion's files in a format into a folder, all of them or none, and return their paths.

    Args:
        motion: The motion.
        to: Name of the format, such as `mjlab`; docs/exports.md has a table of them.
        folder: Made when it does not exist.
        name: Name of the files without suffix; by default `<clip>.<format>`.
        clip: The clip the motion was made from: it knows the objects' surfaces.
        fps: Frames a second; by default those that the format's readers expect.
        stage: `ik`, `trajectory` or `physics`: what the motion was after it; by default the last.

    Raises:
        ArgumentError: There is no such format or stage, it does not know the robot, or the rate is out of range.
        GeometryError: An object's mesh cannot be read.
        WriteError: A file cannot be written.
    """
    # A clip's name is what a file says: it leads nowhere.
    stem = PureWindowsPath(motion.report.clip).name or motion.robot
    chosen = motion if stage is None else motion.at_stage(stage)
    result = Result(stem, sha256(encode(motion)).hexdigest(), chosen, load_robot(motion.robot), clip)
    exported = export(result, format_named(to), name=name or f"{stem}.{to}", fps=fps)
    files = {Path(folder) / file: content for file, content in exported.files.items()}
    write_together(files)
    return tuple(files)
