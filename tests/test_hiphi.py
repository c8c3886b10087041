"""HiPHI's and OmniContact's folders: written as released and read back, labelled, mirrored, damaged."""

import json
import tarfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from actor_writer import mirror_of, write_hiphi, write_omnicontact
from hoi_retarget.batch.archive_parts import archives_in, pieces
from hoi_retarget.cli import main
from hoi_retarget.clip.augment import at_rate
from hoi_retarget.clip.label_contacts import label_contacts
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError, GeometryError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.readers import read_clip, reader_of, recordings_below
from hoi_retarget.readers.open import open_clip, result_stem
from hoi_retarget.retargeting.solve import solve
from hoi_retarget.robots import load_robot
from short_clips import cut
from source_people import assert_same_objects, assert_same_people
from synthetic import make

SHARED = Path(__file__).parents[2] / "shared" / "data"
SCENES = ("carry_box", "push_table", "move_chair")
SHORT = cut(make("carry_box"), 150, first=90)  # While the box is lifted.


@pytest.fixture(scope="module")
def release(tmp_path_factory):
    """Three objects, each in a recording and its mirror image, 90 frames a second."""
    root = tmp_path_factory.mktemp("release")
    for number, scene in enumerate(SCENES, 1):
        clip = at_rate(make(scene), 90.0)
        write_hiphi(root, clip, f"Bringing-carry_{number:04}")
        write_hiphi(root, mirror_of(clip), f"Bringing-carry_{number:04}__mirror")
    return root


def folder_of(root, number=1, *, mirror=False):
    return root / "data" / "Bringing" / "carry" / f"Bringing-carry_{number:04}{'__mirror' * mirror}"


@pytest.mark.parametrize("number", [1, 2, 3])
@pytest.mark.parametrize("mirror", [False, True])
def test_what_is_released_is_read(release, number, mirror):
    clip, path = at_rate(make(SCENES[number - 1]), 90.0), folder_of(release, number, mirror=mirror) / "motion_actor.bvh"
    made = mirror_of(clip) if mirror else clip
    read = read_clip(path)
    assert_same_people(read, made, tolerance=3e-4)  # Bones of a resampled person are not rigid.
    assert_same_objects(read, made)
    assert (read.name, read.fps, read.contacts) == (path.parent.name, 90.0, ())
    assert result_stem(path) == path.parent.name
    assert read.people[0].fingers_recorded
    assert read.source.format == "hiphi"
    assert f"object_tracks/{clip.objects[0].name}.csv" in "\n".join(read.source.files)
    assert any("A person moves things." in note for note in read.source.notes)


def f1(found, truth):
    return 2 * (found & truth).sum() / max(found.sum() + truth.sum(), 1)


@pytest.mark.parametrize("number", [1, 2, 3])
def test_contacts_are_those_of_the_recording_without_labels(release, number):
    made = make(SCENES[number - 1])
    clip = open_clip(folder_of(release, number) / "motion_actor.bvh", ReadOptions(fps=made.fps))
    assert clip.frames == made.frames
    touching = 0
    for found, truth in zip(clip.contacts, label_contacts(made), strict=False):
        assert found.part == truth.part
        if truth.active.any():
            touching += 1
            assert f1(found.active, truth.active) >= 0.98
    assert touching


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs the recordings in ../shared")
def test_contacts_of_a_recorded_carry_are_its_labels():
    options = ReadOptions(objects=SHARED / "objects", fps=30.0)
    labelled = open_clip(SHARED / "omomo" / "sub3_largebox_003.pt", options)
    folder = SHARED / "foreign" / "hiphi_like" / "data" / "Bringing" / "carry" / "Bringing-carry_0001"
    clip = open_clip(folder / "motion_actor.bvh", ReadOptions(fps=30.0))
    found = {track.part: track.active for track in clip.contacts}
    for track in labelled.contacts:
        if track.active.any():
            assert f1(found[track.part], track.active) >= 0.95


def test_a_mirrored_pair_makes_mirrored_robots(release):
    model = load_robot("unitree_g1")
    hands = []
    for mirror in (False, True):
        clip = open_clip(folder_of(release, mirror=mirror) / "motion_actor.bvh", ReadOptions(fps=30.0))
        kinematics = solve(cut(clip, 90, first=60), model).kinematics
        hands.append({side: kinematics.site_position(f"{side}_palm") for side in ("left", "right")})
    for side, other in (("left", "right"), ("right", "left")):
        np.testing.assert_allclose(hands[1][side], hands[0][other] * [-1.0, 1.0, 1.0], atol=5e-3)


def test_a_release_is_found_by_names(release, monkeypatch):
    monkeypatch.setattr(SourceFile, "content", property(lambda _: pytest.fail("no file is read")))
    assert len(recordings_below(release)) == 2 * len(SCENES)


def test_omnicontact_is_read_as_hiphi_is(tmp_path):
    path = write_omnicontact(tmp_path, SHORT, "20260330_1")
    read = read_clip(path)
    assert_same_people(read, SHORT, tolerance=1e-5)
    assert_same_objects(read, SHORT)
    assert (read.name, read.source.format) == ("20260330_1", "omnicontact")
    assert "CC BY-NC-SA" in read.source.licence


def test_recordings_without_objects_are_motions(tmp_path):
    for write, name in ((write_hiphi, "Dance-bob_0001"), (write_omnicontact, "1")):
        path = write(tmp_path, replace(SHORT, objects=(), contacts=()), name)
        assert read_clip(path).objects == ()
        assert reader_of(SourceFile(path)).format == ("hiphi" if write is write_hiphi else "omnicontact")


def test_damage_is_told(tmp_path):
    path = write_hiphi(tmp_path, SHORT, "Bringing-carry_0001")
    track, facts = path.parent / "object_tracks" / "box.csv", path.parent / "metadata.json"
    text, table = track.read_text(), json.loads(facts.read_text())

    def fails(kind, what):
        with pytest.raises(kind, match=what):
            read_clip(path)
        track.write_text(text)
        facts.write_text(json.dumps(table))

    track.write_text("\n".join(text.splitlines()[:-1]))
    fails(ClipError, "differ in their number of frames")
    track.write_text(text.replace("qw", "q", 1))
    fails(ClipError, "qw, a column of the object's rotation, is missing")
    track.write_text(text.replace("\n0,", "\nzero,", 1))
    fails(ReadError, "line 2: could not convert string to float")
    track.write_text("")
    fails(ReadError, "the file is empty")
    facts.write_text("[]")
    fails(ReadError, "expected an object")
    facts.write_text(json.dumps(table | {"objects": [{"object_id": "../../box", "mesh_id": "box"}]}))
    fails(ReadError, "no plain name")
    facts.write_text(json.dumps(table | {"objects": [{"object_id": "box", "mesh_id": "../box"}]}))
    fails(ReadError, "no plain name")
    facts.write_text(json.dumps(table | {"objects": ["box"]}))
    fails(ClipError, "no list of tables")
    (tmp_path / "object_meshes_preview" / "box.obj").unlink()
    fails(GeometryError, "object_meshes_preview")


def archived(path: Path, root: Path, folders: list[Path], mode: str) -> Path:
    with tarfile.open(path, mode) as archive:
        for folder in folders:
            archive.add(folder, str(folder.relative_to(root)))
    return path


def test_archives_are_read_a_piece_at_a_time(release, tmp_path):
    recordings = sorted((release / "data" / "Bringing" / "carry").iterdir())
    meshes = release / "object_meshes_preview"
    archives = [
        archived(tmp_path / "part-1.tar", release, [meshes, *recordings[:4]], "w"),
        archived(tmp_path / "part-2.tar.gz", release, recordings[4:], "w:gz"),
    ]
    assert archives_in(tmp_path) == tuple(archives)
    smallest = min(sum(file.stat().st_size for file in path.rglob("*.*")) for path in recordings)
    seen: dict[str, bytes] = {}
    for archive in pieces(archives, tmp_path / "piece", size=smallest - 1):
        lying = recordings_below(tmp_path / "piece")
        assert len(lying) <= 1, "a piece ends with the recording that fills it"
        assert {path.name for path in (tmp_path / "piece").rglob("*.obj")} == {path.name for path in meshes.iterdir()}
        for path in lying:
            seen[str(path.relative_to(tmp_path / "piece"))] = path.read_bytes()
            assert (archive == archives[0]) == (
                path.parent in {tmp_path / "piece" / r.relative_to(release) for r in recordings[:4]}
            )
            assert_same_objects(read_clip(path), read_clip(release / path.relative_to(tmp_path / "piece")))
    assert seen == {str(path.relative_to(release)): path.read_bytes() for path in recordings_below(release)}
    assert not (tmp_path / "piece").exists()


@pytest.mark.parametrize("harm", ["cut", "outside", "flat"])
def test_archives_that_are_refused(release, tmp_path, harm):
    path = archived(tmp_path / "part.tar.gz", release, [folder_of(release)], "w:gz")
    if harm == "cut":
        path.write_bytes(path.read_bytes()[:-2000])
    elif harm == "outside":
        with tarfile.open(path, "w:gz") as archive:
            archive.add(folder_of(release) / "metadata.json", "../metadata.json")
    else:
        with tarfile.open(path, "w:gz") as archive:
            for number in range(20):
                archive.add(folder_of(release) / "metadata.json", f"data/{number}.json")
    sizes = {"flat": (folder_of(release) / "metadata.json").stat().st_size}
    with pytest.raises(
        ReadError, match={"cut": "damaged", "outside": "outside of itself", "flat": "one recording"}[harm]
    ):
        list(pieces([path], tmp_path / "piece", sizes.get(harm, 10**9)))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["part.tar.gz"]


def test_zstandard_archives_are_a_batch_that_goes_on(release, tmp_path, capsys):
    zstandard = pytest.importorskip("zstandard")
    plain = archived(tmp_path / "part", release, [release / "object_meshes_preview", release / "data"], "w")
    parts = tmp_path / "parts"
    parts.mkdir()
    (parts / "part.tar.zst").write_bytes(zstandard.ZstdCompressor().compress(plain.read_bytes()))
    (tmp_path / "settings.toml").write_text('contact = "landmark"\nsolver.max_iterations = 1\n')
    command = ["batch", str(parts), "--out", str(tmp_path / "out"), "--config", str(tmp_path / "settings.toml")]
    command += ["--figures", "none", "--workers", "1", "--about", "chair", "CARRY_0001"]
    main(command)
    said = capsys.readouterr()
    names = [json.loads(line)["name"] for line in (tmp_path / "out" / "manifest.jsonl").read_text().splitlines()]
    carry = "unitree_g1/data/Bringing/carry/Bringing-carry"
    kept = ("0001", "0001__mirror", "0003", "0003__mirror")
    assert names == [f"{carry}_{number}/motion_actor" for number in kept], said
    main(command)
    assert "4 of them done before" in capsys.readouterr().out
    assert main([*command, "--longest", "0.5"]) == 2
    assert "no clip in it is asked for" in capsys.readouterr().err
    for path in (parts, parts / "part.tar.zst"):
        main(["inspect", str(path)])
        assert "`hoi-retarget batch`" in " ".join("".join(capsys.readouterr()).split())
    (parts / "part.tar.zst").write_bytes((parts / "part.tar.zst").read_bytes()[:-500])
    assert main(command) == 1
    said = capsys.readouterr()
    assert "damaged" in said.err and "done before" in said.out, "what was read before the fault is worked on"


def test_a_release_is_counted_from_its_metadata(release, capsys):
    assert main(["inspect", str(release)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "6 with objects" in said
    assert "3 objects: box 2, table 2, chair 2" in said
