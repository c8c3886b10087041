"""Every example runs as its first lines say, in a folder of its own, with no word on stderr but progress."""

import subprocess
import sys
from pathlib import Path

import pytest

from said import complaints_in

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))


def test_examples_are_numbered_from_one():
    assert [path.name[:3] for path in EXAMPLES] == [f"{number:02}_" for number in range(1, len(EXAMPLES) + 1)]


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=[path.stem for path in EXAMPLES])
def test_example_runs(example, tmp_path):
    assert f"python examples/{example.name}" in example.read_text().partition('"""\n')[0]
    done = subprocess.run([sys.executable, example], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    assert not complaints_in(done.stderr)
    assert not list(tmp_path.iterdir()), "an example leaves nothing behind"
