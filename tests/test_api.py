"""The public names: all there, light to import, enough for the examples."""

import ast
import json
import subprocess
import sys
from html import unescape
from pathlib import Path

import pytest

import hoi_retarget as hr

ROOT = Path(__file__).parents[1]


def test_every_public_name_is_there_and_no_other():
    for name in hr.__all__:
        assert getattr(hr, name) is not None
    assert set(hr.__all__) <= set(dir(hr))
    with pytest.raises(AttributeError, match=r"no 'retarged'\. It has: .*retarget"):
        _ = hr.retarged


def test_each_public_name_is_imported_once_for_type_checkers():
    tree = ast.parse((ROOT / "src/hoi_retarget/__init__.py").read_text())
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    names = [alias.asname for node in block.body for alias in node.names]
    assert len(names) == len(set(names)) == len(hr.__all__) - 1, "what is outside of that block is not public"
    assert (hr.curves.__name__, hr.export.__name__) == ("named_curves", "write_export")


def test_importing_the_package_imports_nothing_heavy():
    code = "import sys, hoi_retarget; print(*{'numpy', 'scipy', 'mujoco', 'tyro', 'trimesh'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_the_page_has_every_name():
    page = (ROOT / "docs" / "api.md").read_text()
    documented = {word for line in page.splitlines() if line.startswith("- `") for word in line.split("`")[1::2]}
    assert set(hr.__all__) - {"__version__"} <= documented


def test_the_examples_import_nothing_deeper():
    for path in sorted((ROOT / "examples").glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("hoi_retarget"):
                pytest.fail(f"{path.name} imports {node.module}")


def shown_by(notebook: Path) -> list[object]:
    """Run a notebook's cells as they stand, and return the values of their last lines."""
    names: dict[str, object] = {}
    shown = []
    for cell in json.loads(notebook.read_text())["cells"]:
        if cell["cell_type"] == "code":
            *lines, last = ast.parse("".join(cell["source"])).body
            exec(compile(ast.Module(lines, []), notebook.name, "exec"), names)
            assert isinstance(last, ast.Expr)
            shown.append(eval(compile(ast.Expression(last.value), notebook.name, "eval"), names))
    return shown


def test_in_a_notebook_values_are_short_and_a_motion_plays():
    clip, motion, page, curves = shown_by(ROOT / "examples" / "07_in_a_notebook.ipynb")
    assert repr(clip) == "<Clip carry_box: 268 frames at 30 a second, person, box>"
    assert repr(motion) == "<Motion of unitree_g1: carry_box, 268 frames at 30 a second, box>"
    assert repr(hr.load_robot("unitree_g1")) == "<RobotModel unitree_g1: 29 joints>"
    assert isinstance(page, hr.player(motion).__class__)
    text = page._repr_html_()
    assert text.startswith('<iframe srcdoc="') and unescape(text).count("</html>") == 1 and "<script src" not in text
    assert set(curves.values()) == {(268,)}


def test_from_a_clip_to_an_export(tmp_path):
    clip = hr.open_clip("builtin:carry_box")
    robot = hr.load_robot("unitree_g1")
    motion = hr.retarget(clip, robot, hr.Config(weights=hr.Weights(jerk=2e-3)))
    assert motion.report.figures["touch_share"] > 0.95 and not motion.warnings
    hr.save(motion, str(tmp_path / "carry_box.npz"))
    assert hr.evaluate(hr.load(tmp_path / "carry_box.npz"), clip, robot) == motion.report.figures
    files = hr.export(motion, "mjlab", tmp_path / "motions", clip=clip)
    assert {path.name for path in files} == {"carry_box.mjlab.npz", "carry_box.mjlab.meta.json"}
    assert all(path.exists() for path in files)
    with pytest.raises(hr.HoiRetargetError, match="no such format"):
        hr.export(motion, "mjlap", tmp_path / "motions")
