"""Figures that motions' reports hold, as scores and as tables in the terminal."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from rich.text import Text

from hoi_retarget.cli.terminal import say, show_table
from hoi_retarget.errors import ReadError
from hoi_retarget.evaluation import FIGURES, Figure, Score, mean_values, table_rows, worst_values
from hoi_retarget.evaluation.figure_table import grouped_columns
from hoi_retarget.evaluation.thresholds import THRESHOLDS, Light, by_kind, known_figures
from hoi_retarget.motion.motion import Motion
from hoi_retarget.robots import load_robot

_MAX_COLUMNS = 4  # Results that stand side by side, one a column.
_MAX_REASONS = 3  # Of a light; all are in the report.
_STYLES = {"pass": "green", "warn": "yellow", "fail": "red"}


def score(motion: Motion, path: Path) -> Score:
    """Return the figures that a motion's report holds, as tables need them; raises `ReadError` where it has none.

    Those that the version which made it did not know are None.
    """
    if not {figure.name for figure in FIGURES} & set(motion.report.figures):
        raise ReadError(f"{path}: its report has none of the figures. Run the retarget again, with --figures all.")
    return known_figures(motion, path)


def titled(scores: Sequence[Score], motions: Sequence[Motion]) -> list[Score]:
    """Return the scores of motions; robots that move the same objects are called by the robots' names."""
    if not any(motion.person for motion in motions):
        return list(scores)
    from hoi_retarget.studio.scene.scene import group_people, shared_objects  # noqa: PLC0415  # slow to load
    from hoi_retarget.studio.scene.subplots import names_together, title_together  # noqa: PLC0415  # as above

    hosts = group_people([shared_objects(motion) for motion in motions], [motion.person for motion in motions])
    found = list(scores)
    for host in set(hosts):
        members = [index for index, other in enumerate(hosts) if other == host]
        names = names_together([(load_robot(motions[index].robot).spec, motions[index].person) for index in members])
        clip = title_together([scores[index].name for index in members])
        for index, name in zip(members, names, strict=True):
            if len(members) > 1:
                title = f"{clip}, {name}" if len(set(hosts)) > 1 else name
                found[index] = replace(scores[index], title=title)
    return found


def show_figures(scores: Sequence[Score], *, every: bool = True) -> None:
    """Print verdicts, then figures: side by side of a few results, else a line for each, and the mean and worst of all.

    Without `every`, these are the figures in `HEADLINE`.
    """
    groups = grouped_columns(scores, every=every)
    if len(scores) <= _MAX_COLUMNS:
        _show_verdicts(scores)
        _show_side_by_side(scores, groups, complete=every)
        return
    columns = next(iter(groups.values()))
    header, *rows = table_rows(scores, columns)[: len(scores) + 1]
    lines = [
        (*row[:4], *map(_light, row[4:6]), *(_cell(score, column) for column in columns))
        for row, score in zip(rows, scores, strict=True)
    ]
    show_table([header, *lines], words=(0, 4, 5))
    say()
    mean, worst = mean_values(scores), worst_values(scores)
    summary = [
        (column.header, column.text(mean[column.name]), column.text(worst[column.name]))
        for columns in groups.values()
        for column in columns
    ]
    show_table([("all clips", "mean", "worst"), *summary])


def _show_verdicts(scores: Sequence[Score]) -> None:
    rows = [
        (score.title or score.name, name, _light(str(light)), _why(light))
        for score in scores
        if score.verdict is not None
        for name, light in (("motion", score.verdict.motion), ("physics", score.verdict.physics))
    ]
    if rows:
        show_table([("verdict", "", "", "why"), *rows], words=range(4))
        say()


def _why(light: Light) -> str:
    """Return the first reasons of a light, and the number of the others."""
    further = len(light.reasons) - _MAX_REASONS
    return by_kind(light.reasons[:_MAX_REASONS]) + (f"; and {further} more" if further > 0 else "")


def _show_side_by_side(scores: Sequence[Score], groups: Mapping[str, Sequence[Figure]], *, complete: bool) -> None:
    """Print figures by their headings, a result in each column; complete with facts, mean and worst."""
    table = table_rows(scores)[: None if complete else len(scores) + 1]
    names, *facts = ((head, *cells) for head, *cells in zip(*(row[:4] for row in table), strict=True))
    means = [mean_values(scores), worst_values(scores)] if len(table) > len(scores) + 1 else []
    rows = [("", *names[1:]), *(facts if complete else ())]
    for heading, figures in groups.items():
        rows.append((Text(heading, "bold"), *("" for _ in names[1:])))
        for figure in figures:
            cells = (_cell(score, figure) for score in scores)
            rows.append((figure.header, *cells, *(figure.text(values[figure.name]) for values in means)))
    show_table(rows)


def _light(level: str) -> Text:
    return Text(level, _STYLES.get(level, ""))


def _cell(score: Score, figure: Figure) -> str | Text:
    """Return the text of a figure in the colour of its level, where it is judged."""
    value, verdict = score.values().get(figure.name), score.verdict
    threshold = next((item for item in THRESHOLDS if item.name == figure.name), None)
    if value is None or verdict is None or threshold is None or figure.name in verdict.not_judged:
        return figure.text(value)
    return Text(figure.text(value), _STYLES[str(threshold.level(value))])
