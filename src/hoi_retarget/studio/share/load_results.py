"""Loads results to be shown together, one by one: a damaged one hides no other."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.result_file import load
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.readers.open import clip_of
from hoi_retarget.robots import load_robot
from hoi_retarget.studio.scene.scene import SceneItem
from hoi_retarget.studio.scene.subplots import short_name, titles_of


def load_results(
    paths: Sequence[Path],
    tell: Callable[[str], None],
    *,
    find_clip: Callable[[Motion], Clip] = clip_of,
    load_motion: Callable[[Path], Motion] = load,
) -> list[tuple[Path, Motion, SceneItem]]:
    """Return the results that can be read, each with its file.

    Titles distinguish a result from the others, or name the robot of a single one.

    `paths`: result files; `tell`: receives the problems with the files, a sentence each; `find_clip`: returns the clip
    that a motion was made from; raises `HoiRetargetError` where it is not to be had, and the robot is then shown alone;
    `load_motion`: returns the motion in a file; raises `HoiRetargetError`.
    """
    found: list[tuple[Path, Motion, SceneItem]] = []
    for path in dict.fromkeys(paths):
        without = f"{path.name}: shown without the human."
        try:
            motion = load_motion(path)
            model = load_robot(motion.robot)
            clip = drawable_clip(motion, find_clip, lambda why, without=without: tell(f"{without} {why}"))
            found.append((path, motion, SceneItem(path.stem, motion, model, clip, motion.person)))
        except HoiRetargetError as error:
            tell(str(error))
    titles = titles_of([(path, motion) for path, motion, _ in found])
    if len(found) == 1:
        titles = (short_name(load_robot(found[0][1].robot).spec),)
    return [
        (path, motion, replace(item, title=title)) for (path, motion, item), title in zip(found, titles, strict=True)
    ]


def drawable_clip(
    motion: Motion, find_clip: Callable[[Motion], Clip], tell: Callable[[HoiRetargetError], None] = lambda _: None
) -> Clip | None:
    """Return the clip that a motion was made from; None, and the reason told, where it or a mesh is not to be had."""
    try:
        clip = find_clip(motion)
        for track in clip.objects:
            surface_of(track.geometry)  # Drawn later, with the other results.
    except HoiRetargetError as error:
        tell(error)
        return None
    return clip
