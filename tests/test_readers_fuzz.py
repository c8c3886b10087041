"""Damaged files of every source: a clip or one error that names a file, and never anything else."""

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.readers import READERS, read_clip

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
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


@pytest.fixture(scope="module")
def sources():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        return importlib.import_module("sources").SOURCES


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


@pytest.mark.slow
@pytest.mark.parametrize("kind", READERS)
def test_a_damaged_file_is_read_or_refused(tmp_path, sources, kind):
    for name in [name for name in sources if name.startswith(kind)]:
        folder = tmp_path / name
        folder.mkdir()
        recording = sources[name](folder, FRAMES)
        options = {"objects": recording.objects, "body_models": recording.body_models}
        whole, refused, alike = read_clip(recording.path, ReadOptions(**options)), 0, 0
        for damage in damaged_files(folder):
            try:
                clip = read_clip(recording.path, ReadOptions(**options))
            except HoiRetargetError as error:
                refused += 1
                assert str(folder) in str(error)
            else:
                alike += moves_alike(clip, whole)
                assert moves_alike(clip, whole) or damage is not truncated, "a part must not pass for the whole"
        # Nothing tells a changed digit of text from another one.
        assert refused and (alike or kind == "bvh")
