"""Clips of InterMimic and its relatives: one reader of tensors with a frame in each row, for several column tables.

30 frames a second: the root, angles and body positions up to column 318, then bodies' rotations, objects and labels, in
another order in each layout. z-up, in metres, with scalar-last quaternions. The layout is the one that
`simulation/interact2mimic.py` of the public InterAct repository writes and InterMimic reads; the order of bodies is
that of its `smpl_2_mujoco`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.clip import MINIMUM_FRAMES
from hoi_retarget.clip.grasp_check import READINGS
from hoi_retarget.errors import ClipError, GeometryError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human import skeleton, t_pose
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import HANDS, JOINT_INDEX, JOINTS, LEFT_FINGERS, PARENT, PARTS, RIGHT_FINGERS
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import describe_frames
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.fields import MAX_VALUE
from hoi_retarget.readers.object_files import SAMPLE_POINTS, load_geometry
from hoi_retarget.readers.parahome import with_fitted_joints
from hoi_retarget.readers.reader import Reader, Record, SourceRecording, Tracks

FPS = 30.0  # [Hz]; the file does not state it, all tools that write or read the layouts use it.

PERSON: Mapping[str, int] = {
    "root position": 3,
    "root rotation": 4,
    "padding": 2,
    "joint angles": 153,
    "body positions": 156,
}
"""The fields that InterMimic's layouts begin with -> their numbers of columns."""
BASE = "_base"  # Ending of ParaHome's name for the main part of an object; the mesh has the object's name.

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
JOINT_ORDER = [BODIES.index(joint) for joint in JOINTS]  # Where each of `skeleton.JOINTS` stands in the file.

# Rotations of some files were multiplied on the right by the inverse of this one (its four
# components are equal, so wxyz and xyzw are the same); multiplying by it restores SMPL-X's.
UPRIGHT_QUAT: Float[np.ndarray, "4"] = np.array([0.5, 0.5, 0.5, 0.5])
UPRIGHT_QUAT.setflags(write=False)

MAX_PALM_LENGTH = 0.25  # [m]; no first finger bone begins farther from its wrist.
ROOT_TOLERANCE = 1e-3  # [m]; from the root to the pelvis it is the same way in all frames, up to rounding.
MAX_REST_PELVIS_DISTANCE = 0.5
"""[m]; where the root is the origin of the body model, the pelvis at rest is no farther from it."""
ROOT_ANGLE_TOLERANCE = np.deg2rad(1.0)
CONTACT_LABEL = 1.0

FINGER_ANGLE = np.radians(0.5)  # Fingers that never turn farther from their first pose are not recorded.
KNUCKLES = np.array([JOINT_INDEX[joint] for joint in (*LEFT_FINGERS, *RIGHT_FINGERS) if joint.endswith("1")])
"""Joints that fingers begin with."""
HAND_JOINTS = {
    hand: [JOINT_INDEX[joint] for joint in (PARTS[hand].rotation_joint, *PARTS[hand].label_joints)] for hand in HANDS
}
"""Hand -> wrist and fingers."""
WRISTS = np.array([JOINT_INDEX[str(PARENT[JOINTS[knuckle]])] for knuckle in KNUCKLES])


def column_table(widths: Mapping[str, int]) -> Mapping[str, slice]:
    """Return the columns of fields that follow each other, from their numbers of columns."""
    stops = np.cumsum(list(widths.values())).tolist()
    return {name: slice(stop - width, stop) for (name, width), stop in zip(widths.items(), stops, strict=True)}


def is_table(value: object, fields: Mapping[str, slice]) -> bool:
    """Return whether a torch file's value is one tensor with the columns of a layout."""
    columns = max(field.stop for field in fields.values())
    return isinstance(value, np.ndarray) and value.ndim == 2 and value.shape[1] == columns


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

    @property
    def objects(self) -> tuple[str, ...]:
        """The beginnings of the objects' field names, such as `object 1`."""
        ends = " rotation"
        return tuple(name.removesuffix(ends) for name in self.fields if name.endswith(ends) and name != f"root{ends}")

    def used(self, name: str) -> Float[np.ndarray, "T columns"]:
        """Return a field in the frames from `first` on [unit of the field]."""
        return self.values[self.first :, self.fields[name]]

    def vectors(self, name: str) -> Float[np.ndarray, "T 52 3"]:
        """Return a field of the bodies in the order of `skeleton.JOINTS`, from `first` on [m]."""
        return self.used(name).reshape(-1, len(BODIES), 3)[:, JOINT_ORDER]

    def rotations(self, name: str) -> Float[np.ndarray, "T 52 4"]:
        """Return the bodies' quaternions, wxyz, in the order of `skeleton.JOINTS`, from `first` on."""
        return se3.quat_from_xyzw(self.used(name).reshape(-1, len(BODIES), 4)[:, JOINT_ORDER])

    def person(self) -> tuple[Person, bool]:
        """Return the person, and whether the file had joint rotations turned by the fixed rotation.

        Raises `ClipError` where limbs fit neither reading, or fingers are far from their wrists.
        """
        positions, stored = self.vectors("body positions"), self.rotations("body rotations")
        readings = (stored, se3.quat_multiply(stored, UPRIGHT_QUAT))
        fits = [t_pose.agreement(positions, quats) for quats in readings]
        turned = fits[1] > fits[0]
        self.check_limbs(max(fits), "body rotations")
        self.check_hands(positions)
        quats = readings[turned]
        return Person("person", positions, quats, fingers_recorded=fingers_move(quats)), turned

    def check_limbs(self, agreement: float, rotations: str) -> None:
        """Raise `ClipError` where rotations, a field, leave limbs elsewhere than the T-pose has them."""
        if agreement < t_pose.MIN_T_POSE_AGREEMENT:
            positions = self.fields["body positions"]
            raise ClipError(
                f"{self._naming(rotations)} do not fit the body positions (columns {positions.start}:"
                f"{positions.stop}): in its parent's frame a knee or an elbow lies "
                f"{np.rad2deg(np.arccos(np.clip(agreement, -1, 1))):.0f} deg from where SMPL-X's T-pose has it. "
                "Convert the clip again."
            )

    def labels(self, name: str) -> Float[np.ndarray, "T 52"]:
        """Return a field of the bodies' labels [unitless] in the order of `skeleton.JOINTS`, from `first` on."""
        return self.used(name)[:, JOINT_ORDER]

    def check(self, labels: tuple[int, int] = (-1, 1), meaning: str = "-1 (far), 0 (near) or 1 (contact)") -> None:
        """Raise `ClipError` unless all frames from `first` on can be used, with labels from the least to the greatest.

        `meaning` says in errors what labels are.
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
            bad = _any_in_frame(~(np.abs(values) <= MAX_VALUE))  # Not a number compares as False.
            if bad.any():
                how = f"exceeds {MAX_VALUE:g}" if np.isfinite(values).all() else "is not finite"
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
        if np.linalg.norm(rest) > MAX_REST_PELVIS_DISTANCE:
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
        far = _any_in_frame(lengths > MAX_PALM_LENGTH)
        if far.any():
            raise ClipError(
                f"{self.path}: fingers begin up to {lengths.max():.3g} m from their wrists in "
                f"{_frames(far, self.first)}, expected at most {MAX_PALM_LENGTH:g} m: the body positions "
                "(columns 162:318) are in another order or another unit. Convert the clip again."
            )

    def _naming(self, name: str, of: str = "") -> str:
        field = self.fields[name]
        return f"{self.path}: {name}{of} (columns {field.start}:{field.stop})"


def fingers_move(quats: Float[np.ndarray, "T 52 4"]) -> bool:
    """Return whether any finger joint ever turns in its parent: no capture of fingers has one pose throughout."""
    bones = [JOINT_INDEX[joint] for joint in (*LEFT_FINGERS, *RIGHT_FINGERS)]
    bent = se3.quat_multiply(
        se3.quat_conjugate(quats[:, [JOINT_INDEX[str(PARENT[JOINTS[b]])] for b in bones]]), quats[:, bones]
    )
    return bool((se3.angle_between(bent, bent[:1]) > FINGER_ANGLE).any())


def palm_lengths(positions: Float[np.ndarray, "T 52 3"]) -> Float[np.ndarray, "T 10"]:
    """Return the distances from the first finger bones to their wrists [m]."""
    return np.linalg.norm(positions[:, KNUCKLES] - positions[:, WRISTS], axis=-1)


def reader_of(name: str, record: Record, holds: Callable[[SourceFile], bool]) -> Reader:
    """Return the reader of a layout with a label for each body."""
    return Reader(
        name,
        record,
        holds=holds,
        floor_at_zero=True,
        rotation_readings=tuple(READINGS),
        has_companions=lambda _file: False,
    )


def recording_of(  # noqa: PLR0913  # layouts differ in all of them
    rows: Rows,
    names: tuple[str, ...],
    *,
    licence: str,
    read_tracks: Callable[[], Tracks],
    notes: tuple[str, ...] = (),
    names_objects: bool = False,
) -> SourceRecording:
    """Return the recording in rows that are not checked yet.

    Args: `rows`: of the file; `names`: of the objects; empty where neither the file nor the user tells them; `licence`:
    the terms of the data; `read_tracks`: checks the rows and returns `tracks_of` them; `notes`: known without the
    arrays; `names_objects`: whether the layout has the objects' names.
    """
    count = len(rows.objects)
    columns = [rows.used(name).ravel() for name in rows.fields if name.endswith("body contact labels")]
    values = ", ".join(f"{value:g}" for value in np.unique(np.concatenate(columns))[:20])
    return SourceRecording(
        name=rows.path.stem,
        description=f"InterMimic clip of one person and {'one object' if count == 1 else f'{count} objects'}",
        frames=len(rows.values),
        fps=FPS,
        skeleton=f"{len(JOINTS)} joints of SMPL-X without jaw and eyes, positions and rotations",
        up="z",
        up_axis="z, by the format",
        objects=names or ("",) * count,
        contacts=f"labels of the bodies: {values}",
        licence=licence,
        notes=notes,
        read_tracks=read_tracks,
        names_objects=names_objects,
        first_frame=rows.first,
        checks_upright=False,
    )


def tracks_of(
    rows: Rows,
    person: Person,
    labels: Mapping[str, Float[np.ndarray, "T 52"]],
    folder: Path | None,
    notes: tuple[str, ...],
) -> Tracks:
    """Return the person and the objects, whose contacts are from the bodies' labels; raises `GeometryError`.

    Args: `rows`: checked ones; `person`: the one in them; `labels`: of the bodies, by the objects' names; `folder`: of
    the objects' geometry; `notes`: what was found before.
    """
    if folder is None:
        files = ", ".join(f"{mesh}/{mesh}.obj or {mesh}/{SAMPLE_POINTS}" for mesh in map(_mesh_name, labels))
        raise GeometryError(
            f"{rows.path}: the clip needs the geometry of its {'object' if len(labels) == 1 else 'objects'} "
            f"{', '.join(map(repr, labels))}. Pass --objects DIR with {files} in it."
        )
    objects = tuple(
        ObjectTrack(
            name,
            rows.used(f"{field} position"),
            se3.quat_from_xyzw(rows.used(f"{field} rotation")),
            _geometry(folder, name),
        )
        for name, field in zip(labels, rows.objects, strict=True)
    )
    touching = {
        (index, part): part_active(values, part) for index, values in enumerate(labels.values()) for part in PARTS
    }
    return Tracks(
        people=(person,), objects=with_fitted_joints(objects), touching=touching, notes=(*notes, *_row_notes(rows))
    )


def _geometry(objects: Path, name: str) -> ObjectGeometry:
    """Return the geometry of an object's own name, or of the object that it is the main part of."""
    try:
        return load_geometry(objects, name)
    except GeometryError:
        if _mesh_name(name) == name:
            raise
        return load_geometry(objects, _mesh_name(name))


def _mesh_name(name: str) -> str:
    return name.removesuffix(BASE) or name


def _row_notes(rows: Rows) -> tuple[str, ...]:
    notes: tuple[str, ...] = ()
    if rows.first:
        notes += (f"{rows.first} leading frame(s) without data were dropped.",)
    rest = rows.root_to_pelvis.mean(axis=0)
    if np.linalg.norm(rest) > ROOT_TOLERANCE:
        notes += (
            f"The pelvis is ({', '.join(f'{value:.3f}' for value in rest)}) m from the root in all frames, as the body "
            "model has it at rest; bodies are where they are.",
        )
    return notes


def part_active(joint_labels: Float[np.ndarray, "T 52"], part: str) -> Bool[np.ndarray, "T"]:
    """Return the frames in which any joint that stands for the part is labelled a contact."""
    indices = [JOINT_INDEX[joint] for joint in skeleton.ALL_PARTS[part].label_joints]
    return _any_in_frame(joint_labels[:, indices] == CONTACT_LABEL)


def object_count(columns: int) -> int:
    """Return the number of objects in a row of the multi-object layout, 0 where it is another layout."""
    return (columns - 526) // 65 if columns > 526 and (columns - 526) % 65 == 0 else 0


def _any_in_frame(mask: Bool[np.ndarray, "T *rest"]) -> Bool[np.ndarray, "T"]:
    return np.asarray(mask.reshape(len(mask), -1).any(axis=1))


def _frames(bad: Bool[np.ndarray, "T"], first: int = 0) -> str:
    return describe_frames(np.flatnonzero(bad) + first)
