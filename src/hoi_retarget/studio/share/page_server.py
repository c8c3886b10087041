"""A server of one page and of its requests.

The address holds a secret token: neither another site in the same browser nor another program on this machine can read
the page. The page loads nothing else; the server answers requests for it, and of it where it has any, alone.
"""

import hmac
import json
import secrets
import socket
from collections.abc import Callable
from contextlib import suppress
from email.message import Message
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Lock, Thread
from typing import Any

from hoi_retarget.errors import ArgumentError

LOOPBACK = ("127.0.0.1", "localhost", "::1")  # Hosts that only this machine reaches.
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


_REFUSED = "Open the whole address that was printed, with its token.\n"
_LARGEST_REQUEST = 1_000_000  # [bytes]


class OnePageServer:
    """A server of one page, made anew for every visit where `page` does so."""

    def __init__(
        self,
        page: Callable[[], str],
        answer: Callable[[Any], dict[str, Any]] | None = None,
        *,
        host: str = "127.0.0.1",
        port: int | None = None,
    ) -> None:
        """Start to listen, in threads of its own, at exactly this port or at the first free one from 8080 on.

        `answer` answers requests of the page, which are JSON as their answers are, one after the other. Raises
        `ArgumentError` when the port is taken, or the machine does not have this address.
        """
        check_address(host, port)
        self._token = secrets.token_urlsafe(16)
        self._page, self._answer, self._host, self._lock = page, answer, host, Lock()
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

    def _is_allowed(self, path: str, headers: Message) -> bool:
        """Return whether a request has the token, and is the page's own."""
        given = path.removeprefix("/").partition("?")[0].rstrip("/")
        hosts, origins = headers.get_all("Host", []), headers.get_all("Origin", [])
        return (
            hmac.compare_digest(given.encode(errors="replace"), self._token.encode())
            # A page that leads a name of its own here would send that name.
            and len(hosts) == 1
            and is_own_host(self._host, hosts[0])
            # Only browsers tell an origin. The port may differ from the server's, where it is forwarded.
            and all(origin == f"http://{hosts[0]}" for origin in origins)
        )

    def _got(self) -> tuple[HTTPStatus, str, str]:
        with self._lock:
            return HTTPStatus.OK, "text/html", self._page()

    def _posted(self, content: bytes) -> tuple[HTTPStatus, str, str]:
        if self._answer is None:
            return HTTPStatus.METHOD_NOT_ALLOWED, "text/plain", "This page asks nothing."
        try:
            request = json.loads(content)
        except (ValueError, RecursionError):
            return HTTPStatus.BAD_REQUEST, "text/plain", "Not a request in JSON."
        with self._lock:
            return HTTPStatus.OK, "application/json", json.dumps(self._answer(request), allow_nan=False)

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        server = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send(server._got)

            def do_POST(self) -> None:
                length = self.headers.get("Content-Length", "")
                if not (length.isdecimal() and int(length) <= _LARGEST_REQUEST):
                    return self.send(lambda: (HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "text/plain", "Too long a request."))
                content = self.rfile.read(int(length))
                return self.send(lambda: server._posted(content))

            def send(self, answer: Callable[[], tuple[HTTPStatus, str, str]]) -> None:
                allowed = server._is_allowed(self.path, self.headers)
                status, kind, text = answer() if allowed else (HTTPStatus.FORBIDDEN, "text/plain", _REFUSED)
                content = text.encode(errors="backslashreplace")
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
