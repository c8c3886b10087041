"""Clips made from nothing, with exactly known contacts; those of default arguments are the built-in clips."""

import json
from collections.abc import Callable, Mapping
from hashlib import sha256
from types import MappingProxyType

import numpy as np

from hoi_retarget.clip.clip import MINIMUM_FRAMES, Clip, Source
from hoi_retarget.errors import ArgumentError, did_you_mean
from hoi_retarget.readers.builtin_clips import FOLDER, builtin_clip
from synthetic.acting import act, contacts_of
from synthetic.object_shapes import OBJECTS
from synthetic.scenes import carry_box, carry_table, drag_suitcase, move_chair, push_table
from synthetic.staging import StagedScene
from synthetic.walking import Times

__all__ = ["OBJECTS", "SCENES", "make"]

LICENCE = "Apache-2.0 (made by hoi-retarget)"
HEIGHT, SEED, FPS = 1.75, 0, 30.0  # Of built-in clips.
MINIMUM_HEIGHT, MAXIMUM_HEIGHT = 1.2, 2.2  # [m]

SCENES: Mapping[str, Callable[[float, int], StagedScene]] = MappingProxyType(
    {scene.__name__: scene for scene in (carry_box, push_table, drag_suitcase, move_chair, carry_table)}
)
"""The scenes by name: each makes its script from a height [m] and a seed."""


def make(  # all but the name are options with defaults
    name: str,
    *,
    height: float = HEIGHT,
    seed: int = SEED,
    fps: float = FPS,
    seconds: float | None = None,
    repetitions: int | None = None,
) -> Clip:
    """Return a synthetic clip.

    Without `seconds` and `repetitions` the clip goes one way and ends at rest. Repeated, it goes
    there and back as often as asked and ends where it begins, one frame before the first one.
    Made with the defaults, it is the built-in clip of that name, and its source says so. Raises `ArgumentError`
    for a scene that does not exist, and a number out of its range.

    Args:
        name: one of `SCENES`.
        height: standing height of the (first) person [m].
        seed: varies sizes, places and step lengths; the same seed gives the same clip.
        fps: frames a second; the motion itself does not depend on it.
        seconds: duration [s]; the way there and back repeats as long as it lasts.
        repetitions: how many times to go there and back; not together with `seconds`.
    """
    _check_scene(name, height, seed)
    _check_duration(fps, seconds, repetitions)
    scene = SCENES[name](height, seed)
    times = _times(scene, fps, seconds, repetitions)
    objects = scene.objects(times)
    people = tuple(act(actor, times, objects) for actor in scene.actors)
    contacts = tuple(track for index, actor in enumerate(scene.actors) for track in contacts_of(actor, index, times))
    parameters = {"name": name, "height": height, "seed": seed, "fps": fps, "frames": len(times)}
    digest = sha256(json.dumps(parameters, sort_keys=True).encode()).hexdigest()
    note = "Made from nothing: contact points and stance are exact."
    is_builtin = (height, seed, fps, seconds, repetitions) == (HEIGHT, SEED, FPS, None, None)
    source = Source("", sha256=digest, format="synthetic", licence=LICENCE, notes=(note,))
    if is_builtin and (FOLDER / f"{name}.npz").is_file():
        source = builtin_clip(name).source
    return Clip(name, fps, people, objects, contacts, source)


def _check_scene(name: str, height: float, seed: int) -> None:
    if name not in SCENES:
        near = did_you_mean(name, SCENES)
        raise ArgumentError(f"There is no synthetic scene {name!r}.{near} Scenes: {', '.join(SCENES)}.")
    if not MINIMUM_HEIGHT <= height <= MAXIMUM_HEIGHT:
        raise ArgumentError(f"The height is {height} m; it must lie between {MINIMUM_HEIGHT} and {MAXIMUM_HEIGHT} m.")
    if seed < 0:
        raise ArgumentError(f"The seed is {seed}; it must not be negative.")


def _check_duration(fps: float, seconds: float | None, repetitions: int | None) -> None:
    if not (np.isfinite(fps) and fps > 0):
        raise ArgumentError(f"The rate is {fps} frames a second; it must be positive.")
    if seconds is not None and repetitions is not None:
        raise ArgumentError("Both seconds and repetitions are given; each alone sets the duration.")
    if seconds is not None and not (np.isfinite(seconds) and seconds > 0):
        raise ArgumentError(f"The duration is {seconds} s; it must be positive.")
    if repetitions is not None and repetitions < 1:
        raise ArgumentError(f"{repetitions} repetitions are asked for; at least one is needed.")


def _times(scene: StagedScene, fps: float, seconds: float | None, repetitions: int | None) -> Times:
    """Return when the frames are, within one cycle [s]."""
    if repetitions is not None:
        frames = round(repetitions * scene.cycle * fps)
    else:
        frames = int(np.floor((scene.there if seconds is None else seconds) * fps + 1e-6)) + 1
    if frames < MINIMUM_FRAMES:
        raise ArgumentError(f"That makes {frames} frames; at least {MINIMUM_FRAMES} are needed: ask for more seconds.")
    return np.mod(np.arange(frames) / fps, scene.cycle)
