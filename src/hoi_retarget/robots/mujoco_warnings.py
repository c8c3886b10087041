"""MuJoCo's warnings, which it would write into a file `MUJOCO_LOG.TXT` in the current folder."""

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco


@contextmanager
def quiet() -> Iterator[None]:
    """Keep MuJoCo from writing its warnings into a log file in the current folder."""
    told = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(_ignore)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(told)


def _ignore(_: str) -> None:
    """Take a warning: simulations count theirs, and of descriptions it is said what was found."""
