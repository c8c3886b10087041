"""The timeline of results: bars of contacts, stance and warnings above charts of curves, and its fragment of HTML.

Every curve comes from the functions behind the figures (`evaluation`): its mean or extreme is the figure. A value
between two frames is plotted at the later one. The plotting area begins `LEFT_INSET_PX` from the fragment's left edge
and ends `RIGHT_INSET_PX` from its right one, however wide the page: frame 0 lies on the one, the last on the other.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.clip.clip import Clip, Severity
from hoi_retarget.dynamics.feasibility import forces_on_clip, physics_of_motion
from hoi_retarget.dynamics.grip_margin import grip_margins
from hoi_retarget.errors import RobotError
from hoi_retarget.evaluation import Comparison, contact_residuals, motion_figures
from hoi_retarget.evaluation.hand_slip import slip_curves
from hoi_retarget.evaluation.surface_distances import PART_SITES, distances_of_motion
from hoi_retarget.motion.motion import Motion, check_robot
from hoi_retarget.motion.motion_report import Status
from hoi_retarget.numerics.arrays import frozen, runs
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.spec import SIDES
from hoi_retarget.studio.html import render, with_exponents
from hoi_retarget.studio.scene.legend_texts import BARS, CURVES, badness, worst_frame

CONTACT, STANCE, WARNING, ERROR = "contact", "stance", "warning", "error"


@dataclass(frozen=True)
class Bar:
    """A stretch of time."""

    start: float  # [s]
    stop: float  # [s]
    kind: str  # One of `contact`, `stance`, `warning` and `error`.
    text: str  # What it stands for, in words.


@dataclass(frozen=True)
class BarRow:
    """Bars of one kind beside each other."""

    name: str
    bars: tuple[Bar, ...]


def bar_rows(results: Sequence[tuple[str, Motion]], *, contacts: bool = True) -> tuple[BarRow, ...]:
    """Return the rows of one or several results by their titles; rows that say the same of several are there once."""
    rows: list[BarRow] = []
    for title, motion in results:
        for row in _rows(motion, contacts):
            namesakes = [other for other in rows if other.name == row.name]
            if row.bars and row not in rows:
                rows.append(BarRow(f"{row.name}, {title}", row.bars) if namesakes else row)
    return tuple(rows)


def _rows(motion: Motion, contacts: bool) -> Iterator[BarRow]:
    touching = dict(zip(motion.contact_links, motion.contact_flags.T, strict=True)) if contacts else {}
    for link, flags in touching.items():
        yield _row(motion, _part(link).replace("_", " "), flags, CONTACT, "touches")
    for side, flags in zip(SIDES, motion.stance_flags.T, strict=True):
        yield _row(motion, f"{side} stance", flags, STANCE, "the foot stands")
    yield BarRow("warnings", tuple(_warnings(motion)))


def _part(link: str) -> str:
    """Return the name of what touches with a contact link: a hand, not the middle of its palm."""
    return next((part for part, site in PART_SITES.items() if site == link), link)


def _row(motion: Motion, name: str, flags: Bool[np.ndarray, "T"], kind: str, what: str) -> BarRow:
    return BarRow(name, tuple(_motion_bar(motion, first, stop - 1, kind, what) for first, stop in runs(flags)))


def _warnings(motion: Motion) -> Iterator[Bar]:
    """Yield the warnings and errors of a motion at their times."""
    report = motion.report
    for window in motion.stages[-1].windows:
        if window.status is not Status.SOLVED:
            yield _motion_bar(motion, window.start, window.stop - 1, WARNING, f"the solver {window.status.message}")
    for event in report.events:
        kind = ERROR if event.warning.severity is Severity.ERROR else WARNING
        yield _motion_bar(motion, event.first_frame, event.last_frame, kind, str(event))
    for jump in report.rotation_jumps:
        last = jump.first_frame if jump.last_frame is None else jump.last_frame
        yield _motion_bar(motion, jump.first_frame, last, WARNING, str(jump))


def _motion_bar(motion: Motion, first: int, last: int, kind: str, text: str) -> Bar:
    return Bar(first / motion.fps, last / motion.fps, kind, text)


SURFACE_GROUPS = ("surface gap", "inside object")  # Groups that are there where the objects' shapes are known.


@dataclass(frozen=True, eq=False)
class Curve:
    """One quantity over T frames."""

    name: str  # Its name within the group, such as `left_palm`.
    unit: str
    values: Float[np.ndarray, "T"]  # NaN where undefined.
    group: str  # The quantity; curves of one group are drawn in one chart.
    fps: float
    counted: Bool[np.ndarray, "T"] | None = None
    """Frames that the figure counts, such as stance; None where all of them count."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", frozen(self.values))
        if self.counted is not None:
            object.__setattr__(self, "counted", frozen(self.counted, bool))


def curves_of(
    motion: Motion, model: RobotModel, geometries: tuple[ObjectGeometry, ...] | None = None
) -> tuple[Curve, ...]:
    """Return the curves of a result; raises `RobotError` when its joints are not the model's.

    - `surface gap` [mm]: of the skin of each link that is to touch, negative inside the object.
    - `inside object` [mm]: of the deepest point of the robot.
    - `contact gap` [mm]: of each link that ever touches, its distance on the object from its target.
    - `sole height` [mm]: of each foot's lowest sole corner; stance counts.
    - `slide` [cm/s]: horizontal speed of each ankle over pairs of stance frames.
    - `jerk` [m/s^3]: mean and largest over the links.
    - `joint margin` [deg] and `speed margin` [rad/s]: smallest over the joints.
    """
    check_robot(motion, model)
    kinematics = model.forward(motion.qpos)

    def curve(group: str, unit: str, name: str, values: np.ndarray, counted: np.ndarray | None = None) -> Curve:
        return Curve(name, unit, values, group, motion.fps, counted)

    stance = motion.stance_flags
    residuals = contact_residuals(motion, kinematics)
    heights = motion_figures.sole_heights(kinematics)
    speeds = _from_frame(1, motion_figures.foot_speeds(kinematics, motion.fps))
    steps = _from_frame(1, stance[1:] & stance[:-1]) == 1.0
    jerks = motion_figures.body_jerks(kinematics, motion.fps)
    range_margins = _finite(motion_figures.joint_range_margins(motion, model).min(axis=1))
    speed_margins = _from_frame(1, _finite(motion_figures.joint_speed_margins(motion, model).min(axis=1)))
    return (
        *_surface_curves(motion, model, geometries),
        *(
            curve("contact gap", "mm", link, 1e3 * residuals[:, column])
            for column, link in enumerate(motion.contact_links)
            if np.isfinite(residuals[:, column]).any()
        ),
        *(
            curve("sole height", "mm", f"{side}_foot", 1e3 * heights[:, column], stance[:, column])
            for column, side in enumerate(SIDES)
        ),
        *(
            curve("slide", "cm/s", f"{side}_foot", np.where(steps[:, column], 1e2 * speeds[:, column], np.nan))
            for column, side in enumerate(SIDES)
        ),
        curve("jerk", "m/s^3", "mean link", _from_frame(3, jerks.mean(axis=1))[: motion.frames]),
        curve("jerk", "m/s^3", "largest", _from_frame(3, jerks.max(axis=1))[: motion.frames]),
        curve("joint margin", "deg", "smallest", np.degrees(range_margins)),
        curve("speed margin", "rad/s", "smallest", speed_margins),
    )


def _surface_curves(
    motion: Motion, model: RobotModel, geometries: tuple[ObjectGeometry, ...] | None
) -> Iterator[Curve]:
    if not geometries:
        return
    distances, gaps = distances_of_motion(motion, model, geometries)
    for column, link in enumerate(motion.contact_links):
        if np.isfinite(gaps[:, column]).any():
            yield Curve(_part(link), "mm", 1e3 * gaps[:, column], SURFACE_GROUPS[0], motion.fps)
    deepest = distances.depth.max(axis=(0, 1), initial=0.0)
    yield Curve("deepest", "mm", 1e3 * deepest, SURFACE_GROUPS[1], motion.fps)


def _from_frame(first: int, values: np.ndarray) -> Float[np.ndarray, "..."]:
    """Return values that begin at a frame, with NaN before it."""
    return np.concatenate([np.full((first, *values.shape[1:]), np.nan), values])


def _finite(values: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Return the values with NaN in the place of infinities: a joint without a limit has no margin."""
    return np.where(np.isfinite(values), values, np.nan)


TRUNK_GROUP, SLIP_GROUP = "trunk", "hand slip"  # Groups that are there where the clip is known.
FORCE_GROUPS = ("missing wrench", "torque", "grip margin")  # Groups that are there where masses and torques are known.


def all_curves(motion: Motion, model: RobotModel, clip: Clip | None) -> tuple[Curve, ...]:
    """Return the curves of a result and, where shapes of objects and torque limits are known, of forces.

    - Those of `curves_of`.
    - `trunk` [deg]: the angle between the chests of robot and human, and how much their sideways leans differ.
    - `hand slip` [mm/s]: of each hand's palm over the object that it touches, and of the person's; frames in which the
      person's holds still count.
    - `missing wrench` [%]: of the robot over its weight, and of each object over its own.
    - `torque` [%]: of the joint that would need most of its limit.
    - `grip margin` [g]: the acceleration that hands bear at each object, and that the person's hands would.

    Raises `GeometryError` when an object's mesh cannot be read.
    """
    own = curves_of(motion, model, None if clip is None else tuple(track.geometry for track in clip.objects))
    if clip is None and motion.object_names:
        return own
    if clip is not None:
        own = (*own, *_compared_curves(motion, model, clip))
    try:
        return (*own, *_force_curves(motion, model, clip))
    except RobotError:
        return own


def named_curves(motion: Motion, clip: Clip | None = None) -> dict[str, Float[np.ndarray, "T"]]:
    """Return the viewer's curves by group, name and unit, such as `slide, left_foot [cm/s]`, a value a frame.

    Without the clip that a result was made from, those that need no human and no object. Raises as `all_curves`.
    """
    found = all_curves(motion, load_robot(motion.robot), clip)
    return {f"{curve.group}, {curve.name} [{curve.unit}]": curve.values for curve in found}


def _compared_curves(motion: Motion, model: RobotModel, clip: Clip) -> Iterator[Curve]:
    view = Comparison(motion, clip, motion.person, model.forward(motion.qpos))
    for name, values in zip(("off", "lean"), motion_figures.trunk_deviations(view), strict=True):
        if values.size:
            yield Curve(name, "deg", _from_frame(view.first, values), TRUNK_GROUP, motion.fps)
    several = len(motion.object_names) > 1
    for slip in slip_curves(view):
        name = f"{slip.part} on {motion.object_names[slip.object]}" if several else slip.part
        held = _from_frame(view.first, slip.held) == 1.0
        for whose, speed in ((name, slip.robot), (f"{name}, person", slip.human)):
            yield Curve(whose, "mm/s", _from_frame(view.first, 1e3 * speed), SLIP_GROUP, motion.fps, held)


def _force_curves(motion: Motion, model: RobotModel, clip: Clip | None) -> Iterator[Curve]:
    forces = forces_on_clip(motion, clip, model)
    missing, torque, grip = FORCE_GROUPS
    yield Curve("robot", "%", 1e2 * forces.missing_share, missing, motion.fps)
    for name, share in zip(motion.object_names, forces.missing_share_at_objects.T, strict=True):
        if np.isfinite(share).any():
            yield Curve(name, "%", 1e2 * share, missing, motion.fps)
    yield Curve("largest", "%", 1e2 * forces.torque_shares.max(axis=1), torque, motion.fps)
    if clip is not None:
        for item in grip_margins(motion, clip, model.forward(motion.qpos), physics_of_motion(motion)):
            name = motion.object_names[item.object]
            for whose, margin in ((name, item.robot), (f"{name}, person", item.human)):
                yield Curve(whose, "g", margin, grip, motion.fps)


LEFT_INSET_PX = 164
RIGHT_INSET_PX = 160
CHART_HEIGHT_PX = 20
CHART_STEP_PX = CHART_HEIGHT_PX + 3  # From one chart to the next.
BAR_ROW_HEIGHT_PX = 15
TITLES_HEIGHT_PX = 19  # Of the line that names several results.
MAX_POINTS = 1500  # Points of one curve; of longer ones the smallest and the largest number of every stretch is drawn.

_WIDTH, _HEIGHT = 20_000, 4000  # Units of the drawings, which are stretched to the page.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
_DASHES = ("", "5 3", "1.5 2.5", "7 2.5 1.5 2.5")
_ROUND_NUMBERS = np.array([1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0])
_ROUND_STEPS = np.array([1.0, 2.0, 5.0, 10.0])
_MAX_TICKS = 12


@dataclass(frozen=True)
class _Look:
    """Colour and dashes of a curve."""

    colour: str
    dash: str = ""


def chart_html(  # noqa: PLR0913 - options with defaults
    subjects: Sequence[tuple[str, tuple[Curve, ...]]],
    fps: float,
    *,
    rows: Sequence[BarRow] = (),
    chart_height_px: int = CHART_HEIGHT_PX,
    max_points: int = MAX_POINTS,
    operable: bool = False,
) -> str:
    """Return the charts of one or several results: a chart a group, curves of all results in it.

    One result's curves differ in colour. Of several results each has a colour, and its curves differ in
    their dashes. Frames that a figure counts are drawn bold, where it counts only some.

    Args: `subjects`: each result's title and curves; `fps`: rate of the frames that the time axis is divided into:
    `Scene.fps` where a scene plays beside it; `rows`: bars above the charts; `chart_height_px`: of one chart [px];
    `max_points`: points of one curve; `operable`: whether a script of the page (`share/page/timeline.js`) makes it
    answer to the pointer.
    """
    seconds = max(((len(curve.values) - 1) / curve.fps for _, curves in subjects for curve in curves), default=0.0)
    # The last frame of the scene, as `Scene.frames` counts.
    seconds = max(round(seconds * fps), 1) / fps
    groups: dict[str, list[tuple[int, Curve]]] = {}
    for index, (_, curves) in enumerate(subjects):
        for curve in curves:
            groups.setdefault(curve.group, []).append((index, curve))
    several = len(subjects) > 1
    return render(
        "studio/scene/page/chart.html.j2",
        **{"left_px": LEFT_INSET_PX, "right_px": RIGHT_INSET_PX, "chart_height_px": chart_height_px},
        **{"width": _WIDTH, "height": _HEIGHT},
        **{"bar_height_px": BAR_ROW_HEIGHT_PX, "operable": operable, "seconds": seconds},
        rows=[
            {"name": row.name, "meaning": BARS[row.bars[0].kind], "bars": [_bar(bar, seconds, fps) for bar in row.bars]}
            for row in rows
        ],
        titles=[(title, _Look(_colour(index))) for index, (title, _) in enumerate(subjects)] if several else [],
        ticks=[
            {"x": _x(tick, seconds), "left": f"{100 * tick / seconds:.3f}", "text": f"{tick:g}"}
            for tick in _ticks(seconds)
        ],
        charts=[
            _chart(group, curves, seconds, several, max_points)
            for group, curves in groups.items()
            if any(np.isfinite(curve.values).any() for _, curve in curves)
        ],
    )


def _bar(bar: Bar, seconds: float, fps: float) -> dict[str, Any]:
    """Return a bar's place as shares of the time axis; it is as wide as one frame at least."""
    when = f"{bar.start:.2f} to {bar.stop:.2f} s" if bar.stop > bar.start else f"{bar.start:.2f} s"
    share = max(bar.stop - bar.start, 0.5 / fps) / seconds
    return {"at": bar.start / seconds, "share": share, "kind": bar.kind, "text": f"{bar.text}, {when}"}


def _chart(
    group: str, curves: Sequence[tuple[int, Curve]], seconds: float, several: bool, max_points: int
) -> dict[str, Any]:
    """Return the template's values for a group of curves, each with the number of its result."""
    names = list(dict.fromkeys(curve.name for _, curve in curves))
    low, high = _range([curve.values for _, curve in curves])

    def look(name: str, colour: str) -> _Look:
        number = names.index(name)
        return _Look(colour, _DASHES[number % len(_DASHES)]) if several else _Look(_colour(number))

    drawn = [
        {
            "d": _path(values, curve.fps, seconds, low, high, max_points),
            "look": look(curve.name, _colour(index)),
            "width": width,
            # Of a curve that is drawn twice, the first time tells all its values.
            "name": f"{curve.name.replace('_', ' ')} {index}" if number == 0 else "",
        }
        for index, curve in curves
        for number, (values, width) in enumerate(_passes(curve))
    ]
    return {
        "group": group,
        "meaning": CURVES[group][0] if group in CURVES else "",
        "worst": _worst(group, [curve for _, curve in curves]),
        "unit": curves[0][1].unit,
        "low": f"{low:g}",
        "high": f"{high:g}",
        "zero": f"{_HEIGHT * high / (high - low):.0f}",
        "paths": [stroke for stroke in drawn if stroke["d"]],
        # Of several results, the legend tells the dashes; the colours stand above all charts.
        "legend": {name.replace("_", " "): look(name, "#444") for name in names},
        "indices": list(dict.fromkeys(index for index, _ in curves)),
    }


def _worst(group: str, curves: Sequence[Curve]) -> dict[str, Any] | None:
    """Return the worst moment of some curves, in words too."""
    found = []
    for curve in curves:
        frame = worst_frame(group, curve.values, curve.counted)
        if frame is not None:
            found.append((float(badness(group, curve.values[frame : frame + 1])[0]), frame, curve))
    if not found:
        return None
    _, frame, curve = max(found, key=lambda item: item[0])
    second = frame / curve.fps
    text = f"{curve.name.replace('_', ' ')} {curve.values[frame]:.3g} {with_exponents(curve.unit)} at {second:.2f} s"
    return {"second": f"{second:.4f}", "text": text}


def _colour(number: int) -> str:
    return _COLOURS[number % len(_COLOURS)]


def _passes(curve: Curve) -> Iterator[tuple[Float[np.ndarray, "T"], float]]:
    """Yield the strokes of a curve and their widths [px]: counted frames are drawn over it once more."""
    if curve.counted is None:
        yield curve.values, 1.4
    else:
        yield curve.values, 0.7
        yield np.where(curve.counted, curve.values, np.nan), 2.0


def _path(  # noqa: PLR0913, PLR0917 - a curve and its axes
    values: Float[np.ndarray, "T"], fps: float, seconds: float, low: float, high: float, max_points: int
) -> str:
    """Return a curve as the commands of an SVG path."""
    strokes = []
    for frames in _strokes(values, max_points):
        heights = _HEIGHT * (high - values[frames]) / (high - low)
        points = [f"{_x(frame / fps, seconds)} {height:.0f}" for frame, height in zip(frames, heights, strict=True)]
        # A number alone is a stroke of no length, which round ends make a dot.
        strokes.append(f"M{points[0]}{'h0' if len(points) == 1 else 'L'}{' '.join(points[1:])}")
    return "".join(strokes)


def _strokes(values: Float[np.ndarray, "T"], max_points: int) -> Iterator[Int[np.ndarray, "_"]]:
    """Yield the frames that are joined: runs of numbers, or the extremes of equal stretches of a long curve."""
    there = np.isfinite(values)
    if len(values) <= max_points:
        yield from (np.arange(first, stop) for first, stop in runs(there))
        return
    stretches = np.array_split(np.arange(len(values)), max_points // 2)
    inhabited = [stretch[there[stretch]] for stretch in stretches]
    for first, stop in runs(np.array([len(frames) > 0 for frames in inhabited])):
        extremes = [
            (frames[values[frames].argmin()], frames[values[frames].argmax()]) for frames in inhabited[first:stop]
        ]
        yield np.unique(extremes)


def _range(values: Sequence[Float[np.ndarray, "_"]]) -> tuple[float, float]:
    """Return round numbers around all values and zero."""
    everything = np.concatenate([each[np.isfinite(each)] for each in values])
    low, high = 0.0 - _round_up(-everything.min(), _ROUND_NUMBERS), _round_up(everything.max(), _ROUND_NUMBERS)
    return (low, high) if high > low else (low, 1.0)


def _round_up(number: float, mantissas: Float[np.ndarray, "_"]) -> float:
    if number <= 0.0:
        return 0.0
    power = 10.0 ** np.floor(np.log10(number))
    # Ten times the power itself is always enough, but for rounding.
    return float(power * mantissas[min(np.searchsorted(mantissas, number / power), len(mantissas) - 1)])


def _ticks(seconds: float) -> tuple[float, ...]:
    step = _round_up(seconds / _MAX_TICKS, _ROUND_STEPS)
    return tuple(float(number * step) for number in range(int(seconds / step + 1e-9) + 1))


def _x(second: float, seconds: float) -> int:
    return round(_WIDTH * second / seconds)
