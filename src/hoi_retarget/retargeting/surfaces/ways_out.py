"""Ways out of an object for links deep inside it: one direction each, kept over time.

The nearest way out of a rod or a board changes sides from frame to frame, and a solve that follows it ends between
the sides. The human's limb was on one side all the time: a robot's link goes there.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import binary_dilation, gaussian_filter1d, maximum_filter1d

from hoi_retarget.human.skeleton import LIMBS
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.numerics.filters import frames_in
from hoi_retarget.retargeting.surfaces.link_points import hinge_rows, levers
from hoi_retarget.retargeting.surfaces.moving_object import MovingObject
from hoi_retarget.retargeting.trajopt.rows import FrameRows
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.skin import LinkSkin, Skin, skin_of

DEEP = 0.006
"""[m]; links that are less deep find out by themselves."""
FURTHEST, SHORTEST_STEP = 0.12, 0.004
"""[m] of a way, and of a step on it."""
AROUND_SECONDS = 0.4
"""A way begins and ends so long before and after the link is deep."""
SIDE_SECONDS, SMOOTHING_SECONDS = 0.3, 0.15
NEXT_TO_BODY = 0.25
"""Share of a human's limb that shows the side, where it begins: a limb that is caught goes back, too."""
WHOLE_RUN = 0.02
"""Share of the whole run in the side of each of its frames."""
STRIDE_SECONDS = 0.1
EARLIER = 1e3
"""Weight of a side that was chosen before."""
PEAK_SECONDS = 0.3
"""A way is as long as the longest one within this time."""


@dataclass(frozen=True, eq=False)
class WayOut:
    """Hinge of a link's way along one direction in each frame, up to where nothing of an object is inside it [m^2]."""

    name: str
    link: str
    thing: int
    """Index of the object."""
    skin: LinkSkin
    frames: Int[np.ndarray, "F"]
    points: Float[np.ndarray, "3 1 F"]
    """The link's deepest point, in its frame [m]."""
    sides: Float[np.ndarray, "3 F"]
    """Directions of the way, in the object's frame."""
    outward: Float[np.ndarray, "3 1 F"]
    """The same in world axes."""
    goals: Float[np.ndarray, "1 F"]
    """How far along them the point is at the end of the way [m]."""
    weight: float
    """[1/m^2]"""

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return one row a frame."""
        lever = levers(kinematics, self.skin.frame, self.points, self.frames)
        points = kinematics.point(self.skin.frame)[:, None, self.frames] + lever
        left = (self.outward * points).sum(axis=0) - self.goals
        return (hinge_rows(self.skin.frame, lever, left, self.outward, 0.0, self.weight, self.frames),)

    def window(self, start: int, stop: int) -> "WayOut":
        """Return what of it is in some consecutive frames."""
        kept = (self.frames >= start) & (self.frames < stop)
        return replace(
            self,
            frames=self.frames[kept] - start,
            points=self.points[..., kept],
            sides=self.sides[:, kept],
            outward=self.outward[..., kept],
            goals=self.goals[:, kept],
        )


def ways_out(  # noqa: PLR0913, PLR0917 - what decides a way
    objects: tuple[MovingObject, ...],
    limbs: Float[np.ndarray, "T O L 2 3"],
    skin: Skin,
    start: Kinematics,
    earlier: Sequence[WayOut],
    weight: float,
    fps: float,
) -> tuple[WayOut, ...]:
    """Return a way out for each link and run of frames in which an object is deep in it.

    Args:
        objects: What links are inside of.
        limbs: The human's limbs in the objects' frames [m].
        skin: Of the links that are looked at.
        start: Trajectory that a solve starts from.
        earlier: Ways of solves before: they keep their sides.
        weight: [1/m^2]
        fps: Frames a second.
    """
    of_link = limb_of_link(start.model)
    return tuple(
        way
        for index, thing in enumerate(objects)
        for link in skin.links
        for way in _Sunk(index, thing, link, start, limbs[:, index, of_link[link.link]], fps).ways(earlier, weight)
    )


def windows_of(ways: Sequence[WayOut], start: int, stop: int) -> tuple[WayOut, ...]:
    """Return what of some ways is in consecutive frames."""
    return tuple(way for way in (each.window(start, stop) for each in ways) if way.frames.size)


@lru_cache(maxsize=8)
def limb_of_link(model: RobotModel) -> dict[str, int]:
    """Return which of the human's limbs each link of a robot stands for: the nearest one in the home pose."""
    standing = model.forward(model.home_qpos[None])
    ends = np.array([[standing.point(_site_of(joint))[:, 0] for joint in limb] for limb in LIMBS])
    middles = {skin.link: standing.point(skin.frame.of(skin.centre, np.eye(3)))[:, 0] for skin in skin_of(model).links}
    return {link: int(np.linalg.norm(_beside(ends, middle), axis=1).argmin()) for link, middle in middles.items()}


def _site_of(joint: str) -> str:
    return {"neck": "head"}.get(joint, joint.replace("foot", "toe").replace("ankle", "foot"))


def _beside(
    limbs: Float[np.ndarray, "*limbs 2 3"], points: Float[np.ndarray, "*points 3"]
) -> Float[np.ndarray, "many 3"]:
    """Return the way [m] from points to the nearest ones of straight limbs."""
    start, along = limbs[..., 0, :], limbs[..., 1, :] - limbs[..., 0, :]
    share = ((points - start) * along).sum(axis=-1) / np.maximum((along**2).sum(axis=-1), 1e-12)
    return start + np.clip(share, 0.0, 1.0)[..., None] * along - points


@dataclass(frozen=True, eq=False)
class _Sunk:
    """One link beside one object, looked at in some frames."""

    index: int
    thing: MovingObject
    skin: LinkSkin
    start: Kinematics
    limb: Float[np.ndarray, "T 2 3"]
    fps: float

    def ways(self, earlier: Sequence[WayOut], weight: float) -> Iterator[WayOut]:
        """Yield a way for each run of frames in which the object is deep in the link, or nearly."""
        last, stride = len(self.limb) - 1, frames_in(STRIDE_SECONDS, self.fps)
        keys = np.unique(np.append(np.arange(0, last, stride), last))
        depths, sides = self._depths_and_sides(keys)
        if depths.max() < DEEP:
            return
        for way in earlier:
            if (way.link, way.thing) == (self.skin.link, self.index):
                _, at, of = np.intersect1d(keys, way.frames, return_indices=True)
                sides[at] = EARLIER * way.sides[:, of].T
        around = binary_dilation(depths >= DEEP, iterations=frames_in(AROUND_SECONDS, self.fps / stride))
        for first, stop in runs(around):
            yield self._way(keys[first:stop], sides[first:stop], weight)

    def _way(self, keys: Int[np.ndarray, "K"], sides: Float[np.ndarray, "K 3"], weight: float) -> WayOut:
        rate = 1 / STRIDE_SECONDS
        mean = gaussian_filter1d(sides, SIDE_SECONDS * rate, axis=0, mode="nearest") + WHOLE_RUN * sides.sum(axis=0)
        mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
        found = [self._to_the_end(frame, side) for frame, side in zip(keys.tolist(), mean, strict=True)]
        lengths = maximum_filter1d([length for length, _ in found], frames_in(PEAK_SECONDS, rate))
        frames = np.arange(keys[0], keys[-1] + 1)
        sides = np.stack([np.interp(frames, keys, along) for along in mean.T])
        outward = np.einsum("ijt,jt->it", self.thing.rotation[:, :, frames], sides)[:, None]
        points = np.array([point for _, point in found])[np.searchsorted(keys, frames)].T[:, None]
        begin = self.start.point(self.skin.frame)[:, None, frames] + levers(self.start, self.skin.frame, points, frames)
        way = gaussian_filter1d(np.interp(frames, keys, lengths), SMOOTHING_SECONDS * self.fps, mode="nearest")
        goals = (outward * begin).sum(axis=0) + way
        name = f"{self.skin.link}_{self.thing.name}_{keys[0]}_way_out"
        return WayOut(name, self.skin.link, self.index, self.skin, frames, points, sides, outward, goals, weight)

    def _depths_and_sides(self, keys: Int[np.ndarray, "K"]) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K 3"]]:
        """Return how deep the object is in the link [m], and the way from what is inside to the human's limb."""
        depths, sides = np.zeros(len(keys)), np.zeros((len(keys), 3))
        near = np.abs(self.thing.distances(self._centres)[keys]) < self.skin.radius
        for key in np.flatnonzero(near).tolist():
            frame = int(keys[key])
            samples, seen = self._samples(frame, 0.0)
            distances = self.skin.solid.distances(seen)
            inside = distances < 0
            if inside.any():
                depths[key] = -distances.min()
                beside = _beside(self._beginning(frame), samples[inside])
                beside /= np.maximum(np.linalg.norm(beside, axis=1, keepdims=True), 1e-9)
                sides[key] = -distances[inside] @ beside
        return depths, sides

    def _beginning(self, frame: int) -> Float[np.ndarray, "2 3"]:
        """Return the part of the human's limb that shows the side [m]."""
        start, end = self.limb[frame]
        return np.stack([start, start + NEXT_TO_BODY * (end - start)])

    def _to_the_end(self, frame: int, side: Float[np.ndarray, "3"]) -> tuple[float, Float[np.ndarray, "3"]]:
        """Return how far the link has to go until nothing is inside it [m], and its deepest point at the start."""
        _, seen = self._samples(frame, FURTHEST)
        back = self._turn(frame).T @ side
        distances = self.skin.solid.distances(seen)
        deepest, way = seen[distances.argmin()] if len(seen) else self.skin.centre, 0.0
        seen = seen[distances < FURTHEST]
        while len(seen) and way < FURTHEST and (depth := -self.skin.solid.distances(seen - way * back).min()) > 0:
            way += max(depth, SHORTEST_STEP)
        return min(way, FURTHEST), deepest

    @cached_property
    def _centres(self) -> Float[np.ndarray, "3 T"]:
        """The middle of the link in the object's frame [m]."""
        centre = self.start.point(self.skin.frame.of(self.skin.centre, np.eye(3)))
        return self.thing.inside(centre[:, None], np.arange(centre.shape[1]))[:, 0]

    def _turn(self, frame: int) -> Float[np.ndarray, "3 3"]:
        return self.thing.rotation[:, :, frame].T @ self.start.orientation(self.skin.frame)[:, :, frame]

    def _samples(self, frame: int, beyond: float) -> tuple[Float[np.ndarray, "N 3"], Float[np.ndarray, "N 3"]]:
        """Return the object's samples around the link, in the object's frame and in the link's [m]."""
        centre = self._centres[:, frame]
        samples = np.asarray(self.thing.samples.data)[
            self.thing.samples.query_ball_point(centre, self.skin.radius + beyond)
        ]
        # The link's origin is where its middle is, less the lever between them.
        return samples, (samples - centre) @ self._turn(frame) + self.skin.centre
