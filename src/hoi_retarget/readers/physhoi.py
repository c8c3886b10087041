"""Reads PhysHOI's `.pt` clips of one person with a basketball: a tensor of the 331 columns in `FIELDS`.

The layout is what `_load_motion` of wyhuai/PhysHOI physhoi/env/tasks/physhoi.py takes apart: z up, 25 frames a
second (its README.md). Bodies are InterMimic's 52 in the same order. Their rotations are not stored: rotation vectors
of the root and of 51 joints in their parents are, counted as SMPL-X counts them. The ball's rotation vector is
negated before use there; in the one clip at hand it is zero.

The one label says that hands touch the ball, not which: a hand counts where it is near the ball in a labelled frame.
The ball's size is not stored and its model was not to be had; a basketball of size 7 is a sphere of 0.12 m. In the
clip at hand the ball bounces with its middle 0.14 m above the floor, between two frames, which agrees with it.
"""

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human import skeleton, t_pose
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import HANDS, JOINTS
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers import intermimic_layouts as layouts
from hoi_retarget.readers.object_files import geometry_files, load_geometry
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks

FORMAT = "physhoi-331"
LICENCE = "not stated by the file; BallPlay, of PhysHOI's repository"
FPS = 25.0
FIELDS = layouts.column_table(
    {
        "root position": 3,
        "root angles": 3,
        "root angles again": 3,
        "joint angles": 153,
        "body positions": 156,
        "ball position": 3,
        "ball angles": 3,
        "padding": 6,
        "contact label": 1,
    }
)
BALL = "ball"
RADIUS = 0.12  # [m]; of a basketball of size 7.
TOUCH = 0.06  # [m]; a hand with a joint this near to the ball touches it where the label says that one does.

_POINTS = 600  # Their hull is at most 1 mm inside the sphere.
_LABELS = "0 or 1 (hands touch the ball)"


def holds(file: SourceFile) -> bool:
    """Return whether a torch file is one tensor of this layout's width."""
    return layouts.is_table(file.torch, FIELDS)


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a file."""
    rows = layouts.Rows(file.path, file.torch.astype(float), FIELDS)
    return SourceRecording(
        name=file.path.stem,
        description="PhysHOI clip of one person and a ball",
        frames=len(rows.values) - rows.first,
        fps=FPS,
        skeleton=f"{len(JOINTS)} joints of SMPL-X without jaw and eyes, positions and rotations to their parents",
        up="z",
        objects=(BALL,),
        contacts="one label for both hands",
        licence=LICENCE,
        notes=("25 frames a second, as PhysHOI's repository has them; the file does not state it.",),
        read_tracks=lambda: _tracks(rows, options),
        first_frame=rows.first,
    )


def _tracks(rows: layouts.Rows, options: ReadOptions) -> Tracks:
    """Return the arrays; raises `ClipError` or `GeometryError`."""
    rows.check((0, 1), _LABELS)
    person = _person(rows)
    geometry, note = _ball(options)
    # The rotation vector is negated where PhysHOI loads it.
    track = ObjectTrack(BALL, rows.used("ball position"), se3.exp(-rows.used("ball angles")), geometry)
    labelled = rows.used("contact label")[:, 0] == layouts.CONTACT_LABEL
    radius = float(np.linalg.norm(geometry.points, axis=1).max())
    touching = {(0, hand): labelled & (_distance(person, hand, track) < radius + TOUCH) for hand in HANDS}
    alone = int((labelled & ~np.any(list(touching.values()), axis=0)).sum())
    notes = (
        note,
        f"Which hand touches is not labelled: one within {100 * TOUCH:g} cm of the ball, while it is touched.",
    )
    if alone:
        notes += (f"{alone} frame(s) are labelled as touched with no hand that near; they count as not touched.",)
    return Tracks(people=(person,), objects=(track,), touching=touching, notes=notes)


def _person(rows: layouts.Rows) -> Person:
    positions = rows.vectors("body positions")
    pose = np.concatenate([rows.used("root angles"), rows.used("joint angles")], axis=1)
    quats = skeleton.world_quats(pose.reshape(len(pose), len(JOINTS), 3)[:, layouts.JOINT_ORDER], skeleton.PARENTS)
    rows.check_limbs(t_pose.agreement(positions, quats), "joint angles")
    rows.check_hands(positions)
    return Person("person", positions, quats)


def _distance(person: Person, hand: str, track: ObjectTrack) -> Float[np.ndarray, "T"]:
    """Return the distance from the ball's middle to the nearest joint of a hand [m]."""
    joints = person.joint_positions[:, layouts.HAND_JOINTS[hand]]
    return np.linalg.norm(joints - track.positions[:, None], axis=-1).min(axis=1)


def _ball(options: ReadOptions) -> tuple[ObjectGeometry, str]:
    """Return the ball in the objects' folder, or a sphere without one there, and a note of its origin."""
    if options.objects is not None and any(path.is_file() for path in geometry_files(options.objects, BALL)):
        return load_geometry(options.objects, BALL), f"The ball's shape is {BALL} in the folder of objects."
    note = (
        f"The ball's size is not stored: it is a sphere of {100 * RADIUS:g} cm, a basketball's. "
        f"--objects DIR with {BALL}/{BALL}.obj gives it another shape."
    )
    return _sphere(), note


def _sphere() -> ObjectGeometry:
    """Return a sphere of evenly spread points: a spiral from pole to pole that turns by the golden angle."""
    height = np.linspace(1.0, -1.0, _POINTS)
    around = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(_POINTS)
    beside = np.sqrt(1.0 - height**2)
    points = RADIUS * np.stack([beside * np.cos(around), beside * np.sin(around), height], axis=1)
    faces = scipy.spatial.ConvexHull(points).simplices
    inward = np.linalg.det(points[faces]) < 0
    return ObjectGeometry(points, faces=np.where(inward[:, None], faces[:, ::-1], faces))


READER = Reader(FORMAT, record, holds=holds, floor_at_zero=True)
