"""The text files of contact edits: writing then reading is the identity, refusals, and versions by name."""

import errno
import os
import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.clip.clip import PINNED_PARTS
from hoi_retarget.clip.edits import (
    Add,
    ChooseHold,
    ContactEdits,
    Delete,
    Fix,
    FixAll,
    MadeFor,
    Merge,
    Move,
    Pin,
    Retime,
    Snap,
    SnapAll,
    Split,
    TurnHand,
    Unpin,
    apply,
    from_text,
    load,
    save,
    to_text,
)
from hoi_retarget.clip.edits.edits_file import EditsFiles
from hoi_retarget.errors import ArgumentError, ReadError, WriteError
from hoi_retarget.human.skeleton import HANDS, PARTS
from outcomes import both_outcomes
from synthetic import make

FAST = settings(max_examples=60, deadline=None, derandomize=True, database=None)

parts = st.sampled_from(list(PARTS))
pinned = st.sampled_from(PINNED_PARTS)
frames = st.integers(0, 10**12)
points = st.tuples(*[st.floats(-100, 100)] * 3)
persons = st.integers(0, 9)
names = st.text(st.characters(exclude_categories=["Cs"]))
where = {"part": parts, "frame": frames, "person": persons}
span = {"start": st.integers(0, 9), "stop": st.integers(10, 99)}
# What objects are made of, not the objects: shape checks draw random numbers, which strategies may not.
edits = st.one_of(
    *(
        st.tuples(st.just(kind), st.fixed_dictionaries(values))
        for kind, values in (
            (Move, {**where, "offset": points}),
            (Retime, {**where, **span}),
            (Split, {**where, "at": frames}),
            (Merge, where),
            (Delete, where),
            (Add, {"part": parts, **span, "point": points, "object": st.none() | names, "person": persons}),
            (Fix, {**where, "point": st.none() | points}),
            (FixAll, {}),
            (Snap, where),
            (ChooseHold, {**where, "part": st.sampled_from(HANDS), "rank": st.integers(1, 9)}),
            (TurnHand, {**where, "part": st.sampled_from(HANDS), "turn": st.tuples(*[st.floats(-180, 180)] * 3)}),
            (SnapAll, {}),
            (
                Pin,
                {
                    **where,
                    "part": pinned,
                    "position": points,
                    "turn": st.none() | st.tuples(*[st.floats(-180, 180)] * 3),
                },
            ),
            (Unpin, {**where, "part": pinned}),
        )
    )
)
made_for = st.fixed_dictionaries(
    {
        "name": names,
        "frames": st.integers(4, 10**6),
        "fps": st.floats(1e-3, 1e5),
        "people": st.integers(1, 9),
        "objects": st.lists(names, max_size=3).map(tuple),
        "contacts": st.text("0123456789abcdef", min_size=64, max_size=64),
    }
)


@FAST
@given(clip=made_for, recipes=st.lists(edits, max_size=6))
def test_writing_then_reading_is_the_identity(clip, recipes):
    written = ContactEdits(MadeFor(**clip), tuple(kind(**values) for kind, values in recipes))
    text = to_text(written)
    assert from_text(text, "text") == written
    assert to_text(from_text(text, "text")) == text
    assert repr(from_text(text, "text")) == repr(written)  # Minus zero too.


def test_saving_then_loading_is_the_identity(tmp_path):
    clip = make("carry_box")
    made = ContactEdits.of(clip).adding(Move("left_hand", 100, (0.1, 1 / 3, -1e-9))).adding(FixAll())
    path = tmp_path / "new folder" / "edits.toml"
    save(made, path)
    assert load(path) == made
    assert path.read_text().startswith("# Contact edits")
    assert apply(clip, load(path)).source.contact_edits == path.read_text()


def test_a_file_may_be_written_by_hand(tmp_path):
    clip = make("carry_box")
    head = to_text(ContactEdits.of(clip))
    text = head + '[[edit]]\noperation = "move"\nframe = 100\npart = "left_hand"\noffset = [0, 0.010, 1]\nperson = 0\n'
    assert from_text(text, "hand").edits == (Move("left_hand", 100, (0.0, 0.01, 1.0)),)


def test_names_of_files_that_are_no_text_can_be_written():
    clip = make("carry_box", seconds=1.0)
    object.__setattr__(clip, "name", os.fsdecode(b'take \xff\x7f "1"\n'))
    made = ContactEdits.of(clip)
    assert from_text(to_text(made), "text") == made
    to_text(made).encode()
    assert apply(clip, made) is clip


GOOD = to_text(ContactEdits.of(make("carry_box", seconds=1.0)).adding(Fix("left_hand", 5)))


def entry(text: str) -> str:
    return GOOD + "\n[[edit]]\n" + text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ("schema",)),
        ("schema = [", ("TOML",)),
        ("[" * 5000, ("TOML",)),
        (GOOD.replace("schema = 1", "schema = 2"), ("schema 2", "reads 1")),
        (GOOD.replace("schema = 1", "schema = true"), ("schema True",)),
        (GOOD.replace("schema = 1", 'schema = 1\nauthor = "x"'), ("'author'", "schema, clip, edit")),
        (GOOD.replace("fps", "rate"), ("[clip]", "'rate'", "fps")),
        (GOOD.replace("people = 1\n", ""), ("[clip]", "'people' is missing")),
        (GOOD.replace("people = 1", "people = true"), ("people holds True",)),
        (GOOD.replace("people = 1", 'people = "1"'), ("people holds '1'",)),
        (GOOD.replace("fps = 30.0", "fps = nan"), ("fps is nan",)),
        (GOOD.replace("fps = 30.0", "fps = 1" + "0" * 400), ("fps",)),
        (GOOD.replace('["box"]', "[1]"), ("objects[0] holds 1",)),
        ("schema = 1\nclip = 3", ("[clip] is no table",)),
        ("schema = 1\n", ("'clip' is missing",)),
        (GOOD.split("[[edit]]")[0].replace("schema = 1", "schema = 1\nedit = 3"), ("'edit' is no list",)),
        (GOOD.split("[[edit]]")[0].replace("schema = 1", "schema = 1\nedit = [3]"), ("edit 1 is no table",)),
        (entry('part = "left_hand"'), ("edit 2", "says no operation", "retime")),
        (entry('operation = "mve"'), ("edit 2", "no operation 'mve'", "move, choose_hold")),
        (entry("operation = 3"), ("edit 2", "no operation 3")),
        (entry('operation = "delete"\npart = "left_hand"\nfram = 3'), ("edit 2 (delete)", "'fram'", "part, frame")),
        (entry('operation = "delete"\npart = "left_hand"'), ("edit 2 (delete)", "'frame' is missing")),
        (entry('operation = "fix_all"\nframe = 3'), ("edit 2 (fix_all)", "'frame'", "none")),
        (entry('operation = "delete"\npart = "head"\nframe = 3'), ("edit 2 (delete)", "'head'", "left_foot")),
        (entry('operation = "delete"\npart = 3\nframe = 3'), ("edit 2", "part is 3")),
        (entry('operation = "delete"\npart = "left_hand"\nframe = 3.0'), ("edit 2", "frame is 3.0")),
        (entry('operation = "delete"\npart = "left_hand"\nframe = true'), ("edit 2", "frame is True")),
        (entry('operation = "delete"\npart = "left_hand"\nframe = -3'), ("edit 2", "frame is -3")),
        (entry('operation = "split"\npart = "left_hand"\nframe = 3\nat = "4"'), ("edit 2", "at is '4'")),
        *(
            (entry(f'operation = "move"\npart = "left_hand"\nframe = 3\noffset = {offset}'), ("edit 2", "offset is"))
            for offset in ("3.0", '"abc"', "[0.0, 0.0]", "[0, 0, nan]", "[inf, 0, 0]", "[0, 0, true]", '["0", 0, 0]')
        ),
        (entry(f'operation = "move"\npart = "left_hand"\nframe = 3\noffset = [0, 0, 1{"0" * 400}]'), ("edit 2",)),
        (entry('operation = "retime"\npart = "left_hand"\nframe = 3\nstart = 5\nstop = 5'), ("edit 2", "no frame")),
        (entry('operation = "add"\npart = "left_hand"\nstart = 3\nstop = 5\npoint = [0,0,0]\nobject = 1'), ("object",)),
    ],
)
def test_what_means_nothing_is_refused(tmp_path, text, words):
    path = tmp_path / "edits.toml"
    path.write_text(text)
    with pytest.raises(ReadError) as caught:
        load(path)
    for word in (str(path), *words):
        assert word in str(caught.value), str(caught.value)


def test_damaged_text_is_read_or_refused():
    @settings(max_examples=80, deadline=None, derandomize=True, database=None)
    @given(cut=st.integers(0, len(GOOD)), stop=st.integers(0, len(GOOD)), junk=st.text(max_size=5))
    def check(cut, stop, junk):
        attempt(from_text, GOOD[:cut] + junk + GOOD[max(cut, stop) :], "text")

    with both_outcomes(ReadError, "text") as attempt:
        check()


def test_files_that_cannot_be_read(tmp_path):
    for path, word in ((tmp_path / "gone.toml", "no such file"), (tmp_path, "cannot be read")):
        with pytest.raises(ReadError, match=word):
            load(path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ReadError, match="not a text file"):
        load(tmp_path / "binary.toml")


def test_a_full_disk_leaves_the_old_file(tmp_path, monkeypatch):
    made = ContactEdits.of(make("carry_box", seconds=1.0))
    path = tmp_path / "edits.toml"
    save(made, path)

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(WriteError, match="No space left"):
        save(made.adding(FixAll()), path)
    assert load(path) == made
    assert [item.name for item in tmp_path.iterdir()] == ["edits.toml"]


def test_the_text_is_toml_of_plain_values():
    table = tomllib.loads(GOOD)
    assert set(table) == {"schema", "clip", "edit"}
    assert table["edit"] == [{"operation": "fix", "part": "left_hand", "frame": 5}]


EDITS = ContactEdits.of(make("carry_box"))
NAMES = st.text("abcXYZ019_-", min_size=1, max_size=40)


@pytest.mark.parametrize("file", ["carry_box.edits.toml", "a.b.edits.toml", "mine.toml", "no_ending"])
def test_versions_lie_beside_the_edits_and_are_found_again_by_their_names(tmp_path, file):
    files = EditsFiles(tmp_path / file)
    assert files.versions == ()
    files.saved.write_text("")
    (tmp_path / "other.x.edits.toml").write_text("")
    for name in ("low", "high-2", "A_b"):
        files.version(name).write_text("")
    files.keep(EDITS)
    assert files.versions == ("A_b", "high-2", "low")
    assert files.version("low").name == {"carry_box.edits.toml": "carry_box.low.edits.toml"}.get(
        file, files.version("low").name
    )


@FAST
@given(st.text() | NAMES)
def test_no_name_leads_out_of_the_folder_or_to_another_file(tmp_path_factory, name):
    files = EditsFiles(tmp_path_factory.getbasetemp() / "carry_box.edits.toml")
    try:
        path = files.version(name)
    except ArgumentError as error:
        assert repr(name) in str(error)
        return
    assert path.parent == files.saved.parent and path.name == f"carry_box.{name}.edits.toml"
    assert path not in (files.saved, files.unsaved)


def test_what_is_kept_is_removed_or_becomes_a_version_and_never_replaces_one(tmp_path):
    files = EditsFiles(tmp_path / "carry_box.edits.toml")
    files.forget()
    for count, name in enumerate(("unsaved", "unsaved-2"), 1):
        edits = EDITS
        for _ in range(count):
            edits = edits.adding(FixAll())
        files.keep(edits)
        assert load(files.unsaved) == edits
        assert files.set_aside() == name
        assert load(files.version(name)) == edits and not files.unsaved.exists()
    files.keep(EDITS)
    files.forget()
    assert files.versions == ("unsaved", "unsaved-2") and len(list(tmp_path.iterdir())) == 2
