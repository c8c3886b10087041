"""What a server does for each browser, from when it comes to when it goes."""

from collections.abc import Callable
from threading import Lock
from typing import Protocol, runtime_checkable

import viser


@runtime_checkable
class Visit(Protocol):
    """What is done for one browser."""

    def stop(self) -> None:
        """End it."""
        ...


def serve_visitors(server: viser.ViserServer, receive: Callable[[viser.ClientHandle], Visit | None]) -> None:
    """Call `receive` for every browser that connects, and stop what it returns when the browser goes."""
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
            dismiss(client)

    @server.on_client_disconnect
    def dismiss(client: viser.ClientHandle) -> None:
        with lock:
            visit = visits.pop(client.client_id, None)
        if visit is not None:
            visit.stop()
