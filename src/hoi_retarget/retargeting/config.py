"""Everything that decides a result beside the clip and the robot, in one place.

Every field can be set from Python, on the command line (`--weights.jerk 2e-3`) and in a TOML file
(`[weights]`, `jerk = 2e-3`), and is kept in the result. Nothing heavy is imported here, so that the
command line's help, which is derived from these classes, is quick.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, is_dataclass, replace
from math import isfinite
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, get_args

from hoi_retarget.dynamics.physics_settings import FigureSet, Physics
from hoi_retarget.errors import ArgumentError, ReadError
from hoi_retarget.files.tables import check_keys, decode, read_toml
from hoi_retarget.retargeting.trajopt.solvers.solver import SOLVERS, BandedInteriorPoint, Solver

MIN_WINDOW_FRAMES = 20  # Of those that pin frames.
PINNED = 3  # The reach of a third difference.
LOOK_AHEAD = 15  # Shared frames with which seams can no longer be seen.


@dataclass(frozen=True)
class Scaling:
    """Scales from the human and the objects to the robot."""

    root_scale: float | Literal["auto"] = "auto"
    """Human size to robot size; auto divides the robot's stature by the mean height of the clip's people."""
    object_scale: float | Literal["auto"] = "auto"
    """Size of the object; 1.0 keeps it, auto shrinks or keeps it, as suits the robot."""
    size_multiplier: float = 1.0  # On top of the object scale, to make several motions of one clip.
    body_scale: float | Literal["root"] = "root"
    """Human to robot: the size of the body; it differs from the root scale where different robots share one world."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not isinstance(value, str) and not (isfinite(value) and value > 0):
                raise ArgumentError(f"{name.replace('_', '-')} is {value}; it must be a positive number.")


WITHOUT_OBJECTS: Mapping[str, float] = MappingProxyType(
    {
        "joint_position": 100.0,
        "base_position": 300.0,
        "head_position": 100.0,
        "feet_position": 10.0,
        "floor_clearance": 10.0,
        "link_floor": 10.0,
    }
)
"""Weight -> its factor in clips without objects: links then move in the human's directions, without more jerk."""


@dataclass(frozen=True)
class Weights:
    """Weights of the cost table (paper Table II); each multiplies the square of a residual.

    Units are those of the residual: metres, radians, or the Frobenius norm of a difference of rotations.
    """

    joint_position: float = 1.0  # E^theta [1/rad^2]
    base_position: float = 1.0  # E^b [1/m^2]
    head_position: float = 1.0  # E^h [1/m^2]
    feet_position: float = 100.0  # E^f [1/m^2]
    torso_orientation: float = 1.0  # E^r
    object_contact: float = 1000.0  # E^c [1/m^2]
    hand_orientation: float = 5.0  # E^ho
    stance_height: float = 2000.0  # E^fz [1/m^2]
    stance_orientation: float = 10.0  # E^fo
    jerk: float = 1e-3
    """E^j [s^4]: multiplies the squared third difference of q divided by dt^2, at 30 frames a second.

    At other rates it is scaled so that its share of the cost stays what it is at 30.
    """
    trunk_orientation: float = 6.0  # Rotations of torso and pelvis in the world, in surface contact; not in the paper.
    stance_anchor: float = 6e4
    """Feet that keep one place while they stand [1/m^2], in surface contact; not in the paper."""
    floor_clearance: float = 2000.0  # Sole corners under the floor [1/m^2]; not in the paper.
    self_clearance: float = 6e4
    """Points of a link's skin, 6 mm apart, in another link [1/m^2], in surface contact; not in the paper."""
    link_floor: float = 5e3  # Skin of any link under the floor [1/m^2], in surface contact; not in the paper.
    surface_touch: float = 2e4
    """Skin off the surface that it is to touch [1/m^2], in surface contact; not in the paper."""
    clearance: float = 8e4
    """Skin inside an object, or an object inside the robot [1/m^2], in surface contact; not in the paper."""
    pin: float = 3e4  # Parts that are pinned by hand [1/m^2]; not in the paper.

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (isfinite(value) and value >= 0):
                raise ArgumentError(f"weight {name} is {value}; it must be a number of at least 0.")

    @property
    def without_objects(self) -> "Weights":
        """The weights for a person alone: with no contact to give way to, the body follows its references closely."""
        return self._multiplied(WITHOUT_OBJECTS)

    @property
    def with_surfaces(self) -> "Weights":
        """The weights for contact between surfaces."""
        return self._multiplied(SURFACE_CONTACT)

    def _multiplied(self, factors: Mapping[str, float]) -> "Weights":
        return replace(self, **{name: factor * getattr(self, name) for name, factor in factors.items()})


SURFACE_CONTACT: Mapping[str, float] = MappingProxyType({"base_position": 50.0, "jerk": 5.5, "hand_orientation": 20.0})
"""Weight -> its factor where surfaces touch: what hands lose of the human's small motions, the body keeps."""


@dataclass(frozen=True)
class Horizon:
    """Number of frames that are solved at once."""

    length: int = 1000  # Frames in a window; a clip that is no longer is solved whole.
    overlap: int = 60  # Frames that a window shares with the one before.
    pinned: int = PINNED  # Leading frames of a window that keep what the one before found; three carry the jerk over.

    def __post_init__(self) -> None:
        if not 0 <= self.pinned <= self.overlap < self.length:
            raise ArgumentError(
                f"horizon: length {self.length}, overlap {self.overlap}, pinned {self.pinned}; "
                "they must satisfy 0 <= pinned <= overlap < length."
            )

    @property
    def text(self) -> str:
        """The shortest text that `parse_horizon` reads as this horizon."""
        for name, preset in _PRESETS.items():
            if self == preset:
                return name
        numbers = (self.length, self.overlap) if self.pinned == PINNED else (self.length, self.overlap, self.pinned)
        return ":".join(map(str, ("windowed", *numbers)))


# One new frame cannot pay for a third difference: with three pinned frames it would extrapolate. A window
# of two has no such row, and each frame follows its predecessor through the speed limits alone.
_PRESETS = {"auto": Horizon(), "whole": Horizon(length=10**9), "per-frame": Horizon(2, 1, 1)}


def parse_horizon(text: str) -> Horizon:
    """Return the horizon for `auto`, `whole`, `per-frame` or `windowed:LENGTH[:OVERLAP[:PINNED]]`.

    Raises `ArgumentError` for anything else.
    """
    kind, *numbers = text.split(":")
    if not numbers and kind in _PRESETS:
        return _PRESETS[kind]
    if kind == "windowed" and len(numbers) == 3 and all(n.isascii() and n.isdecimal() for n in numbers):
        return Horizon(*map(int, numbers))
    if kind == "windowed" and 1 <= len(numbers) <= 2 and all(n.isascii() and n.isdecimal() for n in numbers):
        length, overlap = int(numbers[0]), int(numbers[1]) if len(numbers) == 2 else LOOK_AHEAD
        if length >= MIN_WINDOW_FRAMES and PINNED <= overlap < length:
            return Horizon(length, overlap, PINNED)
        raise ArgumentError(
            f"horizon {text!r}: LENGTH must be at least {MIN_WINDOW_FRAMES} frames, for shorter windows extrapolate "
            f"the jerk of the {PINNED} frames they keep; OVERLAP at least {PINNED} and less than LENGTH."
        )
    raise ArgumentError(f"horizon {text!r}: expected auto, whole, per-frame or windowed:LENGTH[:OVERLAP].")


@dataclass(frozen=True)
class IkWeights:
    """Weights of the IK stage on top of the robot's own table."""

    smoothness: float = 5.0  # First differences of q [1/frame^2].

    def __post_init__(self) -> None:
        if not (isfinite(self.smoothness) and self.smoothness >= 0):
            raise ArgumentError(f"IK weight smoothness is {self.smoothness}; it must be a number of at least 0.")


@dataclass(frozen=True)
class IkConfig:
    """Options of the IK stage."""

    weights: IkWeights = IkWeights()
    stride: int = 10  # The first solve sees every n-th frame; the second starts from its interpolation.
    solver: BandedInteriorPoint = BandedInteriorPoint(max_iterations=60, tolerance=1e-3, step_tolerance=2e-2)

    def __post_init__(self) -> None:
        if self.stride < 1:
            raise ArgumentError(f"stride is {self.stride}; it must be at least 1 frame.")


ContactKind = Literal["surface", "landmark"]
HoldKind = Literal["touch", "simulated"]
ObjectPathKind = Literal["free", "fixed"]


@dataclass(frozen=True)
class Config:
    """Everything that decides a result beside the clip and the robot."""

    scaling: Scaling = Scaling()
    weights: Weights = Weights()
    ik: IkConfig = IkConfig()
    solver: Solver = BandedInteriorPoint()  # Of the trajectory; any value with a `solve` method.
    horizon: Horizon = Horizon()
    contact: ContactKind = "surface"
    """What a labelled contact asks for: the hand's surface on the object's, and nothing inside anything, or the palm's
    landmark at the human's (paper Eq. 1)."""
    holds: HoldKind = "touch"
    """What holds of hands are chosen by, in surface contact: touch near the person's place; or simulated, too, that two
    free hands keep the object, which takes seconds of CPU a clip."""
    object_path: ObjectPathKind = "free"
    """Whether a lifted object may give way, by 3 cm and 5 degrees at most, where arms cannot reach the holds on it."""
    physics: Physics = Physics()  # Decides figures of physics and holds, not the motion else.
    figures: FigureSet = "all"  # Figures that are computed; the motion does not depend on them.

    def as_json(self) -> dict[str, Any]:
        """Return plain JSON values, which `from_table` reads again."""
        name = type(self.solver).__name__
        options = asdict(self.solver) if is_dataclass(self.solver) and not isinstance(self.solver, type) else {}
        plain = {name: asdict(getattr(self, name)) for name in _TABLES}
        chosen = {name: getattr(self, name) for name in ("holds", "object_path", "figures")}
        changed = {name: value for name, value in chosen.items() if value != getattr(type(self), name)}
        return {**plain, "contact": self.contact, **changed, "solver": {"name": name, **options}}

    @classmethod
    def from_table(cls, table: Mapping[str, Any], owner: str) -> "Config":
        """Return the configuration of a table, with defaults for missing keys.

        Raises `ReadError`: a key does not exist, or a value is not of its field's type; `ArgumentError`: a value is out
        of its range.
        """
        check_keys(cls, table, owner)
        values: dict[str, Any] = {}
        for name, value in table.items():
            place = f"{owner}: {name}"
            if name == "horizon" and isinstance(value, str):
                values[name] = parse_horizon(value)
            elif name in _CHOICES:
                if value not in _CHOICES[name]:
                    raise ReadError(f"{place} is {value!r}; expected {' or '.join(_CHOICES[name])}.")
                values[name] = value
            else:
                values[name] = (
                    _solver(value, place)
                    if name == "solver"
                    else decode(type(_TABLES[name]), value, place, default=_TABLES[name])
                )
        return cls(**values)


_CHOICES = {
    "contact": get_args(ContactKind),
    "holds": get_args(HoldKind),
    "object_path": get_args(ObjectPathKind),
    "figures": get_args(FigureSet),
}
_TABLES = {"scaling": Scaling(), "weights": Weights(), "ik": IkConfig(), "horizon": Horizon(), "physics": Physics()}


def _solver(table: Any, owner: str) -> Solver:
    name = table.get("name", BandedInteriorPoint.__name__) if isinstance(table, Mapping) else table
    if name not in SOLVERS:
        raise ReadError(f"{owner}: there is no solver {name!r} here. Solvers: {', '.join(SOLVERS)}.")
    options = {key: value for key, value in table.items() if key != "name"} if isinstance(table, Mapping) else {}
    return decode(SOLVERS[name], options, owner)


def read_config(path: Path) -> Config:
    """Return the configuration of a TOML file; raises the errors of `Config.from_table`."""
    return Config.from_table(read_toml(path), str(path))
