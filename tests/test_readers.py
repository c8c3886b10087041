"""All readers beside each other: every source's recordings are of exactly one, and of none when they are damaged."""

import pickle
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import behave_writer
import bvh_writer
import cari4d_writer
import core4d_writer
import grab_writer
import hodome_writer
import imhd_writer
import interact_writer
import intercap_writer
import omomo_writer
import parahome_writer
import people_writer
from glb_writer import humoto
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import HoiRetargetError, ReadError
from hoi_retarget.files import archive
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.readers import READERS, can_be_clip, own_layout, read_clip, reader_of, recordings_below
from hoi_retarget.synthetic import make
from intermimic_writer import dictionary_of, physhoi_columns_of, theia_columns_of, write_clip
from joblib_writer import write_joblib
from mesh_writer import write_mesh
from short_clips import cut
from source_people import write_models
from torch_writer import torch_bytes

BOX = make("carry_box", seconds=1.0)
CHAIR = cut(make("move_chair", seconds=2.0), 12)
MODELS = "models"


@dataclass(frozen=True)
class Recording:
    """Where a recording is."""

    path: Path
    models: Path
    objects: Path | None = None

    def main(self, name: str = "") -> Path:
        return self.path / name

    def read(self):
        return read_clip(
            self.path, ReadOptions(body_models=self.models if self.models.is_dir() else None, objects=self.objects)
        )


def _intermimic(root: Path) -> Path:
    path = root / "sub1_box_001.pt"
    write_clip(BOX, path)
    write_mesh(root / "meshes" / "box" / "box.obj", BOX.objects[0].geometry)
    return path


def _several(root: Path) -> Path:
    path = root / "several.pt"
    path.write_bytes(torch_bytes(dictionary_of(BOX)))
    write_mesh(root / "meshes" / "box" / "box.obj", BOX.objects[0].geometry)
    return path


def _theia(root: Path) -> Path:
    box = BOX.objects[0]
    clip = replace(BOX, objects=(box, replace(box, name="other")), contacts=())
    path = root / "sub1_box+other_001.pt"
    path.write_bytes(torch_bytes(theia_columns_of(clip)))
    for track in clip.objects:
        write_mesh(root / "meshes" / track.name / f"{track.name}.obj", track.geometry)
    return path


def _physhoi(root: Path) -> Path:
    path = root / "toss.pt"
    path.write_bytes(torch_bytes(physhoi_columns_of(BOX)))
    return path


def _own(path: Path) -> Path:
    path.parent.mkdir(exist_ok=True)
    own_layout.write(BOX, path)
    return path


def _cari4d(root: Path) -> Path:
    write_models(root / MODELS, BOX.people, "smplh", ["male", "female", "neutral"])
    cari4d_writer.write_mesh(root / "meshes", BOX)
    return cari4d_writer.write(root / f"{cari4d_writer.VIDEO}.pth", cari4d_writer.prediction(BOX))


def _behave(root: Path) -> Path:
    write_models(root / MODELS, CHAIR.people, "smplh", ["male", "female"])
    behave_writer.write_mesh(root, CHAIR)
    return behave_writer.write_files(root, behave_writer.files_of(CHAIR))


def _intercap(root: Path) -> Path:
    seen = intercap_writer.in_camera(CHAIR)
    results, model = intercap_writer.results_of(seen)
    intercap_writer.write_model(root, model)
    path = intercap_writer.write_results(root, results)
    intercap_writer.write_saved_mesh(path, seen)
    return path


def _grab(root: Path) -> Path:
    clip = grab_writer.clip_on_table(seconds=1.0)
    members, model = grab_writer.members_of(clip)
    grab_writer.write_tools(root, clip, model)
    grab_writer.write_model(root / MODELS, model)
    return grab_writer.write_members(root, members)


def _omomo(root: Path) -> Path:
    omomo_writer.write_scan(root, "box_cleaned_simplified", BOX.objects[0])
    return omomo_writer.write_clips(root, [omomo_writer.clip_values(BOX, "sub3_box_001")])


def _parahome(root: Path) -> Path:
    clip = replace(CHAIR, objects=(replace(CHAIR.objects[0], name="chair_base"),))
    return parahome_writer.write_recording(root, clip, {"0 12": "Move the chair"})


WRITERS: dict[str, Callable[[Path], Path]] = {
    "intermimic-591": _intermimic,
    "intermimic-multi-object": _several,
    "theia-594": _theia,
    "physhoi-331": _physhoi,
    "hoi-retarget-clip": lambda root: _own(root / "own.npz"),
    "hoi-retarget-clip, a folder": lambda root: _own(root / "own" / own_layout.CLIP_FILE).parent,
    "core4d": lambda root: core4d_writer.write_world(root, make("carry_table", fps=15.0))[0],
    "cari4d": _cari4d,
    "behave": _behave,
    "intercap": _intercap,
    "grab": _grab,
    "interact-canonical": lambda root: interact_writer.write_sequence(root, CHAIR, "omomo")[0],
    "interact-canonical, of BEHAVE": lambda root: interact_writer.write_sequence(root, CHAIR, "behave")[0],
    "hodome": lambda root: hodome_writer.write_sequence(root, CHAIR, f"subject01_{CHAIR.objects[0].name}")[0],
    "imhd": lambda root: imhd_writer.write_recording(root, CHAIR, _imhd_name())[0],
    "omomo": _omomo,
    "humoto": lambda root: humoto(CHAIR).write(root / "chair.glb"),
    "parahome": _parahome,
    "amass": lambda root: people_writer.write_amass(root, CHAIR, "smplh")[0],
    "bvh": lambda root: bvh_writer.write_person(root / "walk.bvh", CHAIR, bvh_writer.Rig(bvh_writer.MIXAMO)),
    "gvhmr": lambda root: people_writer.write_gvhmr(root, CHAIR)[0],
}
"""Format, perhaps with a word on which kind -> what writes a recording with its models and meshes."""
MAIN = {
    "hoi-retarget-clip, a folder": "clip.npz",
    "core4d": "person1_poses.npz",
    "behave": "smpl_fit_all.npz",
    "interact-canonical": "human.npz",
    "interact-canonical, of BEHAVE": "human.npz",
    "parahome": "joint_positions.pkl",
}
"""The file that a folder is told by."""


def _imhd_name() -> Path:
    return Path("20230910", f"20230910_af_{CHAIR.objects[0].name}", "move", "gt_0_10_21.pkl")


def format_of(kind: str) -> str:
    return kind.partition(",")[0]


def at(root: Path, path: Path) -> Recording:
    return Recording(path, root / MODELS, root / "meshes" if (root / "meshes").is_dir() else None)


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Callable[[str], tuple[Path, Recording]]:
    """The folder of a recording and what belongs to it, each written once; and the recording."""

    @lru_cache
    def of(kind: str) -> tuple[Path, Recording]:
        root = tmp_path_factory.mktemp("source")
        return root, at(root, WRITERS[kind](root))

    return of


@pytest.fixture
def copy(written, tmp_path):
    """Copies of recordings, to be changed."""

    def of(kind: str) -> Recording:
        root, recording = written(kind)
        shutil.copytree(root, tmp_path, dirs_exist_ok=True)
        return at(tmp_path, tmp_path / recording.path.relative_to(root))

    return of


def holding(path: Path) -> list[str]:
    """All formats that take a recording; raises `ReadError` as they do."""
    file = SourceFile(path)
    return [reader.format for reader in READERS.values() if file.suffix in reader.suffixes and reader.holds(file)]


def test_there_is_a_recording_of_every_format():
    assert {format_of(kind) for kind in WRITERS} == set(READERS)


@pytest.mark.parametrize("kind", WRITERS)
def test_a_recording_is_held_by_its_reader_alone_and_read(written, kind):
    _, recording = written(kind)
    assert holding(recording.path) == [format_of(kind)] == [reader_of(SourceFile(recording.path)).format]
    assert recording.read().source.format == format_of(kind)
    assert can_be_clip(recording.path)


@pytest.mark.parametrize("kind", WRITERS)
def test_a_recording_is_found_in_its_tree_without_its_other_files(written, kind):
    root, recording = written(kind)
    found = recordings_below(root)
    assert recording.path in found
    assert not any(path.is_relative_to(root / MODELS) or path.parent == recording.path for path in found)


@pytest.mark.parametrize("kind", [kind for kind in WRITERS if kind not in MAIN])
def test_a_file_of_something_else_is_held_by_nobody(copy, kind):
    recording = copy(kind)
    for content in (b"", b"no recording", b"\x80", b"PK\x03\x04", b"\x78\x9c\0", b"glTF"):
        recording.path.write_bytes(content)
        try:
            assert holding(recording.path) == []
        except ReadError as error:
            assert recording.path.name in str(error)
        with pytest.raises(HoiRetargetError, match=re.escape(recording.path.stem)):
            recording.read()


@pytest.mark.parametrize("kind", MAIN)
def test_a_folder_without_its_main_file_is_held_by_nobody(copy, kind):
    recording = copy(kind)
    recording.main(MAIN[kind]).unlink()
    assert holding(recording.path) == []
    with pytest.raises(ReadError, match=r"not the recording of one clip|looks like a recording of"):
        recording.read()


@pytest.mark.parametrize("kind", WRITERS)
def test_a_file_that_is_cut_off_is_refused(copy, kind):
    recording = copy(kind)
    main = recording.main(MAIN.get(kind, ""))
    content = main.read_bytes()
    for keep in (0.0, 0.01, 0.5, 0.99):
        main.write_bytes(content[: int(keep * len(content))])
        with pytest.raises(HoiRetargetError, match=re.escape(recording.path.stem)):
            recording.read()


def nested(depth: int) -> list:
    value: list = []
    for _ in range(depth):
        value = [value]
    return value


def ring() -> list:
    value: list = []
    value.append([value])
    return value


class Touch:
    """Makes a file where a pickle of it is executed."""

    def __reduce__(self):
        return Path.touch, (Path("executed"),)


HOSTILE: dict[str, object] = {
    "text": "../../text",
    "nothing": None,
    "dictionary": {"../a/b": [1, "2"]},
    "ragged": [[1.0], [2.0, 3.0]],
    "nested": nested(100),
    "ring": ring(),
    "large": 10**400,
    "texts": np.array(["a", "b"] * 6),
    "empty": np.zeros((0, 3)),
    "flat": np.zeros((12, 0)),
    "not finite": np.full((12, 3), np.nan),
    "infinite": np.full((12, 156), np.inf),
    "complex": np.zeros(12, dtype=complex),
    "objects": np.array([None, "a"], dtype=object),
    "bytes": b"bytes",
    "executed": Touch(),
}
"""What no recording has in the place of its numbers."""
NO_TENSORS = ("texts", "complex", "objects")
"""Which of them torch cannot write."""
PLACES = {
    "core4d": (("person1_poses.npz", "arr_0"),),
    "cari4d": (("", "pose_abs"), ("", "frames"), ("", "betas")),
    "behave": (("smpl_fit_all.npz", "poses"), ("smpl_fit_all.npz", "frame_times"), ("object_fit_all.npz", "trans")),
    "intercap": (("", "body_pose"), ("", "ob_trans"), ("", "betas")),
    "grab": (("", "body"), ("", "object"), ("", "contact"), ("", "obj_name"), ("", "framerate"), ("", "n_comps")),
    "interact-canonical": (("human.npz", "poses"), ("human.npz", "gender"), ("object.npz", "name")),
    "hodome": (("", "frame_ids"), ("", "transl")),
    "imhd": (("", "smplShape"), ("", "objectRot")),
    "amass": (("", "trans"), ("", "poses"), ("", "betas"), ("", "gender"), ("", "mocap_framerate")),
    "omomo": (("", "trans"), ("", "rest_offsets"), ("", "seq_name"), ("", "obj_scale")),
    "parahome": (("joint_positions.pkl", ""), ("object_transformations.pkl", "3"), ("object_transformations.pkl", "")),
    "hoi-retarget-clip": (("", "joint_pos"), ("", "object_names"), ("", "contact_part")),
}
"""Format -> files and values in them; nothing for the whole file."""


def spoil(kind: str, path: Path, name: str, value: object) -> None:
    """Put a value in the place of another."""
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=True) as archive:
            arrays = dict(archive)
        boxed = np.empty((), dtype=object)
        boxed[()] = value
        arrays[name] = value if isinstance(value, np.ndarray) else boxed
        np.savez(path, **arrays)
    elif kind == "omomo":
        write_joblib(path, {0: omomo_writer.clip_values(BOX, "sub3_box_001") | {name: value}})
    elif kind == "cari4d":
        cari4d_writer.write(path, cari4d_writer.prediction(BOX) | {name: value})
    else:
        values = pickle.loads(path.read_bytes())
        key = int(name) if name.isdigit() else name
        path.write_bytes(pickle.dumps({**values, key: value} if name else value))


@pytest.mark.parametrize(("kind", "place"), [(kind, place) for kind, places in PLACES.items() for place in places])
def test_values_that_no_recording_has_are_our_errors(copy, kind, place, monkeypatch, tmp_path):
    recording = copy(kind)
    name, key = place
    file = recording.main(name)
    content = file.read_bytes()
    monkeypatch.chdir(tmp_path)
    for what, value in HOSTILE.items():
        if kind == "cari4d" and what in NO_TENSORS:
            continue
        file.write_bytes(content)
        spoil(kind, file, key, value)
        with pytest.raises(HoiRetargetError):
            recording.read()
            pytest.fail(f"{what} is read")
    assert not Path("executed").exists()


@pytest.mark.parametrize(("kind", "name"), [("core4d", "object_metadata.json"), ("parahome", "text_annotation.json")])
def test_tables_that_are_none_are_our_errors(copy, kind, name):
    recording = copy(kind)
    for text in ("", "[]", "null", "3", '{"obj_name": 3}', '{"": ""}', "[" * 5000, "1" * 5000, "\0"):
        (recording.path / name).write_text(text)
        with pytest.raises(HoiRetargetError, match=name):
            recording.read()


def test_a_file_that_unpacks_to_more_than_memory_is_refused(copy, monkeypatch):
    recording = copy("behave")
    monkeypatch.setattr(archive, "MAXIMUM_SIZE", 10_000)
    with pytest.raises(ReadError, match=r"would unpack to .* MB, expected at most 0.01"):
        recording.read()
