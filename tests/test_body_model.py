"""Parametric bodies: the laws of blend skinning, and their makers' files, on a tiny body of our own."""

import pickle
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csc_matrix

from body_writer import CORNERS, names_of, tiny_model, write_npz, write_pickle
from hoi_retarget.errors import ArgumentError, ClipError, ReadError
from hoi_retarget.files.array_pickle import parse_pickle
from hoi_retarget.human.body_model import JOINT_COUNT, BodyModel, BodyShape
from hoi_retarget.human.skeleton import JOINTS
from hoi_retarget.numerics import se3
from hoi_retarget.readers.body_parameters import load_body_model, person_from_smplx

FAST = settings(max_examples=10, deadline=None, derandomize=True, database=None)
FAMILIES = ("smplx", "smplh")
seeds = st.integers(0, 10_000)
families = st.sampled_from(FAMILIES)


@cache
def body(family: str, *, bent: bool = True) -> BodyModel:
    """The tiny body; without `bent`, poses displace no vertex before skinning."""
    values = tiny_model(family)
    parents = values["kintree_table"][0].astype(np.int64)
    parents[0] = -1
    return BodyModel(
        family=family,
        gender="neutral",
        template=values["v_template"],
        shape_directions=values["shapedirs"],
        pose_directions=values["posedirs"] * bent,
        regressor=values["J_regressor"],
        weights=values["weights"],
        parents=parents,
        faces=values["f"].astype(np.int64),
        left_components=values["hands_componentsl"],
        right_components=values["hands_componentsr"],
        left_mean=values["hands_meanl"],
        right_mean=values["hands_meanr"],
    )


def skin(model: BodyModel, betas: np.ndarray, pose: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """All vertices of a posed body."""
    positions, quats = model.joints(betas, pose, translation)
    return BodyShape(model, betas).skin(positions[:, model.skeleton_joints], quats[:, model.skeleton_joints])


def random_pose(family: str, seed: int, frames: int = 5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Betas, rotation vectors and a translation; jaw and eyes rest."""
    rng = np.random.default_rng(seed)
    pose = 0.5 * rng.normal(size=(frames, JOINT_COUNT[family], 3))
    pose[:, np.setdiff1d(np.arange(JOINT_COUNT[family]), body(family).skeleton_joints)] = 0.0
    return rng.normal(size=10), pose, rng.normal(size=(frames, 3))


# Laws


@pytest.mark.parametrize("family", FAMILIES)
def test_without_shape_and_pose_a_body_is_its_template(family):
    model = body(family)
    rest, still = np.zeros((3, JOINT_COUNT[family], 3)), np.zeros((3, 3))
    joints, quats = model.joints(np.zeros(10), rest, still)
    np.testing.assert_allclose(joints, np.tile(model.regressor @ model.template, (3, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(quats, np.broadcast_to(se3.IDENTITY_QUAT, quats.shape))
    np.testing.assert_allclose(skin(model, np.zeros(10), rest, still), np.tile(model.template, (3, 1, 1)), atol=1e-12)


@FAST
@given(family=families, seed=seeds)
def test_at_rest_joints_are_regressed_from_the_skin(family, seed):
    model, (betas, pose, translation) = body(family), random_pose(family, seed)
    rest = skin(model, betas, 0 * pose, translation)
    joints, _ = model.joints(betas, 0 * pose, translation)
    np.testing.assert_allclose(model.regressor @ rest, joints, atol=1e-12)


@FAST
@given(family=families, seed=seeds)
def test_turning_the_root_turns_everything_about_it(family, seed):
    model, (betas, pose, translation) = body(family), random_pose(family, seed)
    turn = se3.exp(np.random.default_rng(seed).normal(size=3))
    turned = pose.copy()
    turned[:, 0] = se3.log(se3.quat_multiply(turn, se3.exp(pose[:, 0])))
    before, after = skin(model, betas, pose, translation), skin(model, betas, turned, translation)
    root = model.joints(betas, pose, translation)[0][:, :1]
    np.testing.assert_allclose(after - root, se3.rotate(turn, before - root), atol=1e-9)


@FAST
@given(family=families, seed=seeds)
def test_a_translation_moves_joints_and_skin(family, seed):
    model, (betas, pose, translation) = body(family), random_pose(family, seed)
    for method in (partial(skin, model), lambda *arguments: model.joints(*arguments)[0]):
        moved = method(betas, pose, translation) - method(betas, pose, 0 * translation)
        np.testing.assert_allclose(moved, np.broadcast_to(translation[:, None], moved.shape), atol=1e-12)


@FAST
@given(family=families, seed=seeds)
def test_vertices_of_one_bone_are_rigid_with_it(family, seed):
    model, (betas, pose, translation) = body(family, bent=False), random_pose(family, seed)
    joints, quats = model.joints(betas, pose, translation)
    shaped = model.template + model.shape_directions[..., : len(betas)] @ betas
    local = shaped - np.repeat(model.regressor @ shaped, CORNERS, axis=0)
    expected = np.repeat(joints, CORNERS, axis=1) + se3.rotate(np.repeat(quats, CORNERS, axis=1), local)
    np.testing.assert_allclose(skin(model, betas, pose, translation), expected, atol=1e-9)


@FAST
@given(family=families, seed=seeds)
def test_all_frames_at_once_are_the_frames_one_by_one(family, seed):
    model, (betas, pose, translation) = body(family), random_pose(family, seed, frames=70)
    for method in (partial(skin, model), lambda *arguments: model.joints(*arguments)[0]):
        single = [method(betas, pose[t : t + 1], translation[t : t + 1])[0] for t in (0, 63, 64, 69)]
        np.testing.assert_allclose(method(betas, pose, translation)[[0, 63, 64, 69]], single, atol=1e-12)


def test_pose_displacements_follow_the_rotation_of_their_joint_alone():
    model = body("smplh")
    pose = np.zeros((1, 52, 3))
    pose[0, 5] = [0.3, -0.2, 0.1]
    change = se3.quat_to_matrix(se3.exp(pose[0, 5])) - np.eye(3)
    displaced = model.template + model.pose_directions[..., 9 * 4 : 9 * 5] @ change.reshape(-1)
    moves = (skin(model, np.zeros(1), pose, np.zeros((1, 3)))[0] - displaced).reshape(52, CORNERS, 3)
    np.testing.assert_allclose(moves[0], 0.0, atol=1e-12)
    assert np.abs(moves[5]).max() > 1e-3


@FAST
@given(family=families, seed=seeds, count=st.integers(1, 20))
def test_absent_betas_are_zero(family, seed, count):
    model, (_, pose, translation) = body(family), random_pose(family, seed)
    betas = np.zeros(20)
    betas[:count] = np.random.default_rng(seed).normal(size=count)
    np.testing.assert_allclose(
        skin(model, betas[:count], pose, translation), skin(model, betas, pose, translation), atol=1e-12
    )


# Hands


@pytest.mark.parametrize("family", FAMILIES)
def test_hands_are_components_or_rotations_counted_from_the_mean_or_from_flat(family):
    model, rng = body(family), np.random.default_rng(0)
    trunk, hands = rng.normal(size=(4, 66)), rng.normal(size=(2, 4, 12))
    full = [hands[0] @ model.left_components[:12], hands[1] @ model.right_components[:12]]
    reduced = model.pose(trunk, hands[0], hands[1], flat_hands=True)
    np.testing.assert_allclose(reduced, model.pose(trunk, *full, flat_hands=True), atol=1e-12)
    curled = model.pose(trunk, hands[0], hands[1], flat_hands=False) - reduced
    means = np.concatenate([model.left_mean, model.right_mean]).reshape(30, 3)
    np.testing.assert_allclose(curled[:, -30:], np.broadcast_to(means, (4, 30, 3)), atol=1e-12)
    np.testing.assert_array_equal(curled[:, :-30], 0.0)
    np.testing.assert_array_equal(reduced[:, :22], trunk.reshape(4, 22, 3))


@pytest.mark.parametrize("family", FAMILIES)
def test_skeleton_joints_are_those_of_the_vocabulary(family):
    names = names_of(family)
    assert tuple(names[index] for index in body(family).skeleton_joints) == JOINTS


# Files


def same(model: BodyModel, values: dict[str, np.ndarray]) -> None:
    for name, key in (
        ("template", "v_template"),
        ("shape_directions", "shapedirs"),
        ("pose_directions", "posedirs"),
        ("regressor", "J_regressor"),
        ("weights", "weights"),
        ("faces", "f"),
        ("left_components", "hands_componentsl"),
        ("right_mean", "hands_meanr"),
    ):
        np.testing.assert_allclose(getattr(model, name), values[key], err_msg=name)
    assert model.parents[0] == -1
    np.testing.assert_array_equal(model.parents[1:], values["kintree_table"][0, 1:])


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("sparse", [True, False])
@pytest.mark.parametrize("chumpy", [True, False])
def test_both_layouts_hold_the_same_body(family, sparse, chumpy, tmp_path):
    values = tiny_model(family, shapes=16)
    same(load_body_model(write_npz(tmp_path / "model.npz", values), "male", family), values)
    path = write_pickle(tmp_path / "model.pkl", values, sparse=sparse, chumpy=chumpy)
    same(load_body_model(path, "male", family), values)


@pytest.mark.parametrize(
    "name",
    ["SMPLX_FEMALE.npz", "smplx/SMPLX_FEMALE.pkl", "female/model.npz", "smplx/female/model.pkl", "SMPLX_female.pkl"],
)
def test_a_folder_is_searched_by_the_makers_names(name, tmp_path):
    write = write_npz if name.endswith("npz") else write_pickle
    write(tmp_path / name, tiny_model("smplx", shapes=16))
    assert load_body_model(tmp_path, "female", "smplx").gender == "female"
    with pytest.raises(ReadError, match="there is no male smplx model in this folder"):
        load_body_model(tmp_path, "male", "smplx")


@pytest.mark.parametrize(("stored", "betas"), [(400, 300), (20, 10), (10, 10), (16, 16), (300, 300)])
def test_expressions_are_no_shape(stored, betas, tmp_path):
    path = write_npz(tmp_path / "model.npz", tiny_model("smplx", shapes=stored))
    assert load_body_model(path, "neutral", "smplx").betas == betas


def test_flat_pose_directions_are_the_same_ones(tmp_path):
    values = tiny_model("smplh")
    flat = values | {"posedirs": values["posedirs"].reshape(-1, values["posedirs"].shape[-1]).T}
    same(load_body_model(write_npz(tmp_path / "model.npz", flat), "male", "smplh"), values)


# What is refused


def parameters_of(pose: np.ndarray, betas: np.ndarray, translation: np.ndarray) -> dict[str, np.ndarray]:
    """Under SMPL-X's names; jaw and eyes are between body and hands."""
    rows = {"global_orient": (0, 1), "body_pose": (1, 22), "left_hand_pose": (25, 40), "right_hand_pose": (40, 55)}
    flat = {name: pose[:, first:stop].reshape(len(pose), -1) for name, (first, stop) in rows.items()}
    return {**flat, "betas": betas, "transl": translation}


def test_a_person_of_smplx_parameters_is_where_the_model_puts_it(tmp_path):
    write_npz(tmp_path / "SMPLX_NEUTRAL.npz", tiny_model("smplx"))
    model, (betas, pose, translation) = body("smplx"), random_pose("smplx", 3)
    values = parameters_of(pose, betas, translation)
    person = person_from_smplx(values, tmp_path)
    positions, quats = model.joints(betas, pose, translation)
    np.testing.assert_allclose(person.joint_positions, positions[:, model.skeleton_joints], atol=1e-12)
    np.testing.assert_allclose(person.joint_quats, quats[:, model.skeleton_joints], atol=1e-12)
    shaped = {**values, "body_pose": pose[:, 1:22].tolist()}  # As others store it, in lists and three by three.
    np.testing.assert_array_equal(person_from_smplx(shaped, str(tmp_path)).joint_positions, person.joint_positions)
    assert person.fingers_recorded


def test_hands_that_smplx_parameters_lack_are_flat_and_said_to_be_made_up(tmp_path):
    write_npz(tmp_path / "SMPLX_NEUTRAL.npz", tiny_model("smplx"))
    values = parameters_of(random_pose("smplx", 3)[1], np.zeros(10), np.zeros((5, 3)))
    hands = [name for name in values if "hand" in name]
    without = person_from_smplx({name: values[name] for name in values if name not in hands}, tmp_path)
    flat = person_from_smplx({**values, **dict.fromkeys(hands, np.zeros((5, 45)))}, tmp_path)
    assert flat.fingers_recorded and not without.fingers_recorded
    np.testing.assert_array_equal(flat.joint_positions, without.joint_positions)


@pytest.mark.parametrize("name", ["transl", "body_pose", "betas"])
def test_smplx_parameters_that_are_missing_are_named(name, tmp_path):
    values = parameters_of(random_pose("smplx", 3)[1], np.zeros(10), np.zeros((5, 3)))
    del values[name]
    with pytest.raises(ClipError, match=name):
        person_from_smplx(values, tmp_path)


def test_names_that_do_not_exist_are_refused(tmp_path):
    with pytest.raises(ArgumentError, match=r"no gender 'other'.*neutral, male, female"):
        load_body_model(tmp_path, "other", "smplx")
    with pytest.raises(ArgumentError, match=r"no family 'smpl'.*smplx, smplh"):
        load_body_model(tmp_path, "male", "smpl")
    with pytest.raises(ReadError, match="there is no such file"):
        load_body_model(tmp_path / "absent.npz", "male", "smplx")


def test_another_family_is_named(tmp_path):
    path = write_npz(tmp_path / "model.npz", tiny_model("smplh"))
    with pytest.raises(ReadError, match="52 joints, as smplh has; smplx has 55"):
        load_body_model(path, "male", "smplx")
    with pytest.raises(ArgumentError, match="52 joints, which is smplh's; this smplx model has 55"):
        body("smplx").joints(np.zeros(10), np.zeros((4, 52, 3)), np.zeros((4, 3)))


def test_more_than_the_model_has_is_refused():
    with pytest.raises(ArgumentError, match="21 betas are given; this neutral smplx model has 20"):
        skin(body("smplx"), np.zeros(21), np.zeros((4, 55, 3)), np.zeros((4, 3)))
    with pytest.raises(ArgumentError, match="46 numbers a frame; expected 45"):
        body("smplx").pose(np.zeros((4, 66)), np.zeros((4, 46)), np.zeros((4, 46)), flat_hands=True)


@pytest.mark.parametrize(
    "name", ["v_template", "shapedirs", "posedirs", "J_regressor", "weights", "kintree_table", "f"]
)
def test_wrong_shapes_missing_arrays_and_infinite_numbers_are_one_error(name, tmp_path):
    values = tiny_model("smplh")
    without = {key: value for key, value in values.items() if key != name}
    with pytest.raises(ReadError, match=f"lacks {name}"):
        load_body_model(write_npz(tmp_path / "missing.npz", without), "male", "smplh")
    array = values[name]
    narrow = {"f": array + 10_000, "shapedirs": array[:, :2]}.get(name, array[..., :-1])
    few = array[:, :2] if name == "f" else array[:0]
    for index, wrong in enumerate((narrow, few, np.float64(3.0))):
        with pytest.raises(ReadError, match=r"wrong\d\.npz: "):
            load_body_model(write_npz(tmp_path / f"wrong{index}.npz", values | {name: wrong}), "male", "smplh")
    if name not in ("kintree_table", "f"):
        with pytest.raises(ReadError, match="not finite"):
            load_body_model(write_npz(tmp_path / "nan.npz", values | {name: values[name] * np.nan}), "male", "smplh")


@pytest.mark.parametrize("write", [write_npz, write_pickle])
def test_cut_off_files_are_one_error(write, tmp_path):
    content = (
        write(tmp_path / "whole", tiny_model("smplh", shapes=2))
        .with_suffix(".npz" if write is write_npz else "")
        .read_bytes()
    )
    for stop in (0, 1, 10, len(content) // 3, len(content) - 1):
        path = tmp_path / "cut.pkl"
        path.write_bytes(content[:stop])
        with pytest.raises(ReadError, match=r"cut\.pkl"):
            load_body_model(path, "male", "smplh")


class _Runs:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def test_nothing_in_a_pickle_is_executed(tmp_path):
    path, proof = tmp_path / "model.pkl", tmp_path / "proof"
    path.write_bytes(pickle.dumps(tiny_model("smplh") | {"J": _Runs(proof)}, protocol=2))
    with pytest.raises(ReadError, match="refused"):
        load_body_model(path, "male", "smplh")
    assert not proof.exists()


def test_only_body_models_may_hold_chumpys_arrays(tmp_path):
    path = write_pickle(tmp_path / "model.pkl", tiny_model("smplh"))
    with pytest.raises(ReadError):
        parse_pickle(path.read_bytes(), path)


def test_a_sparse_matrix_that_contradicts_itself_is_refused(tmp_path):
    path = write_pickle(tmp_path / "model.pkl", tiny_model("smplh"))
    content = path.read_bytes()
    at = content.index(b"U\x06_shape") + 2
    damaged = content[:at] + b"_shapf" + content[at + 6 :]
    path.write_bytes(damaged)
    with pytest.raises(ReadError, match="sparse matrix has no shape"):
        load_body_model(path, "male", "smplh")


def test_an_array_inside_itself_is_refused(tmp_path):
    path = tmp_path / "model.pkl"
    # An object of chumpy whose numbers are itself: {"v_template": it, "f": it, ...}.
    ring = b"cchumpy.ch\nCh\n)\x81q\x00}U\x01xh\x00sb"
    names = ("v_template", "shapedirs", "posedirs", "J_regressor", "weights", "kintree_table", "f")
    items = b"".join(
        b"U" + bytes([len(name)]) + name.encode() + (b"h\x00" if index else ring) for index, name in enumerate(names)
    )
    path.write_bytes(b"\x80\x02}(" + items + b"u.")
    with pytest.raises(ReadError, match="inside one another more than"):
        load_body_model(path, "male", "smplh")


def test_a_huge_sparse_matrix_is_not_unfolded(tmp_path):
    values = tiny_model("smplh")
    huge = csc_matrix((1 << 26, 52))
    with pytest.raises(ReadError, match="sparse matrix has no shape"):
        load_body_model(write_pickle(tmp_path / "model.pkl", values, regressor=huge), "male", "smplh")
