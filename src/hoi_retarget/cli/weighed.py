"""Physics of results on the command line: their settings, and the clips that know their objects' shapes."""

from dataclasses import replace

from hoi_retarget.cli.commands import Weighed
from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import ClipError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.physics.feasibility import physics_of_motion
from hoi_retarget.physics.settings import Physics
from hoi_retarget.readers.open import clip_of

WEIGHED = ("object_mass", "hand_friction", "floor_friction", "object_friction")
"""Fields of `Weighed` that are settings of physics."""


def physics_of(motion: Motion, command: Weighed) -> Physics:
    """Return the settings that a result was made with, with those that a command changes; raises `ArgumentError`."""
    changed = {name: value for name in WEIGHED if (value := getattr(command, name)) is not None}
    return replace(physics_of_motion(motion), **changed)


def clip_with_objects(motion: Motion, command: Weighed) -> Clip | None:
    """Return the clip that knows the shapes of a result's objects, or None where the result has no objects.

    Raises `HoiRetargetError` where it is not to be had, or is not of this motion.
    """
    if not motion.object_names:
        return None
    clip = clip_of(motion, name=command.clip, objects=command.objects)
    names = tuple(track.name for track in clip.objects)
    if (clip.frames, names) != (motion.frames, motion.object_names):
        raise ClipError(
            f"clip {clip.name!r} has {clip.frames} frames of {', '.join(names) or 'no object'}, the motion "
            f"{motion.frames} of {', '.join(motion.object_names)}. Name the clip it was made from with --clip."
        )
    return clip
