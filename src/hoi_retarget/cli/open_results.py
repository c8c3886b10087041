"""Results and other programs' motions, with the clips they were made from, as commands name them."""

import os
import shlex
from collections.abc import Callable
from dataclasses import replace
from math import isfinite
from pathlib import Path

from hoi_retarget.cli.commands import PhysicsOptions, ReferenceClipOptions, SourceClipOptions
from hoi_retarget.cli.run_options import to_argv
from hoi_retarget.cli.terminal import program, warn
from hoi_retarget.clip.clip import Clip
from hoi_retarget.dynamics.feasibility import physics_of_motion
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.errors import ArgumentError, ClipError, HoiRetargetError, ReadError
from hoi_retarget.evaluation import Score
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.motion.motion import Motion
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.readers.builtin_clips import builtin_scene
from hoi_retarget.readers.open import clip_of
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.studio.report.open_motion import ReferenceClip, open_motion, with_recording
from hoi_retarget.studio.share.clip_page import last_name
from hoi_retarget.studio.share.gallery import GalleryEntry

PHYSICS_FIELDS = ("object_mass", "hand_friction", "floor_friction", "object_friction")
"""Fields of `PhysicsOptions` that are settings of physics."""


def load_motion(
    path: Path, robot: str, warn: Callable[[str], None] = warn, reference: ReferenceClip | None = None
) -> Motion:
    """Return the motion in a result or in another program's file; raises `ReadError`, which for a clip says so.

    `warn` takes assumptions about another program's file, and its contradictions; `reference` is the clip of it.
    """
    if path.suffix.lower() in (".pt", ".pth") and os.path.isfile(path):  # noqa: PTH113  # raises nothing
        raise ReadError(f"{path}: this is a clip, not a result. Use `{program()} run` on it first.")
    model = load_robot(robot)
    opened = open_motion(path, model)
    if reference is not None:
        opened = with_recording(opened, path, model, reference)
    for note in (*opened.contradictions, *opened.notes):
        warn(f"{path.name}: {note}")
    return opened.motion


def reference_clip_of(options: ReferenceClipOptions) -> ReferenceClip:
    """Return the clip of other programs' motions; raises `ArgumentError` for a missing clip or a wrong scale."""
    for name, scale in (("--object-scale", options.object_scale), ("--root-scale", options.root_scale)):
        if not (isfinite(scale) and scale > 0):
            raise ArgumentError(f"{name} is {scale:g}; it must be a positive number.")
    clip = options.clip
    if clip is not None and builtin_scene(clip) is None and not os.path.exists(SourceFile(clip).path):  # noqa: PTH110  # raises nothing
        raise ArgumentError(f"--clip {clip}: there is no such file or folder.")
    return ReferenceClip(clip, options.objects, options.root_scale, options.object_scale)


def clip_or_warning(
    path: Path, motion: Motion, options: SourceClipOptions, without: str, *, surfaces: bool = False
) -> Clip | None:
    """Return the clip that a result was made from; None, with a warning, where it is not to be had.

    Raises `HoiRetargetError` where the user names the clip, and it is not to be had.

    Args: `path`: the result's file; `motion`: the result; `options`: where the clip is; `without`: the consequence of
    the missing clip, for the warning; `surfaces`: whether the objects' surfaces must be readable, too.
    """
    try:
        clip = clip_of(motion, name=options.clip, objects=options.objects)
        if surfaces:
            for track in clip.objects:
                if track.name in motion.object_names:
                    surface_of(track.geometry)
    except HoiRetargetError as error:
        if options.clip is not None:
            raise
        warn(f"{path.name}: {without} {error}")
        return None
    return clip


def physics_of(motion: Motion, options: PhysicsOptions) -> Physics:
    """Return the settings of physics in a result, with the options in their place; raises `ArgumentError`."""
    changed = {name: value for name in PHYSICS_FIELDS if (value := getattr(options, name)) is not None}
    return replace(physics_of_motion(motion), **changed)


def clip_with_objects(motion: Motion, options: PhysicsOptions) -> Clip | None:
    """Return the clip that knows the shapes of a result's objects, or None where the result has no objects.

    Raises `HoiRetargetError` where it is not to be had, or is not of this motion.
    """
    if not motion.object_names:
        return None
    clip = clip_of(motion, name=options.clip, objects=options.objects)
    names = tuple(track.name for track in clip.objects)
    if (clip.frames, names) != (motion.frames, motion.object_names):
        raise ClipError(
            f"clip {clip.name!r} has {clip.frames} frames of {', '.join(names) or 'no object'}, the motion "
            f"{motion.frames} of {', '.join(motion.object_names)}. Name the clip it was made from with --clip."
        )
    return clip


def gallery_entry_of(motion: Motion, model: RobotModel, score: Score) -> GalleryEntry:
    """Return a result for pages, with the command that makes it again, in which paths are cut to their last name."""
    report, command = motion.report, ""
    if "clips" in report.command:
        words = to_argv({**report.command, "out": "results"}, report.config, shown=last_name)
        command = shlex.join(["hoi-retarget", *words])
    return GalleryEntry(motion, model.spec, score, tuple(map(str, motion.warnings)), command=command)
