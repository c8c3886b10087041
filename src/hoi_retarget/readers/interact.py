"""Reads InterAct's canonical sequences: recordings of eight data sets in one layout, a folder for each.

`data/<data set>/sequences_canonical/<id>` holds `human.npz`, the parameters of a body, and `object.npz`, or
`object_<object>_<part>.npz` for each part of several objects: `angles`, which are rotation vectors, `trans` and
`name`. y is up, in metres, 30 frames a second. The pelvis of the first frame is over the origin, the floor at the
lowest vertex of the first 30 frames. Meshes are `objects/<name>/<name>.obj` beside the sequences, parts
`objects/<object>/<part>.obj`; the mean of their vertices is their origin (wzyabcas/InterAct README.md,
process/canonicalize_human.py, process/canonicalize_obj.py).

Which body the numbers are of, no file says. The data set's folder does; where it has another name, the width of the
pose and the number of betas do, if they are of one data set only. `sequences/<id>`, from which the canonical ones are
made, promises neither floor nor heading and is not read.

Hands of 45 numbers are rotation vectors, others principal components. InterAct leaves these numbers as they are, and
its scripts do not agree on whether they are counted from flat hands or from the model's mean ones. Then the makers of
the data set decide: BEHAVE's model adds no mean hand (xiexh20/behave-dataset challenges/lib/SMPL.py), those of CHAIRS
(thusiyuan/chairs visualize.py) and InterCap (YinghaoHuang91/InterCap prox_second/cfg_files/SMPLifyD.yaml) do.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.body_model import Family
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectTrack
from hoi_retarget.readers.body_parameters import TITLES, BodyParameters
from hoi_retarget.readers.fields import Fields, check_frames, npz_fields
from hoi_retarget.readers.object_files import first_mesh
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks

FORMAT = "interact-canonical"
LICENCE = "InterAct: CC BY-NC-SA 4.0, on request"
FPS = 30.0
CANONICAL = "sequences_canonical"
MAX_OFFSET = 0.01
"""[m]; from the origin of a mesh to the mean of its vertices, which are the same in InterAct's meshes."""

_HUMAN, _OBJECT = "human.npz", "object.npz"
_OBJECTS = "objects"
_BEHAVE_BODY = "smpl_fit_all.npz"
"""BEHAVE's own file, which stands beside InterAct's in the folders that the canonical ones are made from."""
_PARTS = ("base", "part1", "part2", "top", "bottom")
"""Endings of an object's name in that of a part with a mesh of its own."""
_BODY = 66  # Numbers of the pose before those of the hands.
_FACE = 9
_ANGLE_OF_PARTS = "arti"

_RATE_NOTE = "30 frames a second, as InterAct has all data sets; the files do not state it."
_FLOOR_NOTE = "The floor is where InterAct put it, at the lowest vertex of the first 30 frames."
_RESEARCH = f"non-commercial scientific research; by way of {LICENCE}"


@dataclass(frozen=True)
class Subset:
    """One of the data sets, and its kind of bodies."""

    title: str
    terms: str  # Of the data, in its makers' words or InterAct's.
    family: Family
    betas: int  # How many; none where each person has a template instead.
    hand: int = 45  # Numbers of the pose of each hand.
    flat_hands: bool = True  # Whether hands are counted from flat ones; otherwise from the model's mean hand.
    face: bool = False  # Whether numbers of jaw and eyes may follow.
    note: str = ""  # A doubt about it.

    @property
    def width(self) -> int:
        """Numbers of a pose, without jaw and eyes."""
        return _BODY + 2 * self.hand

    def fits(self, width: int, betas: int) -> bool:
        """Return whether a pose of some width with some betas, none for a template, can be of this data set."""
        return betas == self.betas and width in (self.width, self.width + _FACE * self.face)

    @property
    def licence(self) -> str:
        """The terms of the data, named."""
        return f"{self.title}: {self.terms}"


SUBSETS: Mapping[str, Subset] = {
    "behave": Subset(
        "BEHAVE",
        _RESEARCH,
        "smplh",
        10,
        note="Hands are counted from flat ones, as BEHAVE's own model does; some scripts of InterAct add its mean "
        "hand.",
    ),
    "neuraldome": Subset("NeuralDome", f"non-commercial; by way of {LICENCE}", "smplh", 16),
    "imhd": Subset("IMHD", f"CC BY-NC-SA 4.0; by way of {LICENCE}", "smplh", 16),
    "chairs": Subset(
        "CHAIRS",
        f"by way of {LICENCE}",
        "smplx",
        10,
        flat_hands=False,
        face=True,
        note="Hands are counted from the model's mean hand, as CHAIRS' own code does; some scripts of InterAct "
        "count them from flat ones.",
    ),
    "intercap": Subset(
        "InterCap",
        _RESEARCH,
        "smplx",
        10,
        hand=12,
        flat_hands=False,
        note="Hands are counted from the model's mean hand, as InterCap's own fits are; some scripts of InterAct "
        "count them from flat ones.",
    ),
    "omomo": Subset("OMOMO", f"MIT; by way of {LICENCE}", "smplx", 16),
    "omomo_corole": Subset(
        "CoRoleHOI",
        f"CC BY 4.0, as others state it; by way of {LICENCE}",
        "smplx",
        16,
        note="It is one of two people: each is a sequence of its own, the other one is not in it.",
    ),
    "grab": Subset(
        "GRAB",
        _RESEARCH,
        "smplx",
        0,
        hand=24,
        flat_hands=False,
        note="The object's rotations are taken as they are stored; GRAB's own are inverted, and whether InterAct "
        "accounts for that is not known.",
    ),
    "parahome": Subset(
        "ParaHome",
        f"CC BY-NC-SA 4.0; by way of {LICENCE}",
        "smplx",
        20,
        note="InterAct found the floor with ten of the twenty betas; it may be off by some millimetres.",
    ),
}
"""First words of the data set's folder in small letters -> the data set; data sets of others that were converted as
one of InterAct's own have its word first (leggedrobotics/hoi-retarget docs/INTERACT.md)."""


def holds(file: SourceFile) -> bool:
    """Return whether a folder holds the files of one of InterAct's sequences."""
    there = file.beside(_HUMAN).is_file() and bool(_object_files(file.path))
    return there and (_place(file.path).parent.name == CANONICAL or not file.beside(_BEHAVE_BODY).is_file())


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a folder."""
    place = _canonical_place(file)
    human, objects = npz_fields(file, file.beside(_HUMAN)), _objects(file)
    subset, why = _subset(place, human)
    gender = human.text("gender", "the body's gender")
    poses = _poses(human)

    def read_tracks() -> Tracks:
        angles = {name: fields.array("angles", ("T", 3), "the object's rotation") for name, fields in objects.items()}
        check_frames(file.path, {"person": len(poses)} | {name: len(turns) for name, turns in angles.items()})
        folder = options.objects or place.parents[1] / _OBJECTS
        tracks = tuple(_track(name, fields, angles[name], folder) for name, fields in objects.items())
        return Tracks(people=(_body(human, subset, gender, poses),), objects=tracks, notes=_mesh_notes(tracks))

    return SourceRecording(
        name=place.name,
        description=f"InterAct's canonical sequence of {subset.title}",
        frames=len(poses),
        fps=FPS,
        skeleton=f"{TITLES[subset.family]} {gender}, "
        + (f"{subset.betas} betas" if subset.betas else "the person's own template"),
        objects=tuple(objects),
        licence=subset.licence,
        notes=(why, _RATE_NOTE, _FLOOR_NOTE, *filter(None, [subset.note])),
        up="y",
        read_tracks=read_tracks,
    )


def _place(path: Path) -> Path:
    """Return where a sequence is in the data set's tree, of which any folder may be a link."""
    named = path.absolute()
    return named if named.parent.name == CANONICAL else path.resolve()


def _canonical_place(file: SourceFile) -> Path:
    place = _place(file.path)
    if place.parent.name != CANONICAL:
        raise ReadError(
            f"{file.name}: it lies in a folder {place.parent.name!r}; only sequences in {CANONICAL} have their floor "
            f"and their up axis promised. Name {place.parent.parent / CANONICAL / place.name}, or make it with "
            "InterAct's process/canonicalize_human.py."
        )
    return place


def _object_files(folder: Path) -> list[Path]:
    single = folder / _OBJECT
    return [single] if single.is_file() else sorted(folder.glob("object_*.npz"))


def _objects(file: SourceFile) -> dict[str, Fields]:
    """Return each object's arrays by its name; raises `ReadError` or `ClipError`."""
    objects: dict[str, Fields] = {}
    for path in _object_files(file.path):
        fields = npz_fields(file, path)
        name = fields.text("name", "what the object is called")
        file.beside(name)  # A plain name, or an error: the mesh is looked for by it.
        if name in objects:
            raise ClipError(f"{file.name}: two of its files are of an object {name!r}. Download it again.")
        if _ANGLE_OF_PARTS in fields:
            raise ClipError(
                f"{path}: {name} is an object of parts with an angle between them ({_ANGLE_OF_PARTS}); what its pose "
                "is the pose of differs between versions of InterAct's scripts. Only rigid objects are read."
            )
        objects[name] = fields
    if not objects:
        raise ReadError(f"{file.name}: there is no {_OBJECT} and no object_*.npz. Download the sequence again.")
    return objects


def _poses(human: Fields) -> Float[np.ndarray, "T D"]:
    return human.array("poses", ("T", "D"), "the body's pose")


def _betas(human: Fields) -> Float[np.ndarray, "b"]:
    """Return the betas; none where the person has a template."""
    return np.zeros(0) if "vtemp" in human else human.array("betas", ("b",), "the body's shape")


def _body_text(width: int, betas: int) -> str:
    return f"poses of {width} numbers with {f'{betas} betas' if betas else 'a template'}"


def _subset(place: Path, human: Fields) -> tuple[Subset, str]:
    """Return which data set a sequence is of and the sentence that says why; raises `ClipError`."""
    width, betas = _poses(human).shape[1], len(_betas(human))
    folder = place.parents[1].name
    found = _body_text(width, betas)
    words = folder.lower().split("_")
    named = SUBSETS.get("_".join(words[:2])) or SUBSETS.get(words[0])
    if named is not None:
        if not named.fits(width, betas):
            raise ClipError(
                f"{human.path}: it has {found}, but {named.title}, as its folder {folder!r} says, has "
                f"{_body_text(named.width, named.betas)}. Put it into its own data set's folder, or make it again."
            )
        return named, f"It is of {named.title}, as the folder {folder!r} says."
    fitting = [subset for subset in SUBSETS.values() if (subset.width, subset.betas) == (width, betas)]
    if len(fitting) != 1:
        known = " or ".join(subset.title for subset in fitting) if fitting else "none that is known"
        raise ClipError(
            f"{human.path}: which data set it is of cannot be told: its folder is called {folder!r}, and {found} are "
            f"of {known}. Name the folder above {CANONICAL} {', '.join(SUBSETS)}, whichever it is."
        )
    return fitting[0], f"It is of {fitting[0].title}, which alone has {found}."


def _body(human: Fields, subset: Subset, gender: str, poses: Float[np.ndarray, "T D"]) -> BodyParameters:
    return BodyParameters.of_rows(
        poses[:, : subset.width],
        family=subset.family,
        gender=gender,
        betas=_betas(human),
        translation=human.array("trans", (len(poses), 3), "the body's position"),
        flat_hands=subset.flat_hands,
        template=human.array("vtemp", ("V", 3), "the person's own body") if "vtemp" in human else None,
    )


def _track(name: str, fields: Fields, angles: Float[np.ndarray, "T 3"], folder: Path) -> ObjectTrack:
    positions = fields.array("trans", (len(angles), 3), "the object's position")
    geometry = first_mesh(name, _mesh_files(name, folder), centred=False)
    return ObjectTrack(name, positions, se3.exp(angles), geometry)


def _mesh_files(name: str, folder: Path) -> Sequence[Path]:
    whole, _, part = name.rpartition("_")
    files = [folder / name / f"{name}.obj"]
    return [*files, folder / whole / f"{part}.obj"] if whole and part in _PARTS else files


def _mesh_notes(tracks: Sequence[ObjectTrack]) -> tuple[str, ...]:
    offsets = {track.name: float(np.linalg.norm(track.geometry.points.mean(axis=0))) for track in tracks}
    return tuple(
        f"The mesh of {name} has the mean of its vertices {100 * offset:.1f} cm from its origin; InterAct's have it "
        "there, so it may be another one than the poses are of."
        for name, offset in offsets.items()
        if offset > MAX_OFFSET
    )


READER = Reader(FORMAT, record, holds=holds, parts=(_HUMAN, _OBJECT), floor_at_zero=True)
