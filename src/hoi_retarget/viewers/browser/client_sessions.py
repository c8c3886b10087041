"""What a server does for each browser, from when it comes to when it goes."""

from collections.abc import Callable
from threading import Lock
from typing import Protocol, runtime_checkable

import viser

from hoi_retarget.viewers.browser.server import PageServer


@runtime_checkable
class Visit(Protocol):
    """What is done for one browser."""

    def stop(self) -> None:
        """End it, once or more often; it has ended on return."""
        ...


def serve_visitors(server: PageServer, receive: Callable[[viser.ClientHandle], Visit | None]) -> None:
    """Call `receive` for every browser that connects, and stop what it returns when the browser or the server goes."""
    visits: dict[int, Visit] = {}
    lock = Lock()

    @server.on_client_connect
    def _(client: viser.ClientHandle) -> None:
        visit = receive(client)
        if visit is None:
            return
        with lock:
            visits[client.client_id] = visit
        # One that went while it was received has been dismissed too early.
        if client.client_id not in server.get_clients():
            end(client.client_id)

    @server.on_client_disconnect
    def dismiss(client: viser.ClientHandle) -> None:
        end(client.client_id)

    @server.before_stop
    def _() -> None:
        for client_id in list(visits):
            end(client_id)

    def end(client_id: int) -> None:
        with lock:
            visit = visits.get(client_id)
        if visit is not None:
            visit.stop()  # Both may come here; neither goes on before it has ended.
            visits.pop(client_id, None)
