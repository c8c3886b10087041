"""The rows of a report, one a file with figures and verdict, and their tables for programs, in stored units."""

import csv
import io
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path, PureWindowsPath
from typing import Any

from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.evaluation.thresholds import THRESHOLDS, Level, Verdict, by_kind, judged_figures, verdict_of_figures
from hoi_retarget.motion.motion import Motion
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.studio.offscreen.robot_portraits import representative_frame
from hoi_retarget.studio.report.open_motion import OWN_FORMAT, ReferenceClip, open_motion, with_recording
from hoi_retarget.studio.scene.scene import shared_objects

STATES = ("pass", "not judged", "warn", "fail", "unread")  # What a file can be in a report.
LIGHTS = ("pass", "not judged", "warn", "fail")  # What its physics can be.
_OF_OBJECTS = {"touch_share", "contact_gap_m", "penetration_max_m"}


@dataclass(frozen=True)
class Row:
    """One file of a report; without a verdict when it could not be read or was never written."""

    file: str  # Its name in the report.
    path: Path | None = None  # Its place; None when it was never written.
    error: str = ""  # Why there is no verdict.
    format: str = ""
    robot: str = ""
    objects: tuple[str, ...] = ()
    object_surfaces: Mapping[str, str] = field(default_factory=dict)
    """What stands for the surface of each object: `solid`, `shell` or `hull`; empty where the file does not say."""
    clip: str = ""
    person: int = 0  # Whose motion it is, among the clip's people.
    shared: str = ""  # Identity of its objects and their paths; empty without objects.
    frames: int | None = None
    fps: float | None = None
    root_scale: float | None = None
    object_scale: tuple[float, ...] = ()
    licence: str = ""  # Terms of the recording that it was made from; empty where the file does not say.
    lineage: str = ""  # Changes to its recording, as JSON; empty where the file does not say.
    notes: tuple[str, ...] = ()  # Assumptions made to read it, a clause each.
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
        """Names of the objects, with the kind of a surface that is not the object's own."""
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
        reasons = self.verdict.reasons if self.verdict is not None else ()
        return (*self.contradictions, *(f"{reason.kind}: {reason}" for reason in reasons))

    @property
    def physics(self) -> str:
        """Level of the light of physics, one of `LIGHTS`; empty without a verdict."""
        return str(self.verdict.physics) if self.verdict is not None else ""

    @property
    def badness(self) -> tuple[float, ...]:
        """A key to sort by, the worst motion last: level, fatal reasons, reasons, largest ratio to a threshold."""
        if self.verdict is None:
            return ()
        reasons = sum(reason.level for reason in self.verdict.motion.reasons) + Level.FAIL * len(self.contradictions)
        forces = len(self.verdict.physics.reasons)
        fatal = len(self.verdict.fatal)
        return (*map(float, (self.verdict.level, fatal, reasons, forces)), max(self._shares(), default=0.0))

    @property
    def judged(self) -> dict[str, float]:
        """The figures that its verdict looked at, by names that end in their units."""
        passed_over = self.verdict.not_judged if self.verdict is not None else ()
        return {name: value for name, value in self.figures.items() if value is not None and name not in passed_over}

    def _shares(self) -> list[float]:
        """Return ratios of figures to their thresholds, where lower is better and the threshold is not zero."""
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
    recording: ReferenceClip = ReferenceClip(),
) -> Row:
    """Return a file's row; an unreadable file's has the reason.

    Args: `name`: of the file in the report; `path`: the file; `robot`: the robot of files that do not say which;
    `lineage`: what was done to the recording, where it is known from elsewhere; `recording`: the clip of files that do
    not say which.
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
    # Velocities can be computed anew; all else that contradicts the file makes the motion unfit.
    spoilt = [Level.WARN if item.spoils == "velocities" else Level.FAIL for item in opened.contradictions]
    changes = asdict(source.augmentation) if lineage is None else lineage
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
        lineage=json.dumps(changes, sort_keys=True) if changes else "",
        notes=opened.notes,
        contradictions=tuple(map(str, opened.contradictions)),
        figures=figures,
        verdict=replace(verdict, motion=replace(verdict.motion, level=max((verdict.level, *spoilt)))),
    )


_COLUMNS: Mapping[str, tuple[type, Callable[[Row], Any]]] = {
    "file": (str, lambda row: row.file),
    "format": (str, lambda row: row.format),
    "robot": (str, lambda row: row.robot),
    "objects": (str, lambda row: "; ".join(row.objects)),
    "object_surfaces": (str, lambda row: "; ".join(row.object_surfaces.get(name, "") for name in row.objects)),
    "clip": (str, lambda row: row.clip),
    "licence": (str, lambda row: row.licence),
    "lineage": (str, lambda row: row.lineage),
    "level": (str, lambda row: str(row.level) if row.level is not None else ""),
    "physics": (str, lambda row: row.physics),
    "reasons": (str, lambda row: by_kind(row.verdict.reasons) if row.verdict else ""),
    "contradictions": (str, lambda row: "; ".join(row.contradictions)),
    "not_judged": (str, lambda row: "; ".join(row.verdict.not_judged) if row.verdict else ""),
    "notes": (str, lambda row: "; ".join(row.notes)),
    "error": (str, lambda row: row.error),
    "frames": (int, lambda row: row.frames),
    "fps": (float, lambda row: row.fps),
    "root_scale": (float, lambda row: row.root_scale),
    "object_scale": (str, lambda row: "; ".join(map(repr, row.object_scale))),
}
"""The columns before the figures: type and content."""


def index_columns(rows: Sequence[Row]) -> dict[str, list[Any]]:
    """Return the columns by name; None where a file has no such number, and an empty text for a word.

    Several objects, scales, reasons and names stand in one cell, divided by semicolons.
    """
    extra = sorted({name for row in rows for name in row.figures} - {threshold.name for threshold in THRESHOLDS})
    figures = [*(threshold.name for threshold in THRESHOLDS), *extra]
    return {
        **{name: [content(row) for row in rows] for name, (_, content) in _COLUMNS.items()},
        **{name: [row.figures.get(name) for row in rows] for name in figures},
    }


def to_csv(rows: Sequence[Row]) -> bytes:
    """Return the table as CSV; empty where there is no number."""
    columns = index_columns(rows)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return text.getvalue().encode()


def to_parquet(rows: Sequence[Row]) -> bytes | None:
    """Return the same table in Parquet's format; None where pyarrow, of the extra `dataset`, is not installed."""
    try:
        import pyarrow  # noqa: PLC0415  # an extra
        from pyarrow import parquet  # noqa: PLC0415  # an extra
    except ImportError:
        return None
    types = {str: pyarrow.string(), int: pyarrow.int64(), float: pyarrow.float64()}
    table = pyarrow.table(
        {
            name: pyarrow.array(values, types[_COLUMNS[name][0] if name in _COLUMNS else float])
            for name, values in index_columns(rows).items()
        }
    )
    sink = io.BytesIO()
    parquet.write_table(table, sink)
    return sink.getvalue()


def to_json(rows: Sequence[Row]) -> bytes:
    """Return the verdicts as JSON: the thresholds, the number of files of each level, and each file."""
    judged = [row for row in rows if row.verdict is not None]
    document = {
        "counts": {
            **{str(level): sum(row.level is level for row in judged) for level in Level},
            "unread": len(rows) - len(judged),
        },
        "physics": {light: sum(row.physics == light for row in judged) for light in LIGHTS},
        "thresholds": [
            {
                **{"figure": threshold.name, "better": threshold.column.better},
                **{"warn": threshold.warn, "fail": threshold.fail, "why": threshold.why},
                **{"light": threshold.light, "fatal": threshold.fatal},
            }
            for threshold in THRESHOLDS
        ],
        "files": [_entry(row) for row in rows],
    }
    return (json.dumps(document, indent=1, allow_nan=False) + "\n").encode()


def _entry(row: Row) -> dict[str, Any]:
    if row.verdict is None:
        return {"file": row.file, "level": None, "error": row.error}
    figures = {name: value if value is None or math.isfinite(value) else None for name, value in row.figures.items()}
    verdict = {**row.verdict.as_json(), "contradictions": list(row.contradictions)}
    return {"file": row.file, **verdict, "figures": figures}


def worst_frame(motion: Motion) -> int:
    """Return the middle of the longest unreached contact or orientation flip, else that of the longest contact."""
    report = motion.report
    found = [*(report.orientation_flips or ()), *(report.unreached_contacts or ())]
    if not found:
        return representative_frame(motion)
    longest = max(found, key=lambda event: event.frames)
    return (longest.first_frame + longest.last_frame) // 2
