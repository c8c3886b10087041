"""The cost table of trajectory optimization: symbols and weights as in the paper's Table II.

Every weight multiplies the square of a residual in metres, radians, or the Frobenius norm of a
difference of rotations. Rows below the line are not in the paper; `docs/design.md` says why.
"""

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3
from hoi_retarget.retarget.config import IkWeights, Weights
from hoi_retarget.retarget.targets import Targets
from hoi_retarget.retarget.trajopt.problem import Term
from hoi_retarget.retarget.trajopt.terms.differences import Differences
from hoi_retarget.retarget.trajopt.terms.floor_clearance import FloorClearance
from hoi_retarget.retarget.trajopt.terms.object_contact import ObjectContact
from hoi_retarget.retarget.trajopt.terms.posture import Posture
from hoi_retarget.retarget.trajopt.terms.relative_rotation import RelativeRotation
from hoi_retarget.retarget.trajopt.terms.site_height import SiteHeight
from hoi_retarget.retarget.trajopt.terms.site_position import SitePosition
from hoi_retarget.retarget.trajopt.terms.site_rotation import SiteRotation
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.spec import SIDES, SOLE_CORNERS

PAPER_RATE = 30.0  # [frames/s] at which the paper's weights are given
PALMS = tuple(f"{side}_palm" for side in SIDES)


def trajectory_terms(weights: Weights, targets: Targets, reference: Kinematics) -> tuple[Term, ...]:
    """Return the rows of the cost table against an IK reference; rows that would be empty are left out."""
    return (
        *_tracking(weights, targets, reference),
        *_contact(weights, targets),
        *_stance(weights, targets),
        Differences("joint_jerk", 3, weights.jerk * targets.fps**4 * (targets.fps / PAPER_RATE) ** 2),
        *_floor(weights),
    )


def _tracking(weights: Weights, targets: Targets, reference: Kinematics) -> tuple[Term, ...]:
    base = reference.node_rotation[:, :, 0]
    torso = np.einsum("jit,jkt->ikt", base, reference.orientation("torso"))
    return (
        Posture("joint_position", np.ascontiguousarray(reference.qpos[:, 7:].T), weights.joint_position),
        SitePosition("base_position", "pelvis", reference.point("pelvis"), weights.base_position),
        SitePosition("head_position", "head", reference.point("head"), weights.head_position),
        *(
            SitePosition(f"{side}_foot_position", f"{side}_foot", targets.foot_positions[:, k].T, weights.feet_position)
            for k, side in enumerate(SIDES)
        ),
        RelativeRotation("torso_orientation", "torso", torso, weights.torso_orientation),
    )


def _contact(weights: Weights, targets: Targets) -> tuple[Term, ...]:
    terms: list[Term] = []
    frames = np.arange(targets.frames)
    for link, site in enumerate(targets.contact_links):
        if not targets.contact_flags[:, link].any():
            continue
        aimed = targets.carried_contact_object[:, link]
        terms.append(
            ObjectContact(
                f"{site}_contact",
                site,
                targets.carried_contact_points[:, link].T,
                targets.object_pos[frames, aimed].T,
                se3.quat_to_matrix(targets.object_quat[frames, aimed]).transpose(1, 2, 0),
                weights.object_contact * targets.contact_weights[:, link],
            )
        )
        if site in PALMS:
            rotation = se3.quat_to_matrix(targets.palm_quats[:, PALMS.index(site)]).transpose(1, 2, 0)
            weight = weights.hand_orientation * targets.contact_rotation_weights[:, link]
            terms.append(SiteRotation(f"{site}_orientation", site, rotation, weight))
    return tuple(terms)


def _stance(weights: Weights, targets: Targets) -> tuple[Term, ...]:
    terms: list[Term] = []
    for k, side in enumerate(SIDES):
        flags = targets.stance_flags[:, k]
        if flags.any():
            site, height = f"{side}_foot", targets.foot_positions[:, k, 2]
            terms.append(SiteHeight(f"{side}_stance_height", site, height, weights.stance_height * flags))
            rotation = se3.quat_to_matrix(targets.foot_quats[:, k]).transpose(1, 2, 0)
            weight = weights.stance_orientation * flags
            terms.append(SiteRotation(f"{side}_stance_orientation", site, rotation, weight))
    return tuple(terms)


def _floor(weights: Weights) -> tuple[Term, ...]:
    corners = {side: tuple(f"{side}_sole_{corner}" for corner in SOLE_CORNERS) for side in SIDES}
    return tuple(FloorClearance(f"{side}_floor", corners[side], 0.0, weights.floor_clearance) for side in SIDES)


def ik_terms(weights: IkWeights, targets: Targets, model: RobotModel) -> tuple[Term, ...]:
    """Return the rows of the robot's IK table; a rotation's Frobenius norm is twice its squared angle."""
    terms: list[Term] = []
    rotations = se3.quat_to_matrix(targets.site_quats).transpose(1, 2, 3, 0)
    for k, row in enumerate(model.spec.ik):
        if row.position_weight > 0:
            goal: Float[np.ndarray, "3 T"] = targets.site_positions[:, k].T
            terms.append(SitePosition(f"{row.site}_position", row.site, goal, row.position_weight**2))
        if row.rotation_weight > 0:
            terms.append(SiteRotation(f"{row.site}_rotation", row.site, rotations[k], 0.5 * row.rotation_weight**2))
    home = np.repeat(model.home_qpos[7:, None], targets.frames, axis=1)
    terms.append(Posture("posture", home, model.spec.posture_weight))
    terms.append(Differences("smoothness", 1, weights.smoothness * (targets.fps / PAPER_RATE) ** 2))
    return tuple(terms)
