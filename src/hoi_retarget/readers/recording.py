"""One recording of a data set as its reader finds it: in its source's own world, its arrays read when asked for."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool

from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.person import Person
from hoi_retarget.objects.track import ObjectTrack
from hoi_retarget.readers.body_parameters import BodyParameters
from hoi_retarget.readers.reader import Outline, ReadOptions
from hoi_retarget.readers.worlds import World


@dataclass(frozen=True, eq=False, kw_only=True)
class Tracks:
    """People and objects of a recording over time, in its source's own world."""

    people: tuple[Person | BodyParameters, ...]
    objects: tuple[ObjectTrack, ...]
    touching: Mapping[str, Bool[np.ndarray, "T"]] = field(default_factory=dict)
    """Part of the first person -> when it touches the first object; nothing where contacts are not labelled."""
    notes: tuple[str, ...] = ()
    """What was found in the arrays, one sentence each."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """What a reader finds in one recording."""

    name: str
    """Of the clip."""
    outline: Outline
    read_tracks: Callable[[], Tracks]
    """Returns the arrays; raises `ReadError`, `ClipError`, `GeometryError` or `BodyModelError`."""
    world: World | Callable[[Person], World]
    """Which way is up, or what tells it from the first person."""
    names_objects: bool = True
    """Whether it tells the names of its objects, so that the user cannot."""
    first_frame: int = 0
    """How many frames of the source are before its first one."""
    sha256: str = ""
    """Where its bytes were not read by way of `SourceFile`."""


Record = Callable[[SourceFile, ReadOptions], Recording]
"""Returns what a file holds; raises `ReadError` or `ClipError`."""
