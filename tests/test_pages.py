"""`hoi-retarget view` and `edit` as they are started: where they are, how they end, what they refuse."""

import signal
import subprocess
import sys
import urllib.request
from contextlib import contextmanager

import pytest

from hoi_retarget.cli import main
from hoi_retarget.clip.edits import ContactEdits, FixAll, save
from synthetic import make


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo")
    assert main(["run", "builtin:carry_box", "--contact", "landmark", "--out", str(folder)]) == 0
    return folder / "carry_box.npz"


@contextmanager
def started(*words: str, folder):
    command = [sys.executable, "-m", "hoi_retarget", *words]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        lines = []
        for line in process.stdout:
            lines.append(line)
            if line.startswith("Open "):
                break
        yield process, "".join(lines)
    finally:
        process.kill()
        process.communicate()


def page_at(text: str) -> bytes:
    address = text.split("Open ")[1].split(" in a browser", maxsplit=1)[0]
    assert address.startswith("http://localhost:")
    with urllib.request.urlopen(address, timeout=60) as answer:
        return answer.read()


@pytest.mark.slow
@pytest.mark.parametrize("words", [("view", "carry_box.npz"), ("edit", "builtin:carry_box")], ids=["view", "edit"])
def test_it_says_where_the_page_is_and_ends_with_ctrl_c(demo, words):
    with started(*words, folder=demo.parent) as (process, said):
        assert b"<html" in page_at(said).lower()
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
        assert process.returncode == 0
        assert "Traceback" not in err


@pytest.mark.slow
def test_the_editor_says_where_edits_go_and_which_run_makes_the_same(demo):
    words = ("edit", "builtin:carry_box", "--root-scale", "0.8", "--out", "there")
    with started(*words, folder=demo.parent) as (_, said):
        assert "carry_box.edits.toml" in said
        assert "run builtin:carry_box --out there --edits carry_box.edits.toml --root-scale 0.8" in said


def test_results_none_of_which_can_be_read_are_refused(tmp_path, capsys):
    (tmp_path / "other.npz").write_bytes(b"something else")
    assert main(["view", str(tmp_path / "other.npz"), str(tmp_path / "absent.npz")]) == 1
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 2
    assert "not a readable .npz" in errors[0]
    assert "no such file" in errors[1]


def test_no_result_and_a_bad_port_are_wrong_arguments(demo, capsys):
    assert main(["view"]) == 2
    assert main(["view", str(demo), "--port", "99999"]) == 2
    assert main(["view", str(demo), "--host", "203.0.113.1"]) == 2
    assert "--host 203.0.113.1" in capsys.readouterr().err


def test_edits_of_another_clip_are_refused_with_the_reason(tmp_path, capsys):
    other = make("push_table", seconds=3.0)
    save(ContactEdits.of(other).adding(FixAll()), tmp_path / "edits.toml")
    assert main(["edit", "builtin:carry_box", "--edits", str(tmp_path / "edits.toml")]) == 1
    assert "frames" in capsys.readouterr().err
