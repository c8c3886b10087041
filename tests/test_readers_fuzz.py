"""Damaged files of every source: a clip or one error that names a file, and never anything else."""

import json
import pickle
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.files.array_pickle import parse_pickle, read_joblib
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.files.torch_file import parse_torch
from hoi_retarget.readers import clips_in, read_clip, reader_of, readers
from hoi_retarget.readers.reader import Outline
from joblib_writer import joblib_bytes
from outcomes import both_outcomes
from recordings import WRITERS, Recording, format_of
from torch_writer import STORAGE_OF, torch_bytes

FORMATS = [reader.format for reader in readers()]
FRAMES = 15
FILES = 4  # At least so many damaged ones of each kind of damage.


def flipped(content: bytes, place: int) -> bytes:
    return content[:place] + bytes([content[place] ^ 0x41]) + content[place + 1 :]


def truncated(content: bytes, place: int) -> bytes:
    return content[:place]


def gapped(content: bytes, place: int) -> bytes:
    return content[:place] + content[place + 7 :]


def extended(content: bytes, place: int) -> bytes:
    return content + content[:place][-100:]


DAMAGES = (flipped, truncated, gapped, extended)


def damaged_files(folder: Path) -> Iterator[Any]:
    """Damage one file after the other in each way; yield the way, and make the file whole again."""
    rng = np.random.default_rng(0)
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    for path in files * -(-FILES // len(files)):
        content = path.read_bytes()
        for damage in DAMAGES:
            path.write_bytes(damage(content, int(rng.integers(len(content)))))
            yield damage
        path.write_bytes(content)


def moves_alike(a: Clip, b: Clip) -> bool:
    """Whether people, objects and contacts of two clips agree to the bit."""
    pairs = zip(_arrays(a), _arrays(b), strict=True)
    return a.fps == b.fps and all(x.tobytes() == y.tobytes() for x, y in pairs)


def _arrays(clip: Clip) -> list[np.ndarray]:
    parts = (*clip.people, *clip.objects, *clip.contacts)
    return [value for part in parts for value in vars(part).values() if isinstance(value, np.ndarray)]


def recordings(kind: str, folder: Path) -> Iterator[tuple[Path, Recording]]:
    """Write the recordings of a format; yield each one and its folder."""
    for name in [name for name in WRITERS if format_of(name) == kind]:
        (folder / name).mkdir()
        yield folder / name, WRITERS[name](folder / name, FRAMES)


@pytest.mark.slow
@pytest.mark.parametrize("kind", FORMATS)
def test_a_damaged_file_is_read_or_refused(tmp_path, kind):
    for folder, recording in recordings(kind, tmp_path):
        whole, refused, alike = recording.read(), 0, 0
        for damage in damaged_files(folder):
            try:
                clip = recording.read()
            except HoiRetargetError as error:
                refused += 1
                assert str(folder) in str(error)
            else:
                alike += moves_alike(clip, whole)
                assert moves_alike(clip, whole) or damage is not truncated, "a part must not pass for the whole"
        # Nothing tells a changed digit of text from another one.
        assert refused and (alike or kind == "bvh")


# Values in sound files


def npz_values(path: Path) -> dict[str, Any]:
    with np.load(path, allow_pickle=True) as stored:
        return {name: value.item() if value.dtype == object else value for name, value in dict(stored).items()}


def save_npz(path: Path, values: Any) -> None:
    np.savez(path, **values if isinstance(values, dict) else {"values": values})


def glb_values(path: Path) -> Any:
    content = path.read_bytes()
    return json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])


def save_glb(path: Path, tables: Any) -> None:
    """Write other tables before the same binary chunk."""
    content, text = path.read_bytes(), json.dumps(tables, default=str).encode()
    text += b" " * (-len(text) % 4)
    rest = content[20 + int.from_bytes(content[12:16], "little") :]
    sizes = struct.pack("<III", 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    path.write_bytes(content[:8] + sizes + text + rest)


def save_lines(path: Path, lines: Any) -> None:
    lines = lines if isinstance(lines, list) else [lines]
    path.write_text("\n".join(" ".join(map(str, words)) if isinstance(words, list) else str(words) for words in lines))


def tensors(value: Any) -> Any:
    """The value with lists in the place of arrays that torch has no type for, and nothing for objects of classes."""
    if isinstance(value, dict):
        return {key: tensors(item) for key, item in value.items()}
    if isinstance(value, list):
        return [tensors(item) for item in value]
    if isinstance(value, np.ndarray):
        return value if value.dtype.name in STORAGE_OF else value.tolist()
    return value if isinstance(value, str | int | float) else None


VALUES: dict[str, tuple[Callable[[Path], Any], Callable[[Path, Any], object]]] = {
    ".npz": (npz_values, save_npz),
    ".npy": (
        np.load,
        lambda path, value: np.save(path, value if isinstance(value, np.ndarray) else np.array(str(value))),
    ),
    ".json": (lambda path: json.loads(path.read_text()), lambda path, it: path.write_text(json.dumps(it, default=str))),
    ".pkl": (lambda path: parse_pickle(path.read_bytes(), path), lambda path, it: path.write_bytes(pickle.dumps(it))),
    ".pt": (
        lambda path: parse_torch(path.read_bytes(), path),
        lambda path, value: path.write_bytes(torch_bytes(tensors(value))),
    ),
    ".p": (lambda path: read_joblib(path)[0], lambda path, value: path.write_bytes(joblib_bytes(value))),
    ".glb": (glb_values, save_glb),
    ".bvh": (lambda path: [line.split(" ") for line in path.read_text().splitlines()], save_lines),
}
"""Ending of a file -> returns its values, and writes others."""
VALUES[".pth"] = VALUES[".pt"]
NUDGES = st.floats(-1e-4, 1e-4)
JUNK = (
    None,
    True,
    "",
    "x",
    "../x",
    "VEC3",
    -1,
    0,
    3,
    10**9,
    2.5,
    [],
    {},
    [None],
    ["a/b", 3],
    {"a": 1},
    np.zeros((0, 3)),
)


Draw = Callable[[st.SearchStrategy], Any]


def inside(value: dict | list, draw: Draw, change: Callable[[Any, Draw], Any]) -> dict | list:
    """A copy of a table with one of its values changed."""
    value = value.copy()
    place = draw(st.sampled_from(list(value) if isinstance(value, dict) else range(len(value))))
    value[place] = change(value[place], draw)
    return value


def nudged(value: Any, draw: Draw) -> Any:
    """A value with one number changed a little, where it has numbers."""
    if isinstance(value, dict | list) and value:
        return inside(value, draw, nudged)
    if isinstance(value, np.ndarray) and value.size and value.dtype.kind == "f":
        value = value.copy()
        value.flat[draw(st.integers(0, value.size - 1))] += draw(NUDGES)
        return value
    with suppress(ValueError, TypeError):
        return type(value)(float(value) + draw(NUDGES))
    return value


def spoiled(value: Any, draw: Draw) -> Any:
    """A value with one place dropped, cut, reshaped, of other numbers, or of another kind."""
    if isinstance(value, dict | list) and value and draw(st.integers(0, 9)):
        return inside(value, draw, spoiled)
    kind = draw(st.sampled_from(["junk", "drop", "cut", "shape", "number", "numbers"]))
    if isinstance(value, dict) and value and kind == "drop":
        absent = draw(st.sampled_from(list(value)))
        return {key: item for key, item in value.items() if key != absent}
    if not isinstance(value, np.ndarray) or value.size == 0 or kind in ("junk", "drop"):
        return draw(st.sampled_from(JUNK))
    if kind == "cut":
        return np.atleast_1d(value)[: draw(st.integers(0, 8))]
    if kind == "shape" or value.dtype.kind not in "fiu":
        return draw(st.sampled_from([value[None], value.reshape(-1), value.T, value[..., None]]))
    value = value.astype(float)
    value.flat[draw(st.integers(0, value.size - 1)) if kind == "number" else slice(None, None, 7)] = draw(st.floats())
    return value


@pytest.mark.slow
@pytest.mark.parametrize("kind", FORMATS)
def test_whatever_is_in_the_files_only_our_errors_come(tmp_path, kind):
    for folder, recording in recordings(kind, tmp_path):
        paths = [path for path in sorted(folder.rglob("*")) if path.suffix in VALUES and "models" not in path.parts]
        whole = {path: (path.read_bytes(), VALUES[path.suffix][0](path)) for path in paths}
        others = [partial(task, recording.path) for task in (read_clip, outline_of, clips_in)]
        with both_outcomes(HoiRetargetError, str(folder), recording.path.stem, "object", "person") as attempt:
            spoil_and_read(whole, attempt, recording.read, others)


def spoil_and_read(whole: dict[Path, Any], attempt: Any, read: Callable[[], Clip], others: list[Any]) -> None:
    """Read recordings with places changed in one of their files."""

    @settings(derandomize=True, deadline=None, max_examples=50, database=None)
    @given(st.data())
    def examples(data: st.DataObject) -> None:
        path = data.draw(st.sampled_from(list(whole)))
        (content, values), change = whole[path], data.draw(st.sampled_from([nudged, spoiled]))
        for _ in range(data.draw(st.sampled_from([1, 1, 1, 2, 3]))):
            values = change(values, data.draw)
        try:
            VALUES[path.suffix][1](path, values)
            attempt(read)
            with suppress(HoiRetargetError):
                data.draw(st.sampled_from(others))()
        finally:
            path.write_bytes(content)

    examples()


def outline_of(path: Path) -> Outline:
    file = SourceFile(path)
    return reader_of(file).outline(file)
