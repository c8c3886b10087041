"""Addresses of pages' servers: which ports, which hosts, and how they are written."""

import socket
from contextlib import suppress

from hoi_retarget.errors import ArgumentError

LOOPBACK = ("127.0.0.1", "localhost", "::1")
"""Hosts that only this machine reaches."""
_ANY = ("0.0.0.0", "::")
FIRST_PORT, LARGEST_PORT = 8080, 65535  # Taken ports are passed over.


def url(host: str, port: int, token: str) -> str:
    """Return the address to open in a browser."""
    name = "localhost" if host in (*LOOPBACK[:2], *_ANY) else f"[{host}]" if ":" in host else host
    return f"http://{name}:{port}/{token}/"


def is_own_host(host: str, asked: str) -> bool:
    """Return whether a server at a host may be asked by a name: one that only this machine reaches, by its names."""
    name = asked.rpartition(":")[0] if not asked.endswith("]") and ":" in asked else asked
    return host not in LOOPBACK or name.strip("[]").lower() in LOOPBACK


def check_address(host: str, port: int | None) -> None:
    """Raise `ArgumentError` unless this machine can listen at an address."""
    if port is not None and not 1 <= port <= LARGEST_PORT:
        raise ArgumentError(f"--port {port}: ports go from 1 to {LARGEST_PORT}.")
    try:
        kind, _, _, _, where = socket.getaddrinfo(host, port or 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(kind, socket.SOCK_STREAM) as probe:
            with suppress(OSError):
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(where)
    except OSError as error:
        asked = f"--host {host}" + ("" if port is None else f" --port {port}")
        advice = "--port away to take a free one" if port else "--host away to listen to this machine alone"
        raise ArgumentError(f"{asked}: cannot listen there ({error.strerror or error}). Leave {advice}.") from error
