"""A robot's motion with the objects that it moves, stage by stage; body poses follow from `qpos`, never stored."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.clip.clip import HIGHEST_RATE, LOWEST_RATE, QualityWarning, Severity
from hoi_retarget.errors import ArgumentError, ClipError, RobotError
from hoi_retarget.motion.motion_report import Report, Status, Window
from hoi_retarget.numerics.arrays import check_shape, frozen
from hoi_retarget.robots.model import RobotModel

UNIT_TOLERANCE = 1e-3  # Of a quaternion's length: more is damage, not rounding.
_MAX_NUMBER = 1000.0  # Bound of coordinates [m] and angles [rad].
_SCALES = (1e-3, 1e3)
_MAX_HUMAN_HEIGHT_M = 10.0

BEYOND_RANGE = np.pi  # A joint this much beyond its range [rad] is damage.
ARRAYS: Mapping[str, tuple[int | str, ...]] = {
    "object_pos": ("frames", "objects", 3),
    "object_quat": ("frames", "objects", 4),
    "object_scale": ("objects",),
    "contact_flags": ("frames", "links"),
    "contact_object": ("frames", "links"),
    "contact_points": ("frames", "links", 3),
    "stance_flags": ("frames", 2),
}
"""Shapes of the arrays of a motion beside its stages, by name."""

SIMULATED = "physics"
"""Name of the stage in which a simulated robot performed the motion; it ends where the robot fell."""
STAGE_TITLES = {"ik": "inverse kinematics", "trajectory": "trajectory", SIMULATED: "performed in simulation"}
"""Names of stages in sentences."""


@dataclass(frozen=True, eq=False)
class ContactForces:
    """Sums of simulated contact forces on F bodies over T frames, in the world.

    Bodies are the robot's links, and objects, the latter with forces of the floor alone. Raises `ClipError` when
    shapes disagree, or a number is not finite.
    """

    bodies: tuple[str, ...]
    forces: Float[np.ndarray, "T F 3"]  # [N]; zero where nothing is touched.
    points: Float[np.ndarray, "T F 3"]  # Where they act [m]: the mean of the contacts' places, weighted by force.

    def __post_init__(self) -> None:
        for name in ("forces", "points"):
            values = frozen(getattr(self, name))
            object.__setattr__(self, name, values)
            check_shape("motion", f"contact {name}", values, (len(self.forces), len(self.bodies), 3))
            if not np.isfinite(values).all():
                raise ClipError(f"motion: contact {name} hold numbers that are not finite.")


@dataclass(frozen=True, eq=False)
class Stage:
    """A motion after one stage of a retarget, with the outcome of its windows."""

    name: str
    qpos: Float[np.ndarray, "T nq"]  # Root position [m], root rotation wxyz, joints [rad].
    windows: tuple[Window, ...] = ()  # None for a motion that was recorded or made elsewhere.
    objects: Float[np.ndarray, "T O 7"] | None = None
    """Poses of the objects, position [m] and rotation wxyz, where a later stage has them elsewhere."""

    forces: ContactForces | None = None  # Of contacts, where they were simulated.

    def __post_init__(self) -> None:
        object.__setattr__(self, "qpos", frozen(self.qpos))
        if self.objects is not None:
            object.__setattr__(self, "objects", frozen(self.objects))
        if self.qpos.ndim != 2:
            raise ClipError(f"motion: {self.name} qpos has shape {self.qpos.shape}, expected two dimensions.")


@dataclass(frozen=True, eq=False)
class Motion:
    """One robot's motion with the objects it moves; T frames, O objects, C contact links, n joints.

    The world has z up; lengths in [m], rotations wxyz, `fps` in [Hz]. `stages` are the motion after each stage of the
    retarget, the last one is the result. Vertices of objects are multiplied by `object_scale` about the object's
    origin. `contact_object` is the index of the touched object, -1 for none; `contact_points` are to be touched, in
    the frame of the scaled object, NaN where inactive; `stance_flags` tell left and right foot on the floor.
    `first_source_frame` is the number of leading frames of the source that were dropped. `report` has figures,
    settings, versions, source, and faults. Raises `ClipError` when shapes disagree, a number that must be finite is
    not, or a rotation is no unit quaternion.
    """

    robot: str
    fps: float
    joint_names: tuple[str, ...]
    stages: tuple[Stage, ...]
    object_names: tuple[str, ...]
    object_pos: Float[np.ndarray, "T O 3"]
    object_quat: Float[np.ndarray, "T O 4"]
    object_scale: Float[np.ndarray, "O"]
    contact_links: tuple[str, ...]
    contact_flags: Bool[np.ndarray, "T C"]
    contact_object: Int[np.ndarray, "T C"]
    contact_points: Float[np.ndarray, "T C 3"]
    stance_flags: Bool[np.ndarray, "T 2"]
    first_source_frame: int
    human_height: float
    report: Report = Report()

    def __post_init__(self) -> None:
        kinds = {"contact_flags": bool, "stance_flags": bool, "contact_object": int}
        for name in ARRAYS:
            object.__setattr__(self, name, frozen(getattr(self, name), kinds.get(name, float)))
        for name in ("joint_names", "object_names", "contact_links"):
            object.__setattr__(self, name, tuple(str(item) for item in getattr(self, name)))
        if not LOWEST_RATE <= self.fps <= HIGHEST_RATE:
            raise ClipError(
                f"motion: the rate is {self.fps:g} frames a second; it must be {LOWEST_RATE:g} to {HIGHEST_RATE:g}."
            )
        if not (0.0 <= self.human_height <= _MAX_HUMAN_HEIGHT_M and self.first_source_frame >= 0):
            raise ClipError(
                f"motion: a person of {self.human_height:g} m, {self.first_source_frame} frames dropped at the start."
            )
        self._check_shapes()
        self._check_values()
        self._check_frames()

    def _check_shapes(self) -> None:
        if not self.stages:
            raise ClipError("motion: there is no stage in it.")
        frames, n, objects = len(self.qpos), len(self.joint_names), len(self.object_names)
        sizes = {"frames": frames, "objects": objects, "links": len(self.contact_links)}
        for stage in self.stages:
            check_shape("motion", f"{stage.name} qpos", stage.qpos, (frames, 7 + n))
            if stage.forces is not None and len(stage.forces.forces) != frames:
                raise ClipError(f"motion: {stage.name} has forces of {len(stage.forces.forces)} frames of {frames}.")
            if stage.objects is not None:
                check_shape("motion", f"{stage.name} objects", stage.objects, (frames, objects, 7))
        for name, shape in ARRAYS.items():
            expected = tuple(sizes[size] if isinstance(size, str) else size for size in shape)
            check_shape("motion", name, getattr(self, name), expected)
        if frames == 0:
            raise ClipError("motion: there are no frames in it.")

    def _check_values(self) -> None:
        touching = self.contact_flags
        numbers = {f"{stage.name} qpos": stage.qpos for stage in self.stages}
        moved = {f"{stage.name} objects": stage.objects for stage in self.stages if stage.objects is not None}
        numbers |= moved
        numbers |= {name: getattr(self, name) for name in ("object_pos", "object_quat", "object_scale")}
        numbers |= {"contact_points, where there is contact,": self.contact_points[touching]}
        for name, values in numbers.items():
            if not np.isfinite(values).all():
                raise ClipError(f"motion: {name} holds numbers that are not finite.")
            if (np.abs(values) > _MAX_NUMBER).any():
                raise ClipError(
                    f"motion: {name} holds {values.flat[np.abs(values).argmax()]:.4g}; "
                    f"metres and radians end at {_MAX_NUMBER:g}."
                )
        if ((self.object_scale < _SCALES[0]) | (self.object_scale > _SCALES[1])).any():
            raise ClipError(
                f"motion: object_scale is {self.object_scale.tolist()}; it must be {_SCALES[0]:g} to {_SCALES[1]:g}."
            )
        rotations = {f"{stage.name} qpos": stage.qpos[:, 3:7] for stage in self.stages}
        rotations |= {"object_quat": self.object_quat} | {name: poses[..., 3:] for name, poses in moved.items()}
        for name, quats in rotations.items():
            lengths = np.linalg.norm(np.clip(quats, -2.0, 2.0), axis=-1)  # Damage may hold any number.
            if (np.abs(lengths - 1.0) > UNIT_TOLERANCE).any():
                raise ClipError(f"motion: {name} holds rotations that are not unit quaternions.")
        if ((self.contact_object < -1) | (self.contact_object >= len(self.object_names))).any():
            raise ClipError(f"motion: contact_object names an object beyond its {len(self.object_names)}.")
        if (self.contact_object[touching] < 0).any():
            raise ClipError("motion: contact_flags tells a contact where contact_object names no object.")

    def _check_frames(self) -> None:
        spans = [(window.start, window.stop - 1) for stage in self.stages for window in stage.windows]
        events = (*(self.report.unreached_contacts or ()), *(self.report.orientation_flips or ()))
        for first, last in (*spans, *((event.first_frame, event.last_frame) for event in events)):
            if not 0 <= first <= last < self.frames:
                raise ClipError(f"motion: its report tells of frames {first} to {last}; it has {self.frames}.")

    def __repr__(self) -> str:
        what = f"{self.report.clip or 'a motion'}, {self.frames} frames at {self.fps:g} a second"
        return f"<Motion of {self.robot}: {', '.join((what, *self.object_names))}>"

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.qpos)

    @property
    def qpos(self) -> Float[np.ndarray, "T nq"]:
        """The motion: root position [m], root rotation wxyz, joints [rad] in `joint_names` order."""
        return self.stages[-1].qpos

    @property
    def person(self) -> int:
        """Index of the clip's person that it follows."""
        return self.report.person

    @property
    def converged(self) -> bool:
        """Whether every window of every stage was solved to tolerance, in its last pass."""
        return not self._unsolved

    @property
    def warnings(self) -> tuple[QualityWarning, ...]:
        """Its faults and doubts: windows that did not converge, and the warnings of its report."""
        unsolved = [
            QualityWarning(
                "not_converged",
                Severity.WARNING,
                f"{STAGE_TITLES.get(stage.name, stage.name)}, frames {window.start} to {window.stop - 1}: "
                f"{window.status.message}.",
            )
            for stage, window in self._unsolved
        ]
        return (*unsolved, *self.report.warnings)

    def labelled(self, index: int) -> Bool[np.ndarray, "T C"]:
        """Return whether each contact link is to touch an object in each frame."""
        return self.contact_flags & (self.contact_object == index)

    def with_qpos(self, qpos: Float[np.ndarray, "T nq"]) -> "Motion":
        """Return the motion with another last stage."""
        return replace(self, stages=(*self.stages[:-1], replace(self.stages[-1], qpos=qpos)))

    def with_report(self, **fields: Any) -> "Motion":
        """Return the motion with other fields in its report."""
        return replace(self, report=replace(self.report, **fields))

    def at_stage(self, name: str) -> "Motion":
        """Return the motion after one of its stages, without the figures of later ones.

        Raises `ArgumentError`, which lists its stages, where it has no such stage.
        """
        names = [stage.name for stage in self.stages]
        if name not in names:
            raise ArgumentError(f"the motion has no stage {name!r}. Its stages: {', '.join(names)}.")
        *earlier, last = self.stages[: names.index(name) + 1]
        if last is self.stages[-1]:
            return self
        report = replace(self.report, figures={}, performance=None)
        if last.objects is None:
            return replace(self, stages=(*earlier, last), report=report)
        poses = {"object_pos": last.objects[..., :3], "object_quat": last.objects[..., 3:]}
        return replace(self, stages=(*earlier, replace(last, objects=None)), report=report, **poses)

    @property
    def _unsolved(self) -> list[tuple[Stage, Window]]:
        windows = ((stage, window) for stage in self.stages for window in stage.windows)
        return [(stage, window) for stage, window in windows if window.status is not Status.SOLVED]


def on_robot(motion: Motion, model: RobotModel) -> Motion:
    """Return the motion of another robot whose joints are among its own, by name, such as that without fingers.

    Contacts of links that the robot has not are left out, and figures of the whole. Raises `RobotError` where a joint
    is none of the motion's.
    """
    if strange := [name for name in model.joint_names if name not in motion.joint_names]:
        raise RobotError(
            f"{model.spec.title} has {len(strange)} joints that {motion.robot} has not ({', '.join(strange[:4])}"
            f"{', ...' if len(strange) > 4 else ''}). Retarget to it: run RESULT --from {motion.robot}."
        )
    columns = [*range(7), *(7 + motion.joint_names.index(name) for name in model.joint_names)]
    of_robot = {"robot_file": model.spec.description_file, "robot_sha256": model.spec.description_sha256}
    kept = [column for column, link in enumerate(motion.contact_links) if link in model.sites.index]
    return replace(
        motion,
        robot=model.spec.name,
        joint_names=model.joint_names,
        stages=tuple(replace(stage, qpos=stage.qpos[:, columns]) for stage in motion.stages),
        contact_links=tuple(motion.contact_links[column] for column in kept),
        report=replace(motion.report, figures={}, performance=None, **of_robot),
        **{name: getattr(motion, name)[:, kept] for name in ("contact_flags", "contact_object", "contact_points")},
    )


def check_robot(motion: Motion, model: RobotModel) -> None:
    """Raise `RobotError` unless the motion's joints are the model's, in its order, and its contact links are there."""
    if motion.joint_names != model.joint_names:
        strange = sorted(set(motion.joint_names) ^ set(model.joint_names)) or ["the same ones in another order"]
        raise RobotError(
            f"motion of {motion.robot!r}: its joints are not the model's (differing: {', '.join(strange[:10])}"
            f"{', ...' if len(strange) > 10 else ''}). Use the robot it was made for."
        )
    absent = [link for link in motion.contact_links if link not in model.sites.index]
    if absent:
        raise RobotError(f"motion of {motion.robot!r}: {', '.join(absent[:10])} are no contact links of the robot.")


def check_turns(motion: Motion, model: RobotModel) -> None:
    """Raise `RobotError` where a joint is turned so far beyond its range that only damage does it."""
    for stage in motion.stages:
        joints = stage.qpos[:, 7:]
        beyond = np.maximum(joints - model.upper, model.lower - joints)
        if (beyond > BEYOND_RANGE).any():
            frame, joint = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
            raise RobotError(
                f"{stage.name} qpos turns {model.joint_names[joint]} to {joints[frame, joint]:.4g} rad in frame "
                f"{frame}; its range is {model.lower[joint]:.2f} to {model.upper[joint]:.2f}."
            )
