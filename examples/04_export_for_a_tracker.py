"""Write a motion as mjlab's tracking task reads it, and look at it as its loader does.

Run it with `python examples/04_export_for_a_tracker.py`.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # see 01_demo_in_python.py

import io
import json
from hashlib import sha256

import numpy as np

from hoi_retarget.motion.export import export, format_named
from hoi_retarget.motion.result import Result
from hoi_retarget.motion.result_file import encode
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.pipeline import retarget
from hoi_retarget.robots import load_robot
from hoi_retarget.synthetic import make


def main() -> None:
    """Retarget the built-in clip, export it at 50 frames a second, and print what is in the file."""
    clip, model = make("carry_box"), load_robot("unitree_g1")
    motion = retarget(clip, model, Config())
    result = Result("carry_box", sha256(encode(motion)).hexdigest(), motion, model, clip)
    exported = export(result, format_named("mjlab"), name="carry_box.mjlab")

    with np.load(io.BytesIO(exported.files["carry_box.mjlab.npz"]), allow_pickle=False) as arrays:
        for name in ("fps", "joint_pos", "body_pos_w", "body_quat_w", "contact_flags", "contact_normals"):
            print(f"{name:16} {arrays[name].dtype} {arrays[name].shape}")
        hand = list(arrays["contact_bodies"]).index("left_wrist_yaw_link")
        touching = arrays["contact_flags"][:, hand]
        print(f"the left hand touches in {touching.sum()} of {exported.frames} frames,")
        print("  where the box faces", arrays["contact_normals"][touching, hand][0].round(2), "in its own axes")

    description = json.loads(exported.files["carry_box.mjlab.meta.json"])
    print("bodies:", ", ".join(description["body_names"][:4]), "...")
    print("scale of the box:", round(description["objects"][0]["scale"], 3))
    print("licence of the source:", description["source"]["licence"])


if __name__ == "__main__":
    main()
