"""`hoi-retarget report`: many results on one page and in tables, with a verdict on each."""

from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from hoi_retarget.cli.commands import Report
from hoi_retarget.cli.entries import entry_of
from hoi_retarget.cli.jobs import check_inputs_kept, check_writable, known_figures, recording_of
from hoi_retarget.cli.terminal import Working, say, show_table, warn
from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.evaluation.thresholds import Level
from hoi_retarget.files.atomic import write_together
from hoi_retarget.motion.motion import Motion
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.readers.open import clip_of
from hoi_retarget.report.batches import read_manifests
from hoi_retarget.report.discover import find
from hoi_retarget.report.index import to_csv, to_json, to_parquet
from hoi_retarget.report.load_any_motion import open_motion
from hoi_retarget.report.page import report_page
from hoi_retarget.report.pages import MotionPage, MotionPages
from hoi_retarget.report.pictures import worst_frame
from hoi_retarget.report.rows import STATES, Row, read_row, worst_first
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.viewers.scene.scene import Shown
from hoi_retarget.viewers.scene.shared_objects import group_people
from hoi_retarget.viewers.scene.titles import names_together, title_together
from hoi_retarget.viewers.share.clip_page import ClipPage, Way, make_clip_page

_SHOWN = 10  # Files that are named in the terminal.
_PAGE, _TABLE, _PARQUET = "report.html", "index.csv", "index.parquet"


def execute(command: Report) -> int:
    """Write the report; return 1 when `--strict` is given and a file fails or cannot be read."""
    check_writable("--out", command.out)
    recording = recording_of(command)
    motions, manifests = find(command.paths)
    # Of what is written, only the table can be a motion.
    check_inputs_kept("--out", [command.out / _TABLE], motions.values())
    lineages, rows = read_manifests(manifests)
    model = load_robot(command.robot)
    with Working("judging", len(motions)) as working:
        for name, path in motions.items():
            rows.append(read_row(name, path, model, lineages.get(path.resolve()), recording))
            working.advance()
    pages = _write_pages(rows, model, command)
    rows.sort(key=lambda row: row.file)
    _write(command.out, command.title, rows, pages)
    _summarize(rows)
    judged = sum(row.verdict is not None for row in rows)
    if 0 < command.pages < judged:
        say(f"The {command.pages} worst motions have pages that play them; --pages {judged} makes those of all.")
    say(f"Open {command.out / _PAGE} in a browser; the tables are beside it.")
    bad = any(row.level in (None, Level.FAIL) for row in rows)
    return 1 if command.strict and bad else 0


def _write_pages(rows: Sequence[Row], foreign_robot: RobotModel, command: Report) -> dict[str, MotionPage]:
    """Write the pages of the worst motions; return them by the rows' files."""
    pages = MotionPages(command.out, command.title)
    chosen = [row for row in worst_first(rows) if row.path is not None][: command.pages]
    together = _together(rows)
    back = Way(command.title, f"../{_PAGE}")
    with Working("pages", len(chosen)) as working:
        for row in chosen:
            if row.file not in pages.pages:
                paths = {member.file: member.path for member in together[row.file] if member.path is not None}
                pages.add(paths, partial(page_of, row, together[row.file], foreign_robot, command.objects, back))
            working.advance()
    pages.finish()
    if pages.without_pictures:
        warn(f"The page has no pictures. {pages.without_pictures}")
    return pages.pages


def _together(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Return the rows that share a page with each, itself included: robots that move the same objects."""
    found = sorted((row for row in rows if row.verdict is not None), key=lambda row: row.file)
    hosts = group_people([row.shared for row in found], [row.person for row in found])
    groups: dict[int, list[Row]] = {}
    for row, host in zip(found, hosts, strict=True):
        groups.setdefault(host, []).append(row)
    return {row.file: group for group in groups.values() for row in group}


def page_of(
    worst: Row, rows: Sequence[Row], foreign_robot: RobotModel, objects: Path | None, back: Way
) -> tuple[ClipPage, int, list[float]] | None:
    """Return the page of motions that are shown together; None where they cannot be.

    With it come the worst frame of the worst of them, and each one's worst moment [s].
    """
    try:
        opened = [_opened(row.path, foreign_robot, objects) for row in rows if row.path is not None]
        names = names_together([(model.spec, motion.person) for motion, model, _ in opened])
        results = [
            (
                entry_of(motion, model, known_figures(motion, Path(row.file))),
                Shown(name, motion, model, clip, motion.person),
            )
            for row, name, (motion, model, clip) in zip(rows, names, opened, strict=True)
        ]
        reasons = [(name, reason) for row, name in zip(rows, names, strict=True) for reason in row.reasons]
        notices = [f"{name}: {reason}" if len(rows) > 1 else reason for name, reason in reasons]
        page = make_clip_page(title_together([row.name for row in rows]), results, back=back, notices=notices)
    except HoiRetargetError:
        return None
    frames = [worst_frame(motion) for motion, _, _ in opened]
    seconds = [frame / motion.fps for frame, (motion, _, _) in zip(frames, opened, strict=True)]
    return page, frames[list(rows).index(worst)], seconds


def _opened(path: Path, foreign_robot: RobotModel, objects: Path | None) -> tuple[Motion, RobotModel, Clip | None]:
    """Return a motion with its robot, and its clip where that is to be had; raises `HoiRetargetError`."""
    motion = open_motion(path, foreign_robot).motion
    try:
        clip = clip_of(motion, objects=objects)
        for track in clip.objects:
            surface_of(track.geometry)
    except HoiRetargetError:
        clip = None
    return motion, load_robot(motion.robot), clip


def _write(out: Path, title: str, rows: Sequence[Row], pages: dict[str, MotionPage]) -> None:
    contents = {
        out / _PAGE: report_page(title, rows, pages).encode("utf-8", "replace"),
        out / _TABLE: to_csv(rows),
        out / "verdicts.json": to_json(rows),
    }
    parquet = to_parquet(rows)
    if parquet is not None:
        contents[out / _PARQUET] = parquet
    write_together(contents)
    if parquet is None:
        (out / _PARQUET).unlink(missing_ok=True)  # An earlier one would contradict the rest.
        warn(f"{_PARQUET} is not written: it needs pyarrow. Install it with: pip install 'hoi-retarget[dataset]'.")


def _summarize(rows: Sequence[Row]) -> None:
    counts: dict[str, Counter[str]] = {}
    for row in sorted(rows, key=lambda row: row.robot):
        counts.setdefault(row.robot or "-", Counter())[row.state] += 1
    heads = ("robot", "files", *STATES)
    lines = [
        (name, str(sum(count.values())), *(str(count[state]) for state in STATES)) for name, count in counts.items()
    ]
    show_table([heads, *lines])
    say()
    for told in (Level.FAIL, None):
        named = [row for row in rows if row.level is told]
        for row in named[:_SHOWN]:
            why = row.error if row.verdict is None else "; ".join(row.reasons)
            where = "" if row.file in why else f"{row.file}: "  # Errors name their file.
            say(f"{'unread' if told is None else told}: {where}{why}")
        if len(named) > _SHOWN:
            say(f"... and {len(named) - _SHOWN} more.")
