"""Distances between a robot's skin and objects with exactly known surfaces."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from hoi_retarget.evaluation.penetration import self_collision_pairs, self_depths
from hoi_retarget.evaluation.surface_distances import ObjectShape, PosedObject, link_distances, shape_of, surface_kind
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.link_depths import PosedLink, RigidPoses, pair_depths
from hoi_retarget.robots.skin import LinkSkin, link_heights, skin_of

HAND = "left_wrist_yaw_link"


@pytest.fixture(scope="module")
def hand() -> LinkSkin:
    return skin_of(load_robot("unitree_g1")).by_link[HAND]


def shape_of_mesh(mesh: trimesh.Trimesh) -> ObjectShape:
    return shape_of(ObjectGeometry(np.array(mesh.vertices), faces=np.array(mesh.faces)))


def still(frames: int) -> RigidPoses:
    return RigidPoses(np.zeros((frames, 3)), np.tile(np.eye(3), (frames, 1, 1)))


def test_frames_measured_in_blocks_are_those_measured_at_once(hand, monkeypatch):
    random = np.random.default_rng(3)
    frames = 23
    quats = random.normal(size=(frames, 4))
    rotations = se3.quat_to_matrix(quats / np.linalg.norm(quats, axis=1)[:, None])
    link = RigidPoses(random.uniform(-0.15, 0.15, size=(frames, 3)), rotations)
    placed = PosedObject(shape_of_mesh(trimesh.creation.box((0.2, 0.1, 0.3))), still(frames), 0.8)
    measured = random.random(frames) < 0.5
    found = []
    for block in (frames, 5):
        monkeypatch.setattr("hoi_retarget.evaluation.surface_distances.FRAMES_AT_ONCE", block)
        found.append(link_distances(hand, link, placed, measured))
    for name in ("skin", "point", "object"):
        np.testing.assert_array_equal(*(getattr(distances, name) for distances in found))
    assert (found[0].depth > 0.0).any() and np.isinf(found[0].skin).any()


@pytest.mark.parametrize("scale", [1.0, 0.7])
def test_a_hand_before_and_in_a_box(hand, scale):
    """The hand moves along x into a box, whose face is at x = 0.3 times the scale: gap and depth are known."""
    box = trimesh.creation.box((0.6, 0.8, 0.8))
    offsets = np.array([0.05, 0.002, 0.0003, -0.0005, -0.004, -0.03])
    turn = np.diag([-1.0, -1.0, 1.0])  # Fingers ahead
    reach = (hand.points @ turn.T)[:, 0].min()
    link = RigidPoses(
        np.stack([0.3 * scale + offsets - reach, 0 * offsets, 0 * offsets], axis=1), np.tile(turn, (6, 1, 1))
    )
    placed = PosedObject(shape_of_mesh(box), still(6), scale)
    found = link_distances(hand, link, placed, np.ones(6, bool))
    np.testing.assert_allclose(found.skin, offsets, atol=1e-6)
    assert (found.point >= 0).all()
    np.testing.assert_allclose(found.depth[:3], 0.0, atol=3e-4)
    assert (found.depth[3:] >= -offsets[3:] - 1e-6).all()
    near = link_distances(hand, link, placed, np.zeros(6, bool))
    assert np.isinf(near.skin[0])
    np.testing.assert_allclose(near.skin[1:], offsets[1:], atol=1e-6)
    np.testing.assert_allclose(near.depth, found.depth)


def test_a_hand_on_and_in_a_sphere(hand):
    """Distances from a sphere of 60 mm are those from its middle, less 60 mm, and as exact as its triangles."""
    ball = trimesh.creation.icosphere(5, 0.06)
    random = np.random.default_rng(0)
    away = random.normal(size=(8, 3))
    away *= random.uniform(0.1, 0.25, (8, 1)) / np.linalg.norm(away, axis=1, keepdims=True)
    link = RigidPoses(away, still(8).rotations)
    found = link_distances(hand, link, PosedObject(shape_of_mesh(ball), still(8), 1.0), np.ones(8, bool))
    exact = np.array([np.linalg.norm(hand.points + place, axis=1).min() - 0.06 for place in away])
    np.testing.assert_allclose(found.skin, exact, atol=1e-4)


def test_a_slat_through_the_hand_is_seen_from_its_own_side(hand):
    """No point is deeper than 2 mm in a slat of 4 mm, but the slat is far deeper in the hand."""
    slat = trimesh.creation.box((0.004, 0.6, 0.6))
    middle = np.array([0.10, 0.0, 0.0])
    found = link_distances(
        hand,
        RigidPoses(-middle[None], still(1).rotations),
        PosedObject(shape_of_mesh(slat), still(1), 1.0),
        np.zeros(1, bool),
    )
    assert 0.0 < -found.skin[0] <= 0.0021
    assert found.depth[0] > 0.008


def test_a_wall_of_eight_metres_is_seen_as_a_board_is(hand):
    middle = np.array([0.10, 0.0, 0.0])
    link = RigidPoses(-middle[None], still(1).rotations)
    walls = [trimesh.creation.box((0.004, side, side)) for side in (0.6, 8.0)]
    board, wall = (
        link_distances(hand, link, PosedObject(shape_of_mesh(mesh), still(1), 1.0), np.ones(1, bool)) for mesh in walls
    )
    np.testing.assert_allclose(wall.skin, board.skin, atol=1e-6)
    np.testing.assert_allclose(wall.depth, board.depth, atol=2e-3)


def test_what_the_hand_has_swallowed_is_inside(hand):
    pea = trimesh.creation.icosphere(3, 0.003)
    depth = hand.solid.distances(hand.points - 0.008 * hand.normals)
    middle = hand.points[depth.argmin()] - 0.008 * hand.normals[depth.argmin()]
    found = link_distances(
        hand,
        RigidPoses(-middle[None], still(1).rotations),
        PosedObject(shape_of_mesh(pea), still(1), 1.0),
        np.zeros(1, bool),
    )
    assert found.depth[0] > 0.004


def test_a_shell_has_no_inside_but_is_seen_in_the_hand(hand):
    sheet = trimesh.Trimesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]], process=False)
    shape = shape_of_mesh(sheet)
    assert shape.field.shell
    through = RigidPoses(np.array([[-0.1, 0.0, 0.0], [0.0, 0.0, 0.5]]), still(2).rotations)
    found = link_distances(hand, through, PosedObject(shape, still(2), 1.0), np.ones(2, bool))
    assert -0.001 <= found.skin[0] < 0.0
    assert found.depth[0] > 0.01
    np.testing.assert_allclose(found.skin[1], 0.5 + hand.points[:, 2].min() - 0.001, atol=1e-6)


def test_a_knee_below_the_floor_is_seen():
    model = load_robot("unitree_g1")
    qpos = model.home_qpos.copy()
    heights = link_heights(model.forward(qpos[None]))[:, 0]
    links = [link.link for link in skin_of(model).links]
    qpos[2] -= heights[links.index("left_knee_link")] + 0.03
    lowered = link_heights(model.forward(qpos[None]))[:, 0]
    np.testing.assert_allclose(lowered[links.index("left_knee_link")], -0.03, atol=1e-9)
    knee = skin_of(model).by_link["left_knee_link"]
    pose = RigidPoses.of_link(model.forward(qpos[None]), knee)
    np.testing.assert_allclose((knee.points @ pose.rotations[0].T + pose.positions[0])[:, 2].min(), -0.03, atol=1e-9)


def test_hands_in_each_other_and_in_the_thigh_are_seen_but_not_neighbours():
    model = load_robot("unitree_g1")
    links = [link.link for link in skin_of(model).links]
    pairs = {frozenset((links[one], links[other])) for one, other in self_collision_pairs(model)}
    assert frozenset((HAND, "right_wrist_yaw_link")) in pairs
    assert frozenset((HAND, "left_hip_yaw_link")) in pairs
    assert frozenset((HAND, "left_wrist_roll_link")) not in pairs
    standing = model.forward(model.home_qpos[None])
    depths, _, _ = self_depths(standing)
    assert depths.max() == 0.0
    qpos = np.tile(model.home_qpos, (2, 1))
    for joint, angle in (
        ("left_shoulder_roll_joint", -0.5),
        ("left_shoulder_pitch_joint", 0.3),
        ("left_elbow_joint", 1.5),
    ):
        qpos[1, 7 + model.joint_names.index(joint)] = angle
    depths, worst, names = self_depths(model.forward(qpos))
    assert depths[0] == 0.0
    assert depths[1] > 0.005
    assert any("left" in name for name in names[worst[1]])


@pytest.mark.parametrize("seed", range(4))
def test_links_are_as_deep_in_each_other_as_the_deepest_of_all_their_points(hand, seed):
    random = np.random.default_rng(seed)
    thigh, frames = skin_of(load_robot("unitree_g1")).by_link["left_hip_yaw_link"], 40
    turns = se3.quat_to_matrix(se3.quat_normalize(random.normal(size=(2, frames, 4))))
    # Centres are apart by all that lies between the same place and two balls that touch.
    away = se3.rotate(se3.quat_normalize(random.normal(size=(frames, 4))), np.array([1.0, 0.0, 0.0]))
    away *= random.uniform(0.0, hand.radius + thigh.radius, size=(frames, 1))
    one, other = (
        PosedLink(skin, RigidPoses(centre - turned @ skin.centre, turned), centre)
        for skin, turned, centre in zip((hand, thigh), turns, (away, np.zeros((frames, 3))), strict=True)
    )
    expected = np.zeros(frames)
    for skin, solid in ((one, other), (other, one)):
        inside = skin.pose.relative_to(solid.pose)
        points = np.einsum("fij,kj->fki", inside.rotations, skin.skin.points) + inside.positions[:, None]
        deep = -solid.skin.solid.distances(points.reshape(-1, 3)).reshape(frames, -1)
        expected = np.maximum(expected, deep.max(axis=1))
    (depths,), _ = pair_depths([one], [other], [(0, 0)], keep_all=True)
    np.testing.assert_allclose(depths, expected, atol=1e-9)
    assert (depths > 0.0).any() and (depths == 0.0).any()


@pytest.mark.slow
def test_robots_without_a_skin_file_are_measured_too(tmp_path):
    from tiny_robot import tiny_robot

    model = tiny_robot(tmp_path)
    assert model.spec.skin is None
    heights = link_heights(model.forward(model.home_qpos[None]))
    assert heights.shape == (len(skin_of(model).links), 1)
    assert np.isfinite(self_depths(model.forward(model.home_qpos[None]))[0]).all()
    assert replace(model.spec, skin=None) == model.spec


def test_what_stands_for_a_surface_is_told(tmp_path):
    box = trimesh.creation.box((0.3, 0.2, 0.1))
    corners = np.array(box.vertices)
    assert surface_kind(ObjectGeometry(corners, faces=np.array(box.faces))) == "solid"
    sheet = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    assert surface_kind(ObjectGeometry(sheet, faces=np.array([[0, 1, 2], [0, 2, 3]]))) == "shell"
    assert surface_kind(ObjectGeometry(corners)) == "hull"
    for name, kind in (("box.obj", "solid"), ("box_hull.obj", "hull")):
        box.export(tmp_path / name)
        assert surface_kind(ObjectGeometry(corners, mesh_path=tmp_path / name)) == kind
