"""Reads Xsens MVN's `.mvnx`: one person of 23 segments, without fingers and objects.

An XML file: `subject` tells `frameRate` and the `segments` in order, and each `frame` of type `normal` has their
`orientation` in the world (four numbers a segment, wxyz) and `position` (three, in metres), z up. The frame of type
`identity` has all orientations at one: there the person stands in a T-pose and looks along x. A segment's position is
that of the joint above it; `points` in the segments add the top of the head. Fingers and props are not read.

Cites: the schema that MVN names in its files; andres-fr/blender-mvnx-io `test_mocap.mvnx`, exported by MVN 2018.
"""

import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError, ReadError
from hoi_retarget.files.bvh_file import END, bvh_of_rotations
from hoi_retarget.files.reading import parse_xml
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import describe_frames
from hoi_retarget.readers.bvh import recording_of
from hoi_retarget.readers.reader import Reader, SourceRecording

FORMAT = "mvnx"
LICENCE = "that of the data, which the file does not state"
MAX_OFF = 0.01  # Between positions and those that orientations give [m]; 1e-6 in a published file.

_SPINE = {bone: f"Chest{number}" for bone, number in (("L5", ""), ("L3", 2), ("T12", 3), ("T8", 4))}
_TRUNK = {"Pelvis": "Hips", **_SPINE, "Neck": "Neck", "Head": "Head"}
_ARM = {"Shoulder": "Collar", "UpperArm": "Shoulder", "ForeArm": "Elbow", "Hand": "Wrist"}
_LEG = {"UpperLeg": "Hip", "LowerLeg": "Knee", "Foot": "Ankle", "Toe": "Toe"}
_CHAINS = [("", _TRUNK, "")]
_CHAINS += [(side, limb, base) for limb, base in ((_ARM, "T8"), (_LEG, "Pelvis")) for side in ("Right", "Left")]
TREE = {
    f"{side}{part}": (f"{side}{above}" if above in chain else base, f"{side}{name}")
    for side, chain, base in _CHAINS
    for above, (part, name) in zip(("", *chain), chain.items(), strict=False)
}
"""Segment -> its parent, and the name of its joint in Xsens's BVH."""
_TOP = "pTopOfHead"


def holds(file: SourceFile) -> bool:
    """Return whether a file has the element that Xsens's files begin with."""
    return b"<mvnx" in file.beginning


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a file; raises `ReadError` or `ClipError`."""
    try:
        root = parse_xml(re.sub(rb"<!--.*?-->", b"", bytes(file.content), flags=re.DOTALL))
    except ValueError as error:
        raise ReadError(f"{file.path}: {error} Export the recording again.") from error
    subjects = root.findall("{*}subject")
    if len(subjects) != 1:
        raise ClipError(f"{file.path}: there are {len(subjects)} subjects in it, expected one. Export each on its own.")
    subject = subjects[0]
    found = [item.get("label", "") for item in subject.findall("{*}segments/{*}segment")]
    if missing := [name for name in TREE if name not in found]:
        raise ClipError(f"{file.path}: of the 23 segments it lacks {', '.join(missing)}. Export the whole body.")
    order = [found.index(name) for name in TREE]
    frames = subject.findall("{*}frames/{*}frame")
    rest = [item for item in frames if item.get("type") == "identity"]
    normal = [item for item in frames if item.get("type") == "normal"]
    if not rest or not normal:
        raise ClipError(f"{file.path}: it needs a frame of type identity and some of type normal. Export it again.")
    places, quats = (
        np.stack([_values(file.path, item, name, width, len(found))[order] for item in normal])
        for name, width in (("position", 3), ("orientation", 4))
    )
    if (bad := np.abs(np.linalg.norm(quats, axis=2) - 1.0).max(axis=1) > 1e-3).any():
        raise ClipError(f"{file.path}: orientation is no rotation in {describe_frames(np.flatnonzero(bad))}.")
    return _recording(file.path, subject, _values(file.path, rest[0], "position", 3, len(found))[order], places, quats)


def _recording(
    path: Path,
    subject: ElementTree.Element,
    rest: Float[np.ndarray, "23 3"],
    places: Float[np.ndarray, "T 23 3"],
    quats: Float[np.ndarray, "T 23 4"],
) -> SourceRecording:
    """Return the recording of segments in the order of `TREE`."""
    names = list(TREE)
    parents = [names.index(above) if above else -1 for above, _ in TREE.values()]
    above = quats[:, parents]
    above[:, 0] = se3.IDENTITY_QUAT
    local = se3.quat_multiply(se3.quat_conjugate(above), quats)
    offsets = rest - rest[parents]
    offsets[0] = 0.0
    top = subject.find(f".//{{*}}segment[@label='Head']/{{*}}points/{{*}}point[@label='{_TOP}']/{{*}}pos_b")
    bones = [name for _, name in TREE.values()]
    if top is not None:  # An end of the head, as BVH has it: the stature is measured up to there.
        offsets = np.vstack([offsets, _numbers(path, _TOP, top.text, 3)])
        local = np.concatenate([local, np.tile(se3.IDENTITY_QUAT, (len(local), 1, 1))], axis=1)
        bones, parents = [*bones, f"Head{END}"], [*parents, names.index("Head")]
    (rate,) = _numbers(path, "frameRate", subject.get("frameRate"), 1)
    if not rate > 0.0:
        raise ClipError(f"{path}: frameRate is {rate:g}. It must be positive.")
    motion = bvh_of_rotations(bones, parents, offsets, places[:, 0], local, rate=rate)
    if (off := np.linalg.norm(motion.poses()[0][:, : len(names)] - places, axis=2)).max() > MAX_OFF:
        raise ClipError(
            f"{path}: {names[off.max(axis=0).argmax()]} is {off.max():.3g} m from where its orientations put it. "
            "Export positions and orientations of the same processing."
        )
    part = subject.get("configuration", "FullBody")
    told = (
        f"Only a part of the body was measured ({part}): MVN puts the rest as it suits." if "Full" not in part else ""
    )
    return replace(
        recording_of(path, motion),
        description="Xsens MVN motion of one person",
        licence=LICENCE,
        up="z",
        up_axis="",
        notes=tuple(filter(None, [told])),
    )


def _values(path: Path, frame: ElementTree.Element, name: str, width: int, segments: int) -> np.ndarray:
    """Return one array of a frame, a row for each segment."""
    item = frame.find(f"{{*}}{name}")
    where = f"{name} of frame {frame.get('index', frame.get('type'))}"
    return _numbers(path, where, None if item is None else item.text, width * segments).reshape(segments, width)


def _numbers(path: Path, where: str, text: str | None, count: int) -> np.ndarray:
    try:
        values = np.array((text or "").split(), dtype=float)
    except ValueError:
        values = np.empty(0)
    if len(values) != count or not np.isfinite(values).all():
        raise ClipError(f"{path}: {where} is not {count} number{'s'[: count > 1]}. Export it from MVN again.")
    return values


READER = Reader(FORMAT, record, holds=holds)
