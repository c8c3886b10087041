"""How far states are from a reference, as one number each: what sampled motions are judged by.

Squares of deviations, weighted: of joints, base, head, feet and palms; of the capture point, which is the centre of
mass and its velocity over the pendulum's frequency; of objects; and of hands as the objects see them, where they are
labelled to touch. What an object may cost is limited: for an object that is lost, no robot should fall.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3
from hoi_retarget.physics.mass_centre import mass_centres
from hoi_retarget.physics.needs import GRAVITY
from hoi_retarget.physics.reference import Reference
from hoi_retarget.physics.rollout import FALLEN
from hoi_retarget.physics.scene import Scene
from hoi_retarget.robots.spec import SIDES

_BASE, _BASE_TURN, _TURNING, _JOINT, _JOINT_SPEED = 10.0, 2.0, 0.05, 0.3, 0.006  # [1/m^2], [1/rad^2], [s^2/rad^2]
_OBJECT, _OBJECT_TURN, _OBJECT_SPEED = 60.0, 3.0, 0.3
_PLACES = {"head": 15.0} | {f"{side}_foot": 10.0 for side in SIDES} | {f"{side}_palm": 3.0 for side in SIDES}
_TILT = 1.0  # Of a foot's axis, a unit vector.
_CAPTURE = 15.0
_TOUCH, _SPAN = 30.0, 0.2  # Of three points so far from a link [m], in the frame of the object that it touches.
LOST = 8.0
"""Most that an object costs, reached in the limit: half of it when it is 26 cm off hands that stay in place."""
_FALLING = 50.0
_MOMENT = 1e-4  # [s]


@dataclass(frozen=True, eq=False)
class _Postures:
    """What is compared, of N states."""

    places: Float[np.ndarray, "N P 3"]
    tilts: Float[np.ndarray, "N 2 3"]
    """Up-axes of the feet."""
    capture: Float[np.ndarray, "N 2"]
    touching: Float[np.ndarray, "N C 3 3"]
    """Three points on the axes of each link that may touch, in the world: its place and how it is turned."""


class TrackingCost:
    """The cost of states at the ticks of one reference."""

    def __init__(self, scene: Scene, reference: Reference, *, lost: float = LOST) -> None:
        self._lost = lost
        self._model, self._reference, self._n = scene.model, reference, scene.model.n
        heights = mass_centres(scene.model.forward(reference.qpos[:, : 7 + self._n]))[:, 2]
        self._pendulum = np.sqrt(GRAVITY / np.median(heights))
        self._goals = self._postures(reference.qpos, reference.qvel)
        self._weights = np.array(list(_PLACES.values()))
        self._touched = [self._object(reference.qpos, index) for index in range(len(scene.objects))]

    def __call__(
        self, tick: int, qpos: Float[np.ndarray, "N nq"], qvel: Float[np.ndarray, "N nv"]
    ) -> Float[np.ndarray, "N"]:
        """Return the cost of states at a tick of the reference; infinite where numbers are not finite."""
        finite = np.isfinite(qpos).all(axis=1) & np.isfinite(qvel).all(axis=1)
        cost = np.full(len(qpos), np.inf)
        if finite.any():
            cost[finite] = self._finite(tick, qpos[finite], qvel[finite])
        return cost

    def _finite(self, tick: int, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        n, goals, wanted, wanted_speed = self._n, self._goals, self._reference.qpos[tick], self._reference.qvel[tick]
        found = self._postures(qpos, qvel)
        joints, speeds = slice(7, 7 + n), slice(6, 6 + n)
        cost = _JOINT * _squares(qpos[:, joints] - wanted[joints])
        cost += _JOINT_SPEED * _squares(qvel[:, speeds] - wanted_speed[speeds])
        cost += _BASE * _squares(qpos[:, :3] - wanted[:3])
        cost += _BASE_TURN * se3.angle_between(wanted[None, 3:7], qpos[:, 3:7]) ** 2
        cost += _TURNING * _squares(qvel[:, 3:6] - wanted_speed[3:6])
        cost += ((found.places - goals.places[tick]) ** 2).sum(axis=2) @ self._weights
        cost += _TILT * _squares((found.tilts - goals.tilts[tick]).reshape(len(qpos), -1))
        cost += _CAPTURE * _squares(found.capture - goals.capture[tick])
        for index, path in enumerate(self._touched):
            at, moving = slice(7 + n + 7 * index, 14 + n + 7 * index), slice(6 + n + 6 * index, 9 + n + 6 * index)
            pose, goal = qpos[:, at], path[tick]
            lost = _OBJECT * _squares(pose[:, :3] - goal[:3])
            lost += _OBJECT_TURN * se3.angle_between(goal[None, 3:], pose[:, 3:]) ** 2
            lost += _OBJECT_SPEED * _squares(qvel[:, moving] - wanted_speed[moving])
            touching = self._reference.touched[tick] == index
            here = se3.rotate_inverse(pose[:, None, None, 3:], found.touching[:, touching] - pose[:, None, None, :3])
            there = se3.rotate_inverse(goal[3:], goals.touching[tick, touching] - goal[:3])
            lost += _TOUCH / 3.0 * _squares((here - there).reshape(len(qpos), -1))
            cost += self._lost * lost / (self._lost + lost)
        return cost + _FALLING * (qpos[:, 2] < FALLEN * wanted[2])

    def _postures(self, qpos: np.ndarray, qvel: np.ndarray) -> _Postures:
        n = self._n
        kinematics = self._model.forward(qpos[:, : 7 + n])
        later = self._model.forward(self._model.integrate(qpos[:, : 7 + n], _MOMENT * qvel[:, : 6 + n]))
        centres = mass_centres(kinematics)
        capture = centres + (mass_centres(later) - centres) / (_MOMENT * self._pendulum)
        places = [kinematics.point(name) for name in _PLACES]
        tilts = [kinematics.orientation(f"{side}_foot")[:, 2] for side in SIDES]
        spans = [
            kinematics.point(name)[:, None] + _SPAN * kinematics.orientation(name) for name in self._reference.links
        ]
        touching = np.stack(spans).transpose(3, 0, 2, 1) if spans else np.zeros((len(qpos), 0, 3, 3))
        return _Postures(
            np.stack(places).transpose(2, 0, 1), np.stack(tilts).transpose(2, 0, 1), capture[:, :2], touching
        )

    def _object(self, qpos: np.ndarray, index: int) -> np.ndarray:
        return qpos[:, 7 + self._n + 7 * index :][:, :7]


def _squares(apart: np.ndarray) -> np.ndarray:
    return np.einsum("ni,ni->n", apart, apart)
