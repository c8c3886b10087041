"""Makes clips and outlines of the recordings that readers find: z up, checked, with all that is to be noted."""

from collections.abc import Callable

import numpy as np

from hoi_retarget.clip.clip import Clip, ContactTrack, Source
from hoi_retarget.clip.grasp_check import ONLY_INVERSE
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import PARTS
from hoi_retarget.objects.track import ObjectTrack
from hoi_retarget.readers.body_parameters import BodyParameters, person_of_rows
from hoi_retarget.readers.companions import check_frames, refuse_object_name
from hoi_retarget.readers.reader import Reader, is_one_clip
from hoi_retarget.readers.recording import Record, Recording, Tracks
from hoi_retarget.readers.upright import check_upright


def data_set(  # noqa: PLR0913 - what data sets differ in
    name: str,
    suffixes: tuple[str, ...],
    record: Record,
    *,
    holds: Callable[[SourceFile], bool],
    clips_in: Callable[[SourceFile], tuple[str, ...]] = is_one_clip,
    parts: tuple[str, ...] = (),
    floor_at_zero: bool = False,
    rotation_readings: tuple[str, ...] = ONLY_INVERSE,
) -> Reader:
    """Return the reader of a data set from what finds its recordings; arguments are as the fields of `Reader`."""
    return Reader(
        format=name,
        suffixes=suffixes,
        floor_at_zero=floor_at_zero,
        rotation_readings=rotation_readings,
        holds=holds,
        read=lambda file, options: _clip(name, record(file, options), file, options),
        clips_in=clips_in,
        parts=parts,
        outline=lambda file: record(file, ReadOptions()).outline,
    )


def _clip(format_name: str, recording: Recording, file: SourceFile, options: ReadOptions) -> Clip:
    """Return the clip of a recording; raises as `Reader.read`."""
    if recording.names_objects:
        refuse_object_name(file, options, ", ".join(recording.objects) or "none")
    check_frames(file.path, {"recording": recording.frames})
    tracks = recording.read_tracks()
    people, shape_notes = _people(file, tracks, options)
    world = recording.world(people[0])
    people = tuple(world.turned_person(person) for person in people)
    for person in people:
        check_upright(file.path, person, world.up, may_lie=recording.may_lie)
    objects = tuple(world.turned_object(track) for track in tracks.objects)
    notes = (*recording.notes, *filter(None, [world.note]), *shape_notes, *tracks.notes)
    return Clip(
        name=recording.name,
        fps=recording.fps,
        people=people,
        objects=objects,
        contacts=_contacts(tracks, people[0], objects[0]) if tracks.touching else (),
        source=Source(str(file.name), recording.sha256 or file.sha256, format_name, recording.licence, notes),
        first_source_frame=recording.first_frame,
    )


def _people(file: SourceFile, tracks: Tracks, options: ReadOptions) -> tuple[tuple[Person, ...], tuple[str, ...]]:
    """Return all people as joints, and what is to be noted of their bodies."""
    made = [
        person_of_rows(file.path, "person", person, options.body_models)
        if isinstance(person, BodyParameters)
        else (person, ())
        for person in tracks.people
    ]
    return tuple(person for person, _ in made), tuple(note for _, notes in made for note in notes)


def _contacts(tracks: Tracks, person: Person, track: ObjectTrack) -> tuple[ContactTrack, ...]:
    nobody = np.zeros(len(track.positions), dtype=bool)
    return tuple(
        ContactTrack(0, 0, part, tracks.touching.get(part, nobody), track.to_object(person.part_position(part)))
        for part in PARTS
    )
