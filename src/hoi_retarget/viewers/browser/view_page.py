"""The viewer's page: every browser that opens it reads the results anew and gets a player of its own."""

from collections.abc import Callable

import viser

from hoi_retarget.viewers.browser.client_sessions import serve_visitors
from hoi_retarget.viewers.browser.page_content import Exhibit
from hoi_retarget.viewers.browser.player import Player, show_notices
from hoi_retarget.viewers.browser.server import PageServer


def serve_exhibit(server: PageServer, load: Callable[[], Exhibit]) -> None:
    """Let a server show what `load` returns when a browser connects."""

    def receive(client: viser.ClientHandle) -> Player | None:
        exhibit = load()
        if exhibit.scene is None:
            show_notices(client, exhibit)
            return None
        return Player(client, exhibit)

    serve_visitors(server, receive)
