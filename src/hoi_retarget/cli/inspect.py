"""`hoi-retarget inspect`: what a file is, what it lacks, and what to run on it."""

import shlex
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict, replace

from hoi_retarget.cli.commands import Inspect
from hoi_retarget.cli.jobs import check_json, with_file, write_json
from hoi_retarget.cli.terminal import NAME, fail, program, say, show_table, warn
from hoi_retarget.evaluation.table import scales_text
from hoi_retarget.motion.motion import STAGE_TITLES, Motion
from hoi_retarget.readers.describe import MOTION, Inspection, inspect


def execute(command: Inspect) -> int:
    """Describe a file; return 0 unless something is wrong with it."""
    check_json(command.json, [command.file])
    facts = inspect(command.file, command)
    say(f"{facts.path}: {facts.description}  [{facts.format}]")
    _facts(facts)
    if facts.objects:
        say()
        show_table([("object", "moved [m]", "lowest point [m]", "geometry"), *_objects(facts)], words=(0, 3))
    if any(contact.frames for contact in facts.contacts):
        say()
        show_table([("contact of", "frames", "segments", "with"), *_contacts(facts)], words=(0, 3))
    say()
    _list("note", facts.notes)
    _list("missing", facts.missing)
    evaluate = shlex.join([NAME, "evaluate", facts.path])
    next_command = evaluate if facts.format == MOTION else facts.command
    if next_command:
        say(f"to run: {program()}{next_command.removeprefix(NAME)}")
    write_json(command.json, {**asdict(replace(facts, result=None)), "is_result": facts.result is not None})
    for doubt in (*facts.warnings, *(() if facts.result is None else map(str, facts.result.warnings))):
        warn(with_file(facts.path, doubt))
    for problem in facts.problems:
        fail(with_file(facts.path, problem))
    return 1 if facts.problems else 0


def _facts(facts: Inspection) -> None:
    rate = "" if facts.fps is None else f" at {facts.fps:g} frames/s" + ("" if facts.fps_stated else " by its format")
    lowest = None if facts.lowest_joint is None else f"{facts.lowest_joint:.3f} m"
    rows = (
        ("frames", f"{facts.frames}{rate}" if facts.frames else None),
        ("skeleton", facts.skeleton or None),
        ("up axis", facts.up_axis or None),
        ("lowest joint", lowest),
        ("human height", None if facts.height is None else f"{facts.height:.2f} m, from the skeleton"),
        ("contacts", facts.contacts_from or None),
    )
    for title, text in (*rows, *(() if facts.result is None else _result(facts.result))):
        if text is not None:
            say(f"  {title:14}{text}")


def _result(motion: Motion) -> Iterator[tuple[str, str]]:
    """Yield what tells a result from others, as titles and texts."""
    report = motion.report
    yield "robot", motion.robot
    yield "object scale", scales_text(motion.object_scale)
    if report.root_scale is not None:
        yield "root scale", f"{report.root_scale:.3f}"
    yield "clip", report.clip
    for stage in motion.stages:
        counts = Counter(window.status for window in stage.windows)
        counted = ", ".join(f"{count} {status.name.lower().replace('_', ' ')}" for status, count in counts.items())
        yield "windows", f"{counted or 'none'} ({STAGE_TITLES.get(stage.name, stage.name)})"
    if report.performance is not None:
        yield "certificate", report.performance.robustness
    for title, segments in (("unreached", report.unreached_contacts), ("flipped", report.orientation_flips)):
        if segments is not None:
            yield title, f"{len(segments)} stretch(es)" if segments else "none"
    source = report.source
    for title, text in (("source", source.path), ("source format", source.format), ("licence", source.licence)):
        if text:
            yield title, text


def _objects(facts: Inspection) -> list[tuple[str, ...]]:
    return [
        (
            item.name or "?",
            "-" if item.moved is None else f"{item.moved:.2f}",
            "-" if item.lowest is None else f"{item.lowest:.3f}",
            item.geometry,
        )
        for item in facts.objects
    ]


def _contacts(facts: Inspection) -> list[tuple[str, ...]]:
    touching = [contact for contact in facts.contacts if contact.frames]
    return [(item.part, str(item.frames), str(item.segments), item.object or "?") for item in touching]


def _list(title: str, sentences: Iterable[str]) -> None:
    for sentence in sentences:
        say(f"{title}: {sentence}")
