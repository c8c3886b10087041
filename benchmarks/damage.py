"""What verbs make of damaged results and motions: how they end, how long they take, and how much memory.

Files and damage are those of `tests/damaged.py`, from seeds; one that ends in anything but words is told with its seed.
"""

import sys
import tempfile
import traceback
import warnings
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))  # What damages files belongs to the tests.
from common import pin_threads

from damaged import KINDS, Damaged, Outcome, check, damaged, serving_nobody, sound


@dataclass(frozen=True)
class Arguments:
    """Damage files and ask every verb."""

    first: int = 0
    """First seed."""
    files: int = 5000


def peak_mb() -> float:
    """Return the most memory that this process has had since `forget_peak` [MB]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))


def forget_peak() -> None:
    """Begin to measure the memory anew."""
    Path("/proc/self/clear_refs").write_text("5")


def tried(seed: int, work: Path) -> tuple[Damaged, list[Outcome]]:
    """Return a damaged file, and what became of it; raises what a verb raises."""
    rng = np.random.default_rng(seed)
    file = damaged(rng, work)
    forget_peak()
    return file, check(file, work / "out", rng)


def main(arguments: Arguments) -> None:
    pin_threads()
    warnings.simplefilter("ignore")
    for kind in KINDS:
        sound(kind)
    ends, failed, slowest, largest = Counter(), 0, (0.0, ""), (0.0, "")
    with serving_nobody():
        for seed in range(arguments.first, arguments.first + arguments.files):
            with tempfile.TemporaryDirectory() as work:
                try:
                    file, found = tried(seed, Path(work))
                except Exception:  # noqa: BLE001 - this is what is looked for
                    failed += 1
                    print(f"seed {seed}:\n{traceback.format_exc(limit=-3)}", flush=True)
                    continue
            ends.update((outcome.verb, outcome.code) for outcome in found)
            slow = max(found, key=lambda outcome: outcome.seconds)
            slowest = max(slowest, (slow.seconds, f"{slow.verb}, seed {seed}: {file.done}"))
            largest = max(largest, (peak_mb(), f"seed {seed}: {file.done}"))
    for verb in dict.fromkeys(verb for verb, _ in ends):
        print(f"{verb:14}" + "  ".join(f"{code}: {ends[verb, code]}" for code in (0, 1, 2)))
    print(f"{arguments.files} files, {failed} failed. Slowest: {slowest[0]:.1f} s, {slowest[1]}.")
    print(f"Most memory: {largest[0]:.0f} MB, {largest[1]}.")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
