"""One clip, several object sizes: each motion touches its object in the same places.

The size multiplier makes many motions of one recording; contact points grow and shrink with the
object because they are kept in the object's frame. Run it with `python examples/02_own_settings.py`.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # see 01_demo_in_python.py

from dataclasses import replace

import hoi_retarget as hr

clip = hr.open_clip("builtin:carry_box")
robot = hr.load_robot("unitree_g1")
# Windows of 60 frames that share 10 bound the memory of long clips; the jerk's weight is a setting like any other.
config = hr.Config(horizon=hr.Horizon(length=60, overlap=10), weights=hr.Weights(jerk=2e-3))

print("size  contact gap [mm]  contacts not reached")
for size in (0.5, 0.75, 1.0, 1.25):
    motion = hr.retarget(clip, robot, replace(config, scaling=hr.Scaling(size_multiplier=size)))
    gap = 1e3 * motion.report.figures["contact_gap_m"]
    print(f"{size:4.2f}  {gap:16.1f}  {len(motion.report.unreached_contacts):20}")
