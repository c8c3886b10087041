"""Reads the motion of a robot as the clip of a person, to be retargeted to another robot with objects and contacts.

Any file that `check-motion` reads is one, as its numbers are found to be. Objects are at the size that the robot had
them. Contacts are those of this project's results and of files with flags by part; otherwise they are found from
distances between the robot's skin and the objects.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hoi_retarget.clip.clip import ContactTrack
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.clip.robot_person import person_of
from hoi_retarget.errors import ArgumentError, GeometryError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import BODY_PARTS, PARTS
from hoi_retarget.motion import formats
from hoi_retarget.motion.check import CheckedMotion, ObjectPath, check
from hoi_retarget.motion.formats import MotionFile, own_result
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.result_file import load
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.object_joint import scaled
from hoi_retarget.objects.track import ObjectGeometry, ObjectJoint, ObjectTrack
from hoi_retarget.readers.mjcf_objects import objects_beside
from hoi_retarget.readers.object_files import load_geometry
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import RobotModel

LICENCE = "that of the robot's motion and of the recording that it was made from"


def holds(file: SourceFile) -> bool:
    """Return whether a file is a robot's motion."""
    try:
        formats.read(file.path)
    except (ReadError, OSError):
        return False
    return True


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a file, as the motion of the robot that the options name."""
    model = load_robot(options.from_robot or "")
    if model.spec.base != "legs":
        raise ArgumentError(f"--from {model.spec.name}: it has no legs, which a person is retargeted with.")
    stored = formats.read(file.path)
    for path in [file.path] if file.path.is_file() else sorted(filter(Path.is_file, file.path.iterdir())):
        file.read(path)  # For the digest.
    if stored.format == own_result.FORMAT.name:
        return _of_result(file, options, load(file.path), model)
    found = check(stored, model)

    def read_tracks() -> Tracks:
        objects = tuple(track for item in found.objects for track in _objects(file, options, stored, item))
        person = person_of(model.forward(found.qpos))
        contacts = _flagged(stored, person, objects)
        return Tracks(people=(person,), objects=objects, contacts=contacts, notes=_notes(found))

    names = tuple(item.name for item in found.objects)
    facts = {"frames": found.frames, "fps": found.fps, "fps_stated": not found.fps_assumed, "licence": LICENCE}
    return _recording(file, model, objects=names, read_tracks=read_tracks, **facts)


def _recording(file: SourceFile, model: RobotModel, **facts: Any) -> SourceRecording:
    return SourceRecording(
        name=file.path.stem,
        description=f"motion of the robot {model.spec.name}, as a person",
        skeleton=f"the links of {model.spec.name}",
        contacts="those of the motion, or found from the robot's skin",
        up="z",
        names_objects=False,
        may_lie=True,
        **facts,
    )


def _notes(found: CheckedMotion) -> tuple[str, ...]:
    lacking = f"Joints that the file lacks are at 0: {', '.join(found.missing_joints)}." if found.missing_joints else ""
    wrong = "; ".join(f"{item.subject}: {item.numbers}" for item in found.causes)
    return tuple(filter(None, [lacking, f"The file's numbers contradict its claims ({wrong})." if wrong else ""]))


def _geometry(file: SourceFile, options: ReadOptions, name: str) -> ObjectGeometry:
    if options.objects is None:
        raise GeometryError(
            f"{file.name}: the motion moves {name!r}, whose shape it does not hold. Pass --objects DIR with "
            f"{name}/{name}.obj in it, and --object NAME where it has another name there."
        )
    return load_geometry(options.objects, options.object_name or name)


def _objects(file: SourceFile, options: ReadOptions, stored: MotionFile, path: ObjectPath) -> tuple[ObjectTrack, ...]:
    """Return an object with the shape that the options name, or with its parts by an MJCF beside the motion."""
    if options.objects is options.object_name is None and (beside := objects_beside(file, stored, path)):
        return beside
    name = options.object_name or path.name
    return (ObjectTrack(name, path.pos, path.quat, _geometry(file, options, path.name)),)


def _flagged(stored: MotionFile, person: Person, objects: tuple[ObjectTrack, ...]) -> tuple[ContactTrack, ...]:
    """Return the contacts of a file's flags, where these are named as parts; none otherwise."""
    flags = stored.contacts
    if flags is None or len(objects) != 1 or not set(flags.names) <= set(PARTS):
        return ()
    columns = zip(flags.names, flags.flags.T, strict=True)
    return tuple(
        ContactTrack(0, 0, part, active, objects[0].to_object(person.part_position(part))) for part, active in columns
    )


def _of_result(file: SourceFile, options: ReadOptions, motion: Motion, model: RobotModel) -> SourceRecording:
    if motion.robot != model.spec.name:
        raise ArgumentError(f"--from {model.spec.name}: {file.name} is a result for {motion.robot}. Pass --from that.")

    def read_tracks() -> Tracks:
        scales, places, turns = motion.object_scale.tolist(), motion.object_pos, motion.object_quat
        recorded = zip(motion.object_names, _shapes(file, options, motion), scales, strict=True)
        objects = tuple(
            ObjectTrack(name, places[:, index], turns[:, index], _at_size(shape, scale), joint and scaled(joint, scale))
            for index, (name, (shape, joint), scale) in enumerate(recorded)
        )
        person = person_of(model.forward(motion.qpos))
        return Tracks(people=(person,), objects=objects, contacts=tuple(_contacts(motion, model, person, objects)))

    licence = motion.report.source.licence or LICENCE
    facts = {"frames": motion.frames, "fps": motion.fps, "fps_stated": True, "licence": licence}
    return _recording(file, model, objects=motion.object_names, read_tracks=read_tracks, **facts)


def _shapes(file: SourceFile, options: ReadOptions, motion: Motion) -> list[tuple[ObjectGeometry, ObjectJoint | None]]:
    """Return shapes and joints of a result's objects as captured: of its clip, or shapes of the named folder."""
    from hoi_retarget.readers.open import clip_of  # noqa: PLC0415  # it reads by way of this package

    named = [_geometry(file, options, name) for name in motion.object_names] if options.objects is not None else []
    try:
        recorded = clip_of(motion).objects if motion.object_names else ()
    except ReadError as error:
        if named:
            return [(shape, None) for shape in named]
        raise GeometryError(f"{file.name}: {error} Or pass --objects DIR with the shapes of its objects.") from error
    return list(zip(named or [one.geometry for one in recorded], [one.joint for one in recorded], strict=True))


def _at_size(shape: ObjectGeometry, scale: float) -> ObjectGeometry:
    if scale == 1.0:
        return shape
    if not shape.has_surface:
        return ObjectGeometry(scale * shape.points)
    surface = surface_of(shape)
    return ObjectGeometry(scale * surface.vertices, faces=surface.faces)


def _contacts(
    motion: Motion, model: RobotModel, person: Person, objects: tuple[ObjectTrack, ...]
) -> Iterator[ContactTrack]:
    """Yield a result's contacts, at the places of the robot's own palms, feet and links."""
    sites = {site: part for part, site in model.spec.contact_sites.items() if part in PARTS | BODY_PARTS}
    for column, link in enumerate(motion.contact_links):
        for index, track in enumerate(objects):
            active = motion.contact_flags[:, column] & (motion.contact_object[:, column] == index)
            if link in sites and (sites[link] in PARTS or active.any()):
                part = sites[link]
                yield ContactTrack(0, index, part, active, track.to_object(person.part_position(part)))


READER = Reader("robot-motion", record, holds=holds, floor_at_zero=True)
