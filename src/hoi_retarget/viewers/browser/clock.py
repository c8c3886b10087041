"""The clock of a player: playing, paused, at any speed, round and round."""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Clock:
    """A player's state; times are those of any clock that runs evenly [s]."""

    frames: int
    fps: float
    speed: float = 1.0
    playing: bool = False
    place: float = 0.0
    """Frame at time `since`, with its fraction."""
    since: float = 0.0

    def frame(self, now: float) -> int:
        """Return the frame to show."""
        return int(self._place(now))

    def played(self, now: float) -> "Clock":
        """Return the clock going on from where it stands."""
        return replace(self, place=self._place(now), since=now, playing=True)

    def paused(self, now: float) -> "Clock":
        """Return the clock standing still where it is."""
        return replace(self, place=float(self.frame(now)), since=now, playing=False)

    def sought(self, frame: int, now: float) -> "Clock":
        """Return the clock at another frame, cut to those there are."""
        return replace(self, place=float(min(max(frame, 0), self.frames - 1)), since=now)

    def at_speed(self, speed: float, now: float) -> "Clock":
        """Return the clock at another speed from now on."""
        return replace(self, place=self._place(now), since=now, speed=speed)

    def seconds_to_next(self, now: float) -> float:
        """Return how long the frame to show stays; an hour where it does not change."""
        if not self.playing:
            return 3600.0
        return (1.0 - self._place(now) % 1.0) / (self.fps * self.speed)

    def _place(self, now: float) -> float:
        if not self.playing:
            return self.place
        return (self.place + (now - self.since) * self.fps * self.speed) % self.frames
