"""A hold: the pose of a palm on an object during an episode."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.dynamics.free_hands import Touch
from hoi_retarget.motion.motion_report import HoldNote
from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.holds.episodes import Episode
from hoi_retarget.retargeting.holds.hand_shape import HandPoses
from hoi_retarget.retargeting.targets import Targets


@dataclass(frozen=True, eq=False)
class PersonHold:
    """The person's hold in an episode."""

    episode: Episode
    palm: HandPoses  # One pose.
    edited: bool  # Whether somebody has put the contact elsewhere than it was recorded.
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotation vector about the object's axes, by which somebody turned the hand [degrees],"""
    rank: int = 0  # and of the hold that they chose.

    @property
    def asked(self) -> HandPoses:
        """The pose that a hold is to be near."""
        turned = se3.quat_to_matrix(se3.exp(np.radians(self.turn))) @ self.palm.rotations
        return HandPoses(self.palm.positions, turned)

    @property
    def chosen(self) -> bool:
        """Whether somebody chose the hold."""
        return self.edited or self.rank > 0 or any(self.turn)


@dataclass(frozen=True, eq=False)
class Hold:
    """The pose of a robot's palm on an object during an episode."""

    person: PersonHold
    touch: Touch
    frames: Int[np.ndarray, "F"]  # Some of the episode, in which the reach was looked at,
    off: Float[np.ndarray, "F"]  # and how far off the arm ends there, with the body as in inverse kinematics [m].
    area: float  # Palmar skin that touches [m^2].
    score: float  # Of the choice, as cm2 of touch.
    rank: int
    ranks: int  # Of the hold among those that differ, the best one first.
    kept: bool | None = None
    """Whether two free hands keep the object, all its holds together; None where this was not simulated."""

    @property
    def episode(self) -> Episode:
        """Its episode."""
        return self.person.episode

    @property
    def person_position(self) -> Float[np.ndarray, "3"]:
        """Middle of the person's palm in the episode [m]."""
        return self.person.palm.positions[0]

    @property
    def moved(self) -> float:
        """Distance from the person's palm [m]."""
        return float(np.linalg.norm(self.touch.position - self.person_position))

    @property
    def turned(self) -> float:
        """Angle from the person's palm [rad]."""
        return float(se3.matrix_angle_between(self.touch.rotation[None], self.person.palm.rotations)[0])

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
            score=self.score,
            rank=self.rank,
            ranks=self.ranks,
            kept=self.kept,
        )
