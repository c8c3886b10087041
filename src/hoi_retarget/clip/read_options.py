"""Options of reading a clip. Nothing heavy is imported here: the command line's help is made of them."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

from hoi_retarget.errors import ArgumentError
from hoi_retarget.files.tables import decode

MAX_FLOOR_HEIGHT = 1000.0  # [m]
MIN_FPS, MAX_FPS = 10.0, 240.0  # [Hz]; with fewer frames motions lose their contacts' begin and end.
MIN_LEAD, MAX_LEAD = 1.0, 10.0  # [s]
Labels = Literal["auto", "proximity"]
Grasps = Literal["refuse", "warn"]


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """Options of reading a clip, beside its name."""

    objects: Path | None = None
    """Folder with the objects' geometry: OBJECTS/<name>/<name>.obj, or sample_points.npy there, or the source's own."""
    object_name: str | None = None
    """Which object the clip is with; by default the clip says, or its file name sub<N>_<object>_<n>."""
    body_models: Path | None = None
    """Folder with SMPL-X or SMPL-H models for recordings that need them."""
    from_robot: str | None = None
    """The robot whose motion a file is, any that check-motion reads: it is retargeted from in place of a person."""
    floor: float | None = None
    """Height of the floor in the recording [m]; by default the format's, or an estimate from standing feet."""
    labels: Labels = "auto"
    """Where contacts come from: auto keeps the recording's own and finds them from distances where it has none;
    proximity finds them anew."""
    fps: float | None = None
    """Frames a second that the recording is resampled to; by default it keeps its own."""
    lead_in: float = 0.0
    """Time from standing at rest to the recording's first pose [s]; what the person does then is made up."""
    lead_out: float = 0.0
    """Likewise from its last pose to standing [s]."""
    grasps: Grasps = "refuse"
    """What is done where grasps contradict how rotations or units are read: refuse the clip, or warn."""

    def __post_init__(self) -> None:
        if self.floor is not None and not abs(self.floor) <= MAX_FLOOR_HEIGHT:
            raise ArgumentError(
                f"--floor {self.floor:g}: the floor's height in the recording is at most {MAX_FLOOR_HEIGHT:g} m, up or "
                "down. Leave the option out to have it estimated."
            )
        if self.fps is not None and not MIN_FPS <= self.fps <= MAX_FPS:
            raise ArgumentError(
                f"--fps {self.fps:g}: recordings are resampled to {MIN_FPS:g} to {MAX_FPS:g} frames a second. Leave "
                "the option out to keep their own."
            )

        for name, seconds in (("--lead-in", self.lead_in), ("--lead-out", self.lead_out)):
            if seconds and not MIN_LEAD <= seconds <= MAX_LEAD:
                raise ArgumentError(
                    f"{name} {seconds:g}: a lead takes {MIN_LEAD:g} to {MAX_LEAD:g} seconds; 0 is none."
                )

    def as_json(self) -> dict[str, str | float | None]:
        """Return the options, in their units, as a result's report has them."""
        values = {name: getattr(self, name) for name in READ_OPTIONS}
        return {name: str(value) if isinstance(value, Path) else value for name, value in values.items()}

    @staticmethod
    def from_json(table: Mapping[str, Any]) -> "ReadOptions":
        """Return the options in a table, such as `as_json` makes; raises `ReadError` where a value means nothing.

        The table may have other entries, too; options that it lacks keep their defaults.
        """
        values = {name: table[name] for name in READ_OPTIONS if table.get(name) is not None}
        return decode(ReadOptions, values, "the options of reading")


def option_of(name: str) -> str:
    """Return the command line's option for one of the options by its field's name."""
    return {"object_name": "--object", "from_robot": "--from"}.get(name, f"--{name.replace('_', '-')}")


READ_OPTIONS: tuple[str, ...] = tuple(field.name for field in fields(ReadOptions))  # Names of the options of reading.
