"""Objects with joints beside robots' motions, as HDMI has doors: shapes, joints and poses by an MJCF."""

import json
from pathlib import Path

import numpy as np
import pytest

import hoi_retarget as hr
from hoi_retarget.cli import main
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import GeometryError
from hoi_retarget.objects.object_joint import distance_from, path_of
from hoi_retarget.objects.track import ObjectJoint
from hoi_retarget.readers import read_clip
from hoi_retarget.readers.open import open_clip
from hoi_retarget.readers.own_layout import write
from synthetic.jointed import open_door

FOREIGN = Path(__file__).parents[2] / "shared" / "data" / "foreign" / "motions" / "door"
OPTIONS = ReadOptions(from_robot="unitree_g1")
XML = """<mujoco><compiler angle="radian"/><worldbody>
<body name="frame" pos="0.3 0 0.1" quat="0 0 0 1"><freejoint/>
<geom type="box" size="0.05 0.03 0.9" pos="0 0.46 0"/><geom type="cylinder" size="0.04 0.9" pos="0 -0.46 0"/>
<body name="door" pos="{pos}"><joint name="door_joint" pos="{anchor}" axis="0 0 1"/>
<geom type="box" size="0.0166 0.4138 0.8275"/><geom type="capsule" size="0.01 0.1"/><geom type="sphere" size="0.02"/>
<body name="knob" pos="0 -0.3 0.1"><geom type="mesh" mesh="knob"/></body></body></body></worldbody>
<asset><mesh name="knob" vertex="0 0 0 .05 0 0 0 .05 0 0 0 .05"/></asset></mujoco>"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A door opened by a G1, and HDMI's files of it: the frame's pose, and the door's angle among the joints."""
    folder = tmp_path_factory.mktemp("hdmi")
    write(open_door()[0], folder / "clip.npz")
    clip = read_clip(folder / "clip.npz", ReadOptions())
    motion = hr.retarget(clip, hr.load_robot("unitree_g1"), hr.Config(contact="landmark"))
    hr.save(motion, folder / "take.npz")
    words = ["--to", "hdmi", "--object", "frame", "--fps", "30", "--out", str(folder / "hdmi")]
    assert main(["export", str(folder / "take.npz"), *words]) == 0
    (meta,) = folder.rglob("meta.json")
    arrays, told = dict(np.load(meta.with_name("motion.npz"))), json.loads(meta.read_text())
    angle = open_door()[1]
    arrays["joint_pos"] = np.column_stack([arrays["joint_pos"], angle])
    arrays["joint_vel"] = np.column_stack([arrays["joint_vel"], np.gradient(angle) * motion.fps])
    told["joint_names"] = [*told["joint_names"], "door_joint"]
    np.savez(meta.with_name("motion.npz"), **arrays)
    meta.write_text(json.dumps(told))
    scale = float(motion.object_scale[0])
    start = motion.object_pos[0, 0] - motion.object_pos[0, 1]
    numbers = {"pos": start, "anchor": scale * np.array([0.0, 0.5, 0.0])}
    (meta.parent / "door.xml").write_text(XML.format(**{name: " ".join(map(str, it)) for name, it in numbers.items()}))
    return meta.parent, motion


def test_a_doors_panel_moves_by_the_files_angle(recorded):
    folder, motion = recorded
    frame, door, knob = read_clip(folder, OPTIONS).objects
    assert [one.name for one in (frame, door, knob)] == ["frame", "door", "knob"]
    assert frame.joint is None and knob.joint == ObjectJoint("door", "fixed")
    assert door.joint is not None and (door.joint.kind, door.joint.parent) == ("hinge", "frame")
    np.testing.assert_allclose(frame.positions, motion.object_pos[:, 1], atol=1e-6)
    # The retargeted door follows a smoothed angle, the file the recorded one.
    np.testing.assert_allclose(door.positions, motion.object_pos[:, 0], atol=1e-3)
    for part, parent in ((door, frame), (knob, door)):
        assert part.joint is not None
        off, turned = distance_from(path_of(part.joint, parent, part), parent, part)
        assert off < 1e-9 and turned < 1e-4
    np.testing.assert_allclose(path_of(door.joint, frame, door).states, open_door()[1], atol=1e-9)
    np.testing.assert_allclose(np.ptp(door.geometry.points, axis=0), [0.04, 0.8276, 1.655], atol=1e-6)
    assert len(knob.geometry.points) == 4 and frame.geometry.faces is not None


FAULTS = {
    "includes": ("<worldbody>", '<include file="other.xml"/><worldbody>', "it has <include file>"),
    "meshes elsewhere": ('vertex="0 0 0 .05 0 0 0 .05 0 0 0 .05"', 'file="/etc/passwd"', "it has <mesh file>"),
    "cube textures": ("<asset>", '<asset><texture type="cube" fileright="/etc/passwd"/>', "it has <texture fileright>"),
    "much out of little": ("<geom type=", '<replicate count="10000"/><geom type=', "it has <replicate>"),
    "height fields": ("<asset>", '<asset><hfield nrow="46000" ncol="46000" size="1 1 1 1"/>', "it has <hfield>"),
    "folders": ('angle="radian"', 'angle="radian" meshdir="/etc"', "it has <compiler meshdir>"),
    "no MJCF": ('type="sphere"', 'type="egg"', "MuJoCo cannot compile it"),
    "no shape": ('<geom type="mesh" mesh="knob"/>', "", "'knob' has no shape"),
    "huge": ('size="0.02"', 'size="1e300"', "one beyond 100 m"),
    "two joints": (
        'axis="0 0 1"/>',
        'axis="0 0 1"/><joint type="slide"/>',
        "'door' moves by more than one hinge or slide",
    ),
    "a ball": ("<joint name", '<joint type="ball" name', "'door' moves by more than one hinge or slide"),
    "no name": ('<body name="knob"', "<body", "each of its own name"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_wrong_with_an_mjcf_is_told(fault, recorded, tmp_path):
    folder, _ = recorded
    old, new, said = FAULTS[fault]
    for path in folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "door.xml").write_text((folder / "door.xml").read_text().replace(old, new))
    with pytest.raises(GeometryError, match=said):
        read_clip(tmp_path, OPTIONS)


@pytest.mark.parametrize("text", ["</mujoco>", "<annotation/>", "<mujoco><include file='a.xml'/></mujoco>"])
def test_other_files_beside_a_motion_are_passed_over(text, recorded, tmp_path):
    folder, _ = recorded
    for path in folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "a.xml").write_text(text)
    (tmp_path / "b.xml").mkdir()
    assert len(read_clip(tmp_path, OPTIONS).objects) == 3


def test_without_an_mjcf_shapes_are_asked_for_as_before(recorded, tmp_path):
    folder, _ = recorded
    for name in ("motion.npz", "meta.json"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    with pytest.raises(GeometryError, match="whose shape it does not hold"):
        read_clip(tmp_path, OPTIONS)


@pytest.mark.skipif(not FOREIGN.is_dir(), reason="the shared data are not there")
def test_hdmis_own_door_is_read():
    clip = open_clip(FOREIGN, OPTIONS)
    walls, panel = clip.objects
    assert panel.joint is not None and panel.joint.parent == walls.name == "door"
    angles = path_of(panel.joint, walls, panel).states
    assert angles.min() == pytest.approx(-1.5) and angles.max() == pytest.approx(0.0, abs=1e-9)
    # The hand is found at the panel in the frames in which the file flags a contact, and around them.
    touching = next(track for track in clip.contacts if track.part == "right_hand" and track.object == 1).active
    with np.load(FOREIGN / "motion.npz") as arrays:
        flagged = arrays["object_contact"][:, 0]
    assert touching[flagged].all() and touching.sum() < 2 * flagged.sum()
