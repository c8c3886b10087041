"""Other programs' motions beside the clip they were made from: figures that need the human and the objects."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.augment import resampled
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError, HoiRetargetError, ReadError
from hoi_retarget.evaluation import Comparison, figures_of
from hoi_retarget.evaluation.object_shape import surface_kind
from hoi_retarget.motion.motion import Motion
from hoi_retarget.readers.open import builtin_scene, clip_stem, open_clip
from hoi_retarget.report.load_any_motion import OpenedMotion
from hoi_retarget.robots.model import RobotModel

AWAY = 0.5
"""A robot that is further from the person in the median [m] moves in another world than the clip's object."""
_OF_OBJECT_PATHS = ("object_path_error_m", "object_below_floor_m", "object_float_m")
_UNKNOWN = "contacts, penetration of objects and likeness to the human are not measured"


@dataclass(frozen=True)
class Recording:
    """The clip of other programs' motions, and what their files do not say."""

    clip: Path | None = None
    """A clip, or a folder with clips that are named as the motions are."""
    objects: Path | None = None
    """Folder with the objects' geometry."""
    root_scale: float = 1.0
    """Of the clip's object paths about the world's origin, for files that hold no objects."""
    object_scale: float = 1.0
    """Size of the objects."""


def with_recording(opened: OpenedMotion, path: Path, model: RobotModel, recording: Recording) -> OpenedMotion:
    """Return another program's motion with the figures that its clip tells, or with a note why there are none.

    A result, which has its figures, stays as it is.

    Args:
        opened: What a file holds.
        path: The file.
        model: The robot.
        recording: Its clip.
    """
    if not opened.motion.report.is_foreign:
        return opened
    if recording.clip is None:
        return replace(opened, notes=(*opened.notes, f"{_UNKNOWN}: no clip is named (--clip)"))
    try:
        clip = _at_frames_of(opened.motion, _clip_of(path, recording.clip, ReadOptions(objects=recording.objects)))
        motion = _with_objects_of(clip, opened.motion, recording)
        figures = dict(figures_of(Comparison(motion, clip, 0, model.forward(motion.qpos))))
    except HoiRetargetError as error:
        return replace(opened, notes=(*opened.notes, f"{_UNKNOWN}: {str(error).removesuffix('.')}"))
    notes = [f"compared with the clip {clip.name!r}"]
    if clip.objects:
        notes.append(f"objects are taken to be at {100 * recording.object_scale:g} % of their captured size")
    if clip.objects and not opened.motion.object_names:
        notes.append(f"it holds no objects: they are taken to move as in the clip, scaled by {recording.root_scale:g}")
        figures |= dict.fromkeys(_OF_OBJECT_PATHS)
    figures |= {name: value for name, value in opened.motion.report.figures.items() if value is not None}
    kinds = {track.name: surface_kind(track.geometry) for track in clip.objects}
    report = replace(motion.report, figures=figures, object_surfaces=kinds)
    return replace(opened, motion=replace(motion, report=report), notes=(*opened.notes, *notes))


def _clip_of(motion: Path, clip: Path, options: ReadOptions) -> Clip:
    """Return the clip that is named, or the one in a folder of clips whose name the motion's begins with."""
    if builtin_scene(clip) is not None or not clip.is_dir():
        return open_clip(clip, options)
    stems = {file: clip_stem(file) for file in sorted(clip.iterdir())}
    fitting = {file: stem for file, stem in stems.items() if f"{motion.name}.".startswith(f"{stem}.")}
    longest = max(map(len, fitting.values()), default=0)
    found = [file for file, stem in fitting.items() if len(stem) == longest]
    if len(found) > 1:
        raise ReadError(f"{clip} has several clips of its name: {', '.join(file.name for file in found)}")
    if found:
        return open_clip(found[0], options)
    try:
        return open_clip(clip, options)  # A folder can be a clip.
    except ReadError as error:
        raise ReadError(f"{clip} has no clip of its name, and is none itself") from error


def _at_frames_of(motion: Motion, clip: Clip) -> Clip:
    """Return the clip at a motion's frames, which begin with its own; raises `ClipError` where it is another's."""
    if len(clip.people) != 1:
        raise ClipError(f"the clip {clip.name!r} has {len(clip.people)} people, and the file does not say whose it is")
    seconds = [(item.frames - 1) / item.fps for item in (motion, clip)]
    if abs(seconds[0] - seconds[1]) > 1.0 / min(motion.fps, clip.fps) + 1e-9:
        raise ClipError(f"it lasts {seconds[0]:.2f} s, the clip {clip.name!r} {seconds[1]:.2f} s")
    if (motion.frames, motion.fps) == (clip.frames, clip.fps):
        return clip
    times = np.minimum(np.arange(motion.frames) * (clip.fps / motion.fps), clip.frames - 1.0)
    return resampled(clip, times, motion.fps)


def _with_objects_of(clip: Clip, motion: Motion, recording: Recording) -> Motion:
    """Return a motion with the clip's objects, at its own places where it holds them."""
    own, names = motion.object_names, tuple(track.name for track in clip.objects)
    if own and len(own) == len(names) == 1:
        places = motion.object_pos, motion.object_quat
    elif own and set(names) <= set(own):
        index = [own.index(name) for name in names]
        places = motion.object_pos[:, index], motion.object_quat[:, index]
    elif own:
        raise ClipError(f"its objects are {', '.join(own)}, those of the clip {clip.name!r} {', '.join(names)}")
    else:
        places = _recorded_places(clip, motion, recording.root_scale)
    scale = np.full(len(names), recording.object_scale)
    return replace(motion, object_names=names, object_pos=places[0], object_quat=places[1], object_scale=scale)


def _recorded_places(
    clip: Clip, motion: Motion, scale: float
) -> tuple[Float[np.ndarray, "T O 3"], Float[np.ndarray, "T O 4"]]:
    person = scale * clip.people[0].position("pelvis")
    away = float(np.median(np.linalg.norm(motion.qpos[:, :2] - person[:, :2], axis=1)))
    if clip.objects and away > AWAY:
        raise ClipError(
            f"it holds no objects, and those of the clip {clip.name!r} are not where it is: the robot is {away:.1f} m "
            f"away from the person, who is scaled by {scale:g} (--root-scale)"
        )
    if not clip.objects:
        return np.zeros((clip.frames, 0, 3)), np.zeros((clip.frames, 0, 4))
    positions = np.stack([scale * track.positions for track in clip.objects], axis=1)
    return positions, np.stack([track.quats for track in clip.objects], axis=1)
