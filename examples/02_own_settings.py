"""One clip, several object sizes: each motion touches its object in the same places.

The size multiplier makes many motions of one recording; contact points grow and shrink with the
object because they are kept in the object's frame. Run it with `python examples/02_own_settings.py`.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # see 01_demo_in_python.py

from dataclasses import replace

from hoi_retarget.retargeting.config import Config, Scaling, parse_horizon
from hoi_retarget.retargeting.pipeline import retarget
from hoi_retarget.robots import load_robot
from hoi_retarget.synthetic import make

clip = make("carry_box")
model = load_robot("unitree_g1")
config = Config(horizon=parse_horizon("windowed:60:10"))  # streams long clips in bounded memory

print("size  contact gap [mm]  contacts not reached")
for size in (0.5, 0.75, 1.0, 1.25):
    motion = retarget(clip, model, replace(config, scaling=Scaling(size_multiplier=size)))
    gap = 1e3 * motion.report.figures["contact_gap_m"]
    print(f"{size:4.2f}  {gap:16.1f}  {len(motion.report.unreached_contacts):20}")
