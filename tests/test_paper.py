"""Pictures for papers: what is seen is all there, cut out, at the moments of contact."""

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from hoi_retarget.cli import main
from hoi_retarget.studio.offscreen.paper import _overlaid, _sheet, contact_moments
from offscreen import trouble


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper")
    assert main(["run", "builtin:carry_box", "--contact", "landmark", "--out", str(folder)]) == 0
    return folder / "carry_box.npz"


@pytest.fixture(scope="module")
def motion(result):
    from hoi_retarget.motion.result_file import load

    return load(result)


def test_moments_are_those_of_the_contact(motion):
    moments = contact_moments(motion)
    touched = np.flatnonzero((motion.contact_flags & (motion.contact_object >= 0)).any(axis=1))
    titles = {moment.title: moment.frame for moment in moments}
    assert list(titles) == ["first touch", "lift", "peak", "set down", "release"]
    assert titles["first touch"] == touched[0] and titles["release"] == touched[-1]
    assert list(titles.values()) == sorted(titles.values())
    heights = motion.object_pos[:, 0, 2]
    assert heights[titles["peak"]] == heights[touched].max()
    start = heights[touched[0]]
    assert heights[titles["lift"] - 1] <= start + 0.02 < heights[titles["lift"]]


def test_what_is_not_lifted_has_its_farthest_frame_and_what_is_not_touched_no_moments(motion):
    flat = motion.object_pos.copy()
    flat[..., 2] = 0.3
    assert [moment.title for moment in contact_moments(replace(motion, object_pos=flat))][1:-1] == ["farthest"]
    assert contact_moments(replace(motion, contact_flags=np.zeros_like(motion.contact_flags))) == ()


def test_a_sheet_is_cut_to_what_is_seen_and_loses_none_of_it():
    pictures = [[np.zeros((40, 60, 4)) for _ in range(3)] for _ in range(2)]
    for row, line in enumerate(pictures):
        for column, picture in enumerate(line):
            picture[10 + row : 20, 5 : 15 + column] = 1.0
    sheet = np.asarray(_sheet(pictures, [], ["", ""]))
    assert (sheet[..., 3] > 0).sum() == sum((picture[..., 3] > 0).sum() for line in pictures for picture in line)
    assert sheet.shape[0] < 60 and sheet.shape[1] < 100


def test_the_last_of_overlaid_frames_is_as_drawn_and_the_first_is_faint():
    first, last = np.zeros((2, 4, 4)), np.zeros((2, 4, 4))
    first[:, :2], last[:, 1:3] = 1.0, [0.5, 0.25, 0.0, 1.0]
    laid = _overlaid([first, last])
    assert np.allclose(laid[:, 1:3], last[:, 1:3])
    assert np.all((laid[:, 0, 3] > 0.1) & (laid[:, 0, 3] < 0.9)) and not laid[:, 3, 3].any()


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--style", "paper", "--out", "x.gif"], ".png"),
        (["--background", "transparent", "--out", "x.png"], "--style paper"),
        (["--overlaid", "--out", "x.png"], "--style paper"),
        (["--style", "paper", "--frame", "9999", "--out", "x.png"], "frames 0 to"),
    ],
)
def test_what_cannot_be_drawn_for_a_paper_is_refused(result, words, reason, tmp_path, capsys):
    *options, out = words
    assert main(["render", str(result), "--only", "robot", *options, str(tmp_path / out)]) == 2
    assert reason in capsys.readouterr().err and not any(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.skipif(bool(trouble("egl")), reason="MuJoCo cannot draw here with EGL")
def test_a_cutout_has_every_shape_that_the_plain_picture_has(result, tmp_path):
    import subprocess
    import sys

    for name, words in (("plain", []), ("paper", ["--style", "paper", "--background", "transparent"])):
        command = [sys.executable, "-m", "hoi_retarget", "render", str(result), "--only", "human", "--frame", "150"]
        subprocess.run([*command, *words, "--size", "200x240", "--out", str(tmp_path / f"{name}.png")], check=True)
    cut = Image.open(io.BytesIO((tmp_path / "paper.png").read_bytes()))
    assert cut.mode == "RGBA" and round(cut.info["dpi"][0]) == 300
    plain = np.asarray(Image.open(tmp_path / "plain.png").convert("RGB")).astype(int)
    skin = (plain[..., 0] - plain[..., 2] > 40).sum()  # Neither floor nor sky is so red.
    own = np.asarray(cut).astype(int)
    seen = ((own[..., 3] > 200) & (own[..., 0] - own[..., 2] > 20)).sum()
    assert abs(seen - skin) < 0.1 * skin
