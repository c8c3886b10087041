"""Tables of a robot's joints and of its sites, for people to read."""

from dataclasses import dataclass

import numpy as np

from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.spec import SITES


@dataclass(frozen=True)
class JointRow:
    """One row of the table of joints."""

    joint: str
    lower: float
    """[rad]"""
    upper: float
    """[rad]"""
    speed_limit: float
    """[rad/s]"""
    effort: float | None
    """[N m], where the MJCF has it (`actuatorfrcrange`)."""


@dataclass(frozen=True)
class RoleRow:
    """One row of the table of roles."""

    site: str
    body: str
    place: tuple[float, float, float]
    """In the body's frame [m]."""
    follows: str
    """The human joint that inverse kinematics follows with it, or the human part that touches."""


def joint_table(model: RobotModel) -> tuple[JointRow, ...]:
    """Return the joints in the order of `qpos`."""
    limits = (model.lower, model.upper, model.speed_limits, model.torque_limits)
    return tuple(
        JointRow(name, lower, upper, speed, torque if np.isfinite(torque) else None)
        for name, lower, upper, speed, torque in zip(
            model.joint_names, *(limit.tolist() for limit in limits), strict=True
        )
    )


def role_table(model: RobotModel) -> tuple[RoleRow, ...]:
    """Return the sites in the order of `SITES`, then those of fingers."""
    humans: dict[str, list[str]] = {site: [] for site in SITES}
    for row in model.spec.ik:
        humans[row.site].append(row.human_joint)
    for part, site in model.spec.contact_sites.items():
        humans.setdefault(site, []).append(f"touches for {part}")
    rows = []
    for site, followed in humans.items():
        body = model.body_of(site)
        frame, carrier = model.sites.frames[site], model.body_frames.frames[body]
        x, y, z = (carrier.rotation.T @ (frame.position - carrier.position)).tolist()
        rows.append(RoleRow(site, body, (x, y, z), "; ".join(followed)))
    return tuple(rows)
