"""Bars over the time axis of a result: what touches, which feet stand, and what is not right where."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.report import Status
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.robots.spec import SIDES

CONTACT, STANCE, WARNING, ERROR = "contact", "stance", "warning", "error"


@dataclass(frozen=True)
class Bar:
    """A stretch of time."""

    start: float
    """[s]"""
    stop: float
    """[s]"""
    kind: str
    """One of `contact`, `stance`, `warning` and `error`."""
    text: str
    """What it stands for, in words."""


@dataclass(frozen=True)
class BarRow:
    """Bars of one kind beside each other."""

    name: str
    bars: tuple[Bar, ...]


def bar_rows(results: Sequence[tuple[str, Motion]], *, contacts: bool = True) -> tuple[BarRow, ...]:
    """Return the rows of one or several results; rows that say the same of several are there once.

    Args:
        results: Each result's title and motion.
        contacts: Whether rows of contacts are among them.
    """
    rows: list[BarRow] = []
    for title, motion in results:
        for row in _rows(motion, contacts):
            namesakes = [other for other in rows if other.name == row.name]
            if row.bars and row not in rows:
                rows.append(BarRow(f"{row.name}, {title}", row.bars) if namesakes else row)
    return tuple(rows)


def _rows(motion: Motion, contacts: bool) -> Iterator[BarRow]:
    touching = dict(zip(motion.contact_links, motion.contact_flags.T, strict=True)) if contacts else {}
    for link, flags in touching.items():
        yield _row(motion, link.replace("_", " "), flags, CONTACT, "touches")
    for side, flags in zip(SIDES, motion.stance_flags.T, strict=True):
        yield _row(motion, f"{side} stance", flags, STANCE, "the foot stands")
    yield BarRow("warnings", tuple(_warnings(motion)))


def _row(motion: Motion, name: str, flags: Bool[np.ndarray, "T"], kind: str, what: str) -> BarRow:
    return BarRow(name, tuple(_bar(motion, first, stop - 1, kind, what) for first, stop in runs(flags)))


def _warnings(motion: Motion) -> Iterator[Bar]:
    """Yield what is not right with a motion, and where it is so in time."""
    report = motion.report
    for window in motion.stages[-1].windows:
        if window.status is not Status.SOLVED:
            yield _bar(motion, window.start, window.stop - 1, WARNING, f"the solver {window.status.message}")
    for item in report.trunk_turns:
        yield _bar(motion, item.first_frame, item.last_frame, ERROR, str(item))
    for item in (
        *(report.unreached_contacts or ()),
        *report.sunk_links,
        *(report.orientation_flips or ()),
        *report.inter_robot_penetrations,
    ):
        yield _bar(motion, item.first_frame, item.last_frame, WARNING, str(item))
    for jump in report.rotation_jumps:
        last = jump.first_frame if jump.last_frame is None else jump.last_frame
        yield _bar(motion, jump.first_frame, last, WARNING, str(jump))


def _bar(motion: Motion, first: int, last: int, kind: str, text: str) -> Bar:
    return Bar(first / motion.fps, last / motion.fps, kind, text)
