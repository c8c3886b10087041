"""Motions of robots as clips: the robot as a person, its contacts and objects, and back to the robot again."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hoi_retarget as hr
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.clip.robot_person import person_of
from hoi_retarget.errors import ArgumentError, GeometryError, ReadError
from hoi_retarget.motion import formats
from hoi_retarget.motion.check import check
from hoi_retarget.motion.result_file import save
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.readers import read_clip, recordings_below
from hoi_retarget.readers.open import clip_of, open_clip
from hoi_retarget.retargeting.config import Config, Scaling
from hoi_retarget.retargeting.ik import solve_ik
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.retargeting.targets import make_targets
from hoi_retarget.robots import ROBOTS
from hoi_retarget.robots.model import load_model
from hoi_retarget.robots.skin import skin_of
from mesh_writer import write_mesh
from short_clips import cut

FOREIGN = Path(__file__).parents[2] / "shared" / "data" / "foreign" / "motions"
G1, H2 = load_model(ROBOTS["unitree_g1"]), load_model(ROBOTS["unitree_h2"])
CLIP = cut(open_clip("builtin:carry_box"), 150, first=90)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """The built-in clip by a G1, and its file."""
    motion = retarget(open_clip("builtin:carry_box"), G1)
    path = tmp_path_factory.mktemp("results") / "carry_box.npz"
    save(motion, path)
    return motion, path


@given(st.integers(0, 2**31), st.sampled_from([G1, H2]))
@settings(max_examples=10, deadline=None)
def test_a_person_has_the_robots_sites_skin_and_palms(seed, model):
    rng = np.random.default_rng(seed)
    qpos = np.tile(model.home_qpos, (3, 1))
    qpos[:, 7:] += rng.uniform(-0.4, 0.4, qpos[:, 7:].shape)
    qpos[:, 3:7] = se3.quat_normalize(rng.normal(size=(3, 4)))
    kinematics = model.forward(qpos)
    person = person_of(kinematics)
    for row in model.spec.ik:
        if row.position_weight > 0.0 and row.scale == 1.0:
            np.testing.assert_allclose(person.position(row.human_joint), kinematics.site_position(row.site), atol=1e-12)
        turn = se3.quat_multiply(person.quat(row.human_joint), np.array(row.rotation_offset))
        site = se3.matrix_to_quat(kinematics.site_rotation(row.site))
        assert se3.angle_between(se3.quat_normalize(turn), site).max() < 1e-4  # Offsets have five digits.
    for side in ("left", "right"):
        palm = kinematics.site_position(f"{side}_palm")
        np.testing.assert_allclose(person.part_position(f"{side}_hand"), palm, atol=1e-12)
    assert person.shape.is_rigid
    skin = person.shape.skin(person.joint_positions, person.joint_quats)
    link = skin_of(model).by_link[model.body_of("left_palm")]
    placed = np.einsum("ijt,pj->tpi", kinematics.orientation(link.frame), link.points)
    placed += kinematics.point(link.frame).T[:, None]
    start = next(
        sum(len(other.points) for other in skin_of(model).links[:index])
        for index, other in enumerate(skin_of(model).links)
        if other is link
    )
    np.testing.assert_allclose(skin[:, start : start + len(link.points)], placed, atol=1e-9)


def test_the_hulls_face_outwards():
    shape = person_of(G1.forward(G1.home_qpos[None])).shape
    first, second, third = shape.rest_vertices[shape.faces.T]
    volume = np.einsum("fi,fi->f", first - shape.rest_vertices.mean(axis=0), np.cross(second - first, third - first))
    own = shape.owners[shape.faces[:, 0]]
    for joint in np.unique(own):
        part = own == joint
        centre = first[part].mean(axis=0)
        outward = np.einsum(
            "fi,fi->f", first[part] - centre, np.cross(second[part] - first[part], third[part] - first[part])
        )
        assert outward.sum() > 0.0
    assert volume.sum() > 0.0


def test_inverse_kinematics_gives_the_robot_itself(result):
    motion, path = result
    clip = read_clip(path, ReadOptions(from_robot="unitree_g1"))
    targets = make_targets(clip, G1, Scaling(object_scale=1.0))
    assert targets.root_scale == pytest.approx(1.0)
    qpos, _ = solve_ik(G1, targets, Config().ik, Config().horizon)
    again, before = G1.forward(qpos), G1.forward(motion.qpos)
    for row in G1.spec.ik:
        off = se3.matrix_angle_between(again.site_rotation(row.site), before.site_rotation(row.site))
        assert np.degrees(off.mean()) < 4.0, row.site


def test_contacts_and_objects_of_a_result_are_kept(result):
    motion, path = result
    clip = open_clip(path, ReadOptions(from_robot="unitree_g1"))
    (track,) = clip.objects
    np.testing.assert_allclose(track.positions, motion.object_pos[:, 0])
    captured = surface_of(clip_of(motion).objects[0].geometry).vertices
    np.testing.assert_allclose(surface_of(track.geometry).vertices, motion.object_scale[0] * captured)
    flags = {track.part: track.active for track in clip.contacts}
    for column, link in enumerate(motion.contact_links[:2]):
        np.testing.assert_array_equal(flags[link.replace("palm", "hand")], motion.contact_flags[:, column])
    assert clip.source.format == "robot-motion"
    assert clip.source.licence == motion.report.source.licence != ""


def test_another_robot_touches_where_the_first_did(result):
    motion, path = result
    clip = open_clip(path, ReadOptions(from_robot="unitree_g1"))
    other = retarget(clip, H2)
    assert other.report.figures["touch_share"] >= 0.95
    assert other.contact_flags[:, :2].sum() == motion.contact_flags[:, :2].sum()
    back = retarget(clip, G1, Config(scaling=Scaling(object_scale=1.0)))
    palms = [G1.forward(item.qpos).site_position("left_palm") for item in (motion, back)]
    assert np.linalg.norm(palms[0] - palms[1], axis=1).mean() < 0.03


def test_a_result_knows_its_robot(result):
    _, path = result
    with pytest.raises(ArgumentError, match="is a result for unitree_g1"):
        read_clip(path, ReadOptions(from_robot="unitree_h2"))
    with pytest.raises(ReadError, match="robot's motion, not a clip"):
        read_clip(path)
    assert recordings_below(path.parent, from_robot="unitree_g1") == (path,)
    assert recordings_below(path.parent) == ()


def test_clips_by_robots_are_found_again(result, tmp_path):
    _, path = result
    words = ["run", str(path), "--from", "unitree_g1", "--robot", "unitree_h2", "--fps", "15", "--figures", "none"]
    assert hr.main([*words, "--out", str(tmp_path)]) == 0
    clip, motion = open_clip(path, ReadOptions(from_robot="unitree_g1", fps=15.0)), hr.load(tmp_path / path.name)
    again = clip_of(motion)
    assert motion.fps == again.fps == 15.0
    np.testing.assert_array_equal(again.people[0].joint_positions, clip.people[0].joint_positions)
    assert [track.part for track in again.contacts] == [track.part for track in clip.contacts]


@pytest.mark.parametrize(("name", "parts"), [("carrybox_motion_0_with_contact", "hand"), ("ball10_018", "foot")])
@pytest.mark.skipif(not FOREIGN.is_dir(), reason="needs the motions in ../shared")
def test_omnicontacts_motions_have_objects_and_contacts(tmp_path, name, parts):
    path = FOREIGN / "omnicontact" / f"{name}.npz"
    checked = check(formats.read(path), G1)
    assert [item.name for item in checked.objects] == ["object"]
    assert "object" not in {item.subject for item in checked.causes}
    with pytest.raises(GeometryError, match="'object', whose shape it does not hold"):
        read_clip(path, ReadOptions(from_robot="unitree_g1"))
    write_mesh(tmp_path / "object" / "object.obj", CLIP.objects[0].geometry)
    clip = read_clip(path, ReadOptions(from_robot="unitree_g1", objects=tmp_path))
    touching = {track.part for track in clip.contacts if track.active.any()}
    assert touching and all(part.endswith(parts) for part in touching)
    np.testing.assert_allclose(clip.objects[0].positions, np.load(path)["object_pos_w"], atol=1e-6)
