"""The command line: exit codes, what is written where, and what stands on stderr."""

import csv
import errno
import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import motion_writers
from hoi_retarget import __version__, cli
from hoi_retarget.cli import main, program, terminal
from hoi_retarget.clip.clip import Clip
from hoi_retarget.motion.result_file import load
from hoi_retarget.readers import intermimic
from hoi_retarget.robots import ROBOTS
from intermimic_writer import columns_of, write_box, write_clip
from offscreen import need_drawing, trouble
from synthetic import make
from torch_writer import torch_bytes

NAME = "sub1_box_000"


def listing(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*")) if folder.exists() else []


@pytest.fixture(scope="session")
def columns() -> np.ndarray:
    return columns_of(make("carry_box", seconds=3.0))


@pytest.fixture
def recording(tmp_path, columns):
    """A folder with one good clip and its object."""
    write_box(tmp_path / "objects", "box")
    (tmp_path / f"{NAME}.pt").write_bytes(torch_bytes(columns))
    return tmp_path


@pytest.fixture
def run(recording, monkeypatch, capsys):
    """Run `hoi-retarget run` in the folder of the recording; return exit code, stdout, stderr."""
    monkeypatch.chdir(recording)

    def call(*words: object):
        code = main(["run", *map(str, words), "--objects", "objects", "--out", "out"])
        return code, *capsys.readouterr()

    return call


# help, version, start-up


def test_help_names_every_command_and_imports_nothing_heavy():
    code = "from hoi_retarget.cli import main\ntry: main(['--help'])\nexcept SystemExit as e: print(e.code)\n"
    code += "import sys; print(*(m for m in ('numpy', 'scipy', 'mujoco', 'trimesh', 'igl') if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    *text, exit_code, heavy = done.stdout.split("\n")[:-1]
    assert exit_code == "0"
    assert not heavy
    words = ("demo", "run", "evaluate", "inspect", "robots", "sample")
    assert all(any(line.startswith(f"  {word} ") for line in text) for word in words)


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"hoi-retarget {__version__}\n"


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["run", "a.pt"],
        ["run", "a.pt", "--out", "out", "--size-multiplier", "big"],
        ["run", "a.pt", "--out", "out", "--root-scale", "tall"],
        ["robots"],
        ["inspect"],
    ],
)
def test_arguments_that_do_not_parse(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as exit_:
        main(words)
    assert exit_.value.code == 2
    assert capsys.readouterr().err
    assert not listing(tmp_path)


def test_linear_algebra_gets_one_thread_unless_the_user_says_otherwise(monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    program._use_one_thread()
    assert (os.environ["OMP_NUM_THREADS"], os.environ["OPENBLAS_NUM_THREADS"]) == ("1", "3")
    monkeypatch.delenv("OMP_NUM_THREADS")


def test_drawing_without_a_screen_does_not_override_the_user(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    program._draw_without_a_screen()
    assert os.environ["MUJOCO_GL"] == "glfw"


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have one way to draw")
def test_an_empty_choice_of_drawing_is_none(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr(program.ctypes, "CDLL", lambda library: None)
    program._draw_without_a_screen()
    assert os.environ["MUJOCO_GL"] == "egl"


# run


@pytest.mark.slow
def test_run_of_two_people_calls_robots_by_their_names_and_all_figures_are_there_for_the_asking(tmp_path, capsys):
    command = ["run", "builtin:carry_table", "--robot", "unitree_h2,unitree_g1", "--figures", "fast", "--all"]
    assert main([*command, "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    lines = [line.split() for line in out.splitlines()]
    assert ["H2", "G1", "mean", "worst"] in lines and ["paper's", "figures"] in lines
    assert [line[:2] for line in lines if line[1:2] in (["motion"], ["physics"])] == [
        [name, light] for name in ("H2", "G1") for light in ("motion", "physics")
    ]


def test_run_writes_one_result_and_says_so(run, recording):
    code, out, err = run(f"{NAME}.pt")
    assert (code, err) == (0, "")
    assert listing(recording / "out") == [f"{NAME}.npz"]
    assert "object: box" in out
    assert "touch [%]" in out and "contact gap" not in out
    assert re.search("motion +(pass|warn)", out) and "fail " not in out
    assert out.endswith("1 solved, 0 failed.\n")


@pytest.mark.slow
def test_a_result_carries_source_settings_and_seconds(run, recording):
    run(f"{NAME}.pt", "--size-multiplier", "1.1", "--horizon", "windowed:60:10")
    motion = load(recording / "out" / f"{NAME}.npz")
    report = motion.report
    assert report.source.path == f"{NAME}.pt"
    assert re.fullmatch("[0-9a-f]{64}", report.source.sha256)
    assert report.source.licence == intermimic.LICENCE
    assert report.config["scaling"]["size_multiplier"] == 1.1
    assert report.config["horizon"]["length"] == 60
    assert report.config["horizon"]["overlap"] == 10
    assert report.command["clips"] == [f"{NAME}.pt"]
    assert set(report.versions) >= {"hoi_retarget", "numpy", "scipy", "mujoco"}
    assert set(report.cpu_seconds) == {"read", "targets", "ik", "holds", "trajectory", "metrics", "write"}
    assert all(seconds >= 0 for seconds in report.cpu_seconds.values())
    assert len(motion.stages[-1].windows) == 2


@pytest.mark.slow
def test_one_bad_clip_does_not_stop_the_rest(run, recording, columns):
    broken = columns.copy()
    broken[7, 200] = np.nan
    (recording / "sub1_box_001.pt").write_bytes(torch_bytes(broken))
    (recording / "sub1_box_002.pt").write_bytes(torch_bytes(columns))
    code, out, err = run(f"{NAME}.pt", "sub1_box_001.pt", "sub1_box_002.pt")
    assert code == 1
    assert listing(recording / "out") == [f"{NAME}.npz", "sub1_box_002.npz"]
    assert out.endswith("2 solved, 1 failed.\n")
    (line,) = err.splitlines()
    assert line.startswith("error: ") and "sub1_box_001.pt" in line and "7" in line


def broken_files(columns: np.ndarray) -> dict[str, bytes]:
    good = torch_bytes(columns)
    label, quat = columns.copy(), columns.copy()
    label[3, 340], quat[9, 3:7] = 2.0, 0.0
    return {
        "empty": b"",
        "truncated": good[: len(good) // 2],
        "not_a_tensor": torch_bytes({"a": 1}),
        "columns": torch_bytes(columns[:, :590]),
        "label": torch_bytes(label),
        "zero_quaternion": torch_bytes(quat),
        **{f"frames{count}": torch_bytes(columns[:count]) for count in (0, 1, 2, 3)},
    }


@pytest.mark.parametrize("case", [*broken_files(np.zeros((10, 591), np.float32)), "missing"])
def test_bad_clips_give_one_line_and_nothing_else(run, recording, columns, case):
    path = recording / f"sub1_box_{case}.pt"
    if case != "missing":
        path.write_bytes(broken_files(columns)[case])
    code, _, err = run(path.name)
    assert code == 1
    assert err.startswith("error: ") and err.count("\n") == 1 and path.name in err
    assert not (recording / "out").exists()


def test_a_torch_file_that_wants_to_run_code_is_refused(run, recording):
    class Attack:
        def __reduce__(self):
            return os.mkdir, (str(recording / "owned"),)

    (recording / "sub1_box_009.pt").write_bytes(torch_bytes(Attack()))
    code, _, err = run("sub1_box_009.pt")
    assert code == 1 and err.count("\n") == 1 and "mkdir" in err
    assert not (recording / "owned").exists() and not (recording / "out").exists()


def test_four_frames_are_enough(run, recording, columns):
    (recording / "sub1_box_004.pt").write_bytes(torch_bytes(columns[:4]))
    assert run("sub1_box_004.pt")[0] == 0
    assert load(recording / "out" / "sub1_box_004.npz").frames == 4


@pytest.mark.parametrize("text", ["", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n"])
def test_bad_meshes(run, recording, text):
    (recording / "objects/box/box.obj").write_text(text)
    code, _, err = run(f"{NAME}.pt")
    assert code == 1 and err.count("\n") == 1 and "box.obj" in err
    assert not (recording / "out").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--robot", "unitree_g2"], ", ".join(ROBOTS)),
        (["--root-scale", "0"], "positive"),
        (["--object-scale", "-1"], "positive"),
        (["--size-multiplier", "nan"], "positive"),
        (["--horizon", "windowed:3:9"], "LENGTH must be at least 20"),
        (["--horizon", "sometimes"], "per-frame"),
        (["--floor", "nan"], "--floor nan"),
        (["--floor", "1e9"], "at most 1000 m"),
        (["copy/sub1_box_000.pt"], "different folders"),
        (["objects"], "is a folder"),
    ],
)
def test_wrong_arguments_are_told_before_anything_is_solved(run, recording, words, message):
    code, out, err = run(f"{NAME}.pt", *words)
    assert code == 2
    assert err.startswith("error: ") and err.count("\n") == 1 and message in err
    assert not out
    assert not (recording / "out").exists()


def test_no_clip_at_all(run):
    code, _, err = run()
    assert code == 2 and "CLIP" in err


def test_an_unknown_object_names_those_that_exist(run, recording):
    code, out, err = run(f"{NAME}.pt", "--object", "bux")
    assert code == 2 and "Objects there: box." in err and err.count("\n") == 1 and not out
    (recording / f"{NAME}.pt").rename(recording / "sub1_bux_000.pt")
    code, _, err = run("sub1_bux_000.pt")
    assert code == 1 and "Objects there: box." in err and err.count("\n") == 1
    assert not (recording / "out").exists()


def test_a_missing_folder_of_objects(run, recording):
    (recording / "objects").rename(recording / "elsewhere")
    code, _, err = run(f"{NAME}.pt")
    assert code == 2 and err.startswith("error: --objects objects: there is no such folder.")


def test_an_object_without_geometry(run, recording):
    (recording / "objects/box/box.obj").unlink()
    code, _, err = run(f"{NAME}.pt")
    assert code == 1 and "no geometry" in err and err.count("\n") == 1
    assert not (recording / "out").exists()


def test_the_object_may_be_named_by_the_user(run, recording):
    (recording / f"{NAME}.pt").rename(recording / "take one.pt")
    code, _, err = run("take one.pt")
    assert code != 0 and "--object" in err
    assert run("take one.pt", "--object", "box")[0] == 0
    assert listing(recording / "out") == ["take one.npz"]


def test_a_folder_that_cannot_be_written_is_told_first(recording, monkeypatch, capsys):
    monkeypatch.chdir(recording)
    before = listing(recording)
    for out in (f"{NAME}.pt", f"{NAME}.pt/below/it"):
        code = main(["run", f"{NAME}.pt", "--objects", "objects", "--out", out])
        captured = capsys.readouterr()
        assert code == 2
        assert captured.err.startswith("error: --out") and captured.err.count("\n") == 1
        assert not captured.out
    assert listing(recording) == before


def test_a_full_disk_leaves_the_old_result(run, recording, monkeypatch):
    assert run(f"{NAME}.pt", "--contact", "landmark")[0] == 0
    old = (recording / "out" / f"{NAME}.npz").read_bytes()

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    code, _, err = run(f"{NAME}.pt", "--size-multiplier", "0.9")
    assert code == 1 and "No space left" in err and err.count("\n") == 1
    assert listing(recording / "out") == [f"{NAME}.npz"]
    assert (recording / "out" / f"{NAME}.npz").read_bytes() == old


def test_contacts_out_of_reach_are_named(run, recording):
    code, _, err = run(f"{NAME}.pt", "--object-scale", "4")
    assert code == 1, "elbows turn over"
    lines = [line for line in err.splitlines() if "not reached" in line]
    assert lines
    row = r"warning: \S+\.npz\.failed: not reached: \w+_palm on 'box', frames \d+ to \d+: .* cm"
    assert all(re.match(row, line) for line in lines)
    assert load(recording / "out" / f"{NAME}.npz.failed").report.unreached_contacts


def two_people(clip: Clip) -> Clip:
    """Return a clip with a second person who does the same two metres away."""
    (person,) = clip.people
    other = replace(person, joint_positions=person.joint_positions + np.array([0.0, 2.0, 0.0]))
    return Clip("two", clip.fps, (person, other), clip.objects, clip.contacts, clip.source)


def test_each_person_gets_a_result(run, recording, monkeypatch):
    from hoi_retarget.cli import run as module

    clip = two_people(make("carry_box", seconds=1.0))
    monkeypatch.setattr(module, "open_clip", lambda *_, **__: clip)
    code, out, _ = run(f"{NAME}.pt")
    assert code == 0 and "2 people" in out
    assert listing(recording / "out") == [f"{NAME}.p0.npz", f"{NAME}.p1.npz"]
    first, second = (load(recording / "out" / f"{NAME}.p{person}.npz") for person in (0, 1))
    np.testing.assert_array_equal(first.object_pos, second.object_pos)
    assert [first.report.person, second.report.person] == [0, 1]


def test_ctrl_c_ends_with_one_line(run, monkeypatch):
    from hoi_retarget.cli import run as module

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "open_clip", interrupted)
    code, _, err = run(f"{NAME}.pt")
    assert code == 130 and err.count("\n") == 1


def test_the_program_itself_returns_the_code(recording):
    words = [sys.executable, "-m", "hoi_retarget", "run", "gone.pt", "--out", "out"]
    done = subprocess.run(words, cwd=recording, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == "error: gone.pt: there is no such file. Check the path.\n"


def test_a_reader_that_goes_away_is_no_traceback(recording):
    words = [sys.executable, "-m", "hoi_retarget", "run", f"{NAME}.pt", "--objects", "objects", "--out", "out"]
    program = subprocess.Popen(words, cwd=recording, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    program.stdout.close()
    assert program.stderr.read() == ""
    program.stderr.close()
    assert program.wait() == cli.PIPE_CLOSED


CLOSED = "import os; r, w = os.pipe(); os.close(r); os.dup2(w, 1); "


def program_with(preparation: str, *words: str, **environment: str) -> subprocess.CompletedProcess:
    """Run the program in a process of its own, after some preparation."""
    code = f"{preparation}\nimport sys\nfrom hoi_retarget.cli import main\nsys.exit(main({list(words)!r}))"
    variables = {**os.environ, **environment}
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=variables)


def test_warnings_of_other_packages_do_not_reach_the_terminal():
    warns = "program.run = lambda words: warnings.warn('raw') or 0"
    code = f"import warnings; from hoi_retarget.cli import main, program; {warns}; main()"
    for options, shown in (((), False), (("-W", "default"), True)):
        words = [sys.executable, *options, "-c", code]
        assert ("raw" in subprocess.run(words, capture_output=True, text=True, check=True).stderr) == shown


def test_a_motion_in_the_current_folder_is_exported_under_its_name(tmp_path, monkeypatch):
    folder = tmp_path / "walk"
    folder.mkdir()
    motion_writers.write("hdmi", folder)
    monkeypatch.chdir(folder)
    assert main(["export", ".", "--to", "gmr", "--out", str(tmp_path / "out")]) == 0
    assert {path.name.split(".")[0] for path in (tmp_path / "out").iterdir()} == {"walk"}
    assert main(["export", ".", "--to", "mjlab-task", "--out", str(tmp_path / "task")]) == 1


@pytest.mark.parametrize("words", [["--help"], ["run", "--help"], ["--version"], ["robots", "list"]])
def test_nobody_reads_the_output(words):
    done = program_with(CLOSED, *words)
    assert (done.returncode, done.stderr) == (cli.PIPE_CLOSED, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
@pytest.mark.parametrize("words", [["--help"], ["--version"], ["robots", "list"]])
def test_the_output_is_on_a_full_disk(words):
    done = program_with("import os; os.dup2(os.open('/dev/full', os.O_WRONLY), 1)", *words)
    assert done.returncode == 1
    assert done.stderr.startswith("error: the output cannot be written (No space left")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("module", ["tyro", "numpy", "mujoco"])
def test_ctrl_c_while_modules_are_imported(module):
    preparation = f"""
import sys
from dataclasses import replace
class Interrupter:
    def find_spec(self, name, *_):
        if name == {module!r}: raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupter())"""
    done = program_with(preparation, "robots", "check", "unitree_g1")
    assert done.returncode == cli.INTERRUPTED
    assert done.stderr == "error: interrupted; what was finished before is complete.\n"


def test_streams_that_cannot_show_a_character_or_are_closed(tmp_path):
    done = program_with("", "inspect", str(tmp_path / "kl\u00f6tze\udc80.pt"), PYTHONIOENCODING="ascii")
    assert done.returncode == 1
    assert "kl\\xf6tze\\udc80.pt: there is no such file" in done.stderr
    assert program_with("", "--help", PYTHONIOENCODING="ascii").returncode == 0
    assert program_with("import sys; sys.stdout = sys.stderr = None", "--help").returncode == 0


def test_unreadable_folders_are_no_traceback(run, recording, monkeypatch):
    def refuse(name):
        real = getattr(Path, name)

        def refused(path, *words):
            if path.name in ("locked", "clip.pt"):
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
            return real(path, *words)

        monkeypatch.setattr(Path, name, refused)

    (recording / "locked").mkdir()
    for name in ("is_dir", "iterdir", "exists"):
        refuse(name)
    code, _, err = run("locked/clip.pt")
    assert code == 1 and err.startswith("error: locked/clip.pt: cannot be read") and err.count("\n") == 1
    code = main(["run", f"{NAME}.pt", "--objects", "locked", "--out", "out"])
    assert code == 2


@pytest.mark.parametrize("variable", ["NO_COLOR", "COLORTERM"])
def test_no_color_holds_for_wrong_words_too(variable):
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    environment = {**{k: v for k, v in os.environ.items() if k != "NO_COLOR"}, "TERM": "xterm", variable: "1"}
    words = [sys.executable, "-m", "hoi_retarget", "run"]
    done = subprocess.run(words, stdout=theirs, stderr=theirs, env=environment, check=False)
    text = os.read(ours, 100_000)
    os.close(ours)
    os.close(theirs)
    assert done.returncode == 2
    assert (b"\x1b[" in text) == (variable != "NO_COLOR")


@pytest.mark.parametrize("width", [40, 60, 80, 140])
@pytest.mark.parametrize("count", [1, 2, 5])
def test_tables_break_no_word(width, count, results, monkeypatch, capsys):
    monkeypatch.setattr(terminal, "PLAIN_WIDTH", width)
    monkeypatch.chdir(results[0].parent)
    assert main(["evaluate", *["carry_box.npz"] * count]) == 0
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines()[1:])) <= width
    words = {"contact", "velocity", "direction", "object", "scale", "unitree_g1", "rotation", "[m/s^3]"}
    assert words <= set(out.split())


def test_clips_and_results_are_told_apart(results, recording, capsys):
    assert main(["evaluate", str(recording / f"{NAME}.pt")]) == 1
    assert f"this is a clip, not a result. Use `{terminal.program()} run`" in capsys.readouterr().err
    assert main(["run", str(results[0]), "--out", str(recording / "out")]) == 1
    assert "not a clip. Use `hoi-retarget evaluate`" in capsys.readouterr().err


def test_what_cannot_be_written_is_named(results, tmp_path, monkeypatch, capsys):
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    assert main(["evaluate", str(results[0]), "--json", str(tmp_path / "f.json")]) == 1
    err = capsys.readouterr().err
    assert err.startswith(f"error: --json {tmp_path / 'f.json'}: cannot be written (No space left on device). Free")
    assert "--out" not in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["check", __file__], "descriptions of robots are MJCF (.xml) or URDF (.urdf)"),
        (["show", "unitree_g1", "--picture", "g1.foo"], "ends in .png"),
    ],
)
def test_what_robots_cannot_do_comes_with_what_to_do(words, message, capsys):
    assert main(["robots", *words]) == 2
    out, err = capsys.readouterr()
    assert not out and message in err and err.count("\n") == 1


def test_commands_are_shown_as_the_program_was_started(monkeypatch):
    monkeypatch.setattr(terminal.shutil, "which", lambda _: "/usr/bin/hoi-retarget")
    for started, shown in (
        (".venv/bin/hoi-retarget", ".venv/bin/hoi-retarget"),
        ("/a b/hoi-retarget", "'/a b/hoi-retarget'"),
        ("/usr/bin/hoi-retarget", "hoi-retarget"),
        ("/x/hoi_retarget/__main__.py", f"{sys.executable} -m hoi_retarget"),
        ("pytest", "hoi-retarget"),
    ):
        monkeypatch.setattr(sys, "argv", [started])
        assert terminal.program() == shown


# demo, evaluate, inspect, robots


@pytest.fixture(scope="session")
def results(tmp_path_factory):
    """Two results of the demo, one for each robot."""
    folder = tmp_path_factory.mktemp("results")
    for robot in ROBOTS:
        assert (
            main(["run", "builtin:carry_box", "--robot", robot, "--contact", "landmark", "--out", str(folder / robot)])
            == 0
        )
    return [folder / robot / "carry_box.npz" for robot in ROBOTS]


def test_demo_says_where_the_result_is_and_what_to_do_next(tmp_path, capsys):
    assert main(["demo", "--no-look", "--out", str(tmp_path / "here")]) == 0
    out, err = capsys.readouterr()
    assert not err
    assert listing(tmp_path / "here") == ["carry_box.npz"]
    assert str(tmp_path / "here" / "carry_box.npz") in out
    assert "touch [%]" in out and "contact gap" not in out and "hoi-retarget inspect" in out
    motion = load(tmp_path / "here" / "carry_box.npz")
    assert motion.report.figures["touch_share"] > 0.95
    assert not motion.report.unreached_contacts


def test_demo_with_an_unknown_robot(tmp_path, capsys):
    assert main(["demo", "--robot", "r2d2", "--out", str(tmp_path / "x")]) == 2
    err = capsys.readouterr().err
    assert all(name in err for name in ROBOTS)
    assert not listing(tmp_path)


def test_evaluate_shows_what_the_results_hold(results, tmp_path, capsys):
    words = ["evaluate", *map(str, results), "--json", str(tmp_path / "f.json"), "--csv", str(tmp_path / "f.csv")]
    assert main(words) == 0
    out, err = capsys.readouterr()
    # A squatting H2 has its knees in the box: what results say of themselves is told, and no more.
    assert err.splitlines() == [f"warning: {path}: {told}" for path in results for told in load(path).warnings]
    assert out.startswith("Figures as the run computed and stored them:")
    assert "mean" in out and "worst" in out
    document = json.loads((tmp_path / "f.json").read_text())
    stored = [load(path).report.figures["contact_gap_m"] for path in results]
    assert [row["contact_gap_m"] for row in document["per_clip"]] == stored
    assert document["mean"]["contact_gap_m"] == pytest.approx(np.mean(stored))
    with (tmp_path / "f.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows] == [*["carry_box"] * len(ROBOTS), "mean", "worst"]
    assert [row["robot"] for row in rows[:-2]] == [row["robot"] for row in document["per_clip"]] == list(ROBOTS)
    assert [row["file"] for row in rows[:-2]] == list(map(str, results))
    assert all(
        float(row["object_scale"]) == load(path).object_scale[0] for row, path in zip(rows, results, strict=False)
    )
    assert all(name in out for name in ROBOTS) and "object scale" in out


@pytest.mark.slow
def test_evaluate_and_inspect_warn_of_what_run_warns_of(run, recording, capsys):
    _, out, err = run(f"{NAME}.pt", "--object-scale", "2.5")
    assert "object scale 2.500" in out and "root scale 0." in out
    expected = [line.split(f"{NAME}.npz: ")[1] for line in err.splitlines()]
    assert expected
    for command in ("evaluate", "inspect"):
        assert main([command, f"out/{NAME}.npz"]) == 0
        out, err = capsys.readouterr()
        assert [line.split(f"{NAME}.npz: ")[1] for line in err.splitlines()] == expected
        assert "unitree_g1" in out and "2.500" in out
    assert f"licence       {intermimic.LICENCE}" in out and f"source        {NAME}.pt" in out
    assert "(trajectory)" in out and "unreached" in out and "flipped" in out


def test_inspect_describes_a_result_with_an_empty_report_and_refuses_a_damaged_one(results, tmp_path, capsys):
    with np.load(results[0]) as archive:
        arrays = dict(archive)
    for report, code, words in (("{}", 0, ""), ('{"source": 3}', 1, "its report is damaged")):
        arrays["report"] = np.str_(report)
        np.savez(tmp_path / "bare.npz", **arrays)
        assert main(["inspect", str(tmp_path / "bare.npz")]) == code
        out, err = capsys.readouterr()
        assert words in err and err.count("\n") == code
        assert "unitree_g1" in out or code


def test_evaluate_many_shows_a_row_for_each(results, monkeypatch, capsys):
    monkeypatch.chdir(results[0].parent)
    assert main(["evaluate", *["carry_box.npz"] * 6]) == 0
    out = capsys.readouterr().out
    assert sum("unitree_g1" in line for line in out.splitlines()) == 6
    assert "all clips" in out


def test_evaluate_names_what_it_cannot_read(results, tmp_path, capsys):
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    assert main(["evaluate", str(tmp_path / "other.npz"), str(results[0]), str(tmp_path / "gone.npz")]) == 1
    out, err = capsys.readouterr()
    assert [line.startswith("error: ") for line in err.splitlines()] == [True, True]
    assert "contact gap" in out and "1 evaluated, 2 failed." in out


def test_evaluate_refuses_a_result_without_figures(results, tmp_path, capsys):
    with np.load(results[0]) as archive:
        arrays = dict(archive)
    for report in ("{}", '{"figures": {"x": 1}, "cpu_seconds": {}}', "[]"):
        arrays["report"] = np.str_(report)
        np.savez(tmp_path / "bare.npz", **arrays)
        assert main(["evaluate", str(tmp_path / "bare.npz")]) == 1
        err = capsys.readouterr().err
        assert "bare.npz" in err and err.count("\n") == 1


def test_evaluate_shows_results_of_a_version_that_knew_fewer_figures(results, tmp_path, capsys):
    with np.load(results[0]) as archive:
        arrays = dict(archive)
    report = json.loads(str(arrays["report"]))
    del report["figures"]["object_float_m"]
    np.savez(tmp_path / "old.npz", **{**arrays, "report": np.str_(json.dumps(report))})
    assert main(["evaluate", str(tmp_path / "old.npz"), "--json", str(tmp_path / "f.json")]) == 0
    out = capsys.readouterr().out
    assert "object below floor" in out and "object float" not in out


def test_evaluate_tells_first_that_it_cannot_write(results, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["evaluate", str(results[0]), "--json", str(tmp_path / "file" / "f.json")]) == 2
    out, err = capsys.readouterr()
    assert "--json" in err and not out


def test_evaluate_nothing(capsys):
    assert main(["evaluate"]) == 2
    assert "RESULT" in capsys.readouterr().err


def test_inspect_a_clip_gives_a_command_that_runs(recording, monkeypatch, capsys):
    monkeypatch.chdir(recording)
    assert main(["inspect", f"{NAME}.pt", "--objects", "objects"]) == 0
    out, err = capsys.readouterr()
    assert not err
    command = next(line for line in out.splitlines() if line.startswith("to run: ")).split()[2:]
    assert command[0] == "hoi-retarget"
    assert main(command[1:]) == 0


def test_inspect_says_what_is_missing(recording, capsys):
    assert main(["inspect", str(recording / f"{NAME}.pt")]) == 0
    assert "missing: " in capsys.readouterr().out


def test_inspect_a_result(results, capsys):
    assert main(["inspect", str(results[0])]) == 0
    assert f"to run: hoi-retarget evaluate {results[0]}" in capsys.readouterr().out


def test_inspect_something_else(tmp_path, capsys):
    (tmp_path / "note.txt").write_text("hello")
    assert main(["inspect", str(tmp_path / "note.txt")]) == 1
    assert capsys.readouterr().err.startswith("error: ")
    assert main(["inspect", str(tmp_path / "gone")]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_robots_list(capsys):
    assert main(["robots", "list"]) == 0
    out = capsys.readouterr().out
    assert all(name in out for name in ROBOTS)


@pytest.mark.parametrize("name", ROBOTS)
def test_robots_show(name, capsys):
    assert main(["robots", "show", name]) == 0
    out = capsys.readouterr().out
    assert all(joint in out for joint in ROBOTS[name].speed_limits)
    assert "left_palm" in out and "BSD-3-Clause" in out


def test_robots_show_unknown(capsys):
    assert main(["robots", "show", "atlas"]) == 2
    err = capsys.readouterr().err
    assert all(name in err for name in ROBOTS)


def test_write_clip_is_what_these_tests_use(recording, columns):
    write_clip(make("carry_box", seconds=3.0), recording / "again.pt")
    assert (recording / "again.pt").read_bytes() == torch_bytes(columns)


@pytest.mark.slow
def test_robots_show_draws_a_picture(tmp_path):
    picture = tmp_path / "new" / "g1.png"
    words = [sys.executable, "-m", "hoi_retarget", "robots", "show", "unitree_g1", "--picture", str(picture)]
    if trouble("egl"):
        need_drawing("osmesa")
    # In a process of its own: how to draw is chosen before MuJoCo is imported.
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert f"written: {picture}" in done.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_robots_show_tells_first_that_it_cannot_write(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["robots", "show", "unitree_g1", "--picture", str(tmp_path / "file" / "g1.png")]) == 2
    assert "--picture" in capsys.readouterr().err


@pytest.mark.parametrize("name", ROBOTS)
def test_robots_check_finds_nothing_wrong_with_ours(name, capsys):
    assert main(["robots", "check", name]) == 0
    said = capsys.readouterr().out
    assert "error" not in said
    assert "ok    builtin:move_chair: converged" in said


def test_robots_check_a_file(tmp_path, capsys):
    (tmp_path / "a.xml").write_text("<mujoco><worldbody><body><freejoint/></body></worldbody></mujoco>")
    assert main(["robots", "check", str(tmp_path / "a.xml")]) == 1
    assert main(["robots", "check", str(tmp_path / "gone.xml")]) == 1
    assert "there is no such file" in capsys.readouterr().out
    assert main(["robots", "check", "atlas"]) == 2


@pytest.mark.parametrize("figures", ["none", "fast"])
def test_run_computes_the_figures_that_are_named(figures, tmp_path, capsys):
    arguments = ["run", "builtin:carry_box", "--contact", "landmark", "--figures", figures, "--out", str(tmp_path)]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    motion = load(tmp_path / "carry_box.npz")
    assert motion.report.config["figures"] == figures
    assert "verdict" in printed
    assert ("contact gap" in printed) == (figures == "fast") == ("contact_gap_m" in motion.report.figures)
    assert "touch_share" not in motion.report.figures
    assert (main([*arguments, "--json", "-"]) == 2) == (figures == "none")
