"""Reads Theia's `.pt` clips of one person with an object in each hand: a tensor of 594 columns, named in `FIELDS`.

The layout is InterMimic's with a second object (Arkitect-z/InterMimic isaacgym/scripts/validate_theia_dataset.py). Its
name is `sub<N>_<object 1>+<object 2>_<sequence>.pt`: the first object belongs to the left hand, the second one to
the right hand, and an object's own label says the same as the labels of its hand. Other bodies are not labelled. Who
recorded the clips, and under which terms, is not stated.
"""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.clip import Clip, Source
from hoi_retarget.clip.grasp_check import READINGS
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import GeometryError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINTS
from hoi_retarget.objects.track import ObjectTrack
from hoi_retarget.readers.intermimic_rows import CONTACT_LABEL, PERSON, Rows, clip_of, outline_of
from hoi_retarget.readers.object_files import load_geometry
from hoi_retarget.readers.reader import Outline, Reader, never_has_companions

FORMAT = "theia-594"
LICENCE = "not stated; used in a fork of InterMimic"
COLUMNS = 594
FIELDS: Mapping[str, slice] = MappingProxyType(
    {
        **PERSON,
        "object 1 position": slice(318, 321),
        "object 1 rotation": slice(321, 325),
        "object 2 position": slice(325, 328),
        "object 2 rotation": slice(328, 332),
        "object 1 contact label": slice(332, 333),
        "object 2 contact label": slice(333, 334),
        "body contact labels": slice(334, 386),
        "body rotations": slice(386, 594),
    }
)
SIDES = ("left", "right")
"""Which hand the first and the second object belong to."""

_AND = "+"
_LABELS = "-1 (far), 0 (near) or 1 (contact)"


def holds(file: SourceFile) -> bool:
    """Return whether a torch file is one tensor of this layout's width."""
    return isinstance(file.torch, np.ndarray) and file.torch.ndim == 2 and file.torch.shape[1] == COLUMNS


def read_file(file: SourceFile, options: ReadOptions) -> Clip:
    """Return the clip, with the geometry of its objects from `options.objects`.

    The objects' names are `options.object_name`, two with a plus between them, or else in the file's name.

    Raises:
        ReadError: the file is missing or damaged.
        ClipError: numbers are not finite, rotations zero, labels unknown, or parts contradict each other.
        GeometryError: the objects have no names, or the geometry of one cannot be had.
    """
    rows = _rows(file)
    rows.check((-1, 1), _LABELS)
    positions, quats, _ = rows.person()
    names = _names(file, options)
    if len(names) != len(SIDES) or len(set(names)) < len(names):
        raise GeometryError(
            f"{file.path}: the names of its two objects are not in the file's name, expected "
            f"sub<N>_<object 1>{_AND}<object 2>_<sequence>.pt. Pass --object NAME{_AND}NAME, the left hand's first."
        )
    if options.objects is None:
        wanted = " and ".join(f"{name}/{name}.obj" for name in names)
        raise GeometryError(f"{file.path}: the clip needs its objects' geometry. Pass --objects DIR with {wanted}.")
    tracks = tuple(
        ObjectTrack(
            name, *rows.track(f"object {k} position", f"object {k} rotation"), load_geometry(options.objects, name)
        )
        for k, name in enumerate(names, 1)
    )
    bodies = rows.labels("body contact labels")
    labels = [np.where(_hand(side), bodies, 0.0) for side in SIDES]
    notes = (
        f"{names[0]} belongs to the left hand and {names[1]} to the right one, as the layout has it.",
        *_label_notes(rows, names, bodies, labels),
    )
    source = Source(str(file.path), file.sha256, FORMAT, LICENCE, notes)
    return clip_of(rows, Person("person", positions, quats), tracks, labels, source)


def outline(file: SourceFile) -> Outline:
    """Return what the clip holds."""
    return outline_of(_rows(file), _names(file, ReadOptions()) or ("", ""), LICENCE)


def _rows(file: SourceFile) -> Rows:
    return Rows(file.path, file.torch.astype(float), FIELDS)


def _names(file: SourceFile, options: ReadOptions) -> tuple[str, ...]:
    """Return the objects' names as the user or the file's name has them; none without."""
    pairs = [word for word in file.path.stem.split("_") if _AND in word]
    pair = options.object_name or (pairs[0] if len(pairs) == 1 else "")
    return tuple(pair.split(_AND)) if pair else ()


def _hand(side: str) -> np.ndarray:
    """Return which joints are a hand's."""
    body = len(JOINTS) - 30
    return np.array(
        [joint == f"{side}_wrist" or (place >= body and joint.startswith(side)) for place, joint in enumerate(JOINTS)]
    )


def _label_notes(
    rows: Rows, names: tuple[str, ...], bodies: Float[np.ndarray, "T 52"], labels: list[np.ndarray]
) -> tuple[str, ...]:
    """Return what the labels say that does not become contacts, or against each other."""
    notes: tuple[str, ...] = ()
    for k, (name, side, hand) in enumerate(zip(names, SIDES, labels, strict=True), 1):
        own = rows.used(f"object {k} contact label")[:, 0] == CONTACT_LABEL
        differing = int((own != (hand == CONTACT_LABEL).any(axis=1)).sum())
        if differing:
            notes += (f"{differing} frame(s) label {name} otherwise than the {side} hand, whose labels count.",)
    others = ~(_hand("left") | _hand("right"))
    touching = int((bodies[:, others] == CONTACT_LABEL).any(axis=1).sum())
    if touching:
        notes += (f"{touching} frame(s) label other bodies than hands, at which object is not known; not used.",)
    return notes


READER = Reader(
    format=FORMAT,
    suffixes=(".pt", ".pth"),
    floor_at_zero=True,
    rotation_readings=tuple(READINGS),
    holds=holds,
    read=read_file,
    outline=outline,
    has_companions=never_has_companions,
)
