"""Reads IMHD2, the data set of I'M HOI: one person and one object, a pickle for each part of a sequence.

`ground_truth/<date>/<segment>/<sequence>/gt_<part>_<start>_<end>.pkl` holds `smplPose`, of which the first 66 numbers
are the body's rotation vectors, `smplHandPose`, 90 for the hands from the flat one, `smplShape`, 16 betas of neutral
SMPL-H in each row, `smplTrans`, and the object's rotation vectors `objectRot` and positions `objectTrans`. Metres, 60
frames a second. The third word of the segment names the object, `bat` the template `baseball`; its mesh, less the mean
of its vertices as the file lists them, is `object_templates/<object>/<object>_simplified_transformed.obj`
(AfterJourney00/IMHD-Dataset README.md, visualization.py, body_model/body_model.py).

The world is that of the cameras' calibration, another one on each capture date. The makers advise to turn it into a
camera's, whose tilt nobody states; so calibrations level nothing here. Which axis is up is measured instead: the one
along which the person stands. Where none comes out clearly, the recording is refused.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError, GeometryError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.body_parameters import BodyParameters
from hoi_retarget.readers.fields import Fields, check_frames, folder_above
from hoi_retarget.readers.object_files import first_mesh, mesh_vertices
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks
from hoi_retarget.readers.worlds import TURN, Turn, World

FORMAT = "imhd"
LICENCE = "IMHD2: CC BY-NC-SA 4.0, on request"
FPS = 60.0
BETAS = 16
MAX_TILT = np.radians(30.0)  # Between an axis and the way from feet to head of somebody who stands along it.
MIN_SHARE_STANDING = 0.5  # Share of the frames in which somebody does, for that axis to be up.
TURNS: Mapping[str, tuple[str, ...]] = {"z": ("z",), "y": ("y",), "-y": ("-y",), "-z": ("y", "y")}
"""The axis that is up -> turns of `worlds` that make it z, one after the other: y up becomes z up, and z then -y."""

_KEYS = {"objectRot", "objectTrans", "smplPose", "smplHandPose", "smplShape", "smplTrans"}
_MARK = b"smplHandPose"
_BODY, _HAND = 66, 45
_SEGMENT = re.compile(r"\d{8}_[^_]+_(?P<object>[^_]+)(_.*)?")  # Capture date, who it is, the object.
_TEMPLATES = "object_templates"
_OTHER_NAMES: Mapping[str, str] = {"bat": "baseball"}  # Name of a recording's object -> name of its template.
_RATE_NOTE = "60 frames a second, as the data set has it; the file does not state it."


def holds(file: SourceFile) -> bool:
    """Return whether a pickle is a dictionary with the arrays of IMHD2."""
    return _MARK in file.content and isinstance(file.pickle, dict) and set(file.pickle) >= _KEYS


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a file."""
    fields = Fields(file.path, file.pickle)
    recorded, origin = _object_name(file, options)
    name = _OTHER_NAMES.get(recorded, recorded)
    positions = fields.array("smplTrans", ("T", 3), "the body's position")

    def read_tracks() -> Tracks:
        angles = fields.array("objectRot", ("T", 3), "the object's rotation")
        check_frames(file.path, {"object": len(angles), "person": len(positions)})
        places = fields.array("objectTrans", (len(angles), 3), "the object's position")
        track = ObjectTrack(name, places, se3.exp(angles), _geometry(file, options, name))
        return Tracks(people=(_body(fields, positions),), objects=(track,))

    return SourceRecording(
        name="_".join(file.path.resolve().with_suffix("").parts[-3 if _SEGMENT.fullmatch(_segment(file)) else -1 :]),
        description="IMHD2 recording of one person and one object",
        frames=len(positions),
        fps=FPS,
        skeleton=f"SMPL-H neutral, {BETAS} betas",
        up_axis="another one on each capture date; measured from the person when it is read",
        objects=(name,),
        licence=LICENCE,
        notes=(f"The object is {name}, as {origin}.", _RATE_NOTE),
        up=partial(_world, file.path),
        read_tracks=read_tracks,
        names_objects=False,
    )


def _world(path: Path, person: Person) -> World:
    """Return the world with the axis up along which a person, in the world as recorded, stands.

    Raises `ClipError` where it is none in most frames, or one that no recording of the data set is turned from.
    """
    feet = [JOINT_INDEX[f"{side}_ankle"] for side in ("left", "right")]
    upward = person.position("head") - person.joint_positions[:, feet].mean(axis=1)
    cosines = upward / np.maximum(np.linalg.norm(upward, axis=1, keepdims=True), 1e-9)
    shares = {
        f"{sign}{axis}": float((factor * cosines[:, index] > np.cos(MAX_TILT)).mean())
        for index, axis in enumerate("xyz")
        for sign, factor in (("", 1.0), ("-", -1.0))
    }
    up = max(shares, key=lambda axis: shares[axis])
    if shares[up] <= MIN_SHARE_STANDING or up not in TURNS:
        listing = ", ".join(f"{axis}: {share:.0%}" for axis, share in shares.items())
        raise ClipError(
            f"{path}: which axis is up cannot be told: the person should stand along {', '.join(TURNS)} in more than "
            f"{MIN_SHARE_STANDING:.0%} of the frames, but stands along {listing}. Turn the recording to z up."
        )
    note = (
        f"{up} is up: the person stands along it in {shares[up]:.0%} of the frames. Calibrations are not used; the "
        "floor may be tilted against it."
    )
    return World(up, tuple(Turn(TURN[axis]) for axis in TURNS[up]), note)


def _object_name(file: SourceFile, options: ReadOptions) -> tuple[str, str]:
    """Return the recording's name of its object and the origin of that name; raises `ClipError` without one."""
    if options.object_name is not None:
        return options.object_name, "was asked for"
    segment = _segment(file)
    named = _SEGMENT.fullmatch(segment)
    if named is None:
        raise ClipError(
            f"{file.name}: its object is not told: the folder two above the file is {segment!r}, expected a segment "
            "such as 20230910_af_skateboard. Put it back into the data set's tree, or pass --object NAME."
        )
    return named["object"], f"the segment {segment!r} says"


def _segment(file: SourceFile) -> str:
    """Return the name of the folder two above a file, wherever that is."""
    return "/".join(file.path.resolve().parts[-3:-2])


def _geometry(file: SourceFile, options: ReadOptions, name: str) -> ObjectGeometry:
    folder = options.objects or folder_above(file.path, _TEMPLATES)
    if folder is None:
        raise GeometryError(
            f"object {name!r}: there is no folder {_TEMPLATES} above {file.path}. Download it beside ground_truth, or "
            "pass --objects DIR."
        )
    path = folder / name / f"{name}_simplified_transformed.obj"
    geometry = first_mesh(name, [path], centred=False)
    # Of the vertices as listed: where a texture has seams, the geometry has more of them.
    return replace(geometry, points=geometry.points - mesh_vertices(path).mean(axis=0))


def _body(fields: Fields, positions: np.ndarray) -> BodyParameters:
    frames = len(positions)
    body = fields.array("smplPose", (frames, "D"), "the body's pose")
    if body.shape[1] < _BODY:
        raise ClipError(
            f"{fields.path}: smplPose, the body's pose, has {body.shape[1]} numbers a frame, expected at least "
            f"{_BODY}, three for each joint. Download the recording again."
        )
    hands = fields.array("smplHandPose", (frames, 2 * _HAND), "the pose of both hands")
    return BodyParameters.of_rows(
        np.concatenate([body[:, :_BODY], hands], axis=1),
        family="smplh",
        gender="neutral",
        betas=fields.array("smplShape", (frames, BETAS), "the body's shape"),
        translation=positions,
        flat_hands=True,
    )


READER = Reader(FORMAT, record, holds=holds)
