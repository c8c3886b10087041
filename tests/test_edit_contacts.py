"""The command line around contact edits: the table, the file, and that `run` uses it to the bit."""

import errno
import os
import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from hoi_retarget.cli import edit_contacts as module
from hoi_retarget.cli import main
from hoi_retarget.cli.commands import Contacts
from hoi_retarget.clip.edits import (
    OPERATIONS,
    Add,
    ContactEdits,
    Delete,
    Fix,
    FixAll,
    Merge,
    Move,
    Pin,
    Retime,
    Snap,
    SnapAll,
    Split,
    apply,
    from_text,
    load,
    save,
)
from hoi_retarget.motion.result_file import load as load_motion
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.readers.open import clip_of, open_clip
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.robots import robot
from hoi_retarget.robots.model import load_model
from synthetic import make

BOX = "builtin:carry_box"
PAGE = (Path(__file__).parents[1] / "docs" / "contacts.md").read_text()
ARRAYS = ("qpos", "object_pos", "contact_flags", "contact_points", "stance_flags")


@pytest.fixture
def call(tmp_path, monkeypatch, capsys):
    """Run a command in an empty folder; return exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)

    def run(*words: object):
        code = main([str(word) for word in words])
        return code, *capsys.readouterr()

    return run


def rows(out: str) -> list[list[str]]:
    """The table's rows, split at two spaces."""
    return [re.split(r"\s{2,}", line.strip()) for line in out.splitlines() if "_hand" in line]


def listing(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir()) if folder.exists() else []


def test_the_table_without_edits(call, tmp_path):
    code, out, err = call("contacts", BOX)
    assert (code, err) == (0, "")
    assert rows(out) == [
        ["left_hand", "box", "87 to 223", "4.57", "0.0", "25.0"],
        ["right_hand", "box", "87 to 223", "4.57", "0.0", "25.0"],
    ]
    assert not listing(tmp_path)


def test_several_people_have_a_column(call):
    out = call("contacts", "builtin:carry_table", "--delete", "p1.left_hand:100")[1]
    assert [row[:2] for row in rows(out)] == [["p0", "left_hand"], ["p0", "right_hand"], ["p1", "right_hand"]]
    assert "after 1 edit\n" in out


def test_options_become_edits_in_the_documented_order(call, tmp_path):
    words = {
        "--move": ["left_hand:100:0.01,-0.02,1e-3", "p0.right_hand:100:1,0,0"],
        "--snap": ["all", "left_hand:88"],
        "--fix-segments": ["left_hand:87", "all"],
        "--add": ["left_foot:3:5:0,0,-0.1", "right_foot:3:5:0,0,0:box"],
        "--retime": ["right_hand:100:90:200"],
        "--split": ["left_hand:100:120", "left_hand:130:140"],
        "--merge": ["left_hand:90"],
        "--delete": ["right_hand:223"],
        "--pin": ["left_hand:40:0.7,0.25,0.9", "p0.pelvis:50:0.6,0,0.8:0,0,10"],
        "--out": ["edits.toml"],
    }
    del words["--delete"], words["--merge"]
    code, _, err = call("contacts", BOX, *(word for option, values in words.items() for word in (option, *values)))
    assert (code, err) == (0, "")
    assert load(tmp_path / "edits.toml").edits == (
        Split("left_hand", 100, 120),
        Split("left_hand", 130, 140),
        Retime("right_hand", 100, 90, 200),
        Add("left_foot", 3, 5, (0.0, 0.0, -0.1)),
        Add("right_foot", 3, 5, (0.0, 0.0, 0.0), "box"),
        Fix("left_hand", 87),
        FixAll(),
        SnapAll(),
        Snap("left_hand", 88),
        Move("left_hand", 100, (0.01, -0.02, 1e-3)),
        Move("right_hand", 100, (1.0, 0.0, 0.0)),
        Pin("left_hand", 40, (0.7, 0.25, 0.9)),
        Pin("pelvis", 50, (0.6, 0.0, 0.8), (0.0, 0.0, 10.0)),
    )


def test_a_file_goes_first_and_further_edits_behind_it(call, tmp_path):
    assert call("contacts", BOX, "--split", "left_hand:100:120", "--out", "a.toml")[0] == 0
    words = ("--merge", "left_hand:100", "--delete", "right_hand:100", "--out", "b.toml")
    assert call("contacts", BOX, "--edits", "a.toml", *words)[0] == 0
    expected = (Split("left_hand", 100, 120), Delete("right_hand", 100), Merge("left_hand", 100))
    assert load(tmp_path / "b.toml").edits == expected
    code, out, _ = call("contacts", BOX, "--edits", "b.toml")
    assert code == 0 and [row[0] for row in rows(out)] == ["left_hand"] and "after 3 edits" in out


def test_every_option_of_edits_is_a_field():
    options = [option.removeprefix("--").replace("-", "_") for option, *_ in module._OPTIONS]
    fields = list(Contacts.__dataclass_fields__)
    first = fields.index(options[0])
    assert fields[first : first + len(options)] == options, "help shows them in the order in which they are done"


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["carry_box", "carry_table"])
def test_run_gives_to_the_bit_what_python_gives(scene, call, tmp_path):
    clip = open_clip(f"builtin:{scene}")
    edits = (
        ContactEdits.of(clip).adding(Split("left_hand", 100, 120)).adding(Move("left_hand", 130, (0.01, 0.0, 1 / 30)))
    )
    save(edits.adding(SnapAll()), tmp_path / "edits.toml")
    code, out, _ = call("run", f"builtin:{scene}", "--edits", "edits.toml", "--out", "out")
    assert code == 0 and out.endswith("1 solved, 0 failed.\n")
    edited = apply(clip, load(tmp_path / "edits.toml"))
    model = load_model(robot("unitree_g1"))
    paths = sorted((tmp_path / "out").iterdir())
    assert len(paths) == len(clip.people)
    for person, path in enumerate(paths):
        ours, expected = load_motion(path), retarget(edited, model, Config(), person=person)
        for name in ARRAYS:
            assert getattr(ours, name).tobytes() == getattr(expected, name).tobytes(), name
        # Of one robot alone, nobody knows how deep it is in another.
        figures = {**expected.report.figures, "robot_penetration_max_m": ours.report.figures["robot_penetration_max_m"]}
        assert ours.report.figures == figures
        assert ours.report.source.contact_edits == (tmp_path / "edits.toml").read_text()
        again = clip_of(ours)
        assert again.source == edited.source
        for a, b in zip(again.contacts, edited.contacts, strict=True):
            np.testing.assert_array_equal(a.contact_points, b.contact_points)


def test_results_of_built_in_clips_have_their_names(call, tmp_path):
    code, out, _ = call("run", BOX, "builtin:push_table", "--contact", "landmark", "--out", "out")
    assert code == 0 and "builtin:carry_box: 268 frames" in out
    assert listing(tmp_path / "out") == ["carry_box.npz", "push_table.npz"]
    assert load_motion(tmp_path / "out" / "carry_box.npz").report.source.path == BOX


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["--move", "left_hand:100"], 2, "--move left_hand:100: expected PART:FRAME:DX,DY,DZ."),
        (["--move", "left_hand:100:0,0"], 2, "expected PART:FRAME:DX,DY,DZ."),
        (["--move", "left_hand:100:0,0,0:box"], 2, "expected PART:FRAME:DX,DY,DZ."),
        (["--move", "left_hand:100:0,0,nan"], 2, "three numbers in metres"),
        (["--pin", "left_knee:4:0,0,0"], 2, "part is 'left_knee'; parts that can be pinned: left_hand, right_hand,"),
        (["--pin", "left_hand:4:0,0"], 2, "expected PART:FRAME:X,Y,Z[:RX,RY,RZ]."),
        (["--pin", "left_hand:4:0,0,0:0,0,181"], 2, "three numbers in degrees, none beyond 180."),
        (["--pin", "left_hand:268:0.7,0.25,0.9"], 1, "the clip has frames 0 to 267; asked for: frame 268."),
        (
            ["--pin", "left_hand:40:4,0,1"],
            1,
            "out of reach: 3.33 m from where left_hand is in frame 40 of the recording",
        ),
        (["--unpin", "left_hand:40"], 1, "left_hand is not pinned in frame 40. Pinned: none."),
        (["--move", "all"], 2, "expected PART:FRAME:DX,DY,DZ."),
        (["--fix-segments", "some"], 2, "--fix-segments some: expected all or PART:FRAME."),
        (["--split", "left_hand:ten:3"], 2, "expected PART:FRAME:AT."),
        (["--add", "left_hand:1:3"], 2, "expected PART:START:STOP:X,Y,Z[:OBJECT]."),
        (["--delete", "head:3"], 2, "parts that can touch: left_hand"),
        (["--delete", "px.left_hand:3"], 2, "expected PART:FRAME."),
        (["--delete", "left_hand:-3"], 2, "frame is -3"),
        (["--delete", "left_hand:3"], 1, "touches nothing in frame 3. It touches 'box' in frames 87 to 223."),
        (["--delete", "p1.left_hand:100"], 1, "there is no person 1"),
        (["--add", "left_foot:1:3:0,0,0:a:b"], 1, "there is no object 'a:b'"),
        (["--edits", "gone.toml"], 1, "gone.toml: there is no such file"),
        (["--edits", "other.toml"], 1, "made for another clip, 'carry_table'"),
        (["--out", "other.toml/edits.toml"], 2, "--out"),
    ],
)
def test_what_is_wrong_is_one_line(words, code, message, call, tmp_path):
    save(ContactEdits.of(make("carry_table")), tmp_path / "other.toml")
    done = call("contacts", BOX, *words)
    assert done[0] == code and not done[1]
    assert done[2].startswith("error: ") and done[2].count("\n") == 1 and message in done[2]
    assert listing(tmp_path) == ["other.toml"]


@pytest.mark.parametrize("command", [["contacts"], ["run", "--out", "out"]])
def test_built_in_clips_that_there_are_not(command, call, tmp_path):
    code, _, err = call(*command, "builtin:juggle")
    assert code == 2 and "builtin:carry_box, builtin:push_table" in err
    assert not listing(tmp_path)


def test_edits_are_for_one_clip(call, tmp_path):
    code, out, err = call("run", BOX, "builtin:push_table", "--edits", "e.toml", "--out", "out")
    assert code == 2 and "is for one clip, and 2 are named" in err and not out
    save(ContactEdits.of(make("carry_table")), tmp_path / "e.toml")
    code, _, err = call("run", BOX, "--edits", "e.toml", "--out", "out")
    assert code == 1 and "made for another clip" in err and err.count("\n") == 1
    assert not listing(tmp_path / "out")


def test_a_hull_is_told_from_a_surface(call, monkeypatch):
    clip = make("carry_box")
    (track,) = clip.objects
    hull = replace(clip, objects=(replace(track, geometry=ObjectGeometry(track.geometry.points)),))
    monkeypatch.setattr(module, "open_clip", lambda *_, **__: hull)
    code, out, err = call("contacts", BOX)
    assert code == 0 and [row[-1] for row in rows(out)] == ["25.0", "25.0"]
    assert err == "warning: object 'box': no mesh is known; its surface is the hull of its points.\n"


def test_nothing_touched(call):
    code, out, _ = call("contacts", BOX, "--delete", "left_hand:100", "right_hand:100")
    assert code == 0 and out.endswith("Nothing is touched.\n")


@pytest.mark.slow
def test_results_of_one_clip_are_written_together_or_not_at_all(call, tmp_path, monkeypatch):
    assert call("run", "builtin:carry_table", "--out", "out")[0] == 0
    before = {path: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    assert len(before) == 2
    calls = []

    def full_the_second_time(_: int) -> None:
        calls.append(1)
        if len(calls) == 2:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full_the_second_time)
    words = ("run", "builtin:carry_table", "--size-multiplier", "0.95", "--out")
    code, _, err = call(*words, "out")
    assert code == 1 and "carry_table.p1.npz: cannot be written (No space left on device)" in err
    assert {path: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before
    calls.clear()
    assert call(*words, "new")[0] == 1 and not listing(tmp_path / "new")
    calls.extend([1, 1])
    (tmp_path / "blocked" / "carry_table.p1.npz").mkdir(parents=True)
    assert call(*words, "blocked")[0] == 1 and listing(tmp_path / "blocked") == ["carry_table.p1.npz"]


# docs/contacts.md


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, flags=re.MULTILINE | re.DOTALL)


@pytest.mark.slow
def test_the_pages_commands_write_its_file(call, tmp_path):
    commands, (text,) = "".join(blocks("sh")), blocks("toml")
    for line in commands.splitlines():
        code, _, err = call(*line.split()[1:])
        assert code == 0, line
        made = tmp_path / "results" / "carry_box.npz"
        # What is moved may put a hand into the box: its result says so, and no more is told.
        told = load_motion(made).warnings if " run " in line else ()
        assert err.splitlines() == [f"warning: {made.name}: {warning}" for warning in told], line
    assert made.is_file()
    assert load(tmp_path / "edits.toml") == from_text(text, "page")
    assert (tmp_path / "edits.toml").read_text().endswith(text)


@pytest.mark.slow
def test_the_pages_python_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (code,) = blocks("python")
    exec(compile(code, "docs/contacts.md", "exec"), {})
    assert (tmp_path / "edits.toml").is_file()


def test_the_page_has_every_operation_with_its_keys():
    table = dict(re.findall(r"^\| `(\w+)` \|(.*?)\|", PAGE, flags=re.MULTILINE))
    assert {name: set(re.findall(r"`(\w+)`", keys)) for name, keys in table.items()} == {
        name: {field.name for field in fields(kind)} - {"person"} for name, kind in OPERATIONS.items()
    }
