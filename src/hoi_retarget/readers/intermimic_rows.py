"""Rows of InterMimic's `.pt` clips and their relatives: what columns mean, and what they must hold.

A row is a frame, 30 a second: the root, angles and body positions up to column 318, then bodies' rotations, objects and
labels, in another order in each layout. z-up, in metres, with scalar-last quaternions. The layout is what
`simulation/interact2mimic.py` of the public InterAct repository writes and InterMimic reads; the order of bodies is
that of its `smpl_2_mujoco`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.clip import MINIMUM_FRAMES, Clip, ContactTrack, Source
from hoi_retarget.errors import ClipError
from hoi_retarget.human import rest_pose
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, LEFT_FINGERS, PARENT, PARTS, RIGHT_FINGERS
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import describe_frames
from hoi_retarget.objects.track import ObjectTrack
from hoi_retarget.readers.reader import Outline

FPS = 30.0
"""[Hz]; the file does not state it, all tools that write or read the layouts use it."""

PERSON: Mapping[str, slice] = {
    "root position": slice(0, 3),
    "root rotation": slice(3, 7),
    "padding": slice(7, 9),
    "joint angles": slice(9, 162),
    "body positions": slice(162, 318),
}
"""The columns that InterMimic's layouts begin with."""

BODIES: tuple[str, ...] = (
    "pelvis",
    *(f"left_{name}" for name in ("hip", "knee", "ankle", "foot")),
    *(f"right_{name}" for name in ("hip", "knee", "ankle", "foot")),
    *("spine1", "spine2", "spine3", "neck", "head"),
    *(f"left_{name}" for name in ("collar", "shoulder", "elbow", "wrist")),
    *LEFT_FINGERS,
    *(f"right_{name}" for name in ("collar", "shoulder", "elbow", "wrist")),
    *RIGHT_FINGERS,
)
"""The order of bodies in the file, in the names of `skeleton.JOINTS`."""
JOINT_ORDER = [BODIES.index(joint) for joint in JOINTS]
"""Where each of `skeleton.JOINTS` stands in the file."""

# Rotations of some files were multiplied on the right by the inverse of this one (its four
# components are equal, so wxyz and xyzw are the same); multiplying by it restores SMPL-X's.
UPRIGHT_QUAT: Float[np.ndarray, "4"] = np.array([0.5, 0.5, 0.5, 0.5])
UPRIGHT_QUAT.setflags(write=False)

LARGEST_VALUE = 1e4
"""[m] or [rad]; numbers beyond it are damage."""
LONGEST_PALM = 0.25
"""[m]; no first finger bone begins farther from its wrist."""
ROOT_TOLERANCE = 1e-3
"""[m]; from the root to the pelvis it is the same way in all frames, up to rounding."""
LARGEST_REST_PELVIS = 0.5
"""[m]; where the root is the origin of the body model, the pelvis at rest is no farther from it."""
ROOT_ANGLE_TOLERANCE = np.deg2rad(1.0)
CONTACT_LABEL = 1.0

KNUCKLES = np.array([JOINT_INDEX[joint] for joint in (*LEFT_FINGERS, *RIGHT_FINGERS) if joint.endswith("1")])
"""Joints that fingers begin with."""
WRISTS = np.array([JOINT_INDEX[str(PARENT[JOINTS[knuckle]])] for knuckle in KNUCKLES])


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of a file and the meaning of their columns, nothing checked."""

    path: Path
    values: Float[np.ndarray, "T columns"]
    fields: Mapping[str, slice]

    @cached_property
    def filled(self) -> Bool[np.ndarray, "T"]:
        """Which frames have data: poses that are not zero throughout. Labels alone are none."""
        poses = [field for name, field in self.fields.items() if not name.endswith(("label", "labels"))]
        return np.any([self.values[:, field].any(axis=1) for field in poses], axis=0)

    @cached_property
    def first(self) -> int:
        """Number of frames without data at the beginning, as some conversions begin with one."""
        return int(self.filled.argmax()) if self.filled.any() else len(self.values)

    @cached_property
    def root_to_pelvis(self) -> Float[np.ndarray, "T 3"]:
        """From the root position to that of the pelvis [m], from `first` on."""
        return self.used("body positions")[:, :3] - self.used("root position")

    def used(self, name: str) -> Float[np.ndarray, "T columns"]:
        """Return a field in the frames from `first` on."""
        return self.values[self.first :, self.fields[name]]

    def vectors(self, name: str) -> Float[np.ndarray, "T 52 3"]:
        """Return a field of the bodies in the order of `skeleton.JOINTS`, from `first` on."""
        return self.used(name).reshape(-1, len(BODIES), 3)[:, JOINT_ORDER]

    def rotations(self, name: str) -> Float[np.ndarray, "T 52 4"]:
        """Return a field of the bodies in the order of `skeleton.JOINTS`, wxyz, from `first` on."""
        return se3.quat_from_xyzw(self.used(name).reshape(-1, len(BODIES), 4)[:, JOINT_ORDER])

    def person(self) -> tuple[Float[np.ndarray, "T 52 3"], Float[np.ndarray, "T 52 4"], bool]:
        """Return joint positions, joint rotations, and whether the file had these turned by the fixed rotation.

        Raises `ClipError` where limbs fit neither reading, or fingers are far from their wrists.
        """
        positions, stored = self.vectors("body positions"), self.rotations("body rotations")
        readings = (stored, se3.quat_multiply(stored, UPRIGHT_QUAT))
        fits = [rest_pose.agreement(positions, quats) for quats in readings]
        turned = fits[1] > fits[0]
        self.check_limbs(max(fits), "body rotations")
        self.check_hands(positions)
        return positions, readings[turned], turned

    def check_limbs(self, agreement: float, rotations: str) -> None:
        """Raise `ClipError` where rotations, a field, leave limbs elsewhere than the T-pose has them."""
        if agreement < rest_pose.LEAST_AGREEMENT:
            positions = self.fields["body positions"]
            raise ClipError(
                f"{self._naming(rotations)} do not fit the body positions (columns {positions.start}:"
                f"{positions.stop}): in its parent's frame a knee or an elbow lies "
                f"{np.rad2deg(np.arccos(np.clip(agreement, -1, 1))):.0f} deg from where SMPL-X's T-pose has it. "
                "Convert the clip again."
            )

    def labels(self, name: str) -> Float[np.ndarray, "T 52"]:
        """Return a field of the bodies' labels in the order of `skeleton.JOINTS`, from `first` on."""
        return self.used(name)[:, JOINT_ORDER]

    def track(self, position: str, rotation: str) -> tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 4"]]:
        """Return an object's positions and rotations, wxyz, from `first` on."""
        return self.used(position), se3.quat_from_xyzw(self.used(rotation))

    def check(self, labels: tuple[int, int], meaning: str) -> None:
        """Raise `ClipError` unless all frames from `first` on can be used.

        Args:
            labels: The least and the greatest label.
            meaning: What labels are, for errors.
        """
        self._check_frames()
        self._check_numbers()
        for name in self.fields:
            if name.endswith(("rotation", "rotations")):
                self._check_unit(name)
        for name in self.fields:
            if name.endswith(("label", "labels")):
                self._check_labels(name, labels, meaning)
        self._check_root_position()
        if "body rotations" in self.fields:
            self._check_root_rotation()

    def _check_frames(self) -> None:
        frames = len(self.values)
        if frames - self.first < MINIMUM_FRAMES:
            zero = f", {self.first} of them zero throughout" if self.first else ""
            raise ClipError(
                f"{self.path}: {frames} frame(s){zero}; at least {MINIMUM_FRAMES} usable ones are needed. "
                "Use a longer recording."
            )
        zero = ~self.filled
        zero[: self.first] = False
        last = int(np.flatnonzero(~zero)[-1])
        if zero[last:].any() and not zero[:last].any():
            raise ClipError(
                f"{self.path}: {_frames(zero)} at the end hold zeros only: data are missing there. "
                f"Cut them off: tensor[:{last + 1}]."
            )
        if zero.any():
            raise ClipError(
                f"{self.path}: {_frames(zero)} in the middle hold zeros only: data are missing there. "
                "Cut the clip there."
            )

    def _check_numbers(self) -> None:
        for name, field in self.fields.items():
            values = self.values[:, field]
            bad = _any_in_frame(~(np.abs(values) <= LARGEST_VALUE))  # Not a number compares as False.
            if bad.any():
                how = f"exceeds {LARGEST_VALUE:g}" if np.isfinite(values).all() else "is not finite"
                raise ClipError(
                    f"{self._naming(name)} {how} in {_frames(bad)}, expected metres, radians and unit quaternions. "
                    "Cut those frames or convert the clip again."
                )

    def _check_unit(self, name: str) -> None:
        lengths = np.linalg.norm(self.used(name).reshape(len(self.values) - self.first, -1, 4), axis=-1)
        # Single precision leaves far less than a percent.
        bad = np.abs(lengths - 1.0) > 0.01
        if bad.any():
            worst = lengths[bad].min() if lengths[bad].min() < 0.99 else lengths[bad].max()
            of = f" of {', '.join(np.array(BODIES)[bad.any(axis=0)][:5])}" if name == "body rotations" else ""
            raise ClipError(
                f"{self._naming(name, of)} in {_frames(_any_in_frame(bad), self.first)} "
                f"{'is zero' if worst < 1e-6 else f'has length {worst:.4g}'}, expected unit quaternions. "
                "Cut those frames or convert the clip again."
            )

    def _check_labels(self, name: str, limits: tuple[int, int], meaning: str) -> None:
        labels = self.values[:, self.fields[name]]
        bad = (labels != np.round(labels)) | (labels < limits[0]) | (labels > limits[1])
        if bad.any():
            values = ", ".join(f"{value:g}" for value in np.unique(labels[bad])[:5])
            raise ClipError(
                f"{self._naming(name)} has the value(s) {values} in {_frames(_any_in_frame(bad))}, expected {meaning}. "
                "Convert the clip again."
            )

    def _check_root_position(self) -> None:
        """Raise `ClipError` unless the root is the pelvis, or the origin of a body with its pelvis elsewhere."""
        body = self.fields["body positions"].start
        rest = np.median(self.root_to_pelvis, axis=0)
        if np.linalg.norm(rest) > LARGEST_REST_PELVIS:
            rest = np.zeros(3)
        apart = np.linalg.norm(self.root_to_pelvis - rest, axis=1)
        if (apart > ROOT_TOLERANCE).any():
            raise ClipError(
                f"{self.path}: the root position (columns 0:3) and that of the pelvis (columns {body}:{body + 3}) are "
                f"up to {apart.max():.3g} m apart in {_frames(apart > ROOT_TOLERANCE, self.first)}, expected the same "
                "point, or the same way from one to the other in all frames: the file contradicts itself. Convert the "
                "clip again."
            )

    def _check_root_rotation(self) -> None:
        body = self.fields["body rotations"].start
        angle = se3.angle_between(
            se3.quat_from_xyzw(self.used("root rotation")), se3.quat_from_xyzw(self.used("body rotations")[:, :4])
        )
        if (angle > ROOT_ANGLE_TOLERANCE).any():
            raise ClipError(
                f"{self.path}: the root rotation (columns 3:7) and that of the pelvis (columns {body}:{body + 4}) "
                f"differ by up to {np.rad2deg(angle.max()):.3g} deg in "
                f"{_frames(angle > ROOT_ANGLE_TOLERANCE, self.first)}, expected the same: the file contradicts itself. "
                "Convert the clip again."
            )

    def check_hands(self, positions: Float[np.ndarray, "T 52 3"]) -> None:
        """Raise `ClipError` where fingers are farther from their wrists than any hand is long."""
        lengths = palm_lengths(positions)
        far = _any_in_frame(lengths > LONGEST_PALM)
        if far.any():
            raise ClipError(
                f"{self.path}: fingers begin up to {lengths.max():.3g} m from their wrists in "
                f"{_frames(far, self.first)}, expected at most {LONGEST_PALM:g} m: the body positions "
                "(columns 162:318) are in another order or another unit. Convert the clip again."
            )

    def _naming(self, name: str, of: str = "") -> str:
        field = self.fields[name]
        return f"{self.path}: {name}{of} (columns {field.start}:{field.stop})"


def palm_lengths(positions: Float[np.ndarray, "T 52 3"]) -> Float[np.ndarray, "T 10"]:
    """Return how far from their wrists fingers begin [m]."""
    return np.linalg.norm(positions[:, KNUCKLES] - positions[:, WRISTS], axis=-1)


def clip_of(
    rows: Rows,
    person: Person,
    tracks: tuple[ObjectTrack, ...],
    labels: Sequence[Float[np.ndarray, "T 52"]],
    source: Source,
) -> Clip:
    """Return the clip of checked rows, its contacts from the bodies' labels for each object."""
    if rows.first:
        note = f"{rows.first} leading frame(s) without data were dropped."
        source = replace(source, notes=(*source.notes, note))
    rest = rows.root_to_pelvis.mean(axis=0)
    if np.linalg.norm(rest) > ROOT_TOLERANCE:
        note = f"The pelvis is ({', '.join(f'{value:.3f}' for value in rest)}) m from the root in all frames, as the "
        source = replace(source, notes=(*source.notes, note + "body model has it at rest; bodies are where they are."))
    return Clip(
        name=rows.path.stem,
        fps=FPS,
        people=(person,),
        objects=tracks,
        contacts=tuple(
            ContactTrack(
                person=0,
                object=index,
                part=part,
                active=part_active(labels[index], part),
                contact_points=track.to_object(person.part_position(part)),
            )
            for index, track in enumerate(tracks)
            for part in PARTS
        ),
        source=source,
        first_source_frame=rows.first,
    )


def part_active(joint_labels: Float[np.ndarray, "T 52"], part: str) -> Bool[np.ndarray, "T"]:
    """Return the frames in which any joint that stands for the part is labelled a contact."""
    indices = [JOINT_INDEX[joint] for joint in PARTS[part].label_joints]
    return _any_in_frame(joint_labels[:, indices] == CONTACT_LABEL)


def outline_of(rows: Rows, objects: tuple[str, ...], licence: str, notes: tuple[str, ...] = ()) -> Outline:
    """Return what rows hold, checked or not."""
    columns = [rows.used(name).ravel() for name in rows.fields if name.endswith("body contact labels")]
    values = ", ".join(f"{value:g}" for value in np.unique(np.concatenate(columns))[:20])
    count = "one object" if len(objects) == 1 else f"{len(objects)} objects"
    return Outline(
        description=f"InterMimic clip of one person and {count}",
        frames=len(rows.values),
        fps=FPS,
        fps_stated=False,
        skeleton=f"{len(JOINTS)} joints of SMPL-X without jaw and eyes, positions and rotations",
        up_axis="z, by the format",
        people=1,
        objects=objects,
        contacts=f"labels of the bodies: {values}",
        licence=licence,
        notes=notes,
    )


def object_count(columns: int) -> int:
    """Return the number of objects in a row of the multi-object layout, 0 where it is another layout."""
    return (columns - 526) // 65 if columns > 526 and (columns - 526) % 65 == 0 else 0


def _any_in_frame(mask: Bool[np.ndarray, "T *rest"]) -> Bool[np.ndarray, "T"]:
    return np.asarray(mask.reshape(len(mask), -1).any(axis=1))


def _frames(bad: Bool[np.ndarray, "T"], first: int = 0) -> str:
    return describe_frames(np.flatnonzero(bad) + first)
