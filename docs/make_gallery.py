"""Writes a gallery of all built-in clips on both robots, for any static host: `python docs/make_gallery.py`.

Pictures need EGL (Debian: `apt-get install libegl1 libgl1-mesa-dri`) or a display; without a display, `MUJOCO_GL=egl`.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from hoi_retarget.cli import main
from hoi_retarget.readers.builtin_clips import SCENES

OUT = Path(__file__).parents[1] / "site" / "gallery"
ROBOTS = ("unitree_g1", "unitree_h2")


def write(out: Path) -> int:
    """Write the gallery into a folder; return 1 where a motion is missing from it."""
    clips = [f"builtin:{name}" for name in SCENES]
    with TemporaryDirectory() as results:
        solved = [main(["run", *clips, "--robot", robot, "--out", f"{results}/{robot}"]) for robot in ROBOTS]
        shared = main(["share", results, "--out", str(out), "--title", "The built-in clips on two robots"])
    return max(*solved, shared)


if __name__ == "__main__":
    sys.exit(write(Path(sys.argv[1]) if len(sys.argv) > 1 else OUT))
