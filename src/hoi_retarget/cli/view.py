"""`hoi-retarget view`: results in a browser."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

from hoi_retarget.cli.commands import View
from hoi_retarget.cli.entries import entry_of
from hoi_retarget.cli.jobs import known_figures, load_motion
from hoi_retarget.cli.serving import wait_for_interrupt
from hoi_retarget.cli.terminal import fail, warn
from hoi_retarget.readers.open import clip_of
from hoi_retarget.viewers.share.clip_page import Detail, make_clip_page, notices_page
from hoi_retarget.viewers.share.load_results import LoadedResults, load_results
from hoi_retarget.viewers.share.server import OnePageServer

_DETAIL = Detail(frames=20_000, points=3000)


def execute(command: View) -> int:
    """Serve the viewer until Ctrl-C; return 1 when no result can be read."""
    with serve(command) as server:
        if server is None:
            return 1
        wait_for_interrupt(server.address, server.port)
    return 0


@contextmanager
def serve(command: View) -> Iterator[OnePageServer | None]:
    """Serve the page of results, made anew where files changed, while the block runs; None where none can be read."""
    told: set[str] = set()

    def tell(notice: str, say: Callable[[str], None] = warn) -> None:
        if notice not in told:
            told.add(notice)
            say(notice)

    made = _states(command), _load(command, tell)
    text = _page(made[1])

    def page() -> str:
        nonlocal made, text
        if made[0] != (states := _states(command)):
            made = states, _load(command, tell)
            text = _page(made[1])
        return text

    if not made[1].results:
        yield None
        return
    server = OnePageServer(page, host=command.host, port=command.port)
    try:
        yield server
    finally:
        server.stop()


def _load(command: View, tell: Callable[..., None]) -> LoadedResults:
    loaded = load_results(
        command.results,
        partial(clip_of, name=command.clip, objects=command.objects),
        partial(load_motion, robot=command.robot, warn=tell),
    )
    for notice in loaded.notices:
        tell(notice, warn if loaded.results else fail)
    return loaded


def _page(loaded: LoadedResults) -> str:
    if not loaded.results:
        return notices_page(loaded.notices)
    results = []
    for path, motion, shown in loaded.results:
        assert shown.model is not None, "results have their robots"
        results.append((entry_of(motion, shown.model, known_figures(motion, path)), shown))
    stems = list(dict.fromkeys(path.stem for path, _, _ in loaded.results))
    return make_clip_page(", ".join(stems), results, notices=loaded.notices, detail=_DETAIL).text


def _states(command: View) -> list[tuple[int, int] | None]:
    """Return what tells the files' contents from what they were before; None where one is not there."""
    states: list[tuple[int, int] | None] = []
    for path in command.results:
        try:
            status = path.stat()
        except (OSError, ValueError):
            states.append(None)
        else:
            states.append((status.st_mtime_ns, status.st_size))
    return states
