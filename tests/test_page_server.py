"""The server of one page: it answers who knows its address, with the page as it is then, and nobody else."""

import http.client
from contextlib import closing

import pytest

from hoi_retarget.cli.commands import View
from hoi_retarget.cli.pages import serve
from hoi_retarget.errors import ArgumentError
from hoi_retarget.studio.share.page_server import OnePageServer
from test_share import written


@pytest.fixture
def server():
    visits = iter(range(100))
    started = OnePageServer(lambda: f"visit {next(visits)}")
    yield started
    started.stop()


def answer(server: OnePageServer, path: str, host: str | None = None) -> tuple[int, str]:
    with closing(http.client.HTTPConnection("localhost", server.port, timeout=10)) as asked:
        asked.request("GET", path, headers={} if host is None else {"Host": host})
        got = asked.getresponse()
        return got.status, got.read().decode()


def token_of(server: OnePageServer) -> str:
    return server.address.rstrip("/").rpartition("/")[2]


def test_the_page_is_given_to_those_alone_who_know_the_address(server):
    token = token_of(server)
    for number, path in enumerate((f"/{token}/", f"/{token}", f"/{token}/?a=b")):
        assert answer(server, path) == (200, f"visit {number}"), "and is made for every visit"
    for path in ("/", "/index.html", f"/x/{token}", f"/?{token}", f"/{token.swapcase()}/", f"/{token}x"):
        assert answer(server, path)[0] == 403
    assert answer(server, f"/{token}/../../etc/passwd")[0] == 403


def test_a_name_that_another_page_leads_here_is_refused(server):
    path = f"/{token_of(server)}/"
    for host in ("localhost", f"localhost:{server.port}", "127.0.0.1:9", "[::1]:80", "[::1]"):
        assert answer(server, path, host)[0] == 200
    for host in ("evil.example", f"evil.example:{server.port}", "localhost.evil.example", "x@127.0.0.2", ""):
        assert answer(server, path, host)[0] == 403


def test_a_second_server_takes_another_port_and_a_taken_one_is_refused(server):
    second = OnePageServer(lambda: "")
    second.stop()
    assert second.port != server.port and token_of(second) != token_of(server) and len(token_of(server)) > 20
    with pytest.raises(ArgumentError, match="--port"):
        OnePageServer(lambda: "", port=server.port)


def posted(server: OnePageServer, path: str, content: str, **headers: str) -> tuple[int, str]:
    with closing(http.client.HTTPConnection("localhost", server.port, timeout=10)) as asked:
        asked.request("POST", path, content, headers)
        got = asked.getresponse()
        return got.status, got.read().decode()


def test_requests_of_the_own_page_alone_are_answered():
    server = OnePageServer(lambda: "", lambda request: {"got": request})
    own, path = f"http://localhost:{server.port}", f"/{token_of(server)}/"
    try:
        assert posted(server, path, '{"a": 1}') == (200, '{"got": {"a": 1}}')
        assert posted(server, path, '{"a": 1}', Origin=own)[0] == 200
        for origin in ("http://evil.example", "null", f"{own}0", f"https://localhost:{server.port}"):
            assert posted(server, path, '{"a": 1}', Origin=origin)[0] == 403
        assert posted(server, "/", "{}")[0] == posted(server, path, "{}", Host="evil.example")[0] == 403
        for broken in ("{", "\xff", "[" * 100_000):
            assert posted(server, path, broken)[0] == 400
        # It is refused by its length, before it comes: who sends it all may find the connection closed.
        assert posted(server, path, "", **{"Content-Length": "1000001"})[0] == 413
    finally:
        server.stop()


def test_a_page_without_requests_answers_none(server):
    assert posted(server, f"/{token_of(server)}/", "{}")[0] == 405


@pytest.mark.slow
def test_a_page_that_is_reloaded_shows_the_files_as_they_are_then(tmp_path, capsys):
    one, two = written(tmp_path, "one.npz"), tmp_path / "two.npz"
    two.write_bytes(one.read_bytes()[:5000])
    with serve(View(results=(one, two))) as server:
        path = f"/{token_of(server)}/"
        first = answer(server, path)[1]
        assert "two.npz: not a readable .npz" in first and "jerk over time" in first
        assert answer(server, path)[1] == first
        two.write_bytes(one.read_bytes())
        second = answer(server, path)[1]
        assert "two.npz: not" not in second and ">two</" in second
        one.write_bytes(b"PK")
        two.unlink()
        third = answer(server, path)[1]
        assert "Nothing can be shown" in third and "one.npz" in third and "<canvas" not in third
    assert capsys.readouterr().err.count("two.npz: not a readable") == 1, "it is told once"
