"""Contacts that the robot did not reach: named one by one, never hidden in a mean."""

from dataclasses import dataclass

import numpy as np

from hoi_retarget import se3
from hoi_retarget.metrics.statistics import norms
from hoi_retarget.metrics.view import FOOT_SITES, HAND_SITES, KinematicsLike
from hoi_retarget.motion import Motion
from hoi_retarget.signals import runs

UNREACHED_M = 0.02
"""A segment whose mean residual exceeds this [m] counts as not reached."""

_SITES = {**HAND_SITES, **FOOT_SITES}


@dataclass(frozen=True)
class UnreachedSegment:
    """One contact, from its first to its last frame, that stayed away from its target."""

    link: str
    """The contact link, as the motion names it."""
    object: str
    first_frame: int
    """First frame of the motion in which the contact is asked for."""
    last_frame: int
    """Last such frame, included."""
    mean_residual_m: float
    """Mean distance between link and target [m]."""
    max_residual_m: float
    """Largest such distance [m]."""

    def __str__(self) -> str:
        return (
            f"{self.link} on {self.object!r}, frames {self.first_frame} to {self.last_frame}: "
            f"{100 * self.mean_residual_m:.1f} cm off its target on average, "
            f"{100 * self.max_residual_m:.1f} cm at most"
        )


def unreached_contacts(
    motion: Motion, kinematics: KinematicsLike, *, limit_m: float = UNREACHED_M
) -> tuple[UnreachedSegment, ...]:
    """Return the contact segments whose mean residual exceeds `limit_m` [m], in order of link and time.

    The residual is the distance in the object's frame between a contact link and the target that the motion
    was asked to touch. A segment is a run of frames in which a link touches one object without a break. All
    frames count, the first one too.

    Args:
        motion: The robot's motion; its contact links are sites of the robot, or human parts standing for them.
        kinematics: The model's `forward(motion.qpos)`.
        limit_m: Largest mean residual that counts as reached [m].
    """
    found = []
    for column, link in enumerate(motion.contact_links):
        touched = np.where(motion.contact_flags[:, column], motion.contact_object[:, column], -1)
        if (touched < 0).all():
            continue
        position = kinematics.site_position(_SITES.get(link, link))
        for index in range(len(motion.object_names)):
            inside = se3.rotate_inverse(motion.object_quat[:, index], position - motion.object_pos[:, index])
            residuals = norms(inside - motion.contact_targets[:, column])
            for first, end in runs(touched == index):
                mean = float(residuals[first:end].mean())
                if not mean <= limit_m:
                    largest = float(residuals[first:end].max())
                    found.append(UnreachedSegment(link, motion.object_names[index], first, end - 1, mean, largest))
    return tuple(sorted(found, key=lambda segment: (motion.contact_links.index(segment.link), segment.first_frame)))
