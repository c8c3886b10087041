"""The specification of a batch: clips, times robots, sizes, mirror images and speeds; a small TOML file declares it."""

from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Literal

from hoi_retarget.clip.clip import Augmentation
from hoi_retarget.clip.infer_contacts import Labels
from hoi_retarget.errors import ArgumentError, ReadError
from hoi_retarget.files.tables import decode, read_toml
from hoi_retarget.retarget.config import Scaling, parse_horizon
from hoi_retarget.robots import team

Scale = float | Literal["auto"]
_OBJECTS = "objects"  # A folder's own objects, where none are named.


@dataclass(frozen=True)
class Specification:
    """Clips and a grid of robots and variants; every combination is one job.

    Raises `ArgumentError` when a name does not exist or a number is out of its range.
    """

    clips: tuple[str, ...]
    """Files, patterns such as `*.pt`, folders, or built-in clips such as `builtin:carry_box`."""
    folder: Path = Path()
    """Folder that relative paths start from."""
    objects: Path | None = None
    """Folder with the objects' geometry."""
    object_name: str | None = None
    """Which object the clips are with, where neither they nor their names say."""
    body_models: Path | None = None
    """Folder with SMPL-X or SMPL-H models, for recordings that hold their parameters."""
    floor: float | None = None
    """Height of the floor in the recordings [m], where it is known better than by the format or an estimate."""
    labels: Labels = "auto"
    """Where contacts come from: `auto`, `proximity` or `interact`, as for `run`."""
    edits: Path | None = None
    """Folder with contact edits, `<clip>.edits.toml`; a clip may have none."""
    robots: tuple[str, ...] = ("unitree_g1",)
    root_scale: Scale = "auto"
    horizon: str = "auto"
    object_scales: tuple[Scale, ...] = ("auto",)
    size_multipliers: tuple[float, ...] = (1.0,)
    mirrored: tuple[bool, ...] = (False,)
    speeds: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        for name in ("clips", "robots", "object_scales", "size_multipliers", "mirrored", "speeds"):
            values = getattr(self, name)
            if not values:
                raise ArgumentError(f"{name} is empty: there is nothing to make. Name at least one.")
            if len(set(values)) < len(values):
                raise ArgumentError(f"{name} names the same twice: {', '.join(map(str, values))}. Name each once.")
        for names in self.robots:
            team(names)
        for object_scale, multiplier in product(self.object_scales, self.size_multipliers):
            Scaling(self.root_scale, object_scale, multiplier)
        for speed in self.speeds:
            Augmentation(speed=speed)
        parse_horizon(self.horizon)


def of_folder(folder: Path, objects: Path | None = None) -> Specification:
    """Return the default specification of a folder: every clip in it once, for the default robot.

    Without `objects`, a folder of that name in it is taken where there is one.
    """
    own = folder / _OBJECTS
    return Specification(("",), folder, objects or (own if own.is_dir() else None))


def read_specification(path: Path) -> Specification:
    """Return the specification in a TOML file; its keys are the fields of `Specification`, without `folder`.

    Relative paths in it are relative to its own folder.

    Raises:
        ReadError: the file is missing, no TOML, or has an unknown key or a value of the wrong type.
        ArgumentError: as `Specification`.
    """
    table, folder = read_toml(path), path.parent
    if "clips" not in table:
        raise ReadError(f"{path}: 'clips' is missing. Write, for example, clips = [\"recordings/*.pt\"].")
    return replace(decode(Specification, table, str(path), folder=folder, hidden=("folder",)), folder=folder)
