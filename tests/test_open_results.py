"""Every verb that takes a result takes other programs' motions."""

import json

import numpy as np
import pytest

import motion_writers as writers
from hoi_retarget.cli import main
from hoi_retarget.cli.open_results import gallery_entry_of, load_motion
from hoi_retarget.evaluation.thresholds import known_figures
from hoi_retarget.motion.check import check
from hoi_retarget.motion.formats import read
from hoi_retarget.studio.share.clip_page import make_clip_page
from hoi_retarget.studio.share.load_results import load_results

FORMATS = tuple(writers.MAKERS)
QPOS = writers.motion().qpos
OWN = 1e-5  # Files of single precision, or with nine digits.


@pytest.mark.parametrize("name", FORMATS)
def test_the_motion_of_any_format_is_loaded_as_it_was_written(name, tmp_path):
    motion = load_motion(writers.write(name, tmp_path), "unitree_g1", lambda _: None)
    kept = [
        column for column in range(36) if name != "asap" or column < 7 or "wrist" not in motion.joint_names[column - 7]
    ]
    assert np.abs(motion.qpos[:, kept] - QPOS[:, kept]).max() < OWN
    assert motion.report.source.format == read(writers.write(name, tmp_path)).format
    assert motion.report.is_foreign


@pytest.mark.parametrize("name", ["gmr-npz", "protomotions", "sonic", "bones-seed"])
def test_an_export_of_an_import_is_the_motion(name, tmp_path):
    path = writers.write(name, tmp_path)
    out = tmp_path / "out"
    assert main(["export", str(path), "--to", "gmr", "--out", str(out)]) == 0
    exported = check(read(next(out.glob("*.pkl"))), writers.model())
    assert np.abs(exported.qpos - QPOS).max() < OWN
    described = json.loads(next(out.glob("*.meta.json")).read_text())
    assert described["source"]["licence"] == "unknown"
    assert described["source"]["format"] == name
    assert described["result"]["name"] == path.name


def test_figures_that_need_no_recording_are_shown(tmp_path, capsys):
    path = writers.write("protomotions", tmp_path)
    assert main(["evaluate", str(path), "--json", str(tmp_path / "figures.json")]) == 0
    figures = json.loads((tmp_path / "figures.json").read_text())["per_clip"][0]
    assert figures["body_jerk_mps3"] > 0
    assert figures["contact_gap_m"] is None
    assert figures["compute_s"] is None
    assert "other programs' motions" in capsys.readouterr().out


def test_what_was_assumed_and_what_contradicts_is_said_once_a_file(tmp_path, capsys):
    content = writers.unitree_csv(writers.motion())
    content["table"][:, 3:7] = QPOS[:, 3:7]  # Kimodo's order.
    path = writers.save("unitree-csv", content, tmp_path)
    assert np.abs(load_motion(path, "unitree_g1").qpos - QPOS).max() < OWN
    said = capsys.readouterr().err
    assert said.count("motion.csv: quaternion order: the numbers are wxyz") == 1
    assert said.count("motion.csv: 30 frames a second are assumed") == 1


def test_a_motion_that_cannot_be_read_is_an_error_of_every_verb(tmp_path, capsys):
    content = writers.gmr(writers.motion())
    content["dof_pos"] = content["dof_pos"][:, :22]
    path = writers.save("gmr", content, tmp_path)
    for verb in (
        ["evaluate"],
        ["export", "--to", "gmr", "--out", "x"],
        ["render", "--out", "x.png"],
        ["share", "--out", "x"],
    ):
        assert main([verb[0], str(path), *verb[1:]]) == 1
        assert "22 columns of angles" in capsys.readouterr().err


def test_the_viewer_shows_it(tmp_path):
    path = writers.write("sonic", tmp_path)
    notices = []
    loaded = load_results(
        [path], notices.append, load_motion=lambda file: load_motion(file, "unitree_g1", lambda _: None)
    )
    ((_, motion, shown),) = loaded
    assert shown.title == "G1" and "without the human" in notices[0]
    entry = gallery_entry_of(motion, shown.model, known_figures(motion, path))
    assert "jerk over time" in make_clip_page("walk", [(entry, shown)]).text


def test_an_unknown_robot_is_an_error(tmp_path, capsys):
    path = writers.write("gmr-npz", tmp_path)
    assert main(["evaluate", str(path), "--robot", "nobody"]) == 2
    assert "nobody" in capsys.readouterr().err
