"""Pictures of one robot in a pose, portraits for its page, and small pictures of a result."""

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont

from hoi_retarget.errors import ArgumentError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.robots.model import Kinematics, RobotModel, load_model
from hoi_retarget.robots.spec import SIDES, SITES, RobotSpec
from hoi_retarget.studio.offscreen import stage
from hoi_retarget.studio.offscreen.film import webp
from hoi_retarget.studio.offscreen.renderer import Picture, offscreen_renderer
from hoi_retarget.studio.scene.camera import FIELD_OF_VIEW, Camera, CameraSettings, FittedCamera, camera_axes, cameras
from hoi_retarget.studio.scene.drawing import DrawnScene, Layer, Lines, Part, Shapes, Subject
from hoi_retarget.studio.scene.human_shapes import human_shapes, person_in_pose
from hoi_retarget.studio.scene.marks import site_marks
from hoi_retarget.studio.scene.robot_shapes import robot_parts

FRONT_AND_SIDE = (CameraSettings(155.0, -8.0), CameraSettings(90.0, -4.0))
_ASPECT = 0.62  # Of a panel.


def picture(
    spec: RobotSpec,
    qpos: Float[np.ndarray, "nq"] | None = None,
    *,
    meshes: Path | None = None,
    views: tuple[CameraSettings, ...] = FRONT_AND_SIDE,
    height: int = 800,
) -> Picture:
    """Draw a robot on a floor, one panel per view, side by side, in red, green, blue.

    Raises `ArgumentError` for a configuration of another robot, `ReadError` for mesh files that are missing or damaged,
    and `DrawingError` where this machine has no way to draw without a screen.

    Args: `spec`: the robot; `qpos`: its configuration, root first; the home pose where none is given; `meshes`: folder
    with the vendor's mesh files (`spec.meshes`), or with folders that hold them; without it those that were fetched, or
    the primitives of the MJCF; `views`: one panel each, from left to right; `height`: of the picture [px]; a panel is
    0.62 times as wide.
    """
    model = load_model(spec)
    pose = model.home_qpos if qpos is None else qpos
    if pose.shape != model.home_qpos.shape:
        raise ArgumentError(f"{spec.name}: a configuration has {len(model.home_qpos)} numbers, not {pose.shape}.")
    robot = Layer("robot", robot_parts(model, model.forward(pose[None]), meshes))
    scene = DrawnScene((Subject(spec.title, 1.0, (robot,), pose[None, :3]),))
    width = round(_ASPECT * height)
    with offscreen_renderer(scene, width, height) as draw:
        panels = [draw(0, cameras([scene], view, _ASPECT)[0](0)) for view in views]
    return np.concatenate(panels, axis=1)


def png(pixels: Picture) -> bytes:
    """Return a picture as the bytes of a PNG file."""
    return _encoded(pixels, format="PNG", optimize=True)


def jpeg(pixels: Picture) -> bytes:
    """Return a picture as the bytes of a JPEG file, smaller and made faster than a PNG."""
    return _encoded(pixels, format="JPEG", quality=90, subsampling=0)


def _encoded(pixels: Picture, **options: Any) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, **options)
    return buffer.getvalue()


_HEIGHT = 560  # Of a picture [px].
_TALL, _WIDE = 0.62, 0.9  # Widths over heights.
_AXES, _FINE_AXES = 0.045, 0.03  # Lengths of a site's axes, from afar and from near, as shares of the stature.
_SEE_THROUGH, _NEARLY_SOLID = 0.4, 0.8
_PALE = (178, 184, 194)  # Of robots on which marks are to be seen: many makers' are black.
_ASIDE = 0.5  # From a robot to the person beside it, as a share of the stature.
_FACING = CameraSettings(180.0, -6.0)
_NEAR_FEET, _NEAR_HAND = 0.3, 0.17  # What is seen around them, as shares of the stature.
_INK, _HALO = (20, 22, 28), (255, 255, 255)
_LINE = 12  # Height of names [px].
_UPPER_SITES = tuple(site for site in SITES if not any(part in site for part in ("hip", "knee", "foot", "toe", "heel")))
_UPSIDE_DOWN = np.array([0.0, 1.0, 0.0, 0.0])


@dataclass(frozen=True)
class Portrait:
    """One picture."""

    title: str  # Such as `Soles`.
    caption: str  # What to look at.
    jpeg: bytes  # The file.


def portraits(model: RobotModel) -> Iterator[Portrait]:
    """Yield the pictures of a robot, one after the other; raises `DrawingError`."""
    home, zero = (_on_the_floor(model, joints) for joints in (model.home_qpos[7:], np.zeros(model.n)))
    with_sites = _with_sites(model.forward(np.stack([home, zero])))
    yield Portrait("Home pose", "Each site's axes: x red, y green, z blue. Front and right side.", next(with_sites))
    yield Portrait("Zero pose", "All joints at zero, as the maker's file has it.", next(with_sites))
    posed = model.forward(home[None])
    yield Portrait("Beside a person", "A person whose limbs are turned as the robot's are.", _beside_person(posed))
    if model.spec.base == "legs":
        caption = "From below, the left foot at the right. The corners are to enclose the sole, the toes are up."
        yield Portrait("Soles", caption, _soles(posed))
    for side in SIDES:
        caption = "From the other hand. x along the fingers; the palm looks at you."
        yield Portrait(f"{side.capitalize()} hand", caption, _hand(posed, side))


def _on_the_floor(model: RobotModel, joints: Float[np.ndarray, "n"]) -> Float[np.ndarray, "nq"]:
    """Return a configuration with its lowest sole corner on the floor."""
    qpos = np.concatenate([model.home_qpos[:7], joints])
    posed = model.forward(qpos[None])
    qpos[2] -= min(float(posed.site_position(site)[0, 2]) for site in SITES if "_sole_" in site)
    return qpos


def _scene(posed: Kinematics, *layers: Layer) -> DrawnScene:
    return DrawnScene((Subject(posed.model.spec.title, 1.0, layers, posed.qpos[:, :3]),))


def _with_sites(posed: Kinematics) -> Iterator[bytes]:
    """Yield a robot in each pose: it can be seen through, its sites have axes, and those of one side names."""
    used = SITES if posed.model.spec.base == "legs" else _UPPER_SITES
    named = [site for site in used if not site.startswith("left") and "_sole_" not in site]
    robot = Layer("robot", _pale(posed), opacity=_SEE_THROUGH)
    marks = Layer("sites", site_marks(posed, used, _AXES * posed.model.spec.stature))
    scene, width = _scene(posed, robot, marks), round(_TALL * _HEIGHT)
    with offscreen_renderer(scene, width, _HEIGHT) as draw:
        for frame in range(len(posed.qpos)):
            places = np.stack([posed.site_position(site)[frame] for site in named])
            # Each pose fills its picture: arms that are spread in one do not make the other small.
            pose = posed.model.forward(posed.qpos[frame : frame + 1])
            alone = _scene(pose, Layer("robot", _pale(pose)))
            views = [cameras([alone], view, _TALL)[0](0) for view in FRONT_AND_SIDE]
            seen = [(draw(frame, camera), camera) for camera in views]
            names = [name.removeprefix("right_") for name in named]
            panels = [_labelled(picture, camera, places, names) for picture, camera in seen]
            yield jpeg(np.concatenate(panels, axis=1))


def _pale(posed: Kinematics, beyond: str | None = None) -> tuple[Part, ...]:
    """Return a robot, or its links beyond a site, in one pale colour."""
    parts = robot_parts(posed.model, posed, None, beyond)
    return tuple(
        replace(part, colours=np.tile(np.array(_PALE, dtype=np.uint8), (part.count, 1)))
        if isinstance(part, Shapes)
        else (part if isinstance(part, Lines) else replace(part, colour=_PALE))
        for part in parts
    )


def _beside_person(posed: Kinematics) -> bytes:
    """Return a robot and a person of its stature, from the front."""
    stature = posed.model.spec.stature
    person = person_in_pose(posed, np.array([0.0, -_ASIDE * stature, 0.0]))
    scene = _scene(posed, Layer("robot", robot_parts(posed.model, posed, None)), Layer("human", human_shapes(person)))
    width = round(_WIDE * _HEIGHT)
    with offscreen_renderer(scene, width, _HEIGHT) as draw:
        return jpeg(draw(0, cameras([scene], _FACING, _WIDE)[0](0)))


def _soles(posed: Kinematics) -> bytes:
    """Return the soles, seen from below: nothing is there below a floor, so the robot stands on its head."""
    qpos = posed.qpos[0].copy()
    qpos[3:7] = se3.quat_multiply(_UPSIDE_DOWN, qpos[3:7])
    qpos[2] = 2.0 * posed.model.spec.stature
    turned = posed.model.forward(qpos[None])
    sites = [site for site in SITES if "_sole_" in site or site.endswith(("_foot", "_toe"))]
    middle = np.mean([turned.site_position(site)[0] for site in sites], axis=0)
    return _close(turned, sites, [f"{side}_knee" for side in SIDES], _camera(middle, _NEAR_FEET, -89.99, turned))


def _hand(posed: Kinematics, side: str) -> bytes:
    """Return a hand's palm, seen from the other hand, a little from ahead."""
    sites = [f"{side}_wrist", f"{side}_palm"]
    camera = _camera(posed.site_position(sites[1])[0], _NEAR_HAND, -12.0, posed, 110.0 if side == "left" else 250.0)
    return _close(posed, sites, [f"{side}_elbow"], camera)


def _camera(
    point: Float[np.ndarray, "3"], reach: float, elevation: float, posed: Kinematics, azimuth: float = 0.0
) -> Camera:
    """Return a camera that sees the surroundings of a point, up to a reach as a share of the robot's stature."""
    distance = reach * posed.model.spec.stature / np.tan(np.radians(FIELD_OF_VIEW / 2))
    return Camera(point, distance, azimuth, elevation)


def _close(posed: Kinematics, sites: Sequence[str], links: Sequence[str], camera: Camera) -> bytes:
    """Return sites and the links beyond others, from near."""
    parts = [part for link in links for part in _pale(posed, link)]
    marks = site_marks(posed, sites, _FINE_AXES * posed.model.spec.stature)
    scene = _scene(posed, Layer("robot", tuple(parts), opacity=_NEARLY_SOLID), Layer("sites", marks))
    with offscreen_renderer(scene, _HEIGHT, _HEIGHT) as draw:
        return jpeg(draw(0, camera))


def _labelled(picture: Picture, camera: Camera, places: Float[np.ndarray, "N 3"], names: Sequence[str]) -> Picture:
    """Return a picture with names beside places of the scene [m]."""
    height, width = picture.shape[:2]
    right, up, back = camera_axes(np.radians(camera.azimuth) + np.pi, -np.radians(camera.elevation))
    seen = places - camera.point
    scale = 0.5 * height / np.tan(np.radians(FIELD_OF_VIEW / 2)) / (camera.distance - seen @ back)
    image = Image.fromarray(picture)
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(_LINE)
    labels = sorted(zip(0.5 * height - scale * (seen @ up), 0.5 * width + scale * (seen @ right), names, strict=True))
    lowest = -np.inf
    for label_y, x, name in labels:
        lowest = max(label_y, lowest + _LINE)  # No name lies over another one.
        pen.text((x - 9, lowest), name, _INK, font, anchor="rm", stroke_width=2, stroke_fill=_HALO)
    return np.asarray(image)


STILL, MOVING = ".png", ".webp"  # Endings of their files.
WIDTH, HEIGHT = 720, 405  # [px]
_MOVING_WIDTH, _MOVING_HEIGHT = 320, 180  # [px]
_FRAMES, _RATE, _QUALITY = 24, 8.0, 50  # Of the film: of motions of any length, a second, of 100.


def thumbnails(scene: DrawnScene, frame: int, fitted: FittedCamera) -> dict[str, bytes]:
    """Return a frame and the motion as a PNG and an animated WebP file, by their endings; raises as `picture_of`."""
    return {STILL: png(picture_of(scene, frame, fitted)), MOVING: webp(_film(scene, fitted), _RATE, _QUALITY)}


def picture_of(scene: DrawnScene, frame: int, fitted: FittedCamera) -> Picture:
    """Return a frame, small; raises `DrawingError`."""
    with offscreen_renderer(scene, WIDTH, HEIGHT) as draw:
        return draw(frame, fitted.camera(scene, frame, WIDTH / HEIGHT))


def _film(scene: DrawnScene, fitted: FittedCamera) -> list[Picture]:
    """Return frames of all of the motion, drawn twice as large and halved, which smooths them."""
    size = (_MOVING_WIDTH, _MOVING_HEIGHT)
    frames = np.linspace(0, scene.frames - 1, min(_FRAMES, scene.frames)).round().astype(int).tolist()
    with offscreen_renderer(scene, 2 * size[0], 2 * size[1], stage.QUICK) as draw:
        drawn = [draw(frame, fitted.camera(scene, frame, size[0] / size[1])) for frame in frames]
    return [np.asarray(Image.fromarray(picture).resize(size, Image.Resampling.BOX)) for picture in drawn]


def representative_frame(motion: Motion) -> int:
    """Return the middle of the longest contact; that of the motion where nothing is touched."""
    contacts = [run for flags in motion.contact_flags.T for run in runs(flags)]
    first, stop = max(contacts, key=lambda run: run[1] - run[0], default=(0, motion.frames))
    return (first + stop) // 2
