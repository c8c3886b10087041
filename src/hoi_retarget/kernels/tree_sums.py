"""Forward kinematics, and normal equations of rows that depend on the poses of frames."""

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.errors import ArgumentError
from hoi_retarget.kernels.library import at, function, real, whole

_MOST_COORDINATES = 256  # Of a robot: the size of an array in `tree.c`.
_FORWARD = function("forward", "pppppiipp")
_ADD_ROWS = function("add_rows", "ppiippppippdii")
_ADD_TREE = function("add_tree", "pppippppiiipp")


def forward(  # noqa: PLR0913, PLR0917  # the parts of a tree
    parents: Int[np.ndarray, "n"],
    offsets: Float[np.ndarray, "3 n"],
    hinge_rotations: Float[np.ndarray, "3 3 3 n"],
    theta: Float[np.ndarray, "n T"],
    rotation: Float[np.ndarray, "3 3 N T"],
    position: Float[np.ndarray, "3 N T"],
) -> None:
    """Fill in the poses of all nodes but the root's, as `RobotModel.forward` has them.

    Args: `parents`: node before each hinge; `offsets`: of hinges in the frames of these [m]; `hinge_rotations`:
    constant part, and parts that the cosine and the sine of an angle multiply; `theta`: angles [rad]; `rotation`: of
    the nodes; the root's are given; `position`: of the nodes [m].
    """
    cosine, sine = np.cos(theta), np.sin(theta)
    own = whole(parents), real(offsets), real(hinge_rotations), cosine, sine
    _FORWARD(*map(at, own), *theta.shape, at(rotation), at(position))


class RowSums:
    """Sums of rows of T frames that depend on the poses of nodes: matrices and forces by frame and node."""

    def __init__(self, frames: int, nodes: int) -> None:
        self.matrices, self.forces = np.zeros((frames, nodes, 6, 6)), np.zeros((frames, nodes, 6))

    def add(  # noqa: PLR0913, PLR0917  # the parts of rows
        self,
        node: int,
        residual: Float[np.ndarray, "m F"],
        by_linear: Float[np.ndarray, "m 3 F"] | None,
        by_angular: Float[np.ndarray, "m 3 F"] | None,
        levers: Float[np.ndarray, "3 T"] | None,
        weight: float | Float[np.ndarray, "F"],
        frames: Int[np.ndarray, "F"] | None,
    ) -> None:
        """Add the rows of one frame fixed to a node, as `FrameRows` has them.

        Args: `node`: that carries the frame; `residual`: of the rows; `by_linear`: derivative by the frame's velocity
        in world axes; `by_angular`: derivative by its angular velocity; `levers`: from the root to the frame [m];
        `weight`: of the rows; `frames`: of the trajectory; None for all.
        """
        parts = [None if part is None else real(part) for part in (residual, by_linear, by_angular, levers)]
        chosen = None if frames is None else whole(frames)
        weights = real(weight) if isinstance(weight, np.ndarray) else None
        _ADD_ROWS(
            at(self.matrices), at(self.forces), self.matrices.shape[1], node, *map(at, parts), len(self.matrices),
            at(chosen), at(weights), 0.0 if weights is not None else weight, *residual.shape,
        )  # fmt: skip

    def to_band(  # noqa: PLR0913, PLR0917  # the parts of a tree
        self,
        parents: Int[np.ndarray, "n"],
        axes: Float[np.ndarray, "6 nv T"],
        column_nodes: Int[np.ndarray, "nv"],
        coupled: tuple[Int[np.ndarray, "nv nv"], Int[np.ndarray, "nv"]],
        band: Float[np.ndarray, "T nv width"],
        gradient: Float[np.ndarray, "T nv"],
    ) -> None:
        """Add the normal equations of the rows to a band and a gradient, in place; these sums are used up.

        Args: `parents`: node before each hinge; `axes`: twists of the tangent coordinates at the root; `column_nodes`:
        node that each coordinate moves first; `coupled`: `RobotModel.moving_columns`; `band`: of `NormalEquations`;
        `gradient`: of `NormalEquations`.
        """
        if len(column_nodes) > _MOST_COORDINATES:
            raise ArgumentError(
                f"a robot of {len(column_nodes)} coordinates; kernels know {_MOST_COORDINATES} at most."
            )
        axes = real(axes)
        numbers = [whole(part) for part in (parents, column_nodes, *coupled)]
        before, *after = map(at, numbers)
        _ADD_TREE(
            at(self.matrices), at(self.forces), before, self.matrices.shape[1], at(axes), *after,
            len(column_nodes), len(self.matrices), band.shape[2], at(band), at(gradient),
        )  # fmt: skip
