"""The page that plays one result, or several to be compared; of paths it tells the last name alone.

Galleries, reports and `view` show the same page.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PureWindowsPath

from hoi_retarget.evaluation import shown_columns
from hoi_retarget.evaluation.table import scales_text
from hoi_retarget.evaluation.thresholds import level_of
from hoi_retarget.viewers.html import render
from hoi_retarget.viewers.scene.auto_camera import FittedCamera, fit_camera, fit_each
from hoi_retarget.viewers.scene.bars import bar_rows
from hoi_retarget.viewers.scene.curve_chart import LARGEST_POINTS, chart_html
from hoi_retarget.viewers.scene.curves import curves_of
from hoi_retarget.viewers.scene.drawing import Scene
from hoi_retarget.viewers.scene.force_curves import force_curves
from hoi_retarget.viewers.scene.meanings import meaning_of_figure
from hoi_retarget.viewers.scene.panes import make_panes, on_one_floor
from hoi_retarget.viewers.scene.scene import Shown
from hoi_retarget.viewers.share.gallery import GalleryEntry, summary_of
from hoi_retarget.viewers.share.packed_scene import LARGEST_FRAMES, pack

PLAYER = tuple(
    f"viewers/share/page/player/{name}.js"
    for name in ("numbers", "meshes", "shaders", "shapes", "picture", "camera", "timeline", "player")
)
"""The parts of the page's script, in their order."""
_CHART_HEIGHT_PX = 32


@dataclass(frozen=True)
class Way:
    """The way from a page of one result back to that of all of them."""

    title: str
    page: str


@dataclass(frozen=True)
class Detail:
    """How much of a long motion a page holds."""

    frames: int
    """Of one subject; of a longer one every second, third, ... is kept."""
    points: int
    """Of one curve."""


SMALL = Detail(LARGEST_FRAMES, LARGEST_POINTS)
"""Small enough to be sent by mail."""


@dataclass(frozen=True, eq=False)
class ClipPage:
    """A page, and the scene on it for pictures of it."""

    text: str
    scene: Scene
    """All subjects on one floor."""
    camera: FittedCamera


def make_clip_page(
    title: str,
    results: Sequence[tuple[GalleryEntry, Shown]],
    *,
    back: Way | None = None,
    notices: Sequence[str] = (),
    detail: Detail = SMALL,
) -> ClipPage:
    """Return the page of some results; their titles name the robots.

    Raises:
        GeometryError: An object's mesh file cannot be read.
    """
    shown = [item for _, item in results]
    panes = make_panes(shown)
    scene = on_one_floor(panes)
    floor = fit_camera(scene, shown[0].ahead)
    entries = [entry for entry, _ in results]
    curves = [
        (
            item.title,
            (*curves_of(item.motion, item.model, item.geometries), *force_curves(item.motion, item.model, item.clip)),
        )
        for item in shown
        if item.motion is not None and item.model is not None
    ]
    chart = chart_html(
        curves,
        panes.fps,
        rows=bar_rows([(item.title, item.motion) for item in shown if item.motion is not None]),
        chart_height_px=_CHART_HEIGHT_PX,
        largest_points=detail.points,
        operable=True,
    )
    packed = pack(panes, floor, fit_each(panes, floor), largest_frames=detail.frames)
    names = [item.title for item in shown]
    text = clip_page(title, entries, names=names, scene=packed, curves=chart, back=back, notices=notices, detail=detail)
    return ClipPage(text, scene, floor)


def clip_page(  # noqa: PLR0913
    title: str,
    entries: Sequence[GalleryEntry],
    *,
    names: Sequence[str],
    scene: str,
    curves: str,
    back: Way | None = None,
    notices: Sequence[str] = (),
    detail: Detail = SMALL,
) -> str:
    """Return the HTML of a page.

    Args:
        title: Of the page.
        entries: The results.
        names: What each of them is called beside the others.
        scene: Of `packed_scene.pack`.
        curves: Of `curve_chart.chart_html`.
        back: Where a link above the title leads.
        notices: Problems with files, a sentence each.
        detail: How much of long motions the page holds.
    """
    scores = [entry.score for entry in entries]
    several = len(entries) > 1
    facts = [_facts(entry, detail) for entry in entries]
    return render(
        "viewers/share/page/clip.html.j2",
        player_files=PLAYER,
        title=title,
        gallery=back.title if back else "",
        back=back.page if back else "",
        summary=" | ".join(summary_of([entry]) for entry in entries),
        notices=notices,
        scene=scene,
        curves=curves,
        warnings=[
            f"{name}: {warning}" if several else warning
            for name, entry in zip(names, entries, strict=True)
            for warning in entry.warnings
        ],
        heads=names,
        figures=[
            (
                column.title,
                meaning_of_figure(column),
                [
                    (column.text(entry.score.values().get(column.name)), level_of(entry.motion, column.name))
                    for entry in entries
                ],
                column.unit,
            )
            for column in shown_columns(scores)
        ],
        facts=[(name, [own[name] for own in facts]) for name in facts[0]],
        commands=list(dict.fromkeys(entry.command for entry in entries if entry.command)),
    )


def notices_page(notices: Sequence[str]) -> str:
    """Return a page that says why there is nothing to show."""
    return render("viewers/share/page/notices.html.j2", title="Nothing can be shown", notices=notices)


def _facts(entry: GalleryEntry, detail: Detail) -> dict[str, str]:
    motion, score = entry.motion, entry.score
    stride = -(-motion.frames // detail.frames)
    return {
        "robot": entry.spec.title,
        "recording": _last_name(motion.report.source.path),
        "format": motion.report.source.format,
        "licence": motion.report.source.licence,
        "contacts": "edited" if motion.report.source.contact_edits else "",
        "objects": ", ".join(motion.object_names),
        "object scale": scales_text(motion.object_scale) if motion.object_names else "",
        "root scale": f"{score.root_scale:.3f}" if score.root_scale is not None else "",
        "human height": f"{motion.human_height:.2f} m",
        "frames": f"{motion.frames} at {motion.fps:g} a second",
        "played": f"one frame in {stride}; what lies between is interpolated" if stride > 1 else "",
    }


def _last_name(path: str) -> str:
    # Knows both kinds of slashes, whichever machine the result comes from.
    return PureWindowsPath(path).name or path
