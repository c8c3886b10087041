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

import numpy as np
from jaxtyping import Int

from hoi_retarget.clip.clip import MINIMUM_FRAMES
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.body_parameters import BodyParameters
from hoi_retarget.readers.fields import Fields, folder_of_tree, json_values, npz_fields
from hoi_retarget.readers.object_files import first_mesh
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks

FORMAT = "behave"
LICENCE = "BEHAVE's licence: non-commercial research, education and art only; faces in published images are blurred"
FPS = 30.0
BETAS, POSE = 10, 156
GENDERS = {f"{subject:02d}": "male" if subject <= 5 else "female" for subject in range(1, 9)}
"""Subject's number -> gender, as the makers list them."""
_OBJECTS = (
    *("backpack", "basketball", "boxlarge", "boxlong", "boxmedium", "boxsmall", "boxtiny", "chairblack", "chairwood"),
    *("keyboard", "monitor", "plasticcontainer", "stool", "suitcase", "tablesmall", "tablesquare", "toolbox"),
    *("trashbin", "yogaball", "yogamat"),
)
_OTHER_MESHES = {
    "chairblack": "chairblack_f2500.ply",
    "chairwood": "chairwood_f2500.ply",
    "monitor": "monitor_closed_f1000.ply",
    "tablesquare": "tablesquare_f2000.ply",
}
MESHES: Mapping[str, str] = {name: f"{name}_f1000.ply" for name in _OBJECTS} | _OTHER_MESHES
"""Object -> the simplified mesh that its poses were fitted with."""

_PERSON, _OBJECT, _INFO = "smpl_fit_all.npz", "object_fit_all.npz", "info.json"
_TIMES = "frame_times"
_TIME = re.compile(r"t(\d{1,6}\.\d{3})")
_MAX_OFFSET = 0.1  # Frames by which a time may be off a multiple of 1/30 s; they are written in milliseconds.
_NAME = re.compile(r"Date\d\d_Sub(?P<subject>\d\d)_(?P<category>[a-z]+)(?:_.*)?")
_TILT_NOTE = (
    "The world is that of the first camera, y down: how far it was tilted is not known, so the floor may slope by a "
    "few degrees."
)


def holds(file: SourceFile) -> bool:
    """Return whether a folder has the two files of a recording."""
    return all(file.beside(name).is_file() for name in (_PERSON, _OBJECT))


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a folder, in the stretch without gaps that is selected."""
    gender, category = _gender_and_category(file)
    person, object_ = (npz_fields(file, file.beside(name)) for name in (_PERSON, _OBJECT))
    times = _numbers(person), _numbers(object_)
    chosen = [part for name, part in _stretches(*times).items() if file.selection in (None, name)]
    if not chosen:
        raise ClipError(
            f"{file.name}: {_PERSON} ({len(times[0])} frames) and {_OBJECT} ({len(times[1])}) have no {MINIMUM_FRAMES} "
            f"frames in common that are 1/{FPS:g} s apart. Download the recording again."
        )
    rows = [np.searchsorted(numbers, chosen[0]) for numbers in times]

    def read_tracks() -> Tracks:
        body = _body(person, len(times[0]), gender).at(rows[0])
        angles = object_.array("angles", (len(times[1]), 3), "the object's rotation vectors")[rows[1]]
        positions = object_.array("trans", (len(times[1]), 3), "the object's position")[rows[1]]
        track = ObjectTrack(category, positions, se3.exp(angles), _geometry(file, options, category))
        return Tracks(people=(body,), objects=(track,))

    return SourceRecording(
        name="_".join(filter(None, (file.path.resolve().name, file.selection))),
        description="BEHAVE recording of one person and one object",
        frames=sum(map(len, chosen)),
        fps=FPS,
        fps_stated=True,
        skeleton=f"SMPL-H {gender}, {BETAS} betas",
        up_axis="-y of the first camera, as the format has it; its tilt is not known",
        objects=(category,),
        licence=LICENCE,
        notes=(_TILT_NOTE, *_frame_notes(*times, chosen[0])),
        up="-y",
        read_tracks=read_tracks,
        first_frame=int(rows[0][0]),
    )


def clips_in(file: SourceFile) -> tuple[str, ...]:
    """Return the names of the stretches between gaps, `first-last` in thirtieths of a second; none without gaps."""
    try:
        names = tuple(_stretches(*(_numbers(npz_fields(file, file.beside(name))) for name in (_PERSON, _OBJECT))))
    except ClipError:
        return ()  # Reading raises it.
    return names if len(names) > 1 else ()


def _gender_and_category(file: SourceFile) -> tuple[str, str]:
    named = _NAME.fullmatch(file.path.resolve().name)
    path = file.beside(_INFO)
    info = Fields(path, json_values(file, path) if path.is_file() else {})
    facts = {"gender": GENDERS.get(named["subject"]) if named else None, "cat": named["category"] if named else None}
    for key, meaning in (("gender", "the person's gender"), ("cat", "the object's category")):
        stated = info.text(key, meaning) if key in info else None
        if stated and facts[key] and stated != facts[key]:
            raise ClipError(
                f"{path}: {key} is {stated[:40]!a}, but the folder's name says {facts[key]!r}. Give the folder its "
                "own name again."
            )
        facts[key] = stated or facts[key]
        if facts[key] is None:
            raise ClipError(
                f"{file.name}: neither the folder's name nor {_INFO} tells {meaning}. Expected a name such as "
                f"Date03_Sub04_chairwood_sit, subjects {', '.join(GENDERS)}. Give the folder its own name again."
            )
    gender, category = str(facts["gender"]), str(facts["cat"])
    if category not in MESHES:
        raise ClipError(f"{file.name}: {category[:40]!a} is none of BEHAVE's objects: {', '.join(MESHES)}.")
    return gender, category


def _numbers(fields: Fields) -> Int[np.ndarray, "T"]:
    """Return the numbers of a file's frames, counted in thirtieths of a second; raises `ClipError`."""
    times = fields.get(_TIMES)
    texts = times.tolist() if isinstance(times, np.ndarray) else times
    if not isinstance(texts, list) or not texts or not all(isinstance(text, str) for text in texts):
        raise ClipError(f"{fields.path}: {_TIMES}, when the frames are, is no list of texts. Download it again.")
    matches = [match for match in map(_TIME.fullmatch, texts) if match]
    exact = FPS * np.array([float(match[1]) for match in matches])
    numbers = np.rint(exact).astype(int)
    sound = len(matches) == len(texts) and (np.abs(exact - numbers) <= _MAX_OFFSET).all()
    if not sound or (np.diff(numbers) <= 0).any():
        raise ClipError(
            f"{fields.path}: {_TIMES}, when the frames are, are not times in order such as 't0003.033', each a "
            f"multiple of 1/{FPS:g} s. Only BEHAVE's parameters at 30 frames a second are read."
        )
    return numbers


def _stretches(person: Int[np.ndarray, "P"], object_: Int[np.ndarray, "O"]) -> dict[str, Int[np.ndarray, "T"]]:
    """Return the numbers of the frames that both have, by stretches that are long enough for a clip; with names."""
    shared = np.intersect1d(person, object_, assume_unique=True)
    parts = np.split(shared, np.flatnonzero(np.diff(shared) > 1) + 1)
    return {f"{part[0]:04d}-{part[-1]:04d}": part for part in parts if len(part) >= MINIMUM_FRAMES}


def _frame_notes(
    person: Int[np.ndarray, "P"], object_: Int[np.ndarray, "O"], chosen: Int[np.ndarray, "T"]
) -> tuple[str, ...]:
    alone = {_PERSON: np.setdiff1d(person, object_), _OBJECT: np.setdiff1d(object_, person)}
    notes = [
        f"{len(numbers)} frame(s) that only {name} has are left out." for name, numbers in alone.items() if len(numbers)
    ]
    shared = len(person) - len(alone[_PERSON])
    if len(chosen) < shared:
        notes.append(
            f"The recording has gaps; this is the stretch from {chosen[0] / FPS:.3f} to {chosen[-1] / FPS:.3f} s, "
            f"{len(chosen)} of {shared} frames."
        )
    return tuple(notes)


def _body(fields: Fields, count: int, gender: str) -> BodyParameters:
    return BodyParameters.of_rows(
        fields.array("poses", (count, POSE), "the body's pose, a rotation vector for each of 52 joints"),
        family="smplh",
        gender=gender,
        betas=fields.array("betas", (count, BETAS), "the body's shape"),
        translation=fields.array("trans", (count, 3), "the body's position"),
        flat_hands=True,
    )


def _geometry(file: SourceFile, options: ReadOptions, category: str) -> ObjectGeometry:
    if options.objects is not None:
        folder = options.objects / category
    else:
        folder = folder_of_tree(file.path, "objects", category, beside="sequences")
    return first_mesh(category, [place / MESHES[category] for place in (folder, folder.parent)], centred=True)


READER = Reader(FORMAT, record, holds=holds, parts=(_PERSON, _OBJECT), clips_in=clips_in)
