"""The page of a robot: whether it was understood, in pictures and in words."""

import base64
import io
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from hoi_retarget.cli import main
from hoi_retarget.cli.commands import TRIAL_CLIPS
from hoi_retarget.human.skeleton import JOINT_INDEX
from hoi_retarget.human.t_pose import rest_offsets
from hoi_retarget.numerics import se3
from hoi_retarget.robots import ROBOTS, load_robot, user_robots
from hoi_retarget.robots.spec import SITES
from hoi_retarget.studio.offscreen import stage
from hoi_retarget.studio.scene.human_shapes import person_in_pose
from hoi_retarget.studio.scene.marks import site_marks
from hoi_retarget.studio.scene.robot_shapes import robot_parts
from offscreen import need_drawing
from synthetic_humanoids import Choices, humanoid

NAMES = tuple(ROBOTS)


def random_pose(model, seed):
    rng = np.random.default_rng(seed)
    joints = rng.uniform(model.lower, model.upper)
    return model.forward(np.concatenate([model.home_qpos[:7], joints])[None])


@pytest.mark.parametrize("name", NAMES)
def test_person_is_turned_as_the_robot_is_and_stands_on_the_floor(name):
    model = load_robot(name)
    posed = random_pose(model, 0)
    person = person_in_pose(posed, np.array([0.0, -1.0, 5.0]))
    for row in model.spec.ik:
        followed = se3.quat_multiply(person.quat(row.human_joint), np.array(row.rotation_offset))
        np.testing.assert_allclose(se3.quat_to_matrix(followed), posed.site_rotation(row.site), atol=5e-5)
    toes = [person.position(f"{side}_foot")[0, 2] for side in ("left", "right")]
    assert min(toes) == pytest.approx(0.0145 * model.spec.stature)
    assert person.height == pytest.approx(model.spec.stature, rel=0.005)
    thigh = np.linalg.norm(person.position("left_knee") - person.position("left_hip"))
    assert thigh == pytest.approx(np.linalg.norm(rest_offsets(model.spec.stature)[JOINT_INDEX["left_knee"]]))
    np.testing.assert_allclose((person.position("pelvis") - posed.site_position("pelvis"))[0, :2], [0.0, -1.0])


def test_marks_are_at_the_sites_and_along_their_axes():
    posed = random_pose(load_robot("unitree_g1"), 1)
    balls, axes = site_marks(posed, SITES, 0.1)
    for index, site in enumerate(SITES):
        place, turn = posed.site_position(site), posed.site_rotation(site)
        np.testing.assert_allclose(balls.positions[:, index], place, atol=1e-6)
        for axis in range(3):
            own = 3 * index + axis
            along = se3.rotate(axes.quats[:, own].astype(float), np.array([0.0, 0.0, 1.0]))
            np.testing.assert_allclose(along, turn[:, :, axis], atol=1e-5)
            np.testing.assert_allclose(axes.positions[:, own], place + 0.05 * turn[:, :, axis], atol=1e-5)


def test_links_beyond_a_site_are_those_that_its_joint_moves():
    model = load_robot("unitree_g1")
    home, moved = model.home_qpos.copy(), model.home_qpos.copy()
    moved[7 + model.joint_names.index("left_elbow_joint")] += 0.5

    def places(qpos, beyond):
        parts = robot_parts(model, model.forward(qpos[None]), None, beyond)
        return np.concatenate([part.positions[0] for part in parts]), np.concatenate([part.quats[0] for part in parts])

    beyond = [places(qpos, "left_elbow") for qpos in (home, moved)]
    everything = [places(qpos, None) for qpos in (home, moved)]
    still = [np.all(np.isclose(a, b), axis=1) for a, b in zip(*everything, strict=True)]
    assert 0 < len(beyond[0][0]) == np.sum(~(still[0] & still[1])), "all that moves, nothing else"


def maker(tmp_path):
    made = humanoid(Choices(2, fingers=3))
    # Names of a file are data: nothing of them is read as HTML.
    path = tmp_path / "maker.xml"
    path.write_text(made.mjcf.replace("left_knee_joint", "left_knee&lt;script&gt;_joint"))
    return path


def run(*words):
    """Run the program as a user does: MuJoCo reads how to draw when it is imported."""
    done = subprocess.run(
        [sys.executable, "-m", "hoi_retarget", *map(str, words)],
        env={**os.environ, "MUJOCO_GL": "egl"},
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr


@pytest.mark.slow
def test_page_of_an_added_robot_stands_alone_and_is_made_again(tmp_path, monkeypatch):
    need_drawing("egl")
    monkeypatch.setenv("HOI_RETARGET_ROBOTS", str(tmp_path / "robots"))
    page = tmp_path / "robots" / "mine" / "robot.html"
    code, said = run("robots", "add", maker(tmp_path), "--name", "mine")
    assert code == 1, "speeds are assumed, which is a warning"
    assert f"look at it: {page}" in said
    text = page.read_text()
    assert len(text) < 1.5e6
    assert not re.findall(r"https?:|<script|url\(|@import|<link", text), "nothing is loaded, nothing runs"
    assert "default-src 'none'" in text
    pictures = re.findall(r'src="data:image/jpeg;base64,([^"]+)"', text)
    assert len(pictures) == text.count("<img") == 6 + len(TRIAL_CLIPS)
    for picture in pictures:
        pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(picture))).convert("L"), dtype=float)
        assert pixels.std() > 5, "something is seen"
    words = re.sub(r"<[^>]*>", " ", text).replace("&#34;", '"').replace("&#39;", "'").replace("&gt;", ">")
    for finding in user_robots.record_of("mine").findings:
        for said in (finding.subject, finding.what, finding.hint):
            assert said.replace("<", "&lt;") in words
    again = tmp_path / "again.html"
    assert run("robots", "show", "mine", "--page", again)[0] == 0
    assert again.read_text() == text


@pytest.mark.slow
def test_without_a_way_to_draw_a_robot_is_added_without_a_page(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(stage, "_trouble", lambda: "no screen")
    monkeypatch.setenv("HOI_RETARGET_ROBOTS", str(tmp_path / "robots"))
    assert main(["robots", "add", str(maker(tmp_path)), "--name", "mine"]) == 1
    folder = tmp_path / "robots" / "mine"
    assert "no page of mine is made: This machine cannot draw" in capsys.readouterr().err
    assert not (folder / "robot.html").exists()
    assert main(["robots", "show", "mine", "--page", str(tmp_path / "page.html")]) == 1
    assert "cannot draw" in capsys.readouterr().err
    assert not (tmp_path / "page.html").exists()


def test_page_has_the_name_of_one(tmp_path, capsys):
    assert main(["robots", "show", "unitree_g1", "--page", str(tmp_path / "page.png")]) == 2
    assert "ends in .html" in capsys.readouterr().err
