"""The viewer's page: every browser that opens it reads the results anew and gets a player of its own."""

from collections.abc import Callable

import viser

from hoi_retarget.viewers.browser.client_sessions import serve_sessions
from hoi_retarget.viewers.browser.page_content import PageContent
from hoi_retarget.viewers.browser.player import Player, show_notices
from hoi_retarget.viewers.browser.server import PageServer


def serve_results(server: PageServer, load: Callable[[], PageContent]) -> None:
    """Let a server show what `load` returns when a browser connects."""

    def receive(client: viser.ClientHandle) -> Player | None:
        content = load()
        if content.scene is None:
            show_notices(client, content)
            return None
        return Player(client, content)

    serve_sessions(server, receive)
