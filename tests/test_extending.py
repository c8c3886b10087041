"""The worked examples of docs/extending.md do what the page says, and all tests hold with them."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType, ModuleType

import numpy as np
import pytest

import hoi_retarget as hr
from hoi_retarget import readers, robots
from hoi_retarget.evaluation import figures
from hoi_retarget.motion import formats
from hoi_retarget.motion.result import Result
from hoi_retarget.motion.write_export import export
from hoi_retarget.retargeting.trajopt import trajectory_terms
from test_terms import dense_jacobian, residuals

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "extending.md").read_text()
FILES = re.findall(r"^\*\*(\S+)\*\*[^\n]*\n\n```(python|diff)\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
"""Path, language and text of each block that the page shows, in its order."""
LAWS = (
    *("test_terms", "test_model"),
    *("test_readers", "test_describe", "test_open"),
    *("test_formats", "test_write_export", "test_export", "test_check_motion"),
    *("test_figures", "test_legend_texts"),
    *("test_robots", "test_robot_check", "test_fetched_meshes", "test_program", "test_readme"),
)
"""Tests that run over all terms, readers, formats, figures or robots."""
SLOW_LAWS = {"test_readers": "laboratory", "test_benchmarks": "every_format"}
"""Slow ones, and those of them that see an example."""
ELSEWHERE = ("ci_runs", "on_stdout")
"""Tests among them that need other folders, or take long and have nothing to do with the tables."""


def example(file: str) -> ModuleType:
    """Return the module of a new file that the page shows."""
    (code,) = [text for path, _, text in FILES if path.endswith(f"/{file}.py")]
    module = ModuleType(f"example_{file}")
    sys.modules[module.__name__] = module  # Dataclasses look their module up.
    exec(compile(code, file, "exec"), vars(module))
    return module


def patched(text: str, diff: str) -> str:
    """Return a text with the changes of a diff, whose parts are found by their own lines."""
    for part in diff.split("@@\n"):
        lines = part.splitlines(keepends=True)
        before, after = ("".join(line[1:] for line in lines if line[0] in signs) for signs in (" -", " +"))
        assert f"\n{text}".count(f"\n{before}") == 1, f"not there once:\n{before}"
        text = f"\n{text}".replace(f"\n{before}", f"\n{after}")[1:]
    return text


def add_examples(project: Path) -> None:
    """Do all that the page says in a copy of the project."""
    for path, language, text in FILES:
        file = project / path
        if language == "diff":
            file.write_text(patched(file.read_text(), text))
        else:
            file.write_text(f"{file.read_text()}\n\n{text}" if file.exists() else text)


def carried() -> hr.Motion:
    return hr.retarget(hr.open_clip("builtin:carry_box"), hr.load_robot("unitree_g1"), hr.Config(contact="landmark"))


without_examples = cache(carried)


def test_a_cost_term(monkeypatch):
    module, model, plain = (example("terms/hand_height"), hr.load_robot("unitree_g1"), without_examples())
    term = module.HandHeight("left_palm_height", "left_palm")
    rng = np.random.default_rng(0)
    qpos, direction = plain.qpos[:9], rng.normal(size=(9, model.nv))
    kinematics = model.forward(qpos - 0.6 * (np.arange(qpos.shape[1]) == 2))
    ahead, behind = (model.forward(model.integrate(kinematics.qpos, step * direction)) for step in (1e-6, -1e-6))
    (rows,) = term.rows(kinematics)
    numeric = (residuals(term, ahead) - residuals(term, behind)) / 2e-6
    np.testing.assert_allclose(dense_jacobian(rows, kinematics) @ direction.ravel(), numeric, atol=1e-5)
    monkeypatch.setattr(trajectory_terms, "COSTS", (*trajectory_terms.COSTS, module.hand_height_terms))
    raised = carried()
    lowest = [model.forward(motion.qpos).point("left_palm")[2].min() for motion in (plain, raised)]
    assert lowest[1] > lowest[0] + 0.01
    assert "left_palm_height" in raised.stages[-1].windows[0].cost_by_term


def test_a_reader(monkeypatch, tmp_path):
    module, clip = example("readers/laboratory"), hr.open_clip("builtin:carry_box")
    monkeypatch.setitem(sys.modules, "hoi_retarget.readers.laboratory", module)
    monkeypatch.setattr(readers, "MODULES", {**readers.MODULES, "laboratory": (".npz",)})
    person, box = clip.people[0], clip.objects[0]
    arrays = {"lab_joints": person.joint_positions, "lab_quats": person.joint_quats}
    np.savez(tmp_path / "a.npz", **arrays, box_pos=box.positions, box_quat=box.quats)
    read = hr.open_clip(tmp_path / "a.npz")
    assert read.source.format == "laboratory" and read.fps == 60.0
    assert any(track.active.any() for track in read.contacts), "found from distances"
    shift = read.people[0].joint_positions - person.joint_positions  # Only the floor's height may differ.
    np.testing.assert_allclose(shift, np.broadcast_to(shift[0, 0] * [0, 0, 1], shift.shape), atol=1e-12)


def test_a_format(monkeypatch, tmp_path):
    module, motion, model = example("formats/minimal"), without_examples(), hr.load_robot("unitree_g1")
    files = export(Result("clip", "0", motion, model), module.FORMAT, name="clip", fps=motion.fps).files
    assert {"clip.npz", "clip.meta.json"} <= set(files)
    (tmp_path / "clip.npz").write_bytes(files["clip.npz"])
    monkeypatch.setattr(formats, "FORMATS", (module.FORMAT, *formats.FORMATS))
    read = formats.read(tmp_path / "clip.npz")
    assert read.format == "minimal" and read.fps == motion.fps
    np.testing.assert_allclose(read.joint_pos, motion.qpos[:, 7:], atol=1e-9)


def test_a_figure(monkeypatch):
    module = example("evaluation/hand_height")
    monkeypatch.setattr(figures, "FIGURES", (*figures.FIGURES, module.hand_height_m))
    motion = carried()
    assert 0.3 < motion.report.figures["hand_height_m"] < 1.5
    assert module.hand_height_m.text(motion.report.figures["hand_height_m"]).replace(".", "").isdecimal()


@pytest.mark.slow
def test_a_robot(monkeypatch):
    spec = example("robots/g1_slow").SPEC
    monkeypatch.setattr(robots, "ROBOTS", MappingProxyType({**robots.ROBOTS, spec.name: spec}))
    model = hr.load_robot("slow")
    motion = hr.retarget(hr.open_clip("builtin:carry_box"), model)
    elbow = model.joint_names.index("left_elbow_joint")
    assert model.speed_limits[elbow] == pytest.approx(0.5 * hr.load_robot("unitree_g1").speed_limits[elbow])
    assert motion.robot == "g1_slow" and not motion.warnings
    assert replace(spec, name="x").title == spec.title


def test_new_files_are_new_and_lines_have_their_places():
    assert {path for path, language, _ in FILES if language == "python" and (ROOT / path).exists()} == {
        "tests/recordings.py"
    }
    assert all(patched((ROOT / path).read_text(), text) for path, language, text in FILES if language == "diff")


@pytest.mark.slow
def test_all_examples_together_break_no_law(tmp_path):
    for name in ("src", "tests", "docs"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__", "images"))
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, tmp_path)
    add_examples(tmp_path)
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "src")}

    def passes(*words: str) -> None:
        command = [sys.executable, "-m", *words]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{' '.join(words)}\n{done.stdout[-5000:]}\n{done.stderr[-2000:]}"

    code = [path for path, *_ in FILES if path.endswith(".py")]
    for words in (["check"], ["format", "--check"]) if find_spec("ruff") else ():
        passes("ruff", *words, *code)
    plain = ("pytest", "-q", "--maxfail=9", "--tb=short", "-p", "no:cacheprovider")
    passes(*plain, "-k", f"not {' and not '.join(ELSEWHERE)}", *(f"tests/{name}.py" for name in LAWS))
    slow = [f"tests/{name}.py" for name in SLOW_LAWS]
    passes(*plain, "-m", "slow", "-k", " or ".join(SLOW_LAWS.values()), *slow)
