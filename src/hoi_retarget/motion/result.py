"""A result to be exported, with its origin and its objects' shapes."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path, PureWindowsPath
from typing import Any

from hoi_retarget import __version__
from hoi_retarget.clip.clip import Clip
from hoi_retarget.motion.motion import Motion, check_robot
from hoi_retarget.objects.mesh import Surface, surface_of
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.robots.model import RobotModel

UNKNOWN = "unknown"


@dataclass(frozen=True, eq=False)
class Result:
    """One result, or another program's motion, with its file's name without folder and suffix, and its hash.

    Raises `RobotError` when its joints or its contact links are not the robot's.
    """

    stem: str
    sha256: str
    motion: Motion
    model: RobotModel
    clip: Clip | None = None  # Its source, where available: it knows the objects' shapes.
    suffix: str = ".npz"  # Of the file.

    def __post_init__(self) -> None:
        check_robot(self.motion, self.model)

    @property
    def licence(self) -> str:
        """Terms of the recording that it was made from; `unknown` where its report names none."""
        return _text(self.motion.report.source.licence) or UNKNOWN

    @cached_property
    def geometries(self) -> Mapping[str, ObjectGeometry]:
        """Shapes of the objects by name, where the clip is known."""
        return {} if self.clip is None else {track.name: track.geometry for track in self.clip.objects}

    @cached_property
    def surfaces(self) -> Mapping[str, Surface]:
        """Surfaces of the objects by name; raises `GeometryError` when a mesh cannot be read."""
        return {
            name: surface_of(geometry) for name, geometry in self.geometries.items() if name in self.motion.object_names
        }

    def object_facts(self, index: int) -> dict[str, Any]:
        """Return an object's name, scale and shape as plain values; raises `GeometryError`."""
        name = self.motion.object_names[index]
        facts = {"name": name, "scale": float(self.motion.object_scale[index])}
        geometry = self.geometries.get(name)
        if geometry is None:
            return {**facts, "mesh": None, "mesh_sha256": None, "shape": UNKNOWN}
        path: Path | None = geometry.mesh_path
        return {
            **facts,
            "mesh": None if path is None else path.name,
            "mesh_sha256": None if path is None else sha256(path.read_bytes()).hexdigest(),
            "shape": "triangles" if self.surfaces[name].exact else "convex hull of points",
        }

    def origin(self) -> dict[str, Any]:
        """Return where an export of it comes from as plain values."""
        motion, source = self.motion, self.motion.report.source
        return {
            "source": {
                # Folders of whoever ran it are nobody else's business.
                "name": PureWindowsPath(source.path).name or UNKNOWN,
                "format": _text(source.format),
                "sha256": _text(source.sha256),
                "licence": self.licence,
                "augmentation": asdict(source.augmentation),
                "person": motion.person,
                "first_source_frame": motion.first_source_frame,
            },
            "result": {
                "name": f"{self.stem}{self.suffix}",
                "sha256": self.sha256,
                "stage": motion.stages[-1].name,
                "fps": motion.fps,
            },
            "hoi_retarget": __version__,
        }


def _text(value: str) -> str:
    """Return a text of a report with question marks for half characters, which no file can hold."""
    return value.encode("utf-8", "replace").decode()
