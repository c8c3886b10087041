"""Retarget a built-in clip and print its figures.

Run it with `python examples/01_demo_in_python.py`.
"""

# The matrices are small: linear algebra on several threads only makes them slower.
# The command line sets this by itself; in Python it must stand before numpy's first import.
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from hoi_retarget.evaluation import COLUMNS
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.pipeline import retarget
from hoi_retarget.robots import load_robot
from hoi_retarget.synthetic import make

clip = make("carry_box", height=1.75)  # for a recording: readers.read_clip(path, objects=folder)
model = load_robot("unitree_g1")
motion = retarget(clip, model, Config())

print(f"{motion.robot}: {motion.frames} frames, qpos of shape {motion.qpos.shape}")
for column in COLUMNS:
    if column.name in motion.report.figures:
        print(f"{column.header:28} {column.text(motion.report.figures[column.name])}")
