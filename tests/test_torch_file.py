"""The restricted reader of torch's files: what it reads, and everything that it refuses."""

import io
import os
import pickle
import subprocess
import zipfile
from collections import OrderedDict
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.errors import ReadError
from hoi_retarget.files.reading import read_bytes
from hoi_retarget.files.safe_pickle import MAX_DEPTH
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.files.torch_file import parse_torch
from torch_writer import STORAGE_OF, Call, Storage, Tensor, archive, legacy_bytes, torch_bytes, torch_entries

BOUNDED = settings(derandomize=True, deadline=None, max_examples=80, database=None)
NAME = Path("clip.pt")
SHARED = Path(__file__).resolve().parents[1].parent / "shared"


def refused(content: bytes, *words: str) -> str:
    """Check that the content is refused with a message that names the file and these words."""
    with pytest.raises(ReadError) as caught:
        parse_torch(content, NAME)
    message = str(caught.value)
    assert message.startswith("clip.pt: ")
    for word in words:
        assert word in message, message
    return message


def same(a: object, b: object) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if isinstance(a, dict) and isinstance(b, dict):
        return list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    if isinstance(a, list | tuple):
        return type(a) is type(b) and len(a) == len(b) and all(map(same, a, b))  # type: ignore[arg-type]
    return type(a) is type(b) and a == b


# What is read

TENSORS = st.builds(
    lambda dtype, shape, seed: np.asarray(np.random.default_rng(seed).integers(-3, 99, shape)).astype(dtype),
    st.sampled_from(sorted(STORAGE_OF)),
    st.lists(st.integers(0, 5), max_size=4),
    st.integers(0, 1000),
)
SCALARS = st.one_of(
    st.none(), st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False), st.text(max_size=20)
)
VALUES = st.recursive(
    TENSORS | SCALARS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.lists(inner, max_size=4).map(tuple),
        st.dictionaries(st.text(max_size=5) | st.integers(0, 300), inner, max_size=4),
    ),
    max_leaves=8,
)


@BOUNDED
@given(VALUES, st.sampled_from(["little", "big"]), st.sampled_from([2, 3, 4, 5]))
def test_what_is_written_is_read(value, byte_order, protocol):
    assert same(parse_torch(torch_bytes(value, byte_order, protocol), NAME), value)
    assert same(parse_torch(legacy_bytes(value, byte_order), NAME), value)


@BOUNDED
@given(st.data())
def test_views_follow_offset_size_and_stride(data):
    elements = np.arange(60, dtype=data.draw(st.sampled_from(["float32", "int64", "uint8", "float16"])))
    base = elements.reshape(3, 4, 5).transpose(data.draw(st.permutations(range(3))))
    for axis in range(3):
        start = data.draw(st.integers(0, base.shape[axis]))
        base = np.moveaxis(np.moveaxis(base, axis, 0)[start :: data.draw(st.integers(1, 3))], 0, axis)
    if data.draw(st.booleans()):
        base = np.broadcast_to(base, (2, *base.shape))
    address = base.__array_interface__["data"][0] - elements.__array_interface__["data"][0]
    offset = address // elements.itemsize if base.size else 0
    stride = tuple(step // elements.itemsize for step in base.strides)
    tensor = Tensor(Storage(elements), offset, base.shape, stride)
    for content in (torch_bytes(tensor), legacy_bytes(tensor)):
        read = parse_torch(content, NAME)
        assert read.dtype == elements.dtype
        assert np.array_equal(read, base)


def test_arrays_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        parse_torch(torch_bytes(np.zeros(3)), NAME)[0] = 1.0


def test_bfloat16_becomes_float32():
    values = np.array([1.0, -2.5, 0.0, 3e38, np.inf], dtype=np.float32)
    upper = Storage((values.view(np.uint32) >> 16).astype(np.uint16), kind="BFloat16Storage")
    read = parse_torch(torch_bytes(Tensor(upper, 0, (5,), (1,))), NAME)
    assert read.dtype == np.float32
    assert np.allclose(read[:3], values[:3])
    assert read[4] == np.inf


def test_any_byte_of_a_bool_is_true_or_false():
    storage = Storage(np.array([0, 1, 2, 255], dtype=np.uint8), kind="BoolStorage")
    assert parse_torch(torch_bytes(Tensor(storage, 0, (4,), (1,))), NAME).tolist() == [False, True, True, True]


def test_ordered_dictionaries_shared_values_and_shared_storages():
    storage, shared = Storage(np.arange(6.0)), [1, 2]
    value = OrderedDict(
        a=Tensor(storage, 0, (3,), (1,)), b=Tensor(storage, 3, (3,), (1,)), c=shared, d=shared, long=list(range(2500))
    )
    for content in (torch_bytes(value), legacy_bytes(value)):
        read = parse_torch(content, NAME)
        assert list(read) == ["a", "b", "c", "d", "long"]
        assert read["b"].tolist() == [3.0, 4.0, 5.0]
        assert read["c"] is read["d"]
        assert read["long"] == value["long"]


def test_attributes_of_a_state_dictionary_are_left_out():
    value = OrderedDict(weight=np.ones(2))
    value._metadata = OrderedDict(version=1)  # type: ignore[attr-defined]
    assert list(parse_torch(torch_bytes(value), NAME)) == ["weight"]


# What is refused


def test_code_is_refused_by_name_and_not_executed(tmp_path):
    target = tmp_path / "executed"
    attack = Call(os.system, (f"touch {target}",))
    for value in (attack, [attack], {"data": np.zeros(3), "x": (attack,)}):
        for content in (torch_bytes(value), torch_bytes(value, protocol=4), legacy_bytes(value)):
            refused(content, f"{os.system.__module__}.system", "refused")
    refused(torch_bytes(Call(eval, ("1",))), "eval")
    refused(torch_bytes(Call(subprocess.Popen, (["true"],))), ".Popen")
    assert not target.exists()


@pytest.mark.parametrize(
    ("program", "words"),
    [
        (b"ios\nsystem\n.", "os.system"),  # an instance by protocol 0
        (b"cos\nsystem\n.", "os.system"),
        (b"\x8c\x02os\x8c\x06system\x93.", "os.system"),
        (b"c\xff\xfe\nx\n.", "import"),
        (b"N\x8c\x06system\x93.", "damaged"),
        (b"ctorch\nFloatStorage\n.", "name"),
        (b"](ctorch\nFloatStorage\n\x85e.", "name of a function"),
        (b"ctorch._utils\n_rebuild_tensor_v2\n(t}b.", "not an open container"),
        (b"ctorch._utils\n_rebuild_tensor_v2\n(tR.", "offset, size and stride"),
        (b"ctorch._utils\n_rebuild_parameter\n(K\x01tR.", "not a tensor"),
        (b"ccollections\nOrderedDict\n](K\x01K\x02e\x85R.", "OrderedDict"),
        (b"ctorch\nSize\n(K\x01tR.", "torch.Size"),
        (b"itorch\nFloatStorage\n.", "instance"),
        (b"K\x01)R.", "not a function"),
        (b"K\x01Q.", "not a tensor's storage"),
        (b"(ctorch\nFloatStorage\nQ.", "not a tensor's storage"),
        (b"0.", "not there"),
        (b"(K\x01(0.", "not there"),
        (b"e.", "not opened"),
        (b".", "not there"),
        (b"h\x07.", "not built"),
        (b"r\xff\xff\xff\xff.", "not there"),
        (b"Nj\xff\xff\xff\xff.", "not built"),
        (b"X\xff\xff\xff\xffabc.", "cut off"),
        (b"\x8d\xff\xff\xff\xff\xff\xff\xff\x7fabc.", "cut off"),
        (b"X\x01\x00\x00\x00\xff.", "UTF-8"),
        (b"\x8a\xff" + b"\x01" * 255 + b".", "at most 16"),
        (b"cos", "cut off"),
        (b"\x82\x01.", "EXT1"),
        (b"Px\n.", "PERSID"),
        (b"(cos\nsystem\nN\x6f.", "os.system"),
        (b"(ctorch\nFloatStorage\no.", "OBJ"),
        (b"ctorch\nFloatStorage\n)}\x92.", "NEWOBJ_EX"),
        (b"ctorch\nFloatStorage\n}\x8c\x04nameK\x01sb.", "not an open container"),
        (b"ctorch\nFloatStorage\nNa.", "not an open container"),
        (b"X\x01\x00\x00\x00aN(K\x01e.", "not an open container"),
        (b"\x96\xff\xff\xff\xff\xff\xff\xff\x7f.", "cut off"),
        (b"\x8e\xff\xff\xff\xff\xff\xff\x00\x00.", "cut off"),
        (b"\x95\xff\xff\xff\xff\xff\xff\xff\xff", "cut off"),
        (b"X\x03\x00\x00\x00\xed\xa0\x80.", "UTF-8"),
        (b"\xfe.", "no operation"),
        (b"]q\x00h\x00a.", "contains itself"),
        (b"}q\x00K\x01h\x00s.", "contains itself"),
        (b"]q\x00\x85q\x010h\x00h\x01a.", "endless"),
        (b"}(K\x01u.", "no value"),
        (b"})\x85K\x02s.", "key is a tuple"),
        (b"})K\x01s.", "key is a tuple"),
        (b"}]K\x01s.", "key is a list"),
        (b"}\x8a\x09" + b"\x01" * 9 + b"Ns.", "more than 63 bits"),
        (b"N" + b"\x85" * 100_000 + b".", "nested"),
        (b"]" * 3 + b"aa" + b"]" * 70 + b"a" * 70 + b".", "nested"),
        (b"", "cut off"),
    ],
)
def test_programs_that_torch_does_not_write_are_refused(program, words):
    refused(archive({"clip/data.pkl": b"\x80\x02" + program}), words)


def test_deep_values_are_read_up_to_the_limit():
    value: list = []
    for _ in range(MAX_DEPTH - 1):
        value = [value]
    assert same(parse_torch(torch_bytes(value), NAME), value)
    refused(torch_bytes([value]), "nested more than 64 deep")


@pytest.mark.parametrize(
    ("offset", "size", "stride", "words"),
    [
        (0, (11,), (1,), "reaches element 10"),
        (1, (10,), (1,), "reaches element 10"),
        (0, (2, 5), (6, 1), "reaches element 10"),
        (0, (2,), (1 << 40,), "reaches element"),
        (0, (1 << 40,), (0,), "claims"),
        (0, (1 << 20, 1 << 20), (0, 0), "claims"),
        (0, (0, 1 << 47, 1 << 47), (0, 0, 0), "claims"),
        (-1, (1,), (1,), "offset, size or stride"),
        (0, (-1,), (1,), "offset, size or stride"),
        (9, (2,), (-1,), "offset, size or stride"),
        (0, (1 << 100,), (1,), "offset, size or stride"),
        (0, (2,), (1, 1), "offset, size or stride"),
        (0, (1,) * 40, (1,) * 40, "offset, size or stride"),
        (0, [2], [1], "offset, size or stride"),
        (0, (2.0,), (1,), "offset, size or stride"),
        ("0", (2,), (1,), "offset, size or stride"),
    ],
)
def test_views_outside_of_their_storage_are_refused(offset, size, stride, words):
    tensor = Tensor(Storage(np.arange(10.0)), offset, size, stride)
    refused(torch_bytes(tensor), words)
    refused(legacy_bytes(tensor), words)


def test_expansion_is_bounded_over_the_whole_file():
    storage = Storage(np.arange(1.0))
    tensor = Tensor(storage, 0, (1 << 20,), (0,))
    assert parse_torch(torch_bytes(tensor), NAME).shape == (1 << 20,)
    refused(torch_bytes([Tensor(storage, 0, (1 << 20,), (0,)) for _ in range(2)]), "beyond those stored")


def test_storages_are_checked_against_the_bytes_that_exist():
    tensor = Tensor(Storage(np.arange(4.0), count=1 << 45), 0, (1,), (1,))
    refused(torch_bytes(tensor), "archive has 32 bytes")
    refused(legacy_bytes(tensor), "states 4")
    entries = torch_entries(np.arange(4.0))
    del entries["clip/data/0"]
    refused(archive(entries), "storage '0' is not in the archive")
    refused(legacy_bytes(np.arange(4.0))[:-1], "bytes follow")
    storage = np.arange(4.0)
    twice = [Tensor(Storage(storage), 0, (1,), (1,)), Tensor(Storage(storage, count=2), 0, (1,), (1,))]
    entries = torch_entries(twice)
    entries["clip/data.pkl"] = entries["clip/data.pkl"].replace(b"X\x01\x00\x00\x001", b"X\x01\x00\x00\x000")
    refused(archive(entries), "disagree about storage '0'")


def test_archives_that_torch_does_not_write_are_refused():
    entries = torch_entries(np.arange(4.0))
    refused(archive(entries, zipfile.ZIP_DEFLATED), "compressed")
    refused(archive({**entries, "../evil": b"x"}), "outside of the archive")
    refused(archive({**entries, "/evil": b"x"}), "outside of the archive")
    refused(archive({**entries, "clip/..\\evil": b"x"}), "outside of the archive")
    refused(archive({**entries, "other/data.pkl": b"x"}), "exactly one NAME/data.pkl, found 2")
    refused(archive({"readme.txt": b"x"}), "not one of torch", "readme.txt")
    refused(archive({}), "not one of torch")
    refused(archive({**entries, "clip/byteorder": b"middle"}), "byte order", "middle")
    entries["clip/data.pkl"] = entries["clip/data.pkl"].replace(b"X\x01\x00\x00\x000", b"X\x04\x00\x00\x00../0")
    refused(archive(entries), "not in the archive")


def test_an_archive_with_an_entry_twice_is_refused():
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as target:
        target.writestr("clip/data.pkl", b"N.")
        with pytest.warns(UserWarning, match="Duplicate"):
            target.writestr("clip/data.pkl", b"K\x01.")
    refused(file.getvalue(), "twice")


def test_overlapping_entries_are_refused():
    # A small file whose directory names the same bytes many times.
    content = archive({"clip/data.pkl": b"N." * 500})
    end = content.rindex(b"PK\x05\x06")
    start = content.index(b"PK\x01\x02")
    record = content[start:end]
    names = [record.replace(b"clip/data.pkl", f"clip/data{index:04d}"[:13].encode()) for index in range(40)]
    directory = b"".join(names)
    tail = bytearray(content[end:])
    tail[8:12] = (40).to_bytes(2, "little") * 2
    tail[12:16] = len(directory).to_bytes(4, "little")
    refused(content[:start] + directory + bytes(tail))


def test_missing_empty_foreign_and_cut_files(tmp_path):
    with pytest.raises(ReadError, match="no such file"):
        read_bytes(tmp_path / "absent.pt")
    with pytest.raises(ReadError, match="folder"):
        read_bytes(tmp_path)
    with pytest.raises(ReadError, match=r"cannot be read|no such file"):
        read_bytes(Path("nul\0.pt"))
    refused(b"", "empty")
    refused(b"hello world", "not a torch file", "hello")
    refused(pickle.dumps({"a": 1}), "not a torch file")
    content = torch_bytes(np.arange(100.0))
    for length in range(1, len(content), 7):
        refused(content[:length])
    content = legacy_bytes(np.arange(10.0))
    for length in range(1, len(content), 7):
        refused(content[:length])


def test_a_changed_byte_in_a_storage_is_noticed():
    content = bytearray(torch_bytes(np.arange(100.0)))
    content[content.index(np.arange(100.0).tobytes()) + 11] ^= 0xFF
    refused(bytes(content), "damaged")


# Whatever the bytes

SEEDS = [
    writer({"data": np.arange(12.0, dtype=np.float32).reshape(3, 4), "objects": ["a", ("b", None)], "n": 1.5})
    for writer in (torch_bytes, legacy_bytes)
]
PROGRAM = torch_entries({"data": np.arange(12.0, dtype=np.float32), "objects": ["a", ("b", None)]})


def mutated(data: st.DataObject, content: bytes) -> bytes:
    changed = bytearray(content)
    for _ in range(data.draw(st.integers(1, 6))):
        position = data.draw(st.integers(0, max(0, len(changed) - 1)))
        match data.draw(st.sampled_from(["set", "insert", "delete", "cut", "repeat"])):
            case "set":
                changed[position : position + 1] = data.draw(st.binary(min_size=1, max_size=1))
            case "insert":
                changed[position:position] = data.draw(st.binary(max_size=8))
            case "delete":
                del changed[position : position + data.draw(st.integers(1, 9))]
            case "cut":
                del changed[position:]
            case "repeat":
                changed[position:position] = changed[position : position + 20]
    return bytes(changed)


def survives(content: bytes) -> None:
    """Read content of which only a `ReadError` may come."""
    try:
        parse_torch(content, NAME)
    except ReadError as error:
        assert len(str(error)) < 1000


@settings(BOUNDED, max_examples=400)
@given(st.data(), st.sampled_from(SEEDS))
def test_mutated_files_are_read_or_refused(data, seed):
    survives(mutated(data, seed))


@settings(BOUNDED, max_examples=400)
@given(st.data())
def test_mutated_pickles_in_sound_archives_are_read_or_refused(data):
    survives(archive({**PROGRAM, "clip/data.pkl": mutated(data, PROGRAM["clip/data.pkl"])}))


WORDS = [
    *(bytes([code]) for code in b"\x80\x95(0N\x88\x89KMJ\x8aGUTX\x8d\x8c)\x85\x86\x87t]ae}suqr\x94hjciRbQ.\x932lId"),
    b"ctorch._utils\n_rebuild_tensor_v2\n",
    b"ctorch\nFloatStorage\n",
    b"ccollections\nOrderedDict\n",
    b"X\x07\x00\x00\x00storageq\x01",
    b"K\x01",
    b"K\x00",
    b"X\x01\x00\x00\x000",
    b"\xff\xff\xff\xff",
]


@settings(BOUNDED, max_examples=400)
@given(st.lists(st.sampled_from(WORDS) | st.binary(max_size=3), max_size=40).map(b"".join))
def test_random_programs_are_read_or_refused(program):
    survives(archive({"clip/data.pkl": program, "clip/data/0": b"\0" * 16}))


@pytest.mark.skipif(not SHARED.is_dir(), reason=f"no shared data at {SHARED}")
def test_real_files_hold_their_tensors():
    clips = sorted((SHARED / "data" / "omomo").glob("*.pt"))
    assert len(clips) == 33
    for path in clips:
        assert SourceFile(path).torch.shape[1] == 591
    for path in (SHARED / "data" / "parahome").glob("*.pt"):
        content = SourceFile(path).torch
        assert content["data"].shape[1] == 721
        assert len(content["objects"]) == 3
