"""Retarget a built-in clip and print its figures.

Run it with `python examples/01_demo_in_python.py`.
"""

# The matrices are small: linear algebra on several threads only makes them slower.
# The command line sets this by itself; in Python it must stand before numpy's first import.
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import hoi_retarget as hr

clip = hr.open_clip("builtin:carry_box")  # for a recording: hr.open_clip(path, hr.ReadOptions(objects=folder))
robot = hr.load_robot("unitree_g1")
motion = hr.retarget(clip, robot)

print(f"{motion.robot}: {motion.frames} frames, qpos of shape {motion.qpos.shape}")
for figure in hr.FIGURES:
    print(f"{figure.header:28} {figure.text(motion.report.figures[figure.name])}")
