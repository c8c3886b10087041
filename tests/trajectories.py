"""Random trajectories and the terms of every file in `terms/`, shared by the tests of the solver."""

import numpy as np

from hoi_retarget.numerics import se3
from hoi_retarget.retarget.trajopt.problem import Term
from hoi_retarget.retarget.trajopt.terms.differences import Differences
from hoi_retarget.retarget.trajopt.terms.floor_clearance import FloorClearance
from hoi_retarget.retarget.trajopt.terms.object_contact import ObjectContact
from hoi_retarget.retarget.trajopt.terms.posture import Posture
from hoi_retarget.retarget.trajopt.terms.relative_rotation import RelativeRotation
from hoi_retarget.retarget.trajopt.terms.site_height import SiteHeight
from hoi_retarget.retarget.trajopt.terms.site_position import SitePosition
from hoi_retarget.retarget.trajopt.terms.site_rotation import SiteRotation
from hoi_retarget.robots import ROBOTS
from hoi_retarget.robots.model import RobotModel, load_model

MODELS: dict[str, RobotModel] = {name: load_model(spec) for name, spec in ROBOTS.items()}


def random_qpos(model: RobotModel, frames: int, rng: np.random.Generator, *, wander: float = 0.05) -> np.ndarray:
    """Return a random walk inside the joint ranges that starts anywhere."""
    middle = 0.5 * (model.lower + model.upper)
    spread = 0.4 * (model.upper - model.lower)
    theta = middle + spread * np.tanh(np.cumsum(wander * rng.normal(size=(frames, model.n)), axis=0) + rng.normal())
    turn = se3.exp(rng.normal(size=3) + np.cumsum(wander * rng.normal(size=(frames, 3)), axis=0))
    place = np.array([0.0, 0.0, 0.7]) + np.cumsum(wander * rng.normal(size=(frames, 3)), axis=0)
    return np.concatenate([place, turn, theta], axis=1)


def random_rotations(frames: int, rng: np.random.Generator) -> np.ndarray:
    return se3.quat_to_matrix(se3.exp(rng.normal(size=(frames, 3)))).transpose(1, 2, 0)


def one_term_per_file(model: RobotModel, frames: int, rng: np.random.Generator) -> dict[str, Term]:
    """Return, by file name, a term with random references and weights that vary over time."""
    vectors = rng.normal(size=(3, frames))
    weights = rng.uniform(0.0, 3.0, size=frames)
    corners = tuple(f"left_sole_{corner}" for corner in ("heel_inner", "heel_outer", "toe_inner", "toe_outer"))
    return {
        "site_position": SitePosition("t", "left_palm", vectors, weights),
        "site_rotation": SiteRotation("t", "right_palm", random_rotations(frames, rng), weights),
        "object_contact": ObjectContact(
            "t", "left_palm", vectors, rng.normal(size=(3, frames)), random_rotations(frames, rng), weights
        ),
        "site_height": SiteHeight("t", "right_foot", vectors[0], weights),
        "floor_clearance": FloorClearance("t", corners, 2.0, 2.0),
        "posture": Posture("t", rng.normal(size=(model.n, frames)), 1.7),
        "relative_rotation": RelativeRotation("t", "torso", random_rotations(frames, rng), 0.6),
        "differences": Differences("t", 3, 4.0),
    }
