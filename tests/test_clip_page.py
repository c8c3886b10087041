"""The page that plays results, in a browser: its timeline, its views side by side, and all of it on a phone."""

import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh

from browser import PATIENCE_MS, box_of, chromium, still, wait_until
from hoi_retarget.evaluation.thresholds import verdict_of
from hoi_retarget.motion.motion_report import Event
from hoi_retarget.studio.scene.scene import SceneItem
from hoi_retarget.studio.share.clip_page import make_clip_page
from synthetic import make
from test_curves import G1, carried
from test_share import entry, pixels

pytestmark = [pytest.mark.browser, pytest.mark.slow]
FPS = 30.0
BOX = trimesh.creation.box((1.0, 2.0, 3.0))


@pytest.fixture(scope="module")
def browser() -> Iterator:
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Pages of one result with a warning, and of two to be compared."""
    motion, clip = carried(), make("carry_box")
    unreached = (Event("unreached_contact", 150, 160, 0.05, subject="left_palm", object="box", mean=0.03),)
    worse = replace(motion, report=replace(motion.report, unreached_contacts=unreached))
    folder = tmp_path_factory.mktemp("pages")
    found = {}
    for name, results in {"one": [("G1", worse)], "two": [("before", motion), ("after", worse)]}.items():
        shown = [(judged(each), SceneItem(title, each, G1, clip)) for title, each in results]
        path: Path = folder / f"{name}.html"
        path.write_text(make_clip_page(name, shown).text)
        found[name] = path.as_uri()
    return found


def judged(motion):
    unjudged = entry(motion)
    return replace(unjudged, score=replace(unjudged.score, verdict=verdict_of(motion)))


def opened(browser, address: str, width: int = 1100, height: int = 820, **more):
    page = browser.new_context(viewport={"width": width, "height": height}, **more).new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.troubles = []
    page.on("pageerror", lambda error: page.troubles.append(str(error)))
    page.on("console", lambda told: page.troubles.append(told.text) if told.type == "error" else None)
    page.goto(address)
    wait_until(lambda: "frame" in page.locator("#clock").inner_text(), "a first frame is drawn")
    return page


def closed(page) -> None:
    assert page.troubles == []
    page.context.close()


def second(page) -> float:
    return float(page.locator("#clock").inner_text().split()[0])


def at(page, moment: float) -> None:
    wait_until(lambda: abs(second(page) - moment) < 0.02, f"it shows {moment} s, not {second(page)}")


def stays_between(page, first: float, last: float) -> None:
    """See a range played from its end to its beginning twice, and nothing else."""
    times, before = 0, second(page)
    while times < 2:
        now = second(page)
        assert first < now < last, "it stays in the range"
        times, before = times + (now < before), now
        page.wait_for_timeout(50)


def unlike(a: np.ndarray, b: np.ndarray, least: int = 25) -> float:
    """Return the share of two pictures' pixels that differ by more than this."""
    return float((np.abs(a - b).max(axis=2) > least).mean())


def first_touch() -> float:
    return float(np.flatnonzero(carried().contact_flags.any(axis=1))[0]) / FPS


def test_buttons_keys_and_links_go_to_moments(browser, pages):
    page = opened(browser, pages["one"] + "#t=1.5")
    at(page, 1.5)
    page.locator("#contact-next").click()
    at(page, first_touch())
    page.locator("#warning-next").click()
    at(page, 150 / FPS)
    page.locator("#contact-before").click()
    at(page, first_touch())
    page.locator("h1").click()
    for key, moment in (
        ("w", 150 / FPS),
        ("Shift+C", first_touch()),
        ("End", (carried().frames - 1) / FPS),
        ("Home", 0.0),
    ):
        page.keyboard.press(key)
        at(page, moment)
    chart = page.locator(".chart", has_text="jerk")
    chart.scroll_into_view_if_needed()
    chart.hover(position={"x": 30, "y": 10})
    said = chart.locator(".worst").get_attribute("title")
    chart.locator(".worst").click()
    at(page, float(re.search(r"at ([\d.]+) s", said)[1]))
    largest = float(re.search(r"largest ([\d.e+]+)", said)[1])
    page.mouse.move(5, 5)
    value = chart.locator("b[data-of='largest 0']")
    wait_until(lambda: float(value.inner_text()) == pytest.approx(largest, rel=0.02), "it is the worst")
    closed(page)


def test_the_timeline_is_zoomed_read_and_looped(browser, pages):
    page = opened(browser, pages["one"] + "#t=4")
    timeline, last = page.locator("#curves .time"), (carried().frames - 1) / FPS
    axis = box_of(timeline)
    assert axis["width"] > 0.65 * 1100, "it is as wide as the window, but for names and values"
    bars = page.locator(".bars", has_text="warnings")
    bar = box_of(bars.locator("i"))
    assert bar["x"] - axis["x"] == pytest.approx(axis["width"] * 150 / FPS / last, abs=2.0)
    page.mouse.move(bar["x"] + 2, bar["y"] + 5)
    wait_until(lambda: "left_palm on 'box', frames 150 to 160" in page.locator("#note").inner_text(), "the bar is told")
    values = page.locator("b[data-of='left hand 0']").first
    touching = values.inner_text()
    page.mouse.move(axis["x"] + 5, bar["y"] + 100)
    wait_until(lambda: touching != "" and values.inner_text() == "", "what is under the pointer is read")
    pointer = page.locator("#pointer")
    assert pointer.inner_text() == f"{5 / axis['width'] * last:.2f} s"
    assert box_of(pointer)["x"] == pytest.approx(axis["x"] + 5, abs=1.0)
    page.mouse.move(axis["x"] - 20, bar["y"] + 100)
    wait_until(lambda: not pointer.is_visible(), "beside the curves there is no moment")
    page.mouse.move(axis["x"] + axis["width"] * 4 / last, bar["y"] + 5)
    page.mouse.wheel(0, -700)
    wait_until(lambda: box_of(bars.locator("i"))["width"] > 2.5 * bar["width"], "the wheel over bars zooms")
    cursor = still(lambda: box_of(page.locator("#cursor"))["x"])
    assert cursor == pytest.approx(axis["x"] + axis["width"] * 4 / last, abs=3.0), "about the pointer"
    page.locator("#whole").click()
    wait_until(lambda: abs(box_of(bars.locator("i"))["width"] - bar["width"]) < 1, "all is shown again")
    x, y = (lambda moment: axis["x"] + axis["width"] * moment / last), bar["y"] + 100
    page.keyboard.down("Shift")
    page.mouse.move(x(2.0), y)
    page.mouse.down()
    page.mouse.move(x(2.6), y, steps=3)
    page.mouse.up()
    page.keyboard.up("Shift")
    wait_until(lambda: page.locator("#loop").get_attribute("aria-pressed") == "true", "a range is played")
    page.locator("#play").click()
    wait_until(lambda: second(page) < 2.7, "it goes to the range")
    stays_between(page, 1.9, 2.7)
    page.keyboard.press("Escape")
    wait_until(lambda: second(page) > 2.8, "it goes on")
    closed(page)


def test_the_verdict_is_a_line_that_opens(browser, pages):
    page = opened(browser, pages["one"])
    light = page.locator("details.verdict", has_text="motion")
    said, reasons = light.locator("summary").inner_text(), light.locator("li")
    assert not reasons.first.is_visible()
    light.locator("summary").click()
    wait_until(reasons.first.is_visible, "it opens")
    assert f"{reasons.count()} reason" in said
    assert "unreached contact" in light.inner_text()
    closed(page)
    page = opened(browser, pages["two"])
    lights = page.locator("details.verdict summary").all_inner_texts()
    assert [text.partition(":")[0] for text in lights] == ["before", "before", "after", "after"]
    closed(page)


def test_a_link_can_carry_a_range_that_plays(browser, pages):
    page = opened(browser, pages["one"] + "#t=3.0,3.4")
    stays_between(page, 2.9, 3.5)
    page.locator("#play").click()
    page.locator("#link").click()
    wait_until(lambda: page.evaluate("location.hash") == "#t=3.00,3.40", "the address carries the range")
    closed(page)


def test_cameras_stand_where_they_say_and_a_picture_is_saved(browser, pages):
    page = opened(browser, pages["one"] + "#t=4")
    picture = page.locator("#picture")
    for name in ("front", "top", "home"):
        before = still(lambda: pixels(picture.screenshot()))
        page.locator(f"#{name}").click()
        wait_until(lambda before=before: unlike(pixels(picture.screenshot()), before) > 0.02, name)
    still(lambda: pixels(picture.screenshot()))
    with page.expect_download() as saved:
        page.locator("#shot").click()
    assert saved.value.suggested_filename == "one-4.00s.png"
    shot = pixels(Path(saved.value.path()).read_bytes())
    seen = pixels(picture.screenshot())[: shot.shape[0], : shot.shape[1]]
    assert shot.std() > 10 and np.abs(shot[: seen.shape[0], : seen.shape[1]] - seen).mean() < 3.0
    closed(page)


def test_results_are_side_by_side_with_one_camera_or_over_each_other(browser, pages):
    page = opened(browser, pages["two"] + "#t=4")
    assert page.locator("#labels span").all_inner_texts() == ["human", "before", "after"], "one human"
    page.locator("#show summary").click()

    def whole() -> np.ndarray:
        return pixels(page.locator("#picture").screenshot())[40:]

    def parts_unlike(before: np.ndarray, what: str) -> list[np.ndarray]:
        wait_until(lambda: unlike(whole(), before) > 0.02, what)
        return parts()

    def parts() -> list[np.ndarray]:
        picture = still(whole)
        width = picture.shape[1] // 3
        return [picture[:, k * width : (k + 1) * width] for k in range(3)]

    human, before, after = parts()
    assert np.abs(before - after).max(axis=2).mean() < 2.0, "the same motion is the same picture in both"
    assert unlike(human, before, 40) > 0.02
    seen = whole()
    page.locator("#front").click()
    _, turned, other = parts_unlike(seen, "the camera turns")
    assert unlike(turned, before) > 0.02
    assert np.abs(turned - other).max(axis=2).mean() < 2.0, "one camera turns both"
    seen = whole()
    page.select_option("#look", "left hand")
    _, near, other = parts_unlike(seen, "the camera goes near")
    assert np.abs(near - other).max(axis=2).mean() < 2.0, "and goes near to each one's hand"
    seen = whole()
    page.select_option("#arrange", "over")
    page.select_option("#look", "")
    parts_unlike(seen, "they are over each other")
    over = whole()
    assert page.locator("#labels span").count() == 0
    page.locator("#figures label", has_text="human").click()
    wait_until(lambda: unlike(whole(), over, 15) > 0.001, "the ghost was there")
    closed(page)


@pytest.mark.parametrize("shown", ["one", "two"])
def test_all_curves_are_seen_at_once_on_a_laptop(browser, pages, shown):
    page = opened(browser, pages[shown], 1440, 900)
    hidden = page.locator(".drawer").evaluate("drawer => drawer.scrollHeight - drawer.clientHeight")
    assert hidden <= 1 and page.locator(".chart").count() >= 10
    assert box_of(page.locator("#picture"))["height"] > 250, "and the scene has its room"
    names = [box_of(key) for key in page.locator(".legend .key").all()]
    assert all(one["y"] + one["height"] <= two["y"] + 1 for one, two in pairwise(names)), "no name is over another"
    closed(page)


def test_on_a_phone_curves_are_wide_and_fingers_zoom_the_time(browser, pages):
    page = opened(browser, pages["one"] + "#t=4", 390, 844, has_touch=True, is_mobile=True)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    for plot in page.locator(".plot").all():
        assert box_of(plot)["width"] > 340
    assert not page.get_by_text("Space plays").is_visible() and page.get_by_text("two fingers").is_visible()
    bars = page.locator(".bars", has_text="left hand").locator("i")
    before = box_of(bars)
    page.locator(".plot").nth(2).scroll_into_view_if_needed()
    place = still(lambda: box_of(page.locator(".plot").nth(1)))
    touch = page.context.new_cdp_session(page)

    def fingers(kind: str, *xs: float) -> None:
        points = [{"x": x, "y": place["y"] + 20, "id": number} for number, x in enumerate(xs)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    fingers("touchStart", 180)
    fingers("touchStart", 180, 210)
    for step in range(1, 6):
        fingers("touchMove", 180 - 12 * step, 210 + 12 * step)
    fingers("touchEnd")
    wait_until(lambda: box_of(bars)["width"] > 1.5 * before["width"], "two fingers zoom the time")
    place = box_of(page.locator(".plot").nth(1))
    shown = still(lambda: second(page))
    page.touchscreen.tap(place["x"] + 0.9 * place["width"], place["y"] + 20)
    wait_until(lambda: abs(second(page) - shown) > 0.2, "a tap goes to its moment")
    closed(page)


def test_round_surfaces_are_shaded_round_and_edges_sharp(browser, pages) -> None:
    """Normals of a box are its faces', those of a fine ball point away from its middle."""
    page = opened(browser, pages["one"])
    corners = "([vertices, faces]) => Array.from(solid(Float32Array.from(vertices), Uint32Array.from(faces)))"
    for mesh, expected in ((BOX, "face"), (trimesh.creation.icosphere(subdivisions=3), "place")):
        # Every triangle has vertices of its own, as in STL files.
        triangles = np.asarray(mesh.triangles)
        found = page.evaluate(corners, [triangles.ravel().tolist(), list(range(3 * len(triangles)))])
        places, normals = np.split(np.array(found).reshape(-1, 6), 2, axis=1)
        np.testing.assert_allclose(places, triangles.reshape(-1, 3), atol=1e-6)
        faces = np.repeat(mesh.face_normals, 3, axis=0)
        away = places / np.linalg.norm(places, axis=1, keepdims=True)
        np.testing.assert_allclose(normals, faces if expected == "face" else away, atol=0.02)
        assert expected == "face" or np.abs(faces - away).max() > 0.05, "flat shading would be seen"
    assert not page.troubles
    page.close()
