"""Damaged results and motions: every verb ends in words, soon, in little memory, and leaves nothing half-written."""

import subprocess
import sys

import jaxtyping
import numpy as np
import pytest

import motion_writers
from damaged import KINDS, check, damaged, serving_nobody, sound, words_for, write
from hoi_retarget.motion.formats import WRITABLE
from hoi_retarget.studio.report.rows import read_row

MEMORY_MB = 500


@pytest.fixture
def without_checks_of_annotations():
    """Users' programs run without the checks of shapes that tests run with."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.mark.parametrize("count", [3, pytest.param(300, marks=pytest.mark.slow)])
@pytest.mark.usefixtures("without_checks_of_annotations")
def test_every_verb_ends_in_words(tmp_path, count):
    """`benchmarks/damage.py` does the same for thousands, and measures."""
    codes = set()
    with serving_nobody():
        for seed in range(count):
            rng = np.random.default_rng(seed)
            folder = tmp_path / str(seed)
            folder.mkdir()
            codes |= {outcome.code for outcome in check(damaged(rng, folder), tmp_path / "out", rng)}
    assert codes >= {0, 1}


@pytest.mark.parametrize("kind", sorted(set(KINDS)))
def test_without_damage_all_of_them_are_read(tmp_path, kind):
    path = write(np.random.default_rng(0), kind, dict(sound(kind)), tmp_path)
    assert read_row("file", path, motion_writers.model()).error == ""


@pytest.mark.slow
def test_whole_programs_end_in_words_and_in_little_memory(tmp_path):
    limited = "import resource, sys; resource.setrlimit(resource.RLIMIT_DATA, (MOST, MOST)); "
    code = limited.replace("MOST", str(MEMORY_MB << 20)) + "from hoi_retarget.cli import main; sys.exit(main())"
    for seed in range(1000, 1010):
        rng = np.random.default_rng(seed)
        file = damaged(rng, tmp_path)
        for words in words_for(file.path, tmp_path / "out", str(rng.choice(list(WRITABLE)))):
            if words[0] in ("view", "edit"):
                continue  # They serve until they are interrupted.
            command = [sys.executable, "-c", code, *words]
            done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
            assert done.returncode in (0, 1, 2) and "Traceback" not in done.stderr, (file.done, words, done.stderr)
