"""Serves one page to the browsers of this machine, or of those who know its address.

The address holds a token, which nobody else knows: neither another site in the same browser nor another program on
this machine can read the page. It loads nothing else, and nothing can be asked of this server but the page.
"""

import hmac
import secrets
import socket
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Lock, Thread

from hoi_retarget.errors import ArgumentError
from hoi_retarget.viewers.addresses import FIRST_PORT, LARGEST_PORT, check_address, is_own_host, url

_REFUSED = b"Open the whole address that was printed, with its token.\n"


class OnePageServer:
    """A server of one page, made anew for every visit where `page` does so."""

    def __init__(self, page: Callable[[], str], *, host: str = "127.0.0.1", port: int | None = None) -> None:
        """Start to listen, in threads of its own, at exactly this port or at the first free one from 8080 on.

        Raises:
            ArgumentError: The port is taken, or the machine does not have this address.
        """
        check_address(host, port)
        self._token = secrets.token_urlsafe(16)
        self._page, self._host, self._lock = page, host, Lock()
        self._server = self._listen(host, port)
        Thread(target=self._server.serve_forever, name="page server", daemon=True).start()

    @property
    def address(self) -> str:
        """The address to open in a browser, token included."""
        return url(self._host, self.port, self._token)

    @property
    def port(self) -> int:
        """Where it listens."""
        return self._server.server_address[1]

    def stop(self) -> None:
        """Listen no longer."""
        self._server.shutdown()
        self._server.server_close()

    def _listen(self, host: str, port: int | None) -> ThreadingHTTPServer:
        for number in range(port or FIRST_PORT, LARGEST_PORT + 1):
            with suppress(OSError):
                return _Http((host, number), self._handler(), family=socket.getaddrinfo(host, number)[0][0])
            if port is not None:
                break
        raise ArgumentError(f"--host {host}: no port is free. Name one with --port.")

    def _answer(self, path: str, hosts: list[str]) -> tuple[HTTPStatus, bytes]:
        given = path.removeprefix("/").partition("?")[0].rstrip("/")
        if not hmac.compare_digest(given.encode(errors="replace"), self._token.encode()):
            return HTTPStatus.FORBIDDEN, _REFUSED
        # A page that leads a name of its own here would be asked by that name.
        if len(hosts) != 1 or not is_own_host(self._host, hosts[0]):
            return HTTPStatus.FORBIDDEN, _REFUSED
        with self._lock:
            return HTTPStatus.OK, self._page().encode(errors="backslashreplace")

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        answer = self._answer

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                status, content = answer(self.path, self.headers.get_all("Host", []))
                kind = "text/html" if status is HTTPStatus.OK else "text/plain"
                with suppress(ConnectionError):  # A browser that goes meanwhile is no mistake.
                    self.send_response(status)
                    self.send_header("Content-Type", f"{kind}; charset=utf-8")
                    self.send_header("Content-Length", str(len(content)))
                    self.send_header("Cache-Control", "no-store")
                    self.send_header("Referrer-Policy", "no-referrer")
                    self.send_header("Cross-Origin-Resource-Policy", "same-origin")
                    self.end_headers()
                    self.wfile.write(content)

            def log_message(self, format: str, *args: object) -> None:
                """Print nothing."""

        return Handler


class _Http(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = False

    def __init__(
        self, address: tuple[str, int], handler: type[BaseHTTPRequestHandler], *, family: socket.AddressFamily
    ) -> None:
        self.address_family = family
        super().__init__(address, handler)
