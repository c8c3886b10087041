"""From a folder of clips to a set that a tracker can be trained on: batch, verdicts, export.

Run it with `python examples/05_from_clips_to_a_training_set.py [FOLDER]`; without a folder it takes built-in clips.
The folder holds clips, and their objects' geometry in `FOLDER/objects`.
"""

import json
import sys
import tempfile
from collections import Counter
from pathlib import Path

import hoi_retarget as hr

SPECIFICATION = """
clips = {clips}
objects = {objects}
robots = ["unitree_g1"]
size_multipliers = [1.0, 0.8]    # the object as it is by default, and smaller; contacts stay on its surface
mirrored = [false, true]         # left for right
"""


def main(folder: Path | None, work: Path) -> None:
    """Make the set in `work`."""
    clips = ["builtin:carry_box", "builtin:move_chair"] if folder is None else [str(folder.absolute())]
    objects = "." if folder is None else str(folder.absolute() / "objects")
    (work / "set.toml").write_text(SPECIFICATION.format(clips=json.dumps(clips), objects=json.dumps(objects)))

    # As often as you like: what is done is not done again.
    hr.main(["batch", str(work / "set.toml"), "--out", str(work / "results")])

    entries = hr.read_manifest(work / "results").values()
    print("\nverdicts:", dict(Counter(entry.verdict or entry.status for entry in entries)))
    for entry in entries:
        for result in entry.results:
            for reason in result.verdict["reasons"]:
                print(f"  {result.path}: {reason}")

    # What fails is not trained on.
    good = [entry for entry in entries if entry.verdict in {"pass", "warn"}]
    results = [str(work / "results" / result.path) for entry in good for result in entry.results]
    print()
    hr.main(["export", *results, "--to", "mjlab", "--out", str(work / "mjlab")])
    print("\nlicences in the set:", {entry.source.licence for entry in good})
    print("files:", *sorted(path.name for path in (work / "mjlab").iterdir()), sep="\n  ")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        main(Path(sys.argv[1]) if len(sys.argv) > 1 else None, Path(scratch))
