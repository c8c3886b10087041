"""Many results of one robot as a LeRobot data set, version 3.0: an episode a motion, without pictures.

A frame has the state of base and joints, its velocity, the objects' poses and flags of hands and feet that touch; its
action is the joints' angles of the next frame. The features name every number; quaternions are wxyz.

Cites: huggingface/lerobot `lerobot/datasets/utils.py` and `docs/source/lerobot-dataset-v3.mdx`.
"""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.clip import TOLD
from hoi_retarget.errors import ArgumentError
from hoi_retarget.motion.formats.dataset import check_pyarrow, parquet_bytes
from hoi_retarget.motion.resample import ResampledMotion, resample
from hoi_retarget.motion.result import Result

NAME, FPS = "lerobot", 50.0
INFO, _FILE = "meta/info.json", "chunk-000/file-000.parquet"
_POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
_TASK = "__index_level_0__"
_PANDAS = {
    "index_columns": [_TASK],
    "column_indexes": [],
    "columns": [
        {"name": name, "field_name": field, "pandas_type": kind, "numpy_type": kind, "metadata": None}
        for name, field, kind in (("task_index", "task_index", "int64"), (None, _TASK, "object"))
    ],
    "pandas_version": "2.2.0",
}
"""Tells readers that the tasks are the index of their table."""


def write_lerobot(results: Sequence[Result], fps: float | None) -> dict[str, bytes]:
    """Return the folder's files by their paths in it.

    Raises `HoiRetargetError` where pyarrow is missing, and `ArgumentError` where robots or numbers of objects differ.
    """
    check_pyarrow()
    motions = [resample(result.motion, result.model, fps or FPS) for result in results]
    kinds = {f"{item.motion.robot} with {len(item.motion.object_names)} object(s)": None for item in motions}
    if len(kinds) > 1:
        raise ArgumentError(
            f"frames of a {NAME} data set have one shape, but these results are of {', '.join(kinds)}. Export each "
            "kind into a folder of its own."
        )
    features, tasks = [_features(motion) for motion in motions], [_task(result) for result in results]
    lengths, known = np.array([motion.frames for motion in motions]), list(dict.fromkeys(tasks))
    frames, stops = np.concatenate([np.arange(length) for length in lengths]), np.cumsum(lengths)
    shared = [name for name in features[0] if all(name in item for item in features)]
    columns: dict[str, np.ndarray] = {
        **{name: np.concatenate([item[name][1] for item in features]).astype(np.float32) for name in shared},
        "timestamp": (frames / motions[0].fps).astype(np.float32),
        "frame_index": frames,
        "episode_index": np.repeat(np.arange(len(motions)), lengths),
        "index": np.arange(len(frames)),
        "task_index": np.repeat([known.index(task) for task in tasks], lengths),
    }
    episodes = {
        "episode_index": np.arange(len(motions)),
        "tasks": [[task] for task in tasks],
        "length": lengths,
        **{f"{kind}/{place}_index": 0 * lengths for kind in ("data", "meta/episodes") for place in ("chunk", "file")},
        "dataset_from_index": stops - lengths,
        "dataset_to_index": stops,
    }
    return {
        INFO: json.dumps(_info(motions, columns, features[0], len(known)), indent=4).encode(),
        "meta/stats.json": json.dumps({name: _statistics(values) for name, values in columns.items()}).encode(),
        "meta/tasks.parquet": parquet_bytes(
            {"task_index": np.arange(len(known)), _TASK: known}, {"pandas": json.dumps(_PANDAS)}
        ),
        f"meta/episodes/{_FILE}": parquet_bytes(episodes),
        f"data/{_FILE}": parquet_bytes(columns),
    }


def _features(motion: ResampledMotion) -> dict[str, tuple[list[str], Float[np.ndarray, "T D"]]]:
    """Return the features that a motion has: the names of their numbers, and these."""
    joints, angles, links = list(motion.motion.joint_names), motion.qpos[:, 7:], motion.motion.contact_links
    poses = np.concatenate([motion.object_pos, motion.object_quat], axis=2).reshape(motion.frames, -1)
    velocity = np.concatenate([motion.root_lin_vel, motion.root_ang_vel, motion.joint_vel], axis=1)
    parts = {part: links.index(site) for part, site in motion.model.spec.part_sites.items() if site in links}
    objects = range(len(motion.motion.object_names))
    found = {
        "observation.state": ([*(f"base_{axis}" for axis in _POSE), *joints], motion.qpos),
        "observation.velocity": ([*(f"base_{kind}{axis}" for kind in "vw" for axis in "xyz"), *joints], velocity),
        "observation.objects": ([f"object{index}_{axis}" for index in objects for axis in _POSE], poses),
        "observation.contacts": (list(parts), motion.contact_flags[:, list(parts.values())].astype(float)),
        "action": (joints, np.concatenate([angles[1:], angles[-1:]])),
    }
    return {name: (names, values) for name, (names, values) in found.items() if names}


def _info(
    motions: Sequence[ResampledMotion],
    columns: dict[str, np.ndarray],
    features: dict[str, tuple[list[str], Float[np.ndarray, "T D"]]],
    tasks: int,
) -> dict[str, Any]:
    return {
        "codebase_version": "v3.0",
        "robot_type": motions[0].motion.robot,
        "total_episodes": len(motions),
        "total_frames": len(columns["index"]),
        "total_tasks": tasks,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": motions[0].rate,
        "splits": {"train": f"0:{len(motions)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": {
            name: {
                "dtype": str(values.dtype),
                "shape": list(values.shape[1:]) or [1],
                "names": features[name][0] if name in features else None,
            }
            for name, values in columns.items()
        },
    }


def _task(result: Result) -> str:
    notes = () if result.clip is None else result.clip.source.notes
    return next((note.removeprefix(TOLD) for note in notes if note.startswith(TOLD)), result.stem.replace("_", " "))


def _statistics(values: np.ndarray) -> dict[str, list]:
    table = values.reshape(len(values), -1).astype(float)
    found = {kind: getattr(table, kind)(axis=0).tolist() for kind in ("min", "max", "mean", "std")}
    return found | {"count": [len(table)]}
