"""Laws of rotations, and their agreement with scipy's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hoi_retarget.numerics import se3

LAWS = settings(max_examples=60, deadline=None, derandomize=True, database=None)
TIGHT = 1e-12

components = st.floats(-1.0, 1.0, allow_subnormal=False)
vectors = st.tuples(*[st.floats(-10.0, 10.0, allow_subnormal=False)] * 3).map(np.array)
quats = (
    st.tuples(*[components] * 4)
    .map(np.array)
    .filter(lambda quat: np.linalg.norm(quat) > 0.1)
    .map(lambda quat: quat / np.linalg.norm(quat))
)
axes = st.tuples(*[components] * 3).map(np.array).filter(lambda axis: np.linalg.norm(axis) > 0.1)
axes = axes.map(lambda axis: axis / np.linalg.norm(axis))
# All magnitudes, with those at which formulas switch or lose digits.
angles = st.one_of(
    st.floats(0.0, np.pi),
    st.sampled_from([0.0, 1e-300, 1e-17, 1e-12, 1e-9, 1.9e-8, 2.1e-8, 1e-6, 1e-4, 1e-3, np.pi - 1e-6, np.pi - 1e-9]),
)


def scipy_of(quat: np.ndarray) -> Rotation:
    return Rotation.from_quat(quat, scalar_first=True)


def same_rotation(a: np.ndarray, b: np.ndarray, *, tolerance: float = TIGHT) -> bool:
    """Return whether two unit quaternions are equal up to sign, without the functions under test."""
    return bool(min(np.abs(a - b).max(), np.abs(a + b).max()) < tolerance)


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    return float(se3.angle_between(a[None], b[None])[0])


@LAWS
@given(a=quats, b=quats, c=quats)
def test_multiplication_is_associative(a, b, c):
    left = se3.quat_multiply(se3.quat_multiply(a, b), c)
    np.testing.assert_allclose(left, se3.quat_multiply(a, se3.quat_multiply(b, c)), atol=TIGHT)


@LAWS
@given(quat=quats)
def test_identity_and_inverse(quat):
    np.testing.assert_allclose(se3.quat_multiply(quat, se3.IDENTITY_QUAT), quat, atol=0)
    np.testing.assert_allclose(se3.quat_multiply(se3.IDENTITY_QUAT, quat), quat, atol=0)
    inverse = se3.quat_conjugate(quat)
    np.testing.assert_allclose(se3.quat_multiply(quat, inverse), se3.IDENTITY_QUAT, atol=TIGHT)
    np.testing.assert_allclose(se3.quat_multiply(inverse, quat), se3.IDENTITY_QUAT, atol=TIGHT)


def test_identity_is_read_only():
    with pytest.raises(ValueError, match="read-only"):
        se3.IDENTITY_QUAT[0] = 2.0


@LAWS
@given(a=quats, b=quats)
def test_products_are_scipys_and_those_of_matrices(a, b):
    product = se3.quat_multiply(a, b)
    assert same_rotation(product, (scipy_of(a) * scipy_of(b)).as_quat(scalar_first=True))
    np.testing.assert_allclose(se3.quat_to_matrix(product), se3.quat_to_matrix(a) @ se3.quat_to_matrix(b), atol=TIGHT)


@LAWS
@given(quat=quats)
def test_matrices_are_scipys_and_lead_back(quat):
    matrix = se3.quat_to_matrix(quat)
    np.testing.assert_allclose(matrix, scipy_of(quat).as_matrix(), atol=TIGHT)
    back = se3.matrix_to_quat(matrix)
    assert back[0] >= 0
    assert same_rotation(back, quat)


@pytest.mark.parametrize("largest", range(4))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_every_branch_of_matrix_to_quat(largest, sign):
    """Each component is the largest once, also alone (half turns) and nearly tied."""
    rng = np.random.default_rng(largest)
    alone = np.zeros(4)
    alone[largest] = sign
    tied = np.full(4, 0.4999)
    tied[largest] = sign * np.sqrt(1 - 3 * 0.4999**2)
    small = 1e-9 * rng.normal(size=4)
    small[largest] = sign
    for quat in (alone, tied, se3.quat_normalize(small), se3.quat_normalize(alone + 0.3 * rng.normal(size=4))):
        assert np.argmax(np.abs(quat)) == largest, "the branch under test must be taken"
        assert same_rotation(se3.matrix_to_quat(scipy_of(quat).as_matrix()), quat)


@LAWS
@given(quat=quats, vector=vectors)
def test_rotate_is_the_product_with_the_matrix(quat, vector):
    turned = se3.rotate(quat, vector)
    np.testing.assert_allclose(turned, se3.quat_to_matrix(quat) @ vector, atol=1e-11)
    np.testing.assert_allclose(turned, scipy_of(quat).apply(vector), atol=1e-11)
    np.testing.assert_allclose(np.linalg.norm(turned), np.linalg.norm(vector), atol=1e-11)


@LAWS
@given(quat=quats, vector=vectors)
def test_rotate_inverse_undoes_rotate(quat, vector):
    np.testing.assert_allclose(se3.rotate_inverse(quat, se3.rotate(quat, vector)), vector, atol=1e-11)
    np.testing.assert_allclose(se3.rotate_inverse(quat, vector), se3.quat_to_matrix(quat).T @ vector, atol=1e-11)


@LAWS
@given(axis=axes, angle=angles)
def test_log_undoes_exp_up_to_half_turns(axis, angle):
    vector = angle * axis
    quat = se3.exp(vector)
    assert np.linalg.norm(quat) == pytest.approx(1.0, abs=TIGHT)
    # Relative: near zero the digits of a small rotation must survive.
    np.testing.assert_allclose(se3.log(quat), vector, rtol=1e-9, atol=1e-9 * angle + 1e-300)
    assert same_rotation(quat, Rotation.from_rotvec(vector).as_quat(scalar_first=True))


@LAWS
@given(quat=quats)
def test_exp_undoes_log_and_both_signs_are_one_rotation(quat):
    vector = se3.log(quat)
    assert np.linalg.norm(vector) <= np.pi + TIGHT
    assert same_rotation(se3.exp(vector), quat)
    if abs(quat[0]) > 1e-6:  # Half turns have two vectors.
        np.testing.assert_allclose(se3.log(-quat), vector, atol=TIGHT)
        np.testing.assert_allclose(vector, scipy_of(quat).as_rotvec(), atol=1e-9)


def test_a_half_turn_has_length_pi():
    assert np.linalg.norm(se3.log(np.array([0.0, 0.6, 0.0, 0.8]))) == pytest.approx(np.pi)
    assert np.linalg.norm(se3.log(np.array([-1e-12, 0.6, 0.0, 0.8]))) == pytest.approx(np.pi)


@LAWS
@given(a=quats, b=quats, c=quats)
def test_angle_is_a_metric_that_no_turn_of_the_frame_changes(a, b, c):
    ab, bc, ac = angle_between(a, b), angle_between(b, c), angle_between(a, c)
    assert 0 <= ab <= np.pi + TIGHT
    assert angle_between(a, a) < 1e-12
    assert angle_between(a, -a) < 1e-12
    assert ab == pytest.approx(angle_between(b, a), abs=1e-9)
    assert ac <= ab + bc + 1e-9
    turned = angle_between(se3.quat_multiply(c, a), se3.quat_multiply(c, b))
    assert turned == pytest.approx(ab, abs=1e-9)
    assert ab == pytest.approx((scipy_of(a).inv() * scipy_of(b)).magnitude(), abs=1e-9)


@LAWS
@given(a=quats, axis=axes, angle=st.floats(0.0, np.pi - 1e-3), fraction=st.floats(0.0, 1.0), flip=st.booleans())
def test_slerp_goes_the_shorter_way_at_constant_speed(a, axis, angle, fraction, flip):
    step = Rotation.from_rotvec(angle * axis).as_quat(scalar_first=True)
    b = se3.quat_multiply(a, step) * (-1.0 if flip else 1.0)
    at = se3.slerp(a, b, np.array(fraction))
    assert same_rotation(se3.slerp(a, b, np.array(0.0)), a)
    assert same_rotation(se3.slerp(a, b, np.array(1.0)), b, tolerance=1e-9)
    assert angle_between(a, at) == pytest.approx(fraction * angle, abs=1e-9)
    assert angle_between(at, b) == pytest.approx((1 - fraction) * angle, abs=1e-9)
    middle = a + (np.sign(a @ b) or 1.0) * b
    assert same_rotation(se3.slerp(a, b, np.array(0.5)), middle / np.linalg.norm(middle), tolerance=1e-9)


@LAWS
@given(seed=st.integers(0, 1000), frames=st.integers(1, 30), joints=st.integers(1, 3))
def test_continuous_signs_keep_rotations_and_stay_in_one_hemisphere(seed, frames, joints):
    rng = np.random.default_rng(seed)
    walk = se3.exp(np.cumsum(0.3 * rng.normal(size=(frames, joints, 3)), axis=0))
    broken = walk * rng.choice([-1.0, 1.0], size=(frames, joints, 1))
    mended = se3.quat_continuous(broken)
    np.testing.assert_array_equal(np.abs(mended), np.abs(broken))
    np.testing.assert_allclose(se3.quat_to_matrix(mended), se3.quat_to_matrix(walk), atol=TIGHT)
    assert (np.sum(mended[1:] * mended[:-1], axis=-1) >= 0).all()
    np.testing.assert_array_equal(mended[0], broken[0])
    np.testing.assert_array_equal(se3.quat_continuous(mended), mended)


@LAWS
@given(quat=quats)
def test_scalar_last_is_scipys_order_and_leads_back(quat):
    last = se3.quat_to_xyzw(quat)
    np.testing.assert_allclose(Rotation.from_quat(last).as_matrix(), se3.quat_to_matrix(quat), atol=TIGHT)
    np.testing.assert_array_equal(se3.quat_from_xyzw(last), quat)


@LAWS
@given(quat=quats, length=st.floats(1e-3, 1e3))
def test_normalize_and_positive_keep_the_rotation(quat, length):
    np.testing.assert_allclose(se3.quat_normalize(length * quat), quat, atol=TIGHT)
    positive = se3.quat_positive(quat)
    assert positive[0] >= 0
    assert same_rotation(positive, quat, tolerance=1e-300)


@LAWS
@given(a=vectors, b=vectors)
def test_skew_is_the_cross_product(a, b):
    np.testing.assert_allclose(se3.skew(a) @ b, np.cross(a, b), atol=1e-11)
    np.testing.assert_array_equal(se3.skew(a).T, -se3.skew(a))


def test_stacks_are_their_items_one_by_one():
    """Every function on a stack of two axes, broadcast where it takes two arguments."""
    rng = np.random.default_rng(0)
    many, few = se3.quat_normalize(rng.normal(size=(4, 3, 4))), se3.quat_normalize(rng.normal(size=(1, 3, 4)))
    vector, fraction = rng.normal(size=(4, 1, 3)), rng.uniform(size=(4, 3))
    index = [(t, k) for t in range(4) for k in range(3)]

    def check(stacked: np.ndarray, one: object) -> None:
        for t, k in index:
            np.testing.assert_allclose(stacked[t, k], one(t, k), atol=TIGHT)  # pyright: ignore[reportCallIssue]

    check(se3.quat_multiply(many, few), lambda t, k: se3.quat_multiply(many[t, k], few[0, k]))
    check(se3.rotate(many, vector), lambda t, k: se3.rotate(many[t, k], vector[t, 0]))
    check(se3.rotate_inverse(many, vector), lambda t, k: se3.rotate_inverse(many[t, k], vector[t, 0]))
    check(se3.angle_between(many, few), lambda t, k: angle_between(many[t, k], few[0, k]))
    check(se3.slerp(many, few, fraction), lambda t, k: se3.slerp(many[t, k], few[0, k], np.array(fraction[t, k])))
    for function in (se3.quat_to_matrix, se3.log, se3.quat_positive, se3.quat_conjugate, se3.quat_to_xyzw):
        check(function(many), lambda t, k, function=function: function(many[t, k]))
    check(se3.exp(vector + 0 * many[..., 1:]), lambda t, k: se3.exp(vector[t, 0]))
    check(se3.skew(many[..., 1:]), lambda t, k: se3.skew(many[t, k, 1:]))
    matrices = se3.quat_to_matrix(many)
    check(se3.matrix_to_quat(matrices), lambda t, k: se3.matrix_to_quat(matrices[t, k]))


@settings(max_examples=50, deadline=None, derandomize=True)
@given(seed=st.integers(0, 999))
def test_the_angle_between_matrices_is_that_between_quaternions(seed):
    rng = np.random.default_rng(seed)
    a, b = se3.exp(rng.normal(size=(2, 20, 3)))
    found = se3.matrix_angle_between(se3.quat_to_matrix(a), se3.quat_to_matrix(b))
    np.testing.assert_allclose(found, se3.angle_between(a, b), atol=1e-7)


@LAWS
@given(start=axes, end=vectors)
def test_the_shortest_rotation_leads_there_about_an_axis_across(start, end):
    length = np.linalg.norm(end)
    if length < 1e-6:
        end, length = np.array([0.0, 2.0, 0.0]), 2.0
    quat = se3.shortest_rotation(start, end)
    assert np.linalg.norm(quat) == pytest.approx(1.0, abs=TIGHT)
    np.testing.assert_allclose(se3.rotate(quat, start), end / length, atol=1e-7)
    if start @ end / length > -0.999:
        assert abs(quat[1:] @ start) < 1e-9 and abs(quat[1:] @ end) < 1e-9 * length


@LAWS
@given(start=st.one_of(axes, st.sampled_from([*np.eye(3), *-np.eye(3)])))
def test_the_shortest_rotation_to_the_opposite_is_half_a_turn(start):
    quat = se3.shortest_rotation(start, -3.0 * start)
    np.testing.assert_allclose(se3.rotate(quat, start), -start, atol=1e-7)
    assert abs(quat[0]) < 1e-7 and np.linalg.norm(quat) == pytest.approx(1.0, abs=TIGHT)
    if start[2] == 0.0:
        np.testing.assert_allclose(np.abs(quat), [0.0, 0.0, 0.0, 1.0], atol=1e-7)


def test_the_shortest_rotation_to_nowhere_is_none():
    np.testing.assert_array_equal(se3.shortest_rotation(np.array([0.0, 0.0, 1.0]), np.zeros(3)), se3.IDENTITY_QUAT)
