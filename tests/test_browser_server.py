"""The editor's player in a browser: what is seen moves, controls do what they say, and nobody is in another's way."""

import http.client
import threading
from contextlib import closing

import numpy as np
import pytest

from browser import box_of, chromium, every_drawing, frame_box, open_page, scene_pixels, shown_frame, still, wait_until
from hoi_retarget.errors import ArgumentError
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from synthetic import make
from trajectories import MODELS

pytest.importorskip("viser", reason="viser is not installed")

from hoi_retarget.studio.browser.browser_server import address, open_server, page_content, serve_sessions
from hoi_retarget.studio.browser.player import Player
from hoi_retarget.studio.scene.scene import SceneItem

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture(scope="module")
def content():
    clip = make("carry_box", seconds=4.0)
    return page_content(
        [SceneItem("carry box", retarget(clip, MODELS["unitree_g1"], Config()), MODELS["unitree_g1"], clip)]
    )


@pytest.fixture(scope="module")
def browser():
    with chromium() as started:
        yield started


@pytest.fixture
def server(content):
    started = open_server("test")
    serve_sessions(started, lambda client: Player(client, content))
    yield started
    started.stop()


def players() -> int:
    return sum(thread.name == "player" for thread in threading.enumerate())


def seen_at_rest(page) -> np.ndarray:
    """Return the scene once it is drawn whole."""
    wait_until(lambda: scene_pixels(page).std() > 10, "the canvas is drawn")
    return still(lambda: scene_pixels(page))


def unlike(a: np.ndarray, b: np.ndarray, least: int = 40) -> float:
    """Return the share of two pictures' pixels that differ by more than this."""
    return float((np.abs(a - b).max(axis=2) > least).mean())


def test_the_scene_is_drawn_and_moves_when_played(browser, server):
    page = open_page(browser, address(server))
    before = seen_at_rest(page)
    assert shown_frame(page) == 0
    page.get_by_role("button", name="Play").click()
    wait_until(lambda: shown_frame(page) > 40, "it plays")
    wait_until(lambda: 0.002 < unlike(scene_pixels(page), before) < 0.5, "it moves")
    page.get_by_role("button", name="Pause").click()
    page.get_by_role("button", name="Play").wait_for()
    still(lambda: shown_frame(page))
    page.close()


def test_slider_keys_and_cursor_go_to_their_frames(browser, server):
    page = open_page(browser, address(server))
    wait_until(lambda: page.locator(".mantine-Slider-thumb").count() == 2, "both sliders are there")
    last, thumb = 120, page.locator(".mantine-Slider-thumb").nth(1)

    def at_cursor(frame: int) -> None:
        wait_until(lambda: thumb.get_attribute("aria-valuenow") == str(frame), f"the cursor is at frame {frame}")

    frame_box(page).fill("57")
    at_cursor(57)
    page.mouse.click(700, 200)
    for key, frame in (("ArrowRight", 58), ("ArrowLeft", 57), ("End", last), ("Home", 0)):
        page.keyboard.press(key)
        wait_until(lambda frame=frame: shown_frame(page) == frame, f"{key} shows frame {frame}")
    at_cursor(0)
    curves = box_of(page.locator(".mantine-Slider-root").nth(1))
    height = curves["y"] + 0.5 * curves["height"]
    page.mouse.move(still(lambda: box_of(thumb)["x"]) + 1, height)
    page.mouse.down()
    page.mouse.move(curves["x"] + 0.5 * curves["width"], height, steps=4)
    page.mouse.up()
    wait_until(lambda: abs(shown_frame(page) - last / 2) <= 2, "the cursor was dragged to the middle")
    page.close()


def test_hands_and_objects_are_never_seen_in_different_frames(browser, server):
    """Whatever is drawn after a jump is the frame before or the frame after."""
    page = open_page(browser, address(server))
    seen_at_rest(page)
    page.get_by_label("Follow", exact=True).click()
    page.get_by_label("contacts", exact=True).click()  # Lines, which may come later than what they join.
    page.get_by_label("human's contacts", exact=True).click()
    seen_at_rest(page)

    def jump(frame: int) -> list[np.ndarray]:
        with every_drawing(page) as pictures:
            frame_box(page).fill(str(frame))
            wait_until(lambda: shown_frame(page) == frame, "the frame is shown")
        return pictures

    first, last = jump(70)[-1], jump(115)[-1]
    assert unlike(first, last) > 0.01
    torn = [min(unlike(it, first), unlike(it, last)) for frame in (70, 115, 70, 115) for it in jump(frame)]
    assert len(torn) >= 4
    assert max(torn) < 0.1 * unlike(first, last), torn
    page.close()


def test_layers_can_be_hidden(browser, server):
    page = open_page(browser, address(server))
    before = seen_at_rest(page)
    page.get_by_label("robot", exact=True).click()
    wait_until(lambda: unlike(scene_pixels(page), before) > 0.002, "the robot is gone")
    page.close()


def test_objects_are_see_through_at_a_key_and_hands_are_seen_from_near(browser, server):
    page = open_page(browser, address(server))
    start = seen_at_rest(page)
    frame_box(page).fill("60")  # A frame in which the box is held.
    wait_until(lambda: unlike(scene_pixels(page), start, 25) > 0.002, "another frame is shown")
    page.mouse.click(400, 200)
    for key, what in (("x", "the boxes are see-through"), ("2", "the left hand is near"), ("1", "all is seen again")):
        before = seen_at_rest(page)
        page.keyboard.press(key)
        share = 0.2 if key == "2" else 0.002
        wait_until(lambda before=before, share=share: unlike(scene_pixels(page), before, 25) > share, what)
    page.close()


def test_two_browsers_do_not_disturb_each_other_and_a_closed_one_stops_its_work(browser, server):
    wait_until(lambda: players() == 0, "players of other tests have ended")
    one, two = open_page(browser, address(server)), open_page(browser, address(server))
    wait_until(lambda: players() == 2, "each has a player")
    one.get_by_role("button", name="Play").click()
    wait_until(lambda: shown_frame(one) > 10, "one plays")
    assert shown_frame(two) == 0
    assert two.get_by_role("button", name="Play").count() == 1
    one.close()
    wait_until(lambda: players() == 1, "its player ends")
    frame_box(two).fill("30")
    wait_until(lambda: shown_frame(two) == 30, "the other still answers")
    two.close()
    wait_until(lambda: players() == 0, "the other player ends too")


def test_a_second_server_takes_another_port_and_a_taken_one_is_refused(server):
    second = open_server("second")
    try:
        assert second.get_port() != server.get_port()
        with pytest.raises(ArgumentError, match="--port"):
            open_server("third", port=server.get_port())
    finally:
        second.stop()


def connection(server, token=None, **headers):
    """Connect as a browser does, or another program."""
    from websockets.sync.client import connect

    place = f"ws://localhost:{server.get_port()}/{server.token if token is None else token}"
    return connect(place, subprotocols=["viser-v1"], open_timeout=60, close_timeout=1, **headers)


def test_only_own_pages_and_those_who_know_the_token_are_listened_to(server):
    from websockets.exceptions import InvalidStatus

    port = server.get_port()
    for origin in (None, f"http://localhost:{port}"):
        connection(server, origin=origin).close()
        for token in ("", "x", server.token[:-1], f"{server.token}x", f"?{server.token}", f"x/{server.token}"):
            with pytest.raises(InvalidStatus, match="403"):
                connection(server, token, origin=origin)
    for origin in (
        "http://127.0.0.1:9999",
        f"http://localhost:{port + 1}",
        f"http://127.0.0.1:{port}",  # Asked by another name.
        "http://localhost",
        "http://evil.example",
        f"http://evil.example:{port}",
        f"https://localhost.evil.example:{port}",
        f"http://localhost:{port}@evil.example",
        f"file://localhost:{port}",
        "http://[",
        "null",
        "",
    ):
        with pytest.raises(InvalidStatus, match="403"):
            connection(server, origin=origin)
    with pytest.raises(InvalidStatus, match="403"):  # A name that leads here, which a page chose for itself.
        connection(server, origin="http://evil.example", additional_headers={"Host": "evil.example"})


def test_pages_are_given_to_those_alone_who_know_the_token(server):
    def answer(path: str) -> int:
        with closing(http.client.HTTPConnection("localhost", server.get_port(), timeout=60)) as asked:
            asked.request("GET", path)
            return asked.getresponse().status

    for path in (f"/{server.token}/", f"/{server.token}", f"/{server.token}/?darkMode", f"/{server.token}?darkMode"):
        assert answer(path) == 200
    for path in ("/", "/index.html", "/x/", f"//{server.token}/", f"/?{server.token}", f"/{server.token.swapcase()}/"):
        assert answer(path) == 403
    assert answer(f"/{server.token}/../../etc/passwd") == 404


def test_each_server_has_its_own_token(server):
    second = open_server("second")
    second.stop()
    assert second.token != server.token and len(server.token) > 20
