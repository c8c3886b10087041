"""A Viser server for own visitors alone, a session for each of its browsers, and the content of a page.

Any page that is open in the same browser, of the internet or of another program on this machine, could otherwise
connect to it, read what it shows and press its buttons. So the address holds a token, which nobody else knows, and
a connection from a page must come from the server's own.
"""

import hmac
import io
import secrets
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, replace
from functools import partial
from http import HTTPStatus
from threading import Lock
from typing import Any, Protocol, runtime_checkable
from urllib.parse import urlsplit

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from hoi_retarget.studio.scene.curves import (
    BAR_ROW_HEIGHT_PX,
    CHART_STEP_PX,
    FORCE_GROUPS,
    SLIP_GROUP,
    SURFACE_GROUPS,
    TITLES_HEIGHT_PX,
    TRUNK_GROUP,
    all_curves,
    bar_rows,
    chart_html,
)
from hoi_retarget.studio.scene.drawing import DrawnScene
from hoi_retarget.studio.scene.scene import SceneItem, make_scene
from hoi_retarget.studio.share.page_server import FIRST_PORT, LOOPBACK, check_address, url


class PageServer(viser.ViserServer):
    """Viser's server without its tunnel, which any page it serves could ask it to open, and without its prints."""

    def __init__(self, *, host: str, **settings: Any) -> None:
        self._on_stop: list[Callable[[], None]] = []
        self.token = secrets.token_urlsafe(16)
        """First part of the path of all requests."""
        with redirect_stdout(io.StringIO()), _own_visitors_only(host, self.token):
            super().__init__(host=host, **settings)

    def request_share_url(self, verbose: bool = True) -> None:
        """Open no tunnel."""
        return None

    def on_stop(self, callback: Callable[[], None]) -> None:
        """Call this when the server is to stop, while its messages still arrive."""
        self._on_stop.append(callback)

    def stop(self) -> None:
        """Run the callbacks of `on_stop`, and stop."""
        for callback in self._on_stop:
            callback()
        with redirect_stdout(io.StringIO()):
            super().stop()


def open_server(title: str, *, host: str = "127.0.0.1", port: int | None = None) -> PageServer:
    """Start a server of a page with a title, in threads of its own; `get_port()` tells where, `stop()` ends it.

    Without a port it takes the first free one from 8080 on. Raises `ArgumentError` when the port is taken, or the
    machine does not have this address.
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

    websockets.asyncio.server.serve = listen_to_own  # pyright: ignore[reportAttributeAccessIssue] - its own type is narrower
    try:
        yield
    finally:
        websockets.asyncio.server.serve = listen


def _answer(
    host: str, token: str, answer: Callable[..., Response | None], connection: ServerConnection, request: Request
) -> Response | None:
    """Answer an own visitor's request for a page or a connection, without the token; refuse all others."""
    given, _, path = request.path.removeprefix("/").partition("/")
    if not hmac.compare_digest(given.partition("?")[0].encode(), token.encode()):
        return connection.respond(HTTPStatus.FORBIDDEN, "Open the whole address that was printed, with its token.\n")
    origins, own_address = (request.headers.get_all(name) for name in ("Origin", "Host"))
    if not (len(own_address) == 1 and all(_is_own(host, origin, own_address[0]) for origin in origins)):
        return connection.respond(HTTPStatus.FORBIDDEN, "This page may not connect.\n")
    return answer(connection, replace(request, path=f"/{path}"))


def _is_own(host: str, origin: str, own_address: str) -> bool:
    """Return whether a page's origin is the address of the request; only browsers tell an origin.

    A server for this machine alone has requests by this machine's names: any other is a page's trick. The port
    may differ from the server's, where it is forwarded.
    """
    try:
        page = urlsplit(origin)
        name = page.hostname
    except ValueError:
        return False
    return (
        page.scheme in ("http", "https") and page.netloc == own_address and (host not in LOOPBACK or name in LOOPBACK)
    )


@runtime_checkable
class Session(Protocol):
    """The work for one browser."""

    def stop(self) -> None:
        """End it, once or more often; it has ended on return."""
        ...


_MESSAGES_AT_ONCE = 10_000


def serve_sessions(server: PageServer, create_session: Callable[[viser.ClientHandle], Session | None]) -> None:
    """Call `create_session` for each browser that connects; stop its session when the browser or the server goes."""
    sessions: dict[int, Session] = {}
    lock = Lock()

    @server.on_client_connect
    def _(client: viser.ClientHandle) -> None:
        # Viser sends at most 128 messages together, which would draw the parts of one frame in several.
        client._websock_connection.get_message_buffer().max_window_size = _MESSAGES_AT_ONCE
        session = create_session(client)
        if session is None:
            return
        with lock:
            sessions[client.client_id] = session
        # One that went while it was received has been dismissed too early.
        if client.client_id not in server.get_clients():
            end(client.client_id)

    @server.on_client_disconnect
    def on_disconnect(client: viser.ClientHandle) -> None:
        end(client.client_id)

    @server.on_stop
    def _() -> None:
        for client_id in list(sessions):
            end(client_id)

    def end(client_id: int) -> None:
        with lock:
            session = sessions.get(client_id)
        if session is not None:
            session.stop()  # Both may come here; neither goes on before it has ended.
            sessions.pop(client_id, None)


@dataclass(frozen=True, eq=False)
class PageContent:
    """Scene and curves of a page."""

    scene: DrawnScene
    chart: str = ""
    """HTML of the curves (`chart_html`)."""
    extra_height_px: int = 0
    """Height of the chart beyond that of one result's curves."""
    strip_height_px: int = 0
    """Height of what lies above the chart (`Player.show_strip`)."""


def page_content(shown: Sequence[SceneItem], *, compared: bool = False) -> PageContent:
    """Return the content for results and clips; raises as `make_scene`.

    If `compared`, there are curves of the motions before, too.
    """
    scene = make_scene(shown)
    motions = [(item, item.title, item.motion) for item in shown]
    if compared:  # First, so that today's curves are drawn over them.
        motions[:0] = [(item, f"{item.title}, before", item.baseline) for item in shown]
    curves = [
        (title, all_curves(motion, item.model, item.clip)) for item, title, motion in motions if motion and item.model
    ]
    # The editor has bars of contacts, which can be chosen.
    rows = bar_rows([(item.title, item.motion) for item in shown if item.motion], contacts=False)
    groups = {curve.group for _, own in curves for curve in own}
    extra = (
        CHART_STEP_PX * len(groups.intersection((*SURFACE_GROUPS, TRUNK_GROUP, SLIP_GROUP, *FORCE_GROUPS)))
        + (TITLES_HEIGHT_PX if len(curves) > 1 else 0)
        + BAR_ROW_HEIGHT_PX * len(rows)
    )
    return PageContent(scene, chart_html(curves, scene.fps, rows=rows), extra)
