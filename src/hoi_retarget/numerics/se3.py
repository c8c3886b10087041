"""Rotations and rigid transforms in batched numpy; quaternions are wxyz everywhere.

All functions broadcast over leading axes. No other module indexes the components of a
quaternion; foreign orders are converted here, by name.
"""

import numpy as np
from jaxtyping import Float

Array = np.ndarray

IDENTITY_QUAT: Float[Array, "4"] = np.array([1.0, 0.0, 0.0, 0.0])
IDENTITY_QUAT.setflags(write=False)


def quat_from_xyzw(quat: Float[Array, "*batch 4"]) -> Float[Array, "*batch 4"]:
    """Return a scalar-last quaternion in the wxyz order of this package."""
    return np.roll(quat, 1, axis=-1)


def quat_to_xyzw(quat: Float[Array, "*batch 4"]) -> Float[Array, "*batch 4"]:
    """Return a wxyz quaternion in scalar-last order."""
    return np.roll(quat, -1, axis=-1)


def quat_normalize(quat: Float[Array, "*batch 4"]) -> Float[Array, "*batch 4"]:
    """Return the unit quaternion along `quat`, which must not be zero."""
    return quat / np.linalg.norm(quat, axis=-1, keepdims=True)


def quat_conjugate(quat: Float[Array, "*batch 4"]) -> Float[Array, "*batch 4"]:
    """Return the conjugate, which is the inverse of a unit quaternion."""
    return quat * np.array([1.0, -1.0, -1.0, -1.0])


def quat_multiply(a: Float[Array, "*#batch 4"], b: Float[Array, "*#batch 4"]) -> Float[Array, "*batch 4"]:
    """Return the Hamilton product `a b` of quaternions: first rotate by `b`, then by `a`."""
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def quat_mirrored(quat: Float[Array, "*batch 4"]) -> Float[Array, "*batch 4"]:
    """Return the rotation (quaternion) as seen in a mirror at the plane y = 0."""
    return quat * np.array([1.0, -1.0, 1.0, -1.0])


def quat_to_matrix(quat: Float[Array, "*batch 4"]) -> Float[Array, "*batch 3 3"]:
    """Return the rotation matrix of a unit quaternion."""
    w, x, y, z = np.moveaxis(quat, -1, 0)
    matrix = np.empty((*quat.shape[:-1], 3, 3))
    matrix[..., 0, 0] = 1 - 2 * (y * y + z * z)
    matrix[..., 0, 1] = 2 * (x * y - w * z)
    matrix[..., 0, 2] = 2 * (x * z + w * y)
    matrix[..., 1, 0] = 2 * (x * y + w * z)
    matrix[..., 1, 1] = 1 - 2 * (x * x + z * z)
    matrix[..., 1, 2] = 2 * (y * z - w * x)
    matrix[..., 2, 0] = 2 * (x * z - w * y)
    matrix[..., 2, 1] = 2 * (y * z + w * x)
    matrix[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return matrix


def matrix_to_quat(matrix: Float[Array, "*batch 3 3"]) -> Float[Array, "*batch 4"]:
    """Return the unit quaternion of a rotation matrix, with w >= 0.

    The largest of the four components is taken from the diagonal, so that no small
    number is divided by.
    """
    m00, m11, m22 = matrix[..., 0, 0], matrix[..., 1, 1], matrix[..., 2, 2]
    # Four times the squares of w, x, y, z.
    squares = np.stack([1 + m00 + m11 + m22, 1 + m00 - m11 - m22, 1 - m00 + m11 - m22, 1 - m00 - m11 + m22], axis=-1)
    wx = matrix[..., 2, 1] - matrix[..., 1, 2]
    wy = matrix[..., 0, 2] - matrix[..., 2, 0]
    wz = matrix[..., 1, 0] - matrix[..., 0, 1]
    xy = matrix[..., 0, 1] + matrix[..., 1, 0]
    xz = matrix[..., 0, 2] + matrix[..., 2, 0]
    yz = matrix[..., 1, 2] + matrix[..., 2, 1]
    # Row i is four times component i times the whole quaternion.
    rows = np.stack(
        [
            np.stack([squares[..., 0], wx, wy, wz], axis=-1),
            np.stack([wx, squares[..., 1], xy, xz], axis=-1),
            np.stack([wy, xy, squares[..., 2], yz], axis=-1),
            np.stack([wz, xz, yz, squares[..., 3]], axis=-1),
        ],
        axis=-2,
    )
    largest = np.argmax(squares, axis=-1)
    quat = np.take_along_axis(rows, largest[..., None, None], axis=-2)[..., 0, :]
    return quat_positive(quat_normalize(quat))


def quat_positive(quat: Float[Array, "*batch 4"]) -> Float[Array, "*batch 4"]:
    """Return the quaternion of the rotation with w >= 0."""
    return np.where(quat[..., :1] < 0, -quat, quat)


def quat_continuous(quat: Float[Array, "T *batch 4"]) -> Float[Array, "T *batch 4"]:
    """Return the same quaternions with signs such that neighbours in time are in one hemisphere."""
    flips = np.sum(quat[1:] * quat[:-1], axis=-1, keepdims=True) < 0
    signs = np.where(np.cumsum(flips, axis=0) % 2 == 1, -1.0, 1.0)
    return np.concatenate([quat[:1], quat[1:] * signs], axis=0)


def rotate(quat: Float[Array, "*#batch 4"], vector: Float[Array, "*#batch 3"]) -> Float[Array, "*batch 3"]:
    """Return `vector` rotated by a unit quaternion."""
    imaginary = quat[..., 1:]
    twice = 2.0 * _cross(imaginary, vector)
    return vector + quat[..., :1] * twice + _cross(imaginary, twice)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the vector product; numpy's own spends its time on arranging axes."""
    (a0, a1, a2), (b0, b1, b2) = ((v[..., 0], v[..., 1], v[..., 2]) for v in (a, b))
    return np.stack([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0], axis=-1)


def rotate_inverse(quat: Float[Array, "*#batch 4"], vector: Float[Array, "*#batch 3"]) -> Float[Array, "*batch 3"]:
    """Return `vector` rotated by the inverse of a unit quaternion."""
    return rotate(quat_conjugate(quat), vector)


def exp(rotation_vector: Float[Array, "*batch 3"]) -> Float[Array, "*batch 4"]:
    """Return the unit quaternion of a rotation vector [rad]."""
    half = 0.5 * np.linalg.norm(rotation_vector, axis=-1, keepdims=True)
    # np.sinc(x) is sin(pi x) / (pi x), smooth at zero.
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * rotation_vector], axis=-1)


def log(quat: Float[Array, "*batch 4"]) -> Float[Array, "*batch 3"]:
    """Return the rotation vector [rad] of a unit quaternion, of length at most pi."""
    positive = quat_positive(quat)
    imaginary = positive[..., 1:]
    sine = np.linalg.norm(imaginary, axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, positive[..., :1])
    small = sine < 1e-8
    return imaginary * np.where(small, 2.0, angle / np.where(small, 1.0, sine))


def angle_between(a: Float[Array, "*#batch 4"], b: Float[Array, "*#batch 4"]) -> Float[Array, "*batch"]:
    """Return the angle [rad] of the rotation from `a` to `b`, in [0, pi]."""
    return np.linalg.norm(log(quat_multiply(quat_conjugate(a), b)), axis=-1)


def matrix_angle_between(a: Float[Array, "*#batch 3 3"], b: Float[Array, "*#batch 3 3"]) -> Float[Array, "*batch"]:
    """Return the angle [rad] of the rotation from `a` to `b`, in [0, pi].

    From the chord: the Frobenius distance of two rotations is 2 sqrt(2) sin(angle / 2).
    """
    difference = a - b
    chord = np.sqrt(np.einsum("...ij,...ij->...", difference, difference))
    return 2.0 * np.arcsin(np.minimum(chord / np.sqrt(8.0), 1.0))


def shortest_rotation(start: Float[Array, "3"], end: Float[Array, "3"]) -> Float[Array, "4"]:
    """Return the shortest rotation from a unit vector to a direction; none to a vector of no length."""
    end = end / max(float(np.linalg.norm(end)), 1e-9)
    quat = np.concatenate([[1.0 + start @ end], np.cross(start, end)])
    length = float(np.linalg.norm(quat))
    if length > 1e-6:
        return quat / length
    # Half a turn for opposite ones, about a vector across them: z where it is one.
    across = np.array([0.0, 0.0, 1.0]) - start[2] * start if abs(start[2]) < 0.9 else np.cross(start, [0.0, 1.0, 0.0])
    return np.concatenate([[0.0], across / np.linalg.norm(across)])


def mean_rotation(quats: Float[Array, "K 4"]) -> Float[Array, "3 3"]:
    """Return the rotation matrix that is nearest to all of some rotations, in the Frobenius norm."""
    left, _, right = np.linalg.svd(quat_to_matrix(quats).mean(axis=0))
    return left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right


def slerp(
    a: Float[Array, "*#batch 4"], b: Float[Array, "*#batch 4"], fraction: Float[Array, "*#batch"]
) -> Float[Array, "*batch 4"]:
    """Return the rotation at `fraction` of the shorter way from `a` to `b`."""
    step = log(quat_multiply(quat_conjugate(a), b))
    return quat_multiply(a, exp(np.asarray(fraction)[..., None] * step))


def skew(vector: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3 3"]:
    """Return the matrix `S` with `S v = vector x v`, in the unit of the vector."""
    matrix = np.zeros((*vector.shape[:-1], 3, 3))
    matrix[..., 2, 1], matrix[..., 1, 2] = vector[..., 0], -vector[..., 0]
    matrix[..., 0, 2], matrix[..., 2, 0] = vector[..., 1], -vector[..., 1]
    matrix[..., 1, 0], matrix[..., 0, 1] = vector[..., 2], -vector[..., 2]
    return matrix
