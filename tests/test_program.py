"""Names that do not exist are told with the one that is meant; `--json -` and lines of progress are for programs."""

import json
import re
import subprocess
import sys
import time

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from hoi_retarget.cli import main, terminal
from hoi_retarget.cli.commands import COMMANDS
from hoi_retarget.cli.program import run
from hoi_retarget.cli.terminal import Working
from hoi_retarget.errors import did_you_mean
from hoi_retarget.motion.formats import WRITABLE
from hoi_retarget.motion.write_export import DATASET
from hoi_retarget.robots import ROBOTS, load_robot, robot
from hoi_retarget.simulation.mjlab_task import NAME as TASK
from synthetic import SCENES


def help_of(words, capsys):
    with pytest.raises(SystemExit):
        run([*words, "--help-all" if len(words) == 1 and words[0] in COMMANDS else "--help"])
    return capsys.readouterr().out


@given(st.sampled_from([*COMMANDS, *ROBOTS, *SCENES]), st.data())
def test_a_name_that_lacks_a_letter_or_has_one_more_is_told_as_it_is(name, data):
    place = data.draw(st.integers(0, len(name) - 1))
    known = [*COMMANDS, *ROBOTS, *SCENES]
    longer = name[:place] + data.draw(st.sampled_from("aeqx")) + name[place:]
    shorter = name[:place] + name[place + 1 :]
    assert did_you_mean(longer, known) == f" Did you mean {name}?"
    assume(shorter != "eport")  # Report or export.
    assert len(name) < 5 or did_you_mean(shorter, known) == f" Did you mean {name}?"


TYPOS = {
    "runn x": "run?",
    "demo --ot o": "--out DIR",
    "view x --prot 3": "--port PORT",
    "run x --out o --jerk 3": "--weights.jerk FLOAT",
    "run x --out o --weights.jrek 3": "--weights.jerk FLOAT",
    "render x --out o --only robt": "'robot'",
    "run x --out o --contact=landmrk": "'landmark'",
    "robots lst": "list",
    "robots show g1 --pictur a.png": "--picture FILE",
    "demo --robot unitree_g": "unitree_g1?",
    "run builtin:cary_box --out o": "builtin:carry_box?",
    "export x.npz --to mjlb --out o": "mjlab?",
}
"""Words -> the name that is meant, as the error has it."""


@pytest.mark.parametrize("words", TYPOS)
def test_what_is_misspelt_ends_with_2_and_one_message_that_names_what_is_meant(words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    try:
        code = main(words.split())
    except SystemExit as exit_:
        code = exit_.code
    said = capsys.readouterr()
    assert code == 2 and len(re.findall("^error: |For full helptext", said.err, re.MULTILINE)) == 1
    assert TYPOS[words] in said.err
    assert not any(tmp_path.iterdir())


def test_nothing_like_it_is_told_without_a_guess(capsys):
    assert main(["zzzz"]) == 2
    error = capsys.readouterr().err
    assert "Did you mean" not in error and "demo" in error


@pytest.mark.parametrize("name", COMMANDS)
def test_help_explains_every_option(name, capsys):
    """Behind an option stands its text, or in the next line, which is neither another option nor the frame."""
    lines = [line.strip("│|").strip() for line in help_of([name], capsys).splitlines()]
    options = [index for index, line in enumerate(lines) if re.match("--[a-z]", line) and "{--" not in line]
    assert bool(options) == (name not in ("doctor", "robots", "sample", "settings"))
    bare = [lines[index] for index in options if not re.search(r"  [^\s(]", lines[index])]
    assert [line for line in bare if not re.match(r"\w", lines[lines.index(line) + 1])] == []


def test_help_of_export_names_every_format(capsys):
    words = help_of(["export"], capsys).split()
    assert {f"{name}," for name in WRITABLE} <= {f"{word.strip(',')}," for word in words}
    assert {DATASET, TASK} <= set(words)


def test_run_starts_without_what_it_need_not_have():
    """Nothing slow, and few modules: what only other commands need is imported by them."""
    code = "import sys, hoi_retarget.cli.run; print(*sys.modules)"
    modules = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    slow = {"scipy.signal", "scipy.spatial", "scipy.optimize", "scipy.ndimage", "trimesh", "igl", "PIL", "jinja2"}
    assert not slow & set(modules)
    assert sum(name.split(".")[0] == "hoi_retarget" for name in modules) <= 200


@pytest.mark.parametrize("full", ROBOTS)
def test_robots_have_short_names_and_one_model(full):
    short = full.partition("_")[2]
    assert robot(short) is robot(short.upper()) is ROBOTS[full]
    assert load_robot(short) is load_robot(full)


@pytest.mark.parametrize("words", [["robots", "list"], ["robots", "show", "h2"], ["contacts", "builtin:push_table"]])
def test_json_alone_is_on_stdout_and_a_file_holds_the_same(words, capsys, tmp_path):
    assert main([*words, "--json", "-"]) == 0
    said = capsys.readouterr()
    facts = json.loads(said.out)
    assert facts and said.err
    assert main([*words, "--json", str(tmp_path / "facts.json")]) == 0
    assert json.loads((tmp_path / "facts.json").read_text()) == facts
    assert "written" in capsys.readouterr().out


def test_json_of_results_and_files_is_on_stdout(capsys, tmp_path):
    arguments = ["run", "builtin:push_table", "--contact", "landmark", "--out", str(tmp_path), "--json", "-"]
    assert main(arguments) == 0
    from_run = json.loads(capsys.readouterr().out)
    result = str(tmp_path / "push_table.npz")
    assert main(["evaluate", result, "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out) == from_run
    assert main(["inspect", result, "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["is_result"]
    for command in ("check-motion", "feasible"):
        assert main([command, result, "--json", "-"]) == 0
        assert json.loads(capsys.readouterr().out)


def test_json_over_a_file_that_is_read_is_refused(capsys, tmp_path):
    clip = tmp_path / "clip.npz"
    assert main(["convert", "builtin:carry_box", "--out", str(clip)]) == 0
    before = clip.read_bytes()
    assert main(["contacts", str(clip), "--json", str(clip)]) == 2
    assert clip.read_bytes() == before and "would be written over" in capsys.readouterr().err


def test_work_that_takes_long_is_told_now_and_then_where_there_is_no_terminal(capsys, monkeypatch):
    monkeypatch.setattr(terminal, "PAUSE_S", 0.02)
    with Working("drawing", 3) as working:
        working.advance()
        time.sleep(0.2)
    said = capsys.readouterr()
    assert "drawing: 1 of 3, 0 s" in said.err and not said.out
    time.sleep(0.1)
    assert not capsys.readouterr().err


def test_work_that_is_short_is_not_told(capsys):
    with Working("drawing", 3):
        pass
    assert not capsys.readouterr().err
