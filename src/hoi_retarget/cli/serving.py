"""Pages in a browser: a server that goes on until the user ends it."""

import os
import sys
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from getpass import getuser
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
        wait_for_interrupt(address(server), server.get_port())
    finally:
        server.stop()


def wait_for_interrupt(address: str, port: int) -> None:
    """Open a page where there is a browser, or say how to get to it, and wait for Ctrl-C."""
    try:
        say(f"Open {address} in a browser. Ctrl-C ends it.")
        if _has_screen():
            webbrowser.open(address)
        elif "SSH_CONNECTION" in os.environ:
            # The server's own address, as the user's machine reached it.
            machine = os.environ["SSH_CONNECTION"].split()[2:3] or ["HOST"]
            say(f"From another machine, first: ssh -L {port}:localhost:{port} {getuser()}@{machine[0]}")
        Event().wait()
    except KeyboardInterrupt:
        say()


def _has_screen() -> bool:
    """Return whether somebody sits before this machine and has a browser; a remote shell has none."""
    if not sys.stdout.isatty() or "SSH_CONNECTION" in os.environ:
        return False
    if sys.platform.startswith("linux") and not ("DISPLAY" in os.environ or "WAYLAND_DISPLAY" in os.environ):
        return False
    with suppress(webbrowser.Error):
        webbrowser.get()
        return True
    return False
