"""What every reader of recordings offers."""

from collections.abc import Callable
from dataclasses import dataclass

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.grasp_check import ONLY_INVERSE
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.files.source_file import SourceFile


@dataclass(frozen=True)
class Outline:
    """What a recording holds, as far as its own files say without shapes and body models."""

    description: str
    """Such as `BEHAVE recording of one person and one object`."""
    frames: int
    fps: float
    """Frames a second."""
    fps_stated: bool
    """Whether the recording states its rate; otherwise its format implies it."""
    skeleton: str
    """What the person is given as, such as `SMPL-H male, 10 betas`."""
    up_axis: str
    """Which way is up in the recording, and who says so."""
    people: int
    objects: tuple[str, ...]
    """Their names; empty for an object that the recording does not name."""
    contacts: str
    """Where contacts come from, such as `none stored` or `labels of the hands`."""
    licence: str
    notes: tuple[str, ...] = ()


def always_has_companions(_file: SourceFile) -> bool:
    """Return True: what lies beside the recording, or body models, may be missing when it is read first."""
    return True


def never_has_companions(_file: SourceFile) -> bool:
    """Return False: the recording needs no other file than its objects' geometry."""
    return False


def is_one_clip(_file: SourceFile) -> tuple[str, ...]:
    """Return no names: each recording is one clip."""
    return ()


@dataclass(frozen=True, kw_only=True)
class Reader:
    """How one format is recognized and read.

    Clips come out with z up, in metres; contacts are empty where the source has none.
    """

    format: str
    """Its name, in small letters with dashes."""
    suffixes: tuple[str, ...]
    """Endings of file names in small letters, or `FOLDER`."""
    holds: Callable[[SourceFile], bool]
    """Tells whether a file with one of the suffixes is of this format, by names and shapes alone."""
    read: Callable[[SourceFile, ReadOptions], Clip]
    """Returns the clip; raises `ReadError`, `ClipError`, `GeometryError`, `BodyModelError` or `ArgumentError`."""
    floor_at_zero: bool = False
    """Whether the format has the floor at z = 0; otherwise its height is estimated from the clip."""
    rotation_readings: tuple[str, ...] = ONLY_INVERSE
    """Other ways in which copies could mean objects' rotations: those of `grasp_check.READINGS` that are left open."""
    clips_in: Callable[[SourceFile], tuple[str, ...]] = is_one_clip
    """Returns the names of the clips to select from; none where the recording is one clip."""
    parts: tuple[str, ...] = ()
    """Files that a folder of this format has, where some alone tell that the others are missing."""
    outline: Callable[[SourceFile], Outline]
    """Returns what the recording is and holds, cheaply; raises `ReadError` or `ClipError`."""
    has_companions: Callable[[SourceFile], bool] = always_has_companions
    """Tells whether a recording may need files that are not known until it is read."""
