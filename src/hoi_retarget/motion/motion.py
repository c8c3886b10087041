"""The robot side of a clip: what a retarget produced; body poses follow from `qpos` and are never stored."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.clip.quality_warning import QualityWarning, Severity
from hoi_retarget.errors import ArgumentError, ClipError
from hoi_retarget.motion.contact_forces import ContactForces
from hoi_retarget.motion.report import Report, Status, Window
from hoi_retarget.numerics.arrays import check_shape, frozen

UNIT_TOLERANCE = 1e-3  # Of a quaternion's length: more is damage, not rounding.
LOWEST_RATE, HIGHEST_RATE = 1.0, 1000.0
"""[frames/s]; what is beyond is a slip of the keyboard, or damage."""
FARTHEST = 1000.0
"""[m]; nothing in a motion is so far from anything else, nor from the origin."""
_SCALES = (1e-3, 1e3)
_TALLEST = 10.0  # [m]

SIMULATED = "physics"
"""Name of the stage in which a simulated robot performed the motion; it ends where the robot fell."""
STAGE_TITLES = {"ik": "inverse kinematics", "trajectory": "trajectory", SIMULATED: "performed in simulation"}
"""What stages are called in sentences."""


@dataclass(frozen=True, eq=False)
class Stage:
    """A motion after one stage of a retarget, and how its windows were solved."""

    name: str
    qpos: Float[np.ndarray, "T nq"]
    """Root position [m], root rotation wxyz, joints [rad]."""
    windows: tuple[Window, ...] = ()
    """None for a motion that was recorded or made elsewhere."""
    objects: Float[np.ndarray, "T O 7"] | None = None
    """Poses of the objects, position [m] and rotation wxyz, where a later stage has them elsewhere."""

    forces: ContactForces | None = None
    """Of contacts, where they were simulated."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "qpos", frozen(self.qpos))
        if self.objects is not None:
            object.__setattr__(self, "objects", frozen(self.objects))
        if self.qpos.ndim != 2:
            raise ClipError(f"motion: {self.name} qpos has shape {self.qpos.shape}, expected two dimensions.")


@dataclass(frozen=True, eq=False)
class Motion:
    """One robot's motion with the objects it moves; T frames, O objects, C contact links, n joints.

    Raises `ClipError` when shapes disagree, a number that must be finite is not, or a rotation is
    no unit quaternion.
    """

    robot: str
    fps: float
    joint_names: tuple[str, ...]
    stages: tuple[Stage, ...]
    """What the motion was after each stage of the retarget; the last one is the motion."""
    object_names: tuple[str, ...]
    object_pos: Float[np.ndarray, "T O 3"]
    object_quat: Float[np.ndarray, "T O 4"]
    object_scale: Float[np.ndarray, "O"]
    """Geometry scale: vertices times this about the object's origin."""
    contact_links: tuple[str, ...]
    contact_flags: Bool[np.ndarray, "T C"]
    contact_object: Int[np.ndarray, "T C"]
    """Index of the touched object, -1 for none."""
    contact_points: Float[np.ndarray, "T C 3"]
    """Point to touch, in the frame of the scaled object [m]; NaN where inactive."""
    stance_flags: Bool[np.ndarray, "T 2"]
    """Left and right foot on the floor."""
    first_source_frame: int
    """How many leading frames of the source were dropped."""
    human_height: float
    """[m]"""
    report: Report = Report()
    """Figures, settings, versions, source, and what is wrong."""

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
        if not (0.0 <= self.human_height <= _TALLEST and self.first_source_frame >= 0):
            raise ClipError(
                f"motion: a person of {self.human_height:g} m, {self.first_source_frame} frames dropped at the start."
            )
        self._check_shapes()
        self._check_values()
        self._check_segments()

    def _check_shapes(self) -> None:
        if not self.stages:
            raise ClipError("motion: there is no stage in it.")
        frames, n = len(self.qpos), len(self.joint_names)
        objects, links = len(self.object_names), len(self.contact_links)
        expected = {
            "object_pos": (frames, objects, 3),
            "object_quat": (frames, objects, 4),
            "object_scale": (objects,),
            "contact_flags": (frames, links),
            "contact_object": (frames, links),
            "contact_points": (frames, links, 3),
            "stance_flags": (frames, 2),
        }
        for stage in self.stages:
            check_shape("motion", f"{stage.name} qpos", stage.qpos, (frames, 7 + n))
            if stage.forces is not None and len(stage.forces.forces) != frames:
                raise ClipError(f"motion: {stage.name} has forces of {len(stage.forces.forces)} frames of {frames}.")
            if stage.objects is not None:
                check_shape("motion", f"{stage.name} objects", stage.objects, (frames, objects, 7))
        for name, shape in expected.items():
            check_shape("motion", name, getattr(self, name), shape)
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
            if (np.abs(values) > FARTHEST).any():
                raise ClipError(
                    f"motion: {name} holds {values.flat[np.abs(values).argmax()]:.4g}; "
                    f"metres and radians end at {FARTHEST:g}."
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

    def _check_segments(self) -> None:
        report = self.report
        spans = [(window.start, window.stop - 1) for stage in self.stages for window in stage.windows]
        told = (*(report.unreached_contacts or ()), *(report.orientation_flips or ()))
        spans += [(segment.first_frame, segment.last_frame) for segment in told]
        for first, last in spans:
            if not 0 <= first <= last < self.frames:
                raise ClipError(f"motion: its report tells of frames {first} to {last}; it has {self.frames}.")

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
        """Whether every window of every stage was solved to tolerance."""
        return not any(True for _ in self._unsolved())

    @property
    def warnings(self) -> tuple[QualityWarning, ...]:
        """What is not right with it: windows that did not converge, and the warnings of its report."""
        unsolved = [
            QualityWarning(
                "not_converged",
                self._severity(stage, window),
                f"{STAGE_TITLES.get(stage.name, stage.name)}, frames {window.start} to {window.stop - 1}: "
                f"{window.status.message}.",
            )
            for stage, window in self._unsolved()
        ]
        return (*unsolved, *self.report.warnings)

    def _severity(self, stage: Stage, window: Window) -> Severity:
        """Return how bad an unsolved window is: with surfaces, trapped links keep sound motions from their end."""
        trapped = stage.name == "trajectory" and window.status is Status.MAX_ITERATIONS
        return Severity.WARNING if trapped and self.report.touches_with_surfaces else Severity.ERROR

    @property
    def faults(self) -> tuple[QualityWarning, ...]:
        """Why it is not to be used: the warnings that are errors; none for a good one."""
        return tuple(warning for warning in self.warnings if warning.severity is Severity.ERROR)

    def with_qpos(self, qpos: Float[np.ndarray, "T nq"]) -> "Motion":
        """Return the motion with another last stage."""
        return replace(self, stages=(*self.stages[:-1], replace(self.stages[-1], qpos=qpos)))

    def at_stage(self, name: str) -> "Motion":
        """Return the motion as it was after one of its stages, without the figures of later ones.

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

    def _unsolved(self) -> Iterator[tuple[Stage, Window]]:
        for stage in self.stages:
            yield from ((stage, window) for window in stage.windows if window.status is not Status.SOLVED)


ARRAYS = (
    "object_pos",
    "object_quat",
    "object_scale",
    "contact_flags",
    "contact_object",
    "contact_points",
    "stance_flags",
)
