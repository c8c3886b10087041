"""Data sets: a folder of Parquet rows and a card, read back with pyarrow, and with `datasets` where it is."""

import importlib.util
import io
import json
import re

import numpy as np
import pytest

from export_motions import as_result
from hoi_retarget.motion.formats import dataset
from hoi_retarget.motion.formats.dataset import CARD, write_dataset
from hoi_retarget.motion.motion_report import Report
from trajectories import MODELS

pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")

G1, H2 = MODELS["unitree_g1"], MODELS["unitree_h2"]
ROWS = "data/train-00000-of-00001.parquet"


def rows_of(content: bytes) -> list[dict]:
    return pq.read_table(io.BytesIO(content)).to_pylist()


def test_rows_hold_the_motions_whatever_robots_and_objects_they_have():
    results = [
        as_result(G1, stem="a", objects=1, seed=1),
        as_result(H2, stem="b", objects=2, seed=2, frames=25),
        as_result(G1, stem="c", objects=0, seed=3),
    ]
    files = write_dataset(results, None)
    assert set(files) == {ROWS, CARD}
    for result, row in zip(results, rows_of(files[ROWS]), strict=True):
        motion = result.motion
        assert (row["name"], row["robot"], row["fps"]) == (result.stem, motion.robot, motion.fps)
        assert row["frames"] == motion.frames and row["joint_names"] == list(motion.joint_names)
        np.testing.assert_allclose(np.array(row["qpos"]), motion.qpos, atol=1e-6)
        assert row["contact_object_names"] == list(motion.object_names)
        shape = (motion.frames, len(motion.object_names), 3)
        np.testing.assert_allclose(np.reshape(row["contact_object_pos_w"], shape), motion.object_pos, atol=1e-6)
        np.testing.assert_array_equal(np.array(row["contact_flags"]), motion.contact_flags)
        np.testing.assert_array_equal(np.array(row["contact_object"]), motion.contact_object)
        np.testing.assert_allclose(np.array(row["contact_points"], float), motion.contact_points, atol=1e-6)
        assert json.loads(row["source"])["name"] == "sub1_box_000.pt"
        assert [item["name"] for item in json.loads(row["objects"])] == list(motion.object_names)


def test_another_rate_is_that_of_all_rows():
    files = write_dataset([as_result(G1, stem="a"), as_result(G1, stem="b", fps=24.0)], 50.0)
    assert [row["fps"] for row in rows_of(files[ROWS])] == [50.0, 50.0]


def test_many_motions_are_cut_into_files(monkeypatch):
    monkeypatch.setattr(dataset, "ROWS_PER_FILE", 2)
    files = write_dataset([as_result(G1, stem=name, frames=5) for name in "abc"], None)
    assert sorted(files) == [CARD, "data/train-00000-of-00002.parquet", "data/train-00001-of-00002.parquet"]
    rows = [row["name"] for name in sorted(files) if name != CARD for row in rows_of(files[name])]
    assert rows == ["a", "b", "c"]


def test_the_same_results_make_the_same_bytes():
    results = [as_result(G1, frames=5)]
    assert write_dataset(results, None) == write_dataset(results, None)


def test_the_card_names_every_licence_every_robot_and_every_column():
    results = [as_result(G1, stem="a"), as_result(G1, stem="b", report=Report()), as_result(H2, stem="c")]
    files = write_dataset(results, None)
    card = files[CARD].decode()
    head, body = card.split("---\n")[1:3]
    assert "license: other" in head and "path: data/train-*.parquet" in head
    assert "| CC BY 4.0 / made up | intermimic-591 | 2 |" in body and "| unknown | unknown | 1 |" in body
    assert "| unitree_g1 | 2 |" in body and "| unitree_h2 | 1 |" in body
    columns = set(rows_of(files[ROWS])[0])
    assert columns == set(re.findall(r"`(\w+)`", body.split("## Columns")[1]))


def test_datasets_itself_loads_the_folder(tmp_path):
    if importlib.util.find_spec("datasets") is None:
        pytest.skip("datasets is not installed")
    from datasets import load_dataset

    result = as_result(G1, stem="a")
    for name, content in write_dataset([result], None).items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    row = load_dataset(str(tmp_path), cache_dir=str(tmp_path / "cache"))["train"][0]
    np.testing.assert_allclose(np.array(row["qpos"]), result.motion.qpos, atol=1e-6)
