"""Pages in a browser: a server that goes on until the user ends it."""

from collections.abc import Callable
from importlib.util import find_spec
from threading import Event
from typing import TYPE_CHECKING

from hoi_retarget.cli.terminal import say
from hoi_retarget.errors import HoiRetargetError

if TYPE_CHECKING:
    from hoi_retarget.viewers.browser.server import PageServer


def check_viser() -> None:
    """Raise `HoiRetargetError` unless Viser, an extra, is installed."""
    if find_spec("viser") is None:
        raise HoiRetargetError(
            'Pages in a browser need Viser, which is not installed. In a clone: pip install ".[view]"; '
            'else: pip install "hoi-retarget[view]".'
        )


def serve_until_interrupted(title: str, host: str, port: int | None, prepare: "Callable[[PageServer], None]") -> None:
    """Start a server, let `prepare` fill it, say where it is, and stop it at Ctrl-C."""
    from hoi_retarget.viewers.browser.server import address, open_server  # noqa: PLC0415 - an extra

    server = open_server(title, host=host, port=port)
    try:
        prepare(server)
        say(f"Open {address(server)} in a browser. Ctrl-C ends it.")
        Event().wait()
    except KeyboardInterrupt:
        say()
    finally:
        server.stop()
