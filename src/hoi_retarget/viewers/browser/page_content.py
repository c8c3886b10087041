"""Content of a viewer's page, read from result files one by one: a damaged one hides no other."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.evaluation import COLUMNS
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.result_file import load
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.readers.open import clip_of
from hoi_retarget.robots import load_robot
from hoi_retarget.viewers.html import render
from hoi_retarget.viewers.scene.curve_chart import CHART_STEP_PX, TITLES_HEIGHT_PX, chart_html
from hoi_retarget.viewers.scene.curves import SURFACE_GROUPS, curves_of
from hoi_retarget.viewers.scene.drawing import Scene
from hoi_retarget.viewers.scene.force_curves import FORCE_GROUPS, force_curves
from hoi_retarget.viewers.scene.scene import Shown, make_scene
from hoi_retarget.viewers.scene.titles import titles_of


@dataclass(frozen=True, eq=False)
class PageContent:
    """Scene, curves, figures and notices of a page."""

    scene: Scene | None
    """None where nothing could be read."""
    chart: str = ""
    """HTML of the curves (`curve_chart`)."""
    extra_height_px: int = 0
    """Height of the chart beyond that of one result's curves."""
    figures: str = ""
    """HTML of the figures' table."""
    notices: tuple[str, ...] = ()
    """Problems with the files, a sentence each."""


def load_page_content(
    results: Sequence[Path],
    find_clip: Callable[..., Clip] = clip_of,
    load_motion: Callable[[Path], Motion] = load,
) -> PageContent:
    """Return the content for result files; one that cannot be read becomes a notice.

    Args:
        results: Result files.
        find_clip: Returns the clip that a motion was made from; raises `HoiRetargetError` where it is not to be had,
            and the robot is then shown alone.
        load_motion: Returns the motion in a file; raises `HoiRetargetError`.
    """
    shown: dict[Path, Shown] = {}
    notices: list[str] = []
    for path in results:
        try:
            shown[path] = _shown(path, load_motion(path), find_clip, notices)
        except HoiRetargetError as error:
            notices.append(str(error))
    if not shown:
        return PageContent(None, notices=tuple(notices))
    titles = titles_of([(path, item.motion) for path, item in shown.items() if item.motion is not None])
    titled = [replace(item, title=title) for item, title in zip(shown.values(), titles, strict=True)]
    return page_content(titled, tuple(notices))


def page_content(shown: Sequence[Shown], notices: tuple[str, ...] = ()) -> PageContent:
    """Return the content for results and clips; raises what `make_scene` raises."""
    scene = make_scene(shown)
    curves = [
        (
            item.title,
            (
                *curves_of(item.motion, item.model, item.geometries),
                *force_curves(item.motion, item.model, item.clip),
            ),
        )
        for item in shown
        if item.motion and item.model
    ]
    groups = {curve.group for _, own in curves for curve in own}
    extra = CHART_STEP_PX * len(groups.intersection((*SURFACE_GROUPS, *FORCE_GROUPS))) + (
        TITLES_HEIGHT_PX if len(shown) > 1 else 0
    )
    return PageContent(scene, chart_html(curves, scene.fps), extra, figures_html(shown), notices)


def _shown(path: Path, motion: Motion, find_clip: Callable[..., Clip], notices: list[str]) -> Shown:
    model = load_robot(motion.robot)
    try:
        clip = find_clip(motion)
        for track in clip.objects:
            surface_of(track.geometry)  # Drawn later, with the other results.
    except HoiRetargetError as error:
        clip = None
        notices.append(f"{path.name}: shown without the human. {error}")
    return Shown(path.stem, motion, model, clip, motion.person)


def figures_html(shown: Sequence[Shown]) -> str:
    """Return the figures that results carry as a table, one column a result."""
    reports = [item.motion.report.figures for item in shown if item.motion is not None]
    columns = [column for column in COLUMNS if any(column.name in report for report in reports)]
    return render(
        "viewers/browser/page/figures.html.j2",
        kind="of-results",
        heads=[item.title for item in shown] if len(shown) > 1 else [],
        rows=[(column.header, [column.text(report.get(column.name)) for report in reports]) for column in columns],
    )
