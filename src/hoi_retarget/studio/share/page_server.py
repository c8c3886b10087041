"""A server of one page, and the addresses of pages' servers.

The address holds a secret token: neither another site in the same browser nor another program on this machine can read
the page. The page loads nothing else, and the server answers requests for it alone.
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

LOOPBACK = ("127.0.0.1", "localhost", "::1")
"""Hosts that only this machine reaches."""
_ANY = ("0.0.0.0", "::")
FIRST_PORT, MAX_PORT = 8080, 65535  # Taken ports are passed over.


def url(host: str, port: int, token: str) -> str:
    """Return the address to open in a browser."""
    name = "localhost" if host in (*LOOPBACK[:2], *_ANY) else f"[{host}]" if ":" in host else host
    return f"http://{name}:{port}/{token}/"


def is_own_host(host: str, name: str) -> bool:
    """Return whether a server at a host answers to a name: one for this machine alone answers to its names."""
    name = name.rpartition(":")[0] if not name.endswith("]") and ":" in name else name
    return host not in LOOPBACK or name.strip("[]").lower() in LOOPBACK


def check_address(host: str, port: int | None) -> None:
    """Raise `ArgumentError` unless this machine can listen at an address."""
    if port is not None and not 1 <= port <= MAX_PORT:
        raise ArgumentError(f"--port {port}: ports go from 1 to {MAX_PORT}.")
    try:
        kind, _, _, _, where = socket.getaddrinfo(host, port or 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(kind, socket.SOCK_STREAM) as probe:
            with suppress(OSError):
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(where)
    except OSError as error:
        options = f"--host {host}" + ("" if port is None else f" --port {port}")
        advice = "--port away to take a free one" if port else "--host away to listen to this machine alone"
        raise ArgumentError(f"{options}: cannot listen there ({error.strerror or error}). Leave {advice}.") from error


_REFUSED = b"Open the whole address that was printed, with its token.\n"


class OnePageServer:
    """A server of one page, made anew for every visit where `page` does so."""

    def __init__(self, page: Callable[[], str], *, host: str = "127.0.0.1", port: int | None = None) -> None:
        """Start to listen, in threads of its own, at exactly this port or at the first free one from 8080 on.

        Raises `ArgumentError` when the port is taken, or the machine does not have this address.
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
        for number in range(port or FIRST_PORT, MAX_PORT + 1):
            with suppress(OSError):
                return _Http((host, number), self._handler(), family=socket.getaddrinfo(host, number)[0][0])
            if port is not None:
                break
        raise ArgumentError(f"--host {host}: no port is free. Name one with --port.")

    def _answer(self, path: str, hosts: list[str]) -> tuple[HTTPStatus, bytes]:
        given = path.removeprefix("/").partition("?")[0].rstrip("/")
        if not hmac.compare_digest(given.encode(errors="replace"), self._token.encode()):
            return HTTPStatus.FORBIDDEN, _REFUSED
        # A page that leads a name of its own here would send that name.
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
