"""`hoi-retarget view`: results in a browser."""

from collections.abc import Callable
from functools import partial

from hoi_retarget.cli.commands import View
from hoi_retarget.cli.jobs import load_motion
from hoi_retarget.cli.serving import check_viser, serve_until_interrupted
from hoi_retarget.cli.terminal import fail, warn
from hoi_retarget.readers.open import clip_of


def execute(command: View) -> int:
    """Serve the viewer until Ctrl-C; return 1 when no result can be read."""
    check_viser()
    from hoi_retarget.viewers.browser.page_content import PageContent, load_page_content  # noqa: PLC0415 - need an extra
    from hoi_retarget.viewers.browser.player import serve_results  # noqa: PLC0415

    told: set[str] = set()

    def load() -> PageContent:
        content = load_page_content(
            command.results,
            partial(clip_of, name=command.clip, objects=command.objects),
            partial(load_motion, robot=command.robot, warn=tell),
        )
        for notice in content.notices:
            tell(notice, fail if content.scene is None else warn)
        return content

    def tell(notice: str, say: Callable[[str], None] = warn) -> None:
        if notice not in told:
            told.add(notice)
            say(notice)

    if load().scene is None:
        return 1
    serve_until_interrupted("hoi-retarget", command.host, command.port, lambda server: serve_results(server, load))
    return 0
