"""`hoi-retarget export`: what is written where, what is said, and what is refused."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from export_motions import smooth_motion
from hoi_retarget.cli import main
from hoi_retarget.clip.clip import Source
from hoi_retarget.motion.formats import WRITABLE
from hoi_retarget.motion.result_file import save
from hoi_retarget.motion.write_export import NAMES
from synthetic import LICENCE
from trajectories import MODELS

G1, H2 = MODELS["unitree_g1"], MODELS["unitree_h2"]


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """The result of a built-in clip."""
    folder = tmp_path_factory.mktemp("demo")
    assert main(["run", "builtin:carry_box", "--contact", "landmark", "--out", str(folder)]) == 0
    return folder / "carry_box.npz"


@pytest.fixture
def export(tmp_path, monkeypatch, capsys):
    """Run `hoi-retarget export` in an empty folder; return exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*words: object):
        code = main(["export", *map(str, words)])
        return code, *capsys.readouterr()

    return call


def listing(folder) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


@pytest.mark.parametrize("name", WRITABLE)
def test_every_format_is_written_with_its_description(name, demo, export, tmp_path):
    code, out, err = export(demo, "--to", name, "--out", "motions")
    assert code == 0 and not err
    files = listing(tmp_path / "motions")
    assert f"carry_box.{name}.meta.json" in files
    main_files = (
        [f"carry_box.{name}{WRITABLE[name].suffix}"]
        if WRITABLE[name].suffix
        else [f"carry_box.{name}/meta.json", f"carry_box.{name}/motion.npz"]
    )
    beside = [] if WRITABLE[name].contacts_inside else [f"carry_box.{name}.contacts.npz"]
    assert files == sorted([*main_files, *beside, f"carry_box.{name}.meta.json"])
    assert f"licence of the source: {LICENCE}" in out and out.endswith("1 exported, 0 failed.\n")
    meta = json.loads((tmp_path / "motions" / f"carry_box.{name}.meta.json").read_text())
    assert meta["source"]["licence"] == LICENCE and meta["contacts"]["normals_of"]
    assert str(demo.parent) not in json.dumps(meta)


@pytest.mark.parametrize("name", ["beyondmimic", "mjlab", "holosoma", "hdmi"])
def test_nothing_contradicts_what_a_file_claims(name, demo, export, tmp_path, capsys):
    assert export(demo, "--to", name, "--out", ".")[0] == 0
    assert main(["check-motion", f"carry_box.{name}{WRITABLE[name].suffix}"]) == 0
    assert "Nothing contradicts what the file claims." in capsys.readouterr().out


def test_readers_of_29_joints_get_them_of_a_robot_with_fingers(export, tmp_path):
    save(smooth_motion(MODELS["unitree_g1_dex3"], objects=0), tmp_path / "it.npz")
    for words, columns in (((), 50), (("--as", "g1"), 36)):
        code, out, _ = export("it.npz", "--to", "unitree-csv", "--out", "out", *words)
        assert code == 0 and ("--as unitree_g1" in out) == (columns == 50)
        assert np.loadtxt(tmp_path / "out" / "it.unitree-csv.csv", delimiter=",").shape[1] == columns


def test_a_file_may_be_named(demo, export, tmp_path):
    assert export(demo, "--to", "mjlab", "--out", "deep/motion.npz")[0] == 0
    assert listing(tmp_path) == ["deep/motion.meta.json", "deep/motion.npz"]


def test_the_rate_may_be_named(demo, export, tmp_path):
    code, out, _ = export(demo, "--to", "hdmi", "--out", ".", "--fps", "60")
    assert code == 0 and "60 frames/s" in out and "note: HDMI refuses" in out
    with np.load(tmp_path / "carry_box.hdmi" / "motion.npz") as file:
        assert len(file["joint_pos"]) == 2 * len(np.load(demo)["qpos"]) - 1


def test_several_results_are_written_beside_each_other_and_a_bad_one_stops_none(demo, export, tmp_path):
    (tmp_path / "damaged.npz").write_bytes(b"no archive")
    save(smooth_motion(G1, objects=0), tmp_path / "other.npz")
    code, out, err = export(demo, "damaged.npz", "other.npz", "--to", "gmr", "--out", "motions")
    assert code == 1 and out.endswith("2 exported, 1 failed.\n")
    assert err.count("error:") == 1 and "damaged.npz" in err
    assert [name for name in listing(tmp_path / "motions") if name.endswith(".pkl")] == [
        "carry_box.gmr.pkl",
        "other.gmr.pkl",
    ]


@pytest.mark.slow
def test_two_people_become_two_files_in_one_world(export, tmp_path, capsys):
    assert main(["run", "builtin:carry_table", "--out", "."]) == 0
    capsys.readouterr()
    code, *_ = export("carry_table.p0.npz", "carry_table.p1.npz", "--to", "holosoma", "--out", "motions")
    assert code == 0
    first, second = (dict(np.load(tmp_path / f"motions/carry_table.p{k}.holosoma.npz")) for k in (0, 1))
    for name in ("object_pos_w", "object_quat_w", "object_lin_vel_w"):
        np.testing.assert_array_equal(first[name], second[name])
    assert np.abs(first["body_pos_w"][:, 1] - second["body_pos_w"][:, 1]).max() > 0.3
    people = [
        json.loads((tmp_path / f"motions/carry_table.p{k}.holosoma.meta.json").read_text())["source"]["person"]
        for k in (0, 1)
    ]
    assert people == [0, 1]


def test_without_the_clip_there_are_no_normals_and_a_warning(export, tmp_path):
    save(smooth_motion(G1), tmp_path / "a.npz")
    code, out, err = export("a.npz", "--to", "mjlab", "--out", ".")
    assert code == 0 and err.startswith("warning: a.npz: contacts are written without surface normals.")
    assert json.loads((tmp_path / "a.mjlab.meta.json").read_text())["contacts"]["normals_of"] == []
    assert "licence of the source: CC BY 4.0 | made up" in out
    code, _, err = export("a.npz", "--to", "mjlab", "--out", ".", "--clip", "nowhere.pt")
    assert code == 1 and "nowhere.pt" in err


def test_one_of_several_objects_is_named(export, tmp_path):
    save(smooth_motion(G1, objects=2), tmp_path / "a.npz")
    code, _, err = export("a.npz", "--to", "holosoma", "--out", "motions")
    assert code == 2 and "Name one with --object. Objects: thing_0, thing_1." in err
    assert not (tmp_path / "motions").exists()
    assert export("a.npz", "--to", "holosoma", "--out", "motions", "--object", "thing_1")[0] == 0
    assert np.load(tmp_path / "motions/a.holosoma.npz")["body_names"][-1] == "thing_1_link"


# data sets


def test_a_data_set_takes_all_results_into_one_folder(demo, export, tmp_path):
    pytest.importorskip("pyarrow")
    save(smooth_motion(H2, objects=0), tmp_path / "carry_box.npz")
    code, out, err = export(demo, "carry_box.npz", "--to", "dataset", "--out", "set")
    assert code == 0 and not err
    assert listing(tmp_path / "set") == ["README.md", "data/train-00000-of-00001.parquet"]
    assert out == f"licence of sources: {LICENCE}\nlicence of sources: CC BY 4.0 | made up\n2 motions in set\n"
    code, _, err = export(demo, "--to", "dataset", "--out", "set")
    assert code == 2 and "there are rows in it already" in err
    for words in ([demo, demo.parent / "carry_box.npz"], [demo, "--object", "box"]):
        assert export(*words, "--to", "dataset", "--out", "other")[0] == 2
    assert not (tmp_path / "other").exists()


def test_nothing_of_a_data_set_is_written_when_a_result_is_bad(demo, export, tmp_path):
    pytest.importorskip("pyarrow")
    (tmp_path / "damaged.npz").write_bytes(b"no archive")
    code, _, err = export(demo, "damaged.npz", "--to", "dataset", "--out", "set")
    assert code == 1 and "damaged.npz" in err and not (tmp_path / "set").exists()


def test_without_pyarrow_it_is_told_how_to_get_it(demo, export, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    code, _, err = export(demo, "--to", "dataset", "--out", "set")
    assert code == 1 and 'pip install "pyarrow>=17"' in err


# what is refused


def test_unknown_formats_are_told_with_those_there_are(demo, export):
    code, _, err = export(demo, "--to", "usd", "--out", ".")
    assert code == 2 and all(name in err for name in NAMES)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--to", "mjlab", "--out", "m", "--fps", "0"], "--fps 0"),
        (["--to", "mjlab", "--out", "m", "--object", "box"], "no place for an object"),
        (["--to", "gmr", "--out", "m.npz"], "files that end in .pkl"),
        (["--to", "hdmi", "--out", "m.npz"], "are folders"),
    ],
)
def test_wrong_arguments_are_told_and_write_nothing(words, told, demo, export, tmp_path):
    code, _, err = export(demo, *words)
    assert code == 2 and told in err and err.count("\n") == 1
    assert listing(tmp_path) == []


def test_another_robot_is_named_with_those_that_there_are(export, tmp_path):
    save(smooth_motion(G1, objects=0, robot="some_robot"), tmp_path / "b.npz")
    code, _, err = export("b.npz", "--to", "mjlab", "--out", "m")
    assert code == 1 and "some_robot" in err and "unitree_g1" in err


def test_a_result_is_never_written_over(demo, export, tmp_path):
    content = demo.read_bytes()
    code, _, err = export(demo, "--to", "mjlab", "--out", demo)
    assert code == 2 and "is the result itself" in err and demo.read_bytes() == content
    assert export(demo, "--to", "mjlab", "--out", demo.parent)[0] == 0
    assert demo.read_bytes() == content


def test_a_result_called_as_anothers_export_is_kept(export, tmp_path):
    for name in ("a.npz", "a.mjlab.npz"):
        save(smooth_motion(G1, objects=0), tmp_path / name)
    content = (tmp_path / "a.mjlab.npz").read_bytes()
    code, _, err = export("a.npz", "a.mjlab.npz", "--to", "mjlab", "--out", ".")
    assert code == 1 and "would be written over" in err
    assert (tmp_path / "a.mjlab.npz").read_bytes() == content


def test_texts_that_no_file_can_hold_are_written_with_question_marks(export, tmp_path):
    motion = smooth_motion(G1, objects=0)
    save(replace(motion, report=replace(motion.report, source=Source(licence="\udfff"))), tmp_path / "a.npz")
    assert export("a.npz", "--to", "mjlab", "--out", ".")[0] == 0
    assert json.loads((tmp_path / "a.mjlab.meta.json").read_text())["source"]["licence"] == "?"


def test_a_data_set_replaces_no_page_of_its_folder(demo, export, tmp_path):
    (tmp_path / "README.md").write_text("mine")
    code, _, err = export(demo, "--to", "dataset", "--out", ".")
    assert code == 2 and "README.md" in err
    assert (tmp_path / "README.md").read_text() == "mine" and not (tmp_path / "data").exists()


def test_several_results_need_a_folder_and_names_of_their_own(demo, export, tmp_path):
    save(smooth_motion(G1, objects=0), tmp_path / "a.npz")
    (tmp_path / "sub").mkdir()
    save(smooth_motion(G1, objects=0), tmp_path / "sub" / "a.npz")
    code, _, err = export(demo, "a.npz", "--to", "mjlab", "--out", "m.npz")
    assert code == 2 and "Name a folder" in err
    code, _, err = export("a.npz", "sub/a.npz", "--to", "mjlab", "--out", "m")
    assert code == 2 and "would both be written as a" in err
    assert export("--to", "mjlab", "--out", "m")[0] == 2


@pytest.mark.parametrize(("name", "module"), [("mcap", "mcap_ros2"), ("isaaclab", "h5py")])
def test_no_file_of_a_folder_is_written_over(name, module, demo, export, tmp_path):
    pytest.importorskip(module)
    assert export(demo, "--to", name, "--out", "motions")[0] == 0
    before = {path: path.read_bytes() for path in (tmp_path / "motions").iterdir()}
    code, _, err = export(demo, "--to", name, "--out", "motions")
    assert code == 2 and "would be lost" in err
    assert {path: path.read_bytes() for path in (tmp_path / "motions").iterdir()} == before
