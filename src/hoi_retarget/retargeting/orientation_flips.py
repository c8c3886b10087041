"""Orientation flips: links that point away from the human's, the classic wrong optimum of inverse kinematics."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.motion.report import OrientationFlip
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.numerics.filters import frames_in
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.robots.model import Kinematics, RobotModel

FLIP_DEG = 90.0
"""A link that is turned by more points away from the human's."""
REACH_SECONDS = 1.0
"""A link that points away for as long cannot reach what the human does; for a shorter time it flips there and back."""

AT_END = 0.02
"""[rad]; a joint so near to an end of its range is held by it."""


def orientation_flips(errors: Mapping[str, Float[np.ndarray, "T"]]) -> tuple[OrientationFlip, ...]:
    """Return where a site is further than `FLIP_DEG` from the rotation it should follow, by `rotation_errors_deg`."""
    return tuple(
        OrientationFlip(site, first, stop - 1, float(degrees[first:stop].max()))
        for site, degrees in errors.items()
        for first, stop in runs(degrees > FLIP_DEG)
    )


def short_flips(errors: Mapping[str, Float[np.ndarray, "T"]], fps: float) -> tuple[OrientationFlip, ...]:
    """Return those that last for less than `REACH_SECONDS`, which no person does."""
    longest = frames_in(REACH_SECONDS, fps)
    return tuple(flip for flip in orientation_flips(errors) if flip.frames < longest)


def rotation_errors_deg(kinematics: Kinematics, targets: Targets) -> dict[str, Float[np.ndarray, "T"]]:
    """Return how far the sites of the IK table are from the rotations they should follow [deg], by site.

    Sites on a base follow none.
    """
    model, errors = kinematics.model, {}
    for column, row in enumerate(model.spec.ik_rows):
        on_base = model.spec.base != "legs" and kinematics.frame(row.site).node == 0
        if row.rotation_weight > 0 and not on_base:
            wanted = se3.quat_to_matrix(targets.site_quats[:, column])
            errors[row.site] = np.degrees(se3.matrix_angle_between(kinematics.site_rotation(row.site), wanted))
    return errors


def limb_joints(model: RobotModel, site: str) -> Int[np.ndarray, "joints"]:
    """Return the indices of the joints between the trunk and a site."""
    supports, sites = model.supports[1:].astype(bool), model.sites
    trunk = supports[:, sites.nodes[sites.index["torso"]]]
    return np.flatnonzero(supports[:, sites.nodes[sites.index[site]]] & ~trunk)


def with_reasons(
    flips: Sequence[OrientationFlip], kinematics: Kinematics, targets: Targets
) -> tuple[OrientationFlip, ...]:
    """Return flips that say why they are there: what holds in most of their frames."""
    return tuple(replace(flip, reason=_reason(flip, kinematics, targets)) for flip in flips)


def _reason(flip: OrientationFlip, kinematics: Kinematics, targets: Targets) -> str:
    model, frames = kinematics.model, slice(flip.first_frame, flip.last_frame + 1)
    joints = limb_joints(model, flip.site)
    theta = kinematics.qpos[frames, 7 + joints]
    ends = np.minimum(theta - model.lower[joints], model.upper[joints] - theta) < AT_END
    stopped = [model.joint_names[joint] for joint in joints[ends.mean(axis=0) > 0.5]]
    if stopped:
        return f"at the end of the range of {', '.join(stopped)}"
    links = [link for link in targets.contact_links if set(limb_joints(model, link)) >= set(joints) and len(joints)]
    touching = [link for link in links if targets.contact_flags[frames, targets.contact_links.index(link)].mean() > 0.5]
    if touching:
        return f"the contact of {', '.join(touching)} comes first"
    return "no start of the inverse kinematics led past it"
