"""Results exported: the files of a format, and a small file beside them that describes their content."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path, PureWindowsPath
from typing import Any

from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import ArgumentError, did_you_mean
from hoi_retarget.files import npz
from hoi_retarget.files.atomic import write_together
from hoi_retarget.motion.contact_arrays import contact_arrays
from hoi_retarget.motion.formats import WRITABLE
from hoi_retarget.motion.formats.containers import to_json
from hoi_retarget.motion.formats.dataset import NAME as DATASET
from hoi_retarget.motion.formats.dataset import write_dataset
from hoi_retarget.motion.formats.format import Format, Written
from hoi_retarget.motion.formats.isaac_lab import DATA as ISAAC_LAB
from hoi_retarget.motion.formats.isaac_lab import write_demonstrations
from hoi_retarget.motion.formats.lerobot import NAME as LEROBOT
from hoi_retarget.motion.formats.lerobot import write_lerobot
from hoi_retarget.motion.formats.ros_messages import NAME as MCAP
from hoi_retarget.motion.formats.ros_messages import write_messages
from hoi_retarget.motion.formats.sonic import LIBRARY, write_library
from hoi_retarget.motion.links import held_joints
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.resample import ResampledMotion, resample
from hoi_retarget.motion.result import Result
from hoi_retarget.motion.result_file import encode
from hoi_retarget.robots import load_robot

FOLDERS: Mapping[str, Callable[[Sequence[Result], float | None], dict[str, bytes]]] = {
    DATASET: write_dataset,
    LEROBOT: write_lerobot,
    ISAAC_LAB: write_demonstrations,
    MCAP: write_messages,
    LIBRARY: write_library,
}
"""By name, the formats of many results in one folder."""
NAMES: tuple[str, ...] = (*WRITABLE, *FOLDERS)  # Names of all formats that can be written.
_UNITS = {"length": "m", "angle": "rad", "time": "s"}


@dataclass(frozen=True)
class Exported:
    """One result in a format."""

    files: Mapping[str, bytes]  # By file name; a folder's files with its name before them.
    fps: float
    frames: int
    notes: tuple[str, ...]  # Notes for the user, a sentence each.


def format_named(name: str) -> Format:
    """Return a format of one motion per file; raises `ArgumentError`, which lists the names."""
    if name not in WRITABLE:
        near = did_you_mean(name, NAMES)
        raise ArgumentError(f"--to {name}: there is no such format.{near} Formats: {', '.join(NAMES)}.")
    return WRITABLE[name]


def export(
    result: Result, format: Format, *, name: str, fps: float | None = None, object_name: str | None = None
) -> Exported:
    """Return a result's files in a format, with those beside them.

    Args: `result`: the result; `format`: its format; `name`: of the files, without suffix; `fps`: frames a second; by
    default those that the format's readers expect; `object_name`: the object for the format's one place for it, where
    there are several. Raises `ArgumentError`: the format knows the object not, or the rate is out of range;
    `ClipError`: the motion has a single frame; `GeometryError`: an object's mesh cannot be read.
    """
    motion, model = result.motion, result.model
    chosen = _object(motion, format, object_name)
    resampled = resample(motion, model, format.fps if fps is None else fps, chosen)
    contacts = contact_arrays(resampled, result.surfaces)
    assert format.write is not None
    assert format.container.encode is not None
    written = format.write(resampled)
    contents = format.container.encode({**written.values, **(contacts if format.contacts_inside else {})})
    files = {f"{name}{suffix}": content for suffix, content in contents.items()}
    if not format.contacts_inside:
        files[f"{name}.contacts.npz"] = npz.encode(contacts)
    files[f"{name}.meta.json"] = to_json(_description(result, resampled, format, written, list(files)))
    return Exported(files, resampled.fps, resampled.frames, written.notes)


def write_export(  # noqa: PLR0913 - the last four are options
    motion: Motion,
    to: str,
    folder: Path | str,
    *,
    name: str | None = None,
    clip: Clip | None = None,
    fps: float | None = None,
    stage: str | None = None,
) -> tuple[Path, ...]:
    """Write a motion's files in a format into a folder, all of them or none, and return their paths.

    Args: `motion`: the motion; `to`: name of the format, such as `mjlab`; docs/exports.md has a table of them;
    `folder`: made when it does not exist; `name`: name of the files without suffix; by default `<clip>.<format>`;
    `clip`: the clip the motion was made from: it knows the objects' surfaces; `fps`: frames a second; by default those
    that the format's readers expect; `stage`: `ik`, `trajectory` or `physics`: the motion after it; by default the
    last. Raises `ArgumentError`: there is no such format or stage, it does not know the robot, or the rate is out of
    range; `GeometryError`: an object's mesh cannot be read; `WriteError`: a file cannot be written.
    """
    # A clip's name comes from a file: folders in it are left out.
    stem = PureWindowsPath(motion.report.clip).name or motion.robot
    chosen = motion if stage is None else motion.at_stage(stage)
    result = Result(stem, sha256(encode(motion)).hexdigest(), chosen, load_robot(motion.robot), clip)
    exported = export(result, format_named(to), name=name or f"{stem}.{to}", fps=fps)
    files = {Path(folder) / file: content for file, content in exported.files.items()}
    write_together(files)
    return tuple(files)


def _object(motion: Motion, format: Format, name: str | None) -> int | None:
    """Return the index of the object that goes into a format's one place for it."""
    names = motion.object_names
    listing = f"Objects: {', '.join(names)}." if names else "The result has none."
    if not format.place_for_object:
        if name is not None:
            raise ArgumentError(
                f"--object {name}: the format {format.name} has no place for an object. Leave the option out."
            )
        return None
    if name is not None and name not in names:
        raise ArgumentError(f"--object {name}: the result has no such object. {listing}")
    if name is None and len(names) > 1:
        raise ArgumentError(
            f"the format {format.name} has one place for an object, and the result has {len(names)}. "
            f"Name one with --object. {listing}"
        )
    if not names:
        return None
    return 0 if name is None else names.index(name)


def _description(
    result: Result, resampled: ResampledMotion, format: Format, written: Written, files: Sequence[str]
) -> dict[str, Any]:
    """Return the sidecar's content as plain values, without folders of the machine it was made on."""
    motion, model = result.motion, result.model
    joint_names = written.joint_names or model.joint_names
    return {
        "format": format.name,
        "read_by": format.title,
        "files": list(files),
        "robot": motion.robot,
        "fps": resampled.fps,
        "frames": resampled.frames,
        "seconds": (resampled.frames - 1) / resampled.fps,
        "joint_names": list(joint_names),
        **({"held_joints": held_joints(model, joint_names)} if model.spec.held else {}),
        "body_names": list(written.body_names),
        "quaternions": format.convention.quat_order,
        "linear_velocity_of": format.linear_velocity_of,
        "axes": "world, z up",
        "units": _UNITS,
        "objects": [
            {**result.object_facts(index), "in_the_format": index == resampled.object}
            for index in range(len(motion.object_names))
        ],
        "contacts": {
            "in": "the file" if format.contacts_inside else "beside it",
            "links": list(motion.contact_links),
            "normals_of": sorted(result.surfaces),
        },
        **result.origin(),
        "notes": list(written.notes),
    }
