"""A Viser server that only this machine reaches, unless told otherwise, that hands nothing on and knows its visitors.

Any page that is open in the same browser, of the internet or of another program on this machine, could otherwise
connect to it, read what it shows and press its buttons. So the address holds a token, which nobody else knows, and
a connection from a page must come from the server's own.
"""

import hmac
import io
import secrets
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import replace
from functools import partial
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from hoi_retarget.viewers.addresses import FIRST_PORT, LOOPBACK, check_address, url


class PageServer(viser.ViserServer):
    """Viser's server without its tunnel, which any page it serves could ask it to open, and without its prints."""

    def __init__(self, *, host: str, **settings: Any) -> None:
        self._on_stop: list[Callable[[], None]] = []
        self.token = secrets.token_urlsafe(16)
        """First part of the path of everything that is asked for."""
        with redirect_stdout(io.StringIO()), _own_visitors_only(host, self.token):
            super().__init__(host=host, **settings)

    def request_share_url(self, verbose: bool = True) -> None:
        """Open no tunnel."""
        return None

    def on_stop(self, callback: Callable[[], None]) -> None:
        """Call this when the server is to stop, while what it sends still arrives."""
        self._on_stop.append(callback)

    def stop(self) -> None:
        """Call what `on_stop` was given, and stop."""
        for callback in self._on_stop:
            callback()
        with redirect_stdout(io.StringIO()):
            super().stop()


def open_server(title: str, *, host: str = "127.0.0.1", port: int | None = None) -> PageServer:
    """Start a server in threads of its own; `get_port()` tells where, `stop()` ends it.

    Args:
        title: Shown at the top of its page.
        host: Address to listen at.
        port: Exactly this one, or the first free one from 8080 on.

    Raises:
        ArgumentError: The port is taken, or the machine does not have this address.
    """
    check_address(host, port)
    # A browser that goes while a frame is drawn for it is no mistake.
    warnings.filterwarnings("ignore", message="Queued a .* on a closed connection", category=UserWarning)
    server = PageServer(host=host, port=FIRST_PORT if port is None else port, label=title, verbose=False)
    server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(38, 110, 160))
    server.scene.set_up_direction("+z")
    # Light from all around is what takes longest to draw without a graphics card, and adds little here.
    server.scene.configure_environment_map(hdri=None)
    server.scene.add_light_hemisphere("/sky", sky_color=(255, 255, 255), ground_color=(190, 185, 180), intensity=1.4)
    return server


def address(server: PageServer) -> str:
    """Return the address to open in a browser, token included."""
    return url(server.get_host(), server.get_port(), server.token)


@contextmanager
def _own_visitors_only(host: str, token: str) -> Iterator[None]:
    """Let a server answer only who knows its token, and of pages only its own.

    Viser has no setting for it; what it calls to listen has.
    """
    listen = websockets.asyncio.server.serve

    def listen_to_own(*args: Any, process_request: Any, **settings: Any) -> Any:
        return listen(*args, process_request=partial(_answer, host, token, process_request), **settings)

    websockets.asyncio.server.serve = listen_to_own  # pyright: ignore[reportAttributeAccessIssue]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = listen


def _answer(
    host: str, token: str, answer: Callable[..., Response | None], connection: ServerConnection, request: Request
) -> Response | None:
    """Pass on, without the token, what an own visitor asks for, be it a page or a connection; refuse all else."""
    given, _, path = request.path.removeprefix("/").partition("/")
    if not hmac.compare_digest(given.partition("?")[0].encode(), token.encode()):
        return connection.respond(HTTPStatus.FORBIDDEN, "Open the whole address that was printed, with its token.\n")
    origins, asked = (request.headers.get_all(name) for name in ("Origin", "Host"))
    if not (len(asked) == 1 and all(_is_own(host, origin, asked[0]) for origin in origins)):
        return connection.respond(HTTPStatus.FORBIDDEN, "This page may not connect.\n")
    return answer(connection, replace(request, path=f"/{path}"))


def _is_own(host: str, origin: str, asked: str) -> bool:
    """Return whether a page's origin is the address at which the server was asked; only browsers tell an origin.

    A server that only this machine reaches is asked by a name of this machine: any other is a page's trick. The port
    may differ from the server's, where it is forwarded.
    """
    try:
        page = urlsplit(origin)
        name = page.hostname
    except ValueError:
        return False
    return page.scheme in ("http", "https") and page.netloc == asked and (host not in LOOPBACK or name in LOOPBACK)
