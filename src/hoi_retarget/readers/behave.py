"""Reads BEHAVE's recordings at 30 frames a second: a folder for each, with `smpl_fit_all.npz` and `object_fit_all.npz`.

The first holds a person as gendered SMPL-H, ten betas and 52 rotation vectors in each frame; the makers' own layer
adds no mean hand to them (xiexh20/behave-dataset challenges/lib/SMPL.py, issue 14). The second holds the object's
rotation vectors and positions, which move its simplified mesh less the mean of that mesh's vertices
(tools/parse_obj_pose.py there). Both say when each of their frames is, as texts like `t0003.033`, in seconds. Frames
that could not be fitted are left out, sometimes in one of the files only (README and issue 30): what both have is
read, and where there are gaps, each stretch without one is a clip.

Everything is in the frame of the first Kinect's colour camera, metres, y down. Nobody has measured how that camera
was tilted (issues 32 and 37).

Subject and object are told by the folder's name, `Date03_Sub04_chairwood_sit`, and by `info.json` where there is one.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from hoi_retarget.clip.clip import MINIMUM_FRAMES, Clip, Source
from hoi_retarget.errors import ClipError
from hoi_retarget.files.source_file import FOLDER, SourceFile
from hoi_retarget.human.person import Person
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.body_parameters import BodyParameters
from hoi_retarget.readers.companions import folder_of_tree, json_table, refuse_object_name
from hoi_retarget.readers.fields import Fields
from hoi_retarget.readers.npz_fields import npz_values
from hoi_retarget.readers.reader import Outline, Reader, ReadOptions
from hoi_retarget.readers.triangles import first_mesh
from hoi_retarget.readers.upright import check_upright
from hoi_retarget.readers.varying_shape import person_of_rows
from hoi_retarget.readers.worlds import turned_object, turned_person

FORMAT = "behave"
LICENCE = "BEHAVE's licence: non-commercial research, education and art only; faces in published images are blurred"
FPS = 30.0
UP = "-y"
BETAS, POSE = 10, 156
GENDERS = {f"{subject:02d}": "male" if subject <= 5 else "female" for subject in range(1, 9)}
"""Subject's number -> gender, as the makers list them."""
MESHES: Mapping[str, str] = {
    "backpack": "backpack_f1000.ply",
    "basketball": "basketball_f1000.ply",
    "boxlarge": "boxlarge_f1000.ply",
    "boxlong": "boxlong_f1000.ply",
    "boxmedium": "boxmedium_f1000.ply",
    "boxsmall": "boxsmall_f1000.ply",
    "boxtiny": "boxtiny_f1000.ply",
    "chairblack": "chairblack_f2500.ply",
    "chairwood": "chairwood_f2500.ply",
    "keyboard": "keyboard_f1000.ply",
    "monitor": "monitor_closed_f1000.ply",
    "plasticcontainer": "plasticcontainer_f1000.ply",
    "stool": "stool_f1000.ply",
    "suitcase": "suitcase_f1000.ply",
    "tablesmall": "tablesmall_f1000.ply",
    "tablesquare": "tablesquare_f2000.ply",
    "toolbox": "toolbox_f1000.ply",
    "trashbin": "trashbin_f1000.ply",
    "yogaball": "yogaball_f1000.ply",
    "yogamat": "yogamat_f1000.ply",
}
"""Object -> the simplified mesh that its poses were fitted with."""

_PERSON, _OBJECT, _INFO = "smpl_fit_all.npz", "object_fit_all.npz", "info.json"
_TIMES = "frame_times"
_TIME = re.compile(r"t(\d{1,6}\.\d{3})")
_LARGEST_OFFSET = 0.1
"""Frames by which a time may be off a multiple of 1/30 s; they are written in milliseconds."""
_NAME = re.compile(r"Date\d\d_Sub(?P<subject>\d\d)_(?P<category>[a-z]+)(?:_.*)?")
_TILT_NOTE = (
    "The world is that of the first camera, y down: how far it was tilted is not known, so the floor may slope by a "
    "few degrees."
)


@dataclass(frozen=True, eq=False)
class _Table:
    """One of the two files."""

    fields: Fields
    numbers: Int[np.ndarray, "T"]
    """When its frames are, in thirtieths of a second."""


@dataclass(frozen=True, eq=False)
class _Frames:
    """Which frames are read: a stretch without gaps that both files have."""

    person: Int[np.ndarray, "T"]
    """Rows of the person's file."""
    object: Int[np.ndarray, "T"]
    """Rows of the object's file."""
    notes: tuple[str, ...]


def holds(file: SourceFile) -> bool:
    """Return whether a folder has the two files of a recording."""
    return all(file.beside(name).is_file() for name in (_PERSON, _OBJECT))


def read_file(file: SourceFile, options: ReadOptions) -> Clip:
    """Return the clip in a folder, or the stretch of it that is selected.

    Raises:
        ReadError: a file is missing or damaged.
        ClipError: arrays are missing or unusable, frames are not at 30 Hz, or subject and object are not told.
        GeometryError: the object's mesh cannot be had.
        BodyModelError: the body model cannot be had.
        ArgumentError: an object's name is given.
    """
    gender, category = _gender_and_category(file)
    refuse_object_name(file, options, category)
    body, thing = _table(file, _PERSON), _table(file, _OBJECT)
    frames = _frames(file, body.numbers, thing.numbers)
    person, notes = _person(body, gender, frames, options)
    person = turned_person(person, UP)
    check_upright(file.path, person, UP)
    track = _track(thing, frames, category, _geometry(file, options, category))
    return Clip(
        name="_".join(filter(None, (file.path.resolve().name, file.selection))),
        fps=FPS,
        people=(person,),
        objects=(turned_object(track, UP),),
        contacts=(),
        source=Source(str(file.name), file.sha256, FORMAT, LICENCE, (_TILT_NOTE, *frames.notes, *notes)),
        first_source_frame=int(frames.person[0]),
    )


def outline(file: SourceFile) -> Outline:
    """Return what a folder holds, without shapes and body models; raises `ReadError` or `ClipError`."""
    gender, category = _gender_and_category(file)
    stretches = _stretches(*(_table(file, name).numbers for name in (_PERSON, _OBJECT)))
    chosen = [stretch for name, stretch in stretches.items() if file.selection in (None, name)]
    return Outline(
        description="BEHAVE recording of one person and one object",
        frames=sum(len(stretch) for stretch in chosen),
        fps=FPS,
        fps_stated=True,
        skeleton=f"SMPL-H {gender}, {BETAS} betas",
        up_axis="-y of the first camera, as the format has it; its tilt is not known",
        people=1,
        objects=(category,),
        contacts="none stored",
        licence=LICENCE,
    )


def clips_in(file: SourceFile) -> tuple[str, ...]:
    """Return the names of the stretches between gaps, `first-last` in thirtieths of a second; none without gaps."""
    try:
        names = tuple(_stretches(*(_table(file, name).numbers for name in (_PERSON, _OBJECT))))
    except ClipError:
        return ()  # Reading tells.
    return names if len(names) > 1 else ()


# Files and frames


def _gender_and_category(file: SourceFile) -> tuple[str, str]:
    named = _NAME.fullmatch(file.path.resolve().name)
    path = file.beside(_INFO)
    info = json_table(file, path) if path.is_file() else Fields(path, {})
    told = {
        "gender": GENDERS.get(named["subject"]) if named else None,
        "cat": named["category"] if named else None,
    }
    for key, meaning in (("gender", "the person's gender"), ("cat", "the object's category")):
        stated = info.text(key, meaning) if key in info else None
        if stated and told[key] and stated != told[key]:
            raise ClipError(
                f"{path}: {key} is {stated[:40]!a}, but the folder's name says {told[key]!r}. Give the folder the name "
                "that its makers gave it."
            )
        told[key] = stated or told[key]
        if told[key] is None:
            raise ClipError(
                f"{file.name}: neither the folder's name nor {_INFO} tells {meaning}. Expected a name such as "
                f"Date03_Sub04_chairwood_sit, subjects {', '.join(GENDERS)}. Give the folder its own name again."
            )
    gender, category = str(told["gender"]), str(told["cat"])
    if category not in MESHES:
        raise ClipError(f"{file.name}: {category[:40]!a} is none of BEHAVE's objects: {', '.join(MESHES)}.")
    return gender, category


def _table(file: SourceFile, name: str) -> _Table:
    """Return one of the files."""
    path = file.beside(name)
    values = npz_values(file, path)
    return _Table(Fields(path, values), _numbers(path, values.get(_TIMES)))


def _numbers(path: Path, times: Any) -> Int[np.ndarray, "T"]:
    """Return the numbers of a file's frames, counted in thirtieths of a second; raises `ClipError`."""
    texts = times.tolist() if isinstance(times, np.ndarray) else times
    if not isinstance(texts, list) or not texts or not all(isinstance(text, str) for text in texts):
        raise ClipError(f"{path}: {_TIMES}, when the frames are, is no list of texts. Download it again.")
    matches = [match for match in map(_TIME.fullmatch, texts) if match]
    exact = FPS * np.array([float(match[1]) for match in matches])
    numbers = np.rint(exact).astype(int)
    sound = len(matches) == len(texts) and (np.abs(exact - numbers) <= _LARGEST_OFFSET).all()
    if not sound or (np.diff(numbers) <= 0).any():
        raise ClipError(
            f"{path}: {_TIMES}, when the frames are, are not times in order such as 't0003.033', each a multiple of "
            f"1/{FPS:g} s. Only BEHAVE's parameters at 30 frames a second are read."
        )
    return numbers


def _stretches(person: Int[np.ndarray, "P"], thing: Int[np.ndarray, "O"]) -> dict[str, Int[np.ndarray, "T"]]:
    """Return the numbers of the frames that both have, by stretches that are long enough for a clip; with names."""
    shared = np.intersect1d(person, thing, assume_unique=True)
    parts = np.split(shared, np.flatnonzero(np.diff(shared) > 1) + 1)
    return {f"{part[0]:04d}-{part[-1]:04d}": part for part in parts if len(part) >= MINIMUM_FRAMES}


def _frames(file: SourceFile, person: Int[np.ndarray, "P"], thing: Int[np.ndarray, "O"]) -> _Frames:
    stretches = _stretches(person, thing)
    if not stretches:
        raise ClipError(
            f"{file.name}: {_PERSON} ({len(person)} frames) and {_OBJECT} ({len(thing)}) have no {MINIMUM_FRAMES} "
            f"frames in common that are 1/{FPS:g} s apart. Download the recording again."
        )
    numbers = next(iter(stretches.values())) if file.selection is None else stretches[file.selection]
    notes: tuple[str, ...] = ()
    alone = {_PERSON: len(np.setdiff1d(person, thing)), _OBJECT: len(np.setdiff1d(thing, person))}
    for name, count in alone.items():
        if count:
            notes += (f"{count} frame(s) that only {name} has are left out.",)
    shared = len(person) - alone[_PERSON]
    if len(numbers) < shared:
        notes += (
            f"The recording has gaps; this is the stretch from {numbers[0] / FPS:.3f} to {numbers[-1] / FPS:.3f} s, "
            f"{len(numbers)} of {shared} frames.",
        )
    return _Frames(np.searchsorted(person, numbers), np.searchsorted(thing, numbers), notes)


# What is in them


def _person(table: _Table, gender: str, frames: _Frames, options: ReadOptions) -> tuple[Person, tuple[str, ...]]:
    fields, count = table.fields, len(table.numbers)
    pose = fields.array("poses", (count, POSE), "the body's pose, a rotation vector for each of 52 joints")[
        frames.person
    ]
    betas = fields.array("betas", (count, BETAS), "the body's shape")[frames.person]
    parameters = BodyParameters(
        family="smplh",
        gender=gender,
        betas=betas[0],
        translation=fields.array("trans", (count, 3), "the body's position")[frames.person],
        body=pose[:, :66],
        left_hand=pose[:, 66:111],
        right_hand=pose[:, 111:],
        flat_hands=True,
    )
    return person_of_rows(fields.path, "person", parameters, betas, options.body_models)


def _track(table: _Table, frames: _Frames, category: str, geometry: ObjectGeometry) -> ObjectTrack:
    fields, count = table.fields, len(table.numbers)
    angles = fields.array("angles", (count, 3), "the object's rotation vectors")[frames.object]
    positions = fields.array("trans", (count, 3), "the object's position")[frames.object]
    return ObjectTrack(category, positions, se3.exp(angles), geometry)


def _geometry(file: SourceFile, options: ReadOptions, category: str) -> ObjectGeometry:
    mesh = MESHES[category]
    if options.objects is not None:
        candidates = [options.objects / category / mesh, options.objects / mesh]
    else:
        folder = folder_of_tree(file.path, "objects", category, beside="sequences")
        candidates = [folder / mesh]
    return first_mesh(category, candidates, centred=True)


READER = Reader(
    format=FORMAT,
    suffixes=(FOLDER,),
    parts=(_PERSON, _OBJECT),
    floor_at_zero=False,
    holds=holds,
    read=read_file,
    outline=outline,
    clips_in=clips_in,
)
