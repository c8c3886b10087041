"""Loads results to be shown together, one by one: a damaged one hides no other."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
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


@dataclass(frozen=True, eq=False)
class LoadedResults:
    """The results that can be read."""

    results: tuple[tuple[Path, Motion, SceneItem], ...]
    """Each with its file; titles distinguish it from the others, or name the robot of a single one."""
    notices: tuple[str, ...] = ()
    """Problems with the files, a sentence each."""


def load_results(
    paths: Sequence[Path],
    find_clip: Callable[..., Clip] = clip_of,
    load_motion: Callable[[Path], Motion] = load,
) -> LoadedResults:
    """Return the results in files; an unreadable file becomes a notice.

    Args:
        paths: Result files.
        find_clip: Returns the clip that a motion was made from; raises `HoiRetargetError` where it is not to be had,
            and the robot is then shown alone.
        load_motion: Returns the motion in a file; raises `HoiRetargetError`.
    """
    found: dict[Path, tuple[Motion, SceneItem]] = {}
    notices: list[str] = []
    for path in paths:
        try:
            motion = load_motion(path)
            found[path] = motion, _shown(path, motion, find_clip, notices)
        except HoiRetargetError as error:
            notices.append(str(error))
    titles = titles_of([(path, motion) for path, (motion, _) in found.items()])
    if len(found) == 1:
        titles = tuple(short_name(item.model.spec) for _, item in found.values() if item.model is not None)
    return LoadedResults(
        tuple(
            (path, motion, replace(item, title=title))
            for (path, (motion, item)), title in zip(found.items(), titles, strict=True)
        ),
        tuple(notices),
    )


def _shown(path: Path, motion: Motion, find_clip: Callable[..., Clip], notices: list[str]) -> SceneItem:
    model = load_robot(motion.robot)
    try:
        clip = find_clip(motion)
        for track in clip.objects:
            surface_of(track.geometry)  # Drawn later, with the other results.
    except HoiRetargetError as error:
        clip = None
        notices.append(f"{path.name}: shown without the human. {error}")
    return SceneItem(path.stem, motion, model, clip, motion.person)
