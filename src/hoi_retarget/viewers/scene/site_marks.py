"""A robot's sites as balls with their axes."""

from collections.abc import Sequence

import numpy as np

from hoi_retarget.numerics import se3
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.viewers.scene.axes import axes
from hoi_retarget.viewers.scene.drawing import Colour, Kind, Shapes

_BALL: Colour = (30, 32, 38)
_BALL_RADIUS, _AXIS_RADIUS = 0.16, 0.06
"""In lengths of the axes."""


def site_marks(kinematics: Kinematics, sites: Sequence[str], length: float) -> tuple[Shapes, Shapes]:
    """Return marks of sites over time, whose axes have a length [m]."""
    places = np.stack([kinematics.site_position(site) for site in sites], axis=1)
    quats = np.stack([se3.matrix_to_quat(kinematics.site_rotation(site)) for site in sites], axis=1)
    balls = Shapes(
        kind=Kind.SPHERE,
        sizes=np.full((len(sites), 3), _BALL_RADIUS * length, dtype=np.float32),
        colours=np.tile(np.array(_BALL, dtype=np.uint8), (len(sites), 1)),
        positions=places.astype(np.float32),
        quats=quats.astype(np.float32),
    )
    return balls, axes(places, quats, length, _AXIS_RADIUS * length)
