"""Orientation flips, links that point away from the human's, and turns of the trunk against the person's.

They are the classic wrong optima of inverse kinematics: a robot lies or is twisted where the person sits or stands.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.human.skeleton import trunk_rotations
from hoi_retarget.motion.motion_report import Event
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.numerics.filters import seconds_to_frames
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.robots.model import Kinematics, RobotModel

FLIP_DEG = 90.0  # A link that is turned by more points away from the human's.
MIN_LASTING_FLIP_SECONDS = 1.0
"""A link that points away for as long cannot reach what the human does; for a shorter time it flips there and back."""

LIMIT_TOLERANCE_RAD = 0.02  # [rad]; a joint so near to an end of its range is held by it.


def orientation_flips(errors: Mapping[str, Float[np.ndarray, "T"]]) -> tuple[Event, ...]:
    """Return where a site is further than `FLIP_DEG` from the rotation it should follow, by `rotation_errors_deg`."""
    return tuple(
        Event("orientation_flip", first, stop - 1, float(degrees[first:stop].max()), subject=site)
        for site, degrees in errors.items()
        for first, stop in runs(degrees > FLIP_DEG)
    )


def short_flips(errors: Mapping[str, Float[np.ndarray, "T"]], fps: float) -> tuple[Event, ...]:
    """Return the flips that last for less than `MIN_LASTING_FLIP_SECONDS`: no person moves like this."""
    longest = seconds_to_frames(MIN_LASTING_FLIP_SECONDS, fps)
    return tuple(flip for flip in orientation_flips(errors) if flip.frames < longest)


def rotation_errors_deg(kinematics: Kinematics, targets: Targets) -> dict[str, Float[np.ndarray, "T"]]:
    """Return the angles between sites of the IK table and their target rotations [deg], by site.

    Sites on a base have no target rotation.
    """
    model, errors = kinematics.model, {}
    for column, row in enumerate(model.spec.ik_rows):
        on_base = model.spec.base != "legs" and kinematics.frame(row.site).node == 0
        if row.rotation_weight > 0 and not on_base:
            target = se3.quat_to_matrix(targets.site_quats[:, column])
            errors[row.site] = np.degrees(se3.matrix_angle_between(kinematics.site_rotation(row.site), target))
    return errors


def limb_joints(model: RobotModel, site: str) -> Int[np.ndarray, "joints"]:
    """Return the indices of the joints between the trunk and a site."""
    supports, sites = model.supports[1:].astype(bool), model.sites
    trunk = supports[:, sites.nodes[sites.index["torso"]]]
    return np.flatnonzero(supports[:, sites.nodes[sites.index[site]]] & ~trunk)


def with_reasons(flips: Sequence[Event], kinematics: Kinematics, targets: Targets) -> tuple[Event, ...]:
    """Return flips with their reasons: the condition that holds in most of their frames."""
    return tuple(replace(flip, reason=_reason(flip, kinematics, targets)) for flip in flips)


def _reason(flip: Event, kinematics: Kinematics, targets: Targets) -> str:
    model, frames = kinematics.model, slice(flip.first_frame, flip.last_frame + 1)
    joints = limb_joints(model, flip.subject)
    theta = kinematics.qpos[frames, 7 + joints]
    ends = np.minimum(theta - model.lower[joints], model.upper[joints] - theta) < LIMIT_TOLERANCE_RAD
    stopped = [model.joint_names[joint] for joint in joints[ends.mean(axis=0) > 0.5]]
    if stopped:
        return f"at the end of the range of {', '.join(stopped)}"
    links = [link for link in targets.contact_links if set(limb_joints(model, link)) >= set(joints) and len(joints)]
    touching = [link for link in links if targets.contact_flags[frames, targets.contact_links.index(link)].mean() > 0.5]
    if touching:
        return f"the contact of {', '.join(touching)} comes first"
    return "no start of the inverse kinematics led past it"


MAX_TRUNK_TURN_DEG = 60.0  # Trunks of usable motions stay within 44 degrees of the person's.


def trunk_turns(kinematics: Kinematics, targets: Targets) -> tuple[Event, ...]:
    """Return where the robot's trunk is turned by more than `MAX_TRUNK_TURN_DEG` against the person's.

    A trunk on a base stays upright where the person bends down; it is not turned over.
    """
    if targets.base_qpos is not None:
        return ()
    degrees = trunk_errors_deg(kinematics, targets)
    return tuple(
        Event("trunk_turn", first, stop - 1, float(degrees[first:stop].max()))
        for first, stop in runs(degrees > MAX_TRUNK_TURN_DEG)
    )


def trunk_errors_deg(kinematics: Kinematics, targets: Targets) -> Float[np.ndarray, "T"]:
    """Return the angle between the robot's trunk and the person's [deg]."""
    return np.degrees(se3.matrix_angle_between(trunk_rotations(kinematics.site_position), targets.trunk_rotations))
