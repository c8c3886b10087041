"""The page that plays one result, or several to compare, in galleries, reports and `view`; paths lose their folders."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path, PureWindowsPath

from hoi_retarget.clip.clip import Clip
from hoi_retarget.evaluation.figure_table import grouped_columns, scales_text
from hoi_retarget.evaluation.thresholds import known_figures, level_of
from hoi_retarget.motion.motion import Motion
from hoi_retarget.readers.open import clip_of
from hoi_retarget.robots import load_robot
from hoi_retarget.studio.html import render
from hoi_retarget.studio.scene.camera import FittedCamera, fit_camera, fit_each
from hoi_retarget.studio.scene.curves import MAX_POINTS, all_curves, bar_rows, chart_html
from hoi_retarget.studio.scene.drawing import DrawnScene
from hoi_retarget.studio.scene.legend_texts import legend_of_figure
from hoi_retarget.studio.scene.scene import SceneItem
from hoi_retarget.studio.scene.subplots import make_subplots, on_one_floor, short_name
from hoi_retarget.studio.share.gallery import GalleryEntry, summary_of
from hoi_retarget.studio.share.load_results import drawable_clip
from hoi_retarget.studio.share.packed_scene import MAX_FRAMES, pack

PLAYER = tuple(
    f"studio/share/page/player/{name}.js"
    for name in ("numbers", "meshes", "shaders", "shapes", "picture", "camera", "timeline", "player")
)
"""The parts of the page's script, in their order."""
CHART_HEIGHT_PX = 32  # Of one chart on a page that plays.


@dataclass(frozen=True)
class BackLink:
    """The way from a page of one result back to that of all of them."""

    title: str
    page: str


@dataclass(frozen=True)
class Detail:
    """Limits on the contents of a page with a long motion."""

    frames: int  # Of one subject; of a longer one every second, third, ... is kept.
    points: int  # Of one curve.


SMALL = Detail(MAX_FRAMES, MAX_POINTS)  # Small enough to be sent by mail.


@dataclass(frozen=True, eq=False)
class ClipPage:
    """A page, and the scene on it for pictures of it."""

    text: str
    scene: DrawnScene  # All subjects on one floor.
    camera: FittedCamera


def make_clip_page(
    title: str,
    results: Sequence[tuple[GalleryEntry, SceneItem]],
    *,
    back: BackLink | None = None,
    notices: Sequence[str] = (),
    detail: Detail = SMALL,
) -> ClipPage:
    """Return the page of some results; raises `GeometryError` when an object's mesh file cannot be read.

    Args: `title`: of the page; `results`: the results; titles of their items name the robots; `back`: target of a link
    above the title; `notices`: problems with files, a sentence each; `detail`: how much of long motions the page holds.
    """
    entries, shown = [entry for entry, _ in results], [item for _, item in results]
    subplots = make_subplots(shown)
    scene = on_one_floor(subplots)
    floor = fit_camera(scene, shown[0].ahead)
    with_motion = [
        (item, item.motion, item.model) for item in shown if item.motion is not None and item.model is not None
    ]
    chart = chart_html(
        [(item.title, all_curves(motion, model, item.clip)) for item, motion, model in with_motion],
        subplots.fps,
        rows=bar_rows([(item.title, motion) for item, motion, _ in with_motion]),
        chart_height_px=CHART_HEIGHT_PX,
        max_points=detail.points,
        operable=True,
    )
    names, facts = [item.title for item in shown], [_facts(entry, detail) for entry in entries]
    text = render(
        "studio/share/page/clip.html.j2",
        player_files=PLAYER,
        title=title,
        gallery=back.title if back else "",
        back=back.page if back else "",
        summary=" | ".join(summary_of([entry]) for entry in entries),
        notices=notices,
        verdicts=[
            (name, entry.score.verdict.as_json())
            for name, entry in zip(names, entries, strict=True)
            if entry.score.verdict is not None
        ],
        scene=pack(subplots, floor, fit_each(subplots, floor), max_frames=detail.frames),
        curves=chart,
        warnings=[
            f"{name}: {warning}" if len(entries) > 1 else warning
            for name, entry in zip(names, entries, strict=True)
            for warning in entry.warnings
        ],
        heads=names,
        figures={
            heading: [
                (
                    column.title,
                    legend_of_figure(column),
                    [
                        (column.text(entry.score.values().get(column.name)), level_of(entry.motion, column.name))
                        for entry in entries
                    ],
                    column.unit,
                )
                for column in columns
            ]
            for heading, columns in grouped_columns([entry.score for entry in entries]).items()
        },
        facts=[(name, [own[name] for own in facts]) for name in facts[0]],
        commands=list(dict.fromkeys(entry.command for entry in entries if entry.command)),
    )
    return ClipPage(text, scene, floor)


@dataclass(frozen=True)
class Player:
    """A page that plays a motion without a server; notebooks show it in the cell."""

    page: str  # HTML.

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{escape(self.page)}" style="width: 100%; height: 45em; border: 0"></iframe>'


def player(motion: Motion, clip: Clip | None = None) -> Player:
    """Return the page that plays a motion, with the person of its clip, which is found where it was made from a file.

    Raises `RobotError` where its robot is gone, and `GeometryError` where an object's mesh cannot be read.
    """
    model = load_robot(motion.robot)
    clip = drawable_clip(motion, clip_of) if clip is None else clip
    item = SceneItem(short_name(model.spec), motion, model, clip, motion.person)
    entry = GalleryEntry(motion, model.spec, known_figures(motion, Path(motion.report.clip)))
    return Player(make_clip_page(motion.report.clip or motion.robot, [(entry, item)]).text)


def notices_page(notices: Sequence[str]) -> str:
    """Return a page with the reasons why there is nothing to show."""
    return render("studio/share/page/notices.html.j2", title="Nothing can be shown", notices=notices)


def _facts(entry: GalleryEntry, detail: Detail) -> dict[str, str]:
    motion, score = entry.motion, entry.score
    stride = -(-motion.frames // detail.frames)
    return {
        "robot": entry.spec.title,
        "verdict": "" if score.verdict is None else str(score.verdict),
        "recording": last_name(motion.report.source.path),
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


def last_name(path: str) -> str:
    """Return a path's last name, of both kinds of slashes, whichever machine it comes from."""
    return PureWindowsPath(path).name or path
