"""Built-in clips in this project's layout, with exactly known contacts, as `tools/make_clips.py` makes them."""

from dataclasses import replace
from pathlib import Path

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, did_you_mean
from hoi_retarget.readers import read_recording

BUILTIN = "builtin:"  # Stands before a scene's name in the place of a clip's file.
SCENES = ("carry_box", "push_table", "drag_suitcase", "move_chair", "carry_table")  # Their names.
FOLDER = Path(__file__).parent


def builtin_scene(name: Path | str) -> str | None:
    """Return the scene that `builtin:<scene>` names, whether there is such a one or not; None for a file."""
    text = str(name)
    return text.removeprefix(BUILTIN) if text.startswith(BUILTIN) else None


def builtin_clip(scene: str) -> Clip:
    """Return the built-in clip of a scene; raises `ArgumentError` where there is no such one."""
    if scene not in SCENES:
        name, known = f"{BUILTIN}{scene}", [f"{BUILTIN}{known}" for known in SCENES]
        near = did_you_mean(name, known)
        raise ArgumentError(f"{name}: there is no such built-in clip.{near} Built-in clips: {', '.join(known)}.")
    clip, _ = read_recording(FOLDER / f"{scene}.npz", ReadOptions())
    return replace(clip, source=replace(clip.source, path=f"{BUILTIN}{scene}", format="synthetic"))
