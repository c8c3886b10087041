"""A relaxed standing pose of a robot, from its sites: slightly bent knees, hanging arms with bent elbows."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from hoi_retarget.numerics import se3
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.spec import SIDES

_KNEE, _ELBOW, _ARM_OUT, _ARM_AHEAD = 0.15, 0.47, 0.2, 0.15
"""Of thigh and shank against the vertical, of the forearm below the horizontal, of arms outwards and ahead [rad]."""
_WEIGHTS = {"wrist": 0.3, "elbow": 0.7, "foot": 2.0}
_ZERO_WEIGHT = 0.01
_RANGE_MARGIN = 1e-3  # [rad]
_STEP = 1e-6  # Of finite differences [rad].
_MORE_STARTS, _SUFFICIENT_DEG = 6, 2.0


@dataclass(frozen=True)
class HomePose:
    """Joint angles, and the distance of each site from its goal."""

    angles: Mapping[str, float]  # [rad]
    missed_deg: Mapping[str, float]


def home_goals() -> dict[str, Float[np.ndarray, "3 3"]]:
    """Return the rotations of the sites in the home pose, in axes ahead, left, up."""
    goals = {"pelvis": np.eye(3), "torso": np.eye(3)}
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        arm = _turn(sign * _ARM_OUT, 0.0) @ _turn(0.0, _ARM_AHEAD)
        fore = _turn(sign * _ARM_OUT, 0.0) @ _turn(0.0, _ARM_AHEAD + np.pi / 2 - _ELBOW)
        goals |= {
            f"{side}_hip": _turn(0.0, -_KNEE),
            f"{side}_knee": _turn(0.0, _KNEE),
            f"{side}_foot": np.eye(3),
            f"{side}_shoulder": arm,
            f"{side}_elbow": fore,
            f"{side}_wrist": fore,
        }
    return goals


def solve_home(model: RobotModel) -> HomePose:
    """Return the pose nearest to the goals within a robot's ranges."""
    lower, upper = model.lower + _RANGE_MARGIN, model.upper - _RANGE_MARGIN
    narrow = upper <= lower
    middle = 0.5 * (model.lower + model.upper)
    lower, upper = np.where(narrow, middle - 1e-9, lower), np.where(narrow, middle + 1e-9, upper)
    goals = home_goals()

    def residuals(angles: np.ndarray) -> np.ndarray:
        return _residuals(model, goals, angles[None])[0]

    def jacobian(angles: np.ndarray) -> np.ndarray:
        moved = np.concatenate([angles[None], angles + _STEP * np.eye(model.n)])
        values = _residuals(model, goals, moved)
        return ((values[1:] - values[0]) / _STEP).T

    def solved(start: np.ndarray) -> tuple[float, np.ndarray]:
        inside = np.clip(start, lower + 1e-10, upper - 1e-10)
        found = least_squares(residuals, inside, jac=jacobian, bounds=(lower, upper))  # pyright: ignore[reportArgumentType]  # scipy's types
        return float(found.cost), found.x

    best = min((solved(start) for start in (np.zeros(model.n), middle)), key=lambda one: one[0])
    # Limbs that are stretched or turned half around in the zero pose may need another way.
    random = np.random.default_rng(0)
    for _ in range(_MORE_STARTS):
        if max(_missed(model, goals, best[1]).values()) < _SUFFICIENT_DEG:
            break
        best = min(best, solved(random.uniform(lower, upper)), key=lambda one: one[0])
    angles = np.clip(best[1], lower, upper)
    return HomePose(dict(zip(model.joint_names, angles.tolist(), strict=True)), _missed(model, goals, angles))


def _missed(model: RobotModel, goals: Mapping[str, np.ndarray], angles: Float[np.ndarray, "n"]) -> dict[str, float]:
    kinematics = _posed(model, angles[None])
    return {
        site: float(np.degrees(se3.matrix_angle_between(kinematics.site_rotation(site), goal[None])[0]))
        for site, goal in goals.items()
    }


def standing_height(model: RobotModel) -> float:
    """Return the root's height in the home pose when the soles are on the floor [m]."""
    standing = model.forward(model.home_qpos[None])
    corners = [name for name in model.site_names if "_sole_" in name]
    lowest = min(float(standing.site_position(name)[0, 2]) for name in corners)
    return float(model.home_qpos[2]) - lowest


def _residuals(model: RobotModel, goals: Mapping[str, np.ndarray], angles: Float[np.ndarray, "T n"]) -> np.ndarray:
    kinematics = _posed(model, angles)
    rows = [
        _WEIGHTS.get(site.split("_")[-1], 1.0) * (kinematics.site_rotation(site) - goal).reshape(len(angles), 9)
        for site, goal in goals.items()
    ]
    return np.concatenate([*rows, _ZERO_WEIGHT * angles], axis=1)


def _posed(model: RobotModel, angles: Float[np.ndarray, "T n"]) -> Kinematics:
    root = np.tile(model.home_qpos[:7], (len(angles), 1))
    return model.forward(np.concatenate([root, angles], axis=1))


def _turn(about_ahead: float, about_left: float) -> Float[np.ndarray, "3 3"]:
    return se3.quat_to_matrix(se3.exp(np.array([about_ahead, 0.0, 0.0]))) @ se3.quat_to_matrix(
        se3.exp(np.array([0.0, about_left, 0.0]))
    )
