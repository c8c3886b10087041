"""Pictures of robots; drawing itself runs in a process of its own, because MuJoCo picks its backend at import."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hoi_retarget.errors import ArgumentError, ReadError
from hoi_retarget.robots import ROBOTS
from hoi_retarget.studio.offscreen.robot_portraits import picture, png
from offscreen import need_drawing

MAKER = Path(__file__).resolve().parents[1].parent / "shared" / "data" / "robots"

DRAW = """
import sys
from pathlib import Path
from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.robots import robot
from hoi_retarget.studio.offscreen.robot_portraits import picture
meshes = Path(sys.argv[2]) if len(sys.argv) > 2 else None
try:
    pixels = picture(robot(sys.argv[1]), meshes=meshes, height=200)
except HoiRetargetError as error:
    sys.exit(f"cannot draw: {error}")
print(*pixels.shape, float(pixels[:, :124].std()), float(abs(pixels[:, :124].astype(float) - pixels[:, 124:]).mean()))
print(*pixels[2, 2], *pixels[-2, 2])
"""


def draw(*arguments, backend="egl"):
    if backend == "egl":
        need_drawing(backend)
    return subprocess.run(
        [sys.executable, "-c", DRAW, *map(str, arguments)],
        env={**os.environ, "MUJOCO_GL": backend},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("name", ROBOTS)
def test_picture_shows_a_robot_from_two_sides_before_a_sky(name):
    done = draw(name)
    assert done.returncode == 0, done.stderr
    shape, colors = (line.split() for line in done.stdout.splitlines())
    assert shape[:3] == ["200", "248", "3"]
    assert float(shape[3]) > 15, "the picture is not empty"
    assert float(shape[4]) > 5, "the two views differ"
    red, _, blue, *_ = map(int, colors)
    assert blue > red > 100, "a bright sky above"


@pytest.mark.slow
@pytest.mark.skipif(not MAKER.is_dir(), reason=f"the maker's files are not at {MAKER}")
@pytest.mark.parametrize("name", ROBOTS)
def test_picture_with_the_vendor_meshes(name):
    plain, dressed = draw(name), draw(name, MAKER / {"unitree_g1_dex3": "unitree_g1_hands"}.get(name, name))
    assert dressed.returncode == 0, dressed.stderr
    assert dressed.stdout != plain.stdout


def test_without_a_way_to_draw_the_error_says_what_to_install():
    if sys.platform != "linux" or os.environ.get("DISPLAY"):
        pytest.skip("there is a screen")
    done = draw("unitree_g1", backend="glfw")
    assert done.returncode == 1
    assert "libegl1" in done.stderr and "MUJOCO_GL=osmesa" in done.stderr


def test_missing_meshes_are_named(tmp_path):
    with pytest.raises(ReadError, match=r"35 mesh files of Unitree G1.*pelvis\.STL"):
        picture(ROBOTS["unitree_g1"], meshes=tmp_path)


def test_configuration_of_the_wrong_length():
    with pytest.raises(ArgumentError, match="36 numbers"):
        picture(ROBOTS["unitree_g1"], np.zeros(7))


def test_png_holds_the_pixels():
    image = pytest.importorskip("PIL.Image")
    import io

    pixels = np.random.default_rng(0).integers(0, 255, (4, 6, 3), dtype=np.uint8)
    np.testing.assert_array_equal(np.asarray(image.open(io.BytesIO(png(pixels)))), pixels)
