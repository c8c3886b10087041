"""One file of a report: its origin, its figures, and the verdict on them."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path, PureWindowsPath
from typing import Any

from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.evaluation.thresholds import THRESHOLDS, Level, Verdict, judged_figures, verdict_of_figures
from hoi_retarget.motion.check import Finding
from hoi_retarget.report.load_any_motion import OWN_FORMAT, open_motion
from hoi_retarget.report.recording import Recording, with_recording
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.viewers.scene.shared_objects import shared_objects

STATES = ("pass", "not judged", "warn", "fail", "unread")
"""What a file can be in a report."""
_OF_OBJECTS = {"touch_share", "contact_gap_m", "penetration_max_m"}


@dataclass(frozen=True)
class Row:
    """One file of a report; without a verdict when it could not be read or was never written."""

    file: str
    """Its name in the report."""
    path: Path | None = None
    """Its place; None when it was never written."""
    error: str = ""
    """Why there is no verdict."""
    format: str = ""
    robot: str = ""
    objects: tuple[str, ...] = ()
    object_surfaces: Mapping[str, str] = field(default_factory=dict)
    """What stands for the surface of each object: `solid`, `shell` or `hull`; empty where the file does not say."""
    clip: str = ""
    person: int = 0
    """Whose motion it is, among the clip's people."""
    shared: str = ""
    """What tells its objects and their paths from others'; empty without objects."""
    frames: int | None = None
    fps: float | None = None
    root_scale: float | None = None
    object_scale: tuple[float, ...] = ()
    licence: str = ""
    """Terms of the recording that it was made from; empty where the file does not say."""
    lineage: str = ""
    """Changes to its recording, as JSON; empty where the file does not say."""
    notes: tuple[str, ...] = ()
    """Assumptions made to read it, a clause each."""
    contradictions: tuple[str, ...] = ()
    """What contradicts the file's claims; its figures are those of its numbers as they were found to be."""
    figures: Mapping[str, float | None] = field(default_factory=dict)
    """All that were measured, those that are not judged included."""
    verdict: Verdict | None = None

    def __post_init__(self) -> None:
        for name in ("file", "error", "clip", "licence", "lineage"):
            # Names of files, and what files say, may hold characters that no text file can.
            object.__setattr__(self, name, getattr(self, name).encode("utf-8", "replace").decode())

    @property
    def name(self) -> str:
        """Name of the file without folders and ending."""
        return PureWindowsPath(self.file).stem

    @property
    def object_titles(self) -> tuple[str, ...]:
        """Names of the objects, with what stands for a surface that is not the object's own."""
        kinds = {name: kind for name, kind in self.object_surfaces.items() if kind != "solid"}
        return tuple(f"{name} ({kinds[name]})" if name in kinds else name for name in self.objects)

    @property
    def seconds(self) -> float | None:
        """Length of the motion [s]."""
        return self.frames / self.fps if self.frames is not None and self.fps else None

    @property
    def level(self) -> Level | None:
        """Level of the verdict; None without one."""
        return self.verdict.level if self.verdict is not None else None

    @property
    def state(self) -> str:
        """One of `STATES`: its level, but that a pass needs somebody to have looked at its hands and objects."""
        if self.level is not Level.PASS:
            return str(self.level) if self.level is not None else "unread"
        alone = self.format == OWN_FORMAT and not self.objects
        return "pass" if alone or self.judged.keys() & _OF_OBJECTS else "not judged"

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why its level is no better, in words."""
        return (*self.contradictions, *map(str, self.verdict.reasons if self.verdict is not None else ()))

    @property
    def badness(self) -> tuple[float, ...]:
        """A key to sort by, the worst motion last: level, reasons, and how near to thresholds or beyond them it is."""
        if self.verdict is None:
            return ()
        reasons = sum(reason.level for reason in self.verdict.reasons) + Level.FAIL * len(self.contradictions)
        return (float(self.verdict.level), float(reasons), max(self._shares(), default=0.0))

    @property
    def judged(self) -> dict[str, float]:
        """The figures that its verdict looked at."""
        passed_over = self.verdict.not_judged if self.verdict is not None else ()
        return {name: value for name, value in self.figures.items() if value is not None and name not in passed_over}

    def _shares(self) -> list[float]:
        """Return figures over their thresholds, where lower is better and the threshold is not zero."""
        return [
            value / threshold.warn
            for threshold in THRESHOLDS
            if threshold.column.better == "lower"
            and threshold.warn > 0
            and (value := self.judged.get(threshold.name)) is not None
        ]


def worst_first(rows: Sequence[Row]) -> tuple[Row, ...]:
    """Return the rows that have a verdict, the worst first, equal ones by name."""
    judged = sorted((row for row in rows if row.verdict is not None), key=lambda row: row.file)
    return tuple(sorted(judged, key=lambda row: row.badness, reverse=True))


def read_row(
    name: str,
    path: Path,
    robot: RobotModel,
    lineage: Mapping[str, Any] | None = None,
    recording: Recording = Recording(),
) -> Row:
    """Return what a file holds; one that cannot be read gives a row with the reason.

    Args:
        name: Of the file in the report.
        path: The file.
        robot: The robot of files that do not say which.
        lineage: What was done to the recording, where it is known from elsewhere.
        recording: The clip of files that do not say which.
    """
    try:
        opened = with_recording(open_motion(path, robot), path, robot, recording)
    except HoiRetargetError as error:
        return Row(name, path, str(error).replace(str(path), path.name))
    motion = opened.motion
    judged = {**judged_figures(motion), **dict.fromkeys(opened.not_judged)}
    measured = {**motion.report.figures, **dict.fromkeys(opened.not_judged)}
    figures = {**judged, **{name: value for name, value in measured.items() if judged.get(name) is None}}
    verdict = verdict_of_figures(judged)
    source = motion.report.source
    return Row(
        file=name,
        path=path,
        format=opened.format,
        robot=motion.robot,
        objects=motion.object_names,
        object_surfaces=motion.report.object_surfaces,
        clip=motion.report.clip,
        person=motion.person,
        shared=shared_objects(motion),
        frames=motion.frames,
        fps=motion.fps,
        root_scale=motion.report.root_scale,
        object_scale=tuple(motion.object_scale.tolist()) if opened.format == OWN_FORMAT else (),
        licence=source.licence,
        lineage=_json(lineage if lineage is not None else asdict(source.augmentation)),
        notes=opened.notes,
        contradictions=tuple(map(str, opened.contradictions)),
        figures=figures,
        verdict=replace(verdict, level=max(verdict.level, *map(_level, opened.contradictions), Level.PASS)),
    )


def _level(contradiction: Finding) -> Level:
    """Return how bad a contradiction is: velocities can be computed anew, whatever else is wrong is not read right."""
    return Level.WARN if contradiction.spoils == "velocities" else Level.FAIL


def _json(value: Mapping[str, Any] | None) -> str:
    return json.dumps(value, sort_keys=True) if value else ""
