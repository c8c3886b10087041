"""Laws of bones, trunks and made-up fingers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hoi_retarget.human.skeleton import (
    BODY_PARENTS,
    JOINT_INDEX,
    LEFT_FINGERS,
    PARENTS,
    RIGHT_FINGERS,
    add_straight_fingers,
    bone_deviations,
    bones_in_parents,
    trunk_rotations,
    world_positions,
)
from hoi_retarget.numerics import se3
from synthetic import make

FRAMES = 6
PERSON = make("carry_box", seconds=1.0).people[0]
seeds = st.integers(0, 1000)


def random_body(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a path of the root, bones and rotations of the body's joints."""
    rng, joints = np.random.default_rng(seed), len(BODY_PARENTS)
    return rng.normal(size=(FRAMES, 3)), rng.normal(size=(joints, 3)), se3.exp(rng.normal(size=(FRAMES, joints, 3)))


@given(seed=seeds)
def test_bones_of_rigid_bodies_are_found_again_and_do_not_deviate(seed):
    root, bones, quats = random_body(seed)
    positions = world_positions(root, bones, quats, BODY_PARENTS)
    np.testing.assert_array_equal(positions[:, 0], root)
    found = bones_in_parents(positions, quats, BODY_PARENTS)
    assert not found[:, 0].any(), "the root has no bone"
    np.testing.assert_allclose(found[:, 1:], np.broadcast_to(bones[1:], found[:, 1:].shape), atol=1e-12)
    np.testing.assert_allclose(bone_deviations(found), 0.0, atol=1e-12)


@given(seed=seeds, joint=st.integers(0, len(BODY_PARENTS) - 1))
def test_a_joint_that_leaves_its_place_deviates_by_its_distance_from_the_mean(seed, joint):
    bones = np.repeat(random_body(seed)[1][None], FRAMES, axis=0)
    bones[0, joint] += [0.0, 0.3, 0.4]
    expected = np.zeros((FRAMES, len(BODY_PARENTS)))
    expected[:, joint] = 0.5 / FRAMES
    expected[0, joint] = 0.5 * (1 - 1 / FRAMES)
    np.testing.assert_allclose(bone_deviations(bones), expected, atol=1e-12)


def test_parents_come_before_their_children_and_only_the_root_has_none():
    assert PARENTS[: len(BODY_PARENTS)] == BODY_PARENTS
    assert PARENTS[0] == -1 and all(0 <= parent < joint for joint, parent in enumerate(PARENTS) if joint)


@given(seed=seeds, lean=st.floats(0.0, 0.4))
def test_a_trunks_frame_goes_up_from_the_hips_and_turns_with_the_body(seed, lean):
    rng = np.random.default_rng(seed)
    body = {
        "left_hip": [0.0, 0.1, 0.0],
        "right_hip": [0.0, -0.1, 0.0],
        "left_shoulder": [lean, 0.25, 0.5],
        "right_shoulder": [lean, -0.25, 0.5],
    }
    turns, shift = se3.exp(rng.normal(size=(FRAMES, 3))), rng.normal(size=(FRAMES, 3))
    found = trunk_rotations(lambda name: shift + se3.rotate(turns, np.array([body[name]])))
    own = np.swapaxes(se3.quat_to_matrix(turns), 1, 2) @ found
    up = np.array([lean, 0.0, 0.5]) / np.hypot(lean, 0.5)
    ahead = np.array([up[2], 0.0, -up[0]])
    np.testing.assert_allclose(own, np.broadcast_to(np.stack([ahead, [0, 1, 0], up], axis=1), own.shape), atol=1e-12)


def test_straight_fingers_follow_the_forearm_in_length_and_the_wrist_in_rotation():
    positions = PERSON.joint_positions[:, None].copy()
    quats = PERSON.joint_quats[:, None].copy()
    fingers = [JOINT_INDEX[name] for name in (*LEFT_FINGERS, *RIGHT_FINGERS)]
    positions[:, :, fingers], quats[:, :, fingers] = np.nan, np.nan
    add_straight_fingers(positions, quats)
    for side, names in (("left", LEFT_FINGERS), ("right", RIGHT_FINGERS)):
        wrist, elbow = JOINT_INDEX[f"{side}_wrist"], JOINT_INDEX[f"{side}_elbow"]
        forearm = np.linalg.norm(positions[:, 0, wrist] - positions[:, 0, elbow], axis=1).mean()
        sign = 1.0 if side == "left" else -1.0
        for name in names:
            index = JOINT_INDEX[name]
            np.testing.assert_array_equal(quats[:, 0, index], quats[:, 0, wrist])
            offset = se3.rotate_inverse(quats[:, 0, wrist], positions[:, 0, index] - positions[:, 0, wrist])
            np.testing.assert_allclose(np.ptp(offset, axis=0), 0.0, atol=1e-12)
            bone, share = int(name[-1]), offset[0] * [sign, 1.0, 1.0] / forearm
            if "thumb" in name:
                assert share[2] > 0.1 and share[0] < 0.35
            else:
                assert share[0] == pytest.approx({1: 0.38, 2: 0.50, 3: 0.59}[bone]) and abs(share[1]) < 1e-12
    middle, pinky = (positions[:, 0, JOINT_INDEX[f"left_{name}1"]] for name in ("middle", "pinky"))
    thumb = positions[:, 0, JOINT_INDEX["left_thumb1"]]
    assert (np.linalg.norm(thumb - pinky, axis=1) > np.linalg.norm(thumb - middle, axis=1)).all()
