"""`hoi-retarget inspect`: what a file is, what it lacks, and what to run on it."""

import shlex
from collections import Counter
from collections.abc import Iterable, Iterator

from hoi_retarget.cli.commands import Inspect
from hoi_retarget.cli.jobs import FOREIGN_REPORT
from hoi_retarget.cli.terminal import NAME, fail, program, say, show_table, warn
from hoi_retarget.evaluate.table import scales_text
from hoi_retarget.motion.motion import Motion
from hoi_retarget.readers.describe import MOTION, Inspection, inspect
from hoi_retarget.retarget.multi_person import STAGES, complaints


def execute(command: Inspect) -> int:
    """Describe a file; return 0 unless something is wrong with it."""
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
    for doubt in (*facts.warnings, *(() if facts.result is None else _complaints(facts.result))):
        warn(_naming(facts.path, doubt))
    for problem in facts.problems:
        fail(_naming(facts.path, problem))
    return 1 if facts.problems else 0


def _naming(path: str, problem: str) -> str:
    return problem if path in problem else f"{path}: {problem}"


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
    """Yield what tells a result from others; a report of another version may lack any of it."""
    report = motion.report
    yield "robot", motion.robot
    yield "object scale", scales_text(motion.object_scale)
    for title, key in (("root scale", "root_scale"), ("clip", "clip")):
        if key in report:
            yield title, str(round(report[key], 3) if isinstance(report[key], float) else report[key])
    for stage, key in STAGES.items():
        windows = report.get(key)
        if isinstance(windows, list):
            counts = Counter(str(window.get("status")) if isinstance(window, dict) else "?" for window in windows)
            counted = ", ".join(f"{count} {status.lower().replace('_', ' ')}" for status, count in counts.items())
            yield "windows", f"{counted} ({stage})"
    for title, key in (("unreached", "unreached_contacts"), ("turned over", "turned_over")):
        if isinstance(report.get(key), list):
            yield title, f"{len(report[key])} stretch(es)" if report[key] else "none"
    source = report.get("source")
    if isinstance(source, dict):
        for title, key in (("source", "path"), ("source format", "format"), ("licence", "licence")):
            if source.get(key):
                yield title, str(source[key])


def _complaints(motion: Motion) -> tuple[str, ...]:
    try:
        return complaints(motion)
    except FOREIGN_REPORT:
        return ("its report is not of this version; run the retarget again for figures and statuses.",)


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
