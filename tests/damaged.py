"""Damages results and motions in the ways in which files are damaged, and asks every verb what it makes of them."""

import contextlib
import io
import json
import pickle
import shutil
import time
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import motion_writers
import synthetic
from export_motions import smooth_motion
from hoi_retarget.cli import main, pages
from hoi_retarget.motion.formats import WRITABLE
from hoi_retarget.motion.motion_report import Event
from hoi_retarget.motion.result_file import encode
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget

SLOWEST_S = 30.0
FRAMES = 50
RESULTS = ("retargeted", "random")
KINDS = (*RESULTS, *RESULTS, *motion_writers.MAKERS)  # Results twice as often.
NUMBERS = (
    *(np.nan, np.inf, -np.inf, 1e300, -1e300, 1e30, 1e9, 1e5, 999.0, 100.0),
    *(7.0, 3.0, 1.0, 0.5, -1.0, 0.0, 1e-3, 1e-9, 5e-324),
)
TEXTS = ("", "x" * 10_000, "../../x", "/etc/passwd", "a\nb", "\x1b[31m", "\ud800", "NaN", "<b>", "unitree_g9", "-1")
VALUES = (*NUMBERS[3:], *TEXTS, None, True, [], {}, [[]], [1] * 50, 10**400, 2**63, -(2**63), {"a": {"b": 1}})
DTYPES = ("f2", "f4", ">f8", "i1", "i8", "u8", "?", "c16", "U5", "S5", "O", "M8[s]", "f8,f8")
BOMB = 400 << 20

Content = dict[str, Any]


@cache
def sound(kind: str) -> Content:
    """Return the content of a file that nothing is wrong with."""
    if kind in motion_writers.MAKERS:
        return _cut(motion_writers.MAKERS[kind](motion_writers.motion()), motion_writers.motion().frames)
    model = motion_writers.model()
    if kind == "random":
        return dict(np.load(io.BytesIO(encode(smooth_motion(model, objects=2)))))
    motion = retarget(synthetic.make("carry_box", seconds=1.5), model, Config())
    told = {
        "unreached_contacts": (Event("unreached_contact", 3, 9, 0.04, subject="left_palm", object="box", mean=0.03),),
        "orientation_flips": (Event("orientation_flip", 2, 5, 120.0, subject="left_palm"),),
    }
    return dict(np.load(io.BytesIO(encode(replace(motion, report=replace(motion.report, **told))))))


def _cut(value: Any, frames: int) -> Any:
    """Return content with fewer frames."""
    if isinstance(value, dict):
        return {name: _cut(item, frames) for name, item in value.items()}
    return value[:FRAMES].copy() if isinstance(value, np.ndarray) and value.shape[:1] == (frames,) else value


@dataclass(frozen=True)
class Damaged:
    """A file, and what was done to it."""

    path: Path
    done: str


def damaged(rng: np.random.Generator, folder: Path) -> Damaged:
    """Write a file with one thing wrong, or several."""
    kind = str(rng.choice(KINDS))
    content, done = dict(sound(kind)), []
    for _ in range(int(rng.choice([0, 0, 1, 1, 1, 1, 2]))):
        done.append(_pick(rng, _CONTENT)(rng, content))
    path = write(rng, kind, content, folder)
    if not done or rng.random() < 0.1:
        done.append(_pick(rng, _FILE)(rng, _file(rng, path)))
    return Damaged(path, f"{kind}: {'; '.join(done)}")


def _pick(rng: np.random.Generator, options: tuple) -> Any:
    return options[rng.integers(len(options))]


def write(rng: np.random.Generator, kind: str, content: Content, folder: Path) -> Path:
    """Write content as its kind of files has it, as far as it can be; return what to read."""
    if "table" in content:
        return _write_table(content, folder / "motion.csv")
    if kind in ("gmr", "sbto", "asap"):
        path = folder / "motion.pkl"
        path.write_bytes(pickle.dumps(content, protocol=int(rng.integers(2, 6))))
        return path
    try:
        path = motion_writers.save(kind, content, folder)
    except Exception:  # noqa: BLE001 - some damage no file of that kind can hold
        path = motion_writers.save(kind, sound(kind), folder)
        _flip(rng, _file(rng, path))
    if path.suffix == ".npz" and rng.random() < 0.2:
        np.savez_compressed(path, **content)
    return path


def _write_table(content: Content, path: Path) -> Path:
    names = content.get("header", "")
    header = names if isinstance(names, str) else ",".join(map(str, np.atleast_1d(np.array(names, dtype=object))))
    rows = (",".join(map(str, np.atleast_1d(row).ravel().tolist())) for row in np.atleast_1d(content["table"]))
    path.write_bytes("\n".join((*([header] if header else []), *rows)).encode("utf-8", "replace"))
    return path


def _file(rng: np.random.Generator, path: Path) -> Path:
    """Return a file itself, or one of those in a folder."""
    return _pick(rng, tuple(sorted(file for file in path.iterdir() if file.is_file()))) if path.is_dir() else path


# What is done to the content


def _leaf(rng: np.random.Generator, content: Any) -> tuple[Any, Any]:
    """Return a container and the key of one thing in it, at any depth."""
    while True:
        keys = list(content) if isinstance(content, dict) else range(len(content))
        key = _pick(rng, tuple(keys))
        inner = content[key]
        if not (isinstance(inner, dict | list) and inner) or rng.random() < 0.1:
            return content, key
        # What is changed is the test's own copy.
        content[key] = inner = dict(inner) if isinstance(inner, dict) else list(inner)
        content = inner


def _array(rng: np.random.Generator, content: Content) -> tuple[Any, Any, np.ndarray]:
    for _ in range(20):
        owner, key = _leaf(rng, content)
        if isinstance(owner[key], np.ndarray):
            return owner, key, owner[key]
    content["more"] = np.zeros(3)
    return content, "more", content["more"]


def _numbers(rng: np.random.Generator, content: Content) -> str:
    owner, key, array = _array(rng, content)
    if array.dtype.kind not in "fiub" or array.size == 0:
        return _names(rng, content)
    value = float(_pick(rng, NUMBERS))
    with np.errstate(all="ignore"):
        array = array.copy() if rng.random() < 0.5 or not np.isfinite(value) else array.astype(float)
        if array.dtype.kind != "f":
            array = array.astype(float) if not np.isfinite(value) or abs(value) > 1e9 else array
        flat = array.reshape(-1)
        where = {
            "one": rng.integers(0, flat.size, 1),
            "some": rng.integers(0, flat.size, 5),
            "row": slice(0, array[0].size if array.ndim else 1),
            "column": slice(int(rng.integers(array.shape[-1] if array.ndim else 1)), None, array.shape[-1] or 1)
            if array.ndim
            else slice(None),
            "all": slice(None),
        }
        how = str(rng.choice([*where, "times"]))
        if how == "times":
            flat[:] = flat * value
        else:
            flat[where[how]] = value
    owner[key] = array
    return f"{key} {how} {value:g}"


def _shape(rng: np.random.Generator, content: Content) -> str:
    owner, key, array = _array(rng, content)
    changes: dict[str, Callable[[], np.ndarray]] = {
        "turned": lambda: array.T,
        "flat": lambda: array.reshape(-1),
        "inside": lambda: array[None],
        "columns of one": lambda: array[..., None],
        "first half": lambda: np.atleast_1d(array)[: len(np.atleast_1d(array)) // 2],
        "without the last column": lambda: np.atleast_1d(array)[..., :-1],
        "empty": lambda: np.atleast_1d(array)[:0],
        "twice": lambda: np.concatenate([np.atleast_1d(array)] * 2),
        "wider": lambda: np.concatenate([np.atleast_1d(array)] * 2, axis=-1),
        "one": lambda: np.asarray(array.reshape(-1)[0] if array.size else 0),
    }
    how = str(rng.choice(list(changes)))
    owner[key] = changes[how]()
    return f"{key} {how}"


def _frames(rng: np.random.Generator, content: Content) -> str:
    """Cut all arrays over time to few frames alike."""
    frames = int(rng.integers(0, 5))
    lengths = [len(value) for value in content.values() if isinstance(value, np.ndarray) and value.ndim > 1]
    for key, value in content.items():
        if isinstance(value, np.ndarray) and value.ndim and lengths and len(value) == max(lengths):
            content[key] = value[:frames]
    return f"{frames} frames"


def _dtype(rng: np.random.Generator, content: Content) -> str:
    owner, key, array = _array(rng, content)
    kind = _pick(rng, DTYPES)
    try:
        with np.errstate(all="ignore"):
            owner[key] = array.astype(kind)
    except (ValueError, TypeError, OverflowError):
        owner[key] = np.zeros(array.shape, kind)
    return f"{key} as {kind}"


def _drop(rng: np.random.Generator, content: Content) -> str:
    key = _pick(rng, tuple(content))
    del content[key]
    if not content:
        content["nothing"] = np.zeros(0)
    return f"without {key}"


def _swap(rng: np.random.Generator, content: Content) -> str:
    one, other = _pick(rng, tuple(content)), _pick(rng, tuple(content))
    content[one], content[other] = content[other], content[one]
    return f"{one} and {other} exchanged"


def _names(rng: np.random.Generator, content: Content) -> str:
    texts = [key for key, value in content.items() if isinstance(value, np.ndarray) and value.dtype.kind == "U"]
    text = _pick(rng, TEXTS)
    if not texts:
        content[_pick(rng, tuple(content))] = np.array(text, dtype=object if "\ud800" in text else None)
        return f"text {text[:20]!r}"
    key = _pick(rng, tuple(texts))
    array = content[key].astype(f"U{max(20, len(text))}")
    if array.size:
        array.reshape(-1)[rng.integers(array.size)] = text if "\ud800" not in text else "\udcff"
    content[key] = array
    return f"a name of {key} {text[:20]!r}"


def _value(rng: np.random.Generator, content: Content) -> str:
    owner, key = _leaf(rng, content)
    value = _pick(rng, VALUES)
    if owner is content and isinstance(owner[key], np.ndarray):
        value = np.array(value, dtype=object) if isinstance(value, dict | int) else np.asarray(value)
    owner[key] = value
    return f"{key} = {str(value)[:20]!r}"


def _report(rng: np.random.Generator, content: Content) -> str:
    """Change something in a result's report."""
    if "report" not in content:
        return _value(rng, content)
    try:
        report = json.loads(str(content["report"]))
    except ValueError:
        return "no report"
    owner, key = _leaf(rng, report)
    how = str(rng.choice(["value", "value", "value", "drop", "text"]))
    value = _pick(rng, VALUES)
    if how == "drop" and isinstance(owner, dict):
        del owner[key]
    else:
        owner[key] = value
    text = json.dumps(report)
    if how == "text":
        text = text.replace("0.", _pick(rng, ("1e400 ", "-", "00", "[" * 3000, "9" * 5000)), 1)
    content["report"] = np.array(text)
    return f"report {key} {how} {str(value)[:20]!r}"


def _scalars(rng: np.random.Generator, content: Content) -> str:
    keys = [key for key in ("fps", "human_height", "first_source_frame", "schema", "object_scale") if key in content]
    if not keys:
        return _numbers(rng, content)
    key, value = _pick(rng, tuple(keys)), _pick(rng, NUMBERS)
    whole = np.isfinite(value) and float(value).is_integer() and abs(value) < 1e10
    content[key] = np.full(np.shape(content[key]), int(value) if whole and rng.random() < 0.7 else value)
    return f"{key} = {value:g}"


_CONTENT = (*[_numbers] * 3, *[_report] * 4, _scalars, _shape, _frames, _dtype, _drop, _swap, _names, _value)


# What is done to the file


def _flip(rng: np.random.Generator, path: Path) -> str:
    data = bytearray(path.read_bytes())
    places = rng.integers(0, max(1, len(data)), int(rng.integers(1, 9))) if data else []
    for place in places:
        data[place] = int(rng.integers(256))
    path.write_bytes(bytes(data))
    return f"bytes {[int(place) for place in places]}"


def _cut_off(rng: np.random.Generator, path: Path) -> str:
    data = path.read_bytes()
    size = int(rng.integers(len(data) + 1))
    path.write_bytes(data[:size])
    return f"{size} of {len(data)} bytes"


def _more_bytes(rng: np.random.Generator, path: Path) -> str:
    data = path.read_bytes()
    path.write_bytes(data + rng.bytes(int(rng.integers(1, 5000))))
    return "more bytes"


def _hole(rng: np.random.Generator, path: Path) -> str:
    data = bytearray(path.read_bytes())
    start = int(rng.integers(len(data) + 1))
    stop = min(len(data), start + int(rng.integers(1, 4096)))
    data[start:stop] = bytes(stop - start)
    path.write_bytes(bytes(data))
    return f"zeros from {start} to {stop}"


def _member(rng: np.random.Generator, path: Path) -> str:
    """Change the bytes of one array, with a checksum that fits."""
    try:
        with zipfile.ZipFile(path) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
    except zipfile.BadZipFile:
        return _flip(rng, path)
    name = _pick(rng, tuple(members))
    data = bytearray(members[name])
    how = str(rng.choice(["header", "bytes", "cut", "surplus", "bomb", "twice", "outside"]))
    if how in ("header", "bytes"):
        data[rng.integers(min(len(data), 120) if how == "header" else len(data))] = int(rng.integers(256))
    elif how == "cut":
        del data[rng.integers(len(data)) :]
    elif how == "surplus":
        data += rng.bytes(int(rng.integers(1, 2000)))
    elif how == "bomb":
        data += bytes(BOMB)
    members[name] = bytes(data)
    if how == "outside":
        members["../outside.npy"] = members[name]
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED if how == "bomb" else zipfile.ZIP_STORED) as archive:
        for key, member in members.items():
            archive.writestr(key, member)
        if how == "twice":
            with contextlib.suppress(UserWarning):
                archive.writestr(name, members[name])
    return f"{name} {how}"


def _nothing(_rng: np.random.Generator, path: Path) -> str:
    path.write_bytes(b"")
    return "empty"


_FILE = (_flip, _flip, _cut_off, _more_bytes, _hole, _member, _member, _member, _member, _nothing)


# What verbs make of it


@dataclass(frozen=True)
class Outcome:
    """What became of one verb."""

    verb: str
    code: int
    said: str
    """Errors and warnings."""
    seconds: float


def words_for(file: Path, out: Path, to: str) -> list[list[str]]:
    """Return the words of every verb that takes a result, a motion, or whatever its name may be taken for."""
    return [
        ["inspect", f"{file}"],
        ["evaluate", f"{file}", "--json", f"{out}/figures.json", "--csv", f"{out}/figures.csv"],
        ["report", f"{file}", "--out", f"{out}/report"],
        ["export", f"{file}", "--to", to, "--out", f"{out}/exported"],
        ["check-motion", f"{file}", "--json", f"{out}/checked.json"],
        ["convert", f"{file}", "--out", f"{out}/clip.npz"],
        ["share", f"{file}", "--out", f"{out}/gallery"],
        ["view", f"{file}"],
        ["edit", f"{file}", "--out", f"{out}/edited", "--edits", f"{out}/edits.toml"],
        ["run", "builtin:none", "--config", f"{file}", "--out", f"{out}/run"],
    ]


def outcomes(file: Path, out: Path, to: str) -> Iterator[Outcome]:
    """Yield what each verb makes of a file, in this process; whatever a verb raises passes through.

    Pages are made, and served to nobody: `serving_nobody` must be in force.
    """
    for words in words_for(file, out, to):
        start = time.monotonic()
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as complaints:
            code = main(words)
        yield Outcome(words[0], code, complaints.getvalue(), time.monotonic() - start)


@contextlib.contextmanager
def serving_nobody() -> Iterator[None]:
    """Let `view` and `edit` make their pages and go."""
    before = pages._wait_for_interrupt
    pages._wait_for_interrupt = lambda *_: None
    try:
        yield
    finally:
        pages._wait_for_interrupt = before


def check(file: Damaged, out: Path, rng: np.random.Generator) -> list[Outcome]:
    """Ask every verb, and check what holds for all of them; return what became of it."""
    out.mkdir()
    found = list(outcomes(file.path, out, str(rng.choice(list(WRITABLE)))))
    for outcome in found:
        assert outcome.code in (0, 1, 2), (file.done, outcome)
        assert outcome.seconds < SLOWEST_S, (file.done, outcome)
        # These two tell what is wrong with a file as what they found.
        told = outcome.code == 0 or outcome.verb in ("inspect", "check-motion") or "error: " in outcome.said
        assert told and "Traceback" not in outcome.said, (file.done, outcome)
    left = [path for path in out.rglob(".*") if path != out]
    assert not left, f"{file.done}: left behind {left}"
    shutil.rmtree(out)
    return found
