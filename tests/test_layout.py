"""Motions that lack joints of the robot, or have them in another order."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import motion_writers as writers
from hoi_retarget.errors import ReadError
from hoi_retarget.motion.check import CheckedMotion, as_qpos, check
from hoi_retarget.motion.check.finding import collected
from hoi_retarget.motion.check.layout import lay_out
from hoi_retarget.motion.formats import read
from hoi_retarget.studio.report.open_motion import open_motion

FOREIGN = Path(__file__).resolve().parents[1].parent / "shared" / "data" / "foreign" / "motions"
needs_foreign = pytest.mark.skipif(not FOREIGN.is_dir(), reason="no files of other programs here")
BOUNDED = settings(derandomize=True, deadline=None, max_examples=40, database=None)
NAMES = writers.motion().joint_names
UNITREE_23 = ("waist_roll", "waist_pitch", "wrist_pitch", "wrist_yaw")
WITHOUT = {
    "27": ("waist_roll", "waist_pitch"),
    "25": ("wrist_pitch", "wrist_yaw"),
    "23": ("wrist",),
    "of 23": UNITREE_23,
}


def without(*parts: str) -> list[int]:
    return [index for index, name in enumerate(NAMES) if not any(part in name for part in parts)]


def saved(columns: list[int], folder: Path, *, key: str | None = "joint_names") -> Path:
    """Write a dictionary of GMR with these joints, with their names where there is a key for them."""
    content = writers.gmr(writers.motion())
    content["dof_pos"] = content["dof_pos"][:, columns]
    if key is not None:
        content[key] = [NAMES[column] for column in columns]
    return writers.save("gmr", content, folder)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return read(writers.write("gmr", tmp_path_factory.mktemp("gmr")))


def remarks(checked: CheckedMotion) -> str:
    return "\n".join(f"{item.numbers}: {item.advice}" for item in checked.findings if item.subject == "joint count")


# Names


@BOUNDED
@given(st.permutations(range(len(NAMES))), st.integers(1, len(NAMES)))
def test_every_joint_is_found_by_its_name(whole, order, count):
    columns = order[:count]
    names = tuple(NAMES[column] for column in columns)
    file = replace(whole, joint_pos=whole.joint_pos[:, columns], joint_names=names)
    layout = collected(lay_out(file, writers.model()), [])
    assert layout.columns is not None
    for joint, column in enumerate(layout.columns):
        if joint in columns:
            assert np.array_equal(layout.joint_pos[:, column], whole.joint_pos[:, joint])
        else:
            assert column == -1


@pytest.mark.parametrize("key", ["joint_names", "dof_names"])
def test_names_in_any_order_give_the_same_motion(whole, key, tmp_path):
    order = np.random.default_rng(0).permutation(len(NAMES)).tolist()
    plain = as_qpos(whole, writers.model())
    shuffled = as_qpos(read(saved(order, tmp_path, key=key)), writers.model())
    assert np.array_equal(plain.qpos, shuffled.qpos)
    assert not shuffled.missing_joints


@pytest.mark.parametrize("parts", WITHOUT.values(), ids=WITHOUT)
def test_named_joints_that_a_file_lacks_are_held_still_and_named(parts, tmp_path):
    kept = without(*parts)
    path = saved(kept[::-1], tmp_path)
    checked = check(read(path), writers.model())
    absent = tuple(name for index, name in enumerate(NAMES) if index not in kept)
    assert checked.missing_joints == absent
    assert not checked.contradictions
    assert f"the file lacks {', '.join(absent)}: Joints that the file lacks are held still at 0 rad" in remarks(checked)
    expected = writers.motion().qpos.copy()
    expected[:, 7 + np.array([NAMES.index(name) for name in absent])] = 0.0
    opened = open_motion(path, writers.model())
    assert np.abs(opened.motion.qpos - expected).max() < 1e-12
    assert opened.notes == (f"joints that the file lacks are held still at 0 rad: {', '.join(absent)}",)


def test_names_that_do_not_fit_the_columns_are_an_error(tmp_path):
    path = saved(without(), tmp_path)
    content = pickle.loads(path.read_bytes())
    for names, words in ((list(NAMES[1:]), "28 joint names for 29"), ([1] * 29, "'joint_names' is no list of names")):
        path.write_bytes(pickle.dumps({**content, "joint_names": names}))
        with pytest.raises(ReadError, match=words):
            read(path)


# Counts


@pytest.mark.parametrize(
    ("parts", "words"),
    [(("wrist",), "all but the wrists"), (UNITREE_23, "those of Unitree's 23-joint G1")],
    ids=["without wrists", "Unitree's"],
)
def test_which_23_joints_a_file_without_names_has_is_found_and_said(parts, words, tmp_path):
    kept = without(*parts)
    checked = check(read(saved(kept, tmp_path, key=None)), writers.model())
    assert f"the file has 23 and no names: they are taken for {words}" in remarks(checked)
    assert "held still at 0 rad" in remarks(checked)
    source = writers.motion().qpos
    assert np.abs(checked.qpos[:, 7:][:, kept] - source[:, 7:][:, kept]).max() < 1e-12


def test_23_joints_that_may_be_either_are_not_guessed_where_the_format_leaves_it_open(tmp_path):
    source = writers.unitree_csv(writers.motion())["table"]
    table = np.concatenate([source[:, :7], 0.1 * np.ones((len(source), 23))], axis=1)
    checked = check(read(writers.save("unitree-csv", {"table": table}, tmp_path)), writers.model())
    assert [item.subject for item in checked.contradictions][:1] == ["joint count"]
    assert "no names that tell which" in remarks(checked)


@pytest.mark.parametrize("count", [22, 24, 27, 28, 30])
def test_other_counts_without_names_are_not_guessed(count, tmp_path):
    columns = [*range(29), 0][:count]
    checked = check(read(saved(columns, tmp_path, key=None)), writers.model())
    assert "no names that tell which" in remarks(checked)
    assert checked.readable_qpos is None


# Other people's files


@needs_foreign
def test_a_recording_with_29_named_and_with_23_nameless_joints_is_one_motion():
    folder = FOREIGN / "gmr_view"
    names = ("sub1_clothesstand_004.pkl", "sub1_clothesstand_004_23dof.pkl")
    whole, part = (check(read(folder / name), writers.model()).qpos for name in names)
    assert whole is not None
    assert part is not None
    columns = [*range(7), *(7 + column for column in without("wrist"))]
    assert np.array_equal(whole[:, columns], part[:, columns])


@needs_foreign
@pytest.mark.parametrize("name", ["walk1_subject1-3_12", "push_box"])
def test_motions_of_hdmi_with_25_joints_are_read(name):
    folder = next(path.parent for path in (FOREIGN / "hdmi" / name).rglob("motion.npz"))
    missing = check(read(folder), writers.model()).missing_joints
    assert missing == tuple(NAMES[column] for column in range(len(NAMES)) if column not in without(*WITHOUT["25"]))
