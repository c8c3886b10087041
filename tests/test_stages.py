"""Laws of stages: each has its own configurations and objects, files keep them, and exports choose among them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from export_motions import smooth_motion
from hoi_retarget.cli import main
from hoi_retarget.errors import ArgumentError, ClipError
from hoi_retarget.evaluation.physics_figures import PERFORMED, performed_figures
from hoi_retarget.motion.formats import WRITABLE
from hoi_retarget.motion.motion import Motion, Stage
from hoi_retarget.motion.performance import Performance
from hoi_retarget.motion.result_file import load, save
from hoi_retarget.motion.write_export import write_export
from hoi_retarget.numerics import se3
from plain_motions import plain_motion, standing_qpos
from trajectories import MODELS

G1 = MODELS["unitree_g1"]


def performed(motion: Motion, shift=(0.0, 0.0, 0.0), turn=0.0, joint=0.0, moved=(0.0, 0.0, 0.0)) -> Motion:
    """A motion with one more stage: the base shifted and turned, every joint turned, the objects moved."""
    qpos = motion.qpos.copy()
    qpos[:, :3] += shift
    qpos[:, 3:7] = se3.quat_multiply(se3.exp(np.array([0.0, 0.0, turn])), qpos[:, 3:7])
    qpos[:, 7:] += joint
    before = np.concatenate([motion.object_pos, motion.object_quat], axis=2)
    stages = [replace(stage, objects=before) for stage in motion.stages]
    report = replace(motion.report, performance=Performance(1.5, False), figures={"body_jerk_mps3": 1.0})
    return replace(
        motion, stages=(*stages, Stage("physics", qpos)), object_pos=motion.object_pos + np.array(moved), report=report
    )


@pytest.fixture(scope="module")
def motion():
    return performed(smooth_motion(G1), shift=(0.02, 0.0, 0.0), joint=0.01, moved=(0.0, 0.0, 0.03))


def test_an_earlier_stage_is_the_motion_that_it_was(motion):
    before = smooth_motion(G1)
    name = before.stages[-1].name
    found = motion.at_stage(name)
    for array in ("qpos", "object_pos", "object_quat", "contact_points"):
        assert getattr(found, array).tobytes() == getattr(before, array).tobytes()
    assert not found.report.figures and found.report.performance is None
    assert motion.at_stage("physics") is motion
    with pytest.raises(ArgumentError, match=rf"no stage 'later'\. Its stages: .*{name}, physics\."):
        motion.at_stage("later")


def test_files_keep_every_stage(motion, tmp_path):
    save(motion, tmp_path / "a.npz")
    read = load(tmp_path / "a.npz")
    for stage, again in zip(motion.stages, read.stages, strict=True):
        assert again.qpos.tobytes() == stage.qpos.tobytes()
        assert (again.objects is None) == (stage.objects is None)
        assert stage.objects is None or again.objects.tobytes() == stage.objects.tobytes()
    save(read, tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_objects_of_a_stage_are_poses_of_these_objects(motion):
    first, *others = motion.stages
    for wrong, what in (
        (first.objects[:, :0], "shape"),
        (2.0 * first.objects, "unit"),
        (first.objects * np.nan, "finite"),
    ):
        with pytest.raises(ClipError, match=what):
            replace(motion, stages=(replace(first, objects=wrong), *others))


@pytest.mark.parametrize("name", WRITABLE)
def test_an_export_of_a_stage_holds_its_arrays(name, motion, tmp_path):
    alone = replace(motion, stages=(replace(motion.stages[-1], name="trajectory"),))
    reference = smooth_motion(G1)
    for stage, same in (("physics", alone), (reference.stages[-1].name, reference), (None, alone)):
        written = write_export(motion, name, tmp_path / f"{stage}", name="a", stage=stage)
        expected = write_export(same, name, tmp_path / f"{stage} expected", name="a")
        for path, other in zip(written, expected, strict=True):
            same_bytes = path.read_bytes() == other.read_bytes()
            assert same_bytes or path.name == "a.meta.json", path
    meta = (tmp_path / "physics" / "a.meta.json").read_text()
    assert '"stage": "physics"' in meta


def test_a_stage_that_is_not_there_is_one_error(tmp_path, capsys):
    save(smooth_motion(G1), tmp_path / "a.npz")
    call = ["export", str(tmp_path / "a.npz"), "--to", "mjlab", "--out", str(tmp_path / "out"), "--stage"]
    assert main([*call, "physics"]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "--stage physics: the motion has no stage 'physics'. Its stages: " in said and "refine" in said
    assert not (tmp_path / "out").exists()


METRES = st.floats(-0.5, 0.5)


@settings(deadline=None, max_examples=15)
@given(shift=st.tuples(*[METRES] * 3), turn=st.floats(0.0, 3.0), joint=METRES, moved=st.tuples(*[METRES] * 3))
def test_deviations_from_the_reference_are_those_that_were_made(shift, turn, joint, moved):
    plain = plain_motion(G1, standing_qpos(G1, 4))
    assert performed_figures(plain) == {}
    figures = performed_figures(performed(plain, shift, turn, joint, moved))
    assert set(figures) == {figure.name for figure in PERFORMED}
    assert figures["reference_root_m"] == pytest.approx(np.linalg.norm(shift), abs=1e-12)
    assert figures["reference_root_deg"] == pytest.approx(np.degrees(turn), abs=1e-6)
    assert figures["reference_joint_rad"] == pytest.approx(abs(joint), abs=1e-12)
    for name in ("reference_object_m", "reference_object_max_m"):
        assert figures[name] == pytest.approx(np.linalg.norm(moved), abs=1e-12)
    assert figures["reference_object_deg"] == pytest.approx(0.0, abs=1e-9) and figures["stood_s"] == 1.5


def test_tables_have_them_where_something_was_performed(motion, tmp_path, capsys):
    figures = {"body_jerk_mps3": 1.0}
    plain = smooth_motion(G1)
    save(replace(plain, report=replace(plain.report, figures=figures)), tmp_path / "plain.npz")
    both = {**figures, **performed_figures(motion)}
    save(replace(motion, report=replace(motion.report, figures=both)), tmp_path / "performed.npz")
    for name, there in (("plain", False), ("performed", True)):
        assert main(["evaluate", str(tmp_path / f"{name}.npz")]) == 0
        assert ("root off reference [cm]" in capsys.readouterr().out) == there
    assert main(["evaluate", *(str(tmp_path / f"{name}.npz") for name in ("plain", "performed"))]) == 0
    assert "root off reference [cm]" in capsys.readouterr().out
