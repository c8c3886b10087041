"""Motions to export: smooth random ones with objects, contacts and a report, shared by the tests of exporters."""

import numpy as np

from hoi_retarget.clip.clip import Source
from hoi_retarget.motion.motion import Motion, Stage
from hoi_retarget.motion.motion_report import Report
from hoi_retarget.motion.result import Result
from hoi_retarget.numerics import se3
from hoi_retarget.robots.model import RobotModel

LINKS = ("left_palm", "right_palm", "left_foot", "right_foot")
SOURCE = Source("/home/somebody/recordings/sub1_box_000.pt", "ab" * 32, "intermimic-591", "CC BY 4.0 | made up")


def waves(rng: np.random.Generator, frames: int, fps: float, *shape: int, speed: float = 1.0) -> np.ndarray:
    """Return sums of three slow sines, which splines follow closely: a path per number of `shape`."""
    time = np.arange(frames).reshape(-1, *(1,) * len(shape)) / fps
    path = np.zeros((frames, *shape))
    for _ in range(3):
        rate = speed * rng.uniform(0.5, 4.0, shape)
        path += rng.normal(size=shape) / 3 * np.sin(rate * time + rng.uniform(0, 6, shape))
    return path


def turning(rng: np.random.Generator, frames: int, fps: float, *shape: int) -> np.ndarray:
    """Return rotations that wander about a random one."""
    start = se3.exp(rng.normal(size=(*shape, 3)))
    return se3.quat_multiply(se3.exp(waves(rng, frames, fps, *shape, 3)), start[None])


def smooth_motion(
    model: RobotModel, *, frames: int = 40, fps: float = 30.0, objects: int = 1, seed: int = 0, **changes: object
) -> Motion:
    """Return a motion inside the joint ranges, whose hands touch objects for some of the time."""
    rng = np.random.default_rng(seed)
    middle, spread = 0.5 * (model.lower + model.upper), 0.5 * (model.upper - model.lower)
    joints = middle + 0.9 * spread * np.tanh(waves(rng, frames, fps, model.n))
    place = waves(rng, frames, fps, 3) + np.array([0.0, 0.0, 0.8])
    qpos = np.concatenate([place, turning(rng, frames, fps), joints], axis=1)
    flags = np.zeros((frames, len(LINKS)), dtype=bool)
    if objects:
        flags[frames // 4 : 3 * frames // 4, :2] = True
    touched = np.where(flags, rng.integers(0, max(objects, 1), len(LINKS)), -1)
    points = np.where(flags[:, :, None], 0.2 * waves(rng, frames, fps, len(LINKS), 3), np.nan)
    values: dict[str, object] = {
        "robot": model.spec.name,
        "fps": fps,
        "joint_names": model.joint_names,
        "stages": (Stage("trajectory", qpos),),
        "object_names": tuple(f"thing_{index}" for index in range(objects)),
        "object_pos": waves(rng, frames, fps, objects, 3),
        "object_quat": turning(rng, frames, fps, objects),
        "object_scale": np.linspace(0.7, 1.3, objects),
        "contact_links": LINKS,
        "contact_flags": flags,
        "contact_object": touched,
        "contact_points": points,
        "stance_flags": rng.random((frames, 2)) < 0.5,
        "first_source_frame": 2,
        "human_height": 1.75,
        "report": Report(source=SOURCE),
    }
    return Motion(**{**values, **changes})  # pyright: ignore[reportArgumentType]


def as_result(model: RobotModel, *, stem: str = "take", sha256: str = "cd" * 32, **changes: object) -> Result:
    """Return a smooth motion as a result file would give it."""
    return Result(stem, sha256, smooth_motion(model, **changes), model)  # pyright: ignore[reportArgumentType]
