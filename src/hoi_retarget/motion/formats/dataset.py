"""Many results as one folder that `datasets.load_dataset` reads: Parquet rows and a card.

A row is a motion. Its arrays are nested lists, frames first, so that robots with other joints and
clips with other objects fit into one table.
"""

import io
import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from hoi_retarget import __version__
from hoi_retarget.errors import HoiRetargetError, install_hint
from hoi_retarget.motion.contact_arrays import contact_arrays
from hoi_retarget.motion.resample import resample
from hoi_retarget.motion.result import UNKNOWN, Result

NAME = "dataset"
ROWS_PER_FILE = 500
FOLDER = "data"
CARD = "README.md"


def write_dataset(results: Sequence[Result], fps: float | None) -> dict[str, bytes]:
    """Return the folder's files by their paths in it; raises `HoiRetargetError` where pyarrow is missing."""
    check_pyarrow()
    rows = [_row(result, fps) for result in results]
    shards = [rows[first : first + ROWS_PER_FILE] for first in range(0, len(rows), ROWS_PER_FILE)]
    files = {
        f"{FOLDER}/train-{number:05}-of-{len(shards):05}.parquet": parquet_bytes(
            {name: [row[name] for row in shard] for name in shard[0]}
        )
        for number, shard in enumerate(shards)
    }
    return {CARD: _card(results).encode(), **files}


def check_pyarrow() -> None:
    """Raise `HoiRetargetError` where pyarrow is missing, with the command that installs it."""
    if hint := install_hint("pyarrow"):
        raise HoiRetargetError(f"A data set is written with pyarrow, which is not installed. {hint}")


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


def parquet_bytes(columns: Mapping[str, Any], metadata: Mapping[str, str] = MappingProxyType({})) -> bytes:
    """Return a Parquet file of columns: arrays of numbers or of rows of them, lists of arrays, or lists."""
    import pyarrow as pa  # noqa: PLC0415 # pyright: ignore[reportMissingImports] - optional
    import pyarrow.parquet as pq  # noqa: PLC0415 # pyright: ignore[reportMissingImports] - optional

    def column(values: Any) -> Any:
        if isinstance(values, np.ndarray) and values.ndim == 2:
            return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])
        if isinstance(values, list) and isinstance(values[0], np.ndarray):
            return _lists(values)
        return pa.array(values)

    table = pa.table({name: column(values) for name, values in columns.items()})
    buffer = io.BytesIO()
    pq.write_table(table.replace_schema_metadata(dict(metadata)) if metadata else table, buffer, compression="zstd")
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
    import jinja2  # noqa: PLC0415 - other formats start without it

    sources = [result.origin()["source"] for result in results]
    terms = Counter((source["licence"], source["format"] or UNKNOWN) for source in sources)
    robots = Counter(result.motion.robot for result in results)
    size = sum(terms.values())
    scale = "n<1K" if size < 1000 else "1K<n<10K" if size < 10_000 else "10K<n<100K"
    environment = jinja2.Environment(trim_blocks=True, undefined=jinja2.StrictUndefined)
    environment.filters["cell"] = lambda text: " ".join(text.replace("|", "/").split())
    card = environment.from_string(Path(__file__).with_name("dataset_card.md.j2").read_text(encoding="utf-8"))
    facts = {"size": size, "scale": scale, "rows": f"{FOLDER}/train-*.parquet", "version": __version__}
    return card.render(terms=sorted(terms.items()), robots=sorted(robots.items()), **facts)
