"""`hoi-retarget render`, cameras, and the bytes of films; what draws runs in processes of their own.

MuJoCo picks how it draws when it is imported, and the other tests import it without.
"""

import io
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from hoi_retarget.cli import main
from hoi_retarget.errors import ArgumentError, HoiRetargetError
from hoi_retarget.motion.result_file import load, save
from hoi_retarget.studio.offscreen import film
from hoi_retarget.studio.scene.camera import FIELD_OF_VIEW, CameraSettings, cameras
from hoi_retarget.studio.scene.drawing import DrawnScene, Kind, Layer, Shapes, Subject
from hoi_retarget.studio.scene.scene import SceneItem, make_scene, seen_through
from offscreen import need_drawing
from synthetic import make
from test_scene import CLIPS, G1, motion_of, shown

DRAW = """
import json, sys
import numpy as np
from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.studio.scene.camera import Camera
from hoi_retarget.studio.scene.drawing import Kind, Layer, Lines, DrawnScene, Shapes, Solid, Subject
from hoi_retarget.studio.offscreen.renderer import offscreen_renderer

def ball(colour, x, frames=2, **options):
    place = np.tile(np.array([x, 0.0, 1.0], dtype=np.float32), (frames, 1, 1))
    turn = np.tile(np.array([1.0, 0.0, 0.0, 0.0], dtype=np.float32), (frames, 1, 1))
    return Shapes(Kind.SPHERE, np.full((1, 3), 0.3), np.array([colour], dtype=np.uint8), place, turn, **options)

corners = 0.3 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
box = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
                [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])
places = np.array([[0.0, -30.0, 0.5], [0.0, 0.0, 0.5]], dtype=np.float32)
turns = np.tile(np.array([1.0, 0.0, 0.0, 0.0], dtype=np.float32), (2, 1))
sheet = Solid(corners[[0, 1, 5]], np.array([[0, 2, 1]]), (40, 40, 220), places, turns)
thread = Solid(corners[:2], np.array([[0, 1, 1]]), (40, 40, 220), places, turns)
parts = {
    "ball": Layer("ball", (ball((220, 20, 20), 0.0),)),
    "hidden layer": Layer("ball", (ball((220, 20, 20), 0.0),), shown=False),
    "invisible": Layer("ball", (ball((220, 20, 20), 0.0, visible=np.zeros((2, 1), bool)),)),
    "half": Layer("ball", (ball((220, 20, 20), 0.0),), opacity=0.3),
    "box": Layer("box", (Solid(corners, box, (40, 40, 220), places, turns),)),
    "one triangle": Layer("flat", (sheet,)),
    "no triangle": Layer("flat", (thread,)),
    "line": Layer("line", (Lines(*(np.full((2, 1, 3), v, np.float32) for v in (0.8, 1.2)),
                           np.full((2, 1, 3), 10, np.uint8), np.array([[False], [True]])),)),
    "nothing": Layer("nothing", ()),
}
seen = {}
for name, layer in parts.items():
    scene = DrawnScene((Subject("s", 10.0, (layer,), np.zeros((2, 3))),))
    try:
        with offscreen_renderer(scene, 96, 64) as draw:
            for frame in (0, 1):
                camera = Camera(np.array([0.0, 0.0, 1.0]), 4.0, 90.0, -10.0)
                pixels = draw(frame, camera).astype(int)
                seen[f"{name} {frame}"] = [pixels[32, 48].tolist(), int(pixels.min()), pixels[60, 5].tolist()]
    except HoiRetargetError as error:
        sys.exit(f"cannot draw: {error}")
print(json.dumps(seen))
"""


def in_a_process(words, backend="egl", **options):
    need_drawing(backend)
    return subprocess.run(
        [sys.executable, *map(str, words)],
        env={**os.environ, "MUJOCO_GL": backend},
        capture_output=True,
        text=True,
        check=False,
        **options,
    )


# drawing


@pytest.fixture(scope="module", params=["egl", "osmesa"])
def seen(request):
    done = in_a_process(["-c", DRAW], request.param)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_each_kind_of_part_is_where_it_should_be_in_its_frame(seen):
    middle = {name: pixel for name, (pixel, _, _) in seen.items()}
    sky = middle["nothing 0"]
    for red in ("ball 0", "ball 1"):
        assert middle[red][0] > 3 * max(middle[red][1:])
    assert sky == middle["hidden layer 0"] == middle["invisible 1"] == middle["box 0"]
    assert sky[0] > middle["half 0"][1] > middle["ball 0"][1], "what is behind shines through"
    assert middle["line 0"] == sky


def test_solids_move_and_may_be_flat_or_nothing(seen):
    assert seen["box 0"][1] > 100 > seen["box 1"][1], "there is nothing dark until the box comes"
    assert seen["no triangle 1"] == seen["nothing 1"] != seen["one triangle 1"]


def test_lines_are_there_when_they_are_visible(seen):
    assert seen["line 0"][1] > 100


def test_shapes_cast_shadows_and_the_floor_has_no_speckles(seen):
    assert seen["nothing 0"][1] > 170, "floor and sky are bright everywhere"
    assert seen["nothing 0"][2] == seen["nothing 1"][2]


# cameras


def ball_scene(places: np.ndarray) -> DrawnScene:
    """Balls of 10 cm over time, (T, N, 3)."""
    frames, count, _ = places.shape
    turns = np.tile(np.array([1.0, 0.0, 0.0, 0.0]), (frames, count, 1))
    balls = Shapes(Kind.SPHERE, np.full((count, 3), 0.1), np.zeros((count, 3), np.uint8), places, turns)
    return DrawnScene((Subject("balls", 10.0, (Layer("balls", (balls,)),), places.mean(axis=1)),))


@settings(deadline=None, max_examples=30)
@given(
    seed=st.integers(0, 2**32 - 1),
    azimuth=st.floats(-360.0, 360.0),
    elevation=st.floats(-80.0, 20.0),
    aspect=st.floats(0.3, 4.0),
    follow=st.booleans(),
)
def test_everything_is_in_the_picture(seed, azimuth, elevation, aspect, follow):
    rng = np.random.default_rng(seed)
    walk = np.cumsum(0.3 * rng.normal(size=(12, 1, 3)) * [1, 1, 0], axis=0)
    places = walk + rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 2.0], size=(12, 5, 3))
    scene = ball_scene(places)
    (camera,) = cameras([scene], CameraSettings(azimuth, elevation, follow=follow), aspect)
    slope = np.tan(np.radians(FIELD_OF_VIEW / 2))
    for frame, points in enumerate(places):
        placed = camera(frame)
        turn, tilt = np.radians(placed.azimuth), np.radians(placed.elevation)
        ahead = np.array([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)])
        right = np.array([np.sin(turn), -np.cos(turn), 0.0])
        seen_from = points - (placed.point - placed.distance * ahead)
        depth = seen_from @ ahead
        assert (np.abs(seen_from @ right) + 0.1 <= slope * aspect * depth + 1e-9).all()
        assert (np.abs(seen_from @ np.cross(right, ahead)) + 0.1 <= slope * depth + 1e-9).all()


def test_a_fixed_camera_stays_and_one_that_follows_keeps_its_height_and_distance():
    places = np.linspace([0.0, 0.0, 0.0], [6.0, 0.0, 1.0], 20)[:, None]
    for follow in (True, False):
        (camera,) = cameras([ball_scene(places)], CameraSettings(90.0, follow=follow), 1.0)
        points = np.array([camera(frame).point for frame in range(20)])
        assert np.ptp(points[:, 0]) == pytest.approx(6.0 if follow else 0.0)
        assert np.ptp(points[:, 1:]) + np.ptp([camera(frame).distance for frame in range(20)]) >= 0.0
        assert np.ptp(points[:, 2]) == 0.0


def test_panels_have_one_scale_and_one_floor():
    small, large = ball_scene(np.full((3, 1, 3), 0.5)), ball_scene(np.full((3, 1, 3), 2.5))
    first, second = cameras([small, large], CameraSettings(90.0), 1.0)
    assert first(0).distance == second(0).distance and first(0).point[2] == second(0).point[2]


def test_a_hand_is_seen_from_near_wherever_it_goes():
    scenes = film.panels([shown(0)])
    view = CameraSettings(30.0, look="left hand")
    for scene, camera in zip(scenes, cameras(scenes, view, 0.85), strict=True):
        (subject,) = scene.subjects
        for frame in range(scene.frames):
            placed = camera(frame)
            np.testing.assert_array_equal(placed.point, subject.look_at_targets["left hand"][frame])
            assert placed.distance < 1.0
    far = cameras(scenes, CameraSettings(30.0, look="left hand", distance=2.0), 0.85)[0](0)
    assert far.distance == 2.0


def test_objects_alone_are_see_through():
    (subject,) = seen_through(make_scene([shown(0)])).subjects
    opacities = {layer.name: layer.opacity for layer in subject.layers}
    assert opacities["object"] == opacities["human's object"] < 0.5
    assert opacities["robot"] == opacities["human"] == opacities["contacts"] == 1.0


def test_the_distance_may_be_told():
    (camera,) = cameras([ball_scene(np.zeros((3, 1, 3)))], CameraSettings(90.0, distance=7.5), 1.0)
    assert camera(1).distance == 7.5


# panels


def names_shown(scene: DrawnScene) -> list[set[str]]:
    return [{layer.name for layer in subject.layers if layer.shown} for subject in scene.subjects]


ROBOT, HUMAN = {"robot", "object", "contacts", "inside something"}, {"human", "human's object", "human's contacts"}


def test_panels_are_the_human_once_and_every_robot():
    filmed = film.panels([shown(1), shown(2)])
    assert [names_shown(scene) for scene in filmed] == [[HUMAN], [ROBOT], [ROBOT]]
    assert [names_shown(scene) for scene in film.panels([shown(1)], "robot")] == [[ROBOT]]
    assert [names_shown(scene) for scene in film.panels([shown(1)], "human")] == [[HUMAN]]


def test_two_people_are_in_one_panel():
    filmed = film.panels([shown(1, "carry_table", person=0), shown(2, "carry_table", person=1)])
    assert [len(scene.subjects) for scene in filmed] == [2, 2]
    assert names_shown(filmed[0])[1] == HUMAN - {"human's object"}


def test_without_a_clip_there_is_the_robot_alone():
    alone = SceneItem("one", motion_of(CLIPS["carry_box"], 0), G1)
    assert [names_shown(scene) for scene in film.panels([alone])] == [[ROBOT]]
    with pytest.raises(ArgumentError, match="no human"):
        film.panels([alone], "human")


def test_the_camera_faces_whom_it_sees():
    clip = make("carry_box", seconds=1.0)
    (azimuth,) = {film.good_azimuth([SceneItem("clip", clip=clip)])}
    ahead = np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth))])
    towards = (clip.objects[0].positions - clip.people[0].position("pelvis"))[0, :2]
    assert ahead @ towards < -0.3 * np.linalg.norm(towards), "against where the person looks, who goes to the box"


def test_times_cover_the_motion():
    filmed = film.panels([shown(0)])
    length = film.duration(filmed)
    assert length == pytest.approx((CLIPS["carry_box"].frames - 1) / CLIPS["carry_box"].fps)
    times = film.film_times(filmed, 10.0)
    assert (times[0], times[-1], len(times)) == (0.0, pytest.approx(length), CLIPS["carry_box"].frames)
    sheet = film.sheet_times(filmed, 4)
    np.testing.assert_allclose(np.diff([0.0, *sheet, length]), length / 4 * np.array([0.5, 1, 1, 1, 0.5]))


# files


def coloured(count: int, size: int = 64) -> list[np.ndarray]:
    pictures = []
    for index in range(count):
        picture = np.full((size, size, 3), 230, np.uint8)
        picture[8:24, 4 * index : 4 * index + 16] = (200, 40, 30)
        picture[40:44, 40:44] = (40, 180, 80)
        pictures.append(picture)
    return pictures


@pytest.mark.parametrize("fps", [7.0, 12.5, 15.0, 30.0])
def test_a_gif_has_the_pictures_their_colours_and_the_time(fps):
    pictures = coloured(9)
    image = Image.open(io.BytesIO(film.gif(iter(pictures), pictures[:3], fps)))
    assert (image.size, image.n_frames, image.info["loop"]) == ((64, 64), 9, 0)
    length = 0
    for index, picture in enumerate(pictures):
        image.seek(index)
        length += image.info["duration"]
        assert np.abs(np.asarray(image.convert("RGB")).astype(int) - picture).max() < 16
    assert length == pytest.approx(9000 / fps, abs=10)


@pytest.mark.parametrize("fps", [7.0, 15.0])
def test_an_animated_webp_has_the_pictures_and_the_time(fps):
    pictures = coloured(9)
    image = Image.open(io.BytesIO(film.webp(iter(pictures), fps)))
    assert (image.size, image.n_frames, image.info["loop"]) == ((64, 64), 9, 0)
    length = 0
    for index, picture in enumerate(pictures):
        image.seek(index)
        seen = np.asarray(image.convert("RGB")).astype(int)  # Its time is known once it is decoded.
        length += image.info["duration"]
        assert np.abs(seen - picture).mean() < 6
    assert length == pytest.approx(9000 / fps, abs=2)


def decoded(path: Path, size: tuple[int, int]) -> tuple[np.ndarray, str]:
    """Return a video's pictures and what ffmpeg says of it."""
    program = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    words = [program, "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(words, capture_output=True, check=True)
    return np.frombuffer(done.stdout, np.uint8).reshape(-1, size[1], size[0], 3), done.stderr.decode()


@pytest.mark.slow
def test_an_mp4_has_the_pictures_and_the_rate(tmp_path):
    path = tmp_path / "film.mp4"
    path.write_bytes(film.mp4(iter(coloured(12)), 24.0))
    pictures, told = decoded(path, (64, 64))
    assert "h264" in told and "yuv420p" in told and "64x64" in told and "24 fps" in told
    assert len(pictures) == 12
    assert np.abs(pictures[5].astype(int) - coloured(6)[5]).mean() < 12


def test_a_video_that_cannot_be_encoded_is_told():
    odd = [picture[:63, :63] for picture in coloured(40, 640)]
    with pytest.raises(HoiRetargetError, match=r"could not be encoded: .*divisible by 2"):
        film.mp4(iter(odd), 24.0)


def test_an_mp4_without_its_package_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(HoiRetargetError, match=r"pip install \"imageio-ffmpeg"):
        film.mp4(iter(coloured(1)), 24.0)


# the command


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A result that knows its clip, one that does not, one of another robot, and a damaged one."""
    folder = tmp_path_factory.mktemp("results")
    clip = make("carry_box")
    motion = motion_of(clip, 0)
    source = replace(clip.source, path="builtin:carry_box")
    save(replace(motion, report=replace(motion.report, source=source)), folder / "good.npz")
    lost = replace(clip.source, path="")
    save(replace(motion, report=replace(motion.report, source=lost)), folder / "lost.npz")
    shorter = tuple(replace(stage, qpos=stage.qpos[:, :-1]) for stage in motion.stages)
    save(replace(motion, joint_names=motion.joint_names[:-1], stages=shorter), folder / "other.npz")
    (folder / "damaged.npz").write_bytes((folder / "good.npz").read_bytes()[:5000])
    return folder


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["--out", "x.png"], 2, "no result is named"),
        (["good.npz", "--out", "x.avi"], 2, "--out x.avi: name a file that ends in .mp4, .gif, .webp or .png"),
        (["good.npz", "--out", "x.gif", "--frame", "3"], 2, "--frame 3: this is for .png files"),
        (["good.npz", "--out", "x.png", "--fps", "3"], 2, "--fps 3.0: this is for .mp4, .gif and .webp files"),
        (["good.npz", "--out", "x.png", "--frame", "3", "--frames", "4"], 2, "both --frame and --frames"),
        (["good.npz", "--out", "x.png", "--frames", "0"], 2, "--frames 0: it must be a positive number up to 28"),
        (["good.npz", "--out", "x.gif", "--fps", "1e9"], 2, "--fps 1000000000.0: it must be a positive number up to"),
        (["good.npz", "--out", "x.png", "--azimuth", "nan"], 2, "--azimuth nan: it must be a number of degrees"),
        (["other.npz", "--out", "x.png", "--clip", "builtin:carry_box"], 1, "its joints are not the model's"),
        (["good.npz", "--out", "x.png", "--distance", "-2"], 2, "--distance -2.0: it must be a positive number"),
        (["good.npz", "--out", "x.png", "--frame", "999"], 2, "--frame 999: the motion has the frames 0 to"),
        (["good.npz", "--out", "x.png", "--size", "12"], 2, "--size 12: give width and height"),
        (["good.npz", "--out", "x.png", "--size", "20x99999"], 2, "--size 20x99999: give width and height"),
        (["good.npz", "--out", "x.mp4", "--size", "321x200"], 2, "--size 321x200: the width and the height"),
        (["good.npz", "--out", "good.npz/x.png"], 2, "--out good.npz: cannot write there"),
        (["absent.npz", "--out", "x.png"], 1, "absent.npz: there is no such file"),
        (["damaged.npz", "--out", "x.png"], 1, "damaged.npz: not a readable .npz motion file"),
        (["good.npz", "--out", "x.png", "--clip", "absent.pt"], 1, "absent.pt"),
        (["good.npz", "--out", "x.png", "--clip", "builtin:push_table"], 2, "Name the clip that the result was made"),
        (["lost.npz", "--out", "x.png", "--only", "human"], 1, "does not say which clip"),
    ],
)
def test_what_cannot_be_drawn_is_one_line(words, code, message, results, monkeypatch, capsys):  # noqa: PLR0917
    monkeypatch.chdir(results)
    assert main(["render", *words]) == code
    out, err = capsys.readouterr()
    assert message in err and err.startswith("error: ") and err.count("\n") == 1 and out == ""
    assert sorted(path.name for path in results.iterdir()) == ["damaged.npz", "good.npz", "lost.npz", "other.npz"]


def test_mp4_without_its_package_is_told_before_anything_is_read(results, monkeypatch, capsys):
    monkeypatch.setattr("hoi_retarget.errors.find_spec", lambda name: None)
    assert main(["render", "absent.npz", "--out", "x.mp4"]) == 1
    assert 'pip install "imageio-ffmpeg' in capsys.readouterr().err


def render(folder: Path, *words: object, backend: str = "egl") -> subprocess.CompletedProcess:
    return in_a_process(["-m", "hoi_retarget", "render", *words], backend, cwd=folder)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "size"),
    [
        (["--out", "o/sheet.png", "--frames", "3", "--size", "300x160"], (300, 160)),
        (["--out", "o/one.png", "--frame", "20", "--size", "200x90"], (200, 90)),
        (["--out", "o/near.png", "--look-at", "left_hand", "--see-through", "--size", "300x160"], (300, 160)),
        (["--out", "o/film.gif", "--fps", "2", "--size", "128x64"], (128, 64)),
        (["--out", "o/film.webp", "--fps", "2", "--size", "128x64"], (128, 64)),
        (["--out", "o/fixed.gif", "--fps", "2", "--size", "128x64", "--camera", "fixed"], (128, 64)),
    ],
)
def test_pictures_and_films_are_written(words, size, results, tmp_path):
    done = render(tmp_path, results / "good.npz", *words)
    assert done.returncode == 0, done.stderr
    # How far it is is told where that takes long.
    assert all(line.startswith("drawing: ") for line in done.stderr.splitlines())
    assert done.stdout.startswith(f"written: {words[1]}")
    pictures = int((make("carry_box").frames - 1) / 30 * 2) + 1 if words[1].endswith(("gif", "webp")) else 1
    with Image.open(tmp_path / words[1]) as image:
        assert image.size == size
        assert getattr(image, "n_frames", 1) == pictures
        assert np.asarray(image.convert("RGB")).std() > 15
    assert [path.name for path in (tmp_path / "o").iterdir()] == [Path(words[1]).name]


@pytest.mark.slow
def test_several_results_are_beside_each_other_and_named(results, tmp_path):
    words = ["--frame", "0", "--size", "300x200", "--only", "robot", "--clip", "builtin:carry_box"]
    (tmp_path / "other.npz").write_bytes((results / "good.npz").read_bytes())
    one = render(tmp_path, results / "good.npz", *words, "--out", "one.png")
    two = render(tmp_path, results / "good.npz", "other.npz", *words, "--out", "two.png")
    assert (one.returncode, two.returncode) == (0, 0), one.stderr + two.stderr
    with Image.open(tmp_path / "two.png") as image:
        pixels = np.asarray(image).astype(int)
    left, right = pixels[:, :150], pixels[:, 150:]
    assert np.abs(left - right)[:170].max() == 0, "the same motion, seen from the same side"
    assert np.abs(left - right)[170:].max() > 50, "under another name"


@pytest.mark.slow
def test_a_video_is_written(results, tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    done = render(tmp_path, results / "good.npz", "--out", "film.mp4", "--fps", "2", "--size", "128x64")
    assert done.returncode == 0, done.stderr
    pictures, told = decoded(tmp_path / "film.mp4", (128, 64))
    assert len(pictures) == int((make("carry_box").frames - 1) / 30 * 2) + 1 and "2 fps" in told


@pytest.mark.slow
def test_a_result_whose_clip_is_lost_is_drawn_alone_with_a_warning(results, tmp_path):
    words = ["--out", "a.png", "--frame", "0", "--size", "64x64"]
    done = render(tmp_path, results / "lost.npz", *words)
    assert done.returncode == 0
    assert done.stderr.startswith("warning: lost.npz: drawn without the human") and "--clip" in done.stderr
    named = render(tmp_path, results / "lost.npz", *words[:1], "b.png", *words[2:], "--clip", "builtin:carry_box")
    assert named.returncode == 0 and named.stderr == ""
    assert (tmp_path / "a.png").read_bytes() != (tmp_path / "b.png").read_bytes()


def test_without_a_way_to_draw_there_is_one_line_and_no_file(results, tmp_path):
    if sys.platform != "linux" or os.environ.get("DISPLAY"):
        pytest.skip("there is a screen")
    for backend, advice in (("glfw", "libegl1"), ("nonsense", "Unset MUJOCO_GL")):
        done = subprocess.run(
            [sys.executable, "-m", "hoi_retarget", "render", results / "good.npz", "--out", "x.png", "--frame", "0"],
            env={**os.environ, "MUJOCO_GL": backend},
            capture_output=True,
            text=True,
            check=False,
            cwd=tmp_path,
        )
        assert done.returncode == 1 and done.stderr.count("\n") == 1 and advice in done.stderr
    assert not list(tmp_path.iterdir())


def test_the_motion_of_a_scene_is_not_changed_by_drawing_it(results):
    motion = load(results / "good.npz")
    before = motion.qpos.copy()
    make_scene([SceneItem("one", motion, G1)])
    np.testing.assert_array_equal(motion.qpos, before)
