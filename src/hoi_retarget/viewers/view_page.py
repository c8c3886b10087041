"""The viewer's page: every browser that opens it reads the results anew and gets a player of its own."""

from collections.abc import Callable
from threading import Lock

import viser

from hoi_retarget.viewers.exhibit import Exhibit
from hoi_retarget.viewers.player import Player, show_notices


def serve_exhibit(server: viser.ViserServer, load: Callable[[], Exhibit]) -> None:
    """Let a server show what `load` returns when a browser connects; nothing of it outlives the browser."""
    players: dict[int, Player] = {}
    lock = Lock()

    @server.on_client_connect
    def _(client: viser.ClientHandle) -> None:
        exhibit = load()
        if exhibit.scene is None:
            show_notices(client, exhibit)
            return
        player = Player(client, exhibit, exhibit.scene)
        with lock:
            players[client.client_id] = player
        if client.client_id not in server.get_clients():
            leave(client)

    @server.on_client_disconnect
    def leave(client: viser.ClientHandle) -> None:
        with lock:
            player = players.pop(client.client_id, None)
        if player is not None:
            player.stop()
