"""`hoi-retarget report`: many results on one page and in tables, with a verdict on each."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from hoi_retarget.cli.commands import Report
from hoi_retarget.cli.jobs import check_inputs_kept, check_writable, recording_of
from hoi_retarget.cli.terminal import Working, say, show_table, warn
from hoi_retarget.errors import DrawingError
from hoi_retarget.evaluation.thresholds import Level
from hoi_retarget.files.atomic import write_together
from hoi_retarget.report.batches import read_manifests
from hoi_retarget.report.discover import find
from hoi_retarget.report.index import to_csv, to_json, to_parquet
from hoi_retarget.report.page import report_page
from hoi_retarget.report.pictures import picture_of
from hoi_retarget.report.rows import Row, read_row, worst_first
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import RobotModel

PICTURES, _PASSING_PICTURES = 6, 3
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
        working.describe("drawing")
        try:
            pictures = _pictures(rows, model, command.objects)
        except DrawingError as error:
            pictures = {}
            warn(f"The page has no pictures. {error}")
    rows.sort(key=lambda row: row.file)
    _write(command.out, command.title, rows, pictures)
    _summarize(rows)
    say(f"Open {command.out / _PAGE} in a browser; the tables are beside it.")
    bad = any(row.level in (None, Level.FAIL) for row in rows)
    return 1 if command.strict and bad else 0


def _pictures(rows: Sequence[Row], model: RobotModel, objects: Path | None) -> dict[str, bytes]:
    drawn: dict[str, bytes] = {}
    for row in _to_draw(rows):
        picture = picture_of(row.path, model, objects=objects) if row.path is not None else None
        if picture is not None:
            drawn[row.file] = picture
    return drawn


def _to_draw(rows: Sequence[Row]) -> Sequence[Row]:
    """Return the worst of the motions that do not pass; where all do, those nearest to a threshold."""
    ordered = worst_first(rows)
    return [row for row in ordered if row.level is not Level.PASS][:PICTURES] or ordered[:_PASSING_PICTURES]


def _write(out: Path, title: str, rows: Sequence[Row], pictures: dict[str, bytes]) -> None:
    contents = {
        out / _PAGE: report_page(title, rows, pictures).encode("utf-8", "replace"),
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
    counts: dict[str, Counter[Level | None]] = {}
    for row in sorted(rows, key=lambda row: row.robot):
        counts.setdefault(row.robot or "-", Counter())[row.level] += 1
    heads = ("robot", "files", *map(str, Level), "unread")
    lines = [
        (name, str(sum(count.values())), *(str(count[level]) for level in (*Level, None)))
        for name, count in counts.items()
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
