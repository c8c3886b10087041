"""The state of the editor's work as its page reads it: contacts, pins, edits, figures.

A contact's point is the middle of a hand, which lies some way off the touched surface, as in the recording. A point
much farther off is in thin air.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits import Segment, describe, part_text, segments_of
from hoi_retarget.evaluation import COLUMNS
from hoi_retarget.evaluation.surface_distances import distances_of_motion
from hoi_retarget.evaluation.unreached_contacts import FARTHER_M, NEAR_SURFACE_M
from hoi_retarget.human.skeleton import HANDS
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.studio.editor.edit_session import EditState
from hoi_retarget.studio.html import with_exponents

_FIGURES = (
    "touch_share",
    "contact_gap_m",
    "contact_gap_max_m",
    "relative_hand_rotation_deg",
    "body_jerk_mps3",
    "body_jerk_max_mps3",
    "stance_slide_mps",
)
_DIGITS = 5


@dataclass(frozen=True)
class SurfaceGap:
    """Distance of a contact's point from its surface."""

    distance: float  # From the surface, its mean over the frames, at captured size [m].
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
        """Return the distance of each contact's point."""
        gaps = []
        for segment in segments:
            distance = self._distance(segment)
            recorded = self._farthest.get((segment.person, segment.part, segment.object), 0.0)
            gaps.append(SurfaceGap(distance, distance > max(NEAR_SURFACE_M, recorded + FARTHER_M)))
        return gaps

    def _distance(self, segment: Segment) -> float:
        return float(self._surfaces[segment.object].distances(segment.points).mean())


def state_of(
    now: EditState, model: RobotModel, gaps: Sequence[SurfaceGap], first: EditState, previous: EditState | None
) -> dict[str, Any]:
    """Return contacts, pins, edits and figures as plain values.

    Args: `now`: the current state; `model`: the robot; `gaps`: distance of each contact's point from its surface;
    `first`: the state at the beginning; `previous`: the state before the last change, if any.
    """
    several = len(now.clip.people) > 1
    return {
        "segments": [
            {
                **{"person": segment.person, "part": segment.part, "object": segment.object},
                **{"start": segment.start, "stop": segment.stop, "hold": segment.hold, "turn": segment.turn},
                "name": part_name(segment.person, segment.part, several),
                "point": np.round(segment.points.mean(axis=0), _DIGITS).tolist(),
                "turns": segment.part in HANDS,
                "off": text,
                "air": gap.in_thin_air,
            }
            for segment, gap, text in zip(now.segments, gaps, _distances(now, model, gaps), strict=True)
        ],
        "pins": _pins(now, several),
        "edits": [f"{number}: {describe(edit)}" for number, edit in enumerate(now.edits.edits, 1)],
        "figures": _figures(first, previous or first, now),
    }


def changes_text(before: EditState, now: EditState) -> str:
    """Return the changed figures, such as `contact gap 1.5 -> 2.9 mm`; the first person's of several."""
    sides = [edited.motions[0].report.figures for edited in (before, now)]
    changes = []
    for column in (column for column in COLUMNS if column.name in _FIGURES):
        texts = [column.text(side.get(column.name)) for side in sides]
        if texts[0] != texts[1]:
            changes.append(f"{column.title} {texts[0]} -> {texts[1]} {with_exponents(column.unit)}")
    return ", ".join(changes) or "no figure changed"


def part_name(person: int, part: str, several: bool) -> str:
    """Return a part's name, with its person where there are several."""
    return (part_text(person, part) if several else part).replace("_", " ")


def _distances(now: EditState, model: RobotModel, gaps: Sequence[SurfaceGap]) -> list[str]:
    """Return the mean distance of each contact's hand from the surface, or of its point in thin air, in words."""
    geometries = tuple(track.geometry for track in now.clip.objects)
    skins = [distances_of_motion(motion, model, geometries)[1] for motion in now.motions]
    texts = []
    for segment, gap in zip(now.segments, gaps, strict=True):
        links = now.motions[segment.person].contact_links
        site = model.spec.contact_sites.get(segment.part)
        own = np.zeros(0)
        if site in links:
            own = skins[segment.person][segment.start : segment.stop, links.index(site)]
        mean = 1e3 * np.nanmean(own) if np.isfinite(own).any() else None
        if gap.in_thin_air:
            texts.append(f"point {1e3 * gap.distance:.0f} mm off")
        else:
            texts.append("not followed" if mean is None else f"{abs(mean):.1f} mm {'off' if mean > 0 else 'inside'}")
    return texts


def _pins(now: EditState, several: bool) -> list[dict[str, Any]]:
    off = {
        (person, item.part, item.frame): item.off_m
        for person, motion in enumerate(now.motions)
        for item in motion.report.pins
    }
    return [
        {
            **{"person": pin.person, "part": pin.part, "frame": pin.frame},
            "text": f"{part_name(pin.person, pin.part, several)} {pin.frame / now.clip.fps:.2f} s "
            f"({1e3 * off[pin.person, pin.part, pin.frame]:.0f} mm off)",
        }
        for pin in now.clip.pins
    ]


def _figures(*states: EditState) -> list[list[str]]:
    """Return rows of figures of some states, each after its name; a row of a name alone heads a person's."""
    rows: list[list[str]] = []
    people = states[-1].clip.people
    for person, track in enumerate(people):
        sides = [state.motions[person].report.figures for state in states]
        if len(people) > 1:
            rows.append([track.name])
        rows += [
            [with_exponents(column.header), *(column.text(side.get(column.name)) for side in sides)]
            for column in COLUMNS
            if column.name in _FIGURES and column.name in sides[-1]
        ]
    return rows
