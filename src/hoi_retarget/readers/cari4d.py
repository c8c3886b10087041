"""Reads CARI4D's reconstructions of a person and an object from video: `<sequence>.pth`, torch files.

A dictionary, of which `pr`, the prediction, counts: the parameters of an SMPL-H body with 10 betas (`smpl_pose`,
`smpl_t`, `betas`), the object's poses as 4 x 4 matrices (`pose_abs`), raw scores of the left and the right hand's
contact (`contact_logits`), and names of frames, all for every frame. Everything is in the camera's frame: x right, y
down, z forward, metres. The optimization's files hold 72 numbers of pose, 66 of the body and six zeros, as hands rest
in a mean pose; those of the network before it hold 156, with hands. `train_state`, an object of CARI4D's own, is
passed over.

The body is gendered; CARI4D takes the gender from the subject's code in the sequence's name, and so is it here. The
object is reconstructed from one picture of the video: its mesh is in a folder of its own, named after the sequence. Of
videos its poses are of the mesh less the mean of its vertices; for the sequences of BEHAVE and InterCap, which CARI4D
also runs on, of the mesh as it is.

Cites: NVlabs/CARI4D `learning/training/opt_refineout.py` (what is written, hands, centring, contacts above 0) and
`docs/custom_video.md` (names of meshes and frames); `run_horefine.py`, `behave_data/const.py` (genders),
`behave_data/behave_video.py` (names of frames) and `lib_smpl/__init__.py` (156 numbers) as in its forks. That videos
have 30 frames a second, and which way the camera's axes point: leggedrobotics/hoi-retarget
`hoi_retarget/datasets/cari4d.py`.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hoi_retarget.clip.clip import MINIMUM_FRAMES
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError, GeometryError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.skeleton import HANDS
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.body_parameters import BodyParameters
from hoi_retarget.readers.fields import Fields
from hoi_retarget.readers.object_files import first_mesh, poses_of
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks

FORMAT = "cari4d"
LICENCE = "NVIDIA licence of CARI4D: non-commercial research; the video's own terms hold as well"
BETAS = 10
BODY_NUMBERS, HAND_NUMBERS = 66, 45
OPTIMIZED, REFINED = 72, BODY_NUMBERS + 2 * HAND_NUMBERS
"""Numbers of pose in a frame, after the optimization and before it."""
VIDEO_FPS = 30.0
RECONSTRUCTION_LENGTH = 2.0  # How long meshes are before their size is estimated: from -1 to 1.

_GENDER_OF: Mapping[str, str] = {
    **dict.fromkeys(("Sub01", "Sub02", "Sub03", "Sub04", "Sub05"), "male"),
    **dict.fromkeys(("Sub06", "Sub07", "Sub08"), "female"),
    **{word: word for word in ("male", "female", "neutral")},
}
_SUBJECT = re.compile(r"[Ss]ub\d+")
_TIME, _INDEX = re.compile(r"t\d+\.\d{3}"), re.compile(r"\d{1,9}")
_TIME_STEP_TOLERANCE = 2e-3  # [s]; times of frames are rounded to milliseconds.
_MESH_FOLDER_END = re.compile(r"(?:[._](?:\d[\d.]*|t\d[\d.]*|k\d+|color|mp4))*_(?:rgba|align)")
_PLAIN_NAME = re.compile(r"[\w+-][\w+. -]*")
_LEVEL = "The world is the camera's, taken to be level: how far it was tilted is not stored."
_PREDICTION = ("pose_abs", "smpl_pose", "smpl_t", "betas")


@dataclass(frozen=True)
class _Sequence:
    """Facts from the names of a recording's file, folder and frames."""

    name: str  # CARI4D's name of the video, such as `Date03_Sub01_gas_wild002`.
    object: str | None
    frames: int
    fps: float
    centred: bool  # Whether the object's poses are of the mesh less the mean of its vertices.
    rate_note: str


def holds(file: SourceFile) -> bool:
    """Return whether a torch file is a dictionary with a prediction of body and object."""
    value = file.torch
    prediction = value.get("pr") if isinstance(value, dict) else None
    return isinstance(prediction, dict) and all(name in prediction for name in _PREDICTION)


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a file."""
    fields = Fields(file.path, file.torch).table("pr", "the prediction")
    sequence = _sequence(file)
    frames, gender, name = sequence.frames, _gender(file, sequence), sequence.object or options.object_name
    touching, contact_notes = _touching(fields, frames)

    def read_tracks() -> Tracks:
        if name is None:
            raise GeometryError(
                f"{file.name}: the object's name is not in the name {sequence.name!r}, expected such as "
                "Date03_Sub01_table_wild. Pass --object NAME."
            )
        body, body_notes = _body(fields, frames, gender)
        matrices = fields.array("pose_abs", (frames, 4, 4), "the object's poses")
        positions, quats = poses_of(file.path, "pr/pose_abs", matrices)
        geometry, mesh_notes = _geometry(file, sequence, name, options.objects)
        return Tracks(
            people=(body,),
            objects=(ObjectTrack(name, positions, quats, geometry),),
            touching=touching,
            notes=(*body_notes, *mesh_notes, *contact_notes),
        )

    return SourceRecording(
        name=file.path.stem,
        description="CARI4D reconstruction of one person and one object from video",
        frames=frames,
        fps=sequence.fps,
        fps_stated=not sequence.centred,
        skeleton=f"SMPL-H {gender}, {BETAS} betas",
        up_axis="-y, by the camera, taken to be level",
        objects=(name,) if name else (),
        contacts="scores of the hands" if touching else "none stored",
        licence=LICENCE,
        notes=(sequence.rate_note, _LEVEL),
        up="-y",
        read_tracks=read_tracks,
        names_objects=sequence.object is not None,
    )


def _sequence(file: SourceFile) -> _Sequence:
    labels = _frame_names(file)
    folders = {label.rpartition("/")[0].rpartition("/")[2] for label in labels}
    if len(folders) > 1:
        raise ClipError(
            f"{file.path}: pr/frames names frames of several videos ({', '.join(sorted(folders)[:4])}), expected one. "
            "Convert each by itself."
        )
    # As CARI4D names what it makes: up to the first dot, `.0.color.mp4` of a video left out.
    name = folders.pop().partition(".")[0] or file.path.name.partition(".")[0]
    if not _PLAIN_NAME.fullmatch(name):
        raise ClipError(f"{file.path}: the sequence is called {name[:80]!a}, which is no plain name. Rename it.")
    words = name.split("_")
    fps, timed, note = _rate(file.path, [label.rpartition("/")[2] for label in labels])
    return _Sequence(
        name=name,
        object=words[2] if len(words) > 2 and _SUBJECT.fullmatch(words[1]) else None,
        frames=len(labels),
        fps=fps,
        centred=not timed and not name.startswith("ICap"),
        rate_note=note,
    )


def _frame_names(file: SourceFile) -> list[str]:
    path, labels = file.path, file.torch["pr"].get("frames")
    if not isinstance(labels, list) or not all(isinstance(label, str) for label in labels):
        raise ClipError(f"{path}: pr/frames is no list of the frames' names. Download the recording again.")
    if len(labels) < MINIMUM_FRAMES:
        raise ClipError(f"{path}: pr/frames names {len(labels)} frame(s); at least {MINIMUM_FRAMES} are needed.")
    return labels


def _rate(path: Path, stamps: list[str]) -> tuple[float, bool, str]:
    """Return frames a second, whether the frames' names are times, and a note on it."""
    if all(_TIME.fullmatch(stamp) for stamp in stamps):
        times = np.array([float(stamp[1:]) for stamp in stamps])
        steps = np.diff(times)
        step = (times[-1] - times[0]) / len(steps)
        _check_steps(path, stamps, np.abs(steps - step) > _TIME_STEP_TOLERANCE, step)
        fps = 1.0 / step
        # Times are rounded to milliseconds: rates that differ from a whole number by less are that number.
        fps = round(fps) if abs(fps - round(fps)) < 0.01 * fps else fps
        return float(fps), True, f"{fps:g} frames a second, as the frames' names say, which are times."
    if all(_INDEX.fullmatch(stamp) for stamp in stamps):
        steps = np.diff([int(stamp) for stamp in stamps])
        _check_steps(path, stamps, steps != steps[0], float(steps[0]))
        skipped = f", of which every {steps[0]}th is here" if steps[0] > 1 else ""
        note = f"The video's rate is not stored: it is taken as {VIDEO_FPS:g} frames a second{skipped}."
        return VIDEO_FPS / float(steps[0]), False, note
    other = next(stamp for stamp in stamps if not (_TIME.fullmatch(stamp) or _INDEX.fullmatch(stamp)))
    raise ClipError(
        f"{path}: pr/frames names a frame {other[:40]!a}, expected times such as t0003.033 or numbers such as 000017, "
        "one or the other throughout. Download the recording again."
    )


def _check_steps(path: Path, stamps: list[str], uneven: np.ndarray, step: float) -> None:
    if step > 0 and not uneven.any():
        return
    at = int(np.argmax(uneven))
    raise ClipError(
        f"{path}: frames do not follow each other evenly: {stamps[at][:40]} is followed by {stamps[at + 1][:40]} in "
        "pr/frames. Cut the recording there, or reconstruct the frames between."
    )


def _gender(file: SourceFile, sequence: _Sequence) -> str:
    """Return the gender that a subject's code or a word in the name of sequence, file or folder tells."""
    words = [
        word
        for name in (sequence.name, file.path.stem, file.path.absolute().parent.name)
        for word in re.split(r"[^a-zA-Z0-9]+", name)
    ]
    found = {word: _GENDER_OF[word] for word in words if word in _GENDER_OF}
    if len(set(found.values())) == 1:
        return next(iter(found.values()))
    if found:
        listing = ", ".join(f"{word} is {gender}" for word, gender in found.items())
        raise ClipError(f"{file.path}: names of file and folder contradict each other about the body: {listing}.")
    raise ClipError(
        f"{file.path}: nothing tells which body was fitted. CARI4D tells it by a subject's code, Sub01 to Sub05 for "
        f"male and Sub06 to Sub08 for female, in the sequence's name, here {sequence.name!r}. Put the file into a "
        "folder called male, female or neutral."
    )


def _body(fields: Fields, frames: int, gender: str) -> tuple[BodyParameters, tuple[str, ...]]:
    pose = fields.array("smpl_pose", (frames, "numbers"), "the body's pose")
    if pose.shape[1] not in (OPTIMIZED, REFINED):
        raise ClipError(
            f"{fields.path}: pr/smpl_pose has {pose.shape[1]} numbers a frame, expected {OPTIMIZED} of the "
            f"optimization or {REFINED} of the network before it. Download the recording again."
        )
    notes = (f"The body is {gender}, as names tell.",)
    optimized = pose.shape[1] == OPTIMIZED
    if optimized:
        notes += ("Hands are not stored; they rest in the body model's mean pose.",)
        if pose[:, BODY_NUMBERS:].any():
            notes += ("The last six numbers of the pose, of fingers, are not used.",)
        pose = np.concatenate([pose[:, :BODY_NUMBERS], np.zeros((frames, 2 * HAND_NUMBERS))], axis=1)
    else:
        notes += ("This is the network's result; the optimization after it improves contacts.",)
    body = BodyParameters.of_rows(
        pose,
        family="smplh",
        gender=gender,
        betas=fields.array("betas", (frames, BETAS), "the body's shape"),
        translation=fields.array("smpl_t", (frames, 3), "the body's position"),
        flat_hands=not optimized,
    )
    return body, notes


def _geometry(
    file: SourceFile, sequence: _Sequence, name: str, objects: Path | None
) -> tuple[ObjectGeometry, tuple[str, ...]]:
    """Return the object's shape in the frame of its poses; raises `ReadError` or `GeometryError`."""
    plain = file.beside(name, f"{name}.obj")  # Refuses names that would leave the folder.
    folder = objects or file.path.parent
    found = _meshes(folder, sequence.name)
    expected = folder / f"{sequence.name}*_align" / "*_align.obj"
    own = folder / plain.parent.name / plain.name
    geometry = first_mesh(name, (*found[:1], expected, own), centred=sequence.centred)
    frame = "less the mean of its vertices, as for videos" if sequence.centred else "as it is"
    mesh = found[0].relative_to(folder) if found else own.relative_to(folder)
    notes = (f"The object's poses are of its mesh {mesh} {frame}.",)
    if len(found) > 1:
        notes += (f"There are {len(found)} meshes of this sequence; CARI4D, too, takes the first.",)
    longest = float(np.ptp(geometry.points, axis=0).max())
    if abs(longest - RECONSTRUCTION_LENGTH) < 0.05 * RECONSTRUCTION_LENGTH:
        notes += (
            f"The mesh is {longest:.2f} m long, as all are before CARI4D estimates their size: unless that is its "
            "true length, pass the folder of metric meshes.",
        )
    return geometry, notes


def _meshes(folder: Path, sequence: str) -> list[Path]:
    """Return the meshes of a sequence's object, as CARI4D looks for them, not those of sequences named alike."""
    try:
        folders = [
            item
            for item in sorted(folder.iterdir())
            if item.name.startswith(sequence) and _MESH_FOLDER_END.fullmatch(item.name[len(sequence) :])
        ]
        return [mesh for item in folders for mesh in sorted(item.glob("*_align.obj"))]
    except OSError as error:
        raise GeometryError(f"{folder}: cannot be read ({error}). Check --objects and its permissions.") from error


def _touching(fields: Fields, frames: int) -> tuple[dict[tuple[int, str], np.ndarray], tuple[str, ...]]:
    """Return the contact of each hand with the object over time, empty where no scores are stored, and notes of it."""
    stored = "contact_logits" in fields
    scores = fields.array("contact_logits", (frames, 2), "scores of the hands' contacts") if stored else np.zeros(0)
    if not scores.any():
        return {}, ("The file has no scores of contacts.",)
    touching = scores > 0.0
    notes = ("Hands touch where CARI4D's score is above 0; feet are not scored.",)
    if touching.all():
        notes += ("Both hands are said to touch in all frames: another kind of score, distances, would look the same.",)
    return {(0, hand): touching[:, index] for index, hand in enumerate(HANDS)}, notes


READER = Reader(FORMAT, record, holds=holds)
