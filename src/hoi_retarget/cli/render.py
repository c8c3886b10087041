"""`hoi-retarget render`: results as a picture or a film."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import isfinite
from pathlib import Path

import numpy as np

from hoi_retarget.cli.commands import Render
from hoi_retarget.cli.open_results import clip_or_warning, load_motion
from hoi_retarget.cli.output_checks import check_writable, write_file
from hoi_retarget.cli.terminal import Working, program, say
from hoi_retarget.errors import ArgumentError, HoiRetargetError, install_hint
from hoi_retarget.motion.motion import SIMULATED
from hoi_retarget.readers.open import clip_of
from hoi_retarget.robots import load_robot
from hoi_retarget.studio.offscreen import film
from hoi_retarget.studio.offscreen.paper import contact_moments, paper_picture
from hoi_retarget.studio.offscreen.robot_portraits import png
from hoi_retarget.studio.scene.camera import CameraSettings
from hoi_retarget.studio.scene.drawing import DrawnScene
from hoi_retarget.studio.scene.scene import SceneItem, seen_through, without_marks
from hoi_retarget.studio.scene.subplots import titles_of

_SHEET_FRAMES = 6  # Of a contact sheet, where nothing else is asked for.
# By kind of file: width and height [px].
_PANEL = {".mp4": (640, 720), ".gif": (320, 360), ".webp": (480, 480), ".png": (640, 720)}
_SHEET_PANEL = (290, 340)
_MIN_SIDE_PX, _MAX_SIDE_PX = 64, 8192
_NUMBERS: Mapping[str, tuple[Callable[[float], bool], str]] = {
    **{
        name: (lambda value, most=most: 0 < value <= most, f"a positive number up to {most}")
        for name, most in (("frames", 28), ("fps", 240), ("distance", 50))
    },
    **dict.fromkeys(("azimuth", "elevation"), (isfinite, "a number of degrees")),
}
"""Options that are numbers: which ones fit."""
_MAX_RATE = {".mp4": 60.0, ".gif": 15.0, ".webp": 15.0}  # Pictures a second, where nothing else is asked for.


def execute_render(command: Render) -> int:
    """Draw the results into one file."""
    kind = _check(command)
    shown = _titled(command.results, [_shown(path, command) for path in command.results])
    if command.style == "paper" and len(shown) == 1 and shown[0].model is not None:
        shown = [replace(shown[0], title=shown[0].model.spec.title.partition(",")[0])]
    filmed = film.panels(shown, command.only, command.also)
    if command.see_through:
        filmed = tuple(seen_through(scene) for scene in filmed)
    azimuth = film.good_azimuth(shown) if command.azimuth == "auto" else command.azimuth
    distance = None if command.distance == "auto" else command.distance
    look = None if command.look_at == "body" else command.look_at.replace("_", " ")
    view = CameraSettings(azimuth, command.elevation, distance, follow=command.camera == "follow", look=look)
    if command.style == "paper":
        content = _for_paper(command, shown, filmed, view)
    elif kind == ".png":
        content = _picture(command, filmed, view)
    else:
        content = _film(command, kind, filmed, view)
    write_file("--out", command.out, content)
    say(f"written: {command.out}  ({len(content) / 1e6:.2f} MB)")
    return 0


def _for_paper(
    command: Render, shown: Sequence[SceneItem], filmed: Sequence[DrawnScene], view: CameraSettings
) -> bytes:
    """Return the moments of the first motion, or the frames that are asked for, cut out."""
    plain = tuple(without_marks(scene) for scene in filmed)
    motion = shown[0].motion
    moments = () if motion is None or command.frames or command.frame is not None else contact_moments(motion)
    if command.frame is not None:
        times = [_time_of(command.frame, plain)]
    elif motion is not None and moments:
        times = [moment.frame / motion.fps for moment in moments]
    else:
        times = film.sheet_times(plain, command.frames or _SHEET_FRAMES).tolist()
    names = [f"{moment.title}, " for moment in moments] or [""] * len(times)
    titles = [f"{name}{time:.2f} s" for name, time in zip(names, times, strict=True)]
    cell = _size(command, *_PANEL[".png"])
    fixed = replace(view, follow=view.follow and not command.overlaid)
    with Working("drawing", len(times) * len(plain)) as working:
        return paper_picture(
            plain,
            fixed,
            cell,
            times=times,
            titles=titles,
            rows=film.row_names(plain),
            overlaid=command.overlaid,
            transparent=command.background == "transparent",
            drawn=working.advance,
        )


def _time_of(frame: int, filmed: Sequence[DrawnScene]) -> float:
    """Return when a frame is [s]; raises `ArgumentError` for one that there is not."""
    rate = max(scene.fps for scene in filmed)
    last = round(film.duration(filmed) * rate)
    if not 0 <= frame <= last:
        raise ArgumentError(f"--frame {frame}: the motion has the frames 0 to {last}.")
    return frame / rate


def _check(command: Render) -> str:
    """Return the kind of file to write; raise `ArgumentError` for options that do not fit, before anything is read."""
    kind = command.out.suffix.lower()
    if kind not in _PANEL:
        raise ArgumentError(f"--out {command.out}: name a file that ends in .mp4, .gif, .webp or .png.")
    if kind == ".mp4" and (hint := install_hint("imageio_ffmpeg")):
        raise HoiRetargetError(film.VIDEO_MISSING + hint)
    others, fitting = (("fps",), ".mp4, .gif and .webp") if kind == ".png" else (("frame", "frames"), ".png")
    for name in others:
        if (value := getattr(command, name)) is not None:
            raise ArgumentError(f"--{name} {value}: this is for {fitting} files; --out names a {kind} file.")
    _check_style(command, kind)
    if command.frame is not None and command.frames is not None:
        raise ArgumentError("both --frame and --frames are given: the one draws one frame, the other so many.")
    for name, (fits, expected) in _NUMBERS.items():
        value = getattr(command, name)
        if isinstance(value, int | float) and not fits(value):
            raise ArgumentError(f"--{name} {value}: it must be {expected}.")
    check_writable("--out", command.out.parent)
    return kind


def _check_style(command: Render, kind: str) -> None:
    if command.style == "paper" and kind != ".png":
        raise ArgumentError(f"--style paper: this is for .png files; --out names a {kind} file.")
    for name, given in (("background", command.background != "white"), ("overlaid", command.overlaid)):
        if given and command.style != "paper":
            raise ArgumentError(f"--{name} is for pictures for a paper. Add --style paper.")


def _titled(results: Sequence[Path], shown: Sequence[SceneItem]) -> list[SceneItem]:
    motions = [item.motion for item in shown if item.motion is not None]
    titles = titles_of(list(zip(results, motions, strict=True)))
    return [replace(item, title=title) for item, title in zip(shown, titles, strict=True)]


def _shown(path: Path, command: Render) -> SceneItem:
    motion = load_motion(path, command.robot)
    if command.also and motion.stages[-1].name != SIMULATED:
        raise ArgumentError(
            f"--also {' '.join(command.also)}: {path} was not performed in simulation. "
            f"`{program()} refine {path}` does so."
        )
    model = load_robot(motion.robot)
    if command.only == "human":
        clip = clip_of(motion, name=command.clip, objects=command.objects)
    else:
        clip = clip_or_warning(path, motion, command, "drawn without the human, and the object as its axes.")
    return SceneItem(path.stem, motion, model, clip, motion.person, command.meshes)


def _picture(command: Render, filmed: Sequence[DrawnScene], view: CameraSettings) -> bytes:
    """Return one frame, or a contact sheet."""
    if command.frame is not None:
        times = np.array([_time_of(command.frame, filmed)])
        width, height = _size(command, *_beside(filmed, _PANEL[".png"]))
    else:
        times = film.sheet_times(filmed, command.frames or _SHEET_FRAMES)
        width, height = _size(command, len(times) * _SHEET_PANEL[0], len(filmed) * _SHEET_PANEL[1])
    with film.panel_renderer(filmed, view, max(1, width // len(times)), height) as draw:
        return png(np.concatenate(list(_drawn(draw, times)), axis=1))


def _film(command: Render, kind: str, filmed: Sequence[DrawnScene], view: CameraSettings) -> bytes:
    rate = max(scene.fps for scene in filmed)
    fps = command.fps or rate / np.ceil(rate / _MAX_RATE[kind] - 1e-6)
    width, height = _size(command, *_beside(filmed, _PANEL[kind]))
    if kind == ".mp4" and (width % 2 or height % 2):
        raise ArgumentError(f"--size {command.size}: the width and the height of a video must be even.")
    times = film.film_times(filmed, fps)
    with film.panel_renderer(filmed, view, width, height) as draw:
        pictures = _drawn(draw, times)
        if kind == ".mp4":
            return film.mp4(pictures, fps)
        if kind == ".webp":
            return film.webp(pictures, fps)
        return film.gif(pictures, [draw(time) for time in film.sheet_times(filmed, _SHEET_FRAMES)], fps)


def _drawn(draw: Callable[[float], film.Picture], times: Sequence[float] | np.ndarray) -> Iterator[film.Picture]:
    """Yield a picture for each time, with a bar."""
    with Working("drawing", len(times)) as working:
        for time in times:
            yield draw(float(time))
            working.advance()


def _beside(filmed: Sequence[DrawnScene], panel: tuple[int, int]) -> tuple[int, int]:
    """Return the size of a picture of all panels [px]: up to three in a row."""
    columns = len(filmed) if len(filmed) <= 3 else int(np.ceil(np.sqrt(len(filmed))))
    return panel[0] * columns, panel[1] * -(-len(filmed) // columns)


def _size(command: Render, width: int, height: int) -> tuple[int, int]:
    """Return the size that is asked for, or else the given one [px]."""
    if command.size == "auto":
        return width, height
    numbers = re.fullmatch(r"(\d{1,6})[xX](\d{1,6})", command.size)
    sides = tuple(map(int, numbers.groups())) if numbers else ()
    if len(sides) != 2 or not all(_MIN_SIDE_PX <= side <= _MAX_SIDE_PX for side in sides):
        raise ArgumentError(
            f"--size {command.size}: give width and height in pixels, from {_MIN_SIDE_PX} to {_MAX_SIDE_PX}, "
            "such as 1280x720."
        )
    return sides[0], sides[1]
