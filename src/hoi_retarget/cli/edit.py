"""`hoi-retarget edit`: the contacts of a clip in a browser."""

import os
import shlex
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING

from hoi_retarget.cli.commands import Edit
from hoi_retarget.cli.jobs import check_spared, check_writable, config_of
from hoi_retarget.cli.serving import check_viser, serve_until_interrupted
from hoi_retarget.cli.terminal import Working, program, say
from hoi_retarget.contact_edits import ContactEdits, load
from hoi_retarget.recordings import open_clip, result_stem
from hoi_retarget.results import result_paths, with_report, write
from hoi_retarget.robots import robot
from hoi_retarget.robots.model import load_model

if TYPE_CHECKING:
    from hoi_retarget.viewers.editing import Edited

_OPTIONS = {"object_name": "--object"}
"""Options that are not called what their fields are."""


def execute(command: Edit) -> int:
    """Serve the editor until Ctrl-C."""
    check_viser()
    from hoi_retarget.viewers.edit_page import serve_editor  # noqa: PLC0415 - need an extra
    from hoi_retarget.viewers.editing import solved  # noqa: PLC0415
    from hoi_retarget.viewers.editor import Places  # noqa: PLC0415

    config, model = config_of(command), load_model(robot(command.robot))
    stem = result_stem(command.clip)
    path = command.edits or Path(f"{stem}.edits.toml")
    check_writable("--edits", path.parent)
    check_writable("--out", command.out)
    check_spared(command.clip, command.out)
    clip = open_clip(command.clip, objects=command.objects, object_name=command.object_name)
    edits = load(path) if os.path.lexists(path) else ContactEdits.of(clip)
    with Working("retargeting", None):
        start = solved(clip, model, config, edits)

    def save_result(edited: "Edited") -> tuple[Path, ...]:
        paths = result_paths(clip, stem, command.out)
        settings = {name: str(value) if isinstance(value, Path) else value for name, value in asdict(command).items()}
        write(with_report(edited.motions, {"command": settings}), paths)
        return paths

    count = len(edits.edits)
    say(f"Edits are saved to {path}{f', which has {count} already' if count else ''}; then:")
    say(f"  {program()} {shlex.join(_run_words(command, path))}")
    places = Places(path, save_result)
    serve_until_interrupted(
        f"contacts of {stem}",
        command.host,
        command.port,
        lambda server: serve_editor(server, clip, model, config, start, places),
    )
    return 0


def _run_words(command: Edit, edits: Path) -> list[str]:
    """Return the words of the `run` that makes the same result."""
    words = ["run", str(command.clip), "--edits", str(edits), "--out", str(command.out)]
    for option in fields(command):
        name, value = option.name, getattr(command, option.name)
        if name not in ("clip", "edits", "out", "host", "port") and value != option.default:
            words += [_OPTIONS.get(name, f"--{name.replace('_', '-')}"), str(value)]
    return words
