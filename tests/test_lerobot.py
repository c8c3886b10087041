"""LeRobot data sets: every number where its name says, and read by lerobot itself where it is installed."""

import io
import json

import numpy as np
import pytest

from export_motions import as_result
from hoi_retarget.errors import ArgumentError
from hoi_retarget.motion.formats.lerobot import INFO, write_lerobot
from hoi_retarget.motion.resample import resample
from trajectories import MODELS

pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")

G1, H2 = MODELS["unitree_g1"], MODELS["unitree_h2"]
FRAMES = "data/chunk-000/file-000.parquet"
RESULTS = [as_result(G1, stem="lift_a_box", objects=1, seed=1), as_result(G1, stem="b", objects=1, seed=2, frames=25)]


def table_of(content: bytes) -> dict[str, list]:
    return pq.read_table(io.BytesIO(content)).to_pydict()


def test_every_number_is_where_its_name_says():
    files = write_lerobot(RESULTS, None)
    info, columns = json.loads(files[INFO]), table_of(files[FRAMES])
    assert set(columns) == set(info["features"])
    motions = [resample(result.motion, result.model, 50.0) for result in RESULTS]
    assert info["fps"] == 50 and info["total_frames"] == sum(motion.frames for motion in motions)
    names = info["features"]["observation.state"]["names"]
    state, first = np.array(columns["observation.state"]), 0
    for number, motion in enumerate(motions):
        own = slice(first, first + motion.frames)
        np.testing.assert_allclose(state[own], motion.qpos, atol=1e-6)
        for joint, name in enumerate(motion.motion.joint_names):
            np.testing.assert_allclose(state[own, names.index(name)], motion.qpos[:, 7 + joint], atol=1e-6)
        poses = np.concatenate([motion.object_pos[:, 0], motion.object_quat[:, 0]], axis=1)
        np.testing.assert_allclose(np.array(columns["observation.objects"])[own], poses, atol=1e-6)
        np.testing.assert_allclose(np.array(columns["action"])[own][:-1], motion.qpos[1:, 7:], atol=1e-6)
        np.testing.assert_allclose(columns["timestamp"][own], np.arange(motion.frames) / 50.0, atol=1e-5)
        assert columns["episode_index"][own] == [number] * motion.frames
        assert columns["frame_index"][own] == list(range(motion.frames))
        flags = np.array(columns["observation.contacts"])[own]
        for column, part in enumerate(info["features"]["observation.contacts"]["names"]):
            link = motion.motion.contact_links.index(motion.model.spec.part_sites[part])
            np.testing.assert_array_equal(flags[:, column], motion.contact_flags[:, link])
        first += motion.frames
    assert columns["index"] == list(range(first))
    episodes = table_of(files["meta/episodes/chunk-000/file-000.parquet"])
    assert episodes["dataset_from_index"] == [0, motions[0].frames]
    assert episodes["dataset_to_index"] == [motions[0].frames, first]
    assert episodes["tasks"] == [["lift a box"], ["b"]]
    statistics = json.loads(files["meta/stats.json"])["observation.state"]
    np.testing.assert_allclose(statistics["mean"], state.mean(axis=0), atol=1e-4)
    np.testing.assert_allclose(statistics["max"], state.max(axis=0), atol=1e-6)


def test_frames_have_one_shape():
    for other in (as_result(H2, stem="b", objects=1), as_result(G1, stem="b", objects=2)):
        with pytest.raises(ArgumentError, match="frames of a lerobot data set have one shape"):
            write_lerobot([RESULTS[0], other], None)
    assert "observation.objects" not in json.loads(write_lerobot([as_result(G1, objects=0)], 30.0)[INFO])["features"]


def test_lerobot_reads_it(tmp_path):
    datasets = pytest.importorskip("lerobot.datasets.lerobot_dataset", reason="lerobot is not installed")
    for name, content in write_lerobot(RESULTS, None).items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    read = datasets.LeRobotDataset("local/set", root=tmp_path)
    motion = resample(RESULTS[0].motion, G1, 50.0)
    assert len(read) == motion.frames + resample(RESULTS[1].motion, G1, 50.0).frames
    np.testing.assert_allclose(read[3]["observation.state"].numpy(), motion.qpos[3], atol=1e-6)
    assert read[0]["task"] == "lift a box"
