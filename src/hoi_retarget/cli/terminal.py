"""Printing: plain lines, errors and warnings on stderr, tables, and a bar for what takes long."""

import sys
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from threading import Timer

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

PATIENCE_S = 2.0  # Nobody needs a bar for less.
PLAIN_WIDTH = 140  # Of tables that do not go to a terminal.


def say(text: str = "") -> None:
    """Print a line."""
    print(text, flush=True)


def warn(text: str) -> None:
    """Print a warning on stderr."""
    print(f"warning: {text}", file=sys.stderr, flush=True)


def fail(text: str) -> None:
    """Print an error on stderr, in one line."""
    print(f"error: {' '.join(text.split())}", file=sys.stderr, flush=True)


def show_table(rows: Sequence[Sequence[str]], *, words: Collection[int] = (0,)) -> None:
    """Print rows as a table; the first one is the header, columns other than `words` are numbers."""
    console = Console(highlight=False, markup=False)
    if not console.is_terminal:
        console = Console(highlight=False, markup=False, width=PLAIN_WIDTH)
    table = Table(box=None, pad_edge=False, header_style="bold")
    for index, name in enumerate(rows[0]):
        table.add_column(name, justify="left" if index in words else "right", overflow="fold", no_wrap=index == 0)
    for row in rows[1:]:
        table.add_row(*row)
    console.print(table)


class Working:
    """A bar on stderr that appears when the work takes longer than two seconds.

    It is drawn on terminals only, and steps aside while a line is printed.
    """

    def __init__(self, what: str, total: int | None) -> None:
        console = Console(stderr=True, highlight=False)
        columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
        if total is not None and total > 1:
            columns = (*columns[:2], BarColumn(), MofNCompleteColumn(), columns[2])
        self._progress = Progress(
            *columns, console=console, transient=True, redirect_stdout=False, redirect_stderr=False
        )
        self._task = self._progress.add_task(what, total=total)
        self._visible = console.is_terminal
        self._timer = Timer(PATIENCE_S, self._progress.start)
        self._timer.daemon = True

    def __enter__(self) -> "Working":
        if self._visible:
            self._timer.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._timer.cancel()
        if self._progress.live.is_started:
            self._progress.stop()

    def describe(self, what: str) -> None:
        """Say what is being worked on now."""
        self._progress.update(self._task, description=what)

    def advance(self) -> None:
        """Count one piece of work as done."""
        self._progress.advance(self._task)

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Take the bar away while lines are printed."""
        shown = self._progress.live.is_started
        if shown:
            self._progress.stop()
        yield
        if shown:
            self._progress.start()
