"""Many results as one folder that `datasets.load_dataset` reads: Parquet rows and a card.

A row is a motion. Its arrays are nested lists, frames first, so that robots with other joints and
clips with other objects fit into one table.
"""

import io
import json
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from hoi_retarget import __version__
from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.motion.contact_arrays import contact_arrays
from hoi_retarget.motion.resample import resample
from hoi_retarget.motion.result import UNKNOWN, Result

NAME = "dataset"
ROWS_PER_FILE = 500
FOLDER = "data"
CARD = "README.md"

PYARROW_MISSING = (
    'A data set is written with pyarrow, which is not installed. In a clone: pip install ".[dataset]"; '
    'else: pip install "hoi-retarget[dataset]".'
)
_COLUMNS = """\
| column | shape | meaning |
|---|---|---|
| `name`, `robot`, `licence` | | the motion; whose; under which terms its recording is |
| `fps`, `frames` | | rate [1/s], number of frames T |
| `joint_names` | n | order of the joints |
| `qpos` | T, 7 + n | root position [m], root rotation wxyz, joints [rad] |
| `root_lin_vel`, `root_ang_vel`, `joint_vel` | T, 3; T, 3; T, n | in the world's axes [m/s], [rad/s] |
| `contact_object_names`, `contact_object_scale` | O | objects, and what their meshes are to be multiplied by |
| `contact_object_pos_w`, `contact_object_quat_w` | T, O, 3; T, O, 4 | their paths [m], wxyz |
| `contact_links`, `contact_bodies` | C | what touches: its role, and the robot's body |
| `contact_body_points` | C, 3 | where on the body [m] |
| `contact_flags`, `contact_object` | T, C | whether it touches, and which object (-1: none) |
| `contact_points`, `contact_normals` | T, C, 3 | in the scaled object's frame [m], outwards; NaN where there are none |
| `contact_stance` | T, 2 | left and right foot on the floor |
| `objects`, `source`, `result` | | JSON: shapes, recording, result file |
"""


def write_dataset(results: Sequence[Result], fps: float | None) -> dict[str, bytes]:
    """Return the folder's files by their paths in it; raises `HoiRetargetError` where pyarrow is missing."""
    try:
        import pyarrow  # noqa: F401, PLC0415 # pyright: ignore[reportMissingImports] - optional
    except ImportError as error:
        raise HoiRetargetError(PYARROW_MISSING) from error
    shards = [results[first : first + ROWS_PER_FILE] for first in range(0, len(results), ROWS_PER_FILE)]
    files = {
        f"{FOLDER}/train-{number:05}-of-{len(shards):05}.parquet": _parquet([_row(result, fps) for result in shard])
        for number, shard in enumerate(shards)
    }
    return {CARD: _card(results).encode(), **files}


def _row(result: Result, fps: float | None) -> dict[str, Any]:
    motion = result.motion
    resampled = resample(motion, result.model, fps)
    made_from = result.origin()
    return {
        "name": result.stem,
        "robot": motion.robot,
        "licence": result.licence,
        "fps": resampled.fps,
        "frames": resampled.frames,
        "joint_names": np.array(motion.joint_names, dtype=np.str_),
        "qpos": resampled.qpos,
        "root_lin_vel": resampled.root_lin_vel,
        "root_ang_vel": resampled.root_ang_vel,
        "joint_vel": resampled.joint_vel,
        **contact_arrays(resampled, result.surfaces),
        "objects": json.dumps([result.object_facts(index) for index in range(len(motion.object_names))]),
        "source": json.dumps(made_from["source"]),
        "result": json.dumps(made_from["result"]),
    }


def _parquet(rows: Sequence[dict[str, Any]]) -> bytes:
    import pyarrow as pa  # noqa: PLC0415 # pyright: ignore[reportMissingImports] - optional
    import pyarrow.parquet as pq  # noqa: PLC0415 # pyright: ignore[reportMissingImports] - optional

    columns = {}
    for name, value in rows[0].items():
        values = [row[name] for row in rows]
        columns[name] = _lists(values) if isinstance(value, np.ndarray) else pa.array(values)
    buffer = io.BytesIO()
    pq.write_table(pa.table(columns), buffer, compression="zstd")
    return buffer.getvalue()


def _lists(arrays: Sequence[np.ndarray]) -> Any:
    """Return a column of nested lists, a list per array; numbers in single precision."""
    import pyarrow as pa  # noqa: PLC0415 # pyright: ignore[reportMissingImports] - optional

    flat = np.concatenate([array.reshape(-1) for array in arrays])
    kinds = {"f": pa.float32(), "U": pa.string(), "b": pa.bool_(), "i": pa.int64()}
    column = pa.array(flat.astype(np.float32) if flat.dtype.kind == "f" else flat, type=kinds[flat.dtype.kind])
    for axis in reversed(range(arrays[0].ndim)):
        lengths = [np.full(int(np.prod(array.shape[:axis])), array.shape[axis]) for array in arrays]
        offsets = np.concatenate([[0], np.cumsum(np.concatenate(lengths))])
        column = pa.ListArray.from_arrays(pa.array(offsets, type=pa.int32()), column)
    return column


def _card(results: Iterable[Result]) -> str:
    sources = [result.origin()["source"] for result in results]
    terms = Counter((source["licence"], source["format"] or UNKNOWN) for source in sources)
    robots = Counter(result.motion.robot for result in results)
    size = sum(terms.values())
    scale = "n<1K" if size < 1000 else "1K<n<10K" if size < 10_000 else "10K<n<100K"
    lines = [
        "---",
        "license: other",
        "license_name: by-source",
        "license_link: README.md",
        "task_categories: [robotics]",
        "tags: [humanoid, retargeting, human-object-interaction, contacts]",
        f"size_categories: [{scale}]",
        "configs:",
        "- config_name: default",
        "  data_files:",
        "  - split: train",
        f"    path: {FOLDER}/train-*.parquet",
        "---",
        "",
        "# Retargeted motions",
        "",
        f"{size} motions of humanoid robots that handle objects, made from recordings of people by "
        f"hoi-retarget {__version__}.",
        "",
        "## Terms",
        "",
        "Motions keep the terms of the recordings that they were made from; each row names its own.",
        "",
        "| licence of the recordings | format | motions |",
        "|---|---|---|",
        *(f"| {_cell(licence)} | {_cell(format)} | {count} |" for (licence, format), count in sorted(terms.items())),
        "",
        "## Robots",
        "",
        "| robot | motions |",
        "|---|---|",
        *(f"| {_cell(name)} | {count} |" for name, count in sorted(robots.items())),
        "",
        "## Columns",
        "",
        "World with z up; metres, radians, seconds; quaternions wxyz; numbers in single precision.",
        "",
        _COLUMNS,
    ]
    return "\n".join(lines)


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "/").split())
