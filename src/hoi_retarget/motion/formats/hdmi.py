"""HDMI's motions: `motion.npz` with bodies and joints, `meta.json` beside it with their names and the rate."""

import json
from pathlib import Path
from typing import Any

from hoi_retarget.errors import ReadError
from hoi_retarget.files.reading import read_bytes
from hoi_retarget.motion.formats.arrays_by_name import (
    Arrays,
    contents,
    names,
    numbers,
    optional_numbers,
    rate,
    read_npz,
)
from hoi_retarget.motion.formats.motion_file import Bodies, ContactFlags, Convention, MotionFile

FORMAT = "hdmi"
KEYS = frozenset({"joint_pos", "body_pos_w", "body_quat_w"})
_MOTION, _META = "motion.npz", "meta.json"


def read_folder(path: Path) -> MotionFile:
    """Return what a folder with `motion.npz` and `meta.json` holds; raises `ReadError`."""
    return parse(path / _MOTION, read_npz(path / _MOTION))


def parse(path: Path, arrays: Arrays) -> MotionFile:
    """Return what the arrays hold, with the names and the rate of the meta file beside; raises `ReadError`."""
    meta = _meta(path)
    flags = optional_numbers(path, arrays, "object_contact")
    if flags is not None and flags.ndim == 1:
        flags = flags[:, None]
    contacts = None
    if flags is not None and flags.ndim == 2:
        contacts = ContactFlags(tuple(f"object_contact{index}" for index in range(flags.shape[1])), flags > 0.5)
    return MotionFile(
        path=str(path),
        format=FORMAT,
        convention=Convention(order="names"),
        contents=contents(arrays),
        fps=rate(path, meta),
        joint_pos=numbers(path, arrays, "joint_pos"),
        joint_vel=optional_numbers(path, arrays, "joint_vel"),
        bodies=Bodies(
            numbers(path, arrays, "body_pos_w"),
            numbers(path, arrays, "body_quat_w"),
            optional_numbers(path, arrays, "body_lin_vel_w"),
            optional_numbers(path, arrays, "body_ang_vel_w"),
        ),
        joint_names=names(path, meta, "joint_names"),
        body_names=names(path, meta, "body_names"),
        contacts=contacts,
    )


def _meta(path: Path) -> dict[str, Any]:
    # motion.npz has meta.json beside it, walk_motion.npz has walk_meta.json.
    place = path.with_name(path.name.replace("motion", "meta")).with_suffix(".json")
    if not place.is_file():
        raise ReadError(
            f"{path}: it has bodies and joints but neither names nor a rate, and there is no {place.name} beside it. "
            "An HDMI motion needs its meta.json; other tracking files have 'fps' in them."
        )
    try:
        meta = json.loads(read_bytes(place).decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise ReadError(f"{place}: not readable JSON ({error}). Make the file again.") from error
    if not isinstance(meta, dict):
        raise ReadError(f"{place}: expected an object with body_names, joint_names and fps.")
    return meta
