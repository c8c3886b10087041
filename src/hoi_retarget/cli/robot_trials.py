"""Trials of a robot on built-in clips, with what its motions must do, and the page that shows them."""

import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco

from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.evaluation.thresholds import judged_figures
from hoi_retarget.motion.motion import Motion
from hoi_retarget.readers.open import open_clip
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.pipeline import retarget
from hoi_retarget.robots.adding.findings import Finding
from hoi_retarget.robots.model import RobotModel, load_model
from hoi_retarget.robots.spec import RobotSpec

_GAP, _POSE, _POSE_OF_SHORT_ARMS = 0.002, 25.0, 30.0


@dataclass(frozen=True, eq=False)
class Tried:
    """A robot's motion of a clip, and what it must do."""

    name: str
    """Of the clip."""
    clip: Clip
    model: RobotModel
    """The robot without its shapes."""
    motion: Motion | None
    """None where there is none."""
    gates: list[tuple[str, bool]]
    """In words with figures, and whether it does."""


def tried(spec: RobotSpec, mjcf: str, clip: str) -> Tried:
    """Retarget a built-in clip by its landmarks for a robot with the text of its MJCF."""
    opened = open_clip(clip)
    with tempfile.TemporaryDirectory() as folder:
        model = without_shapes(spec, mjcf, Path(folder))
        try:
            motion = retarget(opened, model, Config(contact="landmark"))
        except HoiRetargetError as error:
            return Tried(clip, opened, model, None, [(str(error), False)])
    return Tried(clip, opened, model, motion, gates_of(motion, model))


def gates_of(motion: Motion, model: RobotModel) -> list[tuple[str, bool]]:
    """Return what a motion must do, in words with its figures, and whether it does."""
    figures = judged_figures(motion, model)
    gap, pose = figures["contact_gap_m"], figures["body_pose_deviation_deg"]
    unreached, margin = figures["unreached_share"] or 0.0, figures["joint_range_margin_rad"]
    widest = _POSE if model.spec.palm_weight == 1.0 else _POSE_OF_SHORT_ARMS
    return [
        ("converged", motion.converged) if motion.converged else ("not converged", False),
        (f"contacts {1000 * (gap or 0.0):.1f} mm off", gap is None or gap <= _GAP),
        (f"{100 * unreached:.0f} % of them unreached", unreached == 0.0),
        (f"pose {pose or 0.0:.0f} deg from the person's", pose is None or pose <= widest),
        ("ranges kept" if margin is None or margin >= 0 else "ranges not kept", margin is None or margin >= 0),
    ]


def without_shapes(spec: RobotSpec, mjcf: str, folder: Path) -> RobotModel:
    """Return a robot's model without geometry: skins take minutes, and landmarks need none."""
    description = mujoco.MjSpec.from_string(mjcf)
    for element in (*description.geoms, *description.meshes):
        description.delete(element)
    file = folder / "robot.xml"
    description.compile()
    file.write_text(description.to_xml(), encoding="utf-8")
    return load_model(replace(spec, mjcf=file))


def page(model: RobotModel, findings: Iterable[Finding], trials: Iterable[Tried]) -> bytes:
    """Return the page of a robot, with pictures.

    Raises:
        DrawingError: This machine has no way to draw without a screen.
    """
    # What draws is imported only where something is drawn.
    from hoi_retarget.report.robot_page import Trial, robot_page  # noqa: PLC0415

    shown = [Trial(trial.name, trial.gates, _picture(model, trial)) for trial in trials]
    return robot_page(model, tuple(findings), shown).encode("utf-8")


def _picture(model: RobotModel, trial: Tried) -> bytes | None:
    from hoi_retarget.viewers.offscreen.robot_picture import jpeg  # noqa: PLC0415
    from hoi_retarget.viewers.offscreen.thumbnail import picture_of, representative_frame  # noqa: PLC0415
    from hoi_retarget.viewers.scene.auto_camera import fit_camera  # noqa: PLC0415
    from hoi_retarget.viewers.scene.drawing import Scene  # noqa: PLC0415
    from hoi_retarget.viewers.scene.robot_shapes import robot_parts  # noqa: PLC0415
    from hoi_retarget.viewers.scene.scene import Shown, make_scene  # noqa: PLC0415

    if trial.motion is None:
        return None
    shown = Shown(trial.name, trial.motion, trial.model, trial.clip)
    subject = make_scene([shown]).subjects[0]
    parts = robot_parts(model, model.forward(trial.motion.qpos), None)
    layers = (replace(layer, parts=parts) if layer.name == "robot" else layer for layer in subject.layers)
    scene = Scene((replace(subject, layers=tuple(layers)),))
    return jpeg(picture_of(scene, representative_frame(trial.motion), fit_camera(scene, shown.ahead)))
