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

from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.result_file import load, save
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.pipeline import retarget
from hoi_retarget.robots import load_robot
from hoi_retarget.synthetic import make


def main(path: Path) -> None:
    """Print what a result holds."""
    motion = load(path)
    kinematics = load_robot(motion.robot).forward(motion.qpos)
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
    print("status of each window:", [window["status"] for window in report["windows"]])


def make_one(path: Path) -> None:
    """Write a result of the built-in clip."""
    motion: Motion = retarget(make("carry_box"), load_robot("unitree_g1"), Config())
    save(motion, path)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as folder:
            make_one(Path(folder) / "carry_box.npz")
            main(Path(folder) / "carry_box.npz")
