"""The README's commands run, and what the documents promise is what the code has."""

import dataclasses
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from hoi_retarget.retargeting.config import Weights
from hoi_retarget.robots import ROBOTS
from hoi_retarget.robots.spec import SITES
from offscreen import trouble

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"^```sh *(\w*)\n(.*?)^```", README, flags=re.MULTILINE | re.DOTALL)


def block(label: str) -> list[str]:
    return [line for name, text in BLOCKS for line in text.strip().splitlines() if name == label]


def after_installation(line: str) -> list[str]:
    """Return the words of a README line's last command, to be run with this interpreter."""
    words = shlex.split(line.rsplit("&&", maxsplit=1)[-1])
    program = Path(words[0]).name
    return [sys.executable, *(["-m", "hoi_retarget"] if program == "hoi-retarget" else []), *words[1:]]


def test_one_line_installs_and_demonstrates_and_one_tests():
    (demo,), (test,) = block("demo"), block("test")
    install = "python3.11 -m venv .venv && .venv/bin/pip install ."
    assert demo == f"{install} && .venv/bin/hoi-retarget demo --out out"
    assert test.split(" && ")[-1].startswith(".venv/bin/pytest")


def test_ci_runs_exactly_the_readmes_test_command():
    (test,) = block("test")
    lines = (ROOT / ".ci" / "run").read_text().splitlines()
    assert test in lines
    for tool in ("ruff check", "ruff format --check", "pyright", "lint-imports"):
        assert any(line.startswith(f".venv/bin/{tool}") for line in lines)


@pytest.mark.slow
def test_the_readmes_commands_run_in_its_order(tmp_path):
    (demo,) = block("demo")
    drawn = not trouble("egl") or not trouble("osmesa")
    uses = [demo, *(line for line in block("") if drawn or " render " not in line)]
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    for line in uses:
        done = subprocess.run(after_installation(line), cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"
    assert (tmp_path / "out" / "carry_box.npz").is_file()
    assert (tmp_path / "gallery" / "index.html").is_file() and (tmp_path / "report" / "report.html").is_file()
    if not drawn:
        pytest.skip("all commands ran but `render`: MuJoCo cannot draw here")
    assert (tmp_path / "carry_box.png").is_file()


def test_the_method_lists_every_weight_as_it_is():
    text = (ROOT / "docs" / "method.md").read_text()
    rows = re.findall(r"^\|[^|]*\|[^|]*\| `(\w+)` \| ([\d.e-]+) \| `(\w+)` \|$", text, flags=re.MULTILINE)
    assert {name: float(value) for name, value, _ in rows} == dataclasses.asdict(Weights())
    folders = (ROOT / "src/hoi_retarget/retargeting" / name for name in ("trajopt/terms", "surfaces"))
    terms = {path.stem for folder in folders for path in folder.glob("[a-z]*.py")}
    assert {term for _, _, term in rows} <= terms


def test_the_robots_page_names_every_robot_and_every_site():
    text = (ROOT / "docs" / "robots.md").read_text()
    assert all(f"| `{name}` |" in text for name in ROBOTS)
    for site in SITES:
        side, _, rest = site.partition("_")
        names = (f"`{site}`", f"..._{rest.removeprefix('sole_')}`", f"`left_{rest}`, `right_{rest}`")
        assert any(name in text for name in names) or (side == "right" and "and right" in text), site
