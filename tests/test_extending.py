"""The worked examples of docs/extending.md do what the page says, each with its one line in a table."""

import re
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import MappingProxyType, ModuleType

import numpy as np
import pytest

import hoi_retarget as hr
from hoi_retarget import readers, robots
from hoi_retarget.evaluation import figures
from hoi_retarget.motion import formats
from hoi_retarget.motion.export import export
from hoi_retarget.motion.result import Result
from hoi_retarget.retargeting.trajopt import table
from test_terms import dense_jacobian, residuals

PAGE = (Path(__file__).parents[1] / "docs" / "extending.md").read_text()


def example(name: str) -> ModuleType:
    """Return the module that the page shows."""
    (code,) = re.findall(rf"^```python {name}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    module = ModuleType(f"example_{name}")
    sys.modules[module.__name__] = module  # Dataclasses look their module up.
    exec(compile(code, f"extending.md, {name}", "exec"), vars(module))
    return module


def carried() -> hr.Motion:
    return hr.retarget(hr.open_clip("builtin:carry_box"), hr.load_robot("unitree_g1"), hr.Config(contact="landmark"))


without_examples = cache(carried)


def test_a_cost_term(monkeypatch):
    module, model, plain = example("term"), hr.load_robot("unitree_g1"), without_examples()
    term = module.HandHeight("left_palm_height", "left_palm")
    rng = np.random.default_rng(0)
    qpos, direction = plain.qpos[:9], rng.normal(size=(9, model.nv))
    kinematics = model.forward(qpos - 0.6 * (np.arange(qpos.shape[1]) == 2))
    ahead, behind = (model.forward(model.integrate(kinematics.qpos, step * direction)) for step in (1e-6, -1e-6))
    (rows,) = term.rows(kinematics)
    numeric = (residuals(term, ahead) - residuals(term, behind)) / 2e-6
    np.testing.assert_allclose(dense_jacobian(rows, kinematics) @ direction.ravel(), numeric, atol=1e-5)
    monkeypatch.setattr(table, "COSTS", (*table.COSTS, module.hand_height_terms))
    raised = carried()
    lowest = [model.forward(motion.qpos).point("left_palm")[2].min() for motion in (plain, raised)]
    assert lowest[1] > lowest[0] + 0.01
    assert "left_palm_height" in raised.stages[-1].windows[0].cost_by_term


def test_a_reader(monkeypatch, tmp_path):
    module, clip = example("reader"), hr.open_clip("builtin:carry_box")
    known = MappingProxyType({**readers.READERS, "laboratory": module.READER})
    monkeypatch.setattr(readers, "READERS", known)
    monkeypatch.setattr("hoi_retarget.readers.open.READERS", known)
    person, box = clip.people[0], clip.objects[0]
    arrays = {"lab_joints": person.joint_positions, "lab_quats": person.joint_quats}
    np.savez(tmp_path / "a.npz", **arrays, box_pos=box.positions, box_quat=box.quats)
    read = hr.open_clip(tmp_path / "a.npz")
    assert read.source.format == "laboratory" and read.fps == 60.0
    assert any(track.active.any() for track in read.contacts), "found from distances"
    shift = read.people[0].joint_positions - person.joint_positions  # Only the floor's height may differ.
    np.testing.assert_allclose(shift, np.broadcast_to(shift[0, 0] * [0, 0, 1], shift.shape), atol=1e-12)


def test_a_format(monkeypatch, tmp_path):
    module, motion, model = example("format"), without_examples(), hr.load_robot("unitree_g1")
    files = export(Result("clip", "0", motion, model), module.FORMAT, name="clip", fps=motion.fps).files
    assert {"clip.npz", "clip.meta.json"} <= set(files)
    (tmp_path / "clip.npz").write_bytes(files["clip.npz"])
    monkeypatch.setattr(formats, "FORMATS", (module.FORMAT, *formats.FORMATS))
    read = formats.read(tmp_path / "clip.npz")
    assert read.format == "minimal" and read.fps == motion.fps
    np.testing.assert_allclose(read.joint_pos, motion.qpos[:, 7:], atol=1e-9)


def test_a_figure(monkeypatch):
    module = example("figure")
    monkeypatch.setattr(figures, "FIGURES", (*figures.FIGURES, module.HAND_HEIGHT))
    motion = carried()
    assert 0.3 < motion.report.figures["hand_height_m"] < 1.5
    assert module.HAND_HEIGHT.text(motion.report.figures["hand_height_m"]).replace(".", "").isdecimal()


@pytest.mark.slow
def test_a_robot(monkeypatch):
    spec = example("robot").SPEC
    monkeypatch.setattr(robots, "ROBOTS", MappingProxyType({**robots.ROBOTS, spec.name: spec}))
    model = hr.load_robot("slow_g1")
    motion = hr.retarget(hr.open_clip("builtin:carry_box"), model)
    elbow = model.joint_names.index("left_elbow_joint")
    assert model.speed_limits[elbow] == pytest.approx(0.5 * hr.load_robot("unitree_g1").speed_limits[elbow])
    assert motion.robot == "slow_g1" and not motion.warnings
    assert replace(spec, name="x").title == spec.title
