"""Does the robot touch the object where the human did, and turn its hands on it as the human did?"""

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.evaluation.figure import Figure
from hoi_retarget.evaluation.statistics import max_or_none, mean_or_none, norms
from hoi_retarget.evaluation.view import HAND_SITES, Comparison
from hoi_retarget.numerics import se3


def contact_gaps(view: Comparison) -> Float[np.ndarray, "K"]:
    """Return the distance on the object [m] between palm and human contact point, hands and contact frames pooled."""
    gaps = [np.zeros(0)]
    for track in view.hand_contacts:
        palm = view.robot_objects[track.object].points_inside(view.robot_point(HAND_SITES[track.part]))
        target = track.contact_points * view.motion.object_scale[track.object]
        gaps.append(norms((palm - target)[track.active]))
    return np.concatenate(gaps)


def contact_slip_mps(view: Comparison) -> float | None:
    """Return the mean speed [m/s] of palms on what they touch, over frames that touch as the frame before did."""
    speeds = [np.zeros(0)]
    for track in view.hand_contacts:
        palm = view.robot_objects[track.object].points_inside(view.robot_point(HAND_SITES[track.part]))
        held = track.active[1:] & track.active[:-1]
        speeds.append(view.motion.fps * norms(np.diff(palm, axis=0)[held]))
    return mean_or_none(np.concatenate(speeds))


def contact_gap_m(view: Comparison) -> float | None:
    """Return the mean distance on the object between palm and human contact point [m]."""
    return mean_or_none(view.once(contact_gaps))


def contact_gap_p95_m(view: Comparison) -> float | None:
    """Return the 95th percentile of that distance [m]."""
    gaps = view.once(contact_gaps)
    return float(np.percentile(gaps, 95)) if gaps.size else None


def contact_gap_max_m(view: Comparison) -> float | None:
    """Return the largest such distance [m]."""
    return max_or_none(view.once(contact_gaps))


def relative_hand_rotation_deg(view: Comparison) -> float | None:
    """Return the mean angle [deg] between the two sides' change of hand rotation since the segment's first frame.

    With `A_t` the hand's rotation relative to the object, the change is `A_t A_0^T`: it is written in the
    object's axes, which both sides share, and a constant offset between the human's and the robot's hand
    frames, `A_t K`, cancels in it. (`A_0^T A_t` would be written in the hand's axes, which differ.)
    """
    angles = [np.zeros(0)]
    for track in view.hand_contacts:
        frames = np.flatnonzero(track.active)
        starts = segment_starts(track.active)
        robot = view.robot_objects[track.object].rotations_inside(view.robot_rotation(HAND_SITES[track.part]))
        human = view.human_objects[track.object].rotations_inside(view.human_part_rotation(track.part))
        robot_change = robot[frames] @ np.swapaxes(robot[starts], 1, 2)
        human_change = human[frames] @ np.swapaxes(human[starts], 1, 2)
        angles.append(np.degrees(se3.matrix_angle_between(robot_change, human_change)))
    return mean_or_none(np.concatenate(angles))


def segment_starts(active: Bool[np.ndarray, "F"]) -> Int[np.ndarray, "K"]:
    """Return, for each active frame, the first frame of its run of active frames."""
    begins = active.copy()
    begins[1:] &= ~active[:-1]
    latest = np.maximum.accumulate(np.where(begins, np.arange(len(active)), 0))
    return latest[active]


CONTACT_GAP = Figure("contact_gap_m", "contact gap", "mm", 1e3, 1, "lower", contact_gap_m, in_paper=True)
CONTACT_GAP_P95 = Figure("contact_gap_p95_m", "gap p95", "mm", 1e3, 1, "lower", contact_gap_p95_m)
CONTACT_GAP_MAX = Figure("contact_gap_max_m", "gap max", "mm", 1e3, 1, "lower", contact_gap_max_m)
CONTACT_SLIP = Figure("contact_slip_mps", "contact slip", "cm/s", 1e2, 1, "lower", contact_slip_mps)
RELATIVE_HAND_ROTATION = Figure(
    "relative_hand_rotation_deg", "hand rotation", "deg", 1.0, 1, "lower", relative_hand_rotation_deg, in_paper=True
)
