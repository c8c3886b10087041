"""The choice of one hold for each episode of a hand on an object.

The best few candidates of all episodes are chosen together, by what the object's motion needs and all hands on it can
give.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.dynamics.object_support import ObjectLoad, object_load
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.motion.motion_report import HoldNote
from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.holds.episodes import Episode
from hoi_retarget.retargeting.holds.hand_shape import hand_shape
from hoi_retarget.retargeting.holds.hold_candidates import Finalists, PersonHold, finalists
from hoi_retarget.retargeting.surfaces.skin_points import MovingObject
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.robots.model import Kinematics

BEARABLE_SHARE = 0.05
"""Of an object's weight: hands that lack no more than that hold it."""
MISSING_COST = 10.0
"""Of an object's weight that is missing."""
SWEEPS = 2


@dataclass(frozen=True, eq=False)
class Hold:
    """The pose of a palm on an object during an episode, in the object's frame."""

    episode: Episode
    position: Float[np.ndarray, "3"]
    """[m]"""
    rotation: Float[np.ndarray, "3 3"]
    person_position: Float[np.ndarray, "3"]
    """Middle of the person's palm in the episode [m]."""
    person_rotation: Float[np.ndarray, "3 3"]
    frames: Int[np.ndarray, "F"]
    """Some of the episode, in which the reach was looked at,"""
    off: Float[np.ndarray, "F"]
    """and how far off the arm ends there, with the body as in inverse kinematics [m]."""
    area: float
    """Palmar skin that touches [m^2]."""
    missing_share: float
    """Of the object's weight, with all hands on it: mean over some of the episode's frames."""

    @property
    def moved(self) -> float:
        """Distance from the person's palm [m]."""
        return float(np.linalg.norm(self.position - self.person_position))

    @property
    def turned(self) -> float:
        """Angle from the person's palm [rad]."""
        return float(se3.matrix_angle_between(self.rotation[None], self.person_rotation[None])[0])

    def note(self, targets: Targets) -> HoldNote:
        """Return it for a report's reader."""
        of, site = self.episode, targets.contact_links[self.episode.link]
        return HoldNote(
            part=site.replace("palm", "hand"),
            object=targets.object_names[of.object],
            first_frame=of.first,
            last_frame=of.stop - 1,
            moved_m=self.moved,
            turned_deg=float(np.degrees(self.turned)),
            touching_m2=self.area,
            missing_share=self.missing_share,
        )


def chosen_holds(
    targets: Targets,
    objects: tuple[MovingObject, ...],
    persons: Sequence[PersonHold],
    start: Kinematics,
    physics: Physics,
) -> tuple[Hold, ...]:
    """Return the holds of episodes.

    Args:
        targets: Of the robot.
        objects: Of its world.
        persons: The person's.
        start: The IK trajectory.
        physics: Masses and frictions.
    """
    entries = [
        finalists(
            held, hand_shape(start.model, targets.contact_links[held.episode.link]), objects[held.episode.object], start
        )
        for held in persons
    ]
    loads = {
        index: object_load(
            targets.object_names[index],
            targets.object_geometry[index],
            float(targets.object_scale[index]),
            (targets.object_pos[:, index], targets.object_quat[:, index]),
            targets.fps,
            physics,
        )
        for index in {held.episode.object for held in persons}
    }
    choice = _Choice(entries, objects, loads, physics.hand_friction)
    return choice.holds()


@dataclass(frozen=True, eq=False)
class _Choice:
    """All episodes of all hands, of which one finalist each is to be chosen."""

    entries: list[Finalists]
    objects: tuple[MovingObject, ...]
    loads: dict[int, ObjectLoad]
    friction: float

    def holds(self) -> tuple[Hold, ...]:
        """Return the holds after each episode in turn took its best one, with the others as they are."""
        chosen = [int(entry.scores.argmax()) for entry in self.entries]
        missing = [self._missing(number, chosen) for number in range(len(chosen))]
        for _ in range(SWEEPS):
            for number, entry in enumerate(self.entries):
                if missing[number] <= BEARABLE_SHARE:
                    continue
                tried = [[*chosen[:number], option, *chosen[number + 1 :]] for option in range(len(entry.scores))]
                lacks = [self._missing(number, option) for option in tried]
                totals = entry.scores - MISSING_COST * np.maximum(np.array(lacks) - BEARABLE_SHARE, 0.0)
                chosen[number] = int(totals.argmax())
            missing = [self._missing(number, chosen) for number in range(len(chosen))]
        return tuple(
            Hold(
                entry.person.episode,
                entry.poses.positions[option],
                entry.poses.rotations[option],
                entry.person.palm.positions[0],
                entry.person.palm.rotations[0],
                entry.frames,
                entry.off[option],
                float(entry.areas[option]),
                lack,
            )
            for entry, option, lack in zip(self.entries, chosen, missing, strict=True)
        )

    def _missing(self, number: int, chosen: list[int]) -> float:
        """Return the mean share of the object's weight that is missing in an episode."""
        entry = self.entries[number]
        index, shares = entry.person.episode.object, []
        for frame in entry.frames.tolist():
            held = [
                (other, chosen[place])
                for place, other in enumerate(self.entries)
                if (of := other.person.episode).object == index and of.first <= frame < of.stop
            ]
            points = np.concatenate([other.points[option] for other, option in held])
            inward = np.concatenate([other.inward[option] for other, option in held])
            item = self.objects[index]
            turn, place = item.rotation[:, :, frame], item.position[:, frame]
            shares.append(
                self.loads[index].missing_share(frame, points @ turn.T + place, inward @ turn.T, self.friction)
            )
        return float(np.mean(shares))
