"""Reads Theia's `.pt` clips of one person with an object in each hand: a tensor of the 594 columns in `FIELDS`.

The layout is InterMimic's with a second object (Arkitect-z/InterMimic isaacgym/scripts/validate_theia_dataset.py). Its
name is `sub<N>_<object 1>+<object 2>_<sequence>.pt`: the first object belongs to the left hand, the second one to
the right hand, and an object's own label says the same as the labels of its hand. Other bodies are not labelled. Who
recorded the clips, and under which terms, is not stated.
"""

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import GeometryError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.skeleton import JOINTS
from hoi_retarget.readers import intermimic_layouts as layouts
from hoi_retarget.readers.reader import SourceRecording, Tracks

FORMAT = "theia-594"
LICENCE = "not stated; used in a fork of InterMimic"
FIELDS = layouts.column_table(
    {
        **layouts.PERSON,
        "object 1 position": 3,
        "object 1 rotation": 4,
        "object 2 position": 3,
        "object 2 rotation": 4,
        "object 1 contact label": 1,
        "object 2 contact label": 1,
        "body contact labels": 52,
        "body rotations": 208,
    }
)
SIDES = ("left", "right")  # The hand that the first and the second object belong to.
_AND = "+"


def holds(file: SourceFile) -> bool:
    """Return whether a torch file is one tensor of this layout's width."""
    return layouts.is_table(file.torch, FIELDS)


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the clip; its objects are named by `options.object_name`, two with a plus between them, or by the file."""
    rows, names = layouts.Rows(file.path, file.torch.astype(float), FIELDS), _names(file, options)

    def read_tracks() -> Tracks:
        rows.check()
        if not len(set(names)) == len(names) == len(SIDES):
            raise GeometryError(
                f"{file.path}: the names of its two objects are not in the file's name, expected "
                f"sub<N>_<object 1>{_AND}<object 2>_<sequence>.pt. Pass --object NAME{_AND}NAME, the left hand's first."
            )
        bodies = rows.labels("body contact labels")
        labels = [np.where(_hand(side), bodies, 0.0) for side in SIDES]
        sides = f"{names[0]} belongs to the left hand and {names[1]} to the right one, as the layout has it."
        notes = (sides, *_label_notes(rows, names, bodies, labels))
        by_name = dict(zip(names, labels, strict=True))
        return layouts.tracks_of(rows, rows.person()[0], by_name, options.objects, notes)

    return layouts.recording_of(rows, names, licence=LICENCE, read_tracks=read_tracks)


def _names(file: SourceFile, options: ReadOptions) -> tuple[str, ...]:
    """Return the objects' names as the user or the file's name has them; none without."""
    pairs = [word for word in file.path.stem.split("_") if _AND in word]
    pair = options.object_name or (pairs[0] if len(pairs) == 1 else "")
    return tuple(pair.split(_AND)) if pair else ()


def _hand(side: str) -> Bool[np.ndarray, "52"]:
    """Return the mask of a hand's joints."""
    return np.isin(np.arange(len(JOINTS)), layouts.HAND_JOINTS[f"{side}_hand"])


def _label_notes(
    rows: layouts.Rows, names: tuple[str, ...], bodies: Float[np.ndarray, "T 52"], labels: list[np.ndarray]
) -> tuple[str, ...]:
    """Return notes of labels that do not become contacts, or contradict each other."""
    notes: tuple[str, ...] = ()
    for k, (name, side, hand) in enumerate(zip(names, SIDES, labels, strict=True), 1):
        own = rows.used(f"object {k} contact label")[:, 0] == layouts.CONTACT_LABEL
        differing = int((own != (hand == layouts.CONTACT_LABEL).any(axis=1)).sum())
        if differing:
            notes += (f"{differing} frame(s) label {name} otherwise than the {side} hand, whose labels count.",)
    others = ~(_hand("left") | _hand("right"))
    touching = int((bodies[:, others] == layouts.CONTACT_LABEL).any(axis=1).sum())
    if touching:
        notes += (f"{touching} frame(s) label other bodies than hands, at which object is not known; not used.",)
    return notes


READER = layouts.reader_of(FORMAT, record, holds)
