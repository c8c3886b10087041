"""The specification of a batch: clips, times robots, sizes, mirror images and speeds; a small TOML file declares it."""

from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, Literal

from hoi_retarget.clip.clip import Augmentation
from hoi_retarget.clip.read_options import READ_OPTIONS, ReadOptions
from hoi_retarget.dynamics.physics_settings import Refinement
from hoi_retarget.errors import ArgumentError, ReadError
from hoi_retarget.files.tables import check_keys, decode, read_toml
from hoi_retarget.retargeting.config import Config, Scaling, parse_horizon, read_config
from hoi_retarget.robots import team

Scale = float | Literal["auto"]
_OBJECTS = "objects"  # A folder's own objects, where none are named.


@dataclass(frozen=True, kw_only=True)
class Specification(ReadOptions):
    """Clips and a grid of robots and variants; every combination is one job.

    Raises `ArgumentError` when a name does not exist or a number is out of its range.
    """

    clips: tuple[str, ...]  # Files, patterns such as `*.pt`, folders, or built-in clips such as `builtin:carry_box`.
    about: tuple[str, ...] = ()
    """Words: of a folder or a pattern, clips are taken that have one of them in path, objects or text; all without."""
    longest: float | None = None  # Of a folder or a pattern, clips are taken that last this long at most [s].
    edits: Path | None = None  # Folder with contact edits, `<clip>.edits.toml`; a clip may have none.
    robots: tuple[str, ...] = ("unitree_g1",)
    root_scale: Scale = "auto"
    horizon: str = "auto"
    object_scales: tuple[Scale, ...] = ("auto",)
    size_multipliers: tuple[float, ...] = (1.0,)
    mirrored: tuple[bool, ...] = (False,)
    speeds: tuple[float, ...] = (1.0,)
    refine: bool = False  # Whether a simulated robot is to perform every result, in a stage of its own.
    refinement: Refinement = Refinement()  # How much that stage tries.
    seed: int = 0  # Of its random numbers.
    folder: Path = Path()  # Folder that relative paths start from.
    config: Config = Config()  # Every other setting; scaling and horizon are those above.

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("clips", "robots", "object_scales", "size_multipliers", "mirrored", "speeds"):
            values = getattr(self, name)
            if not values:
                raise ArgumentError(f"{name} is empty: there is nothing to make. Name at least one.")
            if len(set(values)) < len(values):
                raise ArgumentError(f"{name} names the same twice: {', '.join(map(str, values))}. Name each once.")
        for names in self.robots:
            team(names)
        for object_scale, multiplier in product(self.object_scales, self.size_multipliers):
            self.config_of(object_scale, multiplier)
        for speed in self.speeds:
            Augmentation(speed=speed)

    def config_of(self, object_scale: Scale, size_multiplier: float) -> Config:
        """Return the configuration of the jobs with one size of the objects."""
        scaling = Scaling(self.root_scale, object_scale, size_multiplier, self.config.scaling.body_scale)
        return replace(self.config, scaling=scaling, horizon=parse_horizon(self.horizon))


def of_folder(
    folder: Path, options: ReadOptions = ReadOptions(), config: Config = Config(), **settings: Any
) -> Specification:
    """Return the default specification of a folder: every clip in it once, for the default robot.

    Without `options.objects`, a folder of that name in it is taken where there is one; `settings` are other fields.
    """
    own = folder / _OBJECTS
    objects = options.objects or (own if own.is_dir() else None)
    reading = {**{name: getattr(options, name) for name in READ_OPTIONS}, "objects": objects}
    return Specification(clips=("",), folder=folder, config=config, **reading, **_settings_of(config), **settings)


def read_specification(path: Path) -> Specification:
    """Return the specification in a TOML file; its keys are the fields of `Specification`, without `folder`.

    Relative paths in it are relative to its own folder. `config` is a table, or the name of a file with one. Raises
    `ReadError` for no TOML, an unknown key or a value of another type, and the `ArgumentError` of `Specification`.
    """
    table, folder = read_toml(path), path.parent
    if "clips" not in table:
        raise ReadError(f"{path}: 'clips' is missing. Write, for example, clips = [\"recordings/*.pt\"].")
    check_keys(Specification, table, str(path), hidden=("folder",))
    named = table.pop("config", {})
    is_file = isinstance(named, str)
    config = read_config(folder / named) if is_file else Config.from_table(named, f"{path}: config")
    settings = {**_settings_of(config), **table}
    read = decode(Specification, settings, str(path), folder=folder, hidden=("folder", "config"))
    return replace(read, folder=folder, config=config)


def _settings_of(config: Config) -> dict[str, Any]:
    """Return the settings of a configuration that a specification has keys of its own for."""
    scaling = config.scaling
    return {
        "root_scale": scaling.root_scale,
        "horizon": config.horizon.text,
        "object_scales": (scaling.object_scale,),
        "size_multipliers": (scaling.size_multiplier,),
    }
