"""Depenetration: paths out of an object for links deep inside it, along one direction each over time.

The nearest surface of a rod or a board changes sides from frame to frame, and a solve that follows it ends between
the sides. The human's limb stayed on one side: a robot's link goes there.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Bool, Float, Int

from hoi_retarget.human.skeleton import LIMBS
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.numerics.filters import seconds_to_frames, smoothstep_around
from hoi_retarget.retargeting.surfaces.skin_points import LinkAtObject, MovingObject, hinge_rows, levers
from hoi_retarget.retargeting.trajopt.problem import FrameRows
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.skin import LinkSkin, Skin, skin_of

MIN_DEPTH_M = 0.006  # [m]; less deep links leave without a path.
MAX_ESCAPE_M, MIN_STEP_M = 0.12, 0.004  # Length of a path, and of one step of the search for it.
AROUND_SECONDS = 0.4  # A path begins and ends so long before and after the link is deep.
SIDE_SECONDS, SMOOTHING_SECONDS = 0.3, 0.15
NEXT_TO_BODY = 0.25
"""Share of a human's limb, from its beginning, that decides the side: a caught limb must be able to go back."""
WHOLE_RUN = 0.02  # Weight of the whole run in the side of each of its frames.
STRIDE_SECONDS = 0.1
EARLIER = 1e3  # Weight of a side that was chosen before.
PEAK_SECONDS = 0.3  # A path is as long as the longest one within this time.
TAKEN_SECONDS = 0.15  # Before and after contact a path's weight grows from nothing over this time.


@dataclass(frozen=True, eq=False)
class EscapePath:
    """Hinge that moves a link along one direction in each frame, until no part of an object is inside it [m^2]."""

    name: str
    link: str
    object_index: int  # Index of the object.
    skin: LinkSkin
    frames: Int[np.ndarray, "F"]
    points: Float[np.ndarray, "3 1 F"]  # The link's deepest point, in its frame [m].
    sides: Float[np.ndarray, "3 F"]  # Directions of the path, in the object's frame.
    outward: Float[np.ndarray, "3 1 F"]  # The same in world axes.
    goals: Float[np.ndarray, "1 F"]  # Coordinate of the point along them at the end of the path [m].
    weights: Float[np.ndarray, "F"]  # [1/m^2]

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return one row a frame."""
        lever = levers(kinematics, self.skin.frame, self.points, self.frames)
        points = kinematics.point(self.skin.frame)[:, None, self.frames] + lever
        left = (self.outward * points).sum(axis=0) - self.goals
        return (hinge_rows(self.skin.frame, lever, left, self.outward, 0.0, self.weights, self.frames),)

    def window(self, start: int, stop: int) -> "EscapePath":
        """Return the part of the path in some consecutive frames."""
        inside = (self.frames >= start) & (self.frames < stop)
        return replace(
            self,
            frames=self.frames[inside] - start,
            points=self.points[..., inside],
            sides=self.sides[:, inside],
            outward=self.outward[..., inside],
            goals=self.goals[:, inside],
            weights=self.weights[inside],
        )


def escape_paths(  # noqa: PLR0913, PLR0917  # the parts of a path
    objects: tuple[MovingObject, ...],
    limbs: Float[np.ndarray, "T O L 2 3"],
    skin: Skin,
    touching: Mapping[str, Bool[np.ndarray, "T"]],
    start: Kinematics,
    earlier: Sequence[EscapePath],
    weight: float,
    fps: float,
) -> tuple[EscapePath, ...]:
    """Return a path for each link and run of frames in which an object is deep in it.

    Args: `objects`: obstacles of the links; `limbs`: the human's limbs in the objects' frames [m]; `skin`: of the links
    that may leave; `touching`: frames in which a link touches, and stays, by its name; `start`: trajectory that a solve
    starts from; `earlier`: paths of previous solves, which keep their sides; `weight`: [1/m^2]; `fps`: frames a second.
    """
    of_link, never = limb_of_link(start.model), np.zeros(len(start.qpos), dtype=bool)
    return tuple(
        path
        for index, moving_object in enumerate(objects)
        for link in skin.links
        for path in _PenetratedLink(
            link, moving_object, start, index, limbs[:, index, of_link[link.link]], touching.get(link.link, never), fps
        ).paths(earlier, weight)
    )


def paths_within(paths: Sequence[EscapePath], start: int, stop: int) -> tuple[EscapePath, ...]:
    """Return the parts of some paths in consecutive frames."""
    return tuple(part for part in (path.window(start, stop) for path in paths) if part.frames.size)


@lru_cache(maxsize=8)
def limb_of_link(model: RobotModel) -> dict[str, int]:
    """Return which of the human's limbs each link of a robot stands for: the nearest one in the home pose."""
    standing = model.forward(model.home_qpos[None])
    ends = np.array([[standing.point(_site_of(joint))[:, 0] for joint in limb] for limb in LIMBS])
    middles = {skin.link: standing.point(skin.middle)[:, 0] for skin in skin_of(model).links}
    return {link: int(np.linalg.norm(_beside(ends, middle), axis=1).argmin()) for link, middle in middles.items()}


def _site_of(joint: str) -> str:
    return {"neck": "head"}.get(joint, joint.replace("foot", "toe").replace("ankle", "foot"))


def _beside(
    limbs: Float[np.ndarray, "*limbs 2 3"], points: Float[np.ndarray, "*points 3"]
) -> Float[np.ndarray, "many 3"]:
    """Return the vectors [m] from points to the nearest points of straight limbs."""
    start, along = limbs[..., 0, :], limbs[..., 1, :] - limbs[..., 0, :]
    share = ((points - start) * along).sum(axis=-1) / np.maximum((along**2).sum(axis=-1), 1e-12)
    return start + np.clip(share, 0.0, 1.0)[..., None] * along - points


@dataclass(frozen=True, eq=False)
class _PenetratedLink(LinkAtObject):
    """One link near one object."""

    index: int
    limb: Float[np.ndarray, "T 2 3"]
    touching: Bool[np.ndarray, "T"]
    fps: float

    def paths(self, earlier: Sequence[EscapePath], weight: float) -> Iterator[EscapePath]:
        """Yield a path for each run of frames in which the object is deep in the link, or nearly."""
        last, stride = len(self.limb) - 1, seconds_to_frames(STRIDE_SECONDS, self.fps)
        keys = np.unique(np.append(np.arange(0, last, stride), last))
        depths, sides = self._depths_and_sides(keys)
        depths[self.touching[keys]] = 0.0
        if depths.max() < MIN_DEPTH_M:
            return
        for path in earlier:
            if (path.link, path.object_index) == (self.skin.link, self.index):
                _, at, of = np.intersect1d(keys, path.frames, return_indices=True)
                sides[at] = EARLIER * path.sides[:, of].T
        around = scipy.ndimage.binary_dilation(
            depths >= MIN_DEPTH_M, iterations=seconds_to_frames(AROUND_SECONDS, self.fps / stride)
        )
        for first, stop in runs(around & ~self.touching[keys]):
            yield self._way(keys[first:stop], sides[first:stop], weight)

    def _way(self, keys: Int[np.ndarray, "K"], sides: Float[np.ndarray, "K 3"], weight: float) -> EscapePath:
        rate = 1 / STRIDE_SECONDS
        mean = scipy.ndimage.gaussian_filter1d(
            sides, SIDE_SECONDS * rate, axis=0, mode="nearest"
        ) + WHOLE_RUN * sides.sum(axis=0)
        mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
        samples = self.moving_object.samples
        lengths, deepest = samples.ways_out(self.poses(keys), mean, MAX_ESCAPE_M, MIN_STEP_M)
        lengths = scipy.ndimage.maximum_filter1d(lengths, seconds_to_frames(PEAK_SECONDS, rate))
        frames = np.arange(keys[0], keys[-1] + 1)
        sides = np.stack([np.interp(frames, keys, along) for along in mean.T])
        outward = np.einsum("ijt,jt->it", self.moving_object.rotation[:, :, frames], sides)[:, None]
        points = deepest[np.searchsorted(keys, frames)].T[:, None]
        begin = self.start.point(self.skin.frame)[:, None, frames] + levers(self.start, self.skin.frame, points, frames)
        way = scipy.ndimage.gaussian_filter1d(
            np.interp(frames, keys, lengths), SMOOTHING_SECONDS * self.fps, mode="nearest"
        )
        goals = (outward * begin).sum(axis=0) + way
        name = f"{self.skin.link}_{self.moving_object.name}_{keys[0]}_way_out"
        ramp = 1.0 - smoothstep_around(self.touching, seconds_to_frames(TAKEN_SECONDS, self.fps))[frames]
        return EscapePath(
            name, self.skin.link, self.index, self.skin, frames, points, sides, outward, goals, weight * ramp
        )

    def _depths_and_sides(self, keys: Int[np.ndarray, "K"]) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K 3"]]:
        """Return the object's depth in the link [m], and the vector from its points inside to the human's limb."""
        depths, sides = np.zeros(len(keys)), np.zeros((len(keys), 3))
        near = np.flatnonzero(np.abs(self.around[keys]) < self.skin.radius)
        poses = self.poses(keys[near])
        least = self.moving_object.samples.least_distances(poses)
        for key, pose in zip(near[least < 0.0].tolist(), np.flatnonzero(least < 0.0).tolist(), strict=True):
            samples, seen = self.moving_object.samples.around(poses, pose)
            distances = self.skin.solid.distances(seen)
            inside = distances < 0
            depths[key] = -distances.min()
            start, end = self.limb[keys[key]]
            beside = _beside(np.stack([start, start + NEXT_TO_BODY * (end - start)]), samples[inside])
            beside /= np.maximum(np.linalg.norm(beside, axis=1, keepdims=True), 1e-9)
            sides[key] = -distances[inside] @ beside
        return depths, sides
