"""One session for each browser: it begins when the browser connects and ends when it goes or the server stops."""

from collections.abc import Callable
from threading import Lock
from typing import Protocol, runtime_checkable

import viser

from hoi_retarget.viewers.browser.server import PageServer


@runtime_checkable
class Session(Protocol):
    """The work for one browser."""

    def stop(self) -> None:
        """End it, once or more often; it has ended on return."""
        ...


_MESSAGES_AT_ONCE = 10_000


def serve_sessions(server: PageServer, receive: Callable[[viser.ClientHandle], Session | None]) -> None:
    """Call `receive` for every browser that connects, and stop what it returns when the browser or the server goes."""
    sessions: dict[int, Session] = {}
    lock = Lock()

    @server.on_client_connect
    def _(client: viser.ClientHandle) -> None:
        # Viser sends at most 128 messages together, which would draw the parts of one frame in several.
        client._websock_connection.get_message_buffer().max_window_size = _MESSAGES_AT_ONCE
        session = receive(client)
        if session is None:
            return
        with lock:
            sessions[client.client_id] = session
        # One that went while it was received has been dismissed too early.
        if client.client_id not in server.get_clients():
            end(client.client_id)

    @server.on_client_disconnect
    def dismiss(client: viser.ClientHandle) -> None:
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
