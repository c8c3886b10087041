"""How far contacts' points are off the surfaces that they belong to, and which of them are in thin air.

A contact's point is the middle of a hand, which lies some way off the surface that the hand touches: how far, the
recording tells. What is much farther touches nothing.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits import Segment, segments_of
from hoi_retarget.objects.mesh import surface_of

NEAR = 0.05
"""From the surface to a point that is never in thin air [m]: palms' middles lie 3 cm off it in the median recording."""
_FARTHER = 0.01  # Than in the recording [m].


@dataclass(frozen=True)
class SurfaceGap:
    """Where a contact's point is."""

    distance: float
    """From the surface, its mean over the frames, at captured size [m]."""
    in_thin_air: bool

    @property
    def text(self) -> str:
        """One sentence."""
        what = " It touches nothing there; To surface puts it back." if self.in_thin_air else ""
        return f"The point is {1e3 * self.distance:.0f} mm off the surface.{what}"


class SurfaceGaps:
    """Measures contacts of one recording while they are edited."""

    def __init__(self, recorded: Clip) -> None:
        self._surfaces = [surface_of(track.geometry) for track in recorded.objects]
        self._farthest: dict[tuple[int, str, int], float] = {}
        for segment in segments_of(recorded):
            key = (segment.person, segment.part, segment.object)
            self._farthest[key] = max(self._farthest.get(key, 0.0), self._distance(segment))

    def of(self, segments: Iterable[Segment]) -> Sequence[SurfaceGap]:
        """Return where the point of each contact is."""
        gaps = []
        for segment in segments:
            distance = self._distance(segment)
            recorded = self._farthest.get((segment.person, segment.part, segment.object), 0.0)
            gaps.append(SurfaceGap(distance, distance > max(NEAR, recorded + _FARTHER)))
        return gaps

    def _distance(self, segment: Segment) -> float:
        return float(self._surfaces[segment.object].distances(segment.points).mean())
