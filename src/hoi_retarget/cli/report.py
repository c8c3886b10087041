"""Results judged: `evaluate` shows their figures, `report` makes a page and tables with a verdict on each."""

import json
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from hoi_retarget.cli.commands import Evaluate, WriteReport
from hoi_retarget.cli.open_results import gallery_entry_of, load_motion, reference_clip_of
from hoi_retarget.cli.output_checks import check_inputs_kept, check_json, check_writable, write_file, write_json
from hoi_retarget.cli.scores import score, show_figures, titled
from hoi_retarget.cli.terminal import Working, do_for_each, exit_code, say, show_table, warn
from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import HoiRetargetError, install_hint
from hoi_retarget.evaluation import Score
from hoi_retarget.evaluation import to_csv as scores_to_csv
from hoi_retarget.evaluation import to_json as scores_to_json
from hoi_retarget.evaluation.thresholds import Level, by_kind, known_figures
from hoi_retarget.files.atomic import write_together
from hoi_retarget.motion.motion import Motion
from hoi_retarget.readers.open import clip_of
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.studio.report import rows as report_rows
from hoi_retarget.studio.report.discover import find, read_manifests
from hoi_retarget.studio.report.motion_pages import MotionPage, MotionPages
from hoi_retarget.studio.report.open_motion import open_motion
from hoi_retarget.studio.report.page import report_page
from hoi_retarget.studio.scene.scene import SceneItem, group_people
from hoi_retarget.studio.scene.subplots import names_together, title_together
from hoi_retarget.studio.share.clip_page import BackLink, ClipPage, make_clip_page
from hoi_retarget.studio.share.load_results import drawable_clip

_MAX_NAMED = 10  # Files that are named in the terminal.
_PAGE, _TABLE, _PARQUET = "report.html", "index.csv", "index.parquet"


def execute_evaluate(command: Evaluate) -> int:
    """Show the figures of every result; return 0 when all could be read."""
    check_json(command.json)
    if command.csv is not None:
        check_writable("--csv", command.csv.parent)
    reference = reference_clip_of(command)
    scores: list[Score] = []
    motions: list[Motion] = []
    foreign: list[Path] = []

    def evaluate_one(path: Path) -> None:
        motion = load_motion(path, command.robot, reference=reference)
        scores.append(score(motion, path))
        motions.append(motion)
        if motion.report.is_foreign:
            foreign.append(path)
        for warning in motion.warnings:
            warn(f"{path}: {warning}")

    failures = do_for_each("reading", command.results, evaluate_one)
    if scores:
        from_what = "that need no recording" if command.clip is None else "as they are beside the clip"
        others = f", and those of other programs' motions {from_what}" if foreign else ""
        say(f"Figures as the run computed and stored them{others}:")
        show_figures(titled(scores, motions))
        write_json(command.json, json.loads(scores_to_json(scores)))
        if command.csv is not None:
            write_file("--csv", command.csv, scores_to_csv(scores).encode())
            say(f"written: {command.csv}")
    if failures:
        say(f"{len(scores)} evaluated, {len(failures)} failed.")
    return exit_code(failures, len(command.results))


def execute_report(command: WriteReport) -> int:
    """Write the report; return 1 when `--strict` is given and a file fails or cannot be read."""
    check_writable("--out", command.out)
    reference = reference_clip_of(command)
    motions, manifests = find(command.paths)
    # Of what is written, only the table can be a motion.
    check_inputs_kept("--out", [command.out / _TABLE], motions.values())
    lineages, rows = read_manifests(manifests)
    model = load_robot(command.robot)
    with Working("judging", len(motions)) as working:
        for name, path in motions.items():
            rows.append(report_rows.read_row(name, path, model, lineages.get(path.resolve()), reference))
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


def _write_pages(
    rows: Sequence[report_rows.Row], foreign_robot: RobotModel, command: WriteReport
) -> dict[str, MotionPage]:
    """Write the pages of the worst motions; return them by the rows' files."""
    pages = MotionPages(command.out, command.title)
    chosen = [row for row in report_rows.worst_first(rows) if row.path is not None][: command.pages]
    together = _together(rows)
    back = BackLink(command.title, f"../{_PAGE}")
    with Working("pages", len(chosen)) as working:
        for row in chosen:
            if row.file not in pages.pages:
                paths = {member.file: member.path for member in together[row.file] if member.path is not None}
                pages.add(paths, partial(_page_of, row, together[row.file], foreign_robot, command.objects, back))
            working.advance()
    pages.finish()
    if pages.without_pictures:
        warn(f"The page has no pictures. {pages.without_pictures}")
    return pages.pages


def _together(rows: Sequence[report_rows.Row]) -> dict[str, list[report_rows.Row]]:
    """Return the rows that share a page with each, itself included: robots that move the same objects."""
    found = sorted((row for row in rows if row.verdict is not None), key=lambda row: row.file)
    hosts = group_people([row.shared for row in found], [row.person for row in found])
    groups: dict[int, list[report_rows.Row]] = {}
    for row, host in zip(found, hosts, strict=True):
        groups.setdefault(host, []).append(row)
    return {row.file: group for group in groups.values() for row in group}


def _page_of(
    worst: report_rows.Row,
    rows: Sequence[report_rows.Row],
    foreign_robot: RobotModel,
    objects: Path | None,
    back: BackLink,
) -> tuple[ClipPage, int, list[float]] | None:
    """Return the page of motions that are shown together; None where they cannot be.

    With it come the worst frame of the worst of them, and each one's worst moment [s]. Other programs' motions are of
    the foreign robot.
    """
    try:
        opened = [_opened(row.path, foreign_robot, objects) for row in rows if row.path is not None]
        names = names_together([(model.spec, motion.person) for motion, model, _ in opened])
        results = [
            (
                gallery_entry_of(motion, model, known_figures(motion, Path(row.file))),
                SceneItem(name, motion, model, clip, motion.person),
            )
            for row, name, (motion, model, clip) in zip(rows, names, opened, strict=True)
        ]
        reasons = [(name, reason) for row, name in zip(rows, names, strict=True) for reason in row.reasons]
        notices = [f"{name}: {reason}" if len(rows) > 1 else reason for name, reason in reasons]
        if len(notices) > 1:
            lights = (f"{name} {row.level}, physics {row.physics}" for row, name in zip(rows, names, strict=True))
            notices.insert(0, f"{'; '.join(lights)}: {len(reasons)} reasons")
        page = make_clip_page(title_together([row.name for row in rows]), results, back=back, notices=notices)
    except HoiRetargetError:
        return None
    frames = [report_rows.worst_frame(motion) for motion, _, _ in opened]
    seconds = [frame / motion.fps for frame, (motion, _, _) in zip(frames, opened, strict=True)]
    return page, frames[list(rows).index(worst)], seconds


def _opened(path: Path, foreign_robot: RobotModel, objects: Path | None) -> tuple[Motion, RobotModel, Clip | None]:
    """Return a motion with its robot, and its clip where that is to be had; raises `HoiRetargetError`."""
    motion = open_motion(path, foreign_robot).motion
    return motion, load_robot(motion.robot), drawable_clip(motion, partial(clip_of, objects=objects))


def _write(out: Path, title: str, rows: Sequence[report_rows.Row], pages: dict[str, MotionPage]) -> None:
    contents = {
        out / _PAGE: report_page(title, rows, pages).encode("utf-8", "replace"),
        out / _TABLE: report_rows.to_csv(rows),
        out / "verdicts.json": report_rows.to_json(rows),
    }
    parquet = report_rows.to_parquet(rows)
    if parquet is not None:
        contents[out / _PARQUET] = parquet
    write_together(contents)
    if parquet is None:
        (out / _PARQUET).unlink(missing_ok=True)  # An earlier one would contradict the rest.
        warn(f"{_PARQUET} is not written: it needs pyarrow. {install_hint('pyarrow')}")


def _summarize(rows: Sequence[report_rows.Row]) -> None:
    counts: dict[str, Counter[str]] = {}
    physics: dict[str, Counter[str]] = {}
    for row in sorted(rows, key=lambda row: row.robot):
        counts.setdefault(row.robot or "-", Counter())[row.state] += 1
        physics.setdefault(row.robot or "-", Counter())[row.physics] += 1
    lights = [light for light in report_rows.LIGHTS if any(count[light] for count in physics.values())]
    heads = ("robot", "files", *report_rows.STATES, *(f"physics {light}" for light in lights))
    lines = [
        (
            *(name, str(sum(count.values()))),
            *(str(count[state]) for state in report_rows.STATES),
            *(str(physics[name][light]) for light in lights),
        )
        for name, count in counts.items()
    ]
    show_table([heads, *lines])
    say()
    for level in (Level.FAIL, None):
        named = [row for row in rows if row.level is level]
        for row in named[:_MAX_NAMED]:
            why = row.error if row.verdict is None else "; ".join((*row.contradictions, by_kind(row.verdict.reasons)))
            where = "" if row.file in why else f"{row.file}: "  # Errors name their file.
            say(f"{'unread: ' if level is None else ''}{where}{why}")
        if len(named) > _MAX_NAMED:
            say(f"... and {len(named) - _MAX_NAMED} more.")
