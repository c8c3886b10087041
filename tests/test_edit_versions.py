"""Files of edits beside each other: versions by name, and what nobody has saved yet."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.clip.edits import ContactEdits, FixAll, load
from hoi_retarget.clip.edits.versions import EditsFiles
from hoi_retarget.errors import ArgumentError
from hoi_retarget.synthetic import make

EDITS = ContactEdits.of(make("carry_box"))
FAST = settings(max_examples=100, deadline=None, derandomize=True, database=None)
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
