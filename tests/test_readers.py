"""All readers beside each other: every source's recordings are of exactly one, and of none when they are damaged."""

import pickle
import re
import shutil
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import cari4d_writer
from hoi_retarget.errors import HoiRetargetError, ReadError
from hoi_retarget.files import reading
from hoi_retarget.files.array_pickle import read_joblib
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.files.torch_file import parse_torch
from hoi_retarget.readers import can_be_clip, reader_of, readers, recordings_below
from joblib_writer import write_joblib
from recordings import WRITERS, Recording, format_of

FRAMES = 12


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
    monkeypatch.setattr(reading, "MAXIMUM_SIZE", 10_000)
    with pytest.raises(ReadError, match=r"would unpack to .* MB, expected at most 0.01"):
        recording.read()
