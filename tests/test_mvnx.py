"""Xsens's MVNX: a person as written is the person read, in any order of segments; faults are named."""

import numpy as np
import pytest

from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.numerics import se3
from hoi_retarget.readers import read_clip, reader_of
from hoi_retarget.readers.mvnx import TREE
from mvnx_writer import write_mvnx
from people_writer import alone
from short_clips import cut

BODY = 22
SHORT = cut(alone("carry_box"), 60, first=40)


@pytest.mark.parametrize("segments", [tuple(TREE), tuple(reversed(TREE))])
def test_a_person_as_written_is_the_person_read(tmp_path, segments):
    clip = read_clip(write_mvnx(tmp_path / "take.mvnx", SHORT, segments=segments))
    (read,), (written,) = clip.people, SHORT.people
    np.testing.assert_allclose(read.joint_positions[:, :BODY], written.joint_positions[:, :BODY], atol=1e-6)
    assert se3.angle_between(read.joint_quats[:, :BODY], written.joint_quats[:, :BODY]).max() < 1e-6
    assert (clip.name, clip.fps, clip.frames, clip.objects) == ("take", SHORT.fps, SHORT.frames, ())
    assert reader_of(SourceFile(tmp_path / "take.mvnx")).format == clip.source.format == "mvnx"
    assert not clip.people[0].fingers_recorded


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("</mvnx>", "", "is no XML"),
        ("<!-- <!DOCTYPE", "<!DOCTYPE a [<!ENTITY b 'c'>]><!-- <!DOCTYPE", "declares entities"),
        ('type="identity"', 'type="tpose"', "needs a frame of type identity"),
        ('type="normal"', 'type="tpose"', "some of type normal"),
        ('label="LeftToe"', 'label="Tail"', "lacks LeftToe"),
        ('frameRate="30.0"', 'frameRate="0"', "frameRate is 0"),
        ('frameRate="30.0"', 'frameRate="fast"', "frameRate is not 1 number"),
        ("<position>", "<position>nan ", "position of frame"),
        ("<orientation>", "<orientation>1 ", "orientation of frame"),
    ],
)
def test_faults_are_named(tmp_path, old, new, words):
    path = write_mvnx(tmp_path / "take.mvnx", SHORT)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(HoiRetargetError, match=words):
        read_clip(path)


def test_positions_of_another_body_and_several_subjects_are_refused(tmp_path):
    with pytest.raises(HoiRetargetError, match="there are 2 subjects"):
        read_clip(write_mvnx(tmp_path / "two.mvnx", SHORT, subjects=2))
    text = write_mvnx(tmp_path / "take.mvnx", SHORT).read_text()
    begin, _, rest = text.partition('<frame type="normal" index="7"><orientation>')
    numbers, _, end = rest.partition("</orientation>")
    turned = np.tile([0.0, 1.0, 0.0, 0.0], len(TREE)).astype(str)
    assert len(numbers.split()) == len(turned)
    (tmp_path / "take.mvnx").write_text(
        f'{begin}<frame type="normal" index="7"><orientation>{" ".join(turned)}</orientation>{end}'
    )
    with pytest.raises(HoiRetargetError, match="from where its orientations put it"):
        read_clip(tmp_path / "take.mvnx")


def test_legs_that_were_not_measured_are_told(tmp_path):
    path = write_mvnx(tmp_path / "take.mvnx", SHORT)
    path.write_text(path.read_text().replace("<subject ", '<subject configuration="UpperBody" '))
    assert any("UpperBody" in note for note in read_clip(path).source.notes)
