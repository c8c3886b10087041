"""A robot's hand as one rigid body, and poses of it."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float, Int

from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.skin import LinkSkin, palmar_points, pose_at_home, skin_of, skins_from

OUTER_POINTS, WRIST_POINTS, PALMAR_POINTS = 220, 60, 110
"""Of the coarse skins: of the whole hand, of the link that carries it, and of the palmar side."""
PALM_RADIUS = 0.06  # [m]; palmar skin that far from the palm's middle counts less by a factor of 0.6.


@dataclass(frozen=True, eq=False)
class HandPart:
    """One link of a hand."""

    skin: LinkSkin
    rotation: Float[np.ndarray, "3 3"]  # Of the link in the palm's frame.
    origin: Float[np.ndarray, "3"]  # [m]


@dataclass(frozen=True, eq=False)
class HandShape:
    """A hand in the frame of its palm site, with fingers and wrist as in the home pose."""

    site: str
    outer: Float[np.ndarray, "P 3"]  # Points of its skin and of the wrist's [m].
    palmar: Float[np.ndarray, "Q 3"]  # Points of its palmar side [m].
    areas: Float[np.ndarray, "Q"]  # Of the skin that each of these stands for [m^2].
    inward: Float[np.ndarray, "3"]  # Direction in which the palm faces.
    parts: tuple[HandPart, ...]

    @property
    def draws(self) -> Float[np.ndarray, "Q"]:
        """Areas that count less far from the palm's middle [m^2]."""
        return self.areas * np.exp(-0.5 * np.einsum("qi,qi->q", self.palmar, self.palmar) / PALM_RADIUS**2)


@dataclass(frozen=True, eq=False)
class HandPoses:
    """Poses of a palm in an object's frame."""

    positions: Float[np.ndarray, "N 3"]  # [m]
    rotations: Float[np.ndarray, "N 3 3"]

    def placed(self, points: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "N K 3"]:
        """Return points of the palm's frame in the object's [m]."""
        return points @ self.rotations.transpose(0, 2, 1) + self.positions[:, None]

    def moved(self, twists: Float[np.ndarray, "N 6"]) -> "HandPoses":
        """Return the poses after a shift [m] and a turn [rad] of each, in the object's axes."""
        turns = se3.quat_to_matrix(se3.exp(twists[:, 3:]))
        return HandPoses(self.positions + twists[:, :3], turns @ self.rotations)

    def away_from(self, others: "HandPoses") -> Float[np.ndarray, "N 6"]:
        """Return the shift [m] and turn [rad] of each from one other pose, or as many, in the object's axes."""
        turned = se3.log(se3.matrix_to_quat(self.rotations @ others.rotations.transpose(0, 2, 1)))
        return np.concatenate([self.positions - others.positions, turned], axis=1)

    def take(self, chosen: Int[np.ndarray, "M"]) -> "HandPoses":
        """Return some of the poses."""
        return HandPoses(self.positions[chosen], self.rotations[chosen])


@lru_cache(maxsize=16)
def hand_shape(model: RobotModel, site: str) -> HandShape:
    """Return the shape of the hand at a palm site; raises as `skin_of`."""

    def part(skin: LinkSkin) -> HandPart:
        return HandPart(skin, *map(frozen, pose_at_home(model, site, skin.frame)))

    parts = tuple(part(skin) for skin in skins_from(model, site))
    wrist = int(model.parents[min(item.skin.frame.node for item in parts) - 1])
    shares = [(item, OUTER_POINTS // len(parts)) for item in parts]
    shares += [(part(skin), WRIST_POINTS) for skin in skin_of(model).links if skin.frame.node == wrist]
    outer = [item.skin.points[:count] @ item.rotation.T + item.origin for item, count in shares]
    chosen = [palmar_points(model, site, item.skin) for item in parts]
    palmar = np.concatenate(
        [item.skin.points[at] @ item.rotation.T + item.origin for item, at in zip(parts, chosen, strict=True)]
    )
    areas = np.concatenate([item.skin.areas[at] for item, at in zip(parts, chosen, strict=True)])
    # Skin is in farthest-point order: the first points are spread; each stands for those that are nearest to it.
    kept = palmar[:PALMAR_POINTS]
    areas = np.bincount(scipy.spatial.KDTree(kept).query(palmar)[1], areas, minlength=len(kept))
    inward = np.array([0.0, -1.0 if site.startswith("left") else 1.0, 0.0])
    return HandShape(site, frozen(np.concatenate(outer)), frozen(kept), frozen(areas), frozen(inward), parts)
