"""The G1 with three fingers on each palm: a thumb of three joints that closes against two fingers of two joints."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from hoi_retarget.robots import ROBOTS
from hoi_retarget.robots.model import RobotModel, load_model
from hoi_retarget.robots.spec import SIDES

FINGERS = ("thumb", "index", "ring")
LENGTH, RADIUS = 0.04, 0.008


def finger_robot(folder: Path) -> RobotModel:
    """Write the robot's MJCF into a folder, and load it; pads are on the palmar side of the last links."""
    g1 = ROBOTS["unitree_g1"]
    description = mujoco.MjSpec.from_file(str(g1.mjcf))
    speeds = dict(g1.speed_limits)
    for side in SIDES:
        palm = next(site for site in description.sites if site.name == f"{side}_palm")
        inward = -1.0 if side == "left" else 1.0
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, np.array(palm.quat))
        turn = turn.reshape(3, 3)
        for finger, z, joints in (("thumb", 0.0, 3), ("index", 0.025, 2), ("ring", -0.025, 2)):
            close = -inward if finger == "thumb" else inward  # The thumb closes against the others.
            start = np.array([0.0 if finger == "thumb" else 0.05, 0.04 * inward * (finger == "thumb"), z])
            body = palm.parent
            for number in range(joints):
                # The first link is placed in the palm's frame, the others at the ends of those before them.
                place = np.array(palm.pos) + turn @ start if number == 0 else np.array([LENGTH, 0.0, 0.0])
                rotation = np.array(palm.quat) if number == 0 else np.array([1.0, 0.0, 0.0, 0.0])
                body = body.add_body(name=f"{side}_{finger}_{number}_link", pos=place, quat=rotation)
                name = f"{side}_{finger}_{number}_joint"
                body.add_joint(name=name, axis=[0.0, 0.0, close], range=[-0.1, 1.6])
                ends = [0.0, 0.0, 0.0, LENGTH, 0.0, 0.0]
                body.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[RADIUS, 0.0, 0.0], fromto=ends, mass=0.02)
                speeds[name] = 12.0
            body.add_site(name=f"{side}_{finger}", pos=[0.75 * LENGTH, close * RADIUS, 0.0])
    file = folder / "fingers.xml"
    description.compile()
    file.write_text(description.to_xml())
    sites = {f"{side}_{finger}": f"{side}_{finger}" for side in SIDES for finger in FINGERS}
    return load_model(
        replace(g1, name="fingers", mjcf=file, meshes={}, skin=None, speed_limits=speeds, fingers=sites, motors={})
    )
