"""Makes a small public corpus from built-in clips alone, free of others' licences: `python tools/make_corpus.py OUT`.

Five clips, three robots, two sizes of the object, left for right. OUT becomes a data set folder for the Hugging Face
Hub: Parquet rows, a card, and `verdicts/report.html`, which plays the 15 worst motions. Motions that fail are left out
and counted. Needs the extra `dataset`.
"""

import sys
import tempfile
from collections import Counter
from pathlib import Path

import hoi_retarget as hr

SPECIFICATION = """
clips = ["builtin:carry_box", "builtin:move_chair", "builtin:push_table", "builtin:drag_suitcase",
         "builtin:carry_table"]
robots = ["unitree_g1", "unitree_h2", "unitree_g1_dex3"]
size_multipliers = [1.0, 0.8]
mirrored = [false, true]
"""


def main(out: Path, work: Path) -> None:
    """Make the corpus in `out`, its results in `work`."""
    (work / "corpus.toml").write_text(SPECIFICATION)
    hr.main(["batch", str(work / "corpus.toml"), "--out", str(work / "results")])
    entries = list(hr.read_manifest(work / "results").values())
    good = [entry for entry in entries if entry.verdict in {"pass", "warn"}]
    results = [work / "results" / result.path for entry in good for result in entry.results]
    hr.main(["export", *map(str, results), "--to", "dataset", "--out", str(out)])
    hr.main(["report", str(work / "results"), "--pages", "15", "--out", str(out / "verdicts")])
    print("verdicts:", dict(Counter(entry.verdict or entry.status for entry in entries)))
    print(f"{sum(file.stat().st_size for file in out.rglob('*') if file.is_file()) / 1e6:.1f} MB in {out}")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        main(Path(sys.argv[1]), Path(scratch))
