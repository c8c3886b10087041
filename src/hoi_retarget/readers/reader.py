"""The interface of readers: recordings as data sets have them, and checked clips with z up made of them."""

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from hoi_retarget.clip.clip import Clip, ContactTrack, Source
from hoi_retarget.clip.grasp_check import ONLY_INVERSE
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import FINGER_PARTS, PARTS
from hoi_retarget.objects.track import ObjectTrack
from hoi_retarget.readers.body_parameters import BodyParameters, person_of_rows
from hoi_retarget.readers.fields import check_frames, refuse_object_name
from hoi_retarget.readers.worlds import World, check_upright


@dataclass(frozen=True, kw_only=True)
class Outline:
    """Facts of a recording from its own files, without shapes and body models."""

    description: str  # Such as `BEHAVE recording of one person and one object`.
    frames: int
    fps: float  # Frames a second.
    fps_stated: bool = False  # Whether the recording states its rate; otherwise its format implies it.
    skeleton: str  # The kind of body, such as `SMPL-H male, 10 betas`.
    up_axis: str = ""  # The axis that is up in the recording, and the source of that fact.
    people: int = 1
    objects: tuple[str, ...]  # Their names; empty for an object that the recording does not name.
    contacts: str = "none stored"  # The origin of contacts, such as `labels of the hands`.
    licence: str
    notes: tuple[str, ...] = ()  # What was found before the arrays were read, one sentence each.


@dataclass(frozen=True, eq=False, kw_only=True)
class Tracks:
    """People and objects of a recording over time, in its source's own world."""

    people: tuple[Person | BodyParameters, ...]
    objects: tuple[ObjectTrack, ...]
    touching: Mapping[tuple[int, str], Bool[np.ndarray, "T"]] = field(default_factory=dict)
    """Index of an object and part of the first person -> when they touch; nothing where contacts are not labelled."""
    contacts: tuple[ContactTrack, ...] = ()  # Where the source has their points, too.
    notes: tuple[str, ...] = ()  # What was found in the arrays, one sentence each.


@dataclass(frozen=True, eq=False, kw_only=True)
class SourceRecording(Outline):
    """One recording of a data set; the format states its up axis where `up_axis` is empty."""

    name: str  # Of the clip.
    up: str | Callable[[Person], World]
    """The source's axis that is up, one of `worlds.TURN`, or a function that finds its world from the first person."""
    read_tracks: Callable[[], Tracks]
    """Returns the arrays; raises `ReadError`, `ClipError`, `GeometryError` or `BodyModelError`."""
    names_objects: bool = True  # Whether it tells the names of its objects, so that the user cannot.
    first_frame: int = 0  # Number of the source's frames before its first one.
    checks_upright: bool = True  # Whether people must have a person's size and stand upright.
    may_lie: bool = False  # Whether it may be of people who never stand upright, lying on a floor near 0.
    path: Path | None = None  # Of the clip's file, where it stands for the folder that it is in.
    sha256: str = ""  # Where its bytes were not read by way of `SourceFile`.

    def world(self, person: Person) -> World:
        """Return the world of the recording, from its first person where the format does not state it."""
        return World.of_axis(self.up) if isinstance(self.up, str) else self.up(person)


@dataclass(frozen=True)
class Headline:
    """Facts that recordings of a release are selected and counted by."""

    words: str  # Names and kinds of objects, and the text of the recording.
    objects: tuple[str, ...]  # Their names; of several recordings, the same object has the same.
    seconds: float


Record = Callable[[SourceFile, ReadOptions], SourceRecording]
"""Returns the recording in a file; raises `ReadError` or `ClipError`."""


@dataclass(frozen=True)
class Reader:
    """One format: its recognition and its reading.

    Clips come out with z up, in metres; contacts are empty where the source has none.
    """

    format: str  # Its name, in small letters with dashes.
    record: Record
    _: KW_ONLY
    holds: Callable[[SourceFile], bool]
    """Tells whether a file with one of the reader's endings is of this format, by names and shapes alone."""
    floor_at_zero: bool = False
    """Whether the format has the floor at z = 0; otherwise its height is estimated from the clip."""
    rotation_readings: tuple[str, ...] = ONLY_INVERSE
    """Other ways in which copies could mean objects' rotations: those of `grasp_check.READINGS` that are left open."""
    clips_in: Callable[[SourceFile], tuple[str, ...]] = lambda _file: ()
    """Returns the names of the clips to select from; none where the recording is one clip."""
    parts: tuple[str, ...] = ()
    """Files that a folder of this format has, where some alone tell that the others are missing."""
    has_companions: Callable[[SourceFile], bool] = lambda _file: True
    """Tells whether a recording may need files that are not known until it is read, such as body models."""

    headline_of: Callable[[SourceFile], Headline] | None = None
    """Tells them without the motion, where the format has them elsewhere."""

    def headline(self, file: SourceFile) -> Headline:
        """Return the facts to select a recording by; raises `ReadError` or `ClipError`."""
        if self.headline_of is not None:
            return self.headline_of(file)
        outline = self.outline(file)
        return Headline(" ".join((*outline.objects, *outline.notes)), outline.objects, outline.frames / outline.fps)

    def outline(self, file: SourceFile, options: ReadOptions = ReadOptions()) -> Outline:
        """Return the facts of a recording, cheaply; raises `ReadError` or `ClipError`."""
        recording = self.record(file, options)
        return replace(recording, up_axis=recording.up_axis or f"{recording.up}, as the format has it")

    def read(self, file: SourceFile, options: ReadOptions) -> Clip:
        """Return the clip; raises `ReadError`, `ClipError`, `GeometryError`, `BodyModelError` or `ArgumentError`."""
        recording = self.record(file, options)
        if recording.names_objects:
            refuse_object_name(file, options, ", ".join(recording.objects) or "none")
        check_frames(file.path, {"recording": recording.frames})
        tracks = recording.read_tracks()
        people, shape_notes = _people(file, tracks, options)
        world = recording.world(people[0])
        people = tuple(world.turned_person(person) for person in people)
        if recording.checks_upright:
            for person in people:
                check_upright(file.path, person, world.up, may_lie=recording.may_lie)
        objects = tuple(world.turned_object(track) for track in tracks.objects)
        notes = (*recording.notes, *filter(None, [world.note]), *shape_notes, *tracks.notes)
        path, sha256 = str(recording.path or file.name), recording.sha256 or file.sha256
        try:
            return Clip(
                name=recording.name,
                fps=recording.fps,
                people=people,
                objects=objects,
                contacts=tracks.contacts or _contacts(tracks.touching, people[0], objects),
                source=Source(path, sha256, self.format, recording.licence, notes),
                first_source_frame=recording.first_frame,
            )
        except ClipError as error:
            raise ClipError(f"{path}: {error}") from error


def _people(file: SourceFile, tracks: Tracks, options: ReadOptions) -> tuple[tuple[Person, ...], tuple[str, ...]]:
    """Return all people as joints, and notes of their bodies."""
    made = [
        person_of_rows(file.path, "person", person, options.body_models)
        if isinstance(person, BodyParameters)
        else (person, ())
        for person in tracks.people
    ]
    return tuple(person for person, _ in made), tuple(note for _, notes in made for note in notes)


def _contacts(
    touching: Mapping[tuple[int, str], Bool[np.ndarray, "T"]], person: Person, objects: tuple[ObjectTrack, ...]
) -> tuple[ContactTrack, ...]:
    """Return the contacts of all parts with each labelled object, at the parts' own points."""
    nobody = np.zeros(len(person.joint_positions), dtype=bool)
    return tuple(
        ContactTrack(0, index, part, touching.get((index, part), nobody), track.to_object(person.part_position(part)))
        for index, track in enumerate(objects)
        if any(index == labelled for labelled, _ in touching)
        for part in (*PARTS, *(part for part in FINGER_PARTS if (index, part) in touching))
    )
