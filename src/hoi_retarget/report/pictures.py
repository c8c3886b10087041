"""Pictures of the motions that a report warns of, taken where they are at their worst."""

from pathlib import Path

from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.readers.open import clip_of
from hoi_retarget.report.load_any_motion import open_motion
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.viewers.offscreen.thumbnail import representative_frame, thumbnail
from hoi_retarget.viewers.scene.auto_camera import fit_camera
from hoi_retarget.viewers.scene.scene import Shown, make_scene


def picture_of(path: Path, foreign_robot: RobotModel, *, objects: Path | None = None) -> bytes | None:
    """Return a motion, beside its human where the recording is at hand, as a PNG file.

    None where there is nothing to draw: a robot that is not known, or a file that is gone.

    Args:
        path: The motion's file.
        foreign_robot: The robot of files that do not say which.
        objects: The objects' folder, where it is not the one that the result says.

    Raises:
        DrawingError: This machine has no way to draw without a screen.
    """
    try:
        motion = open_motion(path, foreign_robot).motion
        model = load_robot(motion.robot)
        clip = _clip(motion, objects)
        shown = Shown(path.stem, motion, model, clip, motion.person)
        scene = make_scene([shown])
    except HoiRetargetError:
        return None
    return thumbnail(scene, worst_frame(motion), fit_camera(scene, shown.ahead))


def worst_frame(motion: Motion) -> int:
    """Return the middle of the longest unreached contact or orientation flip, else that of the longest contact."""
    report = motion.report
    found = [*(report.orientation_flips or ()), *(report.unreached_contacts or ())]
    stretches = [(item.first_frame, item.last_frame) for item in found]
    if not stretches:
        return representative_frame(motion)
    return sum(max(stretches, key=lambda segment: segment[1] - segment[0])) // 2


def _clip(motion: Motion, objects: Path | None) -> Clip | None:
    try:
        return clip_of(motion, objects=objects)
    except HoiRetargetError:
        return None
