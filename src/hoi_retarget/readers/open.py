"""Clips by name: a built-in one, a recording's file, or the source of a result."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from hoi_retarget.clip import grasp_check
from hoi_retarget.clip.augment import at_rate, augment, resampled
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits import ContactEdits, apply, from_text
from hoi_retarget.clip.floor import on_floor
from hoi_retarget.clip.infer_contacts import with_contacts
from hoi_retarget.clip.leads import with_leads
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.clip.shape_check import with_shape_warnings
from hoi_retarget.errors import HoiRetargetError, ReadError
from hoi_retarget.files.source_file import FOLDER, SourceFile
from hoi_retarget.motion.motion import SIMULATED, Motion
from hoi_retarget.readers import read_recording
from hoi_retarget.readers.builtin_clips import builtin_clip, builtin_scene
from hoi_retarget.readers.bvh import ACTOR
from hoi_retarget.readers.reader import Reader

_ADVICE = "Pass --clip to name it."
_NAMED_BY_FOLDER = ("hmr4d_results", "motion", Path(ACTOR).stem)


def open_clip(name: Path | str, options: ReadOptions = ReadOptions()) -> Clip:
    """Return a clip by its name, `builtin:<scene>` or the path of a recording, with floor and contacts.

    Facts that the source leaves open are found from the motion, and are in the clip's notes. `FILE#NAME` is one clip of
    a file that holds several.

    Raises `ArgumentError`: there is no such built-in clip; `ReadError`: the file is missing, damaged, or of no
    supported format; `ClipError`: its content cannot be used; `GeometryError`: the object's geometry cannot be had;
    `BodyModelError`: the body model that it needs cannot be had.
    """
    clip, reader = _as_recorded(name, options)
    recorded = on_floor(clip, at_zero=reader is None or reader.floor_at_zero, floor=options.floor)
    if reader is not None:  # Built-in shapes fit.
        recorded = with_shape_warnings(recorded, options.grasps)
    readings = grasp_check.ONLY_INVERSE if reader is None else reader.rotation_readings
    clip = with_contacts(recorded, options.labels, readings=readings, grasps=options.grasps)
    if clip.contacts is not recorded.contacts:  # The recording's own were checked when they were read.
        clip = grasp_check.with_grasp_warnings(clip, readings, shifts=(), grasps=options.grasps)
    return with_leads(clip, options.lead_in, options.lead_out)


def _as_recorded(name: Path | str, options: ReadOptions) -> tuple[Clip, Reader | None]:
    """Return the clip and the reader of its file, if it is one."""
    scene = builtin_scene(name)
    if scene is None:
        return read_recording(Path(name), options)
    return at_rate(builtin_clip(scene), options.fps), None


def result_stem(name: Path | str) -> str:
    """Return the name of results made of a clip, without `.npz`.

    Names that say little alone, such as `res.pkl` and `004`, are those of many clips: their folders' stand before them.
    """
    stem = clip_stem(name)
    parents = Path(name).absolute().parts[:-1]
    if stem == "res":
        return "_".join(parents[-3:])
    if stem in _NAMED_BY_FOLDER:
        return parents[-1]
    return f"{parents[-1]}_{stem}" if stem.isdecimal() or stem.startswith("gt_") else stem


def clip_stem(name: Path | str) -> str:
    """Return the name of a clip among those in its folder."""
    scene = builtin_scene(name)
    if scene is not None:
        return scene
    file = SourceFile(Path(name))
    if file.selection is not None:
        own = file.selection.replace(" ", "_")
        # A clip's name may be no more than its frames.
        return own if own[:1].isalpha() else f"{file.path.resolve().stem}_{own}"
    if file.suffix != FOLDER:
        return file.path.stem
    return (file.path.resolve() if file.path.name in ("", "..") else file.path).name


def clip_of(motion: Motion, *, name: Path | None = None, objects: Path | None = None) -> Clip:
    """Return the clip that a result was made from, edited and augmented as the result's report states.

    Of a motion that fell in simulation, it is the clip up to the fall. `name` and `objects`, the objects' folder, stand
    for those in the report; the content of another clip is not compared. Raises `ReadError` where the report does not
    say which clip it is, or the recording is gone, has changed since, or cannot be read any more.
    """
    clip, edits = recording_of(motion, name=name, objects=objects)
    try:
        clip = apply(clip, edits)
    except HoiRetargetError as error:
        raise ReadError(f"the result's contact edits no longer fit its clip: {error} {_ADVICE}") from error
    try:
        clip = augment(clip, motion.report.source.augmentation)
    except HoiRetargetError as error:
        raise ReadError(f"the result's clip cannot be augmented again as it was: {error} {_ADVICE}") from error
    if motion.stages[-1].name == SIMULATED and motion.frames < clip.frames:
        return resampled(clip, np.arange(motion.frames, dtype=float), clip.fps)  # Up to the fall.
    return clip


def recording_of(motion: Motion, *, name: Path | None = None, objects: Path | None = None) -> tuple[Clip, ContactEdits]:
    """Return the clip that a result was made from, as recorded, and the contact edits it was made with.

    Arguments and errors are those of `clip_of`. Paths in the report are taken as they are, relative ones from the
    current folder.
    """
    source = motion.report.source
    path = source.path if name is None else str(name)
    if not path:
        raise ReadError(f"the result does not say which clip it was made from. {_ADVICE}")
    try:
        options = ReadOptions.from_json(motion.report.command)
        clip = open_clip(path, options if objects is None else replace(options, objects=objects))
    except HoiRetargetError as error:
        raise ReadError(f"the clip that the result was made from cannot be read again: {error} {_ADVICE}") from error
    if name is None and clip.source.sha256 != source.sha256:
        raise ReadError(f"{path}: the file has changed since the result was made from it. {_ADVICE}")
    if not source.contact_edits:
        return clip, ContactEdits.of(clip)
    return clip, from_text(source.contact_edits, "the result's contact edits")
