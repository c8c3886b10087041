"""All readers beside each other: every source's recordings are of exactly one, and of none when damaged."""

import io
import json
import pickle
import re
import shutil
import struct
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cari4d_writer
from hoi_retarget.cli import main
from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import HoiRetargetError, ReadError
from hoi_retarget.files import npz, reading
from hoi_retarget.files.array_pickle import parse_pickle, read_joblib
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.files.torch_file import parse_torch
from hoi_retarget.readers import can_be_clip, clips_in, read_clip, reader_of, readers, recordings_below
from hoi_retarget.readers.reader import Outline
from joblib_writer import joblib_bytes, write_joblib
from outcomes import both_outcomes
from recordings import WRITERS, Recording, format_of
from torch_writer import STORAGE_OF, torch_bytes

FORMATS = [reader.format for reader in readers()]
FRAMES = 15


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Callable[[str], tuple[Path, Recording]]:
    """The folder of a recording and what belongs to it, each written once; and the recording."""

    @lru_cache
    def of(kind: str) -> tuple[Path, Recording]:
        root = tmp_path_factory.mktemp("source")
        return root, WRITERS[kind](root, FRAMES)

    return of


@pytest.fixture
def copy(written, tmp_path):
    """Copies of recordings, to be changed."""

    def of(kind: str) -> Recording:
        root, recording = written(kind)
        shutil.copytree(root, tmp_path, dirs_exist_ok=True)
        return recording.below(root, tmp_path)

    return of


def holding(path: Path) -> list[str]:
    """All formats that take a recording; raises `ReadError` as they do."""
    file = SourceFile(path)
    return [reader.format for reader in readers(file.suffix) if reader.holds(file)]


def test_there_is_a_recording_of_every_format():
    assert {format_of(kind) for kind in WRITERS} == {reader.format for reader in readers()}


@pytest.mark.parametrize("kind", WRITERS)
def test_a_recording_is_held_by_its_reader_alone_and_read(written, kind):
    _, recording = written(kind)
    assert holding(recording.path) == [format_of(kind)] == [reader_of(SourceFile(recording.path)).format]
    assert recording.read().source.format == format_of(kind)
    assert can_be_clip(recording.path)


@pytest.mark.parametrize("kind", WRITERS)
def test_a_recording_is_found_in_its_tree_without_its_other_files(written, kind):
    root, recording = written(kind)
    found = recordings_below(root)
    assert recording.path in found
    models = recording.body_models or root / "models"
    assert not any(path.is_relative_to(models) or path.parent == recording.path for path in found)


@pytest.mark.parametrize("kind", WRITERS)
def test_a_file_of_something_else_is_held_by_nobody(copy, kind):
    recording = copy(kind)
    if recording.main:
        recording.main_file.unlink()
        assert holding(recording.path) == []
        with pytest.raises(ReadError, match=r"not the recording of one clip|looks like a recording of"):
            recording.read()
        return
    for content in (b"", b"no recording", b"\x80", b"PK\x03\x04", b"\x78\x9c\0", b"glTF"):
        recording.path.write_bytes(content)
        try:
            assert holding(recording.path) == []
        except ReadError as error:
            assert recording.path.name in str(error)
        with pytest.raises(HoiRetargetError, match=re.escape(recording.path.stem)):
            recording.read()


@pytest.mark.parametrize("kind", WRITERS)
def test_a_pointer_in_place_of_a_file_is_told(copy, kind):
    recording = copy(kind)
    recording.main_file.write_bytes(b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n")
    with pytest.raises(HoiRetargetError, match="git lfs pull"):
        recording.read()


@pytest.mark.parametrize("kind", WRITERS)
def test_a_file_that_is_cut_off_is_refused(copy, kind):
    recording = copy(kind)
    main = recording.main_file
    content = main.read_bytes()
    for keep in (0.0, 0.01, 0.5, 0.99):
        main.write_bytes(content[: int(keep * len(content))])
        with pytest.raises(HoiRetargetError, match=re.escape(recording.path.stem)):
            recording.read()


def nested(depth: int) -> list:
    value: list = []
    for _ in range(depth):
        value = [value]
    return value


def ring() -> list:
    value: list = []
    value.append([value])
    return value


class Touch:
    """Makes a file where a pickle of it is executed."""

    def __reduce__(self):
        return Path.touch, (Path("executed"),)


HOSTILE: dict[str, object] = {
    "text": "../../text",
    "nothing": None,
    "dictionary": {"../a/b": [1, "2"]},
    "ragged": [[1.0], [2.0, 3.0]],
    "nested": nested(100),
    "ring": ring(),
    "large": 10**400,
    "texts": np.array(["a", "b"] * 6),
    "empty": np.zeros((0, 3)),
    "flat": np.zeros((12, 0)),
    "not finite": np.full((12, 3), np.nan),
    "infinite": np.full((12, 156), np.inf),
    "complex": np.zeros(12, dtype=complex),
    "objects": np.array([None, "a"], dtype=object),
    "bytes": b"bytes",
    "executed": Touch(),
}
"""What no recording has in the place of its numbers."""
NO_TENSORS = ("texts", "complex", "objects")
"""Which of them torch cannot write."""
PLACES = {
    "core4d": (("person1_poses.npz", "arr_0"),),
    "cari4d": (("", "pose_abs"), ("", "frames"), ("", "betas")),
    "behave": (("smpl_fit_all.npz", "poses"), ("smpl_fit_all.npz", "frame_times"), ("object_fit_all.npz", "trans")),
    "intercap": (("", "body_pose"), ("", "ob_trans"), ("", "betas")),
    "grab": (("", "body"), ("", "object"), ("", "contact"), ("", "obj_name"), ("", "framerate"), ("", "n_comps")),
    "interact-canonical": (("human.npz", "poses"), ("human.npz", "gender"), ("object.npz", "name")),
    "hodome": (("", "frame_ids"), ("", "transl")),
    "imhd": (("", "smplShape"), ("", "objectRot")),
    "amass": (("", "trans"), ("", "poses"), ("", "betas"), ("", "gender"), ("", "mocap_framerate")),
    "omomo": (("", "trans"), ("", "rest_offsets"), ("", "seq_name"), ("", "obj_scale")),
    "parahome": (("joint_positions.pkl", ""), ("object_transformations.pkl", "3"), ("object_transformations.pkl", "")),
    "hoi-retarget-clip": (("", "joint_pos"), ("", "object_names"), ("", "contact_part")),
}
"""Format -> files and values in them; nothing for the whole file."""


def spoil(kind: str, path: Path, name: str, value: object) -> None:
    """Put a value in the place of another."""
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=True) as archive:
            arrays = dict(archive)
        boxed = np.empty((), dtype=object)
        boxed[()] = value
        arrays[name] = value if isinstance(value, np.ndarray) else boxed
        np.savez(path, **arrays)
    elif kind == "omomo":
        write_joblib(path, {0: read_joblib(path)[0][0] | {name: value}})
    elif kind == "cari4d":
        cari4d_writer.write(path, parse_torch(path.read_bytes(), path)["pr"] | {name: value})
    else:
        values = pickle.loads(path.read_bytes())
        key = int(name) if name.isdigit() else name
        path.write_bytes(pickle.dumps({**values, key: value} if name else value))


@pytest.mark.parametrize(("kind", "place"), [(kind, place) for kind, places in PLACES.items() for place in places])
def test_values_that_no_recording_has_are_our_errors(copy, kind, place, monkeypatch, tmp_path):
    recording = copy(kind)
    name, key = place
    file = recording.path / name
    content = file.read_bytes()
    monkeypatch.chdir(tmp_path)
    for what, value in HOSTILE.items():
        if kind == "cari4d" and what in NO_TENSORS:
            continue
        file.write_bytes(content)
        spoil(kind, file, key, value)
        with pytest.raises(HoiRetargetError):
            recording.read()
            pytest.fail(f"{what} is read")
    assert not Path("executed").exists()


@pytest.mark.parametrize(("kind", "name"), [("core4d", "object_metadata.json"), ("parahome", "text_annotation.json")])
def test_tables_that_are_none_are_our_errors(copy, kind, name):
    recording = copy(kind)
    for text in ("", "[]", "null", "3", '{"obj_name": 3}', '{"": ""}', "[" * 5000, "1" * 5000, "\0"):
        (recording.path / name).write_text(text)
        with pytest.raises(HoiRetargetError, match=name):
            recording.read()


def test_a_file_that_unpacks_to_more_than_memory_is_refused(copy, monkeypatch):
    recording = copy("behave")
    monkeypatch.setattr(reading, "limit_unpacked", lambda packed: 10_000)
    with pytest.raises(ReadError, match=r"would unpack to .* MB, expected at most 0.01"):
        recording.read()


def test_entries_that_nobody_wants_are_not_unpacked():
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("wanted.npy", b"wanted")
        archive.writestr("surplus.npy", b"surplus")
    members = npz.Members(buffer.getvalue().replace(b"surplus", b"damaged", 2).replace(b"damaged.npy", b"surplus.npy"))
    assert (set(members), members["wanted"]) == ({"wanted", "surplus"}, b"wanted")
    with pytest.raises(ValueError, match="damaged"):
        members["surplus"]


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


def save_words(path: Path, words: Any) -> None:
    path.write_text(" ".join(map(str, words)) if isinstance(words, list) else str(words))


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
    ".mvnx": (lambda path: path.read_text().split(" "), save_words),
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


@pytest.mark.parametrize(("name", "way"), [("take.C3D", "export it as BVH")])
def test_captures_that_are_not_read_are_refused_with_a_way_to_bvh(name, way, tmp_path, capsys):
    (tmp_path / name).write_bytes(b"\x02\x50" + bytes(510))
    for words in (["run", str(tmp_path / name), "--out", str(tmp_path / "out")], ["inspect", str(tmp_path / name)]):
        assert main(words) == 1
        assert way in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out").exists()
