"""Shared pages: they hold what the scene holds, leak nothing, replace only their own, and play offline."""

import base64
import errno
import functools
import gzip
import html
import json
import os
import re
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from browser import PATIENCE_MS, box_of, chromium, still, wait_until
from hoi_retarget.cli import main
from hoi_retarget.clip.clip import Source
from hoi_retarget.errors import ArgumentError, DrawingError, HoiRetargetError, WriteError
from hoi_retarget.evaluation import FIGURES, Score
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.motion_report import Report
from hoi_retarget.motion.result_file import save
from hoi_retarget.numerics import se3
from hoi_retarget.studio.offscreen.film import webp
from hoi_retarget.studio.offscreen.robot_portraits import png, representative_frame
from hoi_retarget.studio.scene.camera import fit_camera
from hoi_retarget.studio.scene.drawing import DrawnScene, Kind, Layer, Lines, Shapes, Solid, Subject
from hoi_retarget.studio.scene.scene import SceneItem, group_people, make_scene
from hoi_retarget.studio.share import share
from hoi_retarget.studio.share.clip_page import SMALL, BackLink, Detail, make_clip_page
from hoi_retarget.studio.share.gallery import Card, GalleryEntry, file_name, index_page
from hoi_retarget.studio.share.packed_scene import MAX_FRAMES, POSITION_STEP, pack
from hoi_retarget.studio.share.share import LISTING, gallery_in
from synthetic import make
from test_curves import G1, carried, random_motion

AHEAD = np.array([1.0, 0.0])
PIXELS = png(np.full((405, 720, 3), 200, np.uint8))
NASTY = """<script>alert("1")</script> & '$title' </script><img src=x onerror=alert(2)>"""


# What the player does with a packed scene, once more.


def unpacked(numbers: bytes, track: dict) -> np.ndarray:
    at, frames, width = track["at"], track["frames"], track["width"]
    count = frames * width
    low, high = (np.frombuffer(numbers, np.uint8, count, at + part * count).astype(np.uint16) for part in (0, 1))
    changes = (low | high << 8).reshape(width, frames)
    levels = np.cumsum(np.cumsum(changes, axis=1, dtype=np.uint16), axis=1, dtype=np.uint16)
    return track["low"] + track["step"] * levels.T


def content(scene: DrawnScene) -> tuple[dict, bytes]:
    packed = json.loads(pack(scene, *2 * [fit_camera(scene, AHEAD)]))
    return packed, gzip.decompress(base64.b64decode(packed["numbers"]))


def scene_of(*parts: Shapes | Solid | Lines, frames: int) -> DrawnScene:
    return DrawnScene((Subject("subject", 30.0, (Layer("layer", parts),), np.zeros((frames, 3))),))


def random_turns(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return se3.exp(rng.normal(size=(*shape, 3), scale=2.0))


@settings(max_examples=30, deadline=None)
@given(frames=st.integers(1, 40), copies=st.integers(1, 5), size=st.floats(0.0, 50.0), seed=st.integers(0, 99))
def test_a_packed_shape_is_where_it_was(frames: int, copies: int, size: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    shapes = Shapes(
        kind=Kind.CYLINDER,
        sizes=rng.uniform(0.01, 0.5, size=(copies, 3)),
        colours=rng.integers(0, 256, size=(copies, 3)).astype(np.uint8),
        positions=rng.normal(size=(frames, copies, 3), scale=size),
        quats=random_turns(rng, frames, copies),
        visible=rng.random(size=(frames, copies)) < 0.5,
    )
    packed, numbers = content(scene_of(shapes, frames=frames))
    (part,) = packed["subjects"][0]["layers"][0]["parts"]
    assert part["count"] == copies
    positions = unpacked(numbers, part["positions"]).reshape(-1, copies, 3)
    exact = max(POSITION_STEP, np.ptp(shapes.positions) / 65535)
    assert np.abs(positions - shapes.positions).max() <= 0.51 * exact
    quats = unpacked(numbers, part["quats"]).reshape(-1, copies, 4)
    assert np.abs(np.abs(np.einsum("tni,tni->tn", quats, shapes.quats)) - 1.0).max() < 1e-3
    assert (np.einsum("tni,tni->tn", quats[1:], quats[:-1]) > -1e-3).all(), "the shorter way round"
    assert np.array_equal(unpacked(numbers, part["colours"]).round().reshape(copies, 3), shapes.colours)
    visible = unpacked(numbers, part["visible"]) > 0.5 if "visible" in part else True
    assert np.all(visible == shapes.visible)


@settings(max_examples=20, deadline=None)
@given(corners=st.integers(3, 300), count=st.integers(1, 400), scale=st.floats(0.01, 20.0), seed=st.integers(0, 99))
def test_a_packed_mesh_has_the_same_triangles(corners: int, count: int, scale: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    faces = np.array([rng.choice(corners, size=3, replace=False) for _ in range(count)])
    still = np.zeros((4, 3)), random_turns(rng, 1).repeat(4, axis=0)
    solid = Solid(scale * rng.normal(size=(corners, 3)), faces, (200, 100, 0), *still)
    packed, numbers = content(scene_of(solid, replace(solid, vertices=2.0 * solid.vertices), frames=4))
    one, other = packed["subjects"][0]["layers"][0]["parts"]
    vertices = unpacked(numbers, one["sizes"])[0, 0] * unpacked(numbers, one["vertices"]).reshape(-1, 3)
    assert np.abs(vertices - solid.vertices).max() < 1e-4 * np.abs(solid.vertices).max()
    kept = {cyclic(face) for face in unpacked(numbers, one["faces"]).round().astype(int)}
    assert kept == {cyclic(face) for face in faces}, "and the same way round"
    assert one["vertices"]["at"] == other["vertices"]["at"], "one mesh in two sizes is kept once"


def cyclic(face: np.ndarray) -> tuple[int, ...]:
    return tuple(np.roll(face, -int(face.argmin())).tolist())


def test_of_a_long_motion_every_so_many_frames_are_kept() -> None:
    frames = 2 * MAX_FRAMES + 10
    positions = np.linspace(0.0, 1.0, frames)[:, None, None] * np.ones((1, 1, 3))
    ball = Shapes(Kind.SPHERE, np.ones((1, 3)), np.zeros((1, 3), np.uint8), positions, random_turns_of(frames))
    packed, numbers = content(scene_of(ball, frames=frames))
    (subject,) = packed["subjects"]
    track = subject["layers"][0]["parts"][0]["positions"]
    assert track["frames"] <= MAX_FRAMES
    assert np.abs(unpacked(numbers, track) - positions[::3, 0]).max() <= 0.51 * POSITION_STEP
    assert packed["seconds"] == pytest.approx((frames - 1) / 30.0) and subject["fps"] == 10.0


def test_a_page_of_a_long_motion_says_that_every_so_many_frames_are_kept() -> None:
    motion, detail = random_motion(90, 0), Detail(40, SMALL.points)
    results = [(entry(motion), SceneItem("carry", motion, G1))]
    assert "one frame in 3;" in make_clip_page("carry", results, detail=detail).text
    assert "one frame in" not in make_clip_page("carry", results).text


def random_turns_of(frames: int) -> np.ndarray:
    return random_turns(np.random.default_rng(0), frames, 1)


@settings(max_examples=200, deadline=None)
@given(titles=st.lists(st.text(max_size=120), max_size=6))
def test_names_of_files_are_plain_and_different(titles: list[str]) -> None:
    names: list[str] = []
    for title in titles:
        names.append(file_name(title, ("index", *names)))
    assert all(re.fullmatch(r"[A-Za-z0-9_-]{1,100}", name) for name in names)
    assert len({"index", *(name.casefold() for name in names)}) == len(names) + 1


@pytest.mark.parametrize("aspect", [0.6, 1.0, 2.0])
def test_everything_is_in_the_picture_of_a_fitted_camera(aspect: float) -> None:
    scene = carried_scene()
    place = fit_camera(scene, AHEAD)
    (subject,) = scene.subjects
    view = np.radians(40.0)
    towards = np.array([np.cos(place.azimuth), np.sin(place.azimuth), 0.0])
    right = np.array([-towards[1], towards[0], 0.0])
    seen = []
    for layer in subject.layers:
        for part in layer.parts if layer.shown else ():
            if not isinstance(part, Lines):
                away = part.positions.reshape(subject.frames, -1, 3) - subject.centre[:, None] - place.shift
                slope = np.tan(view / 2) * (place.distance(aspect, view) - away @ towards)
                seen.append((np.abs(away @ right) < aspect * slope) & (np.abs(away[..., 2]) < slope))
    assert all(inside.mean() > 0.97 for inside in seen)
    # As near as that, and no nearer.
    assert place.distance(aspect, view) < 12.0
    opposite = fit_camera(scene, -AHEAD)
    assert np.cos(opposite.azimuth - place.azimuth) == pytest.approx(-1.0)


@functools.cache
def carried_scene() -> DrawnScene:
    return make_scene([SceneItem("carry", carried(), G1, make("carry_box"))])


# The text of the pages.


def entry(motion: Motion, **more) -> GalleryEntry:
    nothing = dict.fromkeys([figure.name for figure in FIGURES])
    return GalleryEntry(motion, G1.spec, Score("carry", nothing, motion.frames, root_scale=0.75), **more)


def page_of(motion: Motion, *, gallery: str = "Gallery", title: str = "carry", **more) -> str:
    results, back = [(entry(motion, **more), SceneItem(title, motion, G1))], BackLink(gallery, "index.html")
    return make_clip_page(title, results, back=back, notices=more.get("warnings", ())).text


class Skeleton(HTMLParser):
    """The tags of a page with the names of their attributes: all but its text."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, ...]] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, *(name for name, _ in attrs)))


def named(text: str) -> Motion:
    source = Source(f"/home/jane/secret/{text}.pt", "0", text, text)
    return replace(random_motion(9, 0, objects=1), object_names=(text,), report=Report(source=source))


def test_text_of_files_stays_text() -> None:
    def pages(text: str) -> tuple[str, str]:
        more = {"warnings": (text,), "command": text}
        card = Card(text, (entry(named(text), **more),), "a.html", "a.png", "a.webp")
        return page_of(named(text), gallery=text, title=text, **more), index_page(text, [card])

    for nasty, tame in zip(pages(NASTY), pages("tame"), strict=True):
        assert Skeleton(nasty).tags == Skeleton(tame).tags
    scene = carried_scene()
    wicked = replace(scene.subjects[0].layers[0], name=NASTY)
    packed = pack(DrawnScene((replace(scene.subjects[0], layers=(wicked,)),)), *2 * [fit_camera(scene, AHEAD)])
    assert "<" not in packed and json.loads(packed)["subjects"][0]["layers"][0]["name"] == NASTY


@pytest.mark.parametrize("path", ["/home/jane/clips/a.pt", r"C:\Users\jane\clips\a.pt", "clips/jane/a.pt"])
def test_of_paths_the_last_name_is_told(path: str) -> None:
    page = page_of(replace(named("x"), report=Report(source=Source(path))))
    assert "a.pt" in page and "jane" not in page


def test_pages_load_nothing() -> None:
    page = page_of(named("x"))
    assert "http" not in re.sub(r'http-equiv="Content-Security-Policy"', "", page)
    assert not re.findall(r"<(?:script|img|link|iframe)[^>]*\b(?:src|href)=", page)


# Pictures.


@pytest.mark.slow
def test_a_machine_that_cannot_draw_makes_the_same_pages_without_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def blind(*_: object) -> dict[str, bytes]:
        raise DrawingError("This machine cannot draw. Install a way to draw.")

    results = [written(tmp_path, name) for name in ("one.npz", "two.npz")]
    words = [*map(str, results), "--out", str(tmp_path / "out")]
    monkeypatch.setattr(share, "thumbnails", lambda *_: {".png": PIXELS, ".webp": PIXELS})
    assert main(["share", *words]) == 0
    seen = {path.name: path.read_bytes() for path in (tmp_path / "out").glob("*.html")}
    assert seen.pop("index.html").count(b"<img") == 2
    assert (tmp_path / "out" / "one.png").read_bytes() == PIXELS
    monkeypatch.setattr(share, "thumbnails", blind)
    capsys.readouterr()
    assert main(["share", *words]) == 0
    assert capsys.readouterr().err.count("Install a way to draw") == 1, "it is said once"
    pages = {path.name: path.read_bytes() for path in (tmp_path / "out").glob("*.html")}
    index = pages.pop("index.html")
    assert pages == seen
    assert b"<img" not in index and index.count(b'class="card"') == 2
    assert not list((tmp_path / "out").glob("*.png"))


def test_the_representative_frame_lies_in_the_longest_contact() -> None:
    motion = carried()
    flags = np.zeros_like(motion.contact_flags)
    flags[10:14, 0] = flags[50:91, 1] = True
    touched, points = np.zeros_like(motion.contact_object), np.zeros_like(motion.contact_points)
    contacts = {"contact_flags": flags, "contact_object": touched, "contact_points": points}
    assert representative_frame(replace(motion, **contacts)) == 70
    assert representative_frame(replace(motion, contact_flags=np.zeros_like(flags))) == motion.frames // 2


# People with one object.

MOVED = st.lists(st.tuples(st.sampled_from(["", "table", "box"]), st.integers(0, 2)), max_size=12)


@given(motions=MOVED)
def test_whoever_is_shown_together_moves_the_same_objects_and_is_somebody_else(motions: list[tuple[str, int]]) -> None:
    hosts = group_people([objects for objects, _ in motions], [person for _, person in motions])
    assert all(hosts[host] == host <= index for index, host in enumerate(hosts))
    groups = [[motion for motion, other in zip(motions, hosts, strict=True) if other == host] for host in set(hosts)]
    for group in groups:
        assert len({objects for objects, _ in group}) == 1
        assert len({person for _, person in group}) == len(group)
        assert len(group) == 1 or group[0][0]
    # No two pages where one would do.
    for objects in {objects for objects, _ in motions} - {""}:
        most = max(motions.count((objects, person)) for person in range(3))
        assert sum(group[0][0] == objects for group in groups) == most


def people(folder: Path) -> list[Path]:
    """Write results of two people who move one box, and one of somebody who moves it elsewhere."""
    motion = carried()
    elsewhere = replace(motion, object_pos=motion.object_pos + np.array([0.0, 1.0, 0.0]))
    found = []
    for name, each, person in (("carry.p0", motion, 0), ("carry.p1", motion, 1), ("other.p1", elsewhere, 1)):
        found.append(folder / f"{name}.npz")
        save(replace(each, report=replace(each.report, person=person, source=Source("/nowhere", "0"))), found[-1])
    return found


def test_robots_of_people_with_one_object_share_a_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setattr(share, "thumbnails", lambda *_: {".png": PIXELS, ".webp": PIXELS})
    people(tmp_path / "results")
    out = tmp_path / "out"
    assert main(["share", str(tmp_path / "results"), "--out", str(out)]) == 0
    assert "3 motions in" in capsys.readouterr().out
    assert {path.name for path in out.glob("*.html")} == {"carry.html", "other-p1.html", "index.html"}
    index = (out / "index.html").read_text()
    assert index.count('class="card"') == 2 and f"{G1.spec.title} and {G1.spec.title}" in index
    page = (out / "carry.html").read_text()
    scene = json.loads(re.search(r'<script id="scene" type="application/json">(.*?)</script>', page, re.DOTALL)[1])
    assert [subject["title"] for subject in scene["subjects"]] == ["G1, person 0, G1, person 1"], "in one scene"
    assert [layer["name"] for layer in scene["subjects"][0]["layers"]].count("object") == 1
    assert '<th class="number">G1, person 0</th>' in page and '<th class="number">G1, person 1</th>' in page


# Folders.


def shared(out: Path, *titles: str) -> None:
    motion = carried()
    with gallery_in(out, "Gallery") as gallery:
        for title in titles:
            gallery.add(title, [(entry(motion), SceneItem("G1", motion, G1, make("carry_box")))])


@pytest.mark.slow
def test_a_gallery_replaces_an_earlier_one_and_nothing_else(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "gallery"
    shared(out, "a", "A")
    first = {path.name: path.read_bytes() for path in out.iterdir()}
    assert {"index.html", "a.html", "A-2.html", LISTING} <= set(first)
    shared(out, "b")
    assert (out / "b.html").exists() and not (out / "a.html").exists()
    shared(out, "a", "A")
    assert {path.name: path.read_bytes() for path in out.iterdir()} == first, "the same pages again"
    (out / "notes.txt").write_text("mine")
    with pytest.raises(ArgumentError, match=r"notes\.txt"):
        shared(out, "b")
    assert (out / "notes.txt").read_text() == "mine" and (out / "a.html").exists()
    assert [path.name for path in out.parent.iterdir()] == ["gallery"]


def test_other_folders_and_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / LISTING).write_text('{"files": 3}')
    for name in ("file", "folder"):
        with pytest.raises(ArgumentError, match="Name a folder"):
            shared(tmp_path / name, "a")


def test_a_failure_leaves_what_was_there(tmp_path: Path) -> None:
    out = tmp_path / "gallery"
    shared(out, "a")
    with pytest.raises(HoiRetargetError, match="halfway"), gallery_in(out, "Gallery") as gallery:
        gallery.add("b", [(entry(carried()), SceneItem("b", carried(), G1))])
        raise HoiRetargetError("halfway")
    assert (out / "a.html").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["gallery"]


def test_a_gallery_can_be_where_one_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    shared(Path(), "a")
    assert (tmp_path / "here" / "a.html").exists()


# The command.


def written(folder: Path, name: str = "carry_box.npz", **report: object) -> Path:
    motion = carried()
    known = {"source": replace(motion.report.source, path="builtin:carry_box"), **report}
    path = folder / name
    save(replace(motion, report=replace(motion.report, **known)), path)
    return path


def test_share_writes_pages_of_results(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = {"clips": [f"{tmp_path}/jane's.pt"], "objects": f"{tmp_path}/objects", "robot": "unitree_g1"}
    result = written(tmp_path, command=command)
    assert main(["share", str(result), "--out", str(tmp_path / "out"), "--title", "Two <boxes>"]) == 0
    assert "index.html" in capsys.readouterr().out
    page = (tmp_path / "out" / "carry_box.html").read_text()
    assert "jane's" not in page
    assert """hoi-retarget run 'jane'"'"'s.pt' --objects objects --out results""" in html.unescape(page)
    assert "human&#x27;s object" in page or "human's object" in page
    index = (tmp_path / "out" / "index.html").read_text()
    assert "<h1>Two &lt;boxes&gt;</h1>" in index
    for file in (tmp_path / "out").iterdir():
        assert str(tmp_path).encode() not in file.read_bytes(), f"{file.name} tells where it was made"


def test_share_shows_the_robot_where_the_clip_is_gone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = written(tmp_path, source=Source("/nowhere/clip.pt", "0"))
    assert main(["share", str(result), "--out", str(tmp_path / "out")]) == 0
    assert "without the human" in capsys.readouterr().err
    page = (tmp_path / "out" / "carry_box.html").read_text()
    assert "nowhere" not in page and '"name": "human"' not in page
    assert main(["share", str(result), "--clip", "/nowhere/clip.pt", "--out", str(tmp_path / "out")]) == 1
    assert "/nowhere/clip.pt" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["absent", "garbage", "foreign", "wrong figure", "wrong scale"])
def test_a_result_that_cannot_be_read_costs_its_own_page_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], damage: str
) -> None:
    good, bad = written(tmp_path), tmp_path / "bad.npz"
    if damage == "garbage":
        bad.write_bytes(b"PK garbage")
    elif damage == "foreign":
        written(tmp_path, "bad.npz", figures={"unknown": 1.0})
    elif damage.startswith("wrong"):
        with np.load(good) as archive:
            arrays = dict(archive)
        report = json.loads(str(arrays["report"]))
        report |= {"root_scale": "large"} if damage == "wrong scale" else {"figures": {"contact_gap_m": "small"}}
        np.savez(bad, **{**arrays, "report": np.str_(json.dumps(report))})
    out = tmp_path / "out"
    for results in ([bad], [bad, bad.with_name("none.npz")]):
        assert main(["share", *map(str, results), "--out", str(out)]) == 1
        assert "bad.npz" in capsys.readouterr().err
        assert not out.exists() and not list(tmp_path.glob(".*"))
    assert main(["share", str(bad), str(good), "--out", str(out)]) == 1
    said, error = capsys.readouterr()
    assert "bad.npz" in error and error.count("error: ") == 1
    assert "1 shared, 1 failed." in said
    assert {path.name for path in out.glob("*.html")} == {"carry_box.html", "index.html"}
    assert not list(tmp_path.glob(".*"))


def test_a_gallery_that_cannot_be_put_back_is_kept_and_told_of(tmp_path: Path, monkeypatch) -> None:
    result, out = written(tmp_path), tmp_path / "out"
    assert main(["share", str(result), "--out", str(out)]) == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}

    def refuse(path: Path, target: Path) -> None:
        if target == out:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        rename(path, target)

    rename = Path.rename
    monkeypatch.setattr(Path, "rename", refuse)
    with pytest.raises(WriteError, match=r"It is in (.*old)") as told, gallery_in(out, "again"):
        pass
    kept = Path(re.search(r"It is in (.*old)", str(told.value))[1])
    assert {path.name: path.read_bytes() for path in kept.iterdir()} == before


def test_results_may_be_called_what_no_text_can_hold(tmp_path: Path) -> None:
    name = os.fsdecode(b"caf\xe9.npz")
    result = written(tmp_path, name)
    assert main(["share", str(result), "--out", str(tmp_path / "out")]) == 0
    assert r"<h1>caf\udce9</h1>" in (tmp_path / "out" / "caf.html").read_text()


def test_share_refuses_a_folder_with_other_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = written(tmp_path)
    assert main(["share", str(result), "--out", str(tmp_path)]) == 2
    assert "carry_box.npz" in capsys.readouterr().err
    assert result.exists()


# In a browser.


@pytest.fixture(scope="module")
def browser() -> Iterator:
    with chromium() as opened:
        yield opened


def pixels(picture: bytes) -> np.ndarray:
    import io

    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(int)


@pytest.mark.browser
@pytest.mark.slow
@pytest.mark.parametrize("touch", [False, True])
def test_pictures_move_where_they_are_pointed_at_and_nowhere_else(browser, tmp_path: Path, touch: bool) -> None:
    cards = [Card(name, (entry(named(name)),), "a.html", f"{name}.png", f"{name}.webp") for name in "ab"]
    for card in cards:
        (tmp_path / card.picture).write_bytes(PIXELS)
        (tmp_path / card.film).write_bytes(webp([np.full((90, 160, 3), 20 * k, np.uint8) for k in range(9)], 8.0))
    (tmp_path / "index.html").write_text(index_page("Gallery", cards))
    page = browser.new_context(viewport={"width": 390, "height": 844}, has_touch=touch).new_page()
    page.set_default_timeout(PATIENCE_MS)
    requests: list[str] = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto((tmp_path / "index.html").as_uri())

    def shown() -> list[str]:
        return [image.evaluate("image => image.currentSrc")[-6:] for image in page.locator(".card img").all()]

    wait_until(lambda: shown() == ["/a.png", "/b.png"], "the pictures are there")
    assert not any(url.endswith(".webp") for url in requests), "no film is loaded before it is wanted"
    event = {"pointerType": "touch"} if touch else {}
    for index, expected in enumerate((["a.webp", "/b.png"], ["/a.png", "b.webp"])):
        card = page.locator(".card").nth(index)
        card.dispatch_event("pointerover", event) if touch else card.hover()
        wait_until(lambda expected=expected: shown() == expected, f"card {index} moves, and it alone")
    page.locator("h1").hover()
    wait_until(lambda: shown() == ["/a.png", "/b.png"], "all stand still again")
    page.context.close()


@pytest.mark.browser
@pytest.mark.slow
def test_a_gallery_plays_from_its_folder_without_a_network(
    browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(share, "thumbnails", lambda *_: {".png": PIXELS, ".webp": PIXELS})
    motion = carried()
    with gallery_in(tmp_path / "out", NASTY) as gallery:
        gallery.add(NASTY, [(entry(motion, warnings=(NASTY,)), SceneItem(NASTY, motion, G1, make("carry_box")))])
    context = browser.new_context(viewport={"width": 1000, "height": 800}, offline=True)
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    troubles: list[str] = []
    page.on("pageerror", lambda error: troubles.append(str(error)))
    page.on("console", lambda message: troubles.append(message.text) if message.type == "error" else None)
    # A film that is being loaded when the page is left is not loaded on.
    page.on("requestfailed", lambda request: request.url.endswith(".webp") or troubles.append(request.url))
    page.on("dialog", lambda dialog: troubles.append(dialog.message))
    requests: list[str] = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto((tmp_path / "out" / "index.html").as_uri())
    assert page.locator("h1").inner_text() == NASTY
    picture = page.locator(".card img")
    wait_until(lambda: picture.evaluate("image => image.complete && image.naturalWidth") > 300, "the card's picture")
    page.click(".card")
    clock = page.locator("#clock")
    wait_until(lambda: "frame" in clock.inner_text(), "a first frame")
    assert page.locator("h1").inner_text() == NASTY
    page.click("#play")
    page.locator("#time").fill("40")
    wait_until(lambda: clock.inner_text().endswith("frame 40"), "frame 40")

    def seen() -> np.ndarray:
        return pixels(page.locator("#picture").screenshot())

    def changes(before: np.ndarray, least: float, what: str) -> None:
        wait_until(lambda: (np.abs(seen() - before).max(axis=2) > 20).mean() > least, what)

    early = still(seen)
    assert early.std(axis=(0, 1)).min() > 5, "the picture is not blank"
    page.locator("#time").fill("150")
    wait_until(lambda: clock.inner_text().endswith("frame 150"), "frame 150")
    changes(early, 0.01, "and moves")
    box, plot = box_of(page.locator("#cursor")), box_of(page.locator("#curves .plot").first)
    assert box["x"] - plot["x"] == pytest.approx(plot["width"] * 150 / (motion.frames - 1), abs=2.0)
    page.locator("#show summary").click()
    late = still(seen)
    page.locator("#layers label", has_text="robot").click()
    changes(late, 0.003, "layers can be hidden")
    page.locator("#show summary").click()
    page.locator("h1").click()  # Keys that are pressed on a box are the box's.
    for key, least, what in (
        ("x", 0.002, "objects are see-through"),
        ("2", 0.2, "a hand is near"),
        ("1", 0.2, "and not"),
    ):
        before = still(seen)
        page.keyboard.press(key)
        changes(before, least, what)
    assert troubles == []
    assert all(url.startswith(("file:", "data:")) for url in requests)
    context.close()
