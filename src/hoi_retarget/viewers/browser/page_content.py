"""Content of the editor's page: its scene, and the curves below it."""

from collections.abc import Sequence
from dataclasses import dataclass

from hoi_retarget.viewers.scene.bars import bar_rows
from hoi_retarget.viewers.scene.curve_chart import BAR_ROW_HEIGHT_PX, CHART_STEP_PX, TITLES_HEIGHT_PX, chart_html
from hoi_retarget.viewers.scene.curves import SURFACE_GROUPS, curves_of
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


def page_content(shown: Sequence[Shown]) -> PageContent:
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
    # The editor has bars of contacts, which can be chosen.
    rows = bar_rows([(item.title, item.motion) for item in shown if item.motion], contacts=False)
    groups = {curve.group for _, own in curves for curve in own}
    extra = (
        CHART_STEP_PX * len(groups.intersection((*SURFACE_GROUPS, *FORCE_GROUPS)))
        + (TITLES_HEIGHT_PX if len(shown) > 1 else 0)
        + BAR_ROW_HEIGHT_PX * len(rows)
    )
    return PageContent(scene, chart_html(curves, scene.fps, rows=rows), extra)
