"""Read a result file, with this package and with numpy alone.

Run it with `python examples/03_read_a_result.py [RESULT.npz]`; without a file it makes one first.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # see 01_demo_in_python.py

import json
import sys
import tempfile
from pathlib import Path

import numpy as np

import hoi_retarget as hr


def main(path: Path) -> None:
    """Print what a result holds."""
    motion = hr.load(path)
    kinematics = hr.load_robot(motion.robot).forward(motion.qpos)
    for column, link in enumerate(motion.contact_links):
        frames = np.flatnonzero(motion.contact_flags[:, column])
        if len(frames):
            print(f"{link} touches {motion.object_names[0]!r} in {len(frames)} frames, from frame {frames[0]} on,")
            print(f"  there at {kinematics.site_position(link)[frames[0]].round(3)} m in the world")

    # The same file without this package: plain arrays, no pickled objects.
    with np.load(path, allow_pickle=False) as arrays:
        report = json.loads(str(arrays["report"]))
        print("arrays:", ", ".join(f"{name} {arrays[name].shape}" for name in arrays.files if arrays[name].ndim))
    print("source:", report["source"]["format"], "- licence:", report["source"]["licence"])
    for stage, windows in report["stages"].items():
        print(f"status of each window of {stage}:", [window["status"] for window in windows])


def make_one(path: Path) -> None:
    """Write a result of the built-in clip."""
    hr.save(hr.retarget(hr.open_clip("builtin:carry_box"), hr.load_robot("unitree_g1")), path)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as folder:
            make_one(Path(folder) / "carry_box.npz")
            main(Path(folder) / "carry_box.npz")
