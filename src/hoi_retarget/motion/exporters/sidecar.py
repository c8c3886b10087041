"""The small file beside an export that says what is in it."""

from collections.abc import Sequence
from typing import Any

from hoi_retarget import __version__
from hoi_retarget.motion.exporters.format import Format, Take, Written
from hoi_retarget.motion.exporters.result import Result

UNITS = {"length": "m", "angle": "rad", "time": "s"}


def describe(result: Result, take: Take, format: Format, written: Written, files: Sequence[str]) -> dict[str, Any]:
    """Return the sidecar's content as plain values, without folders of the machine it was made on."""
    motion, trajectory = result.motion, take.trajectory
    return {
        "format": format.name,
        "read_by": format.title,
        "files": list(files),
        "robot": motion.robot,
        "fps": trajectory.fps,
        "frames": trajectory.frames,
        "seconds": (trajectory.frames - 1) / trajectory.fps,
        "joint_names": list(written.joint_names),
        "body_names": list(written.body_names),
        "quaternions": written.quaternions,
        "linear_velocity_of": written.linear_velocity_of,
        "axes": "world, z up",
        "units": UNITS,
        "objects": [
            {**result.object_facts(index), "in_the_format": index == take.object}
            for index in range(len(motion.object_names))
        ],
        "contacts": {
            "in": "the file" if format.contacts_inside else "beside it",
            "links": list(motion.contact_links),
            "normals_of": sorted(result.surfaces),
        },
        **provenance(result),
        "notes": list(written.notes),
    }


def provenance(result: Result) -> dict[str, Any]:
    """Return where an export comes from as plain values."""
    motion, source = result.motion, result.source
    return {
        "source": {
            "name": source.name,
            "format": source.format,
            "sha256": source.sha256,
            "licence": source.licence,
            "augmentation": dict(source.augmentation),
            "person": motion.person,
            "first_source_frame": motion.first_source_frame,
        },
        "result": {"name": f"{result.stem}.npz", "sha256": result.sha256, "fps": motion.fps},
        "hoi_retarget": __version__,
    }
