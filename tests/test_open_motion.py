"""Other programs' motions beside their clip: the figures are those of a result, or absent with the reason."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import motion_writers as writers
from hoi_retarget.cli import main
from hoi_retarget.clip.clip import Source
from hoi_retarget.errors import ReadError
from hoi_retarget.evaluation import FIGURES, evaluate
from hoi_retarget.evaluation.penetration import self_depths
from hoi_retarget.motion.check import ObjectPath
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.resample import resample
from hoi_retarget.studio.report.open_motion import (
    OpenedMotion,
    ReferenceClip,
    motion_from_qpos,
    open_motion,
    with_recording,
)
from hoi_retarget.studio.report.page import report_page
from hoi_retarget.studio.report.rows import Row, read_row
from synthetic import make
from test_curves import G1, carried

CLIP = Path("builtin:carry_box")
SCALE = float(carried().object_scale[0])
OF_CLIP = (
    "contact_gap_m",
    "touch_share",
    "touch_gap_p95_m",
    "touch_place_m",
    "penetration_mean_m",
    "penetration_p95_m",
    "penetration_max_m",
    "body_pose_deviation_deg",
    "object_path_error_m",
)
OF_ROBOT = ("link_below_floor_m", "floor_penetration_max_m")


def written(name: str, folder: Path, motion: Motion | None = None) -> Path:
    return writers.save(name, writers.MAKERS[name](motion or carried()), folder)


def row_of(path: Path, **recording) -> Row:
    row = read_row(path.name, path, G1, recording=ReferenceClip(**recording))
    assert row.error == ""
    return row


@pytest.mark.parametrize("name", ["holosoma-retarget", "omniretarget"])
def test_a_results_numbers_in_another_programs_file_have_the_results_figures(name, tmp_path):
    row = row_of(written(name, tmp_path), clip=CLIP, object_scale=SCALE)
    expected = carried().report.figures
    for figure in (*OF_CLIP, *OF_ROBOT):
        assert row.figures[figure] == pytest.approx(expected[figure], rel=1e-4, abs=1e-6), figure
    # Without the clip, the first frame counts too.
    depths, _, _ = self_depths(G1.forward(carried().qpos))
    assert row.figures["self_penetration_max_m"] == pytest.approx(depths.max(), rel=1e-4, abs=1e-6)
    assert row.objects == ("box",)
    assert any("compared with the clip 'carry_box'" in note for note in row.notes)
    assert row.verdict.not_judged and "contact_gap_m" not in row.verdict.not_judged, "the landmark is what is known"


def test_without_a_clip_they_are_absent_and_the_page_says_why(tmp_path):
    row = row_of(written("omniretarget", tmp_path))
    assert all(row.figures.get(figure) is None for figure in OF_CLIP)
    assert all(row.figures[figure] is not None for figure in OF_ROBOT)
    assert "no clip is named (--clip)" in report_page("Report", [row], {})


def test_a_file_without_objects_is_beside_the_clips(tmp_path):
    clip, motion, scale = make("carry_box"), carried(), carried().report.root_scale
    row = row_of(written("gmr", tmp_path), clip=CLIP, object_scale=SCALE, root_scale=scale)
    (track,) = clip.objects
    beside = replace(motion, object_pos=scale * track.positions[:, None], object_quat=track.quats[:, None])
    expected = evaluate(beside, clip, G1)
    for figure in OF_CLIP[:-1]:
        assert row.figures[figure] == pytest.approx(expected[figure], rel=1e-4, abs=1e-6), figure
    for figure in ("object_path_error_m", "object_below_floor_m", "object_float_m"):
        assert row.figures[figure] is None, "its objects' paths are not its own"


def test_a_file_at_another_rate_is_compared_at_its_frames(tmp_path):
    at_50 = resample(carried(), G1, 50.0)
    motion = replace(
        carried(),
        fps=50.0,
        stages=(replace(carried().stages[-1], qpos=at_50.qpos, windows=()),),
        **{name: getattr(at_50, name) for name in ("object_pos", "object_quat", "contact_flags", "contact_object")},
        contact_points=at_50.contact_points,
        stance_flags=at_50.stance_flags,
        report=replace(carried().report, unreached_contacts=(), orientation_flips=()),
    )
    row = row_of(written("holosoma-retarget", tmp_path, motion), clip=CLIP, object_scale=SCALE)
    for figure in ("contact_gap_m", "touch_share", "touch_place_m", "body_pose_deviation_deg"):
        assert row.figures[figure] == pytest.approx(carried().report.figures[figure], rel=0.05), figure


@pytest.mark.parametrize(
    ("objects", "forward", "clip", "words"),
    [
        (("box",), 0.0, "builtin:push_table", "s, the clip 'push_table'"),
        (("box",), 0.0, "builtin:carry_table", "2 people"),
        (("box",), 0.0, "nowhere.pt", "nowhere.pt"),
        (("a", "b"), 0.0, "builtin:carry_box", "its objects are a, b, those of the clip 'carry_box' box"),
        ((), 3.0, "builtin:carry_box", "the robot is 2.7 m away"),
    ],
)
def test_what_does_not_fit_is_said_and_not_measured(objects, forward, clip, words):
    motion = carried()
    paths = [ObjectPath(name, motion.object_pos[:, 0], motion.object_quat[:, 0]) for name in objects]
    qpos = motion.qpos + forward * (np.arange(motion.qpos.shape[1]) == 0)
    lone = motion_from_qpos(qpos, motion.fps, G1, paths)
    lone = replace(lone, report=replace(lone.report, source=Source(format="gmr")))
    found = with_recording(OpenedMotion(lone, "gmr"), Path("walk.pkl"), G1, ReferenceClip(Path(clip)))
    assert all(found.motion.report.figures.get(figure) is None for figure in OF_CLIP)
    assert found.motion.report.figures == lone.report.figures
    assert words in found.notes[-1]


def test_a_folder_of_clips_has_the_one_of_its_name(tmp_path):
    clips = tmp_path / "clips"
    clips.mkdir()
    assert main(["convert", str(CLIP), "--out", str(clips / "carry_box.npz")]) == 0
    (clips / "carry.txt").write_text("another name")
    path = written("gmr", tmp_path)
    named = path.rename(tmp_path / "carry_box.gmr.pkl")
    assert row_of(named, clip=clips, root_scale=SCALE).figures["touch_share"] is not None
    other = named.rename(tmp_path / "other.pkl")
    row = row_of(other, clip=clips)
    assert row.figures.get("touch_share") is None and "no clip of its name" in row.notes[-1]


def test_evaluate_and_report_take_the_clip(tmp_path, capsys):
    path = written("omniretarget", tmp_path)
    beside = ["--clip", str(CLIP), "--object-scale", str(SCALE)]
    assert main(["evaluate", str(path), *beside, "--json", str(tmp_path / "figures.json")]) == 0
    (figures,) = json.loads((tmp_path / "figures.json").read_text())["per_clip"]
    assert figures["penetration_max_m"] == pytest.approx(carried().report.figures["penetration_max_m"], rel=1e-4)
    assert {figure.name for figure in FIGURES} <= set(figures)
    capsys.readouterr()
    for words in (["--clip", "nowhere.pt"], ["--object-scale", "0"]):
        assert main(["evaluate", str(path), *words]) == 2
        assert words[0] in capsys.readouterr().err


def test_an_archive_of_another_zip_version_is_damaged_not_a_crash(tmp_path):
    path = writers.write("hoi-retarget", tmp_path)
    content = bytearray(path.read_bytes())
    content[content.index(b"PK\x01\x02") + 6] = 206  # The version that an entry needs.
    path.write_bytes(content)
    with pytest.raises(ReadError, match=r"result\.npz"):
        open_motion(path, G1)
