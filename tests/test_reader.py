"""The finisher of readers: what a new data set's reader has to say, and what is made of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, ClipError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.skeleton import PARTS
from hoi_retarget.readers.reader import Reader, SourceRecording, Tracks
from hoi_retarget.readers.worlds import TURN, Turn, World
from source_people import in_world
from synthetic import make

CLIP = make("carry_box", seconds=1.0)
TOUCHING = {(0, "left_hand"): np.arange(CLIP.frames) > 9}


def reader_of(up: str, /, **changes):
    """The reader of a data set whose recordings are all the same one, in a world of its own."""
    seen = in_world(CLIP, up)

    def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
        recording = SourceRecording(
            name="clip",
            description="A person and a box",
            frames=CLIP.frames,
            fps=CLIP.fps,
            skeleton="52 joints",
            up=up,
            objects=("box",),
            licence="CC0",
            notes=("First.",),
            read_tracks=lambda: Tracks(people=seen.people, objects=seen.objects, touching=TOUCHING, notes=("Last.",)),
        )
        return replace(recording, **changes)

    return Reader("made-up", record, holds=lambda file: True)


def read(reader, **options):
    return reader.read(SourceFile(Path("clip.made")), ReadOptions(**options))


@pytest.fixture(autouse=True)
def file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("clip.made").write_bytes(b"")


@pytest.mark.parametrize("up", TURN)
def test_a_recording_of_any_world_becomes_a_clip_with_z_up(up):
    clip = read(reader_of(up))
    np.testing.assert_allclose(clip.people[0].joint_positions, CLIP.people[0].joint_positions, atol=1e-12)
    np.testing.assert_allclose(clip.objects[0].positions, CLIP.objects[0].positions, atol=1e-12)
    assert (clip.source.format, clip.source.licence, clip.source.notes) == ("made-up", "CC0", ("First.", "Last."))


def test_labels_become_contacts_of_all_parts_at_the_parts_own_points():
    clip = read(reader_of("y"))
    assert [track.part for track in clip.contacts] == list(PARTS)
    for track in clip.contacts:
        np.testing.assert_array_equal(track.active, TOUCHING.get((0, track.part), np.zeros(CLIP.frames, dtype=bool)))
        points = clip.objects[0].to_object(clip.people[0].part_position(track.part))
        np.testing.assert_array_equal(track.contact_points[track.active], points[track.active])


def test_the_first_person_may_tell_the_world():
    def world(person):
        assert person.position("head").shape == (CLIP.frames, 3)
        return World("-y", (Turn(TURN["-y"], floor=0.5),), note="Found.")

    clip = read(reader_of("-y", up=world, up_axis="found"))
    np.testing.assert_allclose(
        clip.people[0].joint_positions[..., 2], CLIP.people[0].joint_positions[..., 2] - 0.5, atol=1e-12
    )
    assert clip.source.notes == ("First.", "Found.", "Last.")


def test_the_outline_is_told_without_the_arrays():
    def unread():
        pytest.fail("arrays are read")

    outline = reader_of("y", read_tracks=unread).outline(SourceFile(Path("clip.made")))
    assert (outline.frames, outline.objects, outline.people) == (CLIP.frames, ("box",), 1)
    assert (outline.fps_stated, outline.up_axis, outline.notes) == (False, "y, as the format has it", ("First.",))


def test_what_contradicts_a_recording_is_refused():
    with pytest.raises(ArgumentError, match="this one names box"):
        read(reader_of("y"), object_name="chair")
    assert read(reader_of("y", names_objects=False), object_name="chair").objects
    with pytest.raises(ClipError, match=r"clip\.made: there are too few frames \(recording: 3\)"):
        read(reader_of("y", frames=3))
    with pytest.raises(ClipError, match="turned to z up from z up as the format has it"):
        read(reader_of("y", up="z"))
