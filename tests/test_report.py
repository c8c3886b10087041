"""Reports: every file once, a reason for what cannot be read, nothing unescaped, the same bytes every time."""

import base64
import csv
import functools
import gzip
import io
import json
import math
import re
from dataclasses import asdict, replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import motion_writers as writers
from browser import PATIENCE_MS, chromium, wait_until
from hoi_retarget.batch.manifest import ManifestEntry, ManifestSource
from hoi_retarget.cli import main
from hoi_retarget.cli.run import OBJECT_SURFACES, describe_result
from hoi_retarget.clip.clip import Source
from hoi_retarget.errors import ArgumentError
from hoi_retarget.evaluation import FIGURES
from hoi_retarget.evaluation.thresholds import THRESHOLDS, Level, judged_figures, verdict_of_figures
from hoi_retarget.motion.check import ObjectPath
from hoi_retarget.motion.motion import Motion, Stage
from hoi_retarget.motion.motion_report import Event, Report
from hoi_retarget.motion.result_file import save
from hoi_retarget.numerics import se3
from hoi_retarget.studio.report.discover import find
from hoi_retarget.studio.report.motion_pages import MotionPage, MotionPages
from hoi_retarget.studio.report.open_motion import OWN_FORMAT, motion_from_qpos
from hoi_retarget.studio.report.page import histogram, report_page
from hoi_retarget.studio.report.rows import (
    Row,
    index_columns,
    read_row,
    to_csv,
    to_json,
    to_parquet,
    worst_first,
    worst_frame,
)
from test_curves import G1, carried

NASTY = """<script>alert("1")</script>&'$title'<img src=x onerror=alert(2)>"""
BLANK = asdict(ManifestEntry("", "solved", "unitree_g1", ManifestSource(), scales={}, lineage={}))
PAGE = MotionPage("a.html", "a.png", 4.0)


def with_figures(motion: Motion, **figures: float | None) -> Motion:
    return replace(motion, report=replace(motion.report, figures={**motion.report.figures, **figures}))


@functools.cache
def good() -> Motion:
    """A motion that passes; the one it is made from has its knees in the box for two frames, and touches with tips."""
    return with_figures(carried(), penetration_max_m=0.004, palm_touch_share=0.5)


@functools.cache
def bad() -> Motion:
    unreached = (Event("unreached_contact", 70, 110, 0.06, subject="left_palm", object="box", mean=0.04),)
    worse = with_figures(good(), touch_gap_p95_m=0.06, body_jerk_mps3=90.0)
    return replace(worse, report=replace(worse.report, unreached_contacts=unreached))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two good results, one bad one in a folder below, a damaged one, and what is not meant."""
    results = tmp_path / "results"
    for name, motion in (("a.npz", good()), ("b.npz", good()), ("deeper/bad.npz", bad())):
        save(motion, results / name)
    (results / "damaged.npz").write_bytes((results / "a.npz").read_bytes()[:5000])
    (results / "figures.csv").write_text("name,contact_gap_m\na,0.001\n")
    (results / ".hidden.npz").write_bytes(b"")
    (results / "notes.txt").write_text("not a result")
    return results


def rows_of(*paths: Path) -> tuple[Row, ...]:
    return tuple(read_row(name, path, G1) for name, path in find(paths)[0].items())


# Which files.


def test_a_report_lists_every_file_once(folder: Path) -> None:
    once, _ = find([folder])
    assert list(once) == ["a.npz", "b.npz", "damaged.npz", "deeper/bad.npz"]
    assert find([folder, folder / "a.npz", folder / "deeper", folder / "deeper" / ".." / "b.npz"])[0] == once


def test_files_are_named_from_the_folder_that_holds_them_all(folder: Path) -> None:
    assert list(find([folder / "deeper"])[0]) == ["bad.npz"]
    assert list(find([folder / "a.npz"])[0]) == ["a.npz"]


def test_what_an_earlier_report_wrote_is_no_motion(folder: Path) -> None:
    before = find([folder])
    assert main(["report", str(folder / "a.npz"), "--out", str(folder)]) == 0
    assert find([folder]) == before


def test_contacts_beside_an_export_are_no_motion(folder: Path) -> None:
    before = find([folder])
    np.savez(folder / "a.gmr.contacts.npz", contact_flags=np.zeros((3, 1), dtype=bool))
    assert find([folder]) == before


def test_a_path_that_does_not_exist_or_an_empty_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="no such"):
        find([tmp_path / "nowhere"])
    with pytest.raises(ArgumentError, match="no results"):
        find([tmp_path])


# What is known of them.


def test_a_damaged_file_is_one_row_with_its_reason_and_the_rest_is_there(folder: Path) -> None:
    rows = {row.file: row for row in rows_of(folder)}
    assert rows["damaged.npz"].verdict is None
    assert "damaged.npz" in rows["damaged.npz"].error and str(folder) not in rows["damaged.npz"].error
    assert rows["a.npz"].level is Level.PASS
    assert rows["deeper/bad.npz"].level is Level.FAIL
    judged = judged_figures(good(), G1)
    assert rows["a.npz"].judged == {name: value for name, value in judged.items() if value is not None}
    assert rows["a.npz"].figures["contact_gap_m"] == good().report.figures["contact_gap_m"], "measured, not judged"


def test_results_without_figures_are_judged_by_what_is_there(tmp_path: Path) -> None:
    bare = replace(carried(), report=Report(), stages=(Stage("motion", carried().qpos),))
    save(bare, tmp_path / "odd.npz")
    (row,) = rows_of(tmp_path)
    assert row.verdict is not None
    of_report = {figure.name for figure in FIGURES}
    assert of_report & {threshold.name for threshold in THRESHOLDS} <= set(row.verdict.not_judged)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"robot": "unheard_of"}, "no robot 'unheard_of'"),
        ({"joint_names": (*carried().joint_names[:-1], "tail_joint")}, "tail_joint"),
        ({"joint_names": carried().joint_names[::-1]}, "another order"),
        ({"contact_links": (*carried().contact_links[:-1], "tail")}, "tail"),
        ({"stages": (Stage("motion", carried().qpos + 100.0 * (np.arange(36) == 20)),)}, "rad in frame"),
    ],
)
def test_results_of_no_robot_get_the_reason_instead_of_a_verdict(tmp_path: Path, changes, words: str) -> None:
    save(replace(carried(), **changes), tmp_path / "odd.npz")
    (row,) = rows_of(tmp_path)
    assert row.verdict is None and words in row.error


def test_the_worst_come_first(folder: Path) -> None:
    rows = rows_of(folder)
    assert [row.file for row in worst_first(rows)] == ["deeper/bad.npz", "a.npz", "b.npz"]
    assert worst_first(rows[::-1]) == worst_first(rows)


def test_a_bad_motion_is_shown_where_it_is_bad() -> None:
    assert worst_frame(bad()) == 90
    assert 0 <= worst_frame(replace(carried(), report=Report())) < carried().frames


# Motions of which only the robot's side is known.


def test_of_a_lone_motion_the_same_is_measured_as_of_the_result() -> None:
    whole = judged_figures(carried(), G1)
    lone = judged_figures(motion_from_qpos(carried().qpos, carried().fps, G1), G1)
    for name in ("base_height_max_share", "base_turn_max_radps", "frozen_share"):
        assert lone[name] == whole[name]
    for name in ("body_jerk_max_mps3", "joint_range_margin_rad", "joint_speed_margin_radps", "floor_penetration_max_m"):
        # A result counts from the recording's second frame on.
        assert lone[name] == pytest.approx(whole[name], rel=0.05, abs=1e-3)
    assert lone["stance_slide_mps"] == pytest.approx(whole["stance_slide_mps"], abs=0.03)
    assert lone["contact_gap_m"] is None


@pytest.mark.parametrize("shift", [-0.02, 0.0, 0.02])
def test_where_feet_stand_does_not_depend_on_where_the_floor_is(shift: float) -> None:
    qpos = carried().qpos.copy()
    stance = motion_from_qpos(qpos, 30.0, G1).stance_flags
    qpos[:, 2] += shift
    moved = motion_from_qpos(qpos, 30.0, G1)
    assert np.array_equal(moved.stance_flags, stance)
    assert stance.any(axis=1).all()
    figures = judged_figures(moved, G1)
    assert max(figures["stance_float_m"], figures["floor_penetration_max_m"]) == pytest.approx(abs(shift), abs=0.005)


def test_a_motion_that_skates_slides() -> None:
    qpos = np.repeat(G1.home_qpos[None], 60, axis=0)
    assert judged_figures(motion_from_qpos(qpos, 30.0, G1), G1)["stance_slide_mps"] == 0.0
    qpos[:, 0] = np.arange(60) / 30.0
    assert judged_figures(motion_from_qpos(qpos, 30.0, G1), G1)["stance_slide_mps"] == pytest.approx(1.0)


# Other programs' files, and batches.


def test_tables_with_names_and_folders_of_tables_are_motions(tmp_path: Path) -> None:
    for name in ("named-csv", "bones-seed", "sonic", "protomotions"):
        (tmp_path / name).mkdir()
        writers.write(name, tmp_path / name)
    (tmp_path / "figures.csv").write_text("name,contact_gap_m\na,0.001\n")
    found = ["bones-seed/motion.csv", "named-csv/motion.csv", "protomotions/walk.motion", "sonic"]
    assert list(find([tmp_path])[0]) == found
    assert list(find([tmp_path / "sonic"])[0].values()) == [tmp_path / "sonic"]
    assert [row.format for row in rows_of(tmp_path)] == ["bones-seed", "named-csv", "protomotions", "sonic"]


def written_csv(path: Path, qpos: np.ndarray) -> Path:
    """A motion as Unitree writes them: no header, rotations scalar last."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, np.concatenate([qpos[:, :3], qpos[:, [4, 5, 6, 3]], qpos[:, 7:]], axis=1), delimiter=",")
    return path


def test_of_another_programs_file_what_needs_no_clip_is_judged(folder: Path) -> None:
    written_csv(folder / "foreign.csv", carried().qpos)
    rows = {row.file: row for row in rows_of(folder)}
    foreign, own = rows["foreign.csv"], rows["a.npz"]
    assert foreign.format == "unitree-csv" and foreign.robot == "unitree_g1"
    assert foreign.notes[0] == "30 frames a second are assumed" and "(--clip)" in foreign.notes[1]
    assert foreign.frames == own.frames
    assert foreign.figures["joint_speed_margin_radps"] == pytest.approx(own.figures["joint_speed_margin_radps"])
    assert set(foreign.verdict.not_judged) > {"contact_gap_m", "orientation_flip_s"}
    assert foreign.level is Level.PASS


def test_another_programs_file_that_contradicts_itself_is_told_as_such(tmp_path: Path) -> None:
    written_csv(tmp_path / "short.csv", carried().qpos[:, :-2])
    (row,) = rows_of(tmp_path)
    assert row.level is None and "27 columns" in row.error


def test_another_programs_file_in_the_wrong_order_is_judged_and_fails(tmp_path: Path) -> None:
    right, wrong = tmp_path / "right", tmp_path / "wrong"
    qpos = carried().qpos
    for folder, table in (
        (right, qpos),
        (wrong, np.concatenate([qpos[:, :3], se3.quat_from_xyzw(qpos[:, 3:7]), qpos[:, 7:]], axis=1)),
    ):
        folder.mkdir()
        written_csv(folder / "walk.csv", table)
    (good,), (bad,) = rows_of(right), rows_of(wrong)
    assert good.level is Level.PASS and good.contradictions == ()
    assert bad.level is Level.FAIL and bad.contradictions[0].startswith("quaternion order: ")
    assert bad.reasons[0] == bad.contradictions[0]
    assert bad.figures == pytest.approx(good.figures, nan_ok=True)
    assert json.loads(to_json([bad]))["files"][0]["contradictions"] == list(bad.contradictions)
    assert bad.contradictions[0][:20] in to_csv([bad]).decode()


def test_a_lone_motion_has_the_objects_that_its_file_has(tmp_path: Path) -> None:
    motion = carried()
    path = ObjectPath("box", motion.object_pos[:, 0], motion.object_quat[:, 0])
    lone = motion_from_qpos(motion.qpos, motion.fps, G1, [path])
    assert lone.object_names == ("box",)
    assert np.array_equal(lone.object_pos, motion.object_pos)


def test_a_batchs_failures_stand_beside_its_results(folder: Path, capsys, monkeypatch) -> None:
    solved = {
        "name": "a",
        "status": "solved",
        "lineage": {"mirrored": True},
        "results": [{"path": "a.npz", "sha256": ""}],
    }
    gone = {"name": "gone", "status": "solved", "results": [{"path": "gone.npz", "sha256": ""}]}
    failed = {"name": "lost", "status": "failed", "reason": f"no such clip {NASTY}", "source": {"licence": "CC0"}}
    lines = [json.dumps({**BLANK, **entry}) for entry in (solved, gone, failed)]
    (folder / "manifest.jsonl").write_text("\n".join([*lines, '{"torn": ']))
    monkeypatch.setattr("hoi_retarget.cli.report._page_of", lambda *_: None)
    assert main(["report", str(folder), "--out", str(folder.parent / "out")]) == 0
    assert "failed: no such clip" in capsys.readouterr().out
    table = (folder.parent / "out" / "index.csv").read_text()
    records = {record["file"]: record for record in csv.DictReader(io.StringIO(table))}
    assert list(records) == ["a.npz", "b.npz", "damaged.npz", "deeper/bad.npz", "gone", "lost"]
    assert json.loads(records["a.npz"]["lineage"]) == {"mirrored": True}
    assert records["b.npz"]["level"] == "pass" and json.loads(records["b.npz"]["lineage"])["mirrored"] is False
    assert "gone.npz" in records["gone"]["error"]
    assert records["lost"]["licence"] == "CC0"


# Tables.

words = st.text(st.characters(codec="utf-8", exclude_characters="\r\0"), max_size=12)
values = st.none() | st.floats(-1e6, 1e6)
figures_of_rows = st.dictionaries(st.sampled_from([threshold.name for threshold in THRESHOLDS]), values)


some_rows = st.lists(
    st.fixed_dictionaries(
        {
            "robot": words,
            "objects": st.lists(words, max_size=2).map(tuple),
            "frames": st.integers(1, 10**6),
            "fps": st.floats(1.0, 200.0),
            "object_scale": st.lists(st.floats(0.1, 3.0), max_size=2).map(tuple),
            "licence": words,
            "figures": figures_of_rows,
        }
    )
    | st.fixed_dictionaries({"error": words}),
    min_size=1,
    max_size=5,
)


def rows_with(facts: list[dict]) -> tuple[Row, ...]:
    return tuple(
        Row(str(number), **fact, verdict=verdict_of_figures(fact["figures"]) if "figures" in fact else None)
        for number, fact in enumerate(facts)
    )


@settings(max_examples=30, deadline=None)
@given(some_rows)
def test_the_index_reads_back_as_it_was_written(facts: list[dict]) -> None:
    rows = rows_with(facts)
    columns = index_columns(rows)
    read = list(csv.DictReader(io.StringIO(to_csv(rows).decode(), newline="")))
    assert len(read) == len(rows)
    for number, record in enumerate(read):
        for name, column in columns.items():
            value = column[number]
            assert (record[name] == (value or "")) if isinstance(value, str) else (record[name] == _cell(value)), name


def _cell(value: float | None) -> str:
    return "" if value is None else str(value)


@settings(max_examples=10, deadline=None)
@given(some_rows)
def test_parquet_holds_the_same_table(facts: list[dict]) -> None:
    rows = rows_with(facts)
    parquet = pytest.importorskip("pyarrow.parquet")
    content = to_parquet(rows)
    assert content is not None
    assert parquet.read_table(io.BytesIO(content)).to_pydict() == index_columns(rows)


@given(some_rows)
@settings(max_examples=20, deadline=None)
def test_verdicts_count_every_file(facts: list[dict]) -> None:
    rows = rows_with(facts)
    told = json.loads(to_json(rows))
    assert sum(told["counts"].values()) == len(rows) == len(told["files"])
    for row, entry in zip(rows, told["files"], strict=True):
        assert entry["level"] == (None if row.level is None else str(row.level))


def test_numbers_that_are_none_do_not_break_the_json() -> None:
    figures = {"contact_gap_m": math.nan, "stance_slide_mps": math.inf}
    told = json.loads(to_json([Row("a", figures=figures, verdict=verdict_of_figures(figures))]))
    assert told["files"][0]["level"] == "fail"
    assert told["files"][0]["figures"] == {"contact_gap_m": None, "stance_slide_mps": None}


# The page.


class Page(HTMLParser):
    """What a page consists of: its elements, attributes and words."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.words: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def nasty_rows() -> tuple[Row, ...]:
    figures = {"contact_gap_m": 0.02}
    known = Row(
        NASTY,
        robot=NASTY,
        objects=(NASTY,),
        licence=NASTY,
        frames=30,
        fps=30.0,
        figures=figures,
        verdict=verdict_of_figures(figures),
    )
    return known, Row(f"{NASTY}2", error=NASTY)


def test_names_from_files_are_escaped() -> None:
    page = Page(report_page(NASTY, nasty_rows(), {NASTY: PAGE}))
    assert page.tags.count("script") == 1
    assert page.tags.count("img") == 2, "on its card and in its row"
    assert not [name for name, _ in page.attributes if name.startswith("on")]
    assert sum(NASTY in word for word in page.words) >= 8


def test_a_page_loads_nothing() -> None:
    attributes = Page(report_page("Report", nasty_rows(), {NASTY: PAGE})).attributes
    for name, value in attributes:
        assert name not in ("src", "href") or value in ("#all", "motions/a.png", "motions/a.html#t=3.00,5.00")


def test_a_page_without_any_motion_still_tells_what_failed() -> None:
    assert "no such clip" in report_page("Report", [Row("a.npz", error="no such clip")], {})


@pytest.mark.parametrize("threshold", THRESHOLDS, ids=lambda threshold: threshold.name)
@given(values=st.lists(st.floats(-1e5, 1e5), min_size=1, max_size=40))
@settings(max_examples=8, deadline=None)
def test_a_histogram_shows_every_level_that_occurs_inside_the_picture(threshold, values: list[float]) -> None:
    drawn = Page(histogram(threshold, values))
    classes = {value for name, value in drawn.attributes if name == "class"}
    assert {str(level) for level in Level} & classes == {str(threshold.level(value)) for value in values}
    for name in ("x", "y", "height", "width"):
        assert all(0 <= float(value) <= 264 for key, value in drawn.attributes if key == name and value)


@pytest.mark.parametrize("kind", ["shell", "hull"])
def test_what_stands_for_an_objects_surface_is_marked_everywhere(tmp_path: Path, capsys, kind: str) -> None:
    assert carried().report.object_surfaces == {"box": "solid"}
    marked = replace(good(), report=replace(good().report, object_surfaces={"box": kind}))
    for motion, there in ((good(), False), (marked, True)):
        path = tmp_path / f"{there}.npz"
        save(motion, path)
        (row,) = rows_of(path)
        assert (f"box ({kind})" in report_page("Report", [row], {})) is there
        assert (kind in index_columns([row])["object_surfaces"]) is there
        describe_result(motion, path)
        assert (f"  box: {OBJECT_SURFACES[kind]}\n" in capsys.readouterr().out) is there
        assert main(["evaluate", str(path), "--json", str(tmp_path / "it.json")]) == 0
        assert (f" {kind}\n" in capsys.readouterr().out) is there
        assert (json.loads((tmp_path / "it.json").read_text())["per_clip"][0]["object_surfaces"] == [kind]) is there


# The command.


def test_report_writes_pages_and_tables_and_tells_how_many_fail(folder: Path, capsys, monkeypatch) -> None:
    out = folder.parent / "out"
    monkeypatch.setattr(
        "hoi_retarget.studio.report.motion_pages.thumbnails", lambda *_: {".png": b"PNG", ".webp": b"WebP"}
    )
    assert main(["report", str(folder), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "deeper/bad.npz" in said and "touch gap p95 60 mm, above 50" in said
    assert "damaged.npz" in said
    page = (out / "report.html").read_text()
    for name in ("a.npz", "b.npz", "deeper/bad.npz", "damaged.npz"):
        assert name in page
    assert json.loads((out / "verdicts.json").read_text())["counts"] == {"pass": 2, "warn": 0, "fail": 1, "unread": 1}
    assert sorted(path.name for path in (out / "motions").glob("*.html")) == [
        "a-npz.html",
        "b-npz.html",
        "deeper-bad-npz.html",
    ]
    first = {path.name: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    for name in ("a-npz.html", "a-npz.png", "deeper-bad-npz.html", "deeper-bad-npz.png"):
        assert name in page
    # What did not change is not made again.
    monkeypatch.setattr("hoi_retarget.cli.report._page_of", lambda *_: pytest.fail("a page was made again"))
    assert main(["report", str(folder), "--out", str(out), "--strict"]) == 1
    assert {path.name: path.read_bytes() for path in out.rglob("*") if path.is_file()} == first
    (folder / "b.npz").unlink()
    assert main(["report", str(folder), "--out", str(out), "--pages", "1"]) == 0
    assert "--pages 2 makes" in capsys.readouterr().out
    assert sorted(path.name for path in (out / "motions").glob("*.*")) == [
        "deeper-bad-npz.html",
        "deeper-bad-npz.png",
        "deeper-bad-npz.webp",
        "pages.json",
    ]


def test_rows_of_people_with_one_object_lead_to_one_page_each_at_its_own_moment(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(
        "hoi_retarget.studio.report.motion_pages.thumbnails", lambda *_: {".png": b"PNG", ".webp": b"WebP"}
    )
    results, out = tmp_path / "results", tmp_path / "out"
    for person, motion in enumerate((good(), bad())):
        report = replace(motion.report, person=person, source=Source("/nowhere", "0"))
        save(replace(motion, report=report), results / f"carry.p{person}.npz")
    command = ["report", str(results), "--out", str(out), "--pages", "1"]
    assert main(command) == 0
    listing = json.loads((out / "motions" / "pages.json").read_text())
    assert {name: entry["page"] for name, entry in listing.items()} == dict.fromkeys(
        ("carry.p0.npz", "carry.p1.npz"), "carry-npz.html"
    )
    seconds = [entry["second"] for entry in listing.values()]
    assert seconds == [worst_frame(motion) / motion.fps for motion in (good(), bad())] and len(set(seconds)) == 2
    page = (out / "motions" / "carry-npz.html").read_text()
    assert "G1, person 0, G1, person 1" in page and "G1, person 1: fail: touch gap p95 60 mm" in page
    assert "<summary>G1, person 0 pass, physics pass; G1, person 1 fail, physics pass: 3 reasons</summary>" in page
    # One of them alone is on a page of its own.
    (results / "carry.p0.npz").unlink()
    assert main(command) == 0
    assert "person 0" not in (out / "motions" / "carry-npz.html").read_text()


def test_what_was_not_looked_at_is_no_pass() -> None:
    soles = {"stance_slide_mps": 0.01}
    for figures, objects, format, state in (
        (soles, ("box",), OWN_FORMAT, "not judged"),
        (soles, (), "gmr", "not judged"),
        (soles, (), OWN_FORMAT, "pass"),
        ({**soles, "penetration_max_m": 0.001}, ("box",), OWN_FORMAT, "pass"),
        ({**soles, "contact_gap_m": 0.001}, ("box",), "gmr", "pass"),
        ({"stance_slide_mps": 5.0}, ("box",), "gmr", "fail"),
    ):
        row = Row("a", objects=objects, format=format, figures=figures, verdict=verdict_of_figures(figures))
        assert row.state == state
        page = Page(report_page("Report", [row], {}))
        assert ("data-verdict", state) in page.attributes


@pytest.mark.parametrize("page", ["../report.html", "/etc/passwd", "pages.json"])
def test_a_listing_that_leads_elsewhere_is_not_followed(tmp_path: Path, page: str) -> None:
    (tmp_path / "motions").mkdir()
    (tmp_path / "report.html").write_text("kept")
    (tmp_path / "motions" / "pages.json").write_text(json.dumps({"a": {"page": page, "picture": "", "second": 1.0}}))
    MotionPages(tmp_path, "Report").finish()
    assert (tmp_path / "report.html").read_text() == "kept" and (tmp_path / "motions" / "pages.json").exists()


def test_names_that_no_text_can_hold_are_told_with_question_marks(tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("hoi_retarget.cli.report._page_of", lambda *_: None)
    strange = replace(carried(), report=replace(carried().report, clip="\ud800", source=Source(licence="\udfff")))
    save(strange, tmp_path / "in" / "strange.npz")
    try:
        (tmp_path / "in" / "\udcff.npz").write_bytes(b"damaged")
    except OSError:
        pytest.skip("this file system has no such names")
    words = ["report", str(tmp_path / "in"), "--out", str(tmp_path / "out"), "--title", "\udc80"]
    assert main(words) == 0
    assert "?.npz" in capsys.readouterr().out
    assert "?.npz" in (tmp_path / "out" / "index.csv").read_text()


@pytest.mark.parametrize("name", ["x" * 5000, "a\0b"], ids=["long", "null"])
def test_a_path_that_cannot_be_is_refused(tmp_path: Path, capsys, name: str) -> None:
    assert main(["report", name, "--out", str(tmp_path / "out")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_table_that_is_a_motion_is_not_written_over(tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("hoi_retarget.cli.report._page_of", lambda *_: None)
    path = written_csv(tmp_path / "index.csv", carried().qpos)
    content = path.read_bytes()
    assert main(["report", str(tmp_path), "--out", str(tmp_path)]) == 2
    assert "would be written over" in capsys.readouterr().err
    assert path.read_bytes() == content


def test_strict_is_content_when_nothing_fails(folder: Path, monkeypatch) -> None:
    monkeypatch.setattr("hoi_retarget.cli.report._page_of", lambda *_: None)
    words = ["report", str(folder / "a.npz"), "--out", str(folder.parent / "out"), "--strict"]
    assert main(words) == 0


def test_without_pyarrow_the_rest_is_written_and_the_extra_named(folder: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("hoi_retarget.studio.report.rows.to_parquet", lambda rows: None)
    monkeypatch.setattr("hoi_retarget.errors.find_spec", lambda name: None)
    monkeypatch.setattr("hoi_retarget.cli.report._page_of", lambda *_: None)
    out = folder.parent / "out"
    assert main(["report", str(folder / "a.npz"), "--out", str(out)]) == 0
    assert 'pip install "pyarrow' in capsys.readouterr().err
    assert sorted(path.name for path in out.iterdir()) == ["index.csv", "report.html", "verdicts.json"]


@pytest.mark.parametrize("words", [(), ("nowhere",)], ids=["nothing", "absent"])
def test_report_of_nothing_is_refused(tmp_path: Path, capsys, words) -> None:
    assert main(["report", *words, "--out", str(tmp_path / "out")]) == 2
    assert not (tmp_path / "out").exists()
    assert len(capsys.readouterr().err.splitlines()) == 1


# In a browser.


BROKEN_WORDS = """[...document.querySelectorAll("button.filter")].flatMap(({ firstChild: text }) =>
  [...text.data.matchAll(/[a-z]+/g)].filter(({ 0: word, index }) => {
    const range = document.createRange();
    range.setStart(text, index);
    range.setEnd(text, index + word.length);
    return word.length < 12 && range.getClientRects().length > 1;
  })).length"""
"""Words of figures and names that are broken over lines."""


@pytest.mark.slow
@pytest.mark.browser
def test_the_page_sorts_and_filters_without_a_network(tmp_path: Path) -> None:
    rows = list(nasty_rows())
    for name, gap in (("b", 0.004), ("a", 0.0004), ("c", None), ("d", 0.03)):
        figures = {"contact_gap_m": gap, "stance_slide_mps": 0.01}
        rows.append(Row(name, robot="robot", frames=90, fps=30.0, figures=figures, verdict=verdict_of_figures(figures)))
    address = tmp_path / "report.html"
    address.write_text(report_page(NASTY, rows, {}))
    with chromium() as browser:
        page = browser.new_context(viewport={"width": 1280, "height": 800}, offline=True).new_page()
        page.set_default_timeout(PATIENCE_MS)
        troubles: list[str] = []
        page.on("pageerror", lambda error: troubles.append(str(error)))
        page.on("console", lambda message: troubles.append(message.text) if message.type == "error" else None)
        page.on("dialog", lambda dialog: troubles.append(dialog.message))
        page.goto(address.as_uri())

        def names() -> list[str]:
            return page.locator("#motions tbody tr:visible td:nth-child(1)").all_inner_texts()

        assert names() == ["d", NASTY, "b", "a", "c"], "the worst first"
        head = page.locator("#motions th", has_text="contact gap")
        head.locator("button").click()
        assert names() == ["a", "b", NASTY, "d", "c"]
        assert head.get_attribute("aria-sort") == "ascending"
        head.locator("button").click()
        assert names() == ["d", NASTY, "b", "a", "c"], "what has no number stays last"
        page.locator("#motions th", has_text="motion").locator("button").click()
        assert names()[1:] == ["a", "b", "c", "d"]
        page.locator("#find select[data-of=verdict]").select_option("fail")
        assert sorted(names()) == sorted([NASTY, "d"])
        page.locator("#find input[type=search]").fill("onerror")
        assert names() == [NASTY]
        assert page.locator("#find output").inner_text() == "1 of 5"
        page.locator("#find input[type=search]").fill("")
        page.locator("#find select[data-of=verdict]").select_option("")
        page.locator("button.filter", has_text="contact gap").click()
        assert sorted(names()) == sorted([NASTY, "d"]), "a click on a figure shows who does not pass it"
        page.locator("#find select[data-of=warning]").select_option("")
        page.locator("rect[data-figure=contact_gap_m]").first.click()
        assert names() == ["a"], "a click on a bar shows those in it"
        page.locator("#between").click()
        assert len(names()) == 5
        assert not page.locator("#motions th", has_text="foot slide").is_visible(), "nobody slides"
        page.locator("#columns summary").click()
        page.locator("#columns label", has_text="foot slide").click()
        assert page.locator("#motions th", has_text="foot slide").is_visible()
        for width in (1280, 360):
            page.set_viewport_size({"width": width, "height": 800})
            wait_until(lambda width=width: page.evaluate("innerWidth") == width, "the window is as wide")
            assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth"), "only tables scroll"
            assert page.evaluate(BROKEN_WORDS) == 0
        assert troubles == []


def many_rows(count: int) -> list[Row]:
    """Return rows that pass, each a little better than the one before."""
    figures = [{"stance_slide_mps": 0.01 * (1 - index / count), "contact_gap_m": 0.001} for index in range(count)]
    return [
        Row(f"clip_{index:03d}", robot="robot", frames=90, fps=30.0, figures=each, verdict=verdict_of_figures(each))
        for index, each in enumerate(figures)
    ]


def test_a_paragraph_says_what_is_good_and_what_to_look_at() -> None:
    """Reasons of the motion apart from those of physics, failures before warnings."""
    figures = (
        {"touch_share": 1.0, "stance_slide_mps": 5.0, "grip_margin_g": 0.0},
        {"touch_share": 0.5, "grip_margin_g": 0.0},
        {"touch_share": 0.5, "grip_margin_g": 0.0},
    )
    rows = [Row(f"clip_{index}", figures=each, verdict=verdict_of_figures(each)) for index, each in enumerate(figures)]
    page = report_page("Report", rows, {})
    told = re.sub(r"<[^>]*>", "", re.search(r'<p class="first">(.*?)</p>', page, re.DOTALL)[1])
    assert told.startswith("touch median 50.0, worst 50.0 %")
    assert "Most often foot slide fails in 1, touch warns in 2." in told
    motion, physics = (page.index(f"<h2>{title}</h2>") for title in ("What does not pass", "What physics warns of"))
    assert motion < page.index("grip margin", physics) and "grip margin" not in page[motion:physics]
    assert 'class="first"' not in report_page("Report", [], {})


def test_of_many_rows_the_worst_are_in_the_page_and_the_others_packed_in_it() -> None:
    page = report_page("Report", many_rows(250), {})
    further = re.search(r'<script id="further" type="text/plain" data-count="(\d+)">(.*?)</script>', page)
    rest = gzip.decompress(base64.b64decode(further[2])).decode()
    names = [re.findall(r"<span>(clip_\d+)</span>", text) for text in (page, rest)]
    assert [len(each) for each in names] == [100, 150] and int(further[1]) == 150
    assert names[0] + names[1] == [row.file for row in worst_first(many_rows(250))]
    assert "further" not in report_page("Report", many_rows(100), {}).partition("<footer")[0]


@pytest.mark.slow
@pytest.mark.browser
def test_many_rows_are_found_sorted_and_scrolled_to(tmp_path: Path) -> None:
    address = tmp_path / "report.html"
    address.write_text(report_page("Report", many_rows(1000), {}))
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.set_default_timeout(PATIENCE_MS)
        page.goto(address.as_uri())
        there, count = page.locator("#motions tbody tr"), page.locator("#find output")
        assert count.inner_text() == "1000 of 1000" and there.count() <= 200
        page.locator("#find input[type=search]").fill("clip_999")
        wait_until(lambda: there.first.inner_text().startswith("clip_999"), "the last one is found")
        assert count.inner_text() == "1 of 1000"
        page.locator("#find input[type=search]").fill("")
        head = page.locator("#motions th", has_text="motion").locator("button")
        head.click()
        head.click()
        assert there.first.inner_text().startswith("clip_999")

        def scrolled() -> bool:
            there.last.scroll_into_view_if_needed()
            return there.count() == 1000

        wait_until(scrolled, "all of them are scrolled to")
        assert there.last.inner_text().startswith("clip_000")
