"""Content of the editor's page: its scene, and the curves below it."""

from collections.abc import Sequence
from dataclasses import dataclass

from hoi_retarget.motion.motion import Motion
from hoi_retarget.viewers.scene.bars import bar_rows
from hoi_retarget.viewers.scene.curve_chart import BAR_ROW_HEIGHT_PX, CHART_STEP_PX, TITLES_HEIGHT_PX, chart_html
from hoi_retarget.viewers.scene.curves import SURFACE_GROUPS, Curve, curves_of
from hoi_retarget.viewers.scene.drawing import Scene
from hoi_retarget.viewers.scene.force_curves import FORCE_GROUPS, force_curves
from hoi_retarget.viewers.scene.scene import Shown, make_scene


@dataclass(frozen=True, eq=False)
class PageContent:
    """Scene and curves of a page."""

    scene: Scene
    chart: str = ""
    """HTML of the curves (`curve_chart`)."""
    extra_height_px: int = 0
    """Height of the chart beyond that of one result's curves."""
    strip_height_px: int = 0
    """Height of what lies above the chart (`Player.show_strip`)."""


def page_content(shown: Sequence[Shown], *, compared: bool = False) -> PageContent:
    """Return the content for results and clips; raises what `make_scene` raises.

    Args:
        shown: The results and clips.
        compared: Whether there are curves of the motions before, too.
    """
    scene = make_scene(shown)
    curves = [(item.title, _curves_of(item, item.motion)) for item in shown if item.motion]
    if compared:  # First, so that today's curves are drawn over them.
        curves[:0] = [(f"{item.title}, before", _curves_of(item, item.before)) for item in shown if item.before]
    # The editor has bars of contacts, which can be chosen.
    rows = bar_rows([(item.title, item.motion) for item in shown if item.motion], contacts=False)
    groups = {curve.group for _, own in curves for curve in own}
    extra = (
        CHART_STEP_PX * len(groups.intersection((*SURFACE_GROUPS, *FORCE_GROUPS)))
        + (TITLES_HEIGHT_PX if len(curves) > 1 else 0)
        + BAR_ROW_HEIGHT_PX * len(rows)
    )
    return PageContent(scene, chart_html(curves, scene.fps, rows=rows), extra)


def _curves_of(item: Shown, motion: Motion) -> tuple[Curve, ...]:
    if item.model is None:
        return ()
    return (*curves_of(motion, item.model, item.geometries), *force_curves(motion, item.model, item.clip))
