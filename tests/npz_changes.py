"""Changes `.npz` files that tests have written, on purpose or by chance."""

import io
from pathlib import Path

import numpy as np


def changed(path: Path, **values) -> Path:
    """Write an `.npz` file again with other arrays, without those that are None; its path is returned."""
    with np.load(path) as archive:
        arrays = dict(archive) | values
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return path


def damage(data, st, path: Path) -> None:
    """Do one thing to a file that Hypothesis draws: drop, reshape or cut an array, spoil a number, change bytes."""
    try:
        arrays = dict(np.load(io.BytesIO(path.read_bytes())))
    except Exception:  # noqa: BLE001 - it was damaged before, and numpy raises anything
        return
    kind = data.draw(st.sampled_from(["bytes", "drop", "shape", "cut", "number", "text"]))
    if kind == "bytes":
        content = bytearray(path.read_bytes())
        for _ in range(data.draw(st.integers(1, 4))):
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
        path.write_bytes(bytes(content)[: data.draw(st.sampled_from([None, 10, len(content) // 2]))])
        return
    name = data.draw(st.sampled_from(sorted(arrays)))
    array = arrays[name]
    if kind == "drop":
        del arrays[name]
    elif kind == "shape":
        arrays[name] = data.draw(st.sampled_from([array[None], array.reshape(-1), array.T, array[..., None]]))
    elif kind == "cut":
        arrays[name] = np.atleast_1d(array)[: data.draw(st.integers(0, 5))]
    elif kind == "text" or array.dtype.kind not in "fiu" or array.size == 0:
        arrays[name] = np.array(data.draw(st.sampled_from(["", "../x", "male", "box", "a/b"])))
    else:
        value = data.draw(st.sampled_from([np.nan, np.inf, -1e300, 1e5, 0.0, 3.2]))
        array = array.astype(float)
        array.flat[data.draw(st.integers(0, array.size - 1))] = value
        arrays[name] = array
    np.savez(path, **arrays)
