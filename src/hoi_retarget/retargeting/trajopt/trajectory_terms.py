"""The cost tables of trajectory optimization and of inverse kinematics.

A file of `terms/` declares kinds of residuals, and functions that build the terms of the trajectory with the weights of
the paper's Table II. `docs/design.md` says why there are costs that are not in the paper.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.config import IkWeights, Weights
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.problem import Term
from hoi_retarget.retargeting.trajopt.terms import site_pose
from hoi_retarget.retargeting.trajopt.terms.differences import PAPER_RATE, Differences, jerk_terms
from hoi_retarget.retargeting.trajopt.terms.floor_clearance import floor_terms, link_floor_terms
from hoi_retarget.retargeting.trajopt.terms.object_contact import contact_terms
from hoi_retarget.retargeting.trajopt.terms.posture import Posture, coupling_terms, posture_terms
from hoi_retarget.robots.model import Kinematics, RobotModel

COSTS: tuple[Callable[[Weights, Targets, Kinematics], Iterable[Term]], ...] = (
    posture_terms,
    coupling_terms,
    site_pose.position_terms,
    site_pose.torso_terms,
    site_pose.trunk_terms,
    contact_terms,
    site_pose.stance_terms,
    jerk_terms,
    floor_terms,
    link_floor_terms,
    site_pose.pin_terms,
)


def trajectory_terms(
    weights: Weights, targets: Targets, reference: Kinematics, *, gives_way: bool = False
) -> tuple[Term, ...]:
    """Return the terms of all costs against an IK reference, without empty ones.

    `weights`: of the table; `targets`: of the trajectory's frames; `reference`: the IK trajectory; `gives_way`: whether
    a body without objects follows its references as loosely as one with objects.
    """
    used = weights if targets.object_names or gives_way else weights.without_objects
    if targets.contact == "surface":
        # Anchors hold the feet that stand; those that swing are smoother with the weight that they have with objects.
        used = replace(used, feet_position=weights.feet_position)
    return _without_base_terms(
        targets, reference.model, (term for cost in COSTS for term in cost(used, targets, reference))
    )


def ik_terms(weights: IkWeights, targets: Targets, model: RobotModel) -> tuple[Term, ...]:
    """Return the rows of the robot's IK table; a rotation's Frobenius norm is twice its squared angle."""
    terms: list[Term] = []
    rotations = se3.quat_to_matrix(targets.site_quats).transpose(1, 2, 3, 0)
    for k, row in enumerate(model.spec.ik_rows):
        if row.position_weight > 0:
            goal: Float[np.ndarray, "3 T"] = targets.site_positions[:, k].T
            terms.append(site_pose.SitePosition(f"{row.site}_position", row.site, goal, row.position_weight**2))
        if row.rotation_weight > 0:
            terms.append(
                site_pose.SiteRotation(f"{row.site}_rotation", row.site, rotations[k], 0.5 * row.rotation_weight**2)
            )
    home = np.repeat(model.home_qpos[7:, None], targets.frames, axis=1)
    terms.append(Posture("posture", home, model.spec.posture_weight))
    terms.append(Differences("smoothness", 1, weights.smoothness * (targets.fps / PAPER_RATE) ** 2))
    return _without_base_terms(targets, model, terms)


def _without_base_terms(targets: Targets, model: RobotModel, terms: Iterable[Term]) -> tuple[Term, ...]:
    """Return the terms without those of sites on a base that stays, or on one that follows but for its own."""
    if targets.base_qpos is None:
        return tuple(terms)
    on_base = {site for site, frame in model.sites.frames.items() if frame.node == 0}
    on_base -= {"pelvis"} if model.spec.base == "follows" else set()
    return tuple(term for term in terms if getattr(term, "site", None) not in on_base)
