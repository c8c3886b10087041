"""SOMA's skeleton: a person as Kimodo writes one is the person read, and a real file is one upright on the floor."""

from pathlib import Path

import numpy as np
import pytest

from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.readers import read_clip, reader_of
from hoi_retarget.readers.open import open_clip
from hoi_retarget.readers.soma import NAMES, PARENTS
from people_writer import alone
from short_clips import cut
from soma_writer import write_soma
from source_people import assert_same_people
from torch_writer import torch_bytes

SHORT = cut(alone("carry_box"), 60, first=40)
REAL = Path(__file__).parents[2] / "shared" / "data" / "foreign" / "gem_soma"
NEEDS_SHARED = pytest.mark.skipif(not REAL.is_dir(), reason=f"no real recordings at {REAL}")


def test_a_person_as_written_is_the_person_read(tmp_path):
    clip = read_clip(write_soma(tmp_path / "walk.npz", SHORT))
    assert_same_people(clip, SHORT)
    assert (clip.name, clip.fps, clip.frames, clip.objects) == ("walk", 30.0, SHORT.frames, ())
    assert reader_of(SourceFile(tmp_path / "walk.npz")).format == clip.source.format == "soma"
    assert any("as Kimodo makes them" in note for note in clip.source.notes)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"posed_joints": np.zeros((SHORT.frames, 30, 3))}, "posed_joints"),
        ({"local_rot_mats": np.zeros((SHORT.frames, 77, 3, 3))}, "is no rotation"),
        ({"local_rot_mats": np.tile(np.diag([1.0, 1.0, -1.0]), (SHORT.frames, 77, 1, 1))}, "mirrors"),
        ({"local_rot_mats": np.tile(np.eye(3), (SHORT.frames, 77, 1, 1))}, "from where the first frame's bones"),
        ({"local_rot_mats": np.tile(np.eye(3), (SHORT.frames - 1, 77, 1, 1))}, "local_rot_mats"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, change, words):
    path = write_soma(tmp_path / "walk.npz", SHORT)
    with np.load(path) as arrays:
        np.savez(path, **{**arrays, **change})
    with pytest.raises(HoiRetargetError, match=words):
        read_clip(path)


def test_what_gem_x_lacks_is_told(tmp_path):
    path = tmp_path / "walk.pt"
    path.write_bytes(torch_bytes({"body_params_global": {"body_pose": np.zeros((20, 228))}}))
    with pytest.raises(HoiRetargetError, match="GEM-X, whose bones' lengths are in SOMA's body model"):
        read_clip(path)


@NEEDS_SHARED
def test_the_published_file_has_this_skeleton_and_stands_on_the_floor():
    with np.load(REAL / "soma77_bind_rig.npz") as rig:
        assert tuple(rig["rig_joint_names"]) == NAMES
        parents = {int(child): int(parent) for parent, child in rig["rig_joint_connections"]}
        assert parents == {index: parent for index, parent in enumerate(PARENTS) if parent >= 0}
    clip = open_clip(REAL / "march_in_place_contacts.npz")
    person = clip.people[0]
    with np.load(REAL / "march_in_place_contacts.npz") as arrays:
        places = arrays["posed_joints"][:, [NAMES.index(name) for name in ("Head", "LeftHand", "RightToeBase")]]
    for index, joint in enumerate(("head", "left_wrist", "right_foot")):
        x, y, z = places[:, index].T
        lying = np.stack([z, x, y], axis=1)  # y up becomes z up by a turn about the axis that is left.
        ours = person.position(joint)
        np.testing.assert_allclose(ours[:, 2], lying[:, 2], atol=0.01)
        np.testing.assert_allclose(
            np.linalg.norm(np.diff(ours, axis=0), axis=1), np.linalg.norm(np.diff(lying, axis=0), axis=1), atol=1e-5
        )
    assert 1.6 < person.height < 1.9 and person.fingers_recorded
