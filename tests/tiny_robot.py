"""A small robot of four limbs on one trunk: no waist, so that torso and pelvis are one link."""

from dataclasses import replace
from pathlib import Path

from hoi_retarget.robots import ROBOTS
from hoi_retarget.robots.model import RobotModel, load_model
from hoi_retarget.robots.spec import SIDES, SITES, SOLE_CORNERS, SitePose

_CORNERS = dict(zip(SOLE_CORNERS, ((-0.05, 0.03), (-0.05, -0.03), (0.15, 0.03), (0.15, -0.03)), strict=True))


def tiny_robot(folder: Path) -> RobotModel:
    """Write the robot's MJCF into a folder, and load it with its sites as data."""
    mjcf = folder / "tiny.xml"
    limbs = "".join(
        _limb(f"{side}_leg", (0, y, -0.1), 0.35) + _limb(f"{side}_arm", (0, 2 * y, 0.3), 0.25)
        for side, y in (("left", 0.1), ("right", -0.1))
    )
    mjcf.write_text(
        '<mujoco><compiler angle="radian"/><worldbody><body name="trunk" pos="0 0 0.85"><freejoint/>'
        f'<geom type="box" size="0.1 0.15 0.3"/>{limbs}</body></worldbody></mujoco>'
    )
    joints = [
        f"{side}_{limb}_{joint}" for side in SIDES for limb in ("leg", "arm") for joint in ("x", "y", "z", "bend")
    ]
    sites = {"pelvis": SitePose("trunk", (0.0, 0.0, 0.0)), "torso": SitePose("trunk", (0.0, 0.0, 0.2))}
    sites["head"] = SitePose("trunk", (0.0, 0.0, 0.5))
    for side in SIDES:
        on_limbs = {
            "hip": ("leg_upper", (0.0, 0.0, 0.0)),
            "knee": ("leg_lower", (0.0, 0.0, 0.0)),
            "foot": ("leg_lower", (0.0, 0.0, -0.35)),
            "toe": ("leg_lower", (0.1, 0.0, -0.38)),
            "shoulder": ("arm_upper", (0.0, 0.0, 0.0)),
            "elbow": ("arm_lower", (0.0, 0.0, 0.0)),
            "wrist": ("arm_lower", (0.0, 0.0, -0.25)),
            "palm": ("arm_lower", (0.0, 0.0, -0.3)),
            **{f"sole_{name}": ("leg_lower", (x, y, -0.4)) for name, (x, y) in _CORNERS.items()},
        }
        sites |= {f"{side}_{name}": SitePose(f"{side}_{body}", place) for name, (body, place) in on_limbs.items()}
    assert set(sites) == set(SITES)
    g1 = ROBOTS["unitree_g1"]
    speeds, home = dict.fromkeys(joints, 20.0), {f"{side}_leg_bend": 0.2 for side in SIDES}
    bare = replace(g1, name="tiny", mjcf=mjcf, sites=sites, meshes={}, skin=None)
    return load_model(replace(bare, speed_limits=speeds, home=home))


def _limb(name: str, place: tuple[float, float, float], length: float) -> str:
    """Return a limb of two links that hangs: three hinges at its root, one in its middle."""
    hinges = "".join(
        f'<joint name="{name}_{axis}" axis="{vector}" range="-2 2"/>'
        for axis, vector in (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1"))
    )
    link = f'<geom type="capsule" size="0.03" fromto="0 0 0 0 0 -{length}"/>'
    x, y, z = place
    return (
        f'<body name="{name}_upper" pos="{x} {y} {z}">{hinges}{link}<body name="{name}_lower" pos="0 0 -{length}">'
        f'<joint name="{name}_bend" axis="0 1 0" range="-2 2"/>{link}</body></body>'
    )
