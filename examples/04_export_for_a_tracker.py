"""Write a motion as mjlab's tracking task reads it, and look at it as its loader does.

Run it with `python examples/04_export_for_a_tracker.py`.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # see 01_demo_in_python.py

import json
import tempfile
from pathlib import Path

import numpy as np

import hoi_retarget as hr


def main(folder: Path) -> None:
    """Retarget the built-in clip, export it at 50 frames a second, and print what is in the file."""
    clip = hr.open_clip("builtin:carry_box")
    motion = hr.retarget(clip, hr.load_robot("unitree_g1"))
    data, sidecar = hr.export(motion, "mjlab", folder, clip=clip)

    with np.load(data, allow_pickle=False) as arrays:
        for name in ("fps", "joint_pos", "body_pos_w", "body_quat_w", "contact_flags", "contact_normals"):
            print(f"{name:16} {arrays[name].dtype} {arrays[name].shape}")
        hand = list(arrays["contact_bodies"]).index("left_wrist_yaw_link")
        touching = arrays["contact_flags"][:, hand]
        print(f"the left hand touches in {touching.sum()} of {len(touching)} frames,")
        print("  where the box faces", arrays["contact_normals"][touching, hand][0].round(2), "in its own axes")

    description = json.loads(sidecar.read_text())
    print("bodies:", ", ".join(description["body_names"][:4]), "...")
    print("scale of the box:", round(description["objects"][0]["scale"], 3))
    print("licence of the source:", description["source"]["licence"])


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        main(Path(scratch))
