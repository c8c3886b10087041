"""Reads and writes clips in a layout of our own, for recordings that no other reader knows: one `.npz`, documented.

z up, floor at z = 0, metres, seconds, quaternions wxyz, no pickled objects; `docs/sources.md` describes every
array. People are given as joints or as parameters of a body model. Missing parts are derived by a stated rule or
refused: fingers are straight and hands flat where there are none, contact points are the parts' own points where none
are given. Nothing else is made up.

A folder is a clip, too, where it holds `clip.npz` in this layout, its meshes, and no other recording.
"""

from pathlib import Path

from hoi_retarget.clip.grasp_check import READINGS
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError, ReadError
from hoi_retarget.files import npz
from hoi_retarget.files.reading import read_bytes
from hoi_retarget.files.source_file import FOLDER, SourceFile
from hoi_retarget.readers.own_layout.own_arrays import FORMAT, SCHEMA_KEY, Arrays, encode, write
from hoi_retarget.readers.own_layout.own_objects import contacts_of, has_contacts, mesh_paths, object_names, objects_of
from hoi_retarget.readers.own_layout.own_people import BODY_JOINTS, PARAMETER_ARRAYS, people_of, summary_of
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks

__all__ = ["BODY_JOINTS", "FORMAT", "READER", "encode", "mesh_files", "write"]

_OTHERS = (".pt", ".pth")
"""Endings of other recordings that are files; those that end with `.npz` say themselves what they are."""


def holds(file: SourceFile) -> bool:
    """Return whether an `.npz` file says that it is of this layout, or a folder holds such a clip and no other."""
    if file.suffix != FOLDER:
        return SCHEMA_KEY in file.array_names
    clip = file.clip_file
    try:
        return _has_schema(clip) and not any(_is_recording(path) for path in file.path.rglob("*") if path != clip)
    except OSError:
        return False


def _has_schema(path: Path) -> bool:
    return SCHEMA_KEY in SourceFile(path).array_names


def _is_recording(path: Path) -> bool:
    return path.suffix.lower() in _OTHERS or (path.suffix.lower() == ".npz" and _has_schema(path))


def has_parameters(file: SourceFile) -> bool:
    """Return whether the people of a clip are parameters, which body models are needed for."""
    return PARAMETER_ARRAYS[0] in SourceFile(file.clip_file).array_names


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a file or folder; shapes may be in the clip, beside it, or in the objects' folder."""
    path = file.clip_file
    content = file.content if path == file.path else file.read(path)
    try:
        arrays = Arrays(path, npz.members(content))
    except ValueError as error:
        raise ReadError(f"{path}: not a readable .npz file ({error}). Write it again.") from error
    arrays.check_schema()
    frames, count, skeleton = summary_of(arrays)

    def read_tracks() -> Tracks:
        people, notes = people_of(arrays, options.body_models)
        tracks = objects_of(arrays, len(people[0].joint_positions), options.objects)
        contacts, contact_notes = contacts_of(arrays, people, tracks)
        arrays.check_all_used()
        return Tracks(people=people, objects=tracks, contacts=contacts, notes=(*notes, *contact_notes))

    return SourceRecording(
        name=arrays.text("name", "what the clip is called"),
        description="a clip in the layout of this project",
        frames=frames,
        fps=arrays.number("fps", "frames a second"),
        fps_stated=True,
        skeleton=skeleton,
        up="z",
        up_axis="z, as the file says",
        people=count,
        objects=tuple(object_names(arrays)),
        contacts="the file" if has_contacts(arrays) else "none in the file; found from distances",
        licence=arrays.text("licence", "the terms of the data, such as 'CC BY 4.0'"),
        notes=arrays.texts("notes"),
        read_tracks=read_tracks,
        first_frame=arrays.count("first_source_frame"),
        checks_upright=False,  # `people_of` does, in words for those who write clips.
        path=path,
    )


def mesh_files(path: Path) -> tuple[Path, ...]:
    """Return the mesh files beside a clip that it may need, whether there or not; none where it cannot be read."""
    file = SourceFile(path).clip_file
    try:
        return mesh_paths(Arrays(file, npz.members(read_bytes(file))))
    except (ReadError, ValueError, ClipError):
        return ()


READER = Reader(
    FORMAT, record, holds=holds, floor_at_zero=True, rotation_readings=tuple(READINGS), has_companions=has_parameters
)
