"""Physics of results on the command line: their settings, and the shapes of their objects."""

from collections.abc import Mapping
from dataclasses import replace

from hoi_retarget.cli.commands import Weighed
from hoi_retarget.motion.motion import Motion
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.physics.settings import Physics
from hoi_retarget.readers.open import clip_of
from hoi_retarget.retargeting.config import Config


def physics_of(motion: Motion, command: Weighed) -> Physics:
    """Return the settings that a result was made with, with those that a command changes; raises `ArgumentError`."""
    names = ("object_mass", "hand_friction", "floor_friction")
    changed = {name: value for name in names if (value := getattr(command, name)) is not None}
    stored = motion.report.config.get("physics", {})
    return replace(Config.from_table({"physics": stored}, "result: config").physics, **changed)


def geometries_of(motion: Motion, command: Weighed) -> Mapping[str, ObjectGeometry]:
    """Return the shapes of a result's objects by name; raises `HoiRetargetError` where its clip is not to be had."""
    if not motion.object_names:
        return {}
    clip = clip_of(motion, name=command.clip, objects=command.objects)
    return {track.name: track.geometry for track in clip.objects}
