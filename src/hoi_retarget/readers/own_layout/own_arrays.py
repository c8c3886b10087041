"""The arrays of a clip's file by name: each checked as it is taken, and written with the joints of any clip."""

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hoi_retarget.clip.clip import MINIMUM_FRAMES, Clip
from hoi_retarget.errors import ClipError, ReadError, WriteError
from hoi_retarget.files import npz
from hoi_retarget.files.atomic import write_atomically
from hoi_retarget.human.skeleton import JOINTS
from hoi_retarget.objects.track import ObjectTrack
from hoi_retarget.readers.fields import MAX_VALUE, other_shape

FORMAT = "hoi-retarget-clip"
SCHEMA = 1
SCHEMA_KEY = "clip_schema"
UP, UNIT = "z", "m"
HEIGHTS = "person_heights"
DOCUMENT = "docs/sources.md describes the layout."


# Kinds of numpy arrays by what they mean.
NUMBERS, INTEGERS, TEXT, FLAGS = "fiu", "iu", "U", "b"


class Arrays:
    """The arrays of a file; the layout knows none but taken ones."""

    def __init__(self, path: Path, members: Mapping[str, bytes]) -> None:
        self.path, self._members, self._used = path, members, set[str]()

    def __contains__(self, name: str) -> bool:
        return name in self._members

    def dimensions(self, name: str) -> int:
        """Return the number of axes of an array, 0 where it is missing or no plain array."""
        try:
            return npz.array(name, self._members[name], NUMBERS).ndim
        except (KeyError, ValueError):
            return 0

    def array(self, name: str, kinds: str, shape: tuple[int | str, ...], meaning: str) -> np.ndarray:
        """Return an array; raises `ClipError`.

        `name`: in the file; `kinds`: of numpy arrays; `shape`: as for `fields.other_shape`; `meaning`: for errors.
        """
        self._used.add(name)
        if name not in self._members:
            close = difflib.get_close_matches(name, self._members, n=1, cutoff=0.75)
            known = f"Did you mean {close[0]!r}?" if close else f"It has {', '.join(sorted(self._members)[:20])}."
            raise ClipError(f"{self.path}: the clip lacks {name!r}, {meaning}. {known} {DOCUMENT}")
        try:
            values = npz.array(name, self._members[name], kinds)
        except (ValueError, UnicodeDecodeError) as error:
            raise ClipError(f"{self.path}: {name}, {meaning}, cannot be used: {error}. {DOCUMENT}") from error
        if other := other_shape(values, shape):
            raise ClipError(f"{self.path}: {name}, {meaning}, {other}. {DOCUMENT}")
        if values.dtype.kind == "f" and name != "contact_points" and not np.isfinite(values).all():
            frames = np.unique(np.argwhere(~np.isfinite(values))[:, 0]) if values.ndim else np.zeros(1, dtype=int)
            raise ClipError(
                f"{self.path}: {name}, {meaning}, holds numbers that are not finite, first at row {frames[0]}. "
                "Cut those frames, or fill them where the recording is made."
            )
        if values.dtype.kind == "f" and np.abs(np.nan_to_num(values)).max(initial=0.0) > MAX_VALUE:
            raise ClipError(
                f"{self.path}: {name}, {meaning}, reaches {np.abs(np.nan_to_num(values)).max():.4g}, expected at most "
                f"{MAX_VALUE:g}: damage, or another unit. Lengths are in metres."
            )
        return values

    def people(self, name: str, shape: tuple[int | str, ...], meaning: str) -> np.ndarray:
        """Return an array of numbers with frames and people first; raises `ClipError` for too few of either."""
        values = self.array(name, NUMBERS, ("T", "P", *shape), meaning)
        frames, people = values.shape[:2]
        if frames < MINIMUM_FRAMES or people == 0:
            raise ClipError(
                f"{self.path}: {name} has {frames} frame(s) of {people} people; at least {MINIMUM_FRAMES} frames of "
                "one person are needed. Use a longer recording."
            )
        return values

    def person_names(self, count: int) -> list[str]:
        """Return the names of so many people; raises `ClipError`."""
        if "person_names" in self:
            return self.array("person_names", TEXT, (count,), "what the people are called").tolist()
        return [f"person {index}" for index in range(count)] if count > 1 else ["person"]

    def text(self, name: str, meaning: str) -> str:
        """Return a text; raises `ClipError`."""
        return str(self.array(name, TEXT, (), meaning))

    def texts(self, name: str) -> tuple[str, ...]:
        """Return sentences, none where they are missing; raises `ClipError`."""
        return tuple(self.array(name, TEXT, ("N",), "sentences").tolist()) if name in self else ()

    def number(self, name: str, meaning: str) -> float:
        """Return a number, in the file's unit; raises `ClipError`."""
        return float(self.array(name, NUMBERS, (), meaning))

    def count(self, name: str) -> int:
        """Return a number of frames, 0 where it is missing; raises `ClipError`."""
        return int(self.array(name, INTEGERS, (), "a number of frames")) if name in self else 0

    def check_schema(self) -> None:
        """Raise `ReadError` unless the file is of this layout, `ClipError` unless z is up and lengths are metres."""
        if SCHEMA_KEY not in self:
            if "schema" in self:
                raise ReadError(
                    f"{self.path}: this is a result, not a clip. Use `hoi-retarget evaluate` on it, or name the "
                    "recording that it was made from."
                )
            listing = ", ".join(ascii(name)[:40] for name in sorted(self._members)[:10])
            raise ReadError(f"{self.path}: not a clip of {FORMAT}: it has no {SCHEMA_KEY!r}, but {listing}. {DOCUMENT}")
        schema = int(self.array(SCHEMA_KEY, INTEGERS, (), "the version of the layout"))
        if schema != SCHEMA:
            raise ReadError(f"{self.path}: {SCHEMA_KEY} is {schema}; this version reads {SCHEMA}.")
        for name, expected, advice in (
            ("up", UP, "Turn the recording: from y-up, (x, y, z) becomes (x, -z, y)"),
            ("unit", UNIT, "Convert lengths to metres"),
        ):
            stated = self.text(name, f"always {expected!r}")
            if stated != expected:
                raise ClipError(f"{self.path}: {name} is {stated[:40]!r}, expected {expected!r}. {advice}. {DOCUMENT}")

    def check_all_used(self) -> None:
        """Raise `ClipError` when there are arrays that nobody has taken."""
        allowed = {"name", "fps", "licence", "notes", "first_source_frame"}
        unknown = sorted(set(self._members) - self._used - allowed)
        if unknown:
            known = sorted(self._used | allowed)
            close = difflib.get_close_matches(unknown[0], known, n=1)
            hint = f"Did you mean {close[0]!r}?" if close else f"Known here: {', '.join(known)}."
            raise ClipError(f"{self.path}: the clip has {unknown[0]!a}, which the layout does not know. {hint}")


def check_unit(path: Path, name: str, quats: np.ndarray) -> None:
    """Raise `ClipError` unless all quaternions are of unit length, within rounding."""
    lengths = np.linalg.norm(quats, axis=-1)
    bad = np.argwhere(np.abs(lengths - 1.0) > 0.01)
    if len(bad):
        at = tuple(int(index) for index in bad[0])
        raise ClipError(
            f"{path}: {name}{list(at)} has length {lengths[at]:.4g}, expected unit quaternions, wxyz. "
            f"({len(bad)} of {lengths.size} are not.) {DOCUMENT}"
        )


def write(clip: Clip, path: Path) -> None:
    """Write a clip so that reading it gives the same people, objects, contacts, notes and licence.

    Raises `WriteError` where it cannot, the mesh of an object is not in the file's folder, or parts are pinned.
    """
    write_atomically(path, encode(clip, path.parent))


def encode(clip: Clip, folder: Path) -> bytes:
    """Return the content of a clip's file that will lie in `folder`; raises `WriteError` as `write`."""
    if clip.pins or any(track.hold or any(track.turn) for track in clip.contacts):
        raise WriteError(
            f"clip {clip.name!r}: its file has no place for pins and chosen holds. Write it as recorded, and keep the "
            "edits."
        )
    values: dict[str, Any] = {
        SCHEMA_KEY: np.int64(SCHEMA),
        "name": np.str_(clip.name),
        "fps": np.float64(clip.fps),
        "up": np.str_(UP),
        "unit": np.str_(UNIT),
        "licence": np.str_(clip.source.licence),
        "notes": np.array(clip.source.notes, dtype=np.str_),
        "first_source_frame": np.int64(clip.first_source_frame),
        "joint_names": np.array(JOINTS, dtype=np.str_),
        "person_names": np.array([person.name for person in clip.people], dtype=np.str_),
        "joint_pos": np.stack([person.joint_positions for person in clip.people], axis=1),
        "joint_quat": np.stack([person.joint_quats for person in clip.people], axis=1),
        "object_names": np.array([track.name for track in clip.objects], dtype=np.str_),
    }
    if any(person.stature is not None for person in clip.people):
        values[HEIGHTS] = np.array([person.height for person in clip.people])
    if clip.objects:
        values["object_pos"] = np.stack([track.positions for track in clip.objects], axis=1)
        values["object_quat"] = np.stack([track.quats for track in clip.objects], axis=1)
    for index, track in enumerate(clip.objects):
        values |= _shape_values(index, track, folder)
        if (joint := track.joint) is not None:
            own = {"joint": np.str_(joint.kind), "parent": np.str_(joint.parent)}
            own |= {"axis": np.array(joint.axis), "anchor": np.array(joint.anchor)}
            values |= {f"object_{index}_{name}": value for name, value in own.items()}
    if clip.contacts:
        values |= {
            "contact_part": np.array([track.part for track in clip.contacts], dtype=np.str_),
            "contact_person": np.array([track.person for track in clip.contacts], dtype=np.int64),
            "contact_object": np.array([track.object for track in clip.contacts], dtype=np.int64),
            "contact_flags": np.stack([track.active for track in clip.contacts], axis=1),
            "contact_points": np.stack([track.contact_points for track in clip.contacts], axis=1),
        }
    return npz.encode(values)


def _shape_values(index: int, track: ObjectTrack, folder: Path) -> dict[str, Any]:
    geometry = track.geometry
    values: dict[str, Any] = {f"object_{index}_points": geometry.points}
    if geometry.faces is not None:
        values[f"object_{index}_faces"] = geometry.faces
    elif geometry.mesh_path is not None:
        try:
            inside = geometry.mesh_path.resolve().relative_to(folder.resolve())
        except ValueError as error:
            raise WriteError(
                f"object {track.name!r}: its mesh {geometry.mesh_path} is not in the folder of the clip, {folder}. "
                "Put it there, or give the object faces."
            ) from error
        values[f"object_{index}_mesh"] = np.str_(inside.as_posix())
    return values
