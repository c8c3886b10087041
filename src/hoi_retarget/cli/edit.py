"""`hoi-retarget edit`: the contacts of a clip in a browser."""

import os
import shlex
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from hoi_retarget.cli.commands import Edit, Reading, Run, Solving
from hoi_retarget.cli.jobs import check_spared, check_writable, config_of
from hoi_retarget.cli.run_arguments import settings_of, words_of
from hoi_retarget.cli.serving import check_viser, serve_until_interrupted
from hoi_retarget.cli.terminal import Working, program, say
from hoi_retarget.clip.edits import ContactEdits, load
from hoi_retarget.clip.edits.versions import EditsFiles
from hoi_retarget.readers.open import open_clip, result_stem
from hoi_retarget.retargeting.multi_person import result_paths, with_report, write
from hoi_retarget.robots import load_robot

if TYPE_CHECKING:
    from hoi_retarget.viewers.browser.editing import Edited


def execute(command: Edit) -> int:
    """Serve the editor until Ctrl-C."""
    check_viser()
    from hoi_retarget.viewers.browser.editing import solved  # noqa: PLC0415 - need an extra
    from hoi_retarget.viewers.browser.editor import Places, serve_editor  # noqa: PLC0415

    config, model = config_of(command), load_robot(command.robot)
    stem = result_stem(command.clip)
    path = command.edits or Path(f"{stem}.edits.toml")
    check_writable("--edits", path.parent)
    check_writable("--out", command.out)
    check_spared(command.clip, command.out)
    clip = open_clip(command.clip, command)
    edits = load(path) if os.path.lexists(path) else ContactEdits.of(clip)
    with Working("retargeting", None):
        start = solved(clip, model, config, edits)

    settings = settings_of(_as_run(command, path))

    def save_result(edited: "Edited") -> tuple[Path, ...]:
        paths = result_paths(clip, stem, command.out)
        write([with_report(motion, command=settings) for motion in edited.motions], paths)
        return paths

    count = len(edits.edits)
    say(f"Edits are saved to {path}{f', which has {count} already' if count else ''}; then:")
    say(f"  {program()} {shlex.join(words_of(settings, config.as_json()))}")
    files = EditsFiles(path)
    if os.path.lexists(files.unsaved):
        say(f"Edits that were not saved last time are in {files.unsaved}; the page offers them.")
    places = Places(files, save_result)
    serve_until_interrupted(
        f"contacts of {stem}",
        command.host,
        command.port,
        lambda server: serve_editor(server, clip, model, config, start, places),
    )
    return 0


def _as_run(command: Edit, edits: Path) -> Run:
    """Return the `run` that makes the same result."""
    shared = {field.name: getattr(command, field.name) for field in (*fields(Reading), *fields(Solving))}
    return Run(clips=(command.clip,), out=command.out, edits=edits, **shared)
