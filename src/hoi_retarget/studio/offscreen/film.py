"""Films of results as files: humans and robots in panels of their own, seen from the same side."""

import io
import itertools
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont

from hoi_retarget.errors import ArgumentError, HoiRetargetError, install_hint
from hoi_retarget.studio.offscreen.renderer import Picture, offscreen_renderer
from hoi_retarget.studio.scene.camera import CameraSettings, cameras
from hoi_retarget.studio.scene.drawing import DrawnScene
from hoi_retarget.studio.scene.scene import SceneItem, group_by_shared_objects, make_scene

Side = Literal["robot", "human", "both"]

VIDEO_MISSING = "Writing MP4 needs imageio-ffmpeg, which is not installed; a .gif or .webp needs nothing. "
_ROBOT_LAYERS = ("robot", "object", "contacts", "inside something")
_HUMAN_LAYERS = ("human", "human's object", "human's contacts")
_BESIDE = 120.0  # From people's heading to the camera's direction: it faces them, from their right [deg].
_BEST_ASPECT = 0.85  # Of a panel: whoever stands in it is taller than wide.
_EMPTY = 255  # Grey of what no panel covers.
_INK = (60, 64, 72)  # Of captions.
_GIF_COLOURS = 200
_WEBP_QUALITY, _WEBP_EFFORT = 70, 4  # Of 100, and of 6.
_GIF_TICK_MS = 10  # A GIF counts time in hundredths of a second.


def panels(shown: Sequence[SceneItem], side: Side = "both", also: Sequence[str] = ()) -> tuple[DrawnScene, ...]:
    """Return the scene of each panel: the human of each clip, then each robot, or robots that share objects.

    `also` are more layers of robots, such as `reference` and `forces`. Raises `ArgumentError` when there is nothing to
    see on that side, `GeometryError` when an object's mesh file cannot be read.
    """
    hosts = group_by_shared_objects(shown)
    groups = [[item for item, host in zip(shown, hosts, strict=True) if host == index] for index in sorted(set(hosts))]
    humans = {
        _recorded(group): [SceneItem(item.title, clip=group[0].clip, person=item.person) for item in group]
        for group in groups
        if group[0].clip is not None
    }
    robots = [group for group in groups if group[0].motion is not None]
    filmed = [_only(make_scene(people), _HUMAN_LAYERS) for people in humans.values() if side != "robot"]
    filmed += [_only(make_scene(group), (*_ROBOT_LAYERS, *also)) for group in robots if side != "human"]
    if not filmed:
        raise ArgumentError(f"there is no {side} to draw. Name a {'clip' if side == 'human' else 'result'}.")
    return tuple(filmed)


def _recorded(group: Sequence[SceneItem]) -> tuple[object, ...]:
    """Return an identity of recorded people: results of one clip are shown with its human once."""
    clips = [item.clip for item in group if item.clip is not None]
    source = clips[0].source
    people = tuple(sorted(item.person for item in group))
    return clips[0].name, source.sha256, source.augmentation, clips[0].frames, people


def _only(scene: DrawnScene, names: Sequence[str]) -> DrawnScene:
    """Return a scene of which only some layers are shown."""
    return scene.with_layers(lambda layer: replace(layer, shown=layer.name in names))


def good_azimuth(shown: Sequence[SceneItem]) -> float:
    """Return the azimuth of a camera that faces people and robots from their right, by their mean heading [deg]."""
    ahead = np.mean([item.ahead for item in shown], axis=0)
    return float(np.round(np.degrees(np.arctan2(ahead[1], ahead[0])) + _BESIDE)) % 360.0


def duration(filmed: Sequence[DrawnScene]) -> float:
    """Return the time until the last panel stands still [s]."""
    return max((scene.frames - 1) / scene.fps for scene in filmed)


@contextmanager
def panel_renderer(
    filmed: Sequence[DrawnScene], view: CameraSettings, width: int, height: int
) -> Iterator[Callable[[float], Picture]]:
    """Open a function that draws all panels at a time [s] in one picture; panels of several results have captions.

    Raises `DrawingError` where this machine has no way to draw without a screen.

    `filmed`: the scene of each panel; `view`: direction, distance and motion of the cameras; `width`: of the picture
    [px]; `height`: of the picture [px].
    """
    columns = _columns(len(filmed), width / height)
    rows = -(-len(filmed) // columns)
    across, down = _edges(width, columns), _edges(height, rows)
    cells = [(down[index // columns], across[index % columns]) for index in range(len(filmed))]
    aspect = (width / columns) / (height / rows)
    with ExitStack() as stack:
        renderers = [
            stack.enter_context(offscreen_renderer(scene, right - left, bottom - top))
            for scene, ((top, bottom), (left, right)) in zip(filmed, cells, strict=True)
        ]
        placed = cameras(filmed, view, aspect)
        names = row_names(filmed)
        captions = names if len(filmed) - names.count("human") > 1 else [""] * len(filmed)

        def draw(time: float) -> Picture:
            picture = np.full((height, width, 3), _EMPTY, dtype=np.uint8)
            drawn = zip(filmed, renderers, placed, captions, cells, strict=True)
            for scene, draw_scene, camera, caption, ((top, bottom), (left, right)) in drawn:
                frame = min(round(time * scene.fps), scene.frames - 1)
                picture[top:bottom, left:right] = _titled(draw_scene(frame, camera(frame)), caption)
            return picture

        yield draw


def row_names(filmed: Sequence[DrawnScene]) -> list[str]:
    """Return a name for each panel: `human`, or the titles of its robots' results."""
    humans = [any(layer.name == "human" and layer.shown for layer in scene.subjects[0].layers) for scene in filmed]
    titles = [" + ".join(subject.title for subject in scene.subjects) for scene in filmed]
    return ["human" if human else title for human, title in zip(humans, titles, strict=True)]


def _titled(picture: Picture, caption: str) -> Picture:
    if not caption:
        return picture
    image = Image.fromarray(picture)
    size = max(10, len(picture) // 28)
    ImageDraw.Draw(image).text((size, len(picture) - 2 * size), caption, _INK, ImageFont.load_default(size))
    return np.asarray(image)


def _columns(count: int, aspect: float) -> int:
    """Return the number of panels in a row with which they are neither too wide nor too high."""

    def waste(columns: int) -> float:
        rows = -(-count // columns)
        return abs(np.log(aspect * rows / columns / _BEST_ASPECT)) + (rows * columns - count) / count

    return min(range(1, count + 1), key=waste)


def _edges(length: int, count: int) -> list[tuple[int, int]]:
    edges = np.linspace(0, length, count + 1).round().astype(int).tolist()
    return list(itertools.pairwise(edges))


def film_times(filmed: Sequence[DrawnScene], fps: float) -> Float[np.ndarray, "N"]:
    """Return the times of a film's pictures [s]."""
    return np.arange(int(duration(filmed) * fps + 1e-6) + 1) / fps


def sheet_times(filmed: Sequence[DrawnScene], count: int) -> Float[np.ndarray, "N"]:
    """Return the times of a contact sheet's pictures: the middles of equal parts of the motion [s]."""
    return duration(filmed) * (np.arange(count) + 0.5) / count


def gif(pictures: Iterable[Picture], samples: Sequence[Picture], fps: float) -> bytes:
    """Return pictures as a GIF file that plays again and again, in the colours of some samples of them."""
    palette = Image.fromarray(np.concatenate(samples)).quantize(_GIF_COLOURS, method=Image.Quantize.MAXCOVERAGE)
    # Without dithering: it would crawl, and cost half as much again.
    frames = [Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    return _animated(frames, "GIF", fps, _GIF_TICK_MS)


def webp(pictures: Iterable[Picture], fps: float, quality: int = _WEBP_QUALITY) -> bytes:
    """Return pictures as an animated WebP file that plays again and again."""
    return _animated(list(map(Image.fromarray, pictures)), "WEBP", fps, 1, quality=quality, method=_WEBP_EFFORT)


def _animated(frames: Sequence[Image.Image], kind: str, fps: float, tick_ms: int, **options: int) -> bytes:
    ends = np.round(1000.0 * np.arange(len(frames) + 1) / fps / tick_ms).astype(int) * tick_ms
    durations, buffer = np.diff(ends).tolist(), io.BytesIO()
    frames[0].save(buffer, kind, save_all=True, append_images=frames[1:], duration=durations, loop=0, **options)
    return buffer.getvalue()


def mp4(pictures: Iterable[Picture], fps: float) -> bytes:
    """Return pictures, of even width and height, as an MP4 file with H.264 video that every player knows.

    Raises `HoiRetargetError` when the encoder is not installed, or fails.
    """
    try:
        from imageio_ffmpeg import get_ffmpeg_exe  # noqa: PLC0415 # pyright: ignore[reportMissingImports] - optional

        program = get_ffmpeg_exe()
    except (ImportError, RuntimeError) as error:
        raise HoiRetargetError(VIDEO_MISSING + install_hint("imageio_ffmpeg")) from error
    pictures = iter(pictures)
    first = next(pictures)
    with tempfile.TemporaryDirectory() as folder:
        path, complaints = Path(folder) / "film.mp4", Path(folder) / "complaints"
        raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{first.shape[1]}x{first.shape[0]}", "-r", f"{fps:.6f}"]
        coded = ["-c:v", "libx264", "-crf", "20", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
        with complaints.open("wb") as output:
            words = [program, "-loglevel", "error", *raw, "-i", "-", "-an", *coded, str(path)]
            with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=output, stderr=output) as encoder:
                try:
                    _feed(encoder, itertools.chain([first], pictures))
                except BaseException:
                    encoder.kill()
                    raise
        if encoder.returncode:
            said = " ".join(complaints.read_text(errors="replace").split())
            raise HoiRetargetError(f"the video could not be encoded: {said or f'exit code {encoder.returncode}'}")
        return path.read_bytes()


def _feed(encoder: subprocess.Popen, pictures: Iterable[Picture]) -> None:
    assert encoder.stdin is not None  # It is a pipe.
    # An encoder that gives up closes its end; its own words tell why.
    with suppress(BrokenPipeError):
        for picture in pictures:
            encoder.stdin.write(np.ascontiguousarray(picture).data)
    with suppress(BrokenPipeError):
        encoder.stdin.close()
