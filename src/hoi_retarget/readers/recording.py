"""One recording of a data set as its reader finds it: in its source's own world, its arrays read when asked for."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.person import Person
from hoi_retarget.objects.track import ObjectTrack
from hoi_retarget.readers.body_parameters import BodyParameters
from hoi_retarget.readers.reader import Outline
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
    """What a reader finds in one recording; fields that `Outline` has too mean the same."""

    name: str
    """Of the clip."""
    description: str
    frames: int
    fps: float
    rate_stated: bool = False
    """Whether the recording states its rate; otherwise its format implies it."""
    skeleton: str
    up: str | Callable[[Person], World]
    """The source's axis that is up, one of `worlds.TURN`, or what finds its world from the first person."""
    up_axis: str = ""
    """Who says so, where that is not the format."""
    people: int = 1
    objects: tuple[str, ...]
    contacts: str = "none stored"
    licence: str
    notes: tuple[str, ...] = ()
    """What was found before the arrays were read, one sentence each."""
    read_tracks: Callable[[], Tracks]
    """Returns the arrays; raises `ReadError`, `ClipError`, `GeometryError` or `BodyModelError`."""
    names_objects: bool = True
    """Whether it tells the names of its objects, so that the user cannot."""
    first_frame: int = 0
    """How many frames of the source are before its first one."""
    may_lie: bool = False
    """Whether it may be of people who never stand upright, lying on a floor near 0."""
    sha256: str = ""
    """Where its bytes were not read by way of `SourceFile`."""

    @property
    def outline(self) -> Outline:
        """What is known without its arrays."""
        return Outline(
            description=self.description,
            frames=self.frames,
            fps=self.fps,
            fps_stated=self.rate_stated,
            skeleton=self.skeleton,
            up_axis=self.up_axis or f"{self.up}, as the format has it",
            people=self.people,
            objects=self.objects,
            contacts=self.contacts,
            licence=self.licence,
            notes=self.notes,
        )

    def world(self, person: Person) -> World:
        """Return the world in which the recording is, by its first person where that tells it."""
        return World.of_axis(self.up) if isinstance(self.up, str) else self.up(person)


Record = Callable[[SourceFile, ReadOptions], Recording]
"""Returns what a file holds; raises `ReadError` or `ClipError`."""
