"""Any program's motion to be judged: read as a result without a human, or beside its clip where one is named."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.augment import resampled
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError, HoiRetargetError, ReadError
from hoi_retarget.evaluation import Comparison, figures_of, motion_figures
from hoi_retarget.evaluation.comparison import finite_min_or_none, max_or_none, mean_or_none
from hoi_retarget.evaluation.penetration import self_depths
from hoi_retarget.evaluation.surface_distances import surface_kind
from hoi_retarget.files.reading import entry_names
from hoi_retarget.motion.check import FLOOR, FormatFinding, ObjectPath, check
from hoi_retarget.motion.formats import own_result, read
from hoi_retarget.motion.motion import Motion, Stage
from hoi_retarget.motion.motion_report import Report, Source
from hoi_retarget.motion.result_file import load, may_be_result
from hoi_retarget.readers.builtin_clips import builtin_scene
from hoi_retarget.readers.open import clip_stem, open_clip
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.skin import link_heights

STANDING_HEIGHT = 0.03  # A foot whose lowest corner is no further above where feet stand in this motion may stand [m].
STANDING_SPEED = 0.3  # A foot that low and slower than this stands [m/s]; the slower of the low ones always does.
_STANDING_PERCENTILE = 5.0  # Of the lower foot's height: where feet stand.


def motion_from_qpos(
    qpos: Float[np.ndarray, "T nq"], fps: float, model: RobotModel, objects: Sequence[ObjectPath] = ()
) -> Motion:
    """Return a robot's path as a result, with the figures in its report that need no human and no object's shape.

    Its stance is estimated. Who touches what is not known, and inverse kinematics is the motion itself. Raises
    `ClipError` when numbers are not finite, or rotations are no unit quaternions.

    `qpos`: root position [m], root rotation wxyz, joints [rad] in the model's order; `fps`: frames a second; `model`:
    the robot; `objects`: what it moves.
    """
    frames, kinematics = len(qpos), model.forward(qpos)
    motion = Motion(
        robot=model.spec.name,
        fps=fps,
        joint_names=model.joint_names,
        stages=(Stage("motion", qpos),),
        object_names=tuple(item.name for item in objects),
        object_pos=np.stack([item.pos for item in objects], axis=1) if objects else np.zeros((frames, 0, 3)),
        object_quat=np.stack([item.quat for item in objects], axis=1) if objects else np.zeros((frames, 0, 4)),
        object_scale=np.ones(len(objects)),
        contact_links=(),
        contact_flags=np.zeros((frames, 0), dtype=bool),
        contact_object=np.zeros((frames, 0), dtype=int),
        contact_points=np.zeros((frames, 0, 3)),
        stance_flags=estimated_stance(kinematics, fps),
        first_source_frame=0,
        human_height=0.0,
    )
    return replace(motion, report=Report(figures=_figures(motion, kinematics, model)))


def estimated_stance(kinematics: Kinematics, fps: float) -> Bool[np.ndarray, "T 2"]:
    """Return when each foot stands: it is low, and slow or the slower of the two.

    Low is meant over the height at which the lower foot usually is, so that a motion that floats as a whole stands,
    too. The slower of the low feet stands however fast it is, or nothing that skates would be found.
    """
    heights = motion_figures.sole_heights(kinematics)
    floor = np.percentile(heights.min(axis=1), _STANDING_PERCENTILE)
    low = heights < floor + STANDING_HEIGHT
    steps = motion_figures.foot_speeds(kinematics, fps)
    # Of a frame: the slower one of the steps to it and from it.
    around = np.concatenate([steps[:1], steps, steps[-1:]]) if len(steps) else np.zeros((2, 2))
    speeds = np.where(low, np.minimum(around[:-1], around[1:]), np.inf)
    return low & ((speeds < STANDING_SPEED) | (speeds <= speeds.min(axis=1, keepdims=True)))


def _figures(motion: Motion, kinematics: Kinematics, model: RobotModel) -> dict[str, float | None]:
    stance, heights = motion.stance_flags, motion_figures.sole_heights(kinematics)
    jerks = motion_figures.body_jerks(kinematics, motion.fps)
    speeds = motion_figures.foot_speeds(kinematics, motion.fps)
    return {
        "body_jerk_mps3": mean_or_none(jerks),
        "body_jerk_max_mps3": max_or_none(jerks),
        "stance_slide_mps": mean_or_none(speeds[stance[1:] & stance[:-1]]),
        "stance_float_m": mean_or_none(np.maximum(heights[stance], 0.0)),
        "floor_penetration_max_m": motion_figures.deepest(heights),
        "link_below_floor_m": max_or_none(np.maximum(-link_heights(kinematics), 0.0)),
        "self_penetration_max_m": max_or_none(self_depths(kinematics)[0]),
        "joint_range_margin_rad": finite_min_or_none(motion_figures.joint_range_margins(motion, model)),
        "joint_speed_margin_radps": finite_min_or_none(motion_figures.joint_speed_margins(motion, model)),
    }


OWN_FORMAT = own_result.FORMAT.name
_OF_FLOOR = (
    "stance_float_m",
    "floor_penetration_max_m",
    "link_below_floor_m",
    "base_height_min_share",
    "base_height_max_share",
)


@dataclass(frozen=True, eq=False)
class OpenedMotion:
    """A motion to be judged."""

    motion: Motion  # As its numbers say, also where they contradict the file's format.
    format: str
    notes: tuple[str, ...] = ()  # Assumptions made to read it, a clause each.
    contradictions: tuple[FormatFinding, ...] = ()  # What contradicts the file's claims.
    not_judged: tuple[str, ...] = ()  # Names of figures that the file does not tell.


def open_motion(path: Path, robot: RobotModel) -> OpenedMotion:
    """Return a result, or the motion of a robot in another program's format, which does not name the robot.

    Raises `ReadError` when the file is missing, damaged, or of no known format; `ClipError` when its numbers do not
    tell the poses.
    """
    if _is_result(path):
        return OpenedMotion(load(path), OWN_FORMAT)
    file = read(path)
    found = check(file, robot)
    notes = []
    motion = motion_from_qpos(found.qpos, found.fps, robot, found.objects)
    if found.fps_assumed:
        notes.append(f"{found.fps:g} frames a second are assumed")
    if found.missing_joints:
        notes.append(f"joints that the file lacks are held still at 0 rad: {', '.join(found.missing_joints)}")
    floor_is_open = any(item.subject == FLOOR and item.level == "unknown" for item in found.findings)
    if floor_is_open:
        notes.append("it may stand on objects: nothing about the floor is judged")
    report = replace(motion.report, source=Source(format=file.format))
    not_judged = _OF_FLOOR if floor_is_open else ()
    return OpenedMotion(replace(motion, report=report), file.format, tuple(notes), found.causes, not_judged)


def _is_result(path: Path) -> bool:
    """Return whether a file is a result; a damaged archive counts as one, since its reading names the damage."""
    if not may_be_result(path):
        return False
    names = entry_names(path)
    return not names or {"schema.npy", "contact_targets.npy"} <= names


AWAY = 0.5  # A robot that is further from the person in the median [m] moves in another world than the clip's object.
_OF_OBJECT_PATHS = ("object_path_error_m", "object_below_floor_m", "object_float_m", "support_height_error_m")
_UNKNOWN = "contacts, penetration of objects and likeness to the human are not measured"


@dataclass(frozen=True)
class ReferenceClip:
    """The clip of other programs' motions, and facts that their files lack."""

    clip: Path | None = None  # A clip, or a folder with clips that are named as the motions are.
    objects: Path | None = None  # Folder with the objects' geometry.
    root_scale: float = 1.0  # Of the clip's object paths about the world's origin, for files that hold no objects.
    object_scale: float = 1.0  # Size of the objects.


def with_recording(opened: OpenedMotion, path: Path, model: RobotModel, recording: ReferenceClip) -> OpenedMotion:
    """Return another program's motion with the figures that need its clip, or with a note on their absence.

    A result, which has its figures, stays as it is.

    `opened`: what a file holds; `path`: the file; `model`: the robot; `recording`: its clip.
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
    """Return the named clip, or of a folder of clips the one with the longest name that the motion's begins with."""
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


def _with_objects_of(clip: Clip, motion: Motion, recording: ReferenceClip) -> Motion:
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
