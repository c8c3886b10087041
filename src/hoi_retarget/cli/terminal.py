"""Printing: plain lines, errors and warnings on stderr, tables, and a bar for long work on many files."""

import shlex
import shutil
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event, Thread, Timer
from time import monotonic
from typing import Any

from rich.cells import cell_len
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from hoi_retarget.errors import ArgumentError, HoiRetargetError

NAME = "hoi-retarget"
PATIENCE_S = 2.0  # Nobody needs a bar for less.
PLAIN_WIDTH = 140  # Of tables that do not go to a terminal.
PAUSE_S = 10.0  # Between lines of progress that do not go to a terminal.
STDOUT = Path("-")  # Instead of a file: what is written goes to stdout, and all that is said to stderr.
_GAP = 2  # Between columns.
_said_on_stderr = False


def program() -> str:
    """Return the word that starts this program from here, for commands that are shown."""
    started = Path(sys.argv[0])
    if started.parts[-2:] == ("hoi_retarget", "__main__.py"):
        return f"{shlex.quote(sys.executable)} -m hoi_retarget"
    found = shutil.which(NAME)
    if started.stem != NAME or (found and Path(found).absolute() == started.absolute()):
        return NAME
    return shlex.quote(sys.argv[0])


@contextmanager
def stdout_for_json(reserved: bool) -> Iterator[None]:
    """Let `say` print on stderr, where stdout is for JSON alone."""
    global _said_on_stderr  # noqa: PLW0603  # as there is one stdout
    _said_on_stderr = reserved
    try:
        yield
    finally:
        _said_on_stderr = False


def say(text: str = "") -> None:
    """Print a line."""
    _print(text, sys.stderr if _said_on_stderr else sys.stdout)


def put(text: str) -> None:
    """Print text for another program on stdout."""
    _print(text, sys.stdout, end="")


def warn(text: str) -> None:
    """Print a warning on stderr."""
    _print(f"warning: {text}", sys.stderr)


def fail(text: str) -> None:
    """Print an error on stderr, in one line."""
    _print(f"error: {' '.join(text.split())}", sys.stderr)


def _print(text: str, stream: Any, end: str = "\n") -> None:
    """Print text; the bar goes away for it."""
    bar = Working.shown.bar if Working.shown is not None else None
    drawn = bar is not None and bar.live.is_started
    if bar is not None and drawn:
        bar.stop()
    print(text, file=stream, end=end, flush=True)
    if bar is not None and drawn:
        bar.start()


def show_table(rows: Sequence[Sequence[str | Text]], *, words: Collection[int] = (0,)) -> None:
    """Print rows as a table; the first one is the header, columns other than `words` are numbers."""
    console = Console(highlight=False, markup=False)
    if not console.is_terminal:
        console = Console(highlight=False, markup=False, width=PLAIN_WIDTH)
    for number, columns in enumerate(_parts(rows, console.width)):
        if number:
            say()
        table = Table(box=None, pad_edge=False, header_style="bold")
        for index, width in columns.items():
            table.add_column(
                rows[0][index], justify="left" if index in words else "right", overflow="fold", width=width
            )
        for row in rows[1:]:
            table.add_row(*(cell if isinstance(cell := row[index], Text) else Text(cell) for index in columns))
        # Printed by `say`: rich itself ends the program with another code when nobody reads it any more.
        with console.capture() as capture:
            console.print(table)
        say(capture.get().removesuffix("\n"))


def _parts(rows: Sequence[Sequence[str | Text]], width: int) -> list[dict[int, int]]:
    """Return widths of columns that stand side by side; others come below them, after the first one again.

    Cells are broken between words; within one only where it is longer than all that is there.
    """
    texts = [tuple(map(str, column)) for column in zip(*rows, strict=True)]
    full = [max(map(cell_len, column)) for column in texts]
    least = [max((cell_len(word) for text in column for word in text.split()), default=1) for column in texts]
    first = min(full[0], max(1, width // 2))
    room = max(1, width - first)
    least = [min(number, max(1, room - _GAP)) for number in least]
    parts: list[list[int]] = [[]]
    for index in range(1, len(texts)):
        if parts[-1] and sum(least[other] + _GAP for other in (*parts[-1], index)) > room:
            parts.append([])
        parts[-1].append(index)
    return [{0: first, **_widths(part, full, least, room)} for part in parts]


def _widths(part: Sequence[int], full: Sequence[int], least: Sequence[int], room: int) -> dict[int, int]:
    widths = {index: full[index] for index in part}
    while sum(widths.values()) + _GAP * len(part) > room:
        widest = max(part, key=lambda index: (widths[index] > least[index], widths[index]))
        if widths[widest] <= least[widest]:
            break
        widths[widest] -= 1
    return widths


class Working:
    """A bar on stderr that appears when the work takes longer than two seconds; no terminal gets a line now and then.

    The bar goes away while a line is printed.
    """

    shown: "Working | None" = None
    """The work that is going on."""

    def __init__(self, what: str, total: int | None) -> None:
        console = Console(stderr=True, highlight=False)
        columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
        if total is not None and total > 1:
            columns = (*columns[:2], BarColumn(), MofNCompleteColumn(), columns[2])
        self.bar = Progress(*columns, console=console, transient=True, redirect_stdout=False, redirect_stderr=False)
        self._task = self.bar.add_task(what, total=total)
        self._visible = console.is_terminal
        self._timer = Timer(PATIENCE_S, self.bar.start)
        self._timer.daemon = True
        self._start, self._ended = monotonic(), Event()

    def __enter__(self) -> "Working":
        Working.shown = self
        if self._visible:
            self._timer.start()
        else:
            Thread(target=self._print_progress, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._timer.cancel()
        self._ended.set()
        Working.shown = None
        if self.bar.live.is_started:
            self.bar.stop()

    def _print_progress(self) -> None:
        """Print progress after every pause."""
        task = self.bar.tasks[0]
        while not self._ended.wait(PAUSE_S):
            counted = f"{task.completed:.0f} of {task.total:.0f}, " if task.total is not None and task.total > 1 else ""
            with suppress(OSError, ValueError):  # Nobody reads stderr any more; the work goes on.
                print(f"{task.description}: {counted}{monotonic() - self._start:.0f} s", file=sys.stderr, flush=True)

    def describe(self, what: str) -> None:
        """Name the current piece of work."""
        self.bar.update(self._task, description=what)

    def advance(self, pieces: int = 1) -> None:
        """Count some pieces of work as done."""
        self.bar.advance(self._task, pieces)

    def through(self, paths: Iterable[Path]) -> Iterator[Path]:
        """Yield paths, each of which is named while it is worked on and then counted as done."""
        for path in paths:
            self.describe(path.name)
            yield path
            self.advance()


def describe_work(what: str) -> None:
    """Name the current piece of the work that is going on."""
    if Working.shown is not None:
        Working.shown.describe(what)


def do_for_each(what: str, paths: Collection[Path], do: Callable[[Path], None]) -> list[HoiRetargetError]:
    """Work on every file, with a bar; print and return the errors."""
    failures: list[HoiRetargetError] = []
    with Working(what, len(paths)) as working:
        for path in working.through(paths):
            try:
                do(path)
            except HoiRetargetError as error:
                failures.append(error)
                fail(with_file(path, error))
    return failures


def with_file(path: Path | str, problem: object) -> str:
    """Return the text of an error or a warning, which names its file."""
    text = str(problem)
    return text if Path(path).name in text else f"{path}: {text}"


def exit_code(failures: Collection[HoiRetargetError], total: int) -> int:
    """Return 0 for no failure, 2 where all of a total fail by their arguments, else 1."""
    if not failures:
        return 0
    return 2 if len(failures) == total and all(isinstance(error, ArgumentError) for error in failures) else 1
